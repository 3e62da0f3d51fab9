"""Layouts of measurement files, one module each."""
