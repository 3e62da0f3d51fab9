"""Interpolators and other baselines."""
