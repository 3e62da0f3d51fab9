"""The distances of samples, as predictors take them, and those that a fit does not use."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.error_map.conditions import conditions_of
from truepose.error_map.registration import check_limits
from truepose.geometry import Registration, apply_transform
from truepose.predictors import Predictor
from truepose.predictors.abilities import DistanceTaking
from truepose.predictors.distances import DistanceRows
from truepose.robots import Robot
from truepose.samples import Samples
from truepose.samples.distances import located

_FAR: Final = 30.0  # mm from the nominal arm: another origin, tool or unit
_NEAR: Final = 50.0  # mm; the direction to a nearer point is not certain


def with_origins(cell: Cell, samples: Samples) -> Samples:
    """Return samples whose distances state their fixed points and standard deviations, as the cell does.

    Raises
    ------
    DataError
        If neither table nor cell states them.
    """
    return samples if samples.distances is None else replace(samples, distances=located(samples.distances, cell))


def distance_rows(cell: Cell, samples: Samples, registration: Registration) -> DistanceRows | None:
    """Return the distances of samples `with_origins` in the base frame; None without any."""
    given = samples.distances
    if given is None or given.q is None or given.p_origin is None or given.distance_std is None:
        return None
    known = conditions_of(given, cell)
    if cell.conditions.approach == "none":
        known.pop("approach", None)
    if given.load is None and cell.payload.mass_kg:
        known["payload"] = np.full(len(given), cell.payload.mass_kg)
    origin = apply_transform(registration.tf_base_tracker, given.p_origin)
    return DistanceRows(given.q, origin, given.distance, given.distance_std, known)


def check_distance_rows(robot: Robot, samples: Samples, rows: DistanceRows | None, tf_flange_tool: FloatArray) -> None:
    """Refuse distances that are far from those of the nominal arm, or from a point at the tool.

    Parameters
    ----------
    robot, samples
        The robot and the samples.
    rows : DistanceRows, optional
        Their distances.
    tf_flange_tool : (4, 4) array [mm]
        The tool.

    Raises
    ------
    DataError
        With the rows, how far they are off and what may be wrong.
    """
    if rows is None:
        return
    given = samples.distances
    assert given is not None
    check_limits(robot, given)
    nominal = np.linalg.norm(robot.forward(rows.q, tool=tf_flange_tool)[:, :3, 3] - rows.origin, axis=1)
    off = np.abs(rows.distance - nominal)
    if (near := nominal < _NEAR).any():
        raise given.error(
            f"the tool point is {nominal.min():.1f} mm from the fixed point; nearer than {_NEAR:g} mm the direction of "
            "a distance is not certain: leave these rows out",
            near,
        )
    if (far := off > _FAR).any():
        worst = int(off.argmax())
        raise given.error(
            f"distance_mm is up to {off[worst]:.1f} mm off ({rows.distance[worst]:.1f} read, {nominal[worst]:.1f} by "
            "the nominal arm); is the fixed point stated in the tracker frame, are distances in mm and to the tool "
            "point?",
            far,
        )


def unused_distances(samples: Samples, predictor: Predictor) -> list[dict[str, Any]]:
    """Return the distances that a fit does not use, by row, point and line, with the reason."""
    given = samples.distances
    if given is None:
        return []
    if not isinstance(predictor, DistanceTaking):
        reason, which = "a distance, which this predictor does not use; kinematic-kriging does", np.arange(len(given))
    elif not predictor.distances or predictor.distance_rows is None:
        reason, which = "a distance; left-out readings do not gain from the distances", np.arange(len(given))
    else:
        reason, which = "a distance that is contradicted by the others", predictor.gross_distances_
    return [{**given.identify(int(i)), "reason": reason} for i in which]
