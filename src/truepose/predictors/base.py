"""The contract of all error models, which is scikit-learn's with standard deviations.

`__init__` stores the parameters, ``fit(X, y, noise_std)`` fits, ``predict(X, return_std)`` predicts. The base validates
the arrays, names their faults, and returns one column from a model that was fitted to one column. A subclass
implements `_fit`, `_predict` and `_leave_one_out` on (n, d) and (n, k) arrays of finite numbers.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any, ClassVar, Literal, NamedTuple, Self, TypeGuard, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose._extras import needed
from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.numerics.threads import LARGE, blas_threads
from truepose.predictors.estimator import Estimator, not_fitted


class LeaveOneOut(NamedTuple):
    """Each sample predicted from the others.

    Attributes
    ----------
    residual : (n, k) array [mm]
        The samples minus their predictions.
    std : (n, k) array [mm]
        The standard deviation of the residual: of the prediction and of the reading together.
    """

    residual: FloatArray
    std: FloatArray


class Predictor(Estimator):
    """Base of error models: predicts positional errors, with a standard deviation, at new positions or joints.

    Attributes
    ----------
    arm_parameters : tuple of str
        The parameters that describe the arm, which `make_predictor` passes on; empty where there are none.
    """

    arm_parameters: ClassVar[tuple[str, ...]] = ()

    takes_reflectors: ClassVar[bool] = False
    """Whether rows may be of several reflectors, see `truepose.predictors.reflectors`."""

    takes_conditions: ClassVar[bool] = False
    """Whether it models conditions, see `truepose.predictors.conditions`."""

    has_local_std: ClassVar[bool] = True
    """Whether the standard deviation depends on the pose; otherwise one value holds for all poses."""

    _blas_threads_from: ClassVar[float] = LARGE
    """Number of samples from which more than one BLAS thread is faster."""

    def fit(self, X: ArrayLike, y: ArrayLike, noise_std: ArrayLike | None = None) -> Self:
        """Fit the model to samples.

        Parameters
        ----------
        X : (n, d) array_like
            Positions (n, 3) [mm] in the base frame, or joints (n, dof) [rad].
        y : (n, k) or (n,) array_like [mm]
            The positional errors e, base frame.
        noise_std : float, (n,) or (n, k) array_like [mm], optional
            The standard deviation of the readings: of all, of each sample, or of each sample and component.

        Returns
        -------
        self

        Raises
        ------
        DataError
            If shapes disagree or a number is not finite; the row is named.
        KrigingError
            If the samples do not determine the model.
        """
        if y is None:
            raise DataError(
                f"{type(self).__name__} requires y to be passed, but the target y is None; give the errors e"
            )
        X, e = self._validate(X, y)
        self._flat = e.ndim == 1
        e = e.reshape(len(e), -1)
        noise = None if noise_std is None else checked_noise(noise_std, e.shape)
        self._given: tuple[FloatArray, FloatArray, FloatArray | None] = X, e, noise
        with self._blas():
            self._fit(X, e, noise)
        return self

    @property
    def points_(self) -> FloatArray:
        """Coordinates of the samples, (n, d) [mm or rad], as given to `fit`."""
        self._check_fitted()
        return self._given[0]

    @property
    def noise_std_(self) -> FloatArray | None:
        """Standard deviation of the samples' readings (n, k) [mm], as given to `fit`; None without it."""
        self._check_fitted()
        return self._given[2]

    @property
    def nugget_(self) -> FloatArray:
        """Variance of a reading that neither the field nor `noise_std` explains, (k,) [mm²].

        It contains noise that was not given to `fit`, and errors of the arm that the model does not describe: those
        that vary from pose to pose without similarity (motor ripple), and those that depend on something that is no
        coordinate (orientation, in a Cartesian model). Zero where the model attributes all of it to the field.
        """
        self._check_fitted()
        return self._nugget_variance()

    @overload
    def predict(self, X: ArrayLike, return_std: Literal[False] = ..., include_nugget: bool = ...) -> FloatArray: ...
    @overload
    def predict(
        self, X: ArrayLike, return_std: Literal[True], include_nugget: bool = ...
    ) -> tuple[FloatArray, FloatArray]: ...
    def predict(
        self, X: ArrayLike, return_std: bool = False, include_nugget: bool = False
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Predict errors at new positions or joints.

        Parameters
        ----------
        X : (m, d) array_like
            The targets, in the coordinates of the samples.
        return_std : bool
            Whether the standard deviation is returned as well.
        include_nugget : bool
            Whether the standard deviation is that of one new reading, `nugget_` included; the known noise of that
            reading (as `noise_std` of `fit`) has to be added. Otherwise it is that of the field that the model
            describes, without noise. The standard deviation of the tool tip lies between the two: see
            `truepose.ErrorMap.predict_errors`.

        Returns
        -------
        e : (m, k) or (m,) array [mm]
            The predicted errors.
        std : (m, k) or (m,) array [mm]
            The standard deviations, only with `return_std`.

        Raises
        ------
        DataError
            If X has another number of columns than the samples, or a number is not finite.
        """
        self._check_fitted()
        with self._blas():
            e, std = self._predict(self._validate(X)[0], return_std)
        if std is None:
            return self._shaped(e)
        return self._shaped(e), self._shaped(np.sqrt(std**2 + self.nugget_) if include_nugget else std)

    def leave_one_out(self) -> LeaveOneOut:
        """Predict each sample from the others, with the fitted hyperparameters.

        All repeats of a sample's point are left out together with it.

        Returns
        -------
        LeaveOneOut
            The residuals and their standard deviations, (n, k) or (n,) arrays [mm].
        """
        self._check_fitted()
        with self._blas():
            residual, std = self._leave_one_out()
        return LeaveOneOut(self._shaped(residual), self._shaped(std))

    def leave_blocks_out(self, blocks: ArrayLike) -> LeaveOneOut:
        """Predict the samples of each block from those of the others, with the fitted hyperparameters.

        Parameters
        ----------
        blocks : (n,) array_like
            The label of each sample's block, as returned by `block_folds`.

        Returns
        -------
        LeaveOneOut
            The residuals and their standard deviations, (n, k) or (n,) arrays [mm].

        Raises
        ------
        DataError, KrigingError
            If there is not one label for each sample, or the samples outside a block do not determine the model.
        """
        self._check_fitted()
        labels, n = np.asarray(blocks), len(self._given[0])
        if labels.shape != (n,):
            raise DataError(f"blocks have shape {labels.shape}; expected ({n},), a label for each sample")
        try:
            with self._blas():
                residual, std = self._leave_blocks_out(labels)
        except np.linalg.LinAlgError:
            raise DataError(
                "the samples outside one of the blocks do not determine the model; use smaller blocks"
            ) from None
        return LeaveOneOut(self._shaped(residual), self._shaped(std))

    def with_fitted_parameters(self) -> Self:
        """Return an unfitted copy whose parameters are the fitted hyperparameters: fitting it estimates nothing."""
        self._check_fitted()
        return self._unfitted().set_params(**self._fitted_parameters())

    def to_dict(self) -> dict[str, Any]:
        """Return the fitted parameters as plain values, without those of the arm: see `arm_parameters`."""
        values = self.with_fitted_parameters().get_params(deep=False)
        return {name: _plain(value) for name, value in values.items() if name not in self.arm_parameters}

    @classmethod
    def from_dict(cls, parameters: Mapping[str, Any]) -> Self:
        """Return the unfitted model that `to_dict` described; parameters of the arm are added to it."""
        arm = cls.arm_parameters
        return cls(
            **{name: value if name in arm else cls._parameter(name, value) for name, value in parameters.items()}
        )

    @classmethod
    def _parameter(cls, name: str, value: Any) -> Any:
        """Return a parameter from its plain value."""
        return _tuples(value)

    @abstractmethod
    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None: ...

    @abstractmethod
    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        """Return the prediction (m, k), and the standard deviation of the field (m, k) or None."""

    @abstractmethod
    def _nugget_variance(self) -> FloatArray:
        """Return `nugget_` of a fitted model."""

    @abstractmethod
    def _leave_one_out(self) -> LeaveOneOut: ...

    def _blas(self) -> AbstractContextManager[Any]:
        return blas_threads(len(self._given[0]), self._blas_threads_from)

    def _fitted_parameters(self) -> dict[str, Any]:
        return {}

    def _leave_blocks_out(self, labels: NDArray[Any]) -> LeaveOneOut:
        X, e, noise = self._given
        predicted, std = np.empty_like(e), np.empty_like(e)
        for label in np.unique(labels):
            out = labels == label
            model = self._to_fit_again().fit(X[~out], e[~out], None if noise is None else noise[~out])
            predicted[out], std[out] = model.predict(X[out], return_std=True, include_nugget=True)
        if noise is not None:
            std = np.sqrt(std**2 + noise**2)
        return LeaveOneOut(e - predicted, std)

    def _to_fit_again(self) -> Self:
        """Return the unfitted copy that `leave_blocks_out` fits, with the fitted hyperparameters."""
        return self.with_fitted_parameters()

    def _check_fitted(self) -> None:
        if not hasattr(self, "_given"):
            raise not_fitted(self)

    def _shaped(self, values: FloatArray) -> FloatArray:
        return values[:, 0] if self._flat else values

    def _validate(self, X: ArrayLike, y: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
        """Return X (n, d) and y, finite and of 64 bits; an empty y when none was given."""
        none = np.empty(0)
        if _is_table(X) and (y is None or (_is_table(y, 1) and len(y) == len(X))) and self._has_plain_columns(X, y):
            return X, none if y is None else y
        try:
            from sklearn.utils.validation import validate_data
        except ModuleNotFoundError:
            return self._validate_alone(X, y)
        options: dict[str, Any] = {"dtype": np.float64, "ensure_all_finite": False, "reset": y is not None}
        if y is not None:
            _check_finite("y", y)  # before scikit-learn, which does not name the row
            options |= {"y": y, "multi_output": True, "y_numeric": True}
        try:
            checked = validate_data(self, X, **options)
        except ValueError as error:
            if "feature names" in str(error):  # scikit-learn's own words, on several lines
                raise
            raise DataError(f"X: {' '.join(str(error).split())}") from None
        X, y = checked if y is not None else (checked, none)
        _check_finite("X", X)
        return np.asarray(X, dtype=np.float64), np.asarray(y, dtype=np.float64)

    def _validate_alone(self, X: ArrayLike, y: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
        """Return X and y as `_validate` does, without scikit-learn, which would check the names of columns."""
        for name, given in {"X": X, "y": y}.items():
            if given is not None and not isinstance(given, (np.ndarray, list, tuple)):
                with needed(f"{name} as {type(given).__name__}", "network", "pass an array"):
                    import sklearn  # noqa: F401
        table, answers = _numbers("X", X), np.empty(0) if y is None else _numbers("y", y)
        if not _is_table(table) or (y is not None and not (_is_table(answers, 1) and len(answers) == len(table))):
            got = f"X of shape {table.shape}" + ("" if y is None else f" and y of shape {answers.shape}")
            raise DataError(f"expected X of shape (n, d), and y of n rows in a fit, with n > 0; got {got}")
        if not self._has_plain_columns(table, y):
            raise DataError(f"X has {table.shape[1]} columns, but {self.n_features_in_} in the fit")
        return table, answers

    def _has_plain_columns(self, X: FloatArray, y: ArrayLike | None) -> bool:
        """Whether scikit-learn's slower validation has nothing to add for checked arrays: no names, right width."""
        if hasattr(self, "feature_names_in_"):
            return False
        if y is not None:
            self.n_features_in_ = X.shape[1]
        return bool(self.n_features_in_ == X.shape[1])

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        return tags


def _is_table(values: ArrayLike, least: int = 2) -> TypeGuard[FloatArray]:
    """Whether values are a finite, not empty array of 64-bit numbers with two dimensions, or with `least`."""
    return (
        type(values) is np.ndarray
        and values.dtype == np.float64
        and least <= values.ndim <= 2
        and values.size > 0
        and math.isfinite(np.vdot(values, values))
    )


def _numbers(name: str, values: ArrayLike) -> FloatArray:
    """Return finite numbers as an array of 64 bits."""
    try:
        array = np.asarray(values)
    except ValueError:  # rows of different lengths
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "biuf":
        raise DataError(f"{name}: expected real numbers in rows of one length")
    _check_finite(name, array)
    return np.asarray(array, dtype=np.float64)


def _check_finite(name: str, values: Any) -> None:
    """Raise DataError, naming the row, where an array of numbers has one that is not finite."""
    array = np.asarray(values)
    if array.dtype.kind == "f" and array.ndim > 0:
        bad = np.flatnonzero(~np.isfinite(array.reshape(len(array), -1)).all(axis=1)) if array.size else np.empty(0)
        if bad.size:
            raise DataError(f"{name} has NaN or infinity in row {bad[0]} ({bad.size} rows in all); remove these rows")


def checked_noise(noise_std: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return the standard deviation of each reading, (n, k)."""
    std = np.asarray(noise_std, dtype=np.float64)
    if std.shape not in ((), shape[:1], shape):
        raise DataError(f"noise_std has shape {std.shape}; expected one number, ({shape[0]},) or {shape}")
    full = np.broadcast_to(std[:, None] if std.ndim == 1 else std, shape)
    bad = np.flatnonzero(~(np.isfinite(full) & (full >= 0)).all(axis=1))
    if bad.size:
        raise DataError(
            f"noise_std is {full[bad[0]]} in row {bad[0]} ({bad.size} rows in all); expected finite numbers >= 0"
        )
    return full


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value.to_dict() if hasattr(value, "to_dict") else value


def _tuples(value: Any) -> Any:
    """Return a value with tuples for its lists, as `json` reads them."""
    return tuple(_tuples(item) for item in value) if isinstance(value, list | tuple) else value
