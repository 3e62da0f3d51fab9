"""Which predictor is best where it has not seen samples: cross-validation over blocks of space (method.md (14))."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose.errors import TrueposeError
from truepose.predictors.folds import block_folds
from truepose.predictors.named import PREDICTORS, Arm, make_predictor

FloatArray = NDArray[np.float64]

CANDIDATES: Final = (
    "registration",
    "idw",
    "ordinary-kriging",
    "universal-kriging",
    "ordinary-kriging-joint",
    "kinematic-kriging",
)


def choose(
    coordinates: Mapping[str, FloatArray],
    e: FloatArray,
    *,
    arm: Arm | None = None,
    candidates: Sequence[str] = CANDIDATES,
    folds: int = 5,
    rng: np.random.Generator | int = 0,
    progress: Callable[[str], Any] = str,
) -> list[dict[str, Any]]:
    """Rank predictors by the mean length of their residuals on blocks left out.

    Parameters
    ----------
    coordinates : mapping
        ``cartesian``: commanded positions (n, 3) [mm]; ``joint``: joints (n, dof) [rad], where there are any.
    e : (n, 3) array [mm]
    arm : Arm, optional
        For candidates that know the arm.
    candidates : sequence of str
        Names of `PREDICTORS`; those whose space has no coordinates, or that need an arm, are passed over without.
    folds : int
    rng : Generator or int
        For the blocks.
    progress : callable
        Takes a line before each candidate.

    Returns
    -------
    list of dict
        ``predictor``, ``mean_mm``, ``p95_mm``, best first; one that failed comes last, with its error as ``note``.

    Raises
    ------
    TrueposeError
        If every candidate failed, or there are fewer samples than folds.
    """
    fold = block_folds(coordinates["cartesian"], folds, rng=rng)
    ranking: list[dict[str, Any]] = []
    failure: TrueposeError | None = None
    for name in candidates:
        x = coordinates.get(PREDICTORS[name].space)
        if x is None or (PREDICTORS[name].family.of_arm and arm is None):
            continue
        progress(f"Cross-validating {name}")
        try:
            length = np.linalg.norm(e - _left_out(name, x, e, fold, arm), axis=1)
        except TrueposeError as error:
            ranking.append({"predictor": name, "note": f"failed: {error}"})
            failure = error
            continue
        figures = {"mean_mm": float(length.mean()), "p95_mm": float(np.percentile(length, 95))}
        ranking.append({"predictor": name, **figures})
    if failure is not None and not any("mean_mm" in row for row in ranking):
        raise failure
    return sorted(ranking, key=lambda row: row.get("mean_mm", np.inf))


def _left_out(name: str, x: FloatArray, e: FloatArray, fold: NDArray[np.int64], arm: Arm | None) -> FloatArray:
    """Return each sample predicted without its fold, (n, 3) [mm]."""
    predicted = np.empty_like(e)
    for k in np.unique(fold):
        out = fold == k
        predicted[out] = make_predictor(name, arm=arm).fit(x[~out], e[~out]).predict(x[out])
    return predicted
