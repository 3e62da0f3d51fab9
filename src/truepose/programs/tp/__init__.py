"""FANUC TP (.ls)."""
