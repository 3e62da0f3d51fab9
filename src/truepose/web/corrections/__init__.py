"""Corrections: tables of targets, differences by byte, and files to download."""
