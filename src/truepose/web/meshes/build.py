"""From uploaded files to the meshes of a cell's arm, in a process of its own.

The process keeps the server free: readers of large texts and the reduction hold Python's lock for seconds, and a
damaged mesh can end no more than this process. It takes a `Task` as JSON and answers with an `Answer`.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from pydantic import BaseModel

from truepose._io.files import check_regular
from truepose._typing import FloatArray
from truepose.cell import load_cell
from truepose.errors import FileError, RobotError, TrueposeError, one_line
from truepose.geometry.transforms import apply_transform, invert_transform
from truepose.robots import Robot
from truepose.robots.io.mesh_files import read_mesh
from truepose.robots.io.triangles import Colour, IntArray, Mesh
from truepose.robots.io.visuals import VisibleArm, Visual, load_visuals
from truepose.web.meshes.index import ArmMeshes, JointDifference, MeshNote, MeshPart
from truepose.web.meshes.match import Match, bodies_at_zero, match_arm
from truepose.web.meshes.names import files_of, resolve
from truepose.web.meshes.reduction import areas, reduced, shares

BUDGET: Final = 60_000
"""Triangles of a whole arm."""
_MOST_URDF: Final = 20
_LARGEST_URDF: Final = 2**24
_MOST_BYTES: Final = 2**29  # of all meshes of an arm
_TIMES_REACH: Final = 10.0
_MEMORY: Final = 2**32


class Task(BaseModel):
    """A cell file, the uploaded files by the names that the user sees, and the file for the meshes."""

    cell: Path
    files: dict[str, Path]
    out: Path


class Answer(BaseModel):
    """The meshes, or why there are none."""

    meshes: ArmMeshes | None = None
    error: str = ""
    file: str | None = None
    line: int | None = None


@dataclass(frozen=True, eq=False)
class _Piece:
    """Triangles of one colour in the frame of their body, mm."""

    body: int
    colour: Colour | None
    points: FloatArray
    triangles: IntArray


def build(robot: Robot, uploaded: dict[str, Path], out: BinaryIO) -> ArmMeshes:
    """Write the meshes of an arm, and return what is known of them.

    Parameters
    ----------
    robot : Robot
        The arm of the cell.
    uploaded : dict of str to Path
        The files by their names: a URDF file with its meshes, or a .zip of them.
    out : file
        Takes the points of all parts (float32, mm, frame of their body), then their indices (uint32).

    Raises
    ------
    FileError
        If there is no URDF file, it cannot be read, or a .zip is refused.
    RobotError
        If the arm is not that of the cell.
    """
    files, notes = files_of(uploaded)
    name, arm, match, others = _arm(robot, files)
    notes += [MeshNote(kind="other_urdf", name=other, detail=name) for other in others]
    notes += _agreement(match)
    notes += [MeshNote(kind="apart", name=one_line(link)) for link in arm.apart]
    reader = _Reader(robot, name, files, match)
    for visual in arm.visuals:
        reader.take(visual)
    result = _packed(reader.pieces, out)
    complete = {piece.body for piece in reader.pieces} - reader.incomplete
    result.urdf, result.source_triangles = one_line(name), reader.source_triangles
    result.placeholders = [body for body in range(robot.dof + 1) if body not in complete]
    result.notes = notes + reader.notes
    result.links = robot.links(np.eye(4))[:-1].tolist()
    result.joints = [
        JointDifference(joint=k, distance_mm=float(mm), angle_deg=float(np.rad2deg(angle)))
        for k, (mm, angle) in enumerate(zip(match.distances, match.angles, strict=True), start=1)
    ]
    return result


def _arm(robot: Robot, files: dict[str, Path]) -> tuple[str, VisibleArm, Match, list[str]]:
    """Return the URDF file whose arm is that of the cell, with the names of other ones that fit no better."""
    urdf = [name for name in files if name.lower().endswith(".urdf")]
    if not urdf:
        made = any(name.lower().endswith((".xacro", ".urdf.xml")) for name in files)
        hint = "xacro files must be expanded first (xacro FILE > robot.urdf)" if made else "add it to the upload"
        raise FileError("upload", f"no .urdf file among {len(files)} files; {hint}")
    if len(urdf) > _MOST_URDF:
        raise FileError("upload", f"{len(urdf)} .urdf files; upload only that of the cell's arm, with its meshes")
    fitting, errors = [], []
    for name in urdf:
        try:
            arm = _visuals(name, files[name])
            fitting.append((name, arm, match_arm(robot, arm, name)))
        except TrueposeError as error:
            errors.append(error)
    if not fitting:
        raise errors[0]
    name, arm, match = min(fitting, key=lambda one: (round(one[2].worst, 3), -len(one[1].visuals), one[0]))
    return name, arm, match, [other for other, _, _ in fitting if other != name]


def _visuals(name: str, path: Path) -> VisibleArm:
    """Return the arm of a file; errors name it as the user does."""
    try:
        if path.is_file():
            check_regular(path, _LARGEST_URDF)
        return load_visuals(path)
    except FileError as error:
        raise FileError(name, _reason(error, path), line=error.line) from None
    except RobotError as error:
        raise RobotError(str(error).replace(str(path), name)) from None


def _reason(error: TrueposeError, path: Path) -> str:
    """Return the message of an error without the path of the server's disk in front."""
    line = getattr(error, "line", None)
    return str(error).removeprefix(f"{path}:{line}: " if line else f"{path}: ").replace(str(path), path.name)


def _agreement(match: Match) -> list[MeshNote]:
    notes = []
    if match.moved:
        x, y, z = match.tf_base_root[:3, 3]
        turn = np.rad2deg(np.arctan2(match.tf_base_root[1, 0], match.tf_base_root[0, 0]))
        notes.append(MeshNote(kind="base_moved", name="", detail=f"{x:.1f}, {y:.1f}, {z:.1f} mm, {turn:.1f}°"))
    for k in match.noted:
        detail = f"{match.distances[k]:.1f} mm, {np.rad2deg(match.angles[k]):.2f}°"
        notes.append(MeshNote(kind="differs", name=str(k + 1), detail=detail))
    return notes


class _Reader:
    """Reads the shapes of an arm one after the other; one that cannot be read leaves a note."""

    def __init__(self, robot: Robot, urdf: str, files: dict[str, Path], match: Match) -> None:
        self.pieces: list[_Piece] = []
        self.notes: list[MeshNote] = []
        self.incomplete: set[int] = set()
        self.source_triangles = 0
        self._urdf, self._files, self._match = urdf, files, match
        self._tf_body_base = invert_transform(bodies_at_zero(robot))
        lengths = np.linalg.norm(robot.links(np.eye(4))[:, :3, 3], axis=1)
        self._farthest = _TIMES_REACH * float(lengths.sum())
        self._bytes = 0

    def take(self, visual: Visual) -> None:
        """Read a shape."""
        try:
            meshes = self._meshes(visual)
        except FileError as error:
            self._note("unreadable", visual, _reason(error, error.path))
            return
        tf = self._tf_body_base[visual.body] @ self._match.tf_base_root @ visual.tf_root_shape
        placed = [(mesh, apply_transform(tf, mesh.points * visual.scale)) for mesh in meshes]
        far = max((float(np.abs(points[mesh.triangles]).max(initial=0.0)) for mesh, points in placed), default=0.0)
        if far > self._farthest:
            self._note("too_large", visual, f"{far / 1e3:,.0f} m")
            return
        for mesh, points in placed:
            self.source_triangles += len(mesh.triangles)
            # what is read is reduced at once, so that memory does not grow with the number of files
            fewer, triangles = reduced(points, mesh.triangles, BUDGET)
            if len(triangles):
                self.pieces.append(_Piece(visual.body, visual.colour or mesh.colour, fewer, triangles))

    def _meshes(self, visual: Visual) -> list[Mesh]:
        if visual.solid is not None:
            return [visual.solid]
        found = resolve(visual.file, self._urdf, self._files)
        if len(found) != 1:
            self._note("ambiguous" if found else "missing", visual, ", ".join(found[:3]))
            return []
        path = self._files[found[0]]
        if path.is_file():  # a member of a .zip is checked when it is read
            self._bytes += path.stat().st_size
        if self._bytes > _MOST_BYTES:
            self._note("too_many", visual, f"{_MOST_BYTES >> 20} MB")
            return []
        return read_mesh(path)

    def _note(self, kind: str, visual: Visual, detail: str) -> None:
        self.incomplete.add(visual.body)
        name = visual.file or visual.link
        self.notes.append(MeshNote.model_validate({"kind": kind, "name": one_line(name), "detail": one_line(detail)}))


def _packed(pieces: list[_Piece], out: BinaryIO) -> ArmMeshes:
    """Reduce pieces to the budget, one for each body and colour, and write them."""
    joined = _joined(pieces)
    most = shares(BUDGET, [len(one.triangles) for one in joined], [areas(one.points, one.triangles) for one in joined])
    fewer = [reduced(one.points, one.triangles, count) for one, count in zip(joined, most, strict=True)]
    parts, point, index = [], 0, 0
    for one, (points, triangles) in zip(joined, fewer, strict=True):
        if not len(triangles):
            continue
        part = MeshPart(
            body=one.body,
            colour=None if one.colour is None else _hex(one.colour),
            first_point=point,
            points=len(points),
            first_index=index,
            indices=triangles.size,
        )
        parts.append(part)
        point, index = point + len(points), index + triangles.size
    for points, _ in fewer:
        out.write(points.astype("<f4").tobytes())
    starts = np.cumsum([0, *(len(points) for points, _ in fewer)])
    for (_, triangles), start in zip(fewer, starts, strict=False):
        out.write((triangles + start).astype("<u4").tobytes())
    return ArmMeshes(parts=parts, triangles=index // 3, size=12 * point + 4 * index)


def _joined(pieces: list[_Piece]) -> list[_Piece]:
    groups: dict[tuple[int, str], list[_Piece]] = {}
    for piece in sorted(pieces, key=lambda one: one.body):
        groups.setdefault((piece.body, "" if piece.colour is None else _hex(piece.colour)), []).append(piece)
    joined = []
    for group in groups.values():
        starts = np.cumsum([0, *(len(one.points) for one in group)])
        triangles = [one.triangles + start for one, start in zip(group, starts, strict=False)]
        points = np.concatenate([one.points for one in group])
        joined.append(_Piece(group[0].body, group[0].colour, points, np.concatenate(triangles).astype(np.int32)))
    return joined


def _hex(colour: Colour) -> str:
    return "#" + "".join(f"{round(255 * value):02x}" for value in colour)


def _limit_memory() -> None:
    """Let this process end rather than the machine run out of memory; on Windows there is no such limit."""
    if sys.platform != "win32":
        import resource

        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        limit = _MEMORY if hard == resource.RLIM_INFINITY else min(_MEMORY, hard)
        resource.setrlimit(resource.RLIMIT_AS, (limit, hard))


def main() -> None:
    """Do the task that comes on the standard input."""
    _limit_memory()
    task = Task.model_validate_json(sys.stdin.buffer.read())
    try:
        with task.out.open("xb") as out:
            answer = Answer(meshes=build(load_cell(task.cell).load_robot(), task.files, out))
    except FileError as error:
        answer = Answer(error=_reason(error, error.path), file=str(error.path), line=error.line)
    except TrueposeError as error:
        answer = Answer(error=str(error))
    sys.stdout.write(answer.model_dump_json())


if __name__ == "__main__":
    main()
