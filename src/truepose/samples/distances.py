"""The checks of distances from fixed points, and where these points are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truepose.cell import Cell
from truepose.samples.table import Distances


def check_distances(distances: Distances) -> None:
    """Refuse distances without joints, of reflectors, or that are not above 0.

    Raises
    ------
    DataError
        With the rows.
    """
    if distances.given_joints is None:
        raise distances.error("distances need the joints (q1_deg …)")
    if distances.reflector is not None and (named := np.char.strip(distances.reflector) != "").any():
        raise distances.error("distances are to the tool point, not to a reflector; leave the reflector empty", named)
    if (wrong := distances.distance <= 0.0).any():
        raise distances.error("distance_mm must be above 0", wrong)
    if distances.distance_std is not None and (wrong := distances.distance_std <= 0.0).any():
        raise distances.error("distance_std_mm must be above 0", wrong)


def located(distances: Distances, cell: Cell) -> Distances:
    """Return distances with the fixed points and standard deviations that the cell states for them.

    Raises
    ------
    DataError
        If a fixed point, or a standard deviation, is stated neither in the table nor in the cell; with the rows.
    """
    known, n = cell.distances, len(distances)
    if distances.p_origin is not None and distances.distance_std is not None:
        return distances
    names = distances.origin
    if names is None:
        if len(known) != 1:
            has = f"it states {', '.join(known)}" if known else "it states none"
            raise distances.error(
                f"the fixed point of distances is not known: the cell file needs one table [distances.NAME] ({has}), "
                "or name one of several in the column origin"
            )
        names = np.full(n, next(iter(known)))
    if (strange := ~np.isin(names, list(known))).any():
        name, has = str(names[strange][0]), ", ".join(known) if known else "none"
        raise distances.error(
            f"origin {name!r} is not in the cell file (it has {has}); add [distances.{name}] with its position in the "
            "tracker frame, or correct the name",
            names == name,
        )
    points = np.array([known[str(name)].p_tracker for name in names])
    std = np.array([known[str(name)].std_mm for name in names])
    return replace(
        distances,
        origin=names,
        p_origin=points if distances.p_origin is None else distances.p_origin,
        distance_std=std if distances.distance_std is None else distances.distance_std,
    )
