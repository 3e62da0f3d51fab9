"""Rows of a store: found by their columns, and listed by pages that take the same time anywhere in a long list."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import sqlalchemy as sa

from truepose.errors import DataError
from truepose.store import schema

OTHER_ROBOT: Final = "other robot"
"""The kind of acceptance of a map of another robot."""
LONGEST_PAGE: Final = 1000
"""The largest number of rows of a page."""


@dataclass(frozen=True)
class Page:
    """A part of a list.

    Attributes
    ----------
    rows : list of dict
        The rows by column.
    following : int or None
        What the next page is asked with (`after`); None if this is the last one.
    """

    rows: list[dict[str, Any]]
    following: int | None


def decoded(table: sa.Table, row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with the values of its JSON columns, and without secret columns."""
    found: dict[str, Any] = {}
    for name, value in row.items():
        info = table.columns[name].info if name in table.columns else {}
        if not info.get("secret"):
            found[name] = json.loads(value) if info.get("json") and value is not None else value
    return found


def find(connection: sa.Connection, table: sa.Table, **values: Any) -> dict[str, Any] | None:
    """Return the newest row with given values; None if there is none."""
    chosen = sa.select(table).where(*_conditions(table, values)).order_by(table.c.id.desc()).limit(1)
    row = connection.execute(chosen).mappings().first()
    return None if row is None else decoded(table, dict(row))


def get(connection: sa.Connection, table: sa.Table, **values: Any) -> dict[str, Any]:
    """Return the newest row with given values.

    Raises
    ------
    DataError
        If there is none.
    """
    if (row := find(connection, table, **values)) is None:
        named = ", ".join(f"{name} {value}" for name, value in values.items())
        raise DataError(f"the store has no {table.name} with {named}")
    return row


def page(
    connection: sa.Connection, table: sa.Table, *, after: int | None = None, limit: int = 50, **values: Any
) -> Page:
    """Return a page of the rows with given values, the newest first.

    Parameters
    ----------
    connection : Connection
        A transaction.
    table : Table
        The table.
    after : int, optional
        The end of the page before: its `Page.following`.
    limit : int
        The number of rows of the page.
    values
        Columns and their values.
    """
    query = sa.select(table).where(*_conditions(table, values))
    return listed(connection, query, table, after=after, limit=limit)


def listed(
    connection: sa.Connection, query: sa.Select[Any], table: sa.Table, *, after: int | None = None, limit: int = 50
) -> Page:
    """Return a page of a query, ordered by the ids of a table, the largest first; see `page`."""
    if not 1 <= limit <= LONGEST_PAGE:
        raise DataError(f"a page has 1 to {LONGEST_PAGE} rows, got {limit}")
    if after is not None:
        query = query.where(table.c.id < after)
    query = query.order_by(table.c.id.desc()).limit(limit + 1)
    found = [decoded(table, dict(row)) for row in connection.execute(query).mappings()]
    more = len(found) > limit
    return Page(found[:limit], found[limit - 1]["id"] if more else None)


def recall(connection: sa.Connection, map_id: int, *, after: int | None = None, limit: int = 50) -> Page:
    """Return a page of the corrections with a map, each with its program and robot."""
    query = _with_programs(schema.correction).where(schema.correction.c.map_id == map_id)
    return listed(connection, query, schema.correction, after=after, limit=limit)


def recall_all(connection: sa.Connection, map_id: int) -> list[dict[str, Any]]:
    """Return all corrections with a map, the newest first, without their options."""
    correction = schema.correction
    columns = [column for column in correction.c if column.name != "options"]
    query = _with_programs(*columns).where(correction.c.map_id == map_id).order_by(correction.c.id.desc())
    found = connection.execute(query)
    names = tuple(found.keys())
    return [dict(zip(names, row, strict=True)) for row in found]


def _with_programs(*columns: Any) -> sa.Select[Any]:
    """Return the query of corrections, each with its program, its robot, and why another robot's map was accepted."""
    correction, program, robot, accepted = schema.correction, schema.program, schema.robot, schema.acceptance
    return (
        sa.select(
            *columns,
            program.c.name.label("program"),
            program.c.sha256.label("program_sha256"),
            robot.c.id.label("robot_id"),
            robot.c.name.label("robot"),
            accepted.c.reason.label("other_robot"),
        )
        .select_from(correction)
        .outerjoin(accepted, (accepted.c.correction_id == correction.c.id) & (accepted.c.kind == OTHER_ROBOT))
        .join(program, program.c.id == correction.c.program_id)
        .join(robot, robot.c.id == program.c.robot_id)
    )


def newest_cells(connection: sa.Connection) -> Sequence[dict[str, Any]]:
    """Return the newest version of each cell with the names of its robot and site, by site, robot and name."""
    cell, robot, site = schema.cell, schema.robot, schema.site
    newest = sa.select(sa.func.max(cell.c.id)).group_by(cell.c.robot_id, cell.c.key)
    query = (
        sa.select(cell, robot.c.name.label("robot"), site.c.name.label("site"))
        .join(robot, robot.c.id == cell.c.robot_id)
        .join(site, site.c.id == robot.c.site_id)
        .where(cell.c.id.in_(newest))
        .order_by(site.c.key, robot.c.key, cell.c.key)
    )
    return [decoded(cell, dict(row)) for row in connection.execute(query).mappings()]


def reading_sets_of(connection: sa.Connection, map_id: int) -> Sequence[dict[str, Any]]:
    """Return the reading sets that a map was fitted to."""
    sets, of = schema.reading_set, schema.map_reading_set
    query = sa.select(sets).join(of, of.c.reading_set_id == sets.c.id).where(of.c.map_id == map_id).order_by(sets.c.id)
    return [decoded(sets, dict(row)) for row in connection.execute(query).mappings()]


def _conditions(table: sa.Table, values: Mapping[str, Any]) -> list[sa.ColumnElement[bool]]:
    return [table.c[name].is_(None) if value is None else table.c[name] == value for name, value in values.items()]
