"""Held-out residuals of candidates into a ranking: figures, bootstrap intervals, and which candidate to take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from truepose._typing import BoolArray, FloatArray

_BOOTSTRAPS: Final = 1000
_GROSS: Final = 10.0  # times the median of the best candidate: no candidate predicts it
_LEVEL: Final = 0.05
_INSIDE_95: Final = 1.95996


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Each sample predicted by each candidate without its fold, in each split.

    Attributes
    ----------
    names : tuple of str
        Of the c candidates; all of them have finite residuals.
    splits : tuple of str
    residual, std : (c, s, n, 3) arrays [mm]
    """

    names: tuple[str, ...]
    splits: tuple[str, ...]
    residual: FloatArray
    std: FloatArray

    @property
    def length(self) -> FloatArray:
        """Lengths of the residuals, (c, s, n) [mm]."""
        length: FloatArray = np.linalg.norm(self.residual, axis=3)
        return length

    @property
    def log_density(self) -> FloatArray:
        """Log density that each candidate gave to each reading, its components taken for independent, (c, s, n)."""
        std = np.maximum(self.std, np.finfo(float).tiny)
        density: FloatArray = -(0.5 * (self.residual / std) ** 2 + np.log(std) + 0.5 * np.log(2 * np.pi)).sum(axis=3)
        return density

    @property
    def gross(self) -> BoolArray:
        """Readings that no candidate predicts in any split: they say nothing about candidates, (n,)."""
        length = self.length
        typical = np.median(length, axis=2).min(axis=0)  # (s,)
        beyond: BoolArray = (length.min(axis=0) > _GROSS * typical[:, None]).all(axis=0)
        return beyond

    def without(self, rows: BoolArray) -> HeldOut:
        """Return these figures without some samples."""
        return HeldOut(self.names, self.splits, self.residual[:, :, ~rows], self.std[:, :, ~rows])


def score(held_out: HeldOut) -> FloatArray:
    """Return what candidates are ranked by, lower is better: mean length over all samples and splits, (c,) [mm]."""
    mean: FloatArray = held_out.length.mean(axis=(1, 2))
    return mean


def take(held_out: HeldOut, *, rng: int = 0) -> int:
    """Return the index of the candidate to take.

    Candidates within 5 % of the best whose difference may be chance are level; of these the one is taken that gave the
    readings the highest density: it judges the standard deviation, too, and tells candidates apart from fewer samples.
    """
    mean = score(held_out)
    level = difference_intervals(held_out, int(np.argmin(mean)), rng=rng)[:, 0] <= 0.0
    level &= mean <= (1.0 + _LEVEL) * mean.min()
    density = held_out.log_density.mean(axis=(1, 2))
    return int(np.argmax(np.where(level, density, -np.inf)))


def difference_intervals(held_out: HeldOut, reference: int, *, rng: int = 0) -> FloatArray:
    """Return 95 % bootstrap intervals of how much worse each candidate is than a reference, paired, (c, 2) [mm]."""
    per_sample = held_out.length.mean(axis=1)
    return _intervals(per_sample - per_sample[reference], rng)


def figures(residual: FloatArray, std: FloatArray, splits: tuple[str, ...], *, rng: int = 0) -> dict[str, Any]:
    """Return the figures of one candidate as plain values.

    Parameters
    ----------
    residual, std : (s, n, 3) arrays [mm]
    splits : tuple of str
    rng : int
        Of the bootstrap, over samples.

    Returns
    -------
    dict
        ``mean_mm`` over samples and splits with ``mean_interval_mm``, its interval; ``p95_mm``; ``mean_mm`` and
        ``p95_mm`` of each split in ``splits``; ``within_95``: share of components in their predicted 95 % intervals.
    """
    length = np.linalg.norm(residual, axis=2)
    return {
        "mean_mm": float(length.mean()),
        "mean_interval_mm": _intervals(length.mean(axis=0)[None], rng)[0].tolist(),
        "p95_mm": float(np.percentile(length, 95)),
        "splits": {
            name: {"mean_mm": float(one.mean()), "p95_mm": float(np.percentile(one, 95))}
            for name, one in zip(splits, length, strict=True)
        },
        "within_95": float(np.mean(np.abs(residual) < _INSIDE_95 * std)),
    }


def _intervals(values: FloatArray, rng: int) -> FloatArray:
    """Return 95 % bootstrap intervals of the mean of each row of (c, n): (c, 2)."""
    generator, n = np.random.default_rng(rng), values.shape[1]
    means = np.stack([values[:, generator.integers(0, n, n)].mean(axis=1) for _ in range(_BOOTSTRAPS)])
    return np.asarray(np.percentile(means, [2.5, 97.5], axis=0).T)
