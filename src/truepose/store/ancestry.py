"""The map that an updated map was made from, found by its content.

An update keeps the errors of the samples of its parent, as they were computed after the registration of the parent, and
may append others. A new fit of the same samples has another registration, and so other errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from truepose.error_map import ErrorMap
from truepose.error_map.encoding import from_bytes
from truepose.store import schema
from truepose.store.rows import decoded
from truepose.store.store import blob_content

if TYPE_CHECKING:
    from truepose.store.store import Store


def is_updated(error_map: ErrorMap, parent: ErrorMap) -> bool:
    """Return whether a map holds all that an update of `parent` keeps.

    Of two maps that differ in the station or the tool only, each holds what the other does: the one that the store had
    first is the parent.
    """
    own, kept = error_map.registration.residuals, parent.registration.residuals
    same = error_map.predictor_name == parent.predictor_name and len(own) >= len(kept)
    return same and np.array_equal(own[: len(kept)], kept)


def parent_of(store: Store, connection: sa.Connection, cell_id: int, error_map: ErrorMap) -> dict[str, Any] | None:
    """Return the row of the map that a map was updated from, among those that the store has of the same cell.

    Of several, as in a series of updates, it is the one with most samples, and of these the newest.
    """
    cell, maps = schema.cell, schema.map
    own = sa.select(cell.c.robot_id, cell.c.key).where(cell.c.id == cell_id).subquery()
    query = (
        sa.select(maps)
        .join(cell, cell.c.id == maps.c.cell_id)
        .join(own, (cell.c.robot_id == own.c.robot_id) & (cell.c.key == own.c.key))
        .where(maps.c.predictor == error_map.predictor_name)
        .order_by(maps.c.id)
    )
    rows = [decoded(maps, dict(row)) for row in connection.execute(query).mappings()]
    rows = [row for row in rows if row["figures"].get("n", 0) <= len(error_map.samples)]
    for row in sorted(rows, key=lambda row: (row["figures"].get("n", 0), row["id"]), reverse=True):
        if is_updated(error_map, from_bytes(blob_content(store, connection, row["sha256"]), row["name"], ErrorMap)):
            return row
    return None
