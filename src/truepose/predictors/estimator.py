"""scikit-learn's contract of estimators without importing scikit-learn, which takes longer than a small fit.

scikit-learn asks an estimator for its parameters and tags, and never for a base class: `clone`, pipelines and searches
take these estimators as their own. It need not be installed; it is imported when it asks, to check inputs that are no
plain arrays, and for its class of the error that a model is not fitted.
"""

from __future__ import annotations

from copy import deepcopy
from inspect import Parameter, signature
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose.errors import DataError


class Estimator:
    """Base of regressors whose parameters are the arguments of ``__init__``, each stored under its name."""

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the parameters by name; if `deep`, those of parameters that are estimators follow as ``name__inner``.

        Parameters
        ----------
        deep : bool
            Whether the parameters of inner estimators are returned as well.
        """
        own = {name: getattr(self, name) for name in self._defaults()}
        if not deep:
            return own
        inner = {
            f"{name}__{key}": one
            for name, value in own.items()
            if hasattr(value, "get_params") and not isinstance(value, type)
            for key, one in value.get_params().items()
        }
        return own | inner

    def set_params(self, **params: Any) -> Self:
        """Set parameters by name, those of inner estimators as ``name__inner``.

        Raises
        ------
        DataError
            If a name is none of the parameters.
        """
        inner: dict[str, dict[str, Any]] = {}
        known = self._defaults()
        for name, value in params.items():
            own, apart, rest = name.partition("__")
            if own not in known:
                raise DataError(f"{type(self).__name__} has no parameter {own!r}; expected one of: {', '.join(known)}")
            if apart:
                inner.setdefault(own, {})[rest] = value
            else:
                setattr(self, own, value)
        for own, values in inner.items():
            getattr(self, own).set_params(**values)
        return self

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Return the coefficient of determination R² of the predictions at X, the mean of that of each column of y.

        Parameters
        ----------
        X : (n, d) array_like
            The inputs, as for ``predict``.
        y : (n, k) or (n,) array_like
            The measured values.
        sample_weight : (n,) array_like, optional
            The weights of the samples.

        Raises
        ------
        DataError
            If y has another shape than the predictions.

        Notes
        -----
        A column of y without variance counts as 1 if it is predicted exactly, else as 0.
        """
        weights = None if sample_weight is None else np.asarray(sample_weight, dtype=np.float64)
        given = y, self.predict(X)  # type: ignore[attr-defined]  # the subclass's
        measured, predicted = (np.atleast_2d(np.asarray(one, dtype=np.float64).T).T for one in given)
        if predicted.shape != measured.shape:
            raise DataError(f"expected y of shape {predicted.shape}, got {measured.shape}")
        left, total = (
            np.average((measured - centre) ** 2, axis=0, weights=weights)
            for centre in (predicted, np.average(measured, axis=0, weights=weights))
        )
        constant = np.where(left == 0, 1.0, 0.0)  # a column without variance
        return float(np.mean(1.0 - np.divide(left, total, out=1.0 - constant, where=total != 0)))

    def __repr__(self) -> str:
        default = self._defaults()
        given = {name: value for name, value in self.get_params(deep=False).items() if _differ(value, default[name])}
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in given.items())})"

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import RegressorTags, Tags, TargetTags

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True),
            transformer_tags=None,
            classifier_tags=None,
            regressor_tags=RegressorTags(),
        )

    @classmethod
    def _defaults(cls) -> dict[str, Any]:
        """Return the parameters by name, in alphabetical order, with their default values."""
        init: Any = cls.__init__  # on the class: its subclasses may have other parameters
        parameters = list(signature(init).parameters.values())[1:]
        named = [p for p in parameters if p.kind not in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)]
        return {p.name: p.default for p in sorted(named, key=lambda p: p.name)}

    def _unfitted(self) -> Self:
        """Return an estimator with copies of the parameters of this one."""
        return type(self)(**{name: _copy(value) for name, value in self.get_params(deep=False).items()})


def not_fitted(estimator: Estimator) -> ValueError:
    """Return the error of an estimator that is used before its fit: scikit-learn's own class, if that is installed."""
    text = f"this {type(estimator).__name__} is not fitted; call fit first"
    try:
        from sklearn.exceptions import NotFittedError
    except ModuleNotFoundError:
        return DataError(text)
    error: ValueError = NotFittedError(text)
    return error


def _copy(value: Any) -> Any:
    return value._unfitted() if isinstance(value, Estimator) else deepcopy(value)


def _differ(value: Any, default: Any) -> bool:
    try:
        return value is not default and not np.array_equal(value, default)
    except (TypeError, ValueError):  # not comparable: another kind of value
        return True
