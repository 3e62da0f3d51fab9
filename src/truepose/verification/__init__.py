"""Verify error models on poses that took no part in the fit or the choice (theory, verification)."""

from truepose.verification.accuracy import Accuracy, IntervalCoverage, accuracy, coverage, mean_noise, summary
from truepose.verification.conformity import conformity
from truepose.verification.held_out import RP_PER_STD, HeldOut, held_out, usual_groups
from truepose.verification.performance import Attained, Iso9283, PoseFigures

__all__ = [
    "RP_PER_STD",
    "Accuracy",
    "Attained",
    "HeldOut",
    "IntervalCoverage",
    "Iso9283",
    "PoseFigures",
    "accuracy",
    "conformity",
    "coverage",
    "held_out",
    "mean_noise",
    "summary",
    "usual_groups",
]
