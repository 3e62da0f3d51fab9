"""A corrected program, and the files that are written for it: the program itself and its record."""

from __future__ import annotations

import csv
import io
import json
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, Protocol

from truepose._io import files
from truepose._io.workbook import to_workbook
from truepose._io.zips import is_zip, on_disk
from truepose._version import version
from truepose.compensation import LimitsInForce, Policy
from truepose.error_map.facts import Fact
from truepose.errors import FileError, RecoveryWarning
from truepose.programs import history
from truepose.programs.core.outcomes import CorrectedShare, Outcomes
from truepose.programs.core.paths import Continuity
from truepose.programs.core.program import Program
from truepose.programs.core.source import Source, unified_diff
from truepose.programs.leftovers import remember_written
from truepose.programs.record import FORMAT, SCHEMA, SUFFIX, encoded, head_csv, joined, json_around, rows
from truepose.programs.stated_robots import state_robot, stated_robot
from truepose.programs.whole import Change, CorrectedFiles

ORIGINAL: Final = ".original"
"""The ending that the kept original of a program corrected in place gets."""
NOTES: Final = ".truepose-*.rows"
"""The pattern of the notes of corrections whose rows a store does not have yet; see `truepose.store.unrecorded`."""


class RenderedParts(NamedTuple):
    """Parts of what is written for a program, each as a function that returns its bytes piece by piece.

    Attributes
    ----------
    files : mapping of Path to callable
        The corrected files by their original paths, as they are stored.
    json_rows, csv_rows : callable
        The targets of the records.
    """

    files: Mapping[Path, Callable[[], Iterable[bytes]]]
    json_rows: Callable[[], Iterable[bytes]]
    csv_rows: Callable[[], Iterable[bytes]]


class Note(Protocol):
    """A file that is written together with corrected programs, so that a store gets their rows whatever happens."""

    def write(self, commit: files.Commit, folder: Path, records: Sequence[Path]) -> None:
        """Write it in a folder as a part of a commit; `records` are the paths of the records."""


@dataclass(frozen=True, eq=False, repr=False)
class CorrectedProgram:
    """A corrected program that is proven and not yet written.

    Attributes
    ----------
    program : Program
        The original program.
    targets : Outcomes
        The outcome of each target.
    on_guard : {"refuse", "skip", "clip"}
        The policy for targets that a limit refuses.
    resolution : float [mm]
        The step of corrections.
    map_hash : str, optional
        The SHA-256 of the map.
    hashes : dict of Path to str
        The SHA-256 of each corrected file.
    limits : LimitsInForce
        The settings of ``[correction]`` in force, with their origins.
    continuity : Continuity
        The changes of the paths through the targets.
    warnings : tuple of str
        The warnings for the user.
    map_path : Path, optional
        The file that the map was read from; corrected programs are listed beside it.
    refused : mapping of Path to str
        The files of refused modules, which are not written, with the reasons; see ``keep_going`` of `correct_program`.
    map_state : str, optional
        The state of the map in a store at the time of the correction: ``draft``, ``released`` or ``superseded``; None
        without a store.
    robot : dict of str to str
        What is known of the robot: the id of the ``map``'s, that of the ``cell``'s in which it corrects, the reason why
        the map of another one is used (``other_robot``), and the id that is ``stated`` now for a map without one.
    rendered : RenderedParts, optional
        The corrected files and the rows of the records, if a worker has written them already.
    facts : tuple of Fact
        The facts of the map; those that refuse corrections were accepted.
    """

    program: Program
    targets: Outcomes
    on_guard: Policy
    resolution: float
    map_hash: str | None
    hashes: dict[Path, str]
    limits: LimitsInForce
    continuity: Continuity
    warnings: tuple[str, ...] = ()
    map_path: Path | None = None
    refused: Mapping[Path, str] = field(default_factory=dict)
    map_state: str | None = None
    robot: Mapping[str, str] = field(default_factory=dict)
    rendered: RenderedParts | None = None
    facts: tuple[Fact, ...] = ()

    def __repr__(self) -> str:
        return f"<CorrectedProgram {self.program.path}: {self.coverage}>"

    def content(self, source: Source) -> Iterator[bytes]:
        """Yield a corrected file, piece by piece."""
        if self.rendered is not None and source.path in self.rendered.files:
            yield from self.rendered.files[source.path]()
            return
        yield from source.stored(self._text(source))

    def _text(self, source: Source) -> Iterator[bytes]:
        for _, _, piece, _ in self.targets.pieces(source, self.resolution):
            yield piece

    @property
    def files(self) -> dict[Path, bytes]:
        """The corrected files by their original paths, changed or not."""
        return {source.path: b"".join(self.content(source)) for source in self.program.sources}

    @property
    def coverage(self) -> CorrectedShare:
        """The number of motion targets, and of those that are corrected."""
        return CorrectedShare.of([self.targets])

    def summary(self) -> dict[str, Any]:
        """Return the counts of the verdicts, and the largest correction and standard deviation [mm]."""
        return {**self.targets.summary(), "motion_targets": self.coverage.targets}

    def to_dict(self) -> dict[str, Any]:
        """Return the record of this correction for JSON, as it is written beside the program.

        Positions and corrections are in each target's own frame, predicted errors and deviations in the base frame.
        """
        targets = [json.loads(line) for lines, _ in rows(self.targets, self.continuity) for line in lines]
        return {**self.head(), "targets": targets}

    def head(self) -> dict[str, Any]:
        """Return the record without the targets."""
        return {
            "format": FORMAT,
            "schema": SCHEMA,
            "written_by": f"truepose {version()}",
            "program": str(self.program.path),
            "files": [self._file(source) for source in self.program.sources],
            "map_sha256": self.map_hash,
            **({} if self.map_state is None else {"map_state": self.map_state}),
            "robot": dict(self.robot),
            "on_guard": self.on_guard,
            "limits": self.limits.to_dict(),
            "resolution_mm": self.resolution,
            "summary": self.summary(),
            "continuity": self.continuity.summary(),
            "blended": self.program.blended,
            "warnings": list(self.warnings),
            "facts": [fact.to_dict() for fact in self.facts],
            "accepted": [fact.code for fact in self.facts if fact.effect == "refuses"],
            "refused": {str(path): reason for path, reason in self.refused.items()},
        }

    def _file(self, source: Source) -> dict[str, str]:
        """Return a file of the record: its name, its hashes, and those of positions by which a copy is recognised."""
        before, after = source.sha256, self.hashes[source.path]
        found = {"file": str(source.path), "sha256_before": before, "sha256_after": after}
        if before == after:
            return found
        kept = history.written_positions(self.targets, source.path, history.RECORDED)
        return {**found, "positions": history.to_text(kept)}

    def write_records(self, json_file: BinaryIO, csv_file: BinaryIO) -> None:
        """Write both records, some thousand targets at a time; the JSON has one line per target."""
        csv_file.write(encoded(head_csv(self.targets)))
        if self.rendered is None:
            targets = self.json_rows(csv_file.write)
        else:
            csv_file.writelines(self.rendered.csv_rows())
            targets = iter(self.rendered.json_rows())
        json_file.writelines(json_around(self.head(), targets))

    def json_rows(self, take_csv: Callable[[bytes], Any]) -> Iterator[bytes]:
        """Yield the targets of the record in JSON, some thousand at a time; hand each piece in CSV to a function."""

        def lines() -> Iterator[list[str]]:
            for some, cells in rows(self.targets, self.continuity):
                take_csv(encoded("".join(cells)))
                yield some

        return joined(lines())

    def to_csv(self) -> str:
        """Return the targets as CSV, units in the names."""
        lines = [line for _, cells in rows(self.targets, self.continuity) for line in cells]
        return head_csv(self.targets) + "".join(lines)

    def diff(self) -> str:
        """Return the changes as a unified diff, decoded as latin-1."""
        return "".join(unified_diff(s.path, s.data, b"".join(self._text(s))) for s in self.program.sources)

    def write(self, out_dir: str | Path, *, force: bool = False, workbook: bool = False) -> list[Path]:
        """Write every file of the program and its record (JSON and CSV) to a folder, all or none; return their paths.

        Parameters
        ----------
        out_dir : str or Path
            The folder.
        force : bool
            Whether to overwrite the results of an earlier run. The program itself is never overwritten.
        workbook : bool
            Whether to write the record as a workbook (.xlsx), too.

        Raises
        ------
        FileError
            If a file exists already, is the program itself, or cannot be written; the folder is then unchanged.
        """
        return write([self], Path(out_dir), force=force, workbook=workbook)

    def write_in_place(self, *, force: bool = False, workbook: bool = False) -> list[Path]:
        """Write over the program; keep each changed file beside it, with ``.original`` added to its name.

        Parameters
        ----------
        force : bool
            Whether to overwrite the record of an earlier run. A kept original is never overwritten.
        workbook : bool
            Whether to write the record as a workbook (.xlsx), too.

        Raises
        ------
        FileError
            If a kept original or a record exists already, or a file cannot be written; the program is then unchanged.
        """
        return write_in_place([self], force=force, workbook=workbook)


def names(program: Program) -> list[Path]:
    """Return all files that a correction of this program may write, as seen from its folder."""
    *sources, last = (*program.names(), program.path)
    if program.path in {source.path for source in program.sources}:  # the record lies beside the program
        here = last.relative_to(program.folder).with_suffix("")
    elif program.controller is None or last == program.folder:  # the record of a project is named after its folder
        here = Path(last.resolve().with_suffix("").name if is_zip(last) else last.resolve().name)
    else:
        here = last.relative_to(program.folder)
    records = [here.with_name(f"{here.name}{ending}") for ending in (SUFFIX, ".corrections.csv")]
    return [*sources, *records]


def _records(program: Program, folder: Path, workbook: bool) -> list[Path]:
    """Return the files of a program's record in a folder: JSON, CSV and, if wanted, the workbook."""
    json_path, csv_path = (folder / name for name in names(program)[-2:])
    return [json_path, csv_path, *([csv_path.with_suffix(".xlsx")] if workbook else [])]


def _write_records(commit: files.Commit, one: CorrectedProgram, paths: Sequence[Path]) -> None:
    """Write the files of a program's record as parts of a commit."""
    json_path, csv_path, *workbooks = paths
    with commit.open(json_path) as json_file, commit.open(csv_path) as csv_file:
        one.write_records(json_file, csv_file)
    for path in workbooks:
        with commit.open(path) as file:
            file.write(to_workbook(csv.reader(io.StringIO(one.to_csv()))))


def write_in_place(
    corrected: Sequence[CorrectedProgram], *, force: bool = False, workbook: bool = False, note: Note | None = None
) -> list[Path]:
    """Write over programs, all or none; see `CorrectedProgram.write_in_place`. A note lies beside the first record."""
    for source in (source for one in corrected for source in one.program.sources):
        if on_disk(source.path) != source.path:
            raise FileError(source.path, "lies in a .zip, which is never written over; give --out, with --whole a .zip")
    changed = [s for one in corrected for s in one.program.sources if one.hashes[s.path] != s.sha256]
    for source in changed:
        if source.path.is_symlink():
            raise FileError(source.path, "is a link; name the file itself")
    for source in (s for one in corrected for s in one.program.sources):
        if files.read_bytes(source.path) != b"".join(source.stored([source.data])):
            raise FileError(source.path, "changed while it was being corrected; run again")
    backups = [_original(source.path) for source in changed]
    for backup in backups:
        if backup.exists() or backup.is_symlink():
            raise FileError(backup, "exists already and would be lost; move it away")
    records = [_records(one.program, one.program.folder, workbook) for one in corrected]
    files.check_outputs(*chain.from_iterable(records), force=force, inputs=[source.path for source in changed])
    _remember(corrected)
    # copies and records first: a program that is corrected is never without them
    json_paths = [paths[0] for paths in records]
    with files.Commit() as commit:
        if note is not None and json_paths:
            note.write(commit, json_paths[0].parent, json_paths)
        for backup, source in zip(backups, changed, strict=True):
            with commit.open(backup, like=source.path) as file:
                file.writelines(source.stored([source.data]))
        for one, paths in zip(corrected, records, strict=True):
            _write_records(commit, one, paths)
        for one in corrected:
            for source in (s for s in one.program.sources if one.hashes[s.path] != s.sha256):
                with commit.open(source.path, expected=source.sha256) as file:
                    file.writelines(one.content(source))
    if note is None:
        _tell_unrecorded({path.parent for path in json_paths})
    return [*(source.path for source in changed), *chain.from_iterable(records), *backups]


def _original(path: Path) -> Path:
    return path.with_name(path.name + ORIGINAL)


def write(
    corrected: Sequence[CorrectedProgram],
    out_dir: Path,
    *,
    force: bool = False,
    workbook: bool = False,
    whole: bool = False,
    note: Note | None = None,
) -> list[Path]:
    """Write the files of programs and their records, all or none; see `CorrectedProgram.write`.

    Of a backup only the files that change are written, and a list of them; with `whole` the whole backup instead.
    """
    kept = [[source for source in one.program.sources if _is_written(one, source, whole)] for one in corrected]
    folders = [out_dir / one.program.place for one in corrected]
    programs = [
        [folder / source.path.relative_to(one.program.folder) for source in some]
        for one, some, folder in zip(corrected, kept, folders, strict=True)
    ]
    records = [_records(one.program, folder, workbook) for one, folder in zip(corrected, folders, strict=True)]
    backups = [CorrectedFiles.of(path, folder, some, whole) for path, folder, some in _by_backup(corrected, out_dir)]
    written = [path for pair in zip(programs, records, strict=True) for path in chain(*pair)]
    written += [path for backup in backups for path in (backup.list_path, *backup.copies)]
    sources = {on_disk(source.path) for one in corrected for source in one.program.sources}
    files.check_outputs(*written, force=force, inputs=[*sources, *(p for b in backups for p in b.copies.values())])
    _remember(corrected)
    with files.Commit() as commit:
        if note is not None and corrected:
            note.write(commit, out_dir, [paths[0] for paths in records])
        for one, some, goals, record in zip(corrected, kept, programs, records, strict=True):
            for source, goal in zip(some, goals, strict=True):
                with commit.open(goal, like=on_disk(source.path)) as file:
                    file.writelines(one.content(source))
            _write_records(commit, one, record)
        for backup in backups:
            backup.write(commit)
    for backup in backups:
        backup.keep_times()
    remember_written(out_dir, written)
    if note is None:
        _tell_unrecorded([out_dir])
    return written


def _remember(corrected: Sequence[CorrectedProgram]) -> None:
    """Keep what later runs must know of programs that are about to be written, and what is stated of their map."""
    history.remember(corrected)
    stated = {(one.map_hash, one.map_path, one.robot["stated"]) for one in corrected if "stated" in one.robot}
    for map_hash, map_path, robot_id in stated:
        if map_hash is not None and stated_robot(map_hash, map_path) != robot_id:
            state_robot(map_hash, map_path, robot_id)


def _tell_unrecorded(folders: Iterable[Path]) -> None:
    """Warn of corrections in some folders that a store does not have, because a run was killed before."""
    for path in (path for folder in folders for path in folder.glob(NOTES)):
        try:
            address = json.loads(path.read_text(encoding="utf-8"))["address"]
        except (OSError, ValueError, KeyError, TypeError):
            address = "that they were for"
        what = f"corrections of an interrupted run have no row in the store {address}"
        warnings.warn(f"{path.parent}: {what}; the next run with it (--store) records them", RecoveryWarning, 3)


def _is_written(one: CorrectedProgram, source: Source, whole: bool) -> bool:
    """Return whether a file is written by itself: of a backup only one that changes, and not with the whole of it."""
    if source.path in one.refused:
        return False
    return one.program.controller is None or (not whole and one.hashes[source.path] != source.sha256)


def _by_backup(corrected: Sequence[CorrectedProgram], out_dir: Path) -> Iterator[tuple[Path, Path, dict[Path, Change]]]:
    """Yield each backup with its folder in the output, and the files of it that change."""
    changes: dict[tuple[Path, Path], dict[Path, Change]] = {}
    for one in corrected:
        if one.program.controller is None:
            continue
        here = changes.setdefault((one.program.folder, out_dir / one.program.place), {})
        for source in one.program.sources:
            if source.path not in one.refused and one.hashes[source.path] != source.sha256:
                content = partial(_whole_content, one, source)
                here[source.path] = Change(content, source.sha256, one.hashes[source.path])
    yield from ((backup, folder, some) for (backup, folder), some in changes.items())


def _whole_content(one: CorrectedProgram, source: Source) -> bytes:
    return b"".join(one.content(source))
