"""The layouts of measurement files."""
