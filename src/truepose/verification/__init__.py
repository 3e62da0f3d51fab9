"""Verification on poses that took no part in the fit or the choice (method.md §5)."""

from truepose.verification.accuracy import Accuracy, Coverage, accuracy, coverage, summary
from truepose.verification.splits import block_folds, random_folds

__all__ = ["Accuracy", "Coverage", "accuracy", "block_folds", "coverage", "random_folds", "summary"]
