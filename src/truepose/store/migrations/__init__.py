"""Migrations of a store, run by Alembic."""
