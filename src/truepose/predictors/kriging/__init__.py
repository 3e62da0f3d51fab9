"""Kriging: simple, ordinary and universal, of vectors, from the nearest samples, and Vecchia's approximation."""
