"""Verification on poses that took no part in the fit or the choice (method.md §5)."""

from truepose.verification.accuracy import Accuracy, Coverage, accuracy, coverage, mean_noise, summary
from truepose.verification.iso9283 import Attained, Iso9283, PoseFigures

__all__ = [
    "Accuracy",
    "Attained",
    "Coverage",
    "Iso9283",
    "PoseFigures",
    "accuracy",
    "coverage",
    "mean_noise",
    "summary",
]
