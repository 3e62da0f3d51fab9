"""Programs that a correction made, recognised by their content, so that none is corrected a second time.

The lists of `truepose.programs.history` are on the machine that corrected; a store knows the corrections of all.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import sqlalchemy as sa

from truepose.errors import DataError
from truepose.store import schema

_MANY: Final = 500  # hashes in one query


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

    def reason(self, file: str) -> str:
        """Return why a file must not be corrected."""
        return (
            f"{file}: was corrected already: on {self.created[:10]} with the map {self.map} ({self.map_sha256[:12]}), "
            f"from {self.program}; do not correct it twice: take the original"
        )


def earlier_corrections(connection: sa.Connection, hashes: Iterable[str]) -> dict[str, Earlier]:
    """Return the first correction that made each of some files, by their hashes.

    A file that a correction left as it was does not count.
    """
    correction, program, error_map = schema.correction, schema.program, schema.map
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
        rows = (
            sa.select(
                correction.c.output_sha256, program.c.name, error_map.c.name, error_map.c.sha256, correction.c.created
            )
            .select_from(correction)
            .join(program, program.c.id == correction.c.program_id)
            .join(error_map, error_map.c.id == correction.c.map_id)
            .where(correction.c.id.in_(query))
        )
        found |= {sha: Earlier(*values) for sha, *values in connection.execute(rows)}
    return found


def is_corrected(connection: sa.Connection, map_id: int, hashes: Iterable[str]) -> bool:
    """Return whether the store has a correction of one of some files with a map, by their hashes before it."""
    correction, program = schema.correction, schema.program
    query = (
        sa.select(correction.c.id)
        .join(program, program.c.id == correction.c.program_id)
        .where(correction.c.map_id == map_id, program.c.sha256.in_(list(hashes)))
    )
    return connection.execute(query.limit(1)).first() is not None


def check_original(connection: sa.Connection, file: str, sha256: str) -> None:
    """Refuse a file that is the output of a correction.

    Raises
    ------
    DataError
        If it is; the message names the map, the date and the remedy.
    """
    if (earlier := earlier_corrections(connection, [sha256]).get(sha256)) is not None:
        raise DataError(earlier.reason(file))
