"""What a store knows of a cell: its maps with signatures, its part of the audit trail, and its accuracy over time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from truepose.store import schema
from truepose.store.access import Identity, viewing
from truepose.store.audit import head
from truepose.store.names import name_key
from truepose.store.recording import cell_name
from truepose.store.releases import signatures
from truepose.store.rows import decoded
from truepose.store.store import Store


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


def audit_of(store: Store, by: Identity, cell_file: Path, before: int | None, limit: int) -> list[dict[str, Any]]:
    """Return the entries about a cell and what belongs to it, the newest first."""
    audit, cells = schema.audit, _cells(cell_file)
    campaigns = sa.select(schema.campaign.c.id).where(schema.campaign.c.cell_id.in_(cells))
    own_maps = sa.select(schema.map.c.id).where(schema.map.c.cell_id.in_(cells))
    corrections = sa.select(schema.correction.c.id).where(schema.correction.c.map_id.in_(own_maps))
    reading_sets = sa.select(schema.reading_set.c.id).where(schema.reading_set.c.campaign_id.in_(campaigns))
    verifications = sa.select(schema.verification.c.id).where(schema.verification.c.map_id.in_(own_maps))
    signed = schema.release.c.object_id.in_(own_maps) & (schema.release.c.object == "map")
    objects = {
        "cell": cells,
        "campaign": campaigns,
        "map": own_maps,
        "correction": corrections,
        "reading_set": reading_sets,
        "verification": verifications,
        "release": sa.select(schema.release.c.id).where(signed),
    }
    wanted = sa.or_(*((audit.c.object == name) & audit.c.object_id.in_(ids) for name, ids in objects.items()))
    query = sa.select(audit).where(wanted).order_by(audit.c.sequence.desc()).limit(limit)
    if before is not None:
        query = query.where(audit.c.sequence < before)
    with viewing(store, by) as connection:
        return [{**row, "payload": json.loads(row["payload"])} for row in connection.execute(query).mappings()]


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
