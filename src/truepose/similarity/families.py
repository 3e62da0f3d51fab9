"""The families of correlation functions: formula, practical range, dimensions and shape of each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Final

from truepose.errors import KrigingError


@dataclass(frozen=True)
class Shape:
    """The shape parameter of a family.

    Attributes
    ----------
    symbol : str
        The symbol.
    least, most : float
        The bounds; `least` is excluded, `most` included.
    """

    symbol: str
    least: float
    most: float


@dataclass(frozen=True)
class Family:
    """One correlation function rho(r) of the scaled distance r = h/a, compiled in `similarity.kernels`.

    Attributes
    ----------
    code : int
        The number of the family in the compiled switches.
    formula : str
        The formula of rho(r), for a reader.
    practical : float or callable
        r at which rho first is 0.05, or a function of the shape that gives it; infinite where there is no sill.
    dimensions : float
        The largest number of coordinates in which rho is positive definite.
    shape : Shape, optional
        The third parameter of the family, if any.
    """

    code: int
    formula: str
    practical: float | Callable[[float], float]
    dimensions: float = math.inf
    shape: Shape | None = None

    @property
    def bounded(self) -> bool:
        """Whether the semivariance reaches a sill, so that a covariance exists."""
        return callable(self.practical) or math.isfinite(self.practical)

    def practical_range(self, shape: float | None = None) -> float:
        """Return r at which the correlation is 0.05."""
        return self.practical(math.nan if shape is None else shape) if callable(self.practical) else self.practical


@cache
def _matern_practical(nu: float) -> float:
    from scipy.optimize import brentq

    from truepose.similarity.covariance import matern

    return float(brentq(lambda r: float(matern(nu, r)) - 0.05, 1e-12, 10.0, xtol=1e-15, rtol=1e-14))


FAMILIES: Final = {
    "spherical": Family(0, "1 - 3/2 r + 1/2 r³ for r < 1, else 0", 0.811401351899508, dimensions=3),
    "exponential": Family(1, "exp(-r)", math.log(20)),
    "gaussian": Family(2, "exp(-r²)", math.sqrt(math.log(20))),
    "matern32": Family(3, "(1 + √3 r) exp(-√3 r)", 2.738871456691915),
    "matern52": Family(4, "(1 + √5 r + 5/3 r²) exp(-√5 r)", 2.646900454666855),
    "cubic": Family(8, "1 - 7 r² + 35/4 r³ - 7/2 r⁵ + 3/4 r⁷ for r < 1, else 0", 0.6903389309446439, dimensions=3),
    "matern": Family(6, "2^(1-ν)/Γ(ν) t^ν K_ν(t), t = √(2ν) r", _matern_practical, shape=Shape("ν", 0.0, 30.0)),
    "stable": Family(7, "exp(-r^α)", lambda alpha: math.log(20) ** (1 / alpha), shape=Shape("α", 0.0, 2.0)),
    "rational": Family(
        9,
        "(1 + r²/(2α))^(-α)",
        lambda alpha: math.sqrt(2 * alpha * (20 ** (1 / alpha) - 1)),
        shape=Shape("α", 0.0, 1e6),
    ),
    "hole": Family(10, "sin(r)/r", 2.991456433400576, dimensions=3),
    "nugget": Family(11, "0 for r > 0", 0.0),
    "linear": Family(5, "1 - r, no sill", math.inf),
    "power": Family(12, "1 - r^α, no sill", math.inf, shape=Shape("α", 0.0, 2.0)),
}
"""The families by name."""


def family_named(name: str) -> Family:
    """Return a family's entry; raise KrigingError where there is none."""
    if name not in FAMILIES:
        raise KrigingError(f"variogram family {name!r} is not known; use one of {', '.join(FAMILIES)}")
    return FAMILIES[name]


def check_shape(name: str, shape: float | None) -> None:
    """Raise KrigingError where a family's shape is missing, needless, or outside its bounds."""
    wanted = family_named(name).shape
    if wanted is None:
        if shape is not None:
            raise KrigingError(f"a {name} variogram has no shape parameter, got shape={shape}; omit it")
        return
    top = 2.0 if name == "power" else wanted.most
    span = f"above {wanted.least:g} and {'below' if name == 'power' else 'up to'} {top:g}"
    if shape is None:
        raise KrigingError(f"a {name} variogram needs its shape {wanted.symbol}; give shape=, a number {span}")
    if not (wanted.least < shape <= top) or (name == "power" and shape == top):
        raise KrigingError(f"variogram shape {wanted.symbol} of {name} is {shape}; expected a number {span}")
