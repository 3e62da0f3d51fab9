"""The uncertainty of a measured error, from its contributions: a budget as GUM asks for it.

Each contribution has a covariance matrix for each target. The length of an error changes with what lies along it alone,
so the variances count in the direction of the error. They are added; the expanded uncertainty has the coverage factor
of Student's t at 95.45 % with the effective degrees of freedom, so that k = 2 where all are known well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy.stats import t as student

from truepose._typing import FloatArray

Source = Literal["reading", "reflector", "station", "tool", "repeatability", "temperature"]
Distribution = Literal["normal", "rectangular"]
PROBABILITY: Final = 0.9545
"""That of k = 2 for a normal distribution."""
_RECTANGULAR: Final = 1.0 / np.sqrt(3.0)
_TINY: Final = np.finfo(float).tiny


class Contribution(NamedTuple):
    """A contribution to the uncertainty of the errors at n targets.

    Attributes
    ----------
    source : str
        What it is.
    covariance : (n, 3, 3) array [mm²], base frame, or None
        Its covariance at each target; None where it is not stated.
    distribution : {"normal", "rectangular"}
        The distribution.
    dof : float
        The degrees of freedom of its standard uncertainty.
    common : bool
        Whether it shifts all targets alike, so that no mean over targets makes it smaller.
    origin : str
        Where it is stated.
    """

    source: Source
    covariance: FloatArray | None
    distribution: Distribution = "normal"
    dof: float = np.inf
    common: bool = False
    origin: str = ""


@dataclass(frozen=True)
class BudgetLine:
    """A line of an uncertainty budget, for a table.

    Attributes
    ----------
    source : str
        The contribution.
    u_mm : float or None [mm]
        Its standard uncertainty along the errors, RMS of the targets; None where it is not stated.
    share : float or None
        Its share of the variance.
    distribution : {"normal", "rectangular"}
        The distribution.
    dof : float or None
        The degrees of freedom; None where they are without limit.
    common : bool
        Whether it shifts all targets alike.
    origin : str
        Where it is stated.
    """

    source: Source
    u_mm: float | None
    share: float | None
    distribution: Distribution
    dof: float | None
    common: bool
    origin: str


class Budget(NamedTuple):
    """The uncertainty of the errors at n targets.

    Attributes
    ----------
    u, expanded : (n,) arrays [mm]
        The combined standard and the expanded uncertainty of each error.
    k : (n,) array
        The coverage factors.
    lines : tuple of BudgetLine
        The contributions.
    """

    u: FloatArray
    expanded: FloatArray
    k: FloatArray
    lines: tuple[BudgetLine, ...]


def isotropic(std: FloatArray) -> FloatArray:
    """Return the covariances (n, 3, 3) of standard uncertainties (n,) that are the same in all directions."""
    return np.square(std)[:, None, None] * np.eye(3)


def along(half_width: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the covariances (n, 3, 3) of rectangular distributions with half widths (n,) along directions (n, 3)."""
    size = np.linalg.norm(directions, axis=1, keepdims=True)
    a = _RECTANGULAR * half_width[:, None] * directions / np.maximum(size, _TINY)
    return np.asarray(a[:, :, None] * a[:, None, :])


def budget(errors: FloatArray, contributions: Sequence[Contribution]) -> Budget:
    """Combine contributions to the uncertainty of the lengths of errors.

    Parameters
    ----------
    errors : (n, 3) array [mm], base frame
        The measured errors. One of no length has the largest uncertainty of any direction.
    contributions : sequence of Contribution
        The contributions, also those that are not stated.

    Notes
    -----
    Source: JCGM 100:2008 (GUM), 5.1.2, G.4.1 (Welch-Satterthwaite) and G.6.4.

    Examples
    --------
    >>> reading = Contribution("reading", isotropic(np.array([0.03])))
    >>> station = Contribution("station", isotropic(np.array([0.04])), common=True)
    >>> found = budget(np.array([[0.2, 0.0, 0.0]]), [reading, station])
    >>> round(float(found.u[0]), 6), round(float(found.expanded[0]), 6)
    (0.05, 0.1)
    """
    n = len(errors)
    stated = [(one, one.covariance) for one in contributions if one.covariance is not None]
    whole = np.sum([np.zeros((n, 3, 3)), *(covariance for _, covariance in stated)], axis=0)
    length = np.linalg.norm(errors, axis=1)
    worst = np.linalg.eigh(whole)[1][:, :, -1]
    unit = np.where((length > 0.0)[:, None], errors / np.maximum(length, _TINY)[:, None], worst)
    parts = [np.einsum("ni,nij,nj->n", unit, covariance, unit) for _, covariance in stated]
    variance = np.sum([np.zeros(n), *parts], axis=0)
    weights = np.sum([np.zeros(n), *(v**2 / one.dof for v, (one, _) in zip(parts, stated, strict=True))], axis=0)
    dof = np.divide(variance**2, weights, out=np.full(n, np.inf), where=weights > 0.0)
    k = np.where(np.isfinite(dof), student.ppf(0.5 + PROBABILITY / 2.0, np.where(np.isfinite(dof), dof, 1.0)), 2.0)
    known = iter(parts)
    lines = tuple(_line(one, None if one.covariance is None else next(known), variance) for one in contributions)
    u = np.sqrt(variance)
    return Budget(u, k * u, k, lines)


def _line(one: Contribution, part: FloatArray | None, variance: FloatArray) -> BudgetLine:
    u = share = None
    if part is not None:
        total = float(variance.mean())
        u, share = float(np.sqrt(part.mean())), float(part.mean()) / total if total > 0.0 else 0.0
    dof = None if np.isinf(one.dof) else float(one.dof)
    return BudgetLine(one.source, u, share, one.distribution, dof, one.common, one.origin)


def words(line: BudgetLine) -> str:
    """Return a contribution in words.

    Examples
    --------
    >>> words(BudgetLine("reflector", None, None, "rectangular", None, False, "[uncertainty] reflector_mm"))
    'reflector: not stated ([uncertainty] reflector_mm)'
    """
    if line.u_mm is None or line.share is None:
        return f"{line.source}: not stated ({line.origin})"
    alike = ", alike at all targets" if line.common else ""
    return f"{line.source}: {line.u_mm:.4f} mm, {100 * line.share:.0f} %{alike} ({line.origin})"
