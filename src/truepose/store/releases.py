"""Release and withdrawal of maps, signed with the password, and the list of what a withdrawn map has corrected.

A map is a draft until somebody else than its maker releases it. The map that is released last is the one in force of
its cell; the one before is superseded. A withdrawn map is never used again.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import sqlalchemy as sa

from truepose.errors import DataError, RefusedError
from truepose.store import schema
from truepose.store.access import Identity, changing, check, confirm, viewing
from truepose.store.names import name_key
from truepose.store.rows import decoded, recall_all

if TYPE_CHECKING:
    from truepose.store.change import Change
    from truepose.store.store import Store

MEANINGS: Final = {
    "release": "I have reviewed this map and release it for the correction of programs.",
    "withdrawal": "I withdraw this map; programs that it corrected must be reviewed.",
}
"""The meaning of each signature."""
_PART: Final = re.compile(r"[0-9a-f]{8,64}")


@dataclass(frozen=True)
class Released:
    """A released map.

    Attributes
    ----------
    map : dict
        The row of the map.
    superseded : list of dict
        The rows of the maps of the same cell that were released before.
    """

    map: dict[str, Any]
    superseded: list[dict[str, Any]]


@dataclass(frozen=True)
class Recall:
    """What a map has corrected.

    Attributes
    ----------
    map : dict
        The row of the map.
    corrections : list of dict
        The corrections with it, the newest first, each with ``program``, ``program_sha256``, ``robot``,
        ``output_sha256``, ``record_sha256``, ``draft``, ``made_by`` and ``created``.
    updated : list of (dict, list of dict)
        The maps that were updated from it, at any distance, each with its corrections.
    """

    map: dict[str, Any]
    corrections: list[dict[str, Any]]
    updated: list[tuple[dict[str, Any], list[dict[str, Any]]]]


def find_map(connection: sa.Connection, named: str) -> dict[str, Any]:
    """Return the row of a map by its SHA-256, the first 8 or more digits of it, or its name.

    Raises
    ------
    DataError
        If there is none, or several have this name or these digits.
    """
    table = schema.map
    text = named.strip()
    conditions = [table.c.name == text]
    if _PART.fullmatch(text.lower()):
        conditions.append(table.c.sha256.startswith(text.lower(), autoescape=True))
    rows = connection.execute(sa.select(table).where(sa.or_(*conditions)).order_by(table.c.id)).mappings().all()
    if not rows:
        # a name in another case or Unicode form
        key = name_key(text)
        every = connection.execute(sa.select(table).order_by(table.c.id)).mappings()
        rows = [row for row in every if name_key(row["name"]) == key]
    if not rows:
        raise DataError(f"the store has no map {named!r}; 'truepose store list maps' lists them")
    if len(rows) > 1:
        several = ", ".join(f"{row['sha256'][:12]} ({row['state']})" for row in rows)
        raise DataError(f"{len(rows)} maps of the store are named {named!r}: {several}; name one by its SHA-256")
    return decoded(table, dict(rows[0]))


def check_usable(row: dict[str, Any], *, released_only: bool = False) -> None:
    """Refuse a map that must not correct programs.

    Raises
    ------
    RefusedError
        If it is withdrawn; with `released_only`, also if it is not the released one.
    """
    name = shown(row)
    if row["state"] == "withdrawn":
        raise RefusedError(f"{name} is withdrawn; use the released map of the cell, or fit a new one")
    if released_only and row["state"] != "released":
        why = "a draft" if row["state"] == "draft" else row["state"]
        raise RefusedError(f"{name} is {why}, but only a released map may be used; see 'truepose store release'")


def shown(row: dict[str, Any]) -> str:
    """Return the name of a map for messages."""
    return f"the map {row['name']} ({row['sha256'][:12]})"


def release_map(store: Store, by: Identity, named: str, password: str, *, comment: str | None = None) -> Released:
    """Release a draft, which supersedes the released map of the same cell.

    Parameters
    ----------
    store : Store
        The store.
    by : Identity
        Who releases; not the maker of the map.
    named : str
        The map; see `find_map`.
    password : str
        The password of `by`, entered for this signature.
    comment : str, optional
        A comment to keep with the signature.

    Raises
    ------
    RefusedError
        If the password is wrong, `by` may not release or made the map, the map is no draft, or a newer map of the cell
        is released.
    DataError
        If there is no such map.
    """
    with store.reading() as connection:
        check(connection, by, "release")
        find_map(connection, named)
    confirm(store, by, password)
    with changing(store, by, "release") as change:
        row = find_map(change.connection, named)
        if row["state"] != "draft":
            raise RefusedError(f"{shown(row)} is {row['state']}; only a draft can be released")
        maker = _maker(change.connection, row)
        if maker == by.user_id:
            raise RefusedError(f"{by.name} made {shown(row)}, so somebody else must release it")
        before = _released_of(change.connection, row["cell_id"])
        if newer := [one for one in before if one["id"] > row["id"]]:
            raise RefusedError(f"{shown(newer[0])} is newer and released; withdraw it before an older map is released")
        for one in before:
            change.update(schema.map, one["id"], {"state": "superseded"}, "map.supersede")
        change.update(schema.map, row["id"], {"state": "released"}, "map.release")
        _sign(change, by, row["id"], MEANINGS["release"], comment, maker)
    return Released({**row, "state": "released"}, [{**one, "state": "superseded"} for one in before])


def withdraw_map(store: Store, by: Identity, named: str, password: str, reason: str) -> Recall:
    """Withdraw a map for good; return every program that it corrected, and those that its updates corrected.

    Raises
    ------
    RefusedError
        If the password is wrong, `by` may not release, or the map is withdrawn already.
    DataError
        If there is no such map, or no reason.
    """
    reason = " ".join(reason.split())
    if not reason:
        raise DataError("a map is withdrawn for a reason; give it with --reason")
    with store.reading() as connection:
        check(connection, by, "release")
        find_map(connection, named)
    confirm(store, by, password)
    with changing(store, by, "release") as change:
        row = find_map(change.connection, named)
        if row["state"] == "withdrawn":
            raise RefusedError(f"{shown(row)} is withdrawn already; 'truepose store recall' lists its programs")
        change.update(schema.map, row["id"], {"state": "withdrawn"}, "map.withdraw")
        _sign(change, by, row["id"], MEANINGS["withdrawal"], reason, None)
        return _recall(change.connection, {**row, "state": "withdrawn"})


def recall_map(store: Store, by: Identity, named: str) -> Recall:
    """Return every program that a map corrected, and those that the maps updated from it corrected."""
    with viewing(store, by) as connection:
        return _recall(connection, find_map(connection, named))


def signatures(connection: sa.Connection, map_id: int) -> list[dict[str, Any]]:
    """Return the signatures about a map, each with the name of its user, the oldest first."""
    table, user = schema.release, schema.user
    query = (
        sa.select(table, user.c.name.label("user"))
        .join(user, user.c.id == table.c.user_id)
        .where(table.c.object == "map", table.c.object_id == map_id)
        .order_by(table.c.id)
    )
    return [dict(row) for row in connection.execute(query).mappings()]


def _recall(connection: sa.Connection, row: dict[str, Any]) -> Recall:
    updated = [(one, recall_all(connection, one["id"])) for one in _updated(connection, row["id"])]
    return Recall(row, recall_all(connection, row["id"]), updated)


def _updated(connection: sa.Connection, map_id: int) -> list[dict[str, Any]]:
    """Return the maps that were updated from a map, directly or from each other, the oldest first."""
    table = schema.map
    chain = sa.select(table.c.id).where(table.c.parent_id == map_id).cte("chain", recursive=True)
    chain = chain.union(sa.select(table.c.id).join(chain, table.c.parent_id == chain.c.id))
    query = sa.select(table).where(table.c.id.in_(sa.select(chain.c.id))).order_by(table.c.id)
    return [decoded(table, dict(row)) for row in connection.execute(query).mappings()]


def _released_of(connection: sa.Connection, cell_id: int) -> list[dict[str, Any]]:
    """Return the released maps of a cell in any version of it."""
    cell, table = schema.cell, schema.map
    own = sa.select(cell.c.robot_id, cell.c.key).where(cell.c.id == cell_id).subquery()
    versions = sa.select(cell.c.id).join(own, (cell.c.robot_id == own.c.robot_id) & (cell.c.key == own.c.key))
    query = sa.select(table).where(table.c.cell_id.in_(versions), table.c.state == "released").order_by(table.c.id)
    return [decoded(table, dict(row)) for row in connection.execute(query).mappings()]


def _maker(connection: sa.Connection, row: dict[str, Any]) -> int | None:
    """Return the user who fitted or imported a map."""
    user = schema.user
    found: int | None = connection.execute(sa.select(user.c.id).where(user.c.key == name_key(row["made_by"]))).scalar()
    return found


def _sign(
    change: Change, by: Identity, map_id: int, meaning: str, reason: str | None, second_user_id: int | None
) -> None:
    """Keep a signature; the second user of a release is the maker of the map."""
    values = {"user_id": by.user_id, "second_user_id": second_user_id, "meaning": meaning, "reason": reason}
    change.insert(schema.release, {"object": "map", "object_id": map_id, **values}, "signature.add")
