"""The words of `verdict` and of the pictures, in one place: a report in another language brings its own."""

from __future__ import annotations

from typing import Final, Protocol

ENGLISH: Final = {
    "axis": "{family}, axis {number}",
    "band": "shuffled, {percent:g} %",
    "chance": "No, the similarity cannot be distinguished from chance (p = {p:.2g}): {count}.",
    "count": (
        "the semivariance of {below} of {lags} distance classes is below the {percent:g} % band of shuffled errors"
    ),
    "distance": "distance h [{unit}]",
    "extent": "the similarity ends at {range:.4g} {unit} (95 % of the sill)",
    "few": "fewer than 30 pairs",
    "outside": "the same, outside the axes",
    "points": "measured (area: pairs)",
    "reach": "all of them up to {lag:.4g} {unit}",
    "residual": "left by a fit of kinematics",
    "semivariance": "semivariance γ(h) [mm²]",
    "short": "but not that of the shortest distances",
    "similar": (
        "Yes, near points have similar errors (p = {p:.2g}): {count}, {reach}; {extent}. Of the variance at "
        "distances up to {lag:.4g} {unit}, {structure:.6g} % is similarity; the rest is noise (nugget)."
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
