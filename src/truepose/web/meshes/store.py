"""Meshes of arms in the workspace: ``.truepose/meshes/HASH`` for each upload, and which cell uses which.

The hash is that of the uploaded files and of the arm, so that the same upload is never computed twice. All of it is a
cache: without it the cells are drawn as shells.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from pydantic import ValidationError

from truepose._io.files import write_atomic
from truepose.errors import FileError, RobotError
from truepose.robots import Robot
from truepose.web.meshes.build import Answer, Task
from truepose.web.meshes.index import ArmMeshes
from truepose.web.multipart import Upload
from truepose.web.problems import WebError, missing
from truepose.web.workspace import CellFolder, Workspace

_VERSION: Final = b"truepose meshes 1"
_INDEX, _DATA, _CELLS = "index.json", "mesh.bin", "cells"
_DEADLINE_S: Final = 180.0
_ONE: Final = threading.Lock()
_PIECE: Final = 1 << 20


class MeshStore:
    """The meshes of a workspace.

    Parameters
    ----------
    workspace : Workspace
        The workspace.
    """

    def __init__(self, workspace: Workspace) -> None:
        self.folder = workspace.own / "meshes"

    def keep(self, cell: CellFolder, upload: Upload) -> ArmMeshes:
        """Compute the meshes of an upload, or take those of the same one, and give them to a cell.

        Raises
        ------
        FileError
            If the files cannot be read.
        RobotError
            If their arm is not that of the cell.
        """
        files = {str(name): upload.folder / name for name in upload.files}
        sha = _hash(cell.load().load_robot(), files)
        with _ONE:
            meshes = self._stored(sha)
            if meshes is None:
                self._build(cell, files, upload, sha)
            write_atomic(self._pointer(cell), sha)
            self._prune()
        return self.of(cell)

    def of(self, cell: CellFolder) -> ArmMeshes:
        """Return the meshes of a cell, which may be none; those of another robot are stale."""
        try:
            sha = self._pointer(cell).read_text("ascii")
        except (OSError, UnicodeDecodeError):
            return ArmMeshes()
        meshes = self._stored(sha)
        if meshes is None:
            return ArmMeshes()
        if not sha.startswith(_arm_hash(cell.load().load_robot())):
            return ArmMeshes(urdf=meshes.urdf, stale=True)
        return meshes

    def data(self, cell: CellFolder) -> tuple[str, Path]:
        """Return the hash and the file of a cell's meshes.

        Raises
        ------
        WebError
            If there are none.
        """
        meshes = self.of(cell)
        if meshes.hash is None:
            raise missing("the mesh of this cell")
        return meshes.hash, self.folder / meshes.hash / _DATA

    def remove(self, cell: CellFolder) -> None:
        """Take the meshes from a cell; what no cell uses is removed from the disk."""
        with _ONE:
            self._pointer(cell).unlink(missing_ok=True)
            self._prune()

    def _pointer(self, cell: CellFolder) -> Path:
        return self.folder / _CELLS / cell.id

    def _stored(self, sha: str) -> ArmMeshes | None:
        if not sha.isalnum():
            return None
        try:
            meshes = ArmMeshes.model_validate_json((self.folder / sha / _INDEX).read_bytes())
            whole = (self.folder / sha / _DATA).stat().st_size == meshes.size
        except (OSError, ValidationError):
            return None
        return meshes if whole and meshes.hash == sha else None

    def _build(self, cell: CellFolder, files: Mapping[str, Path], upload: Upload, sha: str) -> None:
        draft = upload.folder / ".meshes"
        draft.mkdir()
        meshes = _in_own_process(Task(cell=cell.file, files=dict(files), out=draft / _DATA))
        meshes.hash = sha
        (draft / _INDEX).write_text(meshes.model_dump_json(), "utf-8")
        goal = self.folder / sha
        shutil.rmtree(goal, ignore_errors=True)  # a damaged one
        draft.rename(goal)

    def _prune(self) -> None:
        """Remove the meshes that no cell uses."""
        pointers = (self.folder / _CELLS).glob("*") if (self.folder / _CELLS).is_dir() else ()
        used = {path.read_text("ascii", "replace") for path in pointers}
        for path in self.folder.iterdir() if self.folder.is_dir() else ():
            if (path / _INDEX).is_file() and not path.is_symlink() and path.name not in used | {_CELLS}:
                shutil.rmtree(path, ignore_errors=True)


def _in_own_process(task: Task) -> ArmMeshes:
    """Return the meshes of a task; a process that fails, hangs or is killed is an error of the upload."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "truepose.web.meshes.build"],
            input=task.model_dump_json().encode(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_DEADLINE_S,
            check=True,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        answer = Answer.model_validate_json(done.stdout)
    except subprocess.TimeoutExpired:
        raise _failed(f"the meshes take more than {_DEADLINE_S:g} s") from None
    except (subprocess.CalledProcessError, ValidationError):
        raise _failed("the meshes could not be reduced, or need too much memory") from None
    if answer.meshes is not None:
        return answer.meshes
    if answer.file is not None:
        raise FileError(answer.file, answer.error, line=answer.line)
    raise RobotError(answer.error)


def _failed(what: str) -> WebError:
    return WebError(422, "Meshes", f"{what}; export them in a lower resolution and upload again")


def _arm_hash(robot: Robot) -> str:
    """Return the part of a hash that stands for the arm: the frames of the parts depend on it."""
    links = np.round(robot.links(np.eye(4))[:-1], 9) + 0.0
    return hashlib.sha256(_VERSION + links.tobytes() + robot.sign.tobytes()).hexdigest()[:16]


def _hash(robot: Robot, files: Mapping[str, Path]) -> str:
    whole = hashlib.sha256()
    for name in sorted(files):
        one = hashlib.sha256()
        with files[name].open("rb") as file:
            while piece := file.read(_PIECE):
                one.update(piece)
        whole.update(f"{len(name)} {name} {one.hexdigest()} ".encode("utf-8", "surrogateescape"))
    return _arm_hash(robot) + whole.hexdigest()[:48]
