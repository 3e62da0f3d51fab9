"""The record of a corrected program: the outcome of each target, and the hashes of both versions.

By the hashes a program that is already corrected is recognised, and refused, because its errors would be corrected
twice.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import chain, dropwhile, takewhile
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np

from truepose._io.delimited import csv_cell
from truepose._io.files import read_bytes
from truepose._io.folders import files_within
from truepose._io.zips import is_zip, on_disk
from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.programs import history
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.joint_targets import MOST_JOINTS, JointOutcomes
from truepose.programs.core.outcomes import DONE, Outcomes
from truepose.programs.core.paths import Continuity
from truepose.programs.core.program import Program
from truepose.programs.core.target import Target
from truepose.programs.history import Entry, HashArray, KnownCorrections, from_text, recorded_positions

FORMAT: Final = "truepose corrections"
SCHEMA: Final = 1
SUFFIX: Final = ".corrections.json"
CHANGED: Final = "changed-files.csv"
"""The name of the list of the changed files of a corrected backup."""
TARGETS: Final = ' "targets": ['
DRAFT: Final = "draft"
"""The ``map_state`` of a record whose map was not released."""
_COLUMNS: Final = (
    *("file", "line", "name", "motion", "frame", "tool", "status", "turn"),
    *("x_mm", "y_mm", "z_mm", "x_after_mm", "y_after_mm", "z_after_mm"),
    *("ex_mm", "ey_mm", "ez_mm", "sx_mm", "sy_mm", "sz_mm", "bend_mm", "turn_deg", "spacing_mm"),
    "difference_mm",
)
_NONE: Final = np.empty(0, np.uint64)
_quoted = json.encoder.encode_basestring


def head_csv(outcomes: Outcomes) -> str:
    """Return the names of the columns as a line of CSV."""
    columns = [*_COLUMNS, *_angle_columns(outcomes), *_joint_columns(outcomes), "verdict", "reason", "note"]
    return ",".join(columns) + "\n"


def _angle_columns(outcomes: Outcomes) -> list[str]:
    k = outcomes.after.shape[1] - 3
    return [f"angle{i}{when}" for when in ("", "_after") for i in range(1, k + 1)]


def _joint_columns(outcomes: Outcomes) -> list[str]:
    if outcomes.joints is None:
        return []
    return [*(f"joint{i}{when}" for when in ("", "_after") for i in range(1, MOST_JOINTS + 1)), "remaining_mm"]


def json_pieces(head: dict[str, Any], lines: Iterable[list[str]]) -> Iterator[bytes]:
    """Return a head and targets as JSON with one line per target, some thousand targets at a time."""
    return json_around(head, joined(lines))


def json_around(head: dict[str, Any], targets: Iterable[bytes]) -> Iterator[bytes]:
    """Yield a head and targets, which are JSON already, as `json_pieces` does."""
    text = json.dumps(head, indent=1, ensure_ascii=False)
    yield encoded(text.removesuffix("\n}") + f",\n{TARGETS}\n")
    yield from targets
    yield b"\n ]\n}\n"


def joined(lines: Iterable[list[str]]) -> Iterator[bytes]:
    """Yield the targets of a record from their lines."""
    between = ""
    for some in lines:
        yield encoded(between + ",\n".join(some))
        between = ",\n"


def encoded(text: str) -> bytes:
    """Return a text as UTF-8; names of files may hold bytes that are no text."""
    return text.encode("utf-8", "backslashreplace")


def rows(
    outcomes: Outcomes, continuity: Continuity, *, corrected: bool = True
) -> Iterator[tuple[list[str], list[str]]]:
    """Yield some thousand targets at a time, each as a line of JSON and a line of CSV.

    `corrected`: whether the corrections are known; otherwise the targets have no numbers after the correction.
    """
    done, path = outcomes, continuity
    k = done.after.shape[1]
    for first, columns in done.program.targets.chunks():
        here = slice(first, first + len(columns))
        before = columns.values[:, :k]
        after = np.where(np.isnan(done.after[here]), before if corrected else np.nan, done.after[here])
        size = np.linalg.norm(done.std[here], axis=1)[:, None]
        differs = np.full(len(columns), np.nan)
        if done.differences:
            differs[:] = [done.differences.get(first + i, np.nan) for i in range(len(columns))]
        bends = np.column_stack([path.bend[here], path.direction[here], path.spacing[here], differs])
        base = _in_base(columns, before[:, :3], after[:, :3])
        if done.joints is not None:
            before, after = _with_joints(done.joints, here, before, after)
            base = np.where(np.isfinite(base), base, np.hstack([before[:, :3], after[:, :3]]))
        xyz = [before[:, :3], after[:, :3], done.e[here], done.std[here], bends, after[:, :3] - before[:, :3], size]
        texts = _texts(np.concatenate([*xyz, base, before[:, 3:], after[:, 3:]], axis=1))
        joints = None if done.joints is None else _texts(_joints(done.joints, here, columns), 9)
        kinds, which = columns.shared()
        templates = [_templates(kind, k - 3, len(_joint_columns(done))) for kind in kinds]
        lines, cells = [], []
        for i, kind in enumerate(which.tolist()):
            code, row = done.code[first + i], texts[i]
            name, line = columns.name(i), str(columns.line[i])
            status, turn = (str(n) if n >= 0 else "" for n in (int(columns.status[i]), int(columns.turn[i])))
            verdict, reason = DONE[code], done.why.get(first + i, kinds[kind].reason)
            note = done.notes.get(first + i, "")
            json_form, csv_form = templates[kind]
            filled = [number or "null" for number in (status, turn, *row)]
            more = "" if joints is None else _json_joints(joints[i], kinds[kind])
            lines.append(json_form % (line, _quoted(name), *filled, more, verdict, _quoted(reason), _quoted(note)))
            shown = (*row[:16], *row[26:], *(() if joints is None else joints[i]))
            cells.append(
                csv_form % (line, csv_cell(name), status, turn, *shown, verdict, csv_cell(reason), csv_cell(note))
            )
        yield lines, cells


def _in_base(columns: TargetColumns, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the positions before and after in the robot's base frame, (n, 6) [mm]; NaN where no frame is known."""
    tf, held = columns.tf_base_frame(), np.flatnonzero(columns.held)
    both = np.stack([before, after], axis=1)
    base: FloatArray = np.einsum("nij,nkj->nki", tf[:, :3, :3], both) + tf[:, None, :3, 3]
    if len(held := held[np.isfinite(both[held]).all(axis=(1, 2)) & np.isfinite(tf[held]).all(axis=(1, 2))]):
        some = columns.take(held)  # at the tool, which stands
        base[held, 0] = some.poses_base()[:, :3, 3]
        base[held, 1] = base[held, 0] + np.einsum("nji,nj->ni", some.base_to_frame(), (after - before)[held])
    return base.reshape(-1, 6)


def _with_joints(
    joints: JointOutcomes, here: slice, before: FloatArray, after: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the numbers of targets, those of joint targets with the positions of their joints, base frame."""
    known = np.isfinite(joints.p[here, 0])
    before, after = before.copy(), after.copy()
    before[known, :3] = joints.p[here][known]
    after[known, :3] = before[known, :3] + joints.change[here][known]
    return before, after


def _joints(joints: JointOutcomes, here: slice, columns: TargetColumns) -> FloatArray:
    """Return the joints of targets before and after, and the remaining distances, (n, 13)."""
    before = np.full((len(columns), MOST_JOINTS), np.nan) if columns.joints is None else columns.joints
    after = np.where(np.isnan(joints.after[here]), before, joints.after[here])
    return np.concatenate([before, after, joints.remaining[here, None]], axis=1)


def _json_joints(texts: Sequence[str], target: Target) -> str:
    """Return the joints of a joint target as parts of a JSON object; empty for other targets."""
    if (form := target.joint_form) is None:
        return ""
    before, after = (", ".join(texts[k : k + form.count]) for k in (0, MOST_JOINTS))
    remaining = texts[-1] or "null"
    return (
        f', "joints": [{before}], "joints_after": [{after}], "joint_unit": "{form.unit}", "remaining_mm": {remaining}'
    )


def _texts(numbers: FloatArray, decimals: int = 6) -> list[list[str]]:
    """Return rounded numbers; empty where there is none."""
    flat = list(map(repr, (np.round(numbers, decimals) + 0.0).ravel().tolist()))
    if not np.isfinite(numbers).all():
        flat = ["" if text == "nan" else text for text in flat]
    width = numbers.shape[1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def _templates(target: Target, angles: int, joints: int) -> tuple[str, str]:
    """Return the templates of a line of JSON and of CSV for targets that share all data but name, line and numbers."""
    file, motion, frame, tool, configuration = (
        text.replace("%", "%%")
        for text in (str(target.path), target.motion, target.frame, target.tool, target.configuration)
    )
    three, many = "[%s, %s, %s]", "[" + ", ".join(["%s"] * angles) + "]"
    oriented = f', "angles": {many}, "angles_after": {many}' if angles else ""
    json_form = (
        f'{{"file": {_quoted(file)}, "line": %s, "name": %s, "motion": {_quoted(motion)}, "frame": {_quoted(frame)}, '
        f'"tool": {_quoted(tool)}, "configuration": {_quoted(configuration)}, "status": %s, "turn": %s, '
        f'"before_mm": {three}, "after_mm": {three}, "e_mm": {three}, "std_xyz_mm": {three}, '
        f'"bend_mm": %s, "turn_deg": %s, "spacing_mm": %s, "difference_mm": %s, "correction_mm": {three}, '
        f'"std_mm": %s, "base_mm": {three}, "base_after_mm": {three}{oriented}%s, '
        f'"verdict": "%s", "reason": %s, "note": %s}}'
    )
    head = f"{csv_cell(file)},%s,%s,{csv_cell(motion)},{csv_cell(frame)},{csv_cell(tool)},%s,%s,"
    return json_form, head + ",".join(["%s"] * (16 + 2 * angles + joints + 3)) + "\n"


def check_not_corrected(program: Program, map_path: Path | None) -> list[str]:
    """Refuse a program that a record beside it or a list (`truepose.programs.history`) has as a result.

    Return warnings of the corrections that some of its targets are from.

    Raises
    ------
    RefusedError
        If a file of it is the result of a correction, or holds corrected targets.
    FileError
        If a record cannot be read.
    """
    recorded = ((known, _in_record) for known in _results(program))
    return history.check_known(program, chain(recorded, history.listed(map_path)))


def _in_record(entry: Entry) -> str:
    return f", see {entry.file}"


def records_of(program: Program) -> Iterator[tuple[Path, list[tuple[str, str]]]]:
    """Yield the records beside the files of a program and above them, each with the hashes of its files.

    The record of a project lies in its folder, above those of its modules. Those of a corrected backup that was written
    as a whole lie beside it, in the folder with the list of its changed files.
    """
    for folder in _folders(program):
        whole = (folder / CHANGED).is_file()
        for path in sorted(folder.rglob(f"*{SUFFIX}") if whole else folder.glob(f"*{SUFFIX}")):
            yield path, hashes_of(path)
    for path in _in_zip(program):
        if path.name.endswith(SUFFIX):
            yield path, hashes_of(path)


def _folders(program: Program) -> list[Path]:
    """Return the folders of the files of a program, and those above them."""
    beside = dict.fromkeys([program.folder, *(source.path.parent for source in program.sources)])
    above = dict.fromkeys(parent for folder in beside for parent in folder.resolve().parents)
    own = {folder.resolve() for folder in beside}
    return [*beside, *(parent for parent in above if parent not in own)]


_READ: Final[ContextVar[dict[tuple[Any, Path], KnownCorrections] | None]] = ContextVar("records", default=None)


@contextmanager
def records_read_once() -> Iterator[None]:
    """Within the block, read the records of a folder once for all programs in it and below it."""
    token = _READ.set({})
    try:
        yield
    finally:
        _READ.reset(token)


def _results(program: Program) -> Iterator[KnownCorrections]:
    """Yield the results of corrections by the records beside and above a program, then by the lists of backups."""
    inside = _in_zip(program)
    for folder in _folders(program):
        yield _once(_recorded_in, folder)
    yield _recorded(path for path in inside if path.name.endswith(SUFFIX))
    folder = program.folder.resolve()
    for place in (folder, *folder.parents):
        yield _once(_listed_in, place)
    yield _listed(path for path in inside if path.name == CHANGED)


def _once(read: Callable[[Path], KnownCorrections], folder: Path) -> KnownCorrections:
    known = _READ.get()
    if known is None:
        return read(folder)
    if (read, folder) not in known:
        known[read, folder] = read(folder)
    return known[read, folder]


def _recorded_in(folder: Path) -> KnownCorrections:
    return _recorded(sorted(folder.glob(f"*{SUFFIX}")))


def _listed_in(folder: Path) -> KnownCorrections:
    return _listed(path for path in [folder / CHANGED] if path.is_file())


def _recorded(records: Iterable[Path]) -> KnownCorrections:
    return KnownCorrections.of(one for path in records for one in _changed(path))


def _changed(path: Path) -> Iterator[tuple[Entry, HashArray]]:
    """Yield the files that a record's correction changed, with the hashes of their positions."""
    files = [one for one in _files_of(path) if one["sha256_before"] != one["sha256_after"]]
    older = {} if all("positions" in one for one in files) else recorded_positions(_targets_of(path))
    for one in files:
        try:
            kept = older.get(one["file"], _NONE) if older else from_text(one.get("positions", ""))
        except (ValueError, TypeError):
            raise _unreadable(path) from None
        yield Entry("", path.name, one["sha256_after"]), kept


def _targets_of(path: Path) -> Iterator[Mapping[str, Any]]:
    """Yield the targets of a record."""
    with _text(path) as lines:
        for line in dropwhile(lambda line: line.rstrip() != TARGETS, lines):
            if line.lstrip().startswith('{"file"'):
                yield json.loads(line.rstrip().removesuffix(","))


def _listed(lists: Iterable[Path]) -> KnownCorrections:
    """Return the results by the lists of changed files of corrected backups."""
    found = []
    for path in lists:
        lines = [line.split(",") for line in read_bytes(path).decode("utf-8", "replace").splitlines()]
        found += [Entry("", path.name, line[-1]) for line in lines if len(line) > 2 and line[-2] != line[-1]]
    return KnownCorrections.of((entry, _NONE) for entry in found)


def _in_zip(program: Program) -> list[Path]:
    """Return the files of the .zip that a program lies in; none if it lies in no .zip."""
    outer = on_disk(program.path)
    return files_within(outer).files if outer != program.path or is_zip(outer) else []


def _text(path: Path) -> TextIO:
    if on_disk(path) == path:
        return path.open(encoding="utf-8-sig")
    return io.TextIOWrapper(io.BytesIO(read_bytes(path)), encoding="utf-8-sig")


def hashes_of(path: Path) -> list[tuple[str, str]]:
    """Return the hashes before and after of a record's files."""
    return [(entry["sha256_before"], entry["sha256_after"]) for entry in _files_of(path)]


def _files_of(path: Path) -> list[dict[str, Any]]:
    """Return the files of a record, each with its hashes."""
    try:
        found = [{**entry, "sha256_after": entry["sha256_after"]} for entry in head_of(path)["files"]]
        return [entry for entry in found if entry["sha256_before"] is not None]
    except (KeyError, TypeError):
        raise _unreadable(path) from None


def head_of(path: Path) -> dict[str, Any]:
    """Return a record without its targets, which may be a million and are not read.

    Raises
    ------
    FileError
        If the file is no record.
    """
    try:
        with _text(path) as lines:
            head = list(takewhile(lambda line: line.rstrip() != TARGETS, lines))
            more = "]}" if next(lines, None) is not None else ""
        found = json.loads("".join(head) + (f"{TARGETS}{more}" if more else ""))
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError):
        raise _unreadable(path) from None
    if not isinstance(found, dict):
        raise _unreadable(path)
    return found


def _unreadable(path: Path) -> FileError:
    return FileError(path, "is no readable record of corrections; move it away if it is not one")
