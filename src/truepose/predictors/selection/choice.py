"""Choose the predictor that is best on samples that it has not seen, by nested cross-validation (theory (14))."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from truepose._io.tables import data_frame, html_table
from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.numerics.executor import Executor
from truepose.numerics.threads import one_thread
from truepose.predictors.abilities import Startable
from truepose.predictors.base import Predictor
from truepose.predictors.folds import split_samples
from truepose.predictors.registry import PREDICTORS, predictor_spec
from truepose.predictors.selection.cross_validation import (
    FAILURES,
    FoldResult,
    Job,
    PositionalErrors,
    Registrable,
    cross_validate,
)
from truepose.predictors.selection.ranking import (
    CandidateResiduals,
    best_candidate,
    difference_intervals,
    residual_figures,
    score,
)

if TYPE_CHECKING:
    from pandas import DataFrame

QUICK: Final = (
    "registration",
    "idw",
    "ordinary-kriging",
    "universal-kriging",
    "ordinary-kriging-joint",
    "calibration",
    "kinematic-kriging",
)
"""Default candidates: one of each kind."""

_MANY: Final = 2000
_LOCAL: Final = {  # global Kriging is cubic in the number of samples
    "ordinary-kriging": "local-kriging",
    "ordinary-kriging-joint": "local-kriging-joint",
}
_TOO_SLOW: Final = {"universal-kriging", "idw"}


@dataclass(frozen=True, eq=False, repr=False)
class Choice:
    """The result of `rank_predictors` and `truepose.choose`.

    Attributes
    ----------
    ranking : list of dict
        One row per candidate: first the chosen one, then the others by ``mean_mm``. Each row has ``predictor``, the
        keys of `residual_figures`, ``log_density`` (mean per reading), ``worse_by_mm`` (difference to the first),
        ``worse_by_interval_mm`` (its 95 % interval) and ``level`` (whether the difference may be chance). Candidates
        that failed come last, with their error as ``note``.
    expected : dict
        The residuals that the choice itself leaves on samples that took part neither in a fit nor in the choice (the
        outer loop): the keys of `residual_figures`, and ``chosen``, which counts how often each candidate was chosen.
    predictor_name : str
        The name of the chosen candidate.
    predictor : Predictor
        The chosen candidate, fitted to all samples.
    gross : (n,) array
        How strongly the others contradict each sample, in standard deviations; 0 for samples used in the fit.
    errors : PositionalErrors
        The samples after a registration with all of them.
    excluded : sequence of dict
        The readings that were left out before, as `truepose.Samples.excluded`; they are not among the n samples.
    """

    ranking: list[dict[str, Any]]
    expected: dict[str, Any]
    predictor_name: str
    predictor: Predictor
    gross: FloatArray
    errors: PositionalErrors
    excluded: Sequence[Mapping[str, Any]] = ()

    def __repr__(self) -> str:
        low, high = self.expected["mean_interval_mm"]
        used, n = int((self.gross == 0).sum()), len(self.gross)
        width = max(len(row["predictor"]) for row in self.ranking)
        rows = [f"\n  {row['predictor']:<{width}}  {_figures_of(row)}" for row in self.ranking]
        expected = f"{self.expected['mean_mm']:.3f} mm (95 % interval {low:.3f} to {high:.3f})"
        left_out = f" ({len(self.excluded)} more left out before)" if self.excluded else ""
        head = f"<Choice: {self.predictor_name}, fitted to {used} of {n} samples{left_out}; "
        head += f"expected mean residual {expected}"
        return head + "".join(rows) + ">"

    def _repr_html_(self) -> str:
        header = ["predictor", "mean [mm]", "P95 [mm]", ""]
        rows = [
            (row["predictor"], row.get("mean_mm", ""), row.get("p95_mm", ""), row.get("note", "" if k else "chosen"))
            for k, row in enumerate(self.ranking)
        ]
        return html_table("Cross-validation of the candidates", header, rows)

    def to_frame(self) -> DataFrame:
        """Return a pandas table with one row for each candidate, best first, in mm; needs pandas."""
        figures = ("mean_mm", "p95_mm", "within_95", "log_density", "worse_by_mm", "level")
        columns: dict[str, Any] = {
            key: [row.get(key) for row in self.ranking] for key in ("predictor", *figures, "note")
        }
        for key in ("mean", "worse_by"):
            ends = np.array([row.get(f"{key}_interval_mm", (np.nan, np.nan)) for row in self.ranking])
            columns |= {f"{key}_low_mm": ends[:, 0], f"{key}_high_mm": ends[:, 1]}
        return data_frame(columns)

    def to_dict(self) -> dict[str, Any]:
        """Return the ranking and the expected residuals as plain values, for JSON."""
        return {
            "predictor": self.predictor_name,
            "ranking": self.ranking,
            "expected": self.expected,
            "excluded": list(self.excluded),
        }


def _figures_of(row: Mapping[str, Any]) -> str:
    if "note" in row:
        return str(row["note"])
    level = " (level)" if row["level"] and row["worse_by_mm"] else ""
    return f"mean {row['mean_mm']:.3f} mm, P95 {row['p95_mm']:.3f} mm{level}"


def rank_predictors(
    candidates: str | Sequence[str],
    samples: Registrable,
    *,
    splits: Sequence[str] = ("points", "blocks"),
    folds: int = 5,
    rng: int = 0,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[str], Any] = str,
) -> Choice:
    """Rank predictors by their residuals on samples that they have not seen, and fit the best one.

    Parameters
    ----------
    candidates : "quick", "all", or sequence of str
        The names of predictors, see `PREDICTORS`; ``quick`` stands for `QUICK`. Candidates whose coordinates or whose
        arm are not known are left out.
    samples : PositionalErrors or Registrable
        The n samples.
    splits : sequence of str
        The ways to divide the samples, see `split_samples`; residuals are averaged over them. Blocks alone ask for
        extrapolation; points alone favour interpolators.
    folds : int
        The number of folds of each split.
    rng : int
        The seed of the splits and of the bootstrap.
    workers : int
        The number of processes; it does not change the result. 0: as many as pay, see `cross_validate`.
    executor : Executor, optional
        Where the fits run, instead of processes of this machine; it does not change the result.
    progress : callable
        A function that receives a line after each fit.

    Returns
    -------
    Choice

    Raises
    ------
    DataError
        If a name is not known, no candidate can be fitted, or there are fewer samples than folds.

    Examples
    --------
    >>> import numpy as np
    >>> p = np.random.default_rng(0).uniform(0, 1000, (40, 3))
    >>> rank_predictors(["registration", "idw"], PositionalErrors({"cartesian": p}, np.sin(p / 300))).predictor_name
    'idw'
    """
    errors = samples.registered_by(slice(None))
    names = _names(candidates, errors)
    robot = None if errors.arm is None else errors.arm.robot
    labels = split_samples(splits, errors.coordinates, robot=robot, folds=folds, rng=rng, pose=errors.pose)
    fitted: dict[str, tuple[Predictor, FloatArray]] = {}

    def optimum(name: str) -> Any:
        """Return the optimum of a candidate with all samples, from which its folds start."""
        if not issubclass(predictor_spec(name).family, Startable):
            return None
        progress(f"Fitting {name}")
        with suppress(*FAILURES), one_thread():  # the folds say why; they run at the same time
            fitted[name] = errors.fit(name)
        model = fitted[name][0] if name in fitted else None
        return model.optimum() if isinstance(model, Startable) else None

    job = Job(samples, labels)
    results = cross_validate(job, names, optimum=optimum, workers=workers, executor=executor, progress=progress)
    notes = {result.fit.candidate: result.note for result in results if result.note}
    if len(notes) == len(names):
        raise DataError(f"no candidate could be fitted; {names[0]} {notes[names[0]]}")
    residuals = _joined(results, labels, [name for name in names if name not in notes])
    ranking = _ranking(residuals, rng) + [{"predictor": name, "note": note} for name, note in notes.items()]
    expected = _expected(results, labels, residuals, rng)
    best = ranking[0]["predictor"]
    if best not in fitted:
        progress(f"Fitting {best}")
        fitted[best] = errors.fit(best)
    predictor, gross = fitted[best]
    return Choice(ranking, expected, best, predictor, gross, errors)


def _names(candidates: str | Sequence[str], errors: PositionalErrors) -> list[str]:
    """Return the names of the candidates that the samples support, each once."""
    if isinstance(candidates, str):
        if candidates not in ("quick", "all"):
            raise DataError(f'candidates is {candidates!r}; expected "quick", "all" or a list of predictor names')
        candidates = QUICK if candidates == "quick" else tuple(PREDICTORS)
        if len(errors) > _MANY:
            candidates = [_LOCAL.get(name, name) for name in candidates if name not in _TOO_SLOW]
    for name in candidates:
        predictor_spec(name)
    names = [name for name in dict.fromkeys(candidates) if errors.supports(name)]
    if not names:
        raise DataError(f"none of {', '.join(candidates) or 'no candidates'} can be fitted without joints or the arm")
    return names


def _joined(results: Sequence[FoldResult], labels: Mapping[str, IntArray], names: Sequence[str]) -> CandidateResiduals:
    """Join the folds of each split."""
    n = len(next(iter(labels.values())))
    shape = (len(names), len(labels), n, 3)
    residual, std = np.full(shape, np.nan), np.full(shape, np.nan)
    candidates, splits = {name: c for c, name in enumerate(names)}, {name: s for s, name in enumerate(labels)}
    for result in results:
        if result.fit.candidate in candidates:
            at = candidates[result.fit.candidate], splits[result.fit.split], result.rows
            residual[at], std[at] = result.residual, result.std
    return CandidateResiduals(tuple(names), tuple(labels), residual, std)


def _ranking(residuals: CandidateResiduals, rng: int) -> list[dict[str, Any]]:
    kept = residuals.without(residuals.gross)
    best = best_candidate(kept, rng=rng)
    mean, density = score(kept), kept.log_density.mean(axis=(1, 2))
    worse = difference_intervals(kept, best, rng=rng)
    order = sorted(range(len(mean)), key=lambda c: (c != best, mean[c]))
    return [
        {
            "predictor": kept.names[c],
            **residual_figures(kept.residual[c], kept.std[c], kept.splits, rng=rng),
            "log_density": float(density[c]),
            "worse_by_mm": float(mean[c] - mean[best]),
            "worse_by_interval_mm": worse[c].tolist(),
            "level": bool(worse[c, 0] <= 0.0),
        }
        for c in order
    ]


def _expected(
    results: Sequence[FoldResult], labels: Mapping[str, IntArray], residuals: CandidateResiduals, rng: int
) -> dict[str, Any]:
    """Return the figures of the outer loop: each fold predicted by the candidate that the other folds choose."""
    residual, std = np.empty(residuals.residual.shape[1:]), np.empty(residuals.residual.shape[1:])
    chosen: Counter[str] = Counter()
    for s, (split, label) in enumerate(labels.items()):
        for fold in np.unique(label):
            here = [one for one in results if (one.fit.split, one.fit.fold) == (split, fold) and not one.note]
            best = _inner_choice(here, rng)
            chosen[best.fit.candidate] += 1
            residual[s, best.rows], std[s, best.rows] = best.residual, best.std
    kept = ~residuals.gross
    figures = residual_figures(residual[:, kept], std[:, kept], residuals.splits, rng=rng)
    return {**figures, "chosen": dict(chosen.most_common())}


def _inner_choice(results: Sequence[FoldResult], rng: int) -> FoldResult:
    """Return the result of the candidate with the best residuals on the samples of its own fit."""
    whole = [one for one in results if all(np.isfinite(residual).all() for residual, _ in one.inner.values())]
    if not whole:  # too few samples for a second division
        return results[0]
    inner = CandidateResiduals(
        tuple(one.fit.candidate for one in whole),
        tuple(whole[0].inner),
        np.array([[residual for residual, _ in one.inner.values()] for one in whole]),
        np.array([[std for _, std in one.inner.values()] for one in whole]),
    )
    return whole[best_candidate(inner.without(inner.gross), rng=rng)]
