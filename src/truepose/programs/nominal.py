"""The nominal targets of a program: its own for an original, those of the record for a corrected program."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.geometry import invert_transform, make_transform
from truepose.programs import history
from truepose.programs.core import orientations
from truepose.programs.core.program import Program
from truepose.programs.core.target import Target
from truepose.programs.record import records_of


@dataclass(frozen=True, eq=False)
class NominalTargets:
    """The nominal targets of a program whose positions and frames are known; n targets.

    Attributes
    ----------
    targets : list of Target
        The targets as the program states them.
    outcomes : list of str
        The verdict of the correction on each target; ``original`` in a program that was not corrected.
    tf_base_tool : (n, 4, 4) array [mm]
        The nominal poses, base to tool.
    tf_flange_tool : (n, 4, 4) array [mm]
        The tools.
    predicted : (n, 3) array [mm], base frame
        The errors of the uncorrected program that the map predicted; NaN where it predicted none.
    record : Path or None
        The record of the correction; None for an original program.
    map_sha256 : str or None
        The hash of the map that corrected the program.
    unknown : int
        The number of motion targets without a position or with an unknown frame, which cannot be verified.
    """

    targets: list[Target]
    outcomes: list[str]
    tf_base_tool: FloatArray
    tf_flange_tool: FloatArray
    predicted: FloatArray
    record: Path | None
    map_sha256: str | None
    unknown: int

    def __len__(self) -> int:
        return len(self.targets)

    @property
    def names(self) -> list[str]:
        """The names of the targets as operators use them: that of a KRL point without the X of its data."""
        known = {target.name.casefold() for target in self.targets}
        return [
            name[1:] if krl and name[:1] in ("X", "x") and name[1:] and name[1:].casefold() not in known else name
            for name, krl in ((t.name, t.path.suffix.lower() in (".dat", ".src")) for t in self.targets)
        ]

    def positions_of(self, tf_flange_measured: FloatArray) -> FloatArray:
        """Return the nominal positions (n, 3) [mm], base frame, of a point that is fixed to the flange."""
        tf_tool_flange = invert_transform(self.tf_flange_tool)
        poses: FloatArray = self.tf_base_tool @ tf_tool_flange @ tf_flange_measured
        return poses[:, :3, 3]


def nominal_targets(program: Program, map_path: Path | None, tf_flange_measured: FloatArray) -> NominalTargets:
    """Return the nominal targets of a program.

    Parameters
    ----------
    program : Program
        The corrected program, beside the record that ``correct`` wrote, or the original program.
    map_path : Path, optional
        The file of the map; corrected programs are listed beside it.
    tf_flange_measured : (4, 4) array [mm]
        The measured tool, for targets that name none.

    Raises
    ------
    FileError
        If a file was changed after it was corrected, or a record cannot be read or does not fit the program.
    RefusedError
        If the program was corrected and its record is missing.
    """
    record = _record(program)
    if record is None:
        history.check(program, map_path, "its record NAME.corrections.json is missing: put it beside the program")
    rows = None if record is None else _rows(record, program)
    found = [
        (k, target)
        for k, target in enumerate(program.targets)
        if target.tf_base_frame is not None and target.xyz is not None and target.angles is not None
    ]
    poses = [_pose(target, None if rows is None else rows[k]) for k, target in found]
    tools = [tf_flange_measured if t.tf_flange_tool is None else t.tf_flange_tool for _, t in found]
    for i, (_, target) in enumerate(found):
        if target.stands == "tool":  # the pose is that of the tool on the part, which is to come to where it stands
            poses[i], tools[i] = tools[i], poses[i]
        elif target.stands:
            assert target.tf_base_frame is not None
            at_tool = invert_transform(target.tf_base_frame) @ poses[i]  # the part
            poses[i], tools[i] = target.tf_base_frame, tools[i] @ invert_transform(at_tool)
    nothing = [None, None, None]
    errors = [nothing if rows is None else rows[k].get("e_mm", nothing) for k, _ in found]
    return NominalTargets(
        [target for _, target in found],
        ["original" if rows is None else str(rows[k].get("verdict", "")) for k, _ in found],
        np.array(poses).reshape(-1, 4, 4),
        np.array(tools).reshape(-1, 4, 4),
        np.array(errors, np.float64).reshape(-1, 3),
        None if record is None else record[0],
        None if record is None else record[1].get("map_sha256"),
        len(program.targets) - len(found),
    )


def _record(program: Program) -> tuple[Path, dict[str, Any]] | None:
    """Return the record that names the files of the program as results, and its content; None without one."""
    own = {source.sha256: source.path for source in program.sources}
    names = {source.path.name for source in program.sources}
    for path, hashes in records_of(program):
        changed = [(before, after) for before, after in hashes if before != after]
        missing = [after for _, after in changed if after not in own]
        if not changed or any(before in own for before, _ in changed):
            continue
        content = _load(path)
        listed = {_name(entry["file"]) for entry in content["files"] if entry["sha256_after"] in missing}
        if len(missing) == len(changed) and not listed & names:
            continue
        if listed & names:
            edited = ", ".join(sorted(listed & names))
            raise FileError(path, f"{edited} was changed after the correction; verify the file that was corrected")
        return path, content
    return None


def _load(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text("utf-8-sig"))
    except OSError as error:
        raise FileError(path, f"cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict) or not isinstance(content.get("targets"), list):
        raise FileError(path, "is no readable record of corrections; correct the program again")
    return content


def _rows(record: tuple[Path, dict[str, Any]], program: Program) -> Sequence[dict[str, Any]]:
    """Return the record's targets in the order of the program's; refuse a record that does not fit."""
    path, content = record
    hashes, names = {s.sha256 for s in program.sources}, {s.path.name for s in program.sources}
    # the record of a project lists other modules, too
    files = {e["file"] for e in content["files"] if e["sha256_after"] in hashes and _name(e["file"]) in names}
    rows = [row for row in content["targets"] if isinstance(row, dict) and row.get("file") in files]
    same = len(rows) == len(program.targets)
    if same:
        same = all(
            row.get("line") == target.line and row.get("name") == target.name
            for row, target in zip(rows, program.targets, strict=True)
        )
    if not same:
        raise FileError(
            path, "does not list the targets of the program; read it with the options of the correction (--cell …)"
        )
    return rows


def _pose(target: Target, row: dict[str, Any] | None) -> FloatArray:
    """Return the nominal pose of a target (4, 4) [mm], base to tool; from the flange where the tool stands."""
    assert target.tf_base_frame is not None
    xyz, angles = target.xyz, target.angles
    if row is not None and all(value is not None for value in row["before_mm"]):
        xyz, angles = row["before_mm"], row.get("angles", angles)
    rotation = orientations.rotation(target.controller, np.array(angles, np.float64))
    pose: FloatArray = target.tf_base_frame @ make_transform(rotation, np.array(xyz, np.float64))
    return pose


def _name(path: str) -> str:
    return path.replace("\\", "/").rsplit("/", 1)[-1]
