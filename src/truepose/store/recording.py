"""From files of the command line to rows of a store: one function for each kind of object, within a change.

What is there already is found by its hash, so a file that comes twice is one row. `folder import` and the option
``--store`` of the commands use the same functions.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Final

import numpy as np
import sqlalchemy as sa

from truepose._io.archive import as_written
from truepose.cell import Cell
from truepose.error_map import ErrorMap
from truepose.error_map.figures import facts_data
from truepose.errors import DataError
from truepose.programs import ProgramVerification
from truepose.programs.history import recorded_positions
from truepose.samples import Samples
from truepose.store import records, schema
from truepose.store.change import Change
from truepose.store.corrected import add_positions, check_original, targets_of
from truepose.store.names import LONGEST, name_key
from truepose.store.robots import identify_robot, other_robot, state_robot
from truepose.store.rows import OTHER_ROBOT, find

_CORRECTED: Final = ("correct", "clip")
_CELL: Final = "cell"
_NONE: Final = np.empty(0, np.uint64)
FindBytes = Callable[[str], bytes | None]
"""A function from a SHA-256 to the content with it; None if it is not at hand."""


@dataclass(frozen=True)
class CellFile:
    """A cell file as a command got it.

    Attributes
    ----------
    name : str
        The name of the cell; see `cell_name`.
    data : bytes
        The content of the file.
    cell : Cell
        The cell.
    """

    name: str
    data: bytes
    cell: Cell

    @classmethod
    def of(cls, path: Path, cell: Cell) -> CellFile:
        """Return the cell file at a path."""
        return cls(cell_name(path), path.read_bytes(), cell)


def cell_name(path: Path) -> str:
    """Return the name of the cell in a file: that of its folder for ``cell.toml``, as in the browser, else its own.

    Examples
    --------
    >>> cell_name(Path("/plant/robot17/cell.toml")), cell_name(Path("/plant/robot18.toml"))
    ('robot17', 'robot18')
    """
    return path.stem if path.stem.lower() != _CELL else path.resolve().parent.name or _CELL


def add_cell(change: Change, file: CellFile) -> int:
    """Add a version of a cell with its robot; a version that the store has is found by its content."""
    robot_id = records.put_robot(change, file.name, model=file.cell.robot.model, serial=file.cell.robot_id or None)
    identify_robot(change, robot_id, file.cell, file.name)
    same = {"robot_id": robot_id, "key": name_key(file.name), "sha256": hashlib.sha256(file.data).hexdigest()}
    if (known := find(change.connection, schema.cell, **same)) is not None:
        return int(known["id"])
    return records.put_cell(change, file.name, file.data, robot=file.name)


def add_samples(
    change: Change,
    cell_id: int,
    path: Path,
    samples: Samples,
    *,
    source: Path | None = None,
    figures: Mapping[str, Any] | None = None,
) -> int:
    """Add a table of samples; `source` is the tracker's file, `figures` what the tests of the campaign found."""
    data = path.read_bytes()
    if (known := _reading_set(change.connection, cell_id, hashlib.sha256(data).hexdigest())) is not None:
        return known
    campaign_id = records.put_campaign(change, cell_id, path.stem, figures)
    raw = None if source is None else source.read_bytes()
    return records.put_reading_set(change, campaign_id, path.name, data, poses=len(samples), source=raw)


def add_map(
    change: Change,
    cell_id: int,
    path: Path,
    error_map: ErrorMap,
    *,
    reading_sets: tuple[int, ...] = (),
    parent_id: int | None = None,
) -> int:
    """Add a map as a draft; a file that was packed again is the map that the store has."""
    worth, facts = error_map.worth.to_dict(), facts_data(error_map)
    counts = {"n": len(error_map.samples), "left_out": len(error_map.excluded)}
    figures = {**counts, "expected": error_map.expected, "worth": worth, "facts": facts}
    name = path.name.removesuffix(".truepose")
    data, predictor = as_written(path.read_bytes(), path), error_map.predictor_name
    return records.put_map(change, records.NewMap(cell_id, name, data, predictor, figures, reading_sets, parent_id))


def map_of(connection: sa.Connection, sha256: str | None) -> dict[str, Any]:
    """Return the row of a map by its hash.

    Raises
    ------
    DataError
        If the store does not have it.
    """
    if sha256 is None or (row := find(connection, schema.map, sha256=sha256)) is None:
        raise DataError(f"its map {(sha256 or 'without a hash')[:12]} is not in the store; import the map first")
    return row


def add_corrections(change: Change, record: bytes, head: Mapping[str, Any], content: FindBytes) -> list[int]:
    """Add the corrections of a record: one for each file that it changed, or for each file if it changed none.

    Parameters
    ----------
    change : Change
        The change of the store.
    record : bytes
        The record.
    head : mapping
        The record without its targets.
    content : callable
        Where the files before and after the correction are found.

    Raises
    ------
    DataError
        If the store does not have the map, has it as of another robot and no reason is recorded, a file before or after
        the correction is not at hand, or the one before is itself the output of a correction.
    """
    row = map_of(change.connection, head["map_sha256"])
    robot_id = change.row(schema.cell, row["cell_id"])["robot_id"]
    changed = [one for one in head["files"] if one["sha256_before"] != one["sha256_after"]] or head["files"]
    robot: Mapping[str, str] = head.get("robot", {})
    reason = str(robot.get("other_robot", ""))
    if (other := other_robot(change.connection, row["id"], robot.get("cell"))) is not None and not reason:
        raise DataError(f"{other}: correct with the map of this robot, or accept it with --other-robot REASON")
    if other is None and (stated := robot.get("stated")):
        state_robot(change, robot_id, str(stated))
    targets = list(targets_of(record))
    counts = _counts(targets)
    originals, written = (recorded_positions(targets, after=after) for after in (False, True))
    options = {key: head[key] for key in ("on_guard", "limits", "resolution_mm", "map_state") if key in head}
    made = []
    for one in changed:
        if one["sha256_before"] != one["sha256_after"]:
            check_original(change.connection, one["file"], one["sha256_before"], originals.get(one["file"], _NONE))
        before, after = (_needed(content, one["file"], one[key], key) for key in ("sha256_before", "sha256_after"))
        program_id = records.put_program(change, robot_id, program_name(one["file"]), before)
        verdicts = counts.get(one["file"], Counter())
        new = records.NewCorrection(
            program_id,
            row["id"],
            options,
            output=after,
            record=record,
            targets=verdicts.total(),
            corrected=sum(verdicts[verdict] for verdict in _CORRECTED),
            refused=verdicts["refuse"],
        )
        made.append(records.put_correction(change, new))
        if reason:
            records.put_acceptance(change, made[-1], OTHER_ROBOT, reason)
        add_positions(change.connection, made[-1], written.get(one["file"], _NONE))
    return made


def add_verification(
    change: Change, found: ProgramVerification, data: bytes, *, output_sha256: str | None = None
) -> int:
    """Add the verification of a program, of its correction if the store has the program as an output."""
    row = map_of(change.connection, found.map_sha256)
    corrected = {} if output_sha256 is None else {"map_id": row["id"], "output_sha256": output_sha256}
    correction = find(change.connection, schema.correction, **corrected) if corrected else None
    figures = {
        "program": found.program,
        "decision": found.decision,
        "counts": found.counts,
        "tolerance_mm": found.tolerance_mm,
        **found.figures,
    }
    of = None if correction is None else correction["id"]
    sha = hashlib.sha256(data).hexdigest()
    if (known := find(change.connection, schema.verification, map_id=row["id"], record_sha256=sha)) is not None:
        if of is not None and known["correction_id"] is None:  # the correction came later
            change.update(schema.verification, known["id"], {"correction_id": of}, "verification.link")
        return int(known["id"])
    return records.put_verification(change, "program", figures, map_id=row["id"], correction_id=of, record=data)


def program_name(file: str) -> str:
    r"""Return the name of a program from its path in a record: the path if it is relative, else the last part.

    Examples
    --------
    >>> program_name("milling/rib01.src"), program_name(r"C:\krc\rib01.src"), program_name("../../rib01.src")
    ('milling/rib01.src', 'rib01.src', 'rib01.src')
    """
    path = PurePosixPath(file.replace("\\", "/"))
    relative = not path.is_absolute() and ":" not in file and ".." not in path.parts
    return str(path if relative else path.name)[-LONGEST:]


def _reading_set(connection: sa.Connection, cell_id: int, sha256: str) -> int | None:
    """Return the reading set with this table in any version of a cell."""
    cell, campaign, sets = schema.cell, schema.campaign, schema.reading_set
    own = sa.select(cell.c.robot_id, cell.c.key).where(cell.c.id == cell_id).subquery()
    query = (
        sa.select(sets.c.id)
        .join(campaign, campaign.c.id == sets.c.campaign_id)
        .join(cell, cell.c.id == campaign.c.cell_id)
        .join(own, (cell.c.robot_id == own.c.robot_id) & (cell.c.key == own.c.key))
        .where(sets.c.samples_sha256 == sha256)
    )
    found: int | None = connection.execute(query.limit(1)).scalar()
    return found


def _needed(content: FindBytes, file: str, sha256: str, key: str) -> bytes:
    if (data := content(sha256)) is None:
        when = "original" if key == "sha256_before" else "corrected"
        raise DataError(f"the {when} file of {file} ({sha256[:12]}) is neither beside it nor in the store")
    return data


def _counts(targets: Iterable[Mapping[str, Any]]) -> dict[str, Counter[str]]:
    """Return how many targets of each file have which verdict."""
    found: dict[str, Counter[str]] = {}
    for target in targets:
        found.setdefault(str(target.get("file", "")), Counter())[str(target.get("verdict", ""))] += 1
    return found
