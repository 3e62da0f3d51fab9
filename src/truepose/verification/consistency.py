"""Test whether a model still holds for new readings, and fit possible causes if it does not.

If the model holds, the residuals r with covariance S = L Lᵀ give whitened residuals z = L⁻¹ r that are standard normal:
zᵀz is χ² distributed and successive z are uncorrelated. If it does not hold, a cause with columns H (a moved station, a
joint offset) explains the share of rᵀS⁻¹r that generalised least squares of r on H removes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtr, chdtrc, fdtrc, ndtr

from truepose._typing import FloatArray
from truepose.errors import DataError

Verdict = Literal["holds", "doubtful", "does not hold", "too cautious"]

DOUBTFUL: Final = 0.01
"""Probability below which a result is significant."""
_FAILS: Final = 0.001
_NOTABLE: Final = 3.0
_WIDE: Final = 0.5  # ratio below which deviations are too wide; a map's own margins leave 0.7 and more


@dataclass(frozen=True, eq=False, repr=False)
class ConsistencyTest:
    """The test of a model against new readings; the result of `check_consistency`.

    Attributes
    ----------
    n : int
        The number of readings, of three components each.
    ratio : float
        The root mean square of the standardised residuals; 1 if the model holds.
    p_chi_square : float
        The probability of residuals at least as large as these, if the model holds.
    p_white : float
        The probability of successive residuals at least as correlated as these, if the model holds; 1 if not tested.
    far : list of int
        The readings whose standardised length exceeds three times its root mean square.
    p_wide : float
        The probability of residuals at most as large as these, if the model holds.
    """

    n: int
    ratio: float
    p_chi_square: float
    p_white: float
    far: list[int]
    p_wide: float = 1.0

    @property
    def p_value(self) -> float:
        """The smaller of the two probabilities, times two for two tests (Bonferroni)."""
        return min(1.0, 2.0 * min(self.p_chi_square, self.p_white))

    @property
    def verdict(self) -> Verdict:
        """The verdict: ``holds``, ``doubtful`` (p below 0.01) or ``does not hold`` (p below 0.001).

        It is ``too cautious`` where the standard deviations are at least twice too wide (`p_wide` below 0.001), and the
        model holds otherwise. Standard deviations that are less than twice too wide count as holding, because those of
        maps contain margins.
        """
        if self.p_value < DOUBTFUL:
            return "does not hold" if self.p_value < _FAILS else "doubtful"
        return "too cautious" if self.ratio < _WIDE and self.p_wide < _FAILS else "holds"

    @property
    def fails(self) -> bool:
        """Whether residuals are larger, or more alike, than the model allows: ``doubtful`` or ``does not hold``."""
        return self.p_value < DOUBTFUL

    def __repr__(self) -> str:
        far = f", {len(self.far)} of them far off" if self.far else ""
        return (
            f"<ConsistencyTest: {self.verdict} (p = {self.p_value:.2g}); {self.n} readings{far}; "
            f"standardised residuals have RMS {self.ratio:.2f}>"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, with the verdict and the p-value."""
        return {"verdict": self.verdict, "p_value": self.p_value, **asdict(self)}


@dataclass(frozen=True, eq=False)
class Explanation:
    """A possible cause, fitted to the residuals.

    Attributes
    ----------
    cause : str
        The name of the cause.
    estimate, std : (k,) arrays
        The coefficients of its columns and their standard deviations.
    explained : float
        The share of rᵀS⁻¹r that it removes.
    p_left : float
        The probability of the remaining residuals, if this is the only cause.
    evidence : float
        The Bayesian information criterion without the cause minus that with it; positive if the readings support it.
    """

    cause: str
    estimate: FloatArray
    std: FloatArray
    explained: float
    p_left: float
    evidence: float


def check_consistency(
    residual: FloatArray, covariance: FloatArray, shared: FloatArray | None = None
) -> ConsistencyTest:
    """Test whether a model holds for new readings.

    Parameters
    ----------
    residual : (n, 3) array [mm]
        The readings minus the predictions, in the order of time.
    covariance : (3n, 3n) or (n, 3, 3) array [mm²]
        The covariance of prediction and reading together; the second form if the readings' common part is not known.
    shared : (n, 3) array [mm²], optional
        With the second form, the variance of the prediction in it. Neighbours may share this error, so the test treats
        it as one common error (Satterthwaite 1946) and does not test the correlation of successive residuals.

    Returns
    -------
    ConsistencyTest

    Raises
    ------
    DataError
        If shapes disagree, or the covariance is not positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> residual = np.random.default_rng(0).normal(scale=0.03, size=(40, 3))
    >>> check_consistency(residual, np.tile(0.03**2 * np.eye(3), (40, 1, 1))).verdict
    'holds'
    >>> check_consistency(2 * residual, np.tile(0.03**2 * np.eye(3), (40, 1, 1))).verdict
    'does not hold'
    >>> check_consistency(residual / 3, np.tile(0.03**2 * np.eye(3), (40, 1, 1))).verdict
    'too cautious'
    """
    n = len(residual)
    z = _whitening(residual, covariance)(residual.reshape(-1, 1))[:, 0]
    alike = float(z[3:] @ z[:-3]) / np.sqrt(max(3 * (n - 1), 1)) if shared is None else 0.0
    wider, dof = (1.0, float(len(z))) if shared is None else _common(covariance, shared)
    blocks = _blocks(covariance, n)
    own = np.einsum("na,na->n", residual, np.linalg.solve(blocks, residual[..., None])[..., 0])
    return ConsistencyTest(
        n=n,
        ratio=float(np.sqrt(z @ z / len(z))),
        p_chi_square=float(chdtrc(dof, z @ z / wider)),
        p_white=float(2.0 * ndtr(-abs(alike))),
        far=np.flatnonzero(own > _NOTABLE**2 * 3.0).tolist(),
        p_wide=float(chdtr(dof, z @ z / wider)),
    )


def explanations(residual: FloatArray, covariance: FloatArray, causes: Mapping[str, FloatArray]) -> list[Explanation]:
    """Fit each cause alone, and return the causes that the readings support, the likeliest first.

    Parameters
    ----------
    residual, covariance
        The residuals and their covariance, see `check_consistency`.
    causes : mapping of str to (n, 3, k) array
        The columns of each cause: the change of the residuals by one unit of each coefficient [mm].
    """
    white = _whitening(residual, covariance)
    z = white(residual.reshape(-1, 1))[:, 0]
    found = []
    for cause, columns in causes.items():
        if 3 * len(residual) <= columns.shape[2]:
            continue
        estimate, std, left = _least_squares(white(columns.reshape(len(z), -1)), z)
        evidence = float(z @ z) - left - columns.shape[2] * np.log(len(z))
        chance = float(chdtrc(len(z) - columns.shape[2], left))
        found.append(Explanation(cause, estimate, std, 1.0 - left / float(z @ z), chance, float(evidence)))
    return sorted((e for e in found if e.evidence > 0), key=lambda e: -e.evidence)


@dataclass(frozen=True, eq=False)
class Drift:
    """The change of errors with a quantity such as time or temperature; the result of `drift`.

    Attributes
    ----------
    slope, std : (3,) arrays [mm per unit], base frame
        The slopes and their standard deviations, widened if residuals are larger than the model predicts.
    p_value : float
        The probability of slopes at least as large as these without a drift.
    """

    slope: FloatArray
    std: FloatArray
    p_value: float

    def to_dict(self, unit: str) -> dict[str, Any]:
        """Return plain values: slopes with their 95 % intervals, mm per `unit`."""
        low, high = self.slope - 1.96 * self.std, self.slope + 1.96 * self.std
        return {
            f"slope_mm_per_{unit}": self.slope.tolist(),
            "interval_95": np.stack([low, high], axis=1).tolist(),
            "p_value": self.p_value,
        }


def drift(residual: FloatArray, covariance: FloatArray, quantity: FloatArray) -> Drift:
    """Regress residuals on a quantity; each component has its own level and slope.

    Parameters
    ----------
    residual, covariance
        The residuals and their covariance, see `check_consistency`.
    quantity : (n,) array
        The quantity at each reading.

    Returns
    -------
    Drift

    Raises
    ------
    DataError
        If the quantity does not change, or there are fewer than four readings.
    """
    n = len(residual)
    if n < 4 or np.ptp(quantity) == 0:
        raise DataError(f"drift needs 4 or more readings, got {n} whose quantity changes by {np.ptp(quantity):g}")
    white = _whitening(residual, covariance)
    z = white(residual.reshape(-1, 1))[:, 0]
    t = (quantity - quantity.mean()) / quantity.std()
    level = np.tile(np.eye(3), (n, 1, 1))
    columns = np.concatenate([level, level * t[:, None, None]], axis=2)
    estimate, std, left = _least_squares(white(columns.reshape(3 * n, 6)), z)
    _, _, without = _least_squares(white(level.reshape(3 * n, 3)), z)
    spread = max(1.0, left / (3 * n - 6))
    chance = fdtrc(3, 3 * n - 6, max(without - left, 0.0) / 3.0 / spread)
    return Drift(estimate[3:] / quantity.std(), np.sqrt(spread) * std[3:] / quantity.std(), float(chance))


def length_std(vector: FloatArray, std: FloatArray) -> float:
    """Return the standard deviation of a vector's length from those of its components.

    It is the deviation along the vector, so that length / deviation agrees with a test of the vector against zero.

    Examples
    --------
    >>> import numpy as np
    >>> length_std(np.array([3.0, 0.0, 4.0]), np.array([0.1, 0.1, 0.1]))
    0.1
    """
    length = float(np.linalg.norm(vector))
    along = vector / length if length else np.full(len(vector), len(vector) ** -0.5)
    return float(np.linalg.norm(along * std))


def _common(covariance: FloatArray, shared: FloatArray) -> tuple[float, float]:
    """Return the factor and degrees of freedom of χ² if the shared variances are one error in each component."""
    share = np.sqrt(shared / np.einsum("naa->na", covariance))
    squares = sum(float(((np.outer(one, one) + np.diag(1.0 - one**2)) ** 2).sum()) for one in share.T)
    return squares / share.size, share.size**2 / squares


def _least_squares(columns: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the coefficients, their standard deviations under unit noise, and the remaining sum of squares."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    u, s, vt = np.linalg.svd(columns / scale, full_matrices=False)
    if s[-1] < 1e-9 * s[0]:
        raise DataError("the readings cannot separate the parts of a cause; measure more poses, or poses farther apart")
    estimate = vt.T @ ((u.T @ z) / s) / scale
    std = np.linalg.norm(vt.T / s, axis=1) / scale
    left = z - u @ (u.T @ z)
    return estimate, std, float(left @ left)


def _blocks(covariance: FloatArray, n: int) -> FloatArray:
    if covariance.shape == (n, 3, 3):
        return covariance
    return np.asarray(np.einsum("iaib->iab", covariance.reshape(n, 3, n, 3)))


def _whitening(residual: FloatArray, covariance: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the multiplication of columns (3n, k) by L⁻¹."""
    n = len(residual)
    if residual.shape != (n, 3) or not n or covariance.shape not in ((3 * n, 3 * n), (n, 3, 3)):
        raise DataError(
            f"residuals {residual.shape} and covariance {covariance.shape}: expected (n, 3) and (3n, 3n) or (n, 3, 3)"
        )
    try:
        factor = np.asarray(np.linalg.cholesky(covariance), np.float64)
    except np.linalg.LinAlgError:
        raise DataError(
            "the covariance of the residuals is not positive definite; give the noise of the readings"
        ) from None
    if factor.ndim == 2:
        return lambda columns: np.asarray(solve_triangular(factor, columns, lower=True))
    return lambda columns: np.asarray(np.linalg.solve(factor, columns.reshape(n, 3, -1)).reshape(3 * n, -1))
