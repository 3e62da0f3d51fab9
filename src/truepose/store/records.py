"""What a plant keeps: cells with versions, campaigns, reading sets, maps, programs, corrections, verifications, jobs.

Each function adds a row within a change and returns its id. What is there already is not added again: the same content
under the same name gives the id that it has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import sqlalchemy as sa

from truepose._io.plain import plain
from truepose.errors import DataError
from truepose.store import schema
from truepose.store.audit import now
from truepose.store.change import Change
from truepose.store.hashing import canonical
from truepose.store.names import clean_name, name_key
from truepose.store.rows import find

DEFAULT_SITE: Final = "main"
"""The site of robots for which none is named."""
_ENDED: Final = ("done", "failed", "cancelled")


def put_site(change: Change, name: str = DEFAULT_SITE) -> int:
    """Add a site."""
    return _once(change, schema.site, _named(name, "site"))


def put_robot(
    change: Change, name: str, *, site: str = DEFAULT_SITE, model: str | None = None, serial: str | None = None
) -> int:
    """Add a robot to a site; one with this name keeps its model and serial number."""
    named = {"site_id": put_site(change, site), **_named(name, "robot")}
    return _once(change, schema.robot, named, model=model, serial=serial)


def put_cell(change: Change, name: str, data: bytes, *, robot: str | None = None, site: str = DEFAULT_SITE) -> int:
    """Add a version of a cell unless its file is that of the newest version.

    Parameters
    ----------
    change : Change
        The change of the store.
    name : str
        The name of the cell.
    data : bytes
        The content of the cell file.
    robot : str, optional
        The name of the robot; that of the cell if not given.
    site : str
        The name of the site.
    """
    named = {"robot_id": put_robot(change, robot or name, site=site), **_named(name, "cell")}
    newest = find(change.connection, schema.cell, robot_id=named["robot_id"], key=named["key"])
    sha = change.blob(data)
    if newest is not None and newest["sha256"] == sha:
        return int(newest["id"])
    version = 1 if newest is None else newest["version"] + 1
    return change.insert(schema.cell, {**named, "version": version, "sha256": sha})


def put_campaign(change: Change, cell_id: int, name: str, figures: Mapping[str, Any] | None = None) -> int:
    """Add a campaign in a version of a cell; `figures` are what its check found."""
    named = {"cell_id": cell_id, **_named(name, "campaign")}
    return _once(change, schema.campaign, named, figures=_json(figures))


def put_reading_set(
    change: Change, campaign_id: int, name: str, samples: bytes, *, poses: int, source: bytes | None = None
) -> int:
    """Add a table of samples, and the tracker's file that it was made from."""
    same = {"campaign_id": campaign_id, "samples_sha256": change.blob(samples)}
    sha = None if source is None else change.blob(source)
    return _once(change, schema.reading_set, same, name=clean_name(name, "reading set"), poses=poses, source_sha256=sha)


@dataclass(frozen=True)
class NewMap:
    """A map to add.

    Attributes
    ----------
    cell_id : int
        The version of the cell.
    name : str
        The name.
    data : bytes
        The content of the map file.
    predictor : str
        The name of the predictor.
    figures : mapping
        The figures of validation.
    reading_sets : tuple of int
        The reading sets that it was fitted to.
    parent_id : int or None
        The map that it updates.
    """

    cell_id: int
    name: str
    data: bytes
    predictor: str
    figures: Mapping[str, Any]
    reading_sets: tuple[int, ...] = ()
    parent_id: int | None = None


def put_map(change: Change, new: NewMap) -> int:
    """Add a map as a draft; a map file that is there already keeps its row and its state."""
    sha = change.blob(new.data)
    if (known := find(change.connection, schema.map, sha256=sha)) is not None:
        return int(known["id"])
    made = change.insert(
        schema.map,
        {
            "cell_id": new.cell_id,
            "parent_id": new.parent_id,
            "name": clean_name(new.name, "map"),
            "sha256": sha,
            "predictor": new.predictor,
            "figures": _json(new.figures),
            "state": "draft",
        },
    )
    links = [{"map_id": made, "reading_set_id": one} for one in dict.fromkeys(new.reading_sets)]
    change.insert_many(schema.map_reading_set, links)
    return made


def put_program(change: Change, robot_id: int, name: str, data: bytes, language: str | None = None) -> int:
    """Add a program of a robot; each content that a name had is a row of its own."""
    named = {"robot_id": robot_id, **_named(name, "program"), "sha256": change.blob(data)}
    return _once(change, schema.program, named, language=language)


@dataclass(frozen=True)
class NewCorrection:
    """A correction to add.

    Attributes
    ----------
    program_id, map_id : int
        The program before the correction, and the map.
    options : mapping
        The options of the correction.
    output, record : bytes
        The corrected program, and its record.
    targets, corrected, refused : int
        The number of targets, and of those that were corrected and refused.
    """

    program_id: int
    map_id: int
    options: Mapping[str, Any]
    output: bytes
    record: bytes
    targets: int
    corrected: int
    refused: int


def put_correction(change: Change, new: NewCorrection) -> int:
    """Add a correction; it is a draft if the map has not been released."""
    state = change.row(schema.map, new.map_id)["state"]
    same = {"program_id": new.program_id, "map_id": new.map_id, "record_sha256": change.blob(new.record)}
    return _once(
        change,
        schema.correction,
        same,
        options=_json(new.options),
        output_sha256=change.blob(new.output),
        targets=new.targets,
        corrected=new.corrected,
        refused=new.refused,
        draft=state == "draft",
    )


def put_acceptance(change: Change, correction_id: int, kind: str, reason: str) -> int:
    """Add why something that would refuse a correction was accepted."""
    return _once(change, schema.acceptance, {"correction_id": correction_id, "kind": kind}, reason=reason)


def put_verification(
    change: Change,
    kind: str,
    figures: Mapping[str, Any],
    *,
    map_id: int | None = None,
    correction_id: int | None = None,
    reading_set_id: int | None = None,
    record: bytes | None = None,
) -> int:
    """Add the figures of a verification of a map or of a corrected program; `record` is its file."""
    if map_id is None and correction_id is None:
        raise DataError("a verification is of a map or of a correction; name one")
    of = {"map_id": map_id, "correction_id": correction_id, "reading_set_id": reading_set_id, "kind": kind}
    found = {**of, "record_sha256": None if record is None else change.blob(record), "figures": _json(figures)}
    return _once(change, schema.verification, found)


def put_job(change: Change, kind: str, options: Mapping[str, Any]) -> int:
    """Add a job that waits."""
    return change.insert(schema.job, {"kind": kind, "state": "waiting", "options": _json(options)}, "job.add")


def move_job(change: Change, job_id: int, state: str, result: Mapping[str, Any] | None = None) -> None:
    """Set the state of a job, and its result when it has ended.

    Raises
    ------
    DataError
        If it has ended already.
    """
    if (before := change.row(schema.job, job_id)["state"]) in _ENDED:
        raise DataError(f"job {job_id} is {before}; start another")
    ended = {"ended": now(), "result": _json(result)} if state in _ENDED else {}
    change.update(schema.job, job_id, {"state": state, **ended}, f"job.{state}")


def _once(change: Change, table: sa.Table, values: Mapping[str, Any], **more: Any) -> int:
    """Return the id of the row with these values, where a name counts by its key; add it with `more` if it is new."""
    columns = [name for name in values if name != "name" or "key" not in values]
    known = find(change.connection, table, **{name: values[name] for name in columns})
    return change.insert(table, {**values, **more}) if known is None else int(known["id"])


def _named(name: str, what: str) -> dict[str, Any]:
    """Return the columns of a name."""
    clean = clean_name(name, what)
    return {"name": clean, "key": name_key(clean)}


def _json(value: Mapping[str, Any] | None) -> str:
    return canonical(plain(value or {}))
