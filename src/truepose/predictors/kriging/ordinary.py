"""Simple, ordinary and universal Kriging: the best linear unbiased prediction from all samples (7), (8)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import KrigingError
from truepose.predictors.kriging.base import GlobalKriging
from truepose.predictors.kriging.drift import DriftLike
from truepose.similarity import VariogramModel

VariogramLike = VariogramModel | Sequence[VariogramModel] | str | Sequence[str] | None


class OrdinaryKriging(GlobalKriging):
    """Ordinary Kriging of all components from one factorisation, theory (7).

    The nugget of the variogram is noise of the readings (``exact=False``): it is filtered, the prediction does not pass
    through the samples, and the standard deviation is that of the noise-free error; ``predict(…, include_nugget=True)``
    adds the noise of a new reading. Or it is micro-scale variation of the error itself (``exact=True``): the prediction
    passes through the samples, and the standard deviation contains the nugget everywhere but there. `noise_std` given
    to `fit` is noise in either case, and comes on top of the nugget.

    With a variogram of its own the variance is that model's. A fitted one gives all components one correlation (the
    intrinsic model, theory (9) with B diagonal); the mean square of `noise_std` is taken off its nugget, and the
    scale of each component follows by generalised least squares.

    Repeats of one point are averaged. Where the variogram is fitted, or is without nugget and no `noise_std` is given,
    the noise is at least their scatter. With ``exact=True`` and no `noise_std` they must agree.

    Parameters
    ----------
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        For all components; or one for each, of one family and range; or the families to choose from in a fit of the
        components' mean semivariogram by `fit_variogram`. When not given, `fit_likelihood` finds it, which predicts
        better where a smooth trend hides how small the nugget is.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.

    Attributes
    ----------
    variogram_ : VariogramModel
        Mean over the components, as given or fitted.
    variograms_ : tuple of VariogramModel
        Of each component.
    mean_ : (k,) array [mm]
        GLS estimate of the mean.
    condition_ : float
        Condition number of the covariance matrix (the worst, if components have their own).

    Examples
    --------
    >>> model = OrdinaryKriging(VariogramModel("exponential", sill=1.0, range=100.0))
    >>> model.fit([[0.0], [100.0]], [1.0, 3.0]).predict([[0.0], [50.0]]).round(6)
    array([1., 2.])
    """

    def __init__(self, variogram: VariogramLike = None, exact: bool = False) -> None:
        self.variogram = variogram
        self.exact = exact

    @property
    def mean_(self) -> FloatArray:
        """GLS estimate of the mean, (k,) [mm]."""
        mean: FloatArray = self.beta_[0]
        return mean

    def _drift_kind(self) -> DriftLike:
        return "constant"


class SimpleKriging(GlobalKriging):
    """Kriging with a known mean, theory (8) without a drift.

    Parameters
    ----------
    variogram : VariogramModel, sequence of VariogramModel, str or sequence of str, optional
        As for `OrdinaryKriging`; a model without a sill has no simple Kriging.
    exact : bool
        Whether the nugget belongs to the error and not to the readings.
    mean : float or sequence of float [mm]
        The known mean, of all components or of each.

    Examples
    --------
    >>> model = SimpleKriging(VariogramModel("exponential", sill=1.0, range=100.0), mean=2.0)
    >>> model.fit([[0.0], [100.0]], [1.0, 3.0]).predict([[0.0], [1e6]]).round(6)
    array([1., 2.])
    """

    def __init__(
        self, variogram: VariogramLike = None, exact: bool = False, mean: float | Sequence[float] = 0.0
    ) -> None:
        self.variogram = variogram
        self.exact = exact
        self.mean = mean

    def _drift_kind(self) -> None:
        return None

    def _known_mean(self, k: int) -> FloatArray:
        mean = np.asarray(self.mean, dtype=np.float64)
        if mean.shape not in ((), (k,)) or not np.isfinite(mean).all():
            raise KrigingError(f"mean is {self.mean}; expected a finite number, or one for each of {k} components")
        return np.broadcast_to(mean, (k,))


class UniversalKriging(GlobalKriging):
    """Kriging with a drift, theory (8): its coefficients by generalised least squares, their uncertainty in the std.

    The variogram, when it is not given, is that of what the drift leaves by ordinary least squares.

    Parameters
    ----------
    drift : {"constant", "linear", "quadratic", "cubic"}, int, sequence of int, or callable
        A polynomial of all coordinates by name or degree; numbers of columns of X that are columns of the drift and no
        coordinates; or a function X (m, d) → (m, p). The constant always comes on top. A function cannot be saved.
    variogram, exact
        As for `OrdinaryKriging`.

    Attributes
    ----------
    beta_ : (p, k) array [mm]
        GLS coefficients of the columns: the constant, then polynomials of (x − mean of the points)/half their extent,
        or columns of X so scaled, or the function's.
    variogram_, variograms_, condition_
        As of `OrdinaryKriging`.

    Examples
    --------
    >>> model = UniversalKriging("linear", VariogramModel("exponential", sill=1.0, range=10.0))
    >>> model.fit([[0.0], [1.0], [2.0]], [0.0, 1.0, 2.0]).predict([[50.0]]).round(6)
    array([50.])
    """

    def __init__(self, drift: DriftLike = "linear", variogram: VariogramLike = None, exact: bool = False) -> None:
        self.drift = drift
        self.variogram = variogram
        self.exact = exact

    def _drift_kind(self) -> DriftLike:
        return self.drift
