"""The record that stands beside a corrected program: what was done to each target, and the hashes of both versions.

By the hashes a program that is corrected already is known again, and refused: errors would be corrected twice.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from truepose import files
from truepose.errors import FileError, RefusedError

if TYPE_CHECKING:
    from truepose.programs.correct import CorrectedProgram, Outcome
    from truepose.programs.targets import FloatArray, Program

FORMAT: Final = "truepose corrections"
SCHEMA: Final = 1
_SUFFIX: Final = ".corrections.json"
_COLUMNS: Final = (
    "file line name motion frame tool status turn x_mm y_mm z_mm x_after_mm y_after_mm z_after_mm "
    "ex_mm ey_mm ez_mm sx_mm sy_mm sz_mm verdict reason"
)


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
                "sha256_after": hashlib.sha256(corrected.files[source.path]).hexdigest(),
            }
            for source in corrected.program.sources
        ],
        "map_sha256": corrected.map_hash,
        "on_guard": corrected.on_guard,
        "resolution_mm": corrected.resolution,
        "summary": corrected.summary(),
        "warnings": list(corrected.warnings),
    }
    if with_targets:
        found["targets"] = [_target(outcome) for outcome in corrected.targets]
    return found


def to_json(corrected: CorrectedProgram) -> str:
    """Return the record as text, one line per target."""
    head = record(corrected, with_targets=False)
    lines = [json.dumps(head, indent=1, ensure_ascii=False)[:-2], ',\n "targets": [\n']
    lines.append(",\n".join([json.dumps(_target(outcome), ensure_ascii=False) for outcome in corrected.targets]))
    return "".join([*lines, "\n ]\n}\n"])


def to_csv(corrected: CorrectedProgram) -> str:
    """Return one line per target."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS.split())
    for outcome in corrected.targets:
        row = _target(outcome)
        numbers = [*row["before_mm"], *row["after_mm"], *row["e_mm"], *row["std_xyz_mm"]]
        head = [row[key] for key in ("file", "line", "name", "motion", "frame", "tool", "status", "turn")]
        writer.writerow([*head, *numbers, row["verdict"], row["reason"]])
    return out.getvalue()


def names(program: Program) -> list[str]:
    """Return the names of all files that a correction of this program writes to a folder."""
    stem = program.path.stem
    return [*(source.path.name for source in program.sources), f"{stem}{_SUFFIX}", f"{stem}.corrections.csv"]


def write_in_place(corrected: CorrectedProgram) -> list[Path]:
    """Write over the program; see `CorrectedProgram.write_in_place`."""
    changed = [source for source in corrected.program.sources if corrected.files[source.path] != source.data]
    for source in changed:
        if source.path.is_symlink():
            raise FileError(source.path, "is a link; name the file itself")
    for source in corrected.program.sources:
        if files.read_bytes(source.path) != source.data:
            raise FileError(source.path, "changed while it was being corrected; run again")
    backups = {source.path: source.path.with_name(source.path.name + ".original") for source in changed}
    for backup in backups.values():
        if backup.exists():
            raise FileError(backup, "is there already, and would be lost; move it away")
    for source in changed:
        files.write_atomic(backups[source.path], source.data)
    # the record first: a program that is corrected is never without it
    folder, (*_, json_name, csv_name) = corrected.program.path.parent, names(corrected.program)
    files.write_atomic(folder / json_name, to_json(corrected))
    files.write_atomic(folder / csv_name, to_csv(corrected))
    done: list[Path] = []
    try:
        for source in changed:
            files.write_atomic(source.path, corrected.files[source.path])
            done.append(source.path)
    except FileError:
        for source in changed:
            if source.path in done:
                files.write_atomic(source.path, source.data)
        raise
    return [*done, folder / json_name, folder / csv_name, *backups.values()]


def write(corrected: CorrectedProgram, out_dir: Path) -> list[Path]:
    """Write the program's files and the record; see `CorrectedProgram.write`."""
    *_, json_name, csv_name = names(corrected.program)
    contents: dict[Path, bytes | str] = {out_dir / path.name: data for path, data in corrected.files.items()}
    contents[out_dir / json_name] = to_json(corrected)
    contents[out_dir / csv_name] = to_csv(corrected)
    new: list[Path] = []
    try:
        for path in contents:
            if path.exists() and any(path.samefile(s.path) for s in corrected.program.sources):
                raise FileError(path, "is the program itself; choose another output folder")
        for path, data in contents.items():
            if not path.exists():
                new.append(path)
            files.write_atomic(path, data)
    except OSError as error:
        raise FileError(
            out_dir, f"cannot be written: {error.strerror or error}; choose another output folder"
        ) from None
    except FileError:
        for path in new:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
        raise
    return list(contents)


def check_not_corrected(program: Program) -> None:
    """Refuse a program that a record beside it names as a result.

    Raises
    ------
    RefusedError
        If a file of it is what a correction changed.
    FileError
        If a record cannot be read: nobody knows then.
    """
    hashes = {source.sha256: source.path for source in program.sources}
    for folder in {source.path.parent for source in program.sources}:
        for path in sorted(folder.glob(f"*{_SUFFIX}")):
            for before, after in _hashes(path):
                if before != after and after in hashes:
                    raise RefusedError(
                        f"{hashes[after]}: was corrected already, says {path.name}; do not correct it twice: "
                        "take the original"
                    )


def _hashes(path: Path) -> list[tuple[str, str]]:
    try:
        entries = json.loads(files.read_text(path))["files"]
        return [(entry["sha256_before"], entry["sha256_after"]) for entry in entries]
    except FileError:
        raise
    except (ValueError, KeyError, TypeError, RecursionError):
        raise FileError(path, "is no readable record of corrections; move it away if it is not one") from None


def _target(outcome: Outcome) -> dict[str, Any]:
    target = outcome.target
    size = math.hypot(*outcome.std.tolist())
    before, after = outcome.p_before, outcome.p_after
    return {
        "file": str(target.path),
        "line": target.line,
        "name": target.name,
        "motion": target.motion,
        "frame": target.frame,
        "tool": target.tool,
        "status": target.status,
        "turn": target.turn,
        "configuration": target.configuration,
        "before_mm": _numbers(before),
        "after_mm": _numbers(after),
        "correction_mm": _numbers(after - before),
        "e_mm": _numbers(outcome.e),
        "std_xyz_mm": _numbers(outcome.std),
        "std_mm": round(size, 6) if math.isfinite(size) else None,
        "verdict": outcome.verdict,
        "reason": outcome.reason,
    }


def _numbers(values: FloatArray) -> list[float | None]:
    return [round(value, 6) if math.isfinite(value) else None for value in values.tolist()]
