"""The choice among predictors by nested cross-validation."""
