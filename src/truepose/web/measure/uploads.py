"""Measurement files that previews were asked of: kept for a while by their hash, so that no change sends them again."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from pathlib import Path
from typing import Final

from truepose.web.kept import remove_old
from truepose.web.problems import WebError
from truepose.web.uploads import MB
from truepose.web.workspace import Workspace

_FOLDER: Final = "uploads"
_LARGEST, _DAYS = 2048 * MB, 2.0


class StoredUploads:
    """The files in the folder ``.truepose/uploads`` of a workspace: each in a folder that is named after its hash.

    Parameters
    ----------
    workspace : Workspace
        The workspace.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._folder = workspace.own / _FOLDER

    def keep(self, path: Path) -> str | None:
        """Move a file here and return its id: the SHA-256 of its name and content; None if it cannot be kept."""
        with path.open("rb") as file:
            known = hashlib.sha256(os.fsencode(path.name) + b"\0")
            while piece := file.read(MB):
                known.update(piece)
        id_ = known.hexdigest()
        goal = self._folder / id_
        try:
            goal.mkdir(parents=True, exist_ok=True)
            path.replace(goal / path.name)
            os.utime(goal)
            remove_old(self._folder, largest=_LARGEST, days=_DAYS)
        except OSError:  # a full disk, or another one: the file is sent again
            return None
        return id_

    def place(self, id_: str, folder: Path, *, own: bool) -> Path:
        """Put a kept file into a folder, as a copy of its `own` or for reading only; return its path.

        Raises
        ------
        WebError
            If it was removed meanwhile.
        """
        kept = self._folder / id_
        try:
            (source,) = kept.iterdir()
            os.utime(kept)
            goal = folder / source.name
            if not own:
                with contextlib.suppress(OSError):  # a disk without hard links
                    os.link(source, goal)
                    return goal
            shutil.copyfile(source, goal)
        except (OSError, ValueError):
            raise WebError(410, "Upload gone", "the file is not kept any more; choose it again") from None
        return goal
