"""Choose among predictors by nested cross-validation."""
