"""Compare candidates by their held-out residuals: figures, bootstrap intervals, and the best candidate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from truepose._typing import BoolArray, FloatArray

_BOOTSTRAPS: Final = 1000
_CHUNK: Final = 1_000_000  # samples drawn at once
_GROSS: Final = 10.0  # times the median of the best candidate
_LEVEL: Final = 0.05
_INSIDE_95: Final = 1.95996


@dataclass(frozen=True, eq=False)
class CandidateResiduals:
    """Each sample predicted by each candidate without its fold, in each split.

    Attributes
    ----------
    names : tuple of str
        The c candidates; all of them have finite residuals.
    splits : tuple of str
        The s splits.
    residual, std : (c, s, n, 3) arrays [mm]
        The residuals and their predicted standard deviations, reading noise included.
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
        """Log density of each reading as each candidate predicts it, components independent, (c, s, n)."""
        std = np.maximum(self.std, np.finfo(float).tiny)
        density: FloatArray = -(0.5 * (self.residual / std) ** 2 + np.log(std) + 0.5 * np.log(2 * np.pi)).sum(axis=3)
        return density

    @property
    def gross(self) -> BoolArray:
        """Readings that no candidate predicts in any split, (n,); they do not help to compare candidates."""
        length = self.length
        typical = np.median(length, axis=2).min(axis=0)  # (s,)
        beyond: BoolArray = (length.min(axis=0) > _GROSS * typical[:, None]).all(axis=0)
        return beyond

    def without(self, rows: BoolArray) -> CandidateResiduals:
        """Return the residuals without some samples."""
        return CandidateResiduals(self.names, self.splits, self.residual[:, :, ~rows], self.std[:, :, ~rows])


def score(held_out: CandidateResiduals) -> FloatArray:
    """Return the score of each candidate: the mean residual length over samples and splits, (c,) [mm]."""
    mean: FloatArray = held_out.length.mean(axis=(1, 2))
    return mean


def best_candidate(held_out: CandidateResiduals, *, rng: int = 0) -> int:
    """Return the index of the best candidate.

    Candidates are level if they are within 5 % of the lowest score and the difference may be chance. Among level
    candidates the highest density of the readings decides: it also rates the standard deviations, and it separates
    candidates with fewer samples.
    """
    mean = score(held_out)
    level = difference_intervals(held_out, int(np.argmin(mean)), rng=rng)[:, 0] <= 0.0
    level &= mean <= (1.0 + _LEVEL) * mean.min()
    density = held_out.log_density.mean(axis=(1, 2))
    return int(np.argmax(np.where(level, density, -np.inf)))


def difference_intervals(held_out: CandidateResiduals, reference: int, *, rng: int = 0) -> FloatArray:
    """Return paired 95 % bootstrap intervals of the difference between each candidate and a reference, (c, 2) [mm]."""
    per_sample = held_out.length.mean(axis=1)
    return _intervals(per_sample - per_sample[reference], rng)


def residual_figures(residual: FloatArray, std: FloatArray, splits: tuple[str, ...], *, rng: int = 0) -> dict[str, Any]:
    """Return the accuracy figures of one candidate as plain values.

    Parameters
    ----------
    residual, std : (s, n, 3) arrays [mm]
        The residuals and their predicted standard deviations in each split.
    splits : tuple of str
        The names of the splits.
    rng : int
        The seed of the bootstrap over samples.

    Returns
    -------
    dict
        ``mean_mm`` over samples and splits and its interval ``mean_interval_mm``; ``p95_mm``; ``splits`` with
        ``mean_mm`` and ``p95_mm`` of each split; ``within_95``, the share of components in their predicted 95 %
        intervals.
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
    means = []
    for draws in np.array_split(np.arange(_BOOTSTRAPS), -(-n * _BOOTSTRAPS // _CHUNK)):
        drawn = generator.integers(0, n, (len(draws), n)) + n * np.arange(len(draws))[:, None]
        times = np.bincount(drawn.reshape(-1), minlength=drawn.size).reshape(drawn.shape)
        means.append(times.astype(float) @ values.T / n)
    return np.asarray(np.percentile(np.concatenate(means), [2.5, 97.5], axis=0).T)
