"""One structure of a variogram model: its family, its correlation, and sums of correlations over samples.

The formulas are compiled where they can be. Matérn's family is compiled where ν is half an odd number; for another ν
the distances are compiled, and the Bessel function is scipy's. The functions below take coordinates that are already
divided by the range. Compiled code is imported on first use.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError

TURNS: Final = ("rotation_x", "rotation_y", "rotation_z")

ROWS: Final = 2**20
"""Bessel functions in memory at once: 8 MB."""


# --- families ---------------------------------------------------------------------------------------------------------


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
    """One correlation function rho(r) of the scaled distance r = h/a, compiled in `truepose.numerics.kernels`.

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


# --- a structure with its range, axes and shape -----------------------------------------------------------------------


class SingleStructure:
    """The methods of a variogram model that concern its first structure alone."""

    family: str
    sill: float
    range: float | tuple[float, ...]
    shape: float | None
    rotation: tuple[float, ...] | None

    @property
    def kind(self) -> Family:
        """The first structure's entry in the table of families."""
        return FAMILIES[self.family]

    def coordinates(self, x: FloatArray) -> FloatArray:
        """Return points (n, d) in units of the first structure's ranges, along its axes: r is their plain distance."""
        if self.rotation is not None:
            x = x @ self.axes()[: x.shape[1], : x.shape[1]]
        return np.asarray(x / np.asarray(self.range, dtype=np.float64))

    def axes(self) -> FloatArray:
        """Return the axes of the first structure's ranges as columns, (d, d)."""
        d = len(np.ravel(self.range))
        if self.rotation is None:
            return np.eye(d)
        from scipy.spatial.transform import Rotation

        if d == 2 and any(self.rotation[:2]):
            raise KrigingError("a rotation of two coordinates must be about z: (0, 0, angle)")
        return Rotation.from_rotvec(self.rotation).as_matrix()[:d, :d]

    def scaled_distance(self, h: ArrayLike, direction: ArrayLike | None) -> FloatArray:
        """Return r of distances h along a direction."""
        if not isinstance(self.range, tuple):
            return np.asarray(h, dtype=np.float64) / self.range
        per_h = float(np.linalg.norm(self.coordinates(self._unit(direction)[None])))
        return np.asarray(h, dtype=np.float64) * per_h

    def correlation(self, r: FloatArray) -> FloatArray:
        """Return ρ at scaled distances r of any shape."""
        return correlation(self.kind.code, r, self.shape or 0.0)

    def slope_over_distance(self, r: FloatArray) -> FloatArray:
        """Return ρ'(r)/r at scaled distances r of any shape."""
        return slope_over_distance(self.kind.code, r, self.shape or 0.0)

    def structure_derivatives(self, h: FloatArray, direction: ArrayLike | None) -> dict[str, FloatArray]:
        """Return ∂γ/∂parameter of the first structure at distances h along a direction, by name."""
        r = self.scaled_distance(h, direction)
        found = {"sill": 1 - self.correlation(r)}
        names, u, ranges = ["range"], np.ones(1), np.atleast_1d(np.asarray(self.range, dtype=np.float64))
        square = r * r
        if isinstance(self.range, tuple):
            u, square = self.coordinates(self._unit(direction)[None])[0], h * h
            names = [f"range_{k}" for k, _ in enumerate(ranges, 1)]
        moments = (-self.slope_over_distance(r) * square)[..., None, None] * np.outer(u, u)
        rates = -self.sill * self.by_logarithms(moments)
        found |= {name: rates[..., k] / ranges[k] for k, name in enumerate(names)}
        if self.rotation is not None:
            turns = TURNS[-1:] if len(ranges) == 2 else TURNS
            found |= {name: rates[..., k] for k, name in enumerate(turns, len(names))}
        if self.shape is not None:
            found["shape"] = -self.sill * correlation_by_shape(self.family, r, self.shape)
        return found

    def by_logarithms(self, moments: FloatArray) -> FloatArray:
        """Return the derivatives of Σ W ρ by the logarithms of the ranges and by the rotation vector, (…, p).

        With M = Σ W (−ρ'/r) u uᵀ, u = Rᵀh/a: by log a_k it is M_kk (their sum for one range). A small rotation ω turns
        the axes, so that ∂u = −[Rᵀω]× of u in units of the ranges, and the rotation vector φ gives ω = J(φ) dφ with
        the left Jacobian of SO(3).

        Parameters
        ----------
        moments : (…, d, d) array
            The matrix M.
        """
        diagonal = np.diagonal(moments, axis1=-2, axis2=-1)
        if not isinstance(self.range, tuple):
            return np.asarray(diagonal.sum(axis=-1, keepdims=True))
        if self.rotation is None:
            return diagonal
        d, a = diagonal.shape[-1], np.asarray(self.range)
        turned = np.zeros((*moments.shape[:-2], 3, 3))
        turned[..., :d, :d] = moments * a / a[:, None]
        across = turned - turned.swapaxes(-1, -2)
        own = np.stack([across[..., 2, 1], across[..., 0, 2], across[..., 1, 0]], axis=-1)
        by_rotation = own[..., 2:] if d == 2 else own @ (left_jacobian(np.asarray(self.rotation)).T @ self.axes()).T
        return np.concatenate([diagonal, by_rotation], axis=-1)

    def _unit(self, direction: ArrayLike | None) -> FloatArray:
        d = len(np.ravel(self.range))
        if direction is None:
            raise KrigingError(f"the variogram has {d} ranges; pass the direction of the distances")
        axis = np.asarray(direction, dtype=np.float64)
        length = np.linalg.norm(axis)
        if axis.shape != (d,) or not 0 < length < math.inf:
            raise DataError(f"direction is {axis}; expected a vector of {d} numbers that is not zero")
        return np.asarray(axis / length)


def left_jacobian(phi: FloatArray) -> FloatArray:
    """Return J with R(φ + dφ) ≈ exp(J dφ) R(φ), (3, 3). Source: T. Barfoot, State Estimation (2017), 7.1.5."""
    angle = float(np.linalg.norm(phi))
    cross = np.array([[0, -phi[2], phi[1]], [phi[2], 0, -phi[0]], [-phi[1], phi[0], 0]])
    if angle < 1e-4:
        return np.asarray(np.eye(3) + cross / 2 + cross @ cross / 6)
    first, second = (1 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


# --- correlations and their sums --------------------------------------------------------------------------------------


def correlation(family: int, r: FloatArray, shape: float = 0.0) -> FloatArray:
    """Return the correlation rho(r) of a family at scaled distances r >= 0 of any shape."""
    from truepose.numerics import kernels

    if _needs_bessel(family, shape):
        return matern(shape, r)
    flat = np.square(np.asarray(r, dtype=np.float64)).reshape(-1)
    kernels.correlate(family, shape, flat)
    return flat.reshape(np.shape(r))


def slope_over_distance(family: int, r: FloatArray, shape: float = 0.0) -> FloatArray:
    """Return rho'(r)/r of a family at scaled distances r of any shape; 0 at r = 0 where that is infinite."""
    from truepose.numerics import kernels

    if _needs_bessel(family, shape):
        return _matern_slope(shape, r)
    flat = np.square(np.asarray(r, dtype=np.float64)).reshape(-1)
    kernels.slope(family, shape, flat)
    return flat.reshape(np.shape(r))


def cross_correlation(family: int, u: FloatArray, samples: FloatArray, n: int, shape: float = 0.0) -> FloatArray:
    """Return rho(‖u_i − v_j‖), (m, n), C order, of scaled coordinates u (m, d) and n samples v as `pack` gives them."""
    from truepose.numerics import kernels

    out = np.empty((len(u), n))
    if _needs_bessel(family, shape):
        kernels.cross_correlation(kernels.DISTANCE, 0.0, u, samples, out)
        return matern(shape, out)
    kernels.cross_correlation(family, shape, u, samples, out)
    return out


def weighted_sum(
    family: int, u: FloatArray, samples: FloatArray, weights: FloatArray, shape: float = 0.0
) -> FloatArray:
    """Return Σ_j rho(‖u_i − v_j‖) w_jc, (m, c), of samples v and weights w (n, c) as `pack` gives them."""
    from truepose.numerics import kernels

    if not _needs_bessel(family, shape):
        return kernels.weighted_sum(family, shape, u, samples, weights)
    w = _unpack(weights)
    out = np.empty((len(u), w.shape[1]))
    for part in _chunks(len(u), len(w)):
        out[part] = cross_correlation(family, u[part], samples, len(w), shape) @ w
    return out


def weighted_gradient(
    family: int, u: FloatArray, samples: FloatArray, weights: FloatArray, shape: float = 0.0
) -> FloatArray:
    """Return ∂/∂u of `weighted_sum`, (m, c, d)."""
    from truepose.numerics import kernels

    if not _needs_bessel(family, shape):
        return kernels.weighted_gradient(family, shape, u, samples, weights)
    v, w = _unpack(samples), _unpack(weights)
    out = np.empty((len(u), w.shape[1], u.shape[1]))
    moments = (w[:, :, None] * v[:, None, :]).reshape(len(v), -1)
    for part in _chunks(len(u), len(w)):
        slope = _matern_slope(shape, cross_correlation(kernels.DISTANCE, u[part], samples, len(w)))
        out[part] = (slope @ w)[:, :, None] * u[part, None, :] - (slope @ moments).reshape(-1, *out.shape[1:])
    return out


def matern(nu: float, r: ArrayLike) -> FloatArray:
    """Return 2^(1−ν)/Γ(ν) t^ν K_ν(t), t = √(2ν) r; 1 at r = 0. Source: M. L. Stein, Interpolation (1999), §2.7."""
    return _bessel(nu, math.sqrt(2 * nu) * np.asarray(r, dtype=np.float64))


def correlation_by_shape(family: str, r: FloatArray, shape: float) -> FloatArray:
    """Return ∂ρ/∂shape at scaled distances r; by Matérn's ν in central differences of fourth order."""
    safe = np.where(r > 0, r, 1.0)
    if family == "stable":
        power = safe**shape
        return np.where(r > 0, -power * np.log(safe) * np.exp(-power), 0.0)
    if family == "power":
        return np.where(r > 0, -(safe**shape) * np.log(safe), 0.0)
    if family == "rational":
        q = r * r / (2 * shape)
        return np.asarray((q / (1 + q) - np.log1p(q)) * (1 + q) ** -shape)
    step = 2e-3 * shape
    near = matern(shape + step, r) - matern(shape - step, r)
    far = matern(shape + 2 * step, r) - matern(shape - 2 * step, r)
    return np.asarray((8 * near - far) / (12 * step))


def _bessel(nu: float, t: FloatArray) -> FloatArray:
    from scipy.special import gammaln, kve

    tiny = t < 1e-8 * max(1.0, math.sqrt(nu))  # 1 − rho is below 1e-16 there where ν >= 1; a power of t below that
    safe = np.where(tiny, 1.0, t)
    value = np.exp((1 - nu) * math.log(2.0) - gammaln(nu) + nu * np.log(safe) - safe) * kve(nu, safe)
    if not tiny.any():
        return np.asarray(value, dtype=np.float64)
    near = 1.0 if nu > 0.9 else 1 - math.exp(gammaln(1 - nu) - gammaln(1 + nu)) * (t / 2) ** (2 * nu)
    return np.asarray(np.where(tiny, near, value), dtype=np.float64)


def _matern_slope(nu: float, r: FloatArray) -> FloatArray:
    """rho'(r)/r: −ν/(ν − 1) times the function of ν − 1 at the same t; below ν = 1 by K_(1−ν)."""
    from scipy.special import gammaln, kve

    t = math.sqrt(2 * nu) * r
    if nu > 1:
        return -nu / (nu - 1) * _bessel(nu - 1, t)
    safe = np.where(t > 0, t, 1.0)
    size = np.exp((2 - nu) * math.log(2.0) - gammaln(nu) + (nu - 1) * np.log(safe) - safe)
    return np.asarray(np.where(t > 0, -nu * size * kve(1 - nu, safe), 0.0))


def _needs_bessel(family: int, shape: float) -> bool:
    return family == FAMILIES["matern"].code and not (shape + 0.5).is_integer()


def _unpack(packed: FloatArray) -> FloatArray:
    """Return the rows that `pack` laid in blocks, (n, c), with the zeros that fill the last block."""
    return packed.transpose(0, 2, 1).reshape(-1, packed.shape[1])


def _chunks(m: int, n: int) -> list[slice]:
    rows = max(1, ROWS // n)
    return [slice(start, min(start + rows, m)) for start in range(0, m, rows)]


def slope_moments(
    family: int, u: FloatArray, weights: FloatArray, shape: float = 0.0, *, full: bool = False
) -> FloatArray:
    """Return Σ_(j>i) W_ij (−rho'(r)/r) Δu Δuᵀ, (d, d), of scaled points u (n, d) and the upper triangle of W (n, n).

    Its diagonal is Σ W_ij ∂rho_ij/∂log a_k, since ∂rho_ij/∂log a_k = −rho'(r)/r (u_ik − u_jk)²; the trace is the
    derivative by one common range. The other elements, zero unless `full`, are for rotations of the axes.
    """
    from truepose.numerics import kernels

    samples = kernels.pack(u)
    if _needs_bessel(family, shape):
        r = cross_correlation(kernels.DISTANCE, u, samples, len(u))
        product = np.triu(weights, 1) * -_matern_slope(shape, r)
        gaps = u[:, None] - u[None]
        return np.asarray(np.einsum("ij,ija,ijc->ac", product, gaps, gaps, optimize=True))
    lower: FloatArray = kernels.slope_moments(family, shape, u, samples, weights, full).sum(axis=0)
    return lower + np.tril(lower, -1).T
