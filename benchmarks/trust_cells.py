"""What becomes of the targets of one virtual cell: each corrected one better or worse, and its interval right or not.

The truth is that of the virtual cell at work, without noise, seen through the registration of the map: a station found
from the samples is part of the map, and takes up what a tool or a drift has in common for all poses.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose import ErrorMap, VirtualCell, fit_cell
from truepose.compensation import Corrections
from truepose.compensation.guards import BELOW
from truepose.errors import TrueposeError
from truepose.geometry import apply_transform, invert_transform
from truepose.predictors import PREDICTORS
from truepose.robots import nearest_branch
from truepose.simulation import PRESETS

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
KINDS = tuple(name for name in PRESETS if name not in ("ideal", "ripple"))  # ripple: in the study of conditions
SAMPLES, TARGETS = 100, 100
INSIDE_95 = 1.95996
_WORK = 10_000  # added to a cell's seed: that of the work program's design


@dataclass(frozen=True)
class Fate:
    """What became of the targets of one cell.

    Attributes
    ----------
    kind, seed, predictor
    targets, corrected, worse : int
        Targets of the program; those corrected; of these, those whose true error grew.
    below : int
        Targets that stay nominal since their correction is below its uncertainty.
    inside, components : int
        Components of the corrected targets' errors inside their 95 % intervals, and all.
    before_mm, after_mm : float
        Mean true error of the corrected targets.
    of_readings : float
        Share of the components of new readings inside their 95 % intervals, as ``validate`` states it.
    refused : str
        Why the map is not used, or could not be made; empty where it is used.
    """

    kind: str
    seed: int
    predictor: str
    targets: int = TARGETS
    corrected: int = 0
    worse: int = 0
    below: int = 0
    inside: int = 0
    components: int = 0
    before_mm: float = float("nan")
    after_mm: float = float("nan")
    of_readings: float = float("nan")
    refused: str = ""

    @classmethod
    def of(
        cls,
        kind: str,
        seed: int,
        error_map: ErrorMap,
        corrections: Corrections,
        before: FloatArray,
        after: FloatArray,
        margin: float = 0.0,
    ) -> Fate:
        """Count what became of targets whose true errors were `before` and are `after` (n, 3) [mm], in the map's base.

        Those are worse whose error grew by more than the margin [mm].
        """
        used = is_used(corrections)
        was, miss = np.linalg.norm(before, axis=1)[used], after[used]
        left, inside = np.linalg.norm(miss, axis=1), np.abs(miss) <= INSIDE_95 * corrections.std[used]
        return cls(
            kind,
            seed,
            error_map.predictor_name,
            len(before),
            int(used.sum()),
            int((left > was + margin).sum()),
            int((corrections.verdict == BELOW).sum()),
            int(inside.sum()),
            inside.size,
            float(was.mean()) if used.any() else float("nan"),
            float(left.mean()) if used.any() else float("nan"),
        )

    @property
    def coverage(self) -> float:
        """Share of the components inside their 95 % intervals; NaN where nothing was corrected."""
        return self.inside / self.components if self.components else float("nan")

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)


def is_used(corrections: Corrections) -> BoolArray:
    """Return which targets are corrected, (n,)."""
    return np.isin(corrections.verdict, ["correct", "clip"])


def fates(
    kind: str, seed: int, *, samples: int = SAMPLES, predictors: tuple[str, ...] = tuple(PREDICTORS)
) -> list[Fate]:
    """Measure one cell, fit every predictor, correct a work program inside the region, and look at the truth."""
    cell = VirtualCell(kind, seed=seed)
    measured = cell.measure(cell.design(samples, seed=seed), seed=seed)
    q = cell.design(TARGETS, seed=seed + _WORK)
    found = []
    for name in predictors:
        try:
            error_map = fit_cell(cell.cell, measured, name)
            readings = error_map.validate(cell.measure(q, seed=seed + _WORK))["coverage"]["within_95"]
            found.append(replace(_fate(kind, cell, error_map, q), of_readings=readings))
        except TrueposeError as error:
            found.append(Fate(kind, seed, name, refused=str(error)))
    return found


def true_errors(cell: VirtualCell, error_map: ErrorMap, q: FloatArray, p_target: FloatArray) -> FloatArray:
    """Return by how much the tool misses targets (n, 3) [mm] at work, in the base frame of the map: (n, 3) [mm]."""
    p_tracker = apply_transform(invert_transform(cell.truth.tf_base_tracker), cell.at_work(q))
    return error_map.registration.apply(p_tracker) - p_target


def _fate(kind: str, cell: VirtualCell, error_map: ErrorMap, q: FloatArray) -> Fate:
    targets = cell.robot.forward(q, tool=error_map.tf_flange_tool)
    corrections = error_map.correct(targets, on_guard="skip")
    commands = targets.copy()
    commands[:, :3, 3] = corrections.p_command
    q_command = nearest_branch(cell.robot.inverse(commands, tool=error_map.tf_flange_tool), q)
    used = is_used(corrections)
    p_target = targets[:, :3, 3]
    before = true_errors(cell, error_map, q, p_target)
    after = true_errors(cell, error_map, np.where(used[:, None], q_command, q), p_target)
    return Fate.of(kind, cell.seed, error_map, corrections, before, after)
