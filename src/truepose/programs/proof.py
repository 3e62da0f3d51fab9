"""The proof of a corrected program, on every run before anything is written.

Two independent readings. The first splits the old and the new bytes into words by one expression of the language and
requires that only corrected numbers differ (`truepose.programs.core.source.prove`). The second gives the new bytes to
the full reader, as if they were on the disk, and requires that every target is as intended.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Final, NoReturn

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import DataError, FileError, RefusedError
from truepose.programs.core.columns import ProgramTargets, TargetColumns
from truepose.programs.core.joint_targets import MOST_JOINTS
from truepose.programs.core.outcomes import Outcomes
from truepose.programs.core.source import Source, printable, prove, replaced
from truepose.programs.core.target import Target

_OF_ONE: Final = (
    *("name", "line", "xyz", "angles", "status", "turn", "spans", "reason", "joints", "derived", "follows"),
)
"""The attributes that targets of one kind do not share."""
_SHARED: Final = tuple([field.name for field in fields(Target) if field.name not in _OF_ONE])
_EQUAL: Final = 1e-9  # [mm; the controller's angles] two readings of the same digits
_REMEDY: Final = "nothing was written; please report this program"


def proven_hashes(outcomes: Outcomes, resolution: float) -> dict[Path, str]:
    """Prove a corrected program; return the SHA-256 of every corrected file.

    Raises
    ------
    RefusedError
        If anything but corrected numbers changed, or if the corrected program does not have the intended targets.
    """
    program = outcomes.program
    contents = {source.path: _corrected(source, outcomes, resolution) for source in program.sources}
    prove_meaning(outcomes, contents)
    return {source.path: sha256_of(source.stored([contents[source.path]])) for source in program.sources}


def sha256_of(pieces: Iterable[bytes]) -> str:
    """Return the SHA-256 of bytes that come in pieces."""
    total = hashlib.sha256()
    for piece in pieces:
        total.update(piece)
    return total.hexdigest()


def _corrected(source: Source, outcomes: Outcomes, resolution: float) -> bytes:
    """Return a corrected file, proven word by word."""
    whole = io.BytesIO()  # a list of pieces and their sum would hold a long program twice
    for start, end, piece, patches in outcomes.pieces(source, resolution):
        prove(source, start, end, piece, patches, outcomes.program.lexer)
        whole.write(piece)
    return whole.getvalue()


def prove_meaning(outcomes: Outcomes, contents: Mapping[Path, bytes]) -> None:
    """Read the corrected bytes with the full reader and compare every target with the intended one.

    Corrected targets must have the numbers of `outcomes`, which are within half a digit of the correction. All other
    targets, and all other data of a target, must be unchanged. `contents` are the corrected files by path.

    Raises
    ------
    RefusedError
        If a target differs; it is named.
    """
    program = outcomes.program
    if program.again is None:
        raise DataError(f"{program.path}: this program cannot be read again for the proof; read it with read_program")
    with replaced(contents):
        try:
            again = program.again()
        except FileError as error:
            raise RefusedError(f"the corrected program cannot be read ({error}); {_REMEDY}") from None
    same = again.circles == program.circles and again.targets.follows == program.targets.follows
    if len(again.targets) != len(program.targets) or not same:
        counts = f"{len(again.targets)} targets in place of {len(program.targets)}"
        raise RefusedError(f"{program.path}: the corrected program reads otherwise ({counts}); {_REMEDY}")
    for first, old, new in _side_by_side(program.targets, again.targets):
        _compare(outcomes, first, old, new)


def _side_by_side(old: ProgramTargets, new: ProgramTargets) -> Iterator[tuple[int, TargetColumns, TargetColumns]]:
    """Yield the same targets of two readings, some thousand at a time, with the place of the first."""
    readings = [(columns for _, columns in targets.chunks()) for targets in (old, new)]
    first, parts = 0, [next(reading, None) for reading in readings]
    while parts[0] is not None and parts[1] is not None:
        size = min(len(parts[0]), len(parts[1]))
        a, b = (part if len(part) == size else part.take(np.arange(size)) for part in parts if part is not None)
        yield first, a, b
        first += size
        parts = [
            next(reading, None) if len(part) == size else part.take(np.arange(size, len(part)))
            for part, reading in zip(parts, readings, strict=True)
            if part is not None
        ]


def _compare(outcomes: Outcomes, first: int, old: TargetColumns, new: TargetColumns) -> None:
    kinds, where = np.unique(np.column_stack([old.kind, new.kind]), axis=0, return_index=True)
    for (a, b), i in zip(kinds.tolist(), where.tolist(), strict=True):
        for name in _SHARED:
            if not np.array_equal(getattr(old.alike[a], name), getattr(new.alike[b], name)):
                _refuse(old, i, f"its {name} is {getattr(new.alike[b], name)!r}, not {getattr(old.alike[a], name)!r}")
    for name in ("line", "status", "turn"):
        for i in np.flatnonzero(getattr(old, name) != getattr(new, name))[:1].tolist():
            _refuse(old, i, f"its {name} is {getattr(new, name)[i]}, not {getattr(old, name)[i]}")
    for name in ("derived", "follows"):
        before, after_ = getattr(old, name), getattr(new, name)
        for i in sorted({*before, *after_}):
            if before.get(i) != after_.get(i):
                _refuse(old, i, f"what is {name} reads {after_.get(i)}, not {before.get(i)}")
    if old.names != new.names:
        i = next(i for i in range(len(old)) if old.names[i] != new.names[i])
        _refuse(old, i, f"it is named {new.name(i)}")
    _compare_joints(outcomes, first, old, new)
    meant, changed = old.values.copy(), np.zeros(old.values.shape, bool)
    after: FloatArray = outcomes.after[first : first + len(old)]
    changed[:, : after.shape[1]] = np.isfinite(after)
    meant[:, : after.shape[1]][np.isfinite(after)] = after[np.isfinite(after)]
    differs = ~((meant == new.values) | (np.isnan(meant) & np.isnan(new.values)))
    differs &= ~(changed & (np.abs(meant - new.values) <= _EQUAL))
    for i in np.flatnonzero(differs.any(axis=1))[:1].tolist():
        k = int(np.argmax(differs[i]))
        _refuse(old, i, f"its {k + 1}. number reads {new.values[i, k]:.9g}, {meant[i, k]:.9g} was meant")


def _compare_joints(outcomes: Outcomes, first: int, old: TargetColumns, new: TargetColumns) -> None:
    """Require that joint targets have the joints that were meant."""
    if old.joints is None and new.joints is None:
        return
    none = np.full((len(old), MOST_JOINTS), np.nan)
    before, read = (none if columns.joints is None else columns.joints for columns in (old, new))
    meant = before
    if outcomes.joints is not None:
        after = outcomes.joints.after[first : first + len(old)]
        meant = np.where(np.isfinite(after), after, meant)
    same = (meant == read) | (np.isnan(meant) & np.isnan(read))
    same |= (meant != before) & (np.abs(meant - read) <= _EQUAL)
    for i in np.flatnonzero(~same.all(axis=1))[:1].tolist():
        k = int(np.argmin(same[i]))
        _refuse(old, i, f"its {k + 1}. joint reads {read[i, k]:.9g}, {meant[i, k]:.9g} was meant")


def _refuse(columns: TargetColumns, i: int, how: str) -> NoReturn:
    target = columns.target(i)
    raise RefusedError(
        printable(f"{target.where}: {target.name}: the corrected program reads otherwise: {how}; {_REMEDY}")
    )
