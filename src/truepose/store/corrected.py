"""Programs that a correction made, recognised by their content, so that none is corrected a second time.

The lists of `truepose.programs.history` are on the machine that corrected; a store knows the corrections of all. A
program is recognised by the hash of a file, and by the positions that a correction wrote, whatever its name and text.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import sqlalchemy as sa

from truepose.errors import DataError
from truepose.programs.core.program import Program
from truepose.programs.history import (
    REMEDY,
    Entry,
    HashArray,
    KnownCorrections,
    ProgramPositions,
    is_enough,
    recorded_positions,
)
from truepose.programs.record import TARGETS
from truepose.store import schema

_MANY: Final = 500  # hashes in one query
_POSITIONS: Final = 10_000  # hashes of positions in one query


@dataclass(frozen=True)
class Earlier:
    """The first correction that made a program.

    Attributes
    ----------
    program, map : str
        The names of the original program and of the map.
    map_sha256 : str
        The SHA-256 of the map.
    created : str
        The time.
    """

    program: str
    map: str
    map_sha256: str
    created: str

    def __str__(self) -> str:
        return f": on {self.created[:10]} with the map {self.map} ({self.map_sha256[:12]}), from {self.program}"

    def reason(self, file: str) -> str:
        """Return why a file must not be corrected."""
        return f"{file}: was corrected already{self}; {REMEDY}"


@dataclass(frozen=True)
class EarlierPrograms:
    """Programs that hold what a correction of a store wrote.

    Attributes
    ----------
    refused : dict of Program to str
        Those that a correction made, with the reason why they must not be corrected.
    warnings : dict of Program to str
        Those with single targets that a correction made.
    """

    refused: dict[Program, str]
    warnings: dict[Program, str]


def earlier_corrections(connection: sa.Connection, hashes: Iterable[str]) -> dict[str, Earlier]:
    """Return the first correction that made each of some files, by their hashes.

    A file that a correction left as it was does not count.
    """
    correction, program = schema.correction, schema.program
    wanted = list(dict.fromkeys(hashes))
    found: dict[str, Earlier] = {}
    for first in range(0, len(wanted), _MANY):
        query = (
            sa.select(sa.func.min(correction.c.id))
            .join(program, program.c.id == correction.c.program_id)
            .where(correction.c.output_sha256.in_(wanted[first : first + _MANY]))
            .where(program.c.sha256 != correction.c.output_sha256)
            .group_by(correction.c.output_sha256)
        )
        rows = _earlier(correction.c.output_sha256).where(correction.c.id.in_(query))
        found |= {sha: Earlier(*values) for sha, *values in connection.execute(rows)}
    return found


def earlier_programs(connection: sa.Connection, programs: Sequence[Program]) -> EarlierPrograms:
    """Return the programs that hold corrected files or positions, whatever their names."""
    found = EarlierPrograms({}, {})
    made = earlier_corrections(connection, (source.sha256 for program in programs for source in program.sources))
    positions = {program: ProgramPositions.of(program) for program in programs}
    every = np.unique(np.concatenate([np.empty(0, np.uint64), *(own.all for own in positions.values())]))
    known = _known(connection, every)
    for program, own in positions.items():
        if whole := [source for source in program.sources if source.sha256 in made]:
            found.refused[program] = made[whole[0].sha256].reason(str(whole[0].path))
        elif (match := own.find(known)) is not None:
            (earlier,) = connection.execute(_earlier().where(schema.correction.c.id == int(match.entry.after))).all()
            words = match.words(str(Earlier(*earlier)), own, known)
            (found.refused if match.same else found.warnings)[program] = words
    return found


def _earlier(*columns: sa.ColumnElement[Any]) -> sa.Select[Any]:
    """Return the query of corrections with the values of `Earlier` after some columns."""
    correction, program, error_map = schema.correction, schema.program, schema.map
    return (
        sa.select(*columns, program.c.name, error_map.c.name, error_map.c.sha256, correction.c.created)
        .select_from(correction)
        .join(program, program.c.id == correction.c.program_id)
        .join(error_map, error_map.c.id == correction.c.map_id)
    )


def _known(connection: sa.Connection, positions: HashArray) -> KnownCorrections:
    """Return the corrections that wrote any of some positions; `Entry.after` is the number of the row."""
    table, wanted = schema.position, positions.view(np.int64).tolist()
    pairs: list[tuple[int, int]] = []
    for first in range(0, len(wanted), _POSITIONS):
        query = sa.select(table.c.correction_id, table.c.hash).where(
            table.c.hash.in_(wanted[first : first + _POSITIONS])
        )
        pairs += [(row[0], row[1]) for row in connection.execute(query)]
    found: dict[int, list[int]] = {}
    for correction_id, value in sorted(pairs):
        found.setdefault(correction_id, []).append(value)
    hashes = {row_id: np.sort(np.array(values, np.int64).view(np.uint64)) for row_id, values in found.items()}
    return KnownCorrections.of((Entry("", "", str(row_id)), some) for row_id, some in hashes.items())


def add_positions(connection: sa.Connection, correction_id: int, positions: HashArray) -> None:
    """List the positions that a correction wrote, by their hashes."""
    known = sa.select(schema.position.c.hash).where(schema.position.c.correction_id == correction_id)
    have = set(connection.execute(known).scalars())
    rows = [{"hash": value, "correction_id": correction_id} for value in positions.view(np.int64).tolist()]
    if rows := [row for row in rows if row["hash"] not in have]:
        connection.execute(sa.insert(schema.position), rows)


def list_positions(connection: sa.Connection, read: Callable[[str], bytes]) -> None:
    """List the positions of all corrections from their records, which `read` returns by their hashes."""
    correction, program = schema.correction, schema.program
    query = (
        sa.select(correction.c.id, correction.c.record_sha256, correction.c.output_sha256, program.c.sha256)
        .join(program, program.c.id == correction.c.program_id)
        .where(correction.c.output_sha256 != program.c.sha256)
    )
    for row_id, record_sha256, after, before in connection.execute(query).all():
        try:
            record = json.loads(read(record_sha256))
            files = {(one["sha256_before"], one["sha256_after"]): one["file"] for one in record["files"]}
            written = recorded_positions(record["targets"])
        except (ValueError, KeyError, TypeError):  # no record of this program
            continue
        if (positions := written.get(str(files.get((before, after))))) is not None:
            add_positions(connection, row_id, positions)


def targets_of(record: bytes) -> Iterator[Mapping[str, Any]]:
    """Yield the targets of a record, which are a line each; records of other programs are read as a whole."""
    text = record.decode("utf-8-sig", "replace")
    _, mark, lines = text.partition(f"\n{TARGETS}\n")
    if not mark:
        yield from json.loads(text).get("targets", [])
        return
    for line in lines.splitlines():
        if line.lstrip().startswith("{"):
            yield json.loads(line.rstrip().removesuffix(","))


def is_corrected(connection: sa.Connection, map_id: int, hashes: Iterable[str]) -> bool:
    """Return whether the store has a correction of one of some files with a map, by their hashes before it."""
    correction, program = schema.correction, schema.program
    query = (
        sa.select(correction.c.id)
        .join(program, program.c.id == correction.c.program_id)
        .where(correction.c.map_id == map_id, program.c.sha256.in_(list(hashes)))
    )
    return connection.execute(query.limit(1)).first() is not None


def check_original(connection: sa.Connection, file: str, sha256: str, positions: HashArray) -> None:
    """Refuse a file that is the output of a correction, or holds what one wrote.

    Parameters
    ----------
    connection : Connection
        A transaction.
    file, sha256 : str
        The file and its hash.
    positions : array
        The hashes of the positions that its correction replaced.

    Raises
    ------
    DataError
        If it is; the message names the map, the date and the remedy.
    """
    if (earlier := earlier_corrections(connection, [sha256]).get(sha256)) is not None:
        raise DataError(earlier.reason(file))
    known = _known(connection, positions)
    for count, entry in zip(known.shared(positions).tolist(), known.entries, strict=True):
        if is_enough(count, len(positions)):
            (row,) = connection.execute(_earlier().where(schema.correction.c.id == int(entry.after))).all()
            raise DataError(f"{file}: holds {count} positions that were corrected{Earlier(*row)}; {REMEDY}")
