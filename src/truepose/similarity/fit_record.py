"""The record of how a variogram model was fitted, with remarks on bounds and range."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Final

from truepose.errors import VariogramWarning

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
