"""Experiments on virtual robots: the demonstration, the paper's, and ISO 9283."""
