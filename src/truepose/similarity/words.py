"""The words of `verdict` and of the pictures, in one place: a report in another language brings its own."""

from __future__ import annotations

from typing import Final, Protocol

ENGLISH: Final = {
    "axis": "{family}, axis {number}",
    "band": "shuffled, {percent:g} %",
    "chance": "The similarity is not distinguishable from chance (p = {p:.2g}): {count}.",
    "count": "{below} of {lags} lags lie below the {percent:g} % band of shuffled data",
    "distance": "distance h [{unit}]",
    "extent": "similarity fades out at {range:.4g} {unit} (95 % of the sill)",
    "few": "fewer than 30 pairs",
    "outside": "the same, outside the axes",
    "points": "measured (area: pairs)",
    "reach": "out to {lag:.4g} {unit}",
    "residual": "left by a fit of kinematics",
    "semivariance": "semivariance γ(h) [mm²]",
    "short": "at some short lags",
    "similar": (
        "Yes, near points have similar errors (p = {p:.2g}): {count} ({reach}), {extent}, and {structure:.6g} % of "
        "the variance within {lag:.4g} {unit} is structure, the rest noise (nugget)."
    ),
    "theory": "implied by kinematics",
    "trend": "there is no sill within the samples (a trend)",
    "practical_range": "practical range {range:.3g} {unit}",
}
"""Sentences by key; each language has the same keys and values."""


class Words(Protocol):
    """A function that returns the text of a key, with values inserted."""

    def __call__(self, key: str, /, **values: float | str) -> str:
        """Return the text."""


def english(key: str, /, **values: float | str) -> str:
    """Return a text of `ENGLISH`.

    Examples
    --------
    >>> english("distance", unit="mm")
    'distance h [mm]'
    """
    return ENGLISH[key].format(**values)
