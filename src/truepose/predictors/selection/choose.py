"""Which predictor is best where it has not seen samples: nested cross-validation (theory (14))."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.predictors.base import Predictor
from truepose.predictors.registry import PREDICTORS, check_name
from truepose.predictors.selection.cross_validation import Job, Outcome, PositionalErrors, Registrable, cross_validate
from truepose.predictors.selection.folds import split_samples
from truepose.predictors.selection.ranking import HeldOut, difference_intervals, figures, score, take

QUICK: Final = (
    "registration",
    "idw",
    "ordinary-kriging",
    "universal-kriging",
    "ordinary-kriging-joint",
    "calibration",
    "kinematic-kriging",
)
"""Candidates unless others are named: one of each kind."""

_MANY: Final = 2000
_LOCAL: Final = {  # global Kriging is cubic in the number of samples
    "ordinary-kriging": "local-kriging",
    "ordinary-kriging-joint": "local-kriging-joint",
}
_TOO_MUCH: Final = {"universal-kriging", "idw"}


@dataclass(frozen=True, eq=False)
class Choice:
    """What `choose` found.

    Attributes
    ----------
    ranking : list of dict
        One row for each candidate, the one taken first, then by ``mean_mm``: ``predictor``, `figures`, ``log_density``
        (mean, per reading), ``worse_by_mm`` than the first and ``worse_by_interval_mm``, its 95 % interval, ``level``:
        whether that may be chance. One that failed comes last, with its error as ``note``.
    expected : dict
        What the choice itself leaves on samples that took part neither in a fit nor in the choice (the outer loop):
        `figures`, and ``chosen``: how often each candidate was taken.
    predictor_name : str
    predictor : Predictor
        The candidate taken, fitted to all samples.
    gross : (n,) array
        How strongly the others contradict each sample, in standard deviations; 0 for those in the fit.
    errors : PositionalErrors
        The samples, as registered by all of them.
    """

    ranking: list[dict[str, Any]]
    expected: dict[str, Any]
    predictor_name: str
    predictor: Predictor
    gross: FloatArray
    errors: PositionalErrors


def choose(
    samples: Registrable,
    candidates: str | Sequence[str] = "quick",
    *,
    splits: Sequence[str] = ("points", "blocks"),
    folds: int = 5,
    rng: int = 0,
    workers: int = 1,
    progress: Callable[[str], Any] = str,
) -> Choice:
    """Rank predictors by what they leave on samples that they have not seen, and fit the one to take.

    Parameters
    ----------
    samples : PositionalErrors, or what can be registered
        n samples.
    candidates : "quick", "all", or sequence of str
        Names of `PREDICTORS`; ``quick`` are `QUICK`. Those whose space has no coordinates, or that need an arm, are
        passed over without.
    splits : sequence of str
        Ways to divide the samples, see `split_samples`; what is left is averaged over them. Blocks alone ask for
        extrapolation, points alone flatter interpolators.
    folds, rng : int
        Of the splits.
    workers : int
        Processes, see `cross_validate`; the result is the same.
    progress : callable
        Takes a line after each fit.

    Returns
    -------
    Choice

    Raises
    ------
    DataError
        If a name is not known, no candidate can be fitted, or there are fewer samples than folds.
    """
    errors = samples.registered_by(slice(None))
    names = _names(candidates, errors)
    robot = None if errors.arm is None else errors.arm.robot
    labels = split_samples(splits, errors.coordinates, robot=robot, folds=folds, rng=rng)
    outcomes = cross_validate(Job(samples, labels), names, workers=workers, progress=progress)
    notes = {outcome.task.candidate: outcome.note for outcome in outcomes if outcome.note}
    if len(notes) == len(names):
        raise DataError(f"no candidate could be fitted; {names[0]} {notes[names[0]]}")
    held_out = _held_out(outcomes, labels, [name for name in names if name not in notes])
    ranking = _ranking(held_out, rng) + [{"predictor": name, "note": note} for name, note in notes.items()]
    expected = _expected(outcomes, labels, held_out, rng)
    best = ranking[0]["predictor"]
    progress(f"Fitting {best}")
    predictor, gross = errors.fit(best)
    return Choice(ranking, expected, best, predictor, gross, errors)


def _names(candidates: str | Sequence[str], errors: PositionalErrors) -> list[str]:
    """Return the names of candidates that the samples can bear, each once."""
    if isinstance(candidates, str):
        if candidates not in ("quick", "all"):
            raise DataError(f'candidates are {candidates!r}; expected "quick", "all" or a list of predictors\' names')
        candidates = QUICK if candidates == "quick" else tuple(PREDICTORS)
        if len(errors) > _MANY:
            candidates = [_LOCAL.get(name, name) for name in candidates if name not in _TOO_MUCH]
    for name in candidates:
        check_name(name)
    names = [name for name in dict.fromkeys(candidates) if errors.supports(name)]
    if not names:
        raise DataError(f"none of {', '.join(candidates) or 'no candidates'} can be fitted without joints or the arm")
    return names


def _held_out(outcomes: Sequence[Outcome], labels: Mapping[str, IntArray], names: Sequence[str]) -> HeldOut:
    """Put the folds of each split together again."""
    n = len(next(iter(labels.values())))
    shape = (len(names), len(labels), n, 3)
    residual, std = np.full(shape, np.nan), np.full(shape, np.nan)
    place, split = {name: c for c, name in enumerate(names)}, {name: s for s, name in enumerate(labels)}
    for outcome in outcomes:
        if outcome.task.candidate in place:
            at = place[outcome.task.candidate], split[outcome.task.split], outcome.rows
            residual[at], std[at] = outcome.residual, outcome.std
    return HeldOut(tuple(names), tuple(labels), residual, std)


def _ranking(held_out: HeldOut, rng: int) -> list[dict[str, Any]]:
    told = held_out.without(held_out.gross)
    best = take(told, rng=rng)
    mean, density = score(told), told.log_density.mean(axis=(1, 2))
    worse = difference_intervals(told, best, rng=rng)
    order = sorted(range(len(mean)), key=lambda c: (c != best, mean[c]))
    return [
        {
            "predictor": told.names[c],
            **figures(told.residual[c], told.std[c], told.splits, rng=rng),
            "log_density": float(density[c]),
            "worse_by_mm": float(mean[c] - mean[best]),
            "worse_by_interval_mm": worse[c].tolist(),
            "level": bool(worse[c, 0] <= 0.0),
        }
        for c in order
    ]


def _expected(
    outcomes: Sequence[Outcome], labels: Mapping[str, IntArray], held_out: HeldOut, rng: int
) -> dict[str, Any]:
    """Return the outer loop: each fold predicted by the candidate that the other folds alone would choose."""
    residual, std = np.empty(held_out.residual.shape[1:]), np.empty(held_out.residual.shape[1:])
    chosen: Counter[str] = Counter()
    for s, (split, label) in enumerate(labels.items()):
        for fold in np.unique(label):
            mine = [o for o in outcomes if (o.task.split, o.task.fold) == (split, fold) and not o.note]
            best = _inner_choice(mine, rng)
            chosen[best.task.candidate] += 1
            residual[s, best.rows], std[s, best.rows] = best.residual, best.std
    told = ~held_out.gross
    return {**figures(residual[:, told], std[:, told], held_out.splits, rng=rng), "chosen": dict(chosen.most_common())}


def _inner_choice(outcomes: Sequence[Outcome], rng: int) -> Outcome:
    """Return the outcome of the candidate that is to be taken by what it leaves on the samples of its own fit."""
    whole = [o for o in outcomes if all(np.isfinite(residual).all() for residual, _ in o.inner.values())]
    if not whole:  # too few samples for a second division
        return outcomes[0]
    inner = HeldOut(
        tuple(o.task.candidate for o in whole),
        tuple(whole[0].inner),
        np.array([[residual for residual, _ in o.inner.values()] for o in whole]),
        np.array([[std for _, std in o.inner.values()] for o in whole]),
    )
    return whole[take(inner.without(inner.gross), rng=rng)]
