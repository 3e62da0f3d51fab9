"""Models of the semivariogram and of the covariance that belongs to it, equation (5)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose.errors import KrigingError

if TYPE_CHECKING:
    from truepose.similarity.fitting import VariogramFit
    from truepose.similarity.likelihood import LikelihoodFit

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Family:
    """One correlation function rho(r) of the scaled distance r = h/a, compiled in `similarity.covariance`.

    Attributes
    ----------
    code : int
        Its number in the compiled switches.
    formula : str
        rho(r), as shown to a reader.
    practical : float
        r at which rho is 0.05; infinite where there is no sill.
    dimensions : float
        Largest number of coordinates in which rho is positive definite.
    """

    code: int
    formula: str
    practical: float
    dimensions: float = math.inf

    @property
    def bounded(self) -> bool:
        """Whether the semivariance reaches a sill, so that a covariance exists."""
        return math.isfinite(self.practical)


FAMILIES: Final = {
    "spherical": Family(0, "1 - 3/2 r + 1/2 r³ for r < 1, else 0", 0.811401351899508, dimensions=3),
    "exponential": Family(1, "exp(-r)", math.log(20)),
    "gaussian": Family(2, "exp(-r²)", math.sqrt(math.log(20))),
    "matern32": Family(3, "(1 + √3 r) exp(-√3 r)", 2.738871456691915),
    "matern52": Family(4, "(1 + √5 r + 5/3 r²) exp(-√5 r)", 2.646900454666855),
    "linear": Family(5, "1 - r, no sill", math.inf),
}
"""The families by name."""


@dataclass(frozen=True)
class VariogramModel:
    """A semivariogram γ(h) = C0 + C (1 − ρ(h/a)) for h > 0, γ(0) = 0.

    =========== ==================================== ===================
    family      ρ(r), r = h/a                        practical range
    =========== ==================================== ===================
    spherical   1 − 3/2 r + 1/2 r³ for r < 1, else 0 0.811 a
    exponential exp(−r)                              2.996 a
    gaussian    exp(−r²)                             1.731 a
    matern32    (1 + √3 r) exp(−√3 r)                2.739 a
    matern52    (1 + √5 r + 5/3 r²) exp(−√5 r)       2.647 a
    linear      1 − r: γ = C0 + C h/a, no sill       infinite
    =========== ==================================== ===================

    So C(h) = 10 exp(−0.3 h) is ``VariogramModel("exponential", sill=10, range=1 / 0.3)``.

    Parameters
    ----------
    family : str
        A name of the table. The spherical model is valid in up to three coordinates, the others in any number.
    nugget : float [mm²]
        C0: the step at the origin; noise or micro-scale variation (`OrdinaryKriging(exact=…)` says which).
    sill : float [mm²]
        Partial sill C; the total is C0 + C. For "linear", the rise of γ over one range.
    range : float
        a of the formula, in the unit of the coordinates.
    fit : VariogramFit or LikelihoodFit, optional
        How the model was fitted; `fit_variogram` and `fit_likelihood` fill it.

    Raises
    ------
    KrigingError
        For an unknown family, a negative or non-finite parameter, a range of 0, or nugget and sill both 0.

    Examples
    --------
    >>> vm = VariogramModel("spherical", nugget=0.01, sill=1.0, range=500.0)
    >>> float(vm.semivariance(500.0)), float(vm.covariance(0.0))
    (1.01, 1.01)
    """

    family: str
    nugget: float = 0.0
    sill: float = field(kw_only=True)
    range: float = field(kw_only=True)
    fit: VariogramFit | LikelihoodFit | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise KrigingError(f"variogram family {self.family!r} is not known; use one of {', '.join(FAMILIES)}")
        for name in ("nugget", "sill", "range"):
            value = getattr(self, name)
            if not math.isfinite(value) or value < 0 or (name == "range" and value == 0):
                expected = "above 0" if name == "range" else "of 0 or more"
                raise KrigingError(f"variogram {name} is {value}; expected a finite number {expected}")
        if self.nugget + self.sill == 0:
            raise KrigingError("variogram nugget and sill are both 0: nothing varies; give at least one of them")

    def semivariance(self, h: ArrayLike) -> FloatArray:
        """Return γ(h) [mm²] at distances h >= 0 of any shape; 0 at h = 0."""
        h = np.asarray(h, dtype=np.float64)
        return np.where(h == 0, 0.0, self.nugget + self.sill * (1 - self._correlation(h)))

    def covariance(self, h: ArrayLike) -> FloatArray:
        """Return Cov(h) = Cov(0) − γ(h) [mm²], equation (5), of the field with its nugget: Cov(0) = C0 + C."""
        h = np.asarray(h, dtype=np.float64)
        return self.signal_covariance(h) + np.where(h == 0, self.nugget, 0.0)

    def signal_covariance(self, h: ArrayLike) -> FloatArray:
        """Return C ρ(h/a) [mm²]: the covariance of the field without its nugget."""
        if not self.kind.bounded:
            raise KrigingError(f"a {self.family} variogram has no sill, so no covariance exists; use its semivariance")
        return self.sill * self._correlation(np.asarray(h, dtype=np.float64))

    @property
    def kind(self) -> Family:
        """The family's entry in the table."""
        return FAMILIES[self.family]

    @property
    def practical_range(self) -> float:
        """Distance at which γ has risen to C0 + 0.95 C; infinite without a sill."""
        return self.kind.practical * self.range

    @property
    def structural_ratio(self) -> float:
        """C/(C0 + C): the share of the variance that is similarity; the rest is nugget."""
        return self.sill / (self.nugget + self.sill)

    def scaled(self, factor: float) -> Self:
        """Return the model of the quantity whose variance is `factor` times as large."""
        return replace(self, nugget=factor * self.nugget, sill=factor * self.sill)

    def to_dict(self) -> dict[str, Any]:
        """Return family, nugget, sill and range as plain values, for a file."""
        return {
            "family": self.family,
            "nugget": float(self.nugget),
            "sill": float(self.sill),
            "range": float(self.range),
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Return the model that `to_dict` described."""
        return cls(**values)

    def _correlation(self, h: FloatArray) -> FloatArray:
        from truepose.similarity.covariance import correlation

        if not (h >= 0).all():
            raise KrigingError("distances of a variogram must be numbers of 0 or more; a negative or NaN one came")
        return correlation(self.kind.code, h / self.range)
