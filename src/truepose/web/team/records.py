"""What a store knows of a cell: its maps with signatures, its part of the audit trail, and its accuracy over time."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import sqlalchemy as sa

from truepose.errors import FileError
from truepose.programs.record import DRAFT, head_of
from truepose.store import schema
from truepose.store.access import Identity, viewing
from truepose.store.audit import head
from truepose.store.names import name_key
from truepose.store.recording import cell_name
from truepose.store.releases import signatures
from truepose.store.rows import decoded
from truepose.store.store import Store

if TYPE_CHECKING:
    from truepose.web.workspace import CellFolder, Workspace

MapState = Literal["draft", "released", "superseded", "withdrawn", "unknown"]
"""The state of a map; unknown if the store does not have it."""

_OF_MAPS: Final = {
    "verification": (schema.verification, schema.verification.c.map_id),
    "release": (schema.release, schema.release.c.object_id),
}


@dataclass(frozen=True)
class AuditFilter:
    """A part of the audit trail.

    Attributes
    ----------
    text : str
        A part of time, user, action, values or hash; empty for all.
    object : str or None
        The kind of the objects; None for all.
    offset, limit : int
        The number of entries to skip, and the largest number to return.
    """

    text: str = ""
    object: str | None = None
    offset: int = 0
    limit: int = 200


def maps(store: Store, by: Identity, cell_file: Path) -> dict[str, Any]:
    """Return the maps of a cell, the newest first, and the head of the audit trail."""
    table, correction = schema.map, schema.correction
    with viewing(store, by) as connection:
        counted = sa.select(correction.c.map_id, sa.func.count().label("n")).group_by(correction.c.map_id)
        counts = {row.map_id: row.n for row in connection.execute(counted)}
        rows = _maps(connection, cell_file)
        hashes = {row["id"]: row["sha256"] for row in rows}
        parents = sa.select(table.c.id, table.c.sha256).where(table.c.id.in_([row["parent_id"] or 0 for row in rows]))
        hashes |= {row.id: row.sha256 for row in connection.execute(parents)}
        shown = [
            {
                **{name: row[name] for name in ("sha256", "name", "predictor", "state", "made_by", "created")},
                **_accuracy(row["figures"]),
                "parent": hashes.get(row["parent_id"]),
                "corrections": counts.get(row["id"], 0),
                "signatures": [_signature(one) for one in signatures(connection, row["id"])],
            }
            for row in reversed(rows)
        ]
        last = head(connection)
    return {"maps": shown, "sequence": last.sequence, "head": last.hash}


def audit_of(store: Store, by: Identity, cell_file: Path, wanted: AuditFilter) -> dict[str, Any]:
    """Return a part of the entries about a cell and what belongs to it, the newest first, and their number."""
    audit = schema.audit
    objects = _objects(cell_file)
    about = sa.or_(*((audit.c.object == name) & audit.c.object_id.in_(ids) for name, ids in objects.items()))
    if wanted.object is not None:
        about &= audit.c.object == wanted.object
    if text := wanted.text.strip():
        columns = (audit.c.time, audit.c.user, audit.c.action, audit.c.payload, audit.c.hash)
        about &= sa.or_(*(column.icontains(text, autoescape=True) for column in columns))
    query = sa.select(audit).where(about).order_by(audit.c.sequence.desc())
    with viewing(store, by) as connection:
        total = connection.execute(sa.select(sa.func.count()).select_from(audit).where(about)).scalar_one()
        found = connection.execute(query.offset(wanted.offset).limit(wanted.limit)).mappings().all()
        rows = [
            {**row, "payload": json.loads(row["payload"]), "name": _name_of(connection, dict(row))} for row in found
        ]
    return {"total": total, "rows": rows}


def _objects(cell_file: Path) -> dict[str, sa.Select[Any]]:
    """Return the ids of a cell and of what belongs to it, by the name of the table."""
    cells = _cells(cell_file)
    campaigns = sa.select(schema.campaign.c.id).where(schema.campaign.c.cell_id.in_(cells))
    own_maps = sa.select(schema.map.c.id).where(schema.map.c.cell_id.in_(cells))
    signed = schema.release.c.object_id.in_(own_maps) & (schema.release.c.object == "map")
    return {
        "cell": cells,
        "campaign": campaigns,
        "reading_set": sa.select(schema.reading_set.c.id).where(schema.reading_set.c.campaign_id.in_(campaigns)),
        "map": own_maps,
        "correction": sa.select(schema.correction.c.id).where(schema.correction.c.map_id.in_(own_maps)),
        "verification": sa.select(schema.verification.c.id).where(schema.verification.c.map_id.in_(own_maps)),
        "release": sa.select(schema.release.c.id).where(signed),
    }


def _name_of(connection: sa.Connection, entry: Mapping[str, Any]) -> str | None:
    """Return the name of the object of an entry: that of its map or program if it has none itself."""
    kind, id_ = entry["object"], entry["object_id"]
    correction, program = schema.correction, schema.program
    if kind == "correction":
        query = sa.select(program.c.name).join(correction, correction.c.program_id == program.c.id)
        query = query.where(correction.c.id == id_)
    elif kind in _OF_MAPS:
        table, of = _OF_MAPS[kind]
        query = sa.select(schema.map.c.name).join(table, of == schema.map.c.id).where(table.c.id == id_)
    else:
        table = schema.metadata.tables[kind]
        query = sa.select(table.c.name).where(table.c.id == id_)
    return connection.execute(query).scalar()


def drift(store: Store, by: Identity, cell_file: Path) -> list[dict[str, Any]]:
    """Return the figures of the maps and verifications of a cell in the order of time."""
    table = schema.verification
    found: list[dict[str, Any]] = []
    with viewing(store, by) as connection:
        rows = _maps(connection, cell_file)
        names = {row["id"]: row["name"] for row in rows}
        for row in rows:
            kind = "map" if row["parent_id"] is None else "update"
            accuracy = _accuracy(row["figures"])
            if accuracy["mean_mm"] is not None:
                found.append(
                    {"time": row["created"], "kind": kind, "name": row["name"], "of": "cross-validation", **accuracy}
                )
        query = sa.select(table).where(table.c.map_id.in_(list(names))).order_by(table.c.id)
        for one in connection.execute(query).mappings():
            row = decoded(table, dict(one))
            after = row["figures"].get("after", {})
            if (mean := after.get("mean_mm")) is not None:
                name = str(row["figures"].get("program") or names[row["map_id"]])
                numbers = {"n": after.get("n"), "mean_mm": mean, "p95_mm": after.get("p95_mm")}
                found.append(
                    {"time": row["created"], "kind": "verification", "name": name, "of": "measured", **numbers}
                )
    return sorted(found, key=lambda one: one["time"])


def states(store: Store, by: Identity, cell: CellFolder, workspace: Workspace) -> dict[str, dict[str, MapState]]:
    """Return the states of maps by their SHA-256, and those of the cell's files: of maps, and of what maps corrected.

    A correction made with a draft stays one when the map is released later.
    """
    table = schema.map
    hashes = {file.id: workspace.hash_of(file) for file in cell.files("map")}
    heads = {file.id: _map_of_record(file.path, file.modified, file.size) for file in cell.files("record")}
    wanted = {*hashes.values(), *(sha for sha, _ in heads.values() if sha)}
    with viewing(store, by) as connection:
        query = sa.select(table.c.sha256, table.c.state).where(table.c.sha256.in_(wanted))
        known: dict[str, MapState] = {row.sha256: row.state for row in connection.execute(query)}
    by_hash: dict[str, MapState] = {sha: known.get(sha, "unknown") for sha in wanted}
    files: dict[str, MapState] = {id_: by_hash[sha] for id_, sha in hashes.items()}
    for id_, (sha, then) in heads.items():
        now: MapState = by_hash.get(sha or "", "unknown")
        files[id_] = now if now == "withdrawn" else "draft" if then == DRAFT else now
    return {"maps": by_hash, "files": files}


@lru_cache(maxsize=4096)
def _map_of_record(path: Path, _modified: float, _size: int) -> tuple[str | None, str | None]:
    """Return the SHA-256 of the map of a record, and its state at that time; those of unchanged files are kept."""
    try:
        head = head_of(path)
    except FileError:
        return None, None
    return head.get("map_sha256"), head.get("map_state")


def _cells(cell_file: Path) -> sa.Select[Any]:
    """Return the ids of all versions of a cell."""
    return sa.select(schema.cell.c.id).where(schema.cell.c.key == name_key(cell_name(cell_file)))


def _maps(connection: sa.Connection, cell_file: Path) -> list[dict[str, Any]]:
    query = sa.select(schema.map).where(schema.map.c.cell_id.in_(_cells(cell_file))).order_by(schema.map.c.id)
    return [decoded(schema.map, dict(row)) for row in connection.execute(query).mappings()]


def _accuracy(figures: dict[str, Any]) -> dict[str, Any]:
    """Return the number of samples, and the error after correction that cross-validation expects."""
    expected, worth = figures.get("expected") or {}, figures.get("worth") or {}
    mean = expected.get("mean_mm", worth.get("left_mm"))
    return {"n": figures.get("n"), "mean_mm": mean, "p95_mm": expected.get("p95_mm")}


def _signature(row: dict[str, Any]) -> dict[str, Any]:
    return {"user": row["user"], "time": row["created"], "meaning": row["meaning"], "reason": row["reason"]}
