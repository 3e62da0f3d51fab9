"""Does a model still hold? New readings against what it predicted, with the covariance that it gave them.

With residuals r and their covariance S, the whitened z = L⁻¹ r, S = L Lᵀ, are standard normal where it holds: zᵀz is
χ² and successive z are uncorrelated. Where it does not hold, columns H that stand for a cause (a moved station, a joint
that is off) explain it as far as generalised least squares of r on H lowers rᵀS⁻¹r.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np
from scipy import stats
from scipy.linalg import solve_triangular

from truepose._typing import FloatArray
from truepose.errors import DataError

Verdict = Literal["holds", "doubtful", "does not hold"]

_DOUBTFUL: Final = 0.01
_FAILS: Final = 0.001
_NOTABLE: Final = 3.0


@dataclass(frozen=True, eq=False)
class ConsistencyTest:
    """Whether a model still holds for new readings.

    Attributes
    ----------
    n : int
        Readings, of three components each.
    ratio : float
        Root mean square of the standardised residuals; 1 where the model holds.
    p_chi_square : float
        Chance of residuals as large as these or larger, if the model holds.
    p_white : float
        Chance of successive residuals as much alike as these, if the model holds; 1 where that cannot be told.
    far : list of int
        Readings whose own standardised length is beyond three times what chance gives in the mean.
    """

    n: int
    ratio: float
    p_chi_square: float
    p_white: float
    far: list[int]

    @property
    def p_value(self) -> float:
        """The smaller of the two chances, times two as there are two (Bonferroni)."""
        return min(1.0, 2.0 * min(self.p_chi_square, self.p_white))

    @property
    def verdict(self) -> Verdict:
        """In words: ``holds``, ``doubtful`` (p below 0.01) or ``does not hold`` (p below 0.001)."""
        return "does not hold" if self.p_value < _FAILS else "doubtful" if self.p_value < _DOUBTFUL else "holds"

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, verdict and p-value among them."""
        return {"verdict": self.verdict, "p_value": self.p_value, **asdict(self)}


@dataclass(frozen=True, eq=False)
class Explanation:
    """A cause, fitted to residuals.

    Attributes
    ----------
    cause : str
    estimate, std : (k,) arrays
        Of its columns' coefficients.
    explained : float
        Share of rᵀS⁻¹r that it takes away.
    p_left : float
        Chance of what is left, if this is the whole cause.
    evidence : float
        Bayesian information criterion of doing without it, less that with it: positive where the readings speak for it.
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
    """Test whether a model holds.

    Parameters
    ----------
    residual : (n, 3) array [mm]
        Reading minus prediction, in the order of time.
    covariance : (3n, 3n) or (n, 3, 3) array [mm²]
        Of prediction and reading together; the second form where what the readings share is not known.
    shared : (n, 3) array [mm²], optional
        With the second form, the variance of the prediction in it: neighbours may have that error in common. The test
        allows for all of it being one (Satterthwaite 1946), and looks for no likeness of successive residuals.

    Raises
    ------
    DataError
        If shapes disagree, or the covariance is none.

    Examples
    --------
    >>> import numpy as np
    >>> residual = np.random.default_rng(0).normal(scale=0.03, size=(40, 3))
    >>> check_consistency(residual, np.tile(0.03**2 * np.eye(3), (40, 1, 1))).verdict
    'holds'
    >>> check_consistency(2 * residual, np.tile(0.03**2 * np.eye(3), (40, 1, 1))).verdict
    'does not hold'
    """
    n = len(residual)
    z = _whitened(residual, covariance)(residual.reshape(-1, 1))[:, 0]
    alike = float(z[3:] @ z[:-3]) / np.sqrt(max(3 * (n - 1), 1)) if shared is None else 0.0
    wider, dof = (1.0, float(len(z))) if shared is None else _common(covariance, shared)
    blocks = _blocks(covariance, n)
    own = np.einsum("na,na->n", residual, np.linalg.solve(blocks, residual[..., None])[..., 0])
    return ConsistencyTest(
        n=n,
        ratio=float(np.sqrt(z @ z / len(z))),
        p_chi_square=float(stats.chi2.sf(z @ z / wider, dof)),
        p_white=float(2.0 * stats.norm.sf(abs(alike))),
        far=np.flatnonzero(own > _NOTABLE**2 * 3.0).tolist(),
    )


def explanations(residual: FloatArray, covariance: FloatArray, causes: Mapping[str, FloatArray]) -> list[Explanation]:
    """Fit each cause alone, and return those that the readings speak for, the likeliest first.

    Parameters
    ----------
    residual, covariance
        As `check_consistency`.
    causes : mapping of str to (n, 3, k) array
        Columns: what one unit of each coefficient adds to the residuals [mm].
    """
    white = _whitened(residual, covariance)
    z = white(residual.reshape(-1, 1))[:, 0]
    found = []
    for cause, columns in causes.items():
        if 3 * len(residual) <= columns.shape[2]:
            continue
        estimate, std, left = _least_squares(white(columns.reshape(len(z), -1)), z)
        evidence = float(z @ z) - left - columns.shape[2] * np.log(len(z))
        chance = float(stats.chi2.sf(left, len(z) - columns.shape[2]))
        found.append(Explanation(cause, estimate, std, 1.0 - left / float(z @ z), chance, float(evidence)))
    return sorted((e for e in found if e.evidence > 0), key=lambda e: -e.evidence)


@dataclass(frozen=True, eq=False)
class Drift:
    """How errors change with a quantity such as time or temperature.

    Attributes
    ----------
    slope, std : (3,) arrays [mm per unit], base frame
        The standard deviation is widened where residuals are larger than the model says.
    p_value : float
        Chance of slopes as large as these, if nothing drifts.
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
    """Regress residuals on a quantity, each component with its own level and slope.

    Parameters
    ----------
    residual, covariance
        As `check_consistency`.
    quantity : (n,) array

    Raises
    ------
    DataError
        If the quantity does not change, or there are fewer than four readings.
    """
    n = len(residual)
    if n < 4 or np.ptp(quantity) == 0:
        raise DataError(f"{n} readings whose quantity changes by {np.ptp(quantity):g} show no drift; 4 or more must")
    white = _whitened(residual, covariance)
    z = white(residual.reshape(-1, 1))[:, 0]
    t = (quantity - quantity.mean()) / quantity.std()
    level = np.tile(np.eye(3), (n, 1, 1))
    columns = np.concatenate([level, level * t[:, None, None]], axis=2)
    estimate, std, left = _least_squares(white(columns.reshape(3 * n, 6)), z)
    _, _, without = _least_squares(white(level.reshape(3 * n, 3)), z)
    spread = max(1.0, left / (3 * n - 6))
    chance = stats.f.sf((without - left) / 3.0 / spread, 3, 3 * n - 6)
    return Drift(estimate[3:] / quantity.std(), np.sqrt(spread) * std[3:] / quantity.std(), float(chance))


def _common(covariance: FloatArray, shared: FloatArray) -> tuple[float, float]:
    """Return factor and degrees of freedom of χ² where the shared variances are one error in each component."""
    share = np.sqrt(shared / np.einsum("naa->na", covariance))
    squares = sum(float(((np.outer(one, one) + np.diag(1.0 - one**2)) ** 2).sum()) for one in share.T)
    return squares / share.size, share.size**2 / squares


def _least_squares(columns: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return coefficients, their standard deviations under unit noise, and the squares left."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    u, s, vt = np.linalg.svd(columns / scale, full_matrices=False)
    if s[-1] < 1e-9 * s[0]:
        raise DataError("the readings cannot tell a cause's parts from each other; measure more or wider poses")
    estimate = vt.T @ ((u.T @ z) / s) / scale
    std = np.linalg.norm(vt.T / s, axis=1) / scale
    left = z - u @ (u.T @ z)
    return estimate, std, float(left @ left)


def _blocks(covariance: FloatArray, n: int) -> FloatArray:
    if covariance.shape == (n, 3, 3):
        return covariance
    return np.asarray(np.einsum("iaib->iab", covariance.reshape(n, 3, n, 3)))


class _Whitening:
    """Multiplication by L⁻¹."""

    def __init__(self, factor: FloatArray) -> None:
        self._factor = factor

    def __call__(self, columns: FloatArray) -> FloatArray:
        if self._factor.ndim == 2:
            return np.asarray(solve_triangular(self._factor, columns, lower=True))
        n = len(self._factor)
        return np.asarray(np.linalg.solve(self._factor, columns.reshape(n, 3, -1)).reshape(3 * n, -1))


def _whitened(residual: FloatArray, covariance: FloatArray) -> _Whitening:
    n = len(residual)
    if residual.shape != (n, 3) or not n or covariance.shape not in ((3 * n, 3 * n), (n, 3, 3)):
        raise DataError(
            f"residuals {residual.shape} and covariance {covariance.shape}: expected (n, 3) and (3n, 3n) or (n, 3, 3)"
        )
    try:
        return _Whitening(np.asarray(np.linalg.cholesky(covariance), np.float64))
    except np.linalg.LinAlgError:
        raise DataError("the covariance of the residuals is not positive definite; state the readings' noise") from None
