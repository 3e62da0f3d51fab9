"""Finished results of tasks, kept by hash until the run that asked for them has ended."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import tempfile
from pathlib import Path
from typing import Final

from truepose._io.blobs import BlobFolder
from truepose.errors import FileError

_SHA: Final = re.compile(r"[0-9a-f]{64}")


class FinishedResults:
    """Results of tasks in a folder: ``blobs/`` by SHA-256, and ``done/KEY`` with the SHA-256 of a task's result.

    Whoever may write into the folder decides what is computed from it; it belongs to the user, or to a closed circle of
    machines.

    Parameters
    ----------
    root : str or Path
        The folder; it is created with the first result.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     results = FinishedResults(folder)
    ...     key = results.key("fold 3")
    ...     _ = results.put(key, b"0.12 mm")
    ...     results.get(key)
    b'0.12 mm'
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        self.blobs = BlobFolder(self.root / "blobs")

    @staticmethod
    def key(*parts: str) -> str:
        """Return the key of a task from the parts of its identity."""
        return hashlib.sha256("\0".join(parts).encode("utf-8", "surrogateescape")).hexdigest()

    def get(self, key: str) -> bytes | None:
        """Return the result of a task; None if there is none, or it is damaged and must be computed again."""
        try:
            sha = self._done(key).read_text("ascii")
            return self.blobs.read(sha) if _SHA.fullmatch(sha) else None
        except (OSError, UnicodeDecodeError, FileError):
            return None

    def put(self, key: str, data: bytes) -> str:
        """Keep the result of a task, and return its SHA-256; it survives the end of this process.

        Raises
        ------
        FileError
            If it cannot be written.
        """
        sha = self.blobs.put(data)
        done = self._done(key)
        try:
            done.parent.mkdir(exist_ok=True)
            descriptor, draft = tempfile.mkstemp(dir=done.parent)
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                file.write(sha)
            Path(draft).replace(done)
        except OSError as error:
            raise FileError(done, f"cannot be written: {error.strerror or error}") from error
        return sha

    def discard(self, key: str) -> None:
        """Remove the result of a task."""
        with contextlib.suppress(OSError, UnicodeDecodeError):
            sha = self._done(key).read_text("ascii")
            self._done(key).unlink()
            if _SHA.fullmatch(sha):
                self.blobs.path(sha).unlink()

    def _done(self, key: str) -> Path:
        return self.root / "done" / key
