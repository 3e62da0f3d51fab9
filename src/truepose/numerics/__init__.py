"""Compiled formulas and sums, small systems, and the threads that they use."""
