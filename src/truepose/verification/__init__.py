"""Verification on poses that took no part in the fit or the choice (method.md §5)."""

from truepose.verification.accuracy import Accuracy, Coverage, accuracy, coverage, mean_noise, summary

__all__ = ["Accuracy", "Coverage", "accuracy", "coverage", "mean_noise", "summary"]
