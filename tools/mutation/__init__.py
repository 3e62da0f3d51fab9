"""Mutation of single lines: `mutants` makes them, `recording` finds the tests that reach them, `killing` runs these."""
