"""The record that stands beside a corrected program: what was done to each target, and the hashes of both versions.

By the hashes a program that is corrected already is known again, and refused: errors would be corrected twice.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from itertools import chain, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import numpy as np

from truepose._io import files
from truepose._io.delimited import escaped
from truepose._typing import FloatArray
from truepose.errors import FileError, RefusedError
from truepose.programs import history
from truepose.programs.core.outcomes import DONE
from truepose.programs.core.target import Target

if TYPE_CHECKING:
    from truepose.programs.core.targets import Program
    from truepose.programs.correct import CorrectedProgram

FORMAT: Final = "truepose corrections"
SCHEMA: Final = 1
_SUFFIX: Final = ".corrections.json"
_TARGETS: Final = ' "targets": ['
_COLUMNS: Final = (
    *("file", "line", "name", "motion", "frame", "tool", "status", "turn"),
    *("x_mm", "y_mm", "z_mm", "x_after_mm", "y_after_mm", "z_after_mm"),
    *("ex_mm", "ey_mm", "ez_mm", "sx_mm", "sy_mm", "sz_mm", "bend_mm", "turn_deg", "spacing_mm"),
)
_quoted = json.encoder.encode_basestring


def record(corrected: CorrectedProgram, *, with_targets: bool = True) -> dict[str, Any]:
    """Return the record of a correction, for JSON: None stands where there is no number.

    Positions and corrections are in each target's own frame, predicted errors and deviations in the base frame.
    """
    found = {
        "format": FORMAT,
        "schema": SCHEMA,
        "program": str(corrected.program.path),
        "files": [
            {
                "file": str(source.path),
                "sha256_before": source.sha256,
                "sha256_after": corrected.hashes[source.path],
            }
            for source in corrected.program.sources
        ],
        "map_sha256": corrected.map_hash,
        "on_guard": corrected.on_guard,
        "limits": corrected.limits.to_dict(),
        "resolution_mm": corrected.resolution,
        "summary": corrected.summary(),
        "continuity": corrected.continuity.summary(),
        "warnings": list(corrected.warnings),
    }
    if with_targets:
        found["targets"] = [json.loads(line) for lines, _ in _rows(corrected) for line in lines]
    return found


def to_csv(corrected: CorrectedProgram) -> str:
    """Return one line per target."""
    return _head_csv(corrected) + "".join([line for _, lines in _rows(corrected) for line in lines])


def _write_records(corrected: CorrectedProgram, json_file: BinaryIO, csv_file: BinaryIO) -> None:
    """Write both records, some thousand targets at a time; the JSON has one line per target."""
    head = json.dumps(record(corrected, with_targets=False), indent=1, ensure_ascii=False)
    json_file.write(_encoded(head.removesuffix("\n}") + f",\n{_TARGETS}\n"))
    csv_file.write(_encoded(_head_csv(corrected)))
    between = ""
    for lines, rows in _rows(corrected):
        json_file.write(_encoded(between + ",\n".join(lines)))
        csv_file.write(_encoded("".join(rows)))
        between = ",\n"
    json_file.write(b"\n ]\n}\n")


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "backslashreplace")  # names of files may hold bytes that are no text


def _head_csv(corrected: CorrectedProgram) -> str:
    return ",".join([*_COLUMNS, *_angle_columns(corrected), "verdict", "reason"]) + "\n"


def _angle_columns(corrected: CorrectedProgram) -> list[str]:
    k = corrected.targets.after.shape[1] - 3
    return [f"angle{i}{when}" for when in ("", "_after") for i in range(1, k + 1)]


def _rows(corrected: CorrectedProgram) -> Iterator[tuple[list[str], list[str]]]:
    """Yield some thousand targets at a time, each as a line of JSON and a line of CSV."""
    done, path = corrected.targets, corrected.continuity
    k = done.after.shape[1]
    for first, columns in corrected.program.targets.chunks():
        here = slice(first, first + len(columns))
        before = columns.values[:, :k]
        after = np.where(np.isnan(done.after[here]), before, done.after[here])
        size = np.linalg.norm(done.std[here], axis=1)[:, None]
        bends = np.column_stack([path.bend[here], path.direction[here], path.spacing[here]])
        xyz = [before[:, :3], after[:, :3], done.e[here], done.std[here], bends, after[:, :3] - before[:, :3], size]
        texts = _texts(np.concatenate([*xyz, before[:, 3:], after[:, 3:]], axis=1))
        kinds, which = columns.shared()
        templates = [_templates(kind, k - 3) for kind in kinds]
        lines, rows = [], []
        for i, kind in enumerate(which.tolist()):
            code, row = done.code[first + i], texts[i]
            name, line = columns.name(i), str(columns.line[i])
            status, turn = (str(n) if n >= 0 else "" for n in (int(columns.status[i]), int(columns.turn[i])))
            verdict, reason = DONE[code], done.why.get(first + i, kinds[kind].reason)
            json_form, csv_form = templates[kind]
            filled = [number or "null" for number in (status, turn, *row)]
            lines.append(json_form % (line, _quoted(name), *filled, verdict, _quoted(reason)))
            shown = (*row[:15], *row[19:])
            rows.append(csv_form % (line, _cell(name), status, turn, *shown, verdict, _cell(reason)))
        yield lines, rows


def _texts(numbers: FloatArray) -> list[list[str]]:
    """Return numbers to six decimals; empty where there is none."""
    flat = list(map(repr, (np.round(numbers, 6) + 0.0).ravel().tolist()))
    if not np.isfinite(numbers).all():
        flat = ["" if text == "nan" else text for text in flat]
    width = numbers.shape[1]
    return [flat[i : i + width] for i in range(0, len(flat), width)]


def _templates(target: Target, angles: int) -> tuple[str, str]:
    """Return the forms of a line of JSON and of CSV for targets that share all but name, line and numbers."""
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
        f'"bend_mm": %s, "turn_deg": %s, "spacing_mm": %s, "correction_mm": {three}, '
        f'"std_mm": %s{oriented}, "verdict": "%s", "reason": %s}}'
    )
    head = f"{_cell(file)},%s,%s,{_cell(motion)},{_cell(frame)},{_cell(tool)},%s,%s,"
    return json_form, head + ",".join(["%s"] * (15 + 2 * angles + 2)) + "\n"


def _cell(text: str) -> str:
    """Return a cell of CSV, in quotes where it needs them; no spreadsheet takes it for a formula."""
    text = escaped(text)
    if any(mark in text for mark in ',"\r\n'):
        return '"' + text.replace('"', '""') + '"'
    return text


def names(program: Program) -> list[Path]:
    """Return all files that a correction of this program writes, as seen from the output folder."""
    *sources, last = (*program.names(), program.path)
    # the record of a project is named after its folder, that of a program lies beside it
    here = Path(last.resolve().name) if last.is_dir() else last.relative_to(program.folder).with_suffix("")
    records = [here.with_name(f"{here.name}{ending}") for ending in (_SUFFIX, ".corrections.csv")]
    return [*sources, *records]


def write_in_place(corrected: Sequence[CorrectedProgram], *, force: bool = False) -> list[Path]:
    """Write over programs, all or none; see `CorrectedProgram.write_in_place`."""
    changed = [s for one in corrected for s in one.program.sources if one.hashes[s.path] != s.sha256]
    for source in changed:
        if source.path.is_symlink():
            raise FileError(source.path, "is a link; name the file itself")
    for source in (s for one in corrected for s in one.program.sources):
        if files.read_bytes(source.path) != source.data:
            raise FileError(source.path, "changed while it was being corrected; run again")
    backups = [_original(source.path) for source in changed]
    for backup in backups:
        if backup.exists() or backup.is_symlink():
            raise FileError(backup, "is there already, and would be lost; move it away")
    records = [[one.program.folder / name for name in names(one.program)[-2:]] for one in corrected]
    files.check_outputs(*chain.from_iterable(records), force=force, inputs=[source.path for source in changed])
    history.remember(corrected)
    # copies and records first: a program that is corrected is never without them
    with files.Commit() as commit:
        for backup, source in zip(backups, changed, strict=True):
            with commit.open(backup, like=source.path) as file:
                file.write(source.data)
        for one, (json_path, csv_path) in zip(corrected, records, strict=True):
            with commit.open(json_path) as json_file, commit.open(csv_path) as csv_file:
                _write_records(one, json_file, csv_file)
        for one in corrected:
            for source in (s for s in one.program.sources if one.hashes[s.path] != s.sha256):
                with commit.open(source.path, expected=source.sha256) as file:
                    file.writelines(one.content(source))
    return [*(source.path for source in changed), *chain.from_iterable(records), *backups]


def _original(path: Path) -> Path:
    return path.with_name(path.name + ".original")


def write(corrected: Sequence[CorrectedProgram], out_dir: Path, *, force: bool = False) -> list[Path]:
    """Write the files of programs and their records, all or none; see `CorrectedProgram.write`."""
    paths = [[out_dir / name for name in names(one.program)] for one in corrected]
    sources = [source.path for one in corrected for source in one.program.sources]
    files.check_outputs(*chain.from_iterable(paths), force=force, inputs=sources)
    history.remember(corrected)
    with files.Commit() as commit:
        for one, goals in zip(corrected, paths, strict=True):
            *programs, json_path, csv_path = goals
            for source, goal in zip(one.program.sources, programs, strict=True):
                with commit.open(goal, like=source.path) as file:
                    file.writelines(one.content(source))
            with commit.open(json_path) as json_file, commit.open(csv_path) as csv_file:
                _write_records(one, json_file, csv_file)
    return list(chain.from_iterable(paths))


def check_not_corrected(program: Program, map_path: Path | None) -> None:
    """Refuse a program that a record beside it names as a result, or that a store knows (`truepose.programs.history`).

    Raises
    ------
    RefusedError
        If a file of it is what a correction changed, or holds what one wrote.
    FileError
        If a record cannot be read: nobody knows then.
    """
    hashes = {source.sha256: source.path for source in program.sources}
    for folder in {program.folder, *(source.path.parent for source in program.sources)}:
        for path in sorted(folder.glob(f"*{_SUFFIX}")):
            for before, after in _hashes(path):
                if before != after and after in hashes:
                    raise RefusedError(
                        f"{hashes[after]}: was corrected already, says {path.name}; do not correct it twice: "
                        "take the original"
                    )
    history.check(program, map_path)


def _hashes(path: Path) -> list[tuple[str, str]]:
    """Return the hashes before and after of a record's files; targets, which may be a million, are not read."""
    try:
        with path.open(encoding="utf-8-sig") as lines:
            head = list(takewhile(lambda line: line.rstrip() != _TARGETS, lines))
            more = "]}" if next(lines, None) is not None else ""
        entries = json.loads("".join(head) + (f"{_TARGETS}{more}" if more else ""))["files"]
        return [(entry["sha256_before"], entry["sha256_after"]) for entry in entries]
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise FileError(path, "is no readable record of corrections; move it away if it is not one") from None
