"""What a fitted model's bounds mean, in words; and the warning of a fit that the samples do not support."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from truepose.errors import VariogramWarning

if TYPE_CHECKING:
    from truepose.similarity.model import VariogramModel

_MEANING: Final = {
    ("nugget", "lower"): "no nugget can be told: the semivariance starts at zero",
    ("nugget", "upper"): "nearly all of the variance is nugget: no similarity within these lags",
    ("sill", "lower"): "the semivariogram is flat: no similarity within these lags",
    ("range", "lower"): "the range is shorter than the shortest lag: use narrower bins or nearer points",
}


def remarks_on(bounds_hit: Mapping[str, str], practical_range: float, longest: float) -> tuple[str, ...]:
    """Return what bounds and range of a fit mean.

    Parameters
    ----------
    bounds_hit : mapping of str to {"lower", "upper"}
    practical_range, longest : float
        Of the model, and the largest lag (or distance) that it was fitted to; infinite ranges are no fault of a fit.
    """
    said = []
    if sill_is_beyond(bounds_hit, practical_range, longest):
        said.append(
            f"no sill within the samples: the practical range of {practical_range:.4g} is beyond the largest lag of "
            f"{longest:.4g}, so sill and range are extrapolated (a trend); remove a drift first, or use the model at "
            "shorter lags only"
        )
    hit = [(name.split("_")[0], bound) for name, bound in bounds_hit.items()]
    return tuple(said + list(dict.fromkeys(_MEANING[item] for item in hit if item in _MEANING)))


def sill_is_beyond(bounds_hit: Mapping[str, str], practical_range: float, longest: float) -> bool:
    """Return whether a model with a sill reaches it beyond the largest lag only."""
    upper = any(name.startswith("range") and bound == "upper" for name, bound in bounds_hit.items())
    return upper or longest < practical_range < math.inf


def warn_of(model: VariogramModel) -> VariogramModel:
    """Return a fitted model, after one `VariogramWarning` of all remarks on it."""
    if model.fit is not None and model.fit.remarks:
        warnings.warn(f"{model.family} variogram: {'; '.join(model.fit.remarks)}", VariogramWarning, stacklevel=3)
    return model


@contextmanager
def without_warning() -> Iterator[None]:
    """Let fits inside give no `VariogramWarning`: for callers that fit often, or say the remarks themselves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", VariogramWarning)
        yield
