"""Models of the semivariogram and of the covariance that belongs to it, theory (5), and the record of their fit."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose._io.tables import facts_table
from truepose._typing import FloatArray
from truepose.errors import KrigingError, VariogramWarning
from truepose.similarity.structure import SingleStructure, check_shape, cross_correlation, family_named

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


_MEANING: Final = {
    ("nugget", "lower"): "the nugget is not identifiable: the semivariance starts at zero",
    ("nugget", "upper"): "nearly all of the variance is nugget: no similarity within these lags",
    ("sill", "lower"): "the semivariogram is flat: no similarity within these lags",
    ("range", "lower"): "the range is shorter than the shortest lag: use narrower bins or nearer points",
}


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class FitRecord:
    """The record of a fit.

    Attributes
    ----------
    candidates : dict of str to float
        The criterion of every family that was tried.
    bounds_hit : dict of str to {"lower", "upper"}
        The parameters that ended at a bound.
    standard_error : dict of str to float
        The standard error of each parameter; NaN for a parameter at a bound.
    fitted : dict
        The model that was found, as returned by `VariogramModel.to_dict`; it stays when a value is replaced by hand.
    practical_range : float
        The practical range of that model.
    longest : float
        The largest distance that the model was fitted to.
    """

    candidates: dict[str, float]
    bounds_hit: dict[str, str]
    standard_error: dict[str, float] = field(default_factory=dict)
    fitted: dict[str, Any] = field(default_factory=dict)
    practical_range: float = math.nan
    longest: float = math.nan

    @property
    def no_sill(self) -> bool:
        """Whether the model reaches its sill only beyond `longest`: sill and range are extrapolated."""
        upper = any(name.startswith("range") and bound == "upper" for name, bound in self.bounds_hit.items())
        return upper or self.longest < self.practical_range < math.inf

    @property
    def remarks(self) -> tuple[str, ...]:
        """The meaning of bounds and range, in words."""
        remarks = []
        if self.no_sill:
            remarks.append(
                f"no sill within the samples: the practical range of {self.practical_range:.4g} is beyond the largest "
                f"lag of {self.longest:.4g}, so sill and range are extrapolated (a trend); remove a drift first, or "
                "use the model at shorter lags only"
            )
        hit = [(name.split("_")[0], bound) for name, bound in self.bounds_hit.items()]
        return tuple(remarks + list(dict.fromkeys(_MEANING[item] for item in hit if item in _MEANING)))

    def __repr__(self) -> str:
        """Return family, standard errors and bounds in one line."""
        errors = ", ".join(f"{name}={value:.2g}" for name, value in self.standard_error.items() if value == value)
        bounds = ", ".join(f"{name} {bound}" for name, bound in self.bounds_hit.items()) or "none"
        family = self.fitted.get("family", "none")
        return (
            f"{type(self).__name__}({family} of {len(self.candidates)}; standard errors: {errors}; at bound: {bounds})"
        )


@dataclass(frozen=True)
class VariogramModel(SingleStructure):
    """A semivariogram γ(h) = C0 + Σ C (1 − ρ(h/a)) for h > 0, γ(0) = 0: a nugget and one structure, or a sum of them.

    =========== ======================================== ===================== ==========
    family      ρ(r), r = h/a                            practical range       dimensions
    =========== ======================================== ===================== ==========
    spherical   1 − 3/2 r + 1/2 r³ for r < 1, else 0     0.811 a               1 to 3
    exponential exp(−r)                                  2.996 a               any
    gaussian    exp(−r²)                                 1.731 a               any
    matern32    (1 + √3 r) exp(−√3 r)                    2.739 a               any
    matern52    (1 + √5 r + 5/3 r²) exp(−√5 r)           2.647 a               any
    matern      2^(1−ν)/Γ(ν) t^ν K_ν(t), t = √(2ν) r     by ν, 0 < ν <= 30     any
    stable      exp(−r^α)                                by α, 0 < α <= 2      any
    rational    (1 + r²/(2α))^(−α)                       by α, 0 < α           any
    cubic       1 − 7r² + 35/4 r³ − 7/2 r⁵ + 3/4 r⁷      0.690 a               1 to 3
    hole        sin(r)/r                                 2.991 a, then returns 1 to 3
    nugget      0 for r > 0                              0                     any
    linear      1 − r: γ = C0 + C h/a                    no sill               any
    power       1 − r^α: γ = C0 + C (h/a)^α              no sill, 0 < α < 2    any
    =========== ======================================== ===================== ==========

    So C(h) = 10 exp(−0.3 h) is ``VariogramModel("exponential", sill=10, range=1 / 0.3)``. Several ranges make it
    anisotropic: r = ‖Rᵀ h / a‖ of the vector h between two points, one a for each coordinate (joint space), or for each
    axis of a rotation R. The sum of two models is the model of the sum of two independent fields.

    Parameters
    ----------
    family : str
        A name of the table.
    nugget : float [mm²]
        C0, the step at the origin: noise or micro-scale variation, as stated by `OrdinaryKriging(exact=…)`.
    sill : float [mm²]
        The partial sill C of the first structure; the total is C0 + C. For "linear" and "power": γ − C0 at one range.
    range : float or sequence of float
        The range a, in the unit of the coordinates: one, or one for each coordinate or axis.
    shape : float, optional
        The shape ν or α, of the families that have it.
    rotation : Rotation or (3,) array_like [rad], optional
        The axes of the ranges are the columns of this rotation; as a rotation vector. In two coordinates: about z.
    plus : sequence of VariogramModel
        Further structures (nested model); their nuggets are added to the nugget.
    fit : FitRecord, optional
        The record of the fit that found the model; `fit_variogram` and `fit_likelihood` fill it.

    Raises
    ------
    KrigingError
        For an unknown family, a negative or non-finite parameter, a range of 0, a shape outside the family's bounds, or
        nugget and sills all 0.

    Examples
    --------
    >>> vm = VariogramModel("spherical", nugget=0.01, sill=1.0, range=500.0)
    >>> float(vm.semivariance(500.0)), float(vm.covariance(0.0))
    (1.01, 1.01)
    >>> nested = vm + VariogramModel("matern", sill=0.5, range=(2000.0, 2000.0, 300.0), shape=2.0)
    >>> float(nested.semivariance(300.0, direction=[0, 0, 1]).round(4))
    1.0482
    """

    family: str
    nugget: float = 0.0
    sill: float = 0.0
    range: float | tuple[float, ...] = 1.0
    shape: float | None = field(kw_only=True, default=None)
    rotation: tuple[float, ...] | None = field(kw_only=True, default=None)
    plus: tuple[VariogramModel, ...] = field(kw_only=True, default=())
    fit: FitRecord | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        kind = family_named(self.family)
        several = np.ndim(self.range) > 0
        ranges = tuple(float(a) for a in np.ravel(np.asarray(self.range, dtype=np.float64)))
        _check_parameters(self.nugget, self.sill, self.range, ranges)
        check_shape(self.family, self.shape)
        if kind.practical == 0 and self.sill:
            raise KrigingError(f"a {self.family} has no sill, got sill={self.sill}; pass it as nugget=")
        if several:
            object.__setattr__(self, "range", ranges)
        if self.rotation is not None:
            object.__setattr__(self, "rotation", _rotation_vector(self.rotation, several))
        extra = tuple(self.plus)
        if any(not isinstance(model, VariogramModel) for model in extra):
            raise KrigingError("plus holds something else than VariogramModel; give the further structures as models")
        flat = tuple(part for model in extra for part in model.structures)
        object.__setattr__(self, "nugget", self.nugget + sum(model.nugget for model in extra))
        object.__setattr__(self, "plus", flat)
        if self.nugget + self.partial_sill == 0:
            raise KrigingError("variogram nugget and sill are both 0: nothing varies; give at least one of them")

    def _repr_html_(self) -> str:
        found = {"nugget [mm²]": self.nugget, "partial sill [mm²]": self.sill, "range": self.range}
        more = {f"structure {k}": repr(part) for k, part in enumerate(self.plus, 2)}
        remarks = {} if self.fit is None else {"remark": "; ".join(self.fit.remarks) or "none"}
        return facts_table(f"{self.family} variogram", {**found, **more, **remarks})

    def __repr__(self) -> str:
        """Return the parameters that are set, to six digits, and the remarks of a fit."""
        ranges = _short(self.range)
        parts = [repr(self.family), f"nugget={_short(self.nugget)}", f"sill={_short(self.sill)}", f"range={ranges}"]
        parts += [f"shape={_short(self.shape)}"] if self.shape is not None else []
        parts += [f"rotation={_short(self.rotation)}"] if self.rotation is not None else []
        parts += [f"plus={self.plus!r}"] if self.plus else []
        remarks = () if self.fit is None or self.overridden else self.fit.remarks
        parts += [f"remarks={remarks!r}"] if remarks else []
        return f"VariogramModel({', '.join(parts)})"

    # --- properties ---------------------------------------------------------------------------------------------------

    @property
    def structures(self) -> tuple[VariogramModel, ...]:
        """The structures with a sill, each as a model without nugget."""
        if not self.sill:
            return self.plus
        if not (self.nugget or self.plus or self.fit):
            return (self,)
        return (replace(self, nugget=0.0, plus=(), fit=None), *self.plus)

    @property
    def _parts(self) -> tuple[VariogramModel, ...]:
        """The models whose first structures are the structures with a sill; without a copy that has no nugget."""
        return (self, *self.plus) if self.sill else self.plus

    @property
    def bounded(self) -> bool:
        """Whether every structure has a sill, so that a covariance exists."""
        return all(part.kind.bounded for part in self._parts)

    @property
    def isotropic(self) -> bool:
        """Whether γ depends on the length of h alone."""
        return all(isinstance(part.range, float | int) for part in self._parts)

    @property
    def overridden(self) -> bool:
        """Whether a value was replaced by hand since the fit, whose own values are in ``fit.fitted``."""
        return self.fit is not None and self.fit.fitted != self.to_dict()

    @property
    def partial_sill(self) -> float:
        """Sum of the partial sills of all structures [mm²]."""
        return self.sill + sum(part.sill for part in self.plus)

    @property
    def structural_ratio(self) -> float:
        """C/(C0 + C): the share of the variance that is similarity; the rest is nugget."""
        return self.partial_sill / (self.nugget + self.partial_sill)

    @property
    def practical_range(self) -> float:
        """Distance at which γ first rises to C0 + 0.95 C, along the longest axis; infinite without a sill."""
        return max(self.practical_ranges)

    @property
    def practical_ranges(self) -> tuple[float, ...]:
        """The same along each axis of the first anisotropic structure; one number for an isotropic model."""
        if not self.structures:
            return (0.0,)
        first = self.structures[0]
        if len(self.structures) == 1:
            factor = first.kind.practical_range(first.shape)
            return tuple(factor * a for a in np.ravel(first.range).tolist())
        if self.isotropic:
            return (_first_crossing(self, None),)
        turned = next(part for part in self.structures if isinstance(part.range, tuple))
        return tuple(_first_crossing(self, axis) for axis in turned.axes().T)

    def check_dimensions(self, d: int) -> None:
        """Raise KrigingError where a structure is not valid in d coordinates, or has another number of ranges."""
        for part in self._parts:
            if part.kind.dimensions < d:
                raise KrigingError(
                    f"a {part.family} variogram is valid in up to {part.kind.dimensions} coordinates, but there are "
                    f"{d}; use exponential, gaussian, matern32 or matern52"
                )
            if isinstance(part.range, tuple) and len(part.range) != d:
                raise KrigingError(
                    f"the variogram has {len(part.range)} ranges, but there are {d} coordinates; give one, or {d}"
                )
            if part.rotation is not None:
                part.axes()

    # --- values -------------------------------------------------------------------------------------------------------

    def semivariance(self, h: ArrayLike, direction: ArrayLike | None = None) -> FloatArray:
        """Return γ(h) [mm²] at distances h >= 0 of any shape; 0 at h = 0.

        Parameters
        ----------
        h : array_like
            The distances, in the unit of the coordinates.
        direction : (d,) array_like, optional
            Along which the distances are; needed where the model is anisotropic. Its length does not matter.
        """
        h = _distances(h)
        gamma = np.where(h == 0, 0.0, self.nugget)
        for part in self._parts:
            gamma = gamma + part.sill * (1 - part.correlation(part.scaled_distance(h, direction)))
        return gamma

    def semivariance_between(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return γ [mm²] between each point of x (n, d) and the same row of y (n, d), in any direction: (n,)."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        self.check_dimensions(x.shape[1])
        gamma = np.where((x == y).all(axis=1), 0.0, self.nugget)
        for part in self._parts:
            r = np.linalg.norm(part.coordinates(x - y), axis=1)
            gamma = gamma + part.sill * (1 - part.correlation(r))
        return gamma

    def covariance(self, h: ArrayLike, direction: ArrayLike | None = None) -> FloatArray:
        """Return Cov(h) = Cov(0) − γ(h) [mm²], theory (5), of the field with its nugget: Cov(0) = C0 + C."""
        h = np.asarray(h, dtype=np.float64)
        return self.signal_covariance(h, direction) + np.where(h == 0, self.nugget, 0.0)

    def signal_covariance(self, h: ArrayLike, direction: ArrayLike | None = None) -> FloatArray:
        """Return Σ C ρ(h/a) [mm²]: the covariance of the field without its nugget."""
        self._require_sill()
        h = _distances(h)
        total = np.zeros_like(h)
        for part in self._parts:
            total = total + part.sill * part.correlation(part.scaled_distance(h, direction))
        return total

    def covariance_between(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the covariance of the field without its nugget [mm²], (m, n), of points x (m, d) and y (n, d)."""
        from truepose.numerics.kernels import pack

        self._require_sill()
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        self.check_dimensions(y.shape[1])
        total = np.zeros((len(x), len(y)))
        for part in self._parts:
            u, v = part.coordinates(x), pack(part.coordinates(y))
            total += part.sill * cross_correlation(part.kind.code, u, v, len(y), part.shape or 0.0)
        return total

    def slope(self, h: ArrayLike, direction: ArrayLike | None = None) -> FloatArray:
        """Return dγ/dh [mm² per unit of h] at distances h > 0."""
        h = _distances(h)
        slope = np.zeros_like(h)
        for part in self._parts:
            per_h = part.scaled_distance(1.0, direction)
            r = h * per_h
            slope -= part.sill * part.slope_over_distance(r) * r * per_h
        return slope

    def derivatives(self, h: ArrayLike, direction: ArrayLike | None = None) -> dict[str, FloatArray]:
        """Return ∂γ/∂parameter at distances h, by name.

        Names: ``nugget``, and for the first structure ``sill``, ``range`` (or ``range_1`` …), ``shape``,
        ``rotation_x`` …; for the k-th structure (k = 2 …) the same with ``_of_k``. By ν of a Matérn model in central
        differences of fourth order, the others in closed form.
        """
        h = _distances(h)
        found = {"nugget": np.where(h == 0, 0.0, 1.0)}
        for k, part in enumerate(self._parts, 1):
            suffix = "" if k == 1 else f"_of_{k}"
            found |= {name + suffix: value for name, value in part.structure_derivatives(h, direction).items()}
        return found

    # --- others made of it --------------------------------------------------------------------------------------------

    def __add__(self, other: VariogramModel) -> VariogramModel:
        """Return the model of the sum of two independent fields: the nuggets are added, the structures are kept."""
        if not isinstance(other, VariogramModel):
            return NotImplemented
        return replace(self, plus=(*self.plus, other), fit=None)

    def scaled(self, factor: float) -> Self:
        """Return the model of the quantity whose variance is `factor` times as large."""
        extra = tuple(replace(part, sill=factor * part.sill) for part in self.plus)
        return replace(self, nugget=factor * self.nugget, sill=factor * self.sill, plus=extra)

    def stretched(self, factor: float) -> Self:
        """Return the model whose ranges are `factor` times as long."""
        extra = tuple(part.stretched(factor) for part in self.plus)
        ranges = tuple(factor * a for a in self.range) if isinstance(self.range, tuple) else factor * self.range
        return replace(self, range=ranges, plus=extra)

    def with_pseudo_sill(self, points: FloatArray) -> VariogramModel:
        """Return the same γ with its structures without sill as C (1 − ρ), ρ = 1 − (h/a)^α, C large enough for points.

        Then C ρ can be used as a covariance of these points (n, d): C cancels where weights sum to 1, and the matrix is
        positive definite where C is above the largest energy of unit charge in a ball of radius R that holds the
        points, R^α Γ(1 − α/2) Γ((d + α)/2)/Γ(d/2) (N. S. Landkof, Foundations of Modern Potential Theory, 1972); C is
        twice that.
        """
        d = points.shape[1]

        def bounded(part: VariogramModel) -> VariogramModel:
            if part.kind.bounded:
                return part
            alpha = 1.0 if part.shape is None else part.shape
            radius = float(np.linalg.norm(np.ptp(part.coordinates(points), axis=0))) / 2
            energy = math.exp(math.lgamma(1 - alpha / 2) + math.lgamma((d + alpha) / 2) - math.lgamma(d / 2))
            far = radius * (2 * energy) ** (1 / alpha)
            ranges = tuple(far * a for a in part.range) if isinstance(part.range, tuple) else far * part.range
            return replace(part, sill=part.sill * far**alpha, range=ranges)

        if self.bounded:
            return self
        first, *rest = (bounded(part) for part in self.structures)
        return replace(first, nugget=self.nugget, plus=tuple(rest))

    def to_dict(self) -> dict[str, Any]:
        """Return family, nugget, sill and range (and shape, rotation, plus where there are) as plain values."""
        values: dict[str, Any] = {
            "family": self.family,
            "nugget": float(self.nugget),
            "sill": float(self.sill),
            "range": list(self.range) if isinstance(self.range, tuple) else float(self.range),
        }
        if self.shape is not None:
            values["shape"] = float(self.shape)
        if self.rotation is not None:
            values["rotation"] = list(self.rotation)
        if self.plus:
            values["plus"] = [part.to_dict() for part in self.plus]
        return values

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """Return the model that `to_dict` described."""
        return cls(**values | {"plus": tuple(cls.from_dict(part) for part in values.get("plus", ()))})

    def _require_sill(self) -> None:
        for part in self._parts:
            if not part.kind.bounded:
                raise KrigingError(
                    f"a {part.family} variogram has no sill, so no covariance exists; use its semivariance"
                )


def warn_of_remarks(family: str, record: FitRecord) -> None:
    """Issue one `VariogramWarning` with all remarks of a fit, for the caller of the caller."""
    if record.remarks:
        warnings.warn(f"{family} variogram: {'; '.join(record.remarks)}", VariogramWarning, stacklevel=3)


@contextmanager
def without_warning() -> Iterator[None]:
    """Suppress `VariogramWarning` for callers that fit often, or report the remarks themselves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VariogramWarning)
        yield


def _check_parameters(nugget: float, sill: float, given: Any, ranges: Sequence[float]) -> None:
    for name, value, values in (("nugget", nugget, (nugget,)), ("sill", sill, (sill,)), ("range", given, ranges)):
        least = math.ulp(0.0) if name == "range" else 0.0
        if not values or any(not math.isfinite(v) or v < least for v in values):
            expected = "above 0" if name == "range" else "of 0 or more"
            raise KrigingError(f"variogram {name} is {value}; expected a finite number {expected}")


def _rotation_vector(rotation: Rotation | ArrayLike, several: bool) -> tuple[float, ...]:
    from scipy.spatial.transform import Rotation

    vector = np.asarray(rotation.as_rotvec() if isinstance(rotation, Rotation) else rotation, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise KrigingError(f"variogram rotation is {rotation!r}; expected a scipy Rotation or a rotation vector [rad]")
    if not several:
        raise KrigingError("a rotation needs several ranges, one along each of its axes; give range=(a1, a2, a3)")
    return tuple(vector.tolist())


def _short(values: float | tuple[float, ...]) -> str:
    """Return numbers to six digits, as Python would read them."""
    if isinstance(values, tuple):
        return f"({', '.join(_short(value) for value in values)}{',' * (len(values) == 1)})"
    return repr(float(f"{values:.6g}"))


def _distances(h: ArrayLike) -> FloatArray:
    array = np.asarray(h, dtype=np.float64)
    if not (array >= 0).all():
        raise KrigingError("expected distances of 0 or more, got a negative number or NaN")
    return array


def _first_crossing(model: VariogramModel, direction: FloatArray | None) -> float:
    """Return the first distance at which γ − C0 is 95 % of the sills."""
    from scipy.optimize import brentq

    if not model.bounded:
        return math.inf
    reach = [
        part.kind.practical_range(part.shape) / float(part.scaled_distance(1.0, direction)) for part in model.structures
    ]

    def missing(h: float) -> float:
        return float(model.semivariance(h, direction)) - model.nugget - 0.95 * model.partial_sill

    grid = np.concatenate([[1e-9 * min(reach)], np.linspace(min(reach) / 50, 3 * max(reach), 2000)])
    above = model.semivariance(grid, direction) - model.nugget - 0.95 * model.partial_sill >= 0
    k = int(np.argmax(above))
    return float(brentq(missing, grid[max(k - 1, 0)], grid[k], rtol=1e-14)) if above[k] and k else float(grid[k])
