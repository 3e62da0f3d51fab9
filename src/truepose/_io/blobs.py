"""A folder of immutable files that are named by their SHA-256: ``ab/cdef…``."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Final

from truepose._io.commits import sync_folder
from truepose.errors import DataError, FileError

_SHA: Final = re.compile(r"[0-9a-f]{64}")
_PART: Final = 2**20  # bytes read or written at once
_DRAFT: Final = ".draft-"


class BlobFolder:
    """Files by hash; a blob is complete or absent, and equal contents are stored once.

    Parameters
    ----------
    root : str or Path
        The folder; it is created with the first blob.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     blobs = BlobFolder(folder)
    ...     blobs.read(blobs.put(b"DEF MAIN()"))
    b'DEF MAIN()'
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        self._unsynced: set[Path] | None = None  # folders with new names, in `synced_at_end`

    def __contains__(self, sha: object) -> bool:
        return isinstance(sha, str) and _SHA.fullmatch(sha) is not None and self.path(sha).is_file()

    def path(self, sha: str) -> Path:
        """Return the place of a blob, whether it exists or not.

        Raises
        ------
        DataError
            If `sha` is not the SHA-256 of a blob in lower case.
        """
        if _SHA.fullmatch(sha) is None:
            raise DataError(f"expected a SHA-256 of 64 lower-case hexadecimal digits, got {sha!r}")
        return self.root / sha[:2] / sha[2:]

    def put(self, data: bytes) -> str:
        """Store bytes and return their SHA-256; they are on the disk when it returns.

        A blob of another length than its content has was truncated later, and is replaced.
        """
        sha = hashlib.sha256(data).hexdigest()
        if not self._has(sha, len(data)):
            with self._draft() as (file, draft):
                file.write(data)
                self._keep(file, draft, sha)
        return sha

    def put_file(self, path: str | Path) -> str:
        """Store a copy of a file and return its SHA-256.

        Raises
        ------
        FileError
            If the file cannot be read, or the blob cannot be written.
        """
        try:
            source = Path(path).open("rb")  # noqa: SIM115 - closed by the with statement below
        except OSError as error:
            raise FileError(path, f"cannot be read: {error.strerror or error}") from None
        with source, self._draft() as (file, draft):
            found = hashlib.sha256()
            while part := source.read(_PART):
                found.update(part)
                file.write(part)
            if not self._has(sha := found.hexdigest(), file.tell()):
                self._keep(file, draft, sha)
        return sha

    @contextlib.contextmanager
    def synced_at_end(self) -> Iterator[None]:
        """Flush the folders once, at the end of a block that stores many blobs; each blob is still flushed at once.

        Until then a loss of power may remove names of blobs. The block belongs to one thread.
        """
        self._unsynced = unsynced = set[Path]()
        try:
            yield
        finally:
            self._unsynced = None
        try:
            for folder in sorted(unsynced):
                sync_folder(folder)
        except OSError as error:
            raise FileError(self.root, f"a blob cannot be written: {error.strerror or error}") from error

    def read(self, sha: str) -> bytes:
        """Return the content of a blob after a check of its hash.

        Raises
        ------
        FileError
            If the blob is missing, or its content is not that of its name.
        """
        path = self.path(sha)
        try:
            data = path.read_bytes()
        except FileNotFoundError:
            raise FileError(path, "the blob is missing; restore it from a backup") from None
        except OSError as error:
            raise FileError(path, f"cannot be read: {error.strerror or error}") from error
        if hashlib.sha256(data).hexdigest() != sha:
            raise FileError(path, "the content of the blob does not match its name; restore it from a backup")
        return data

    def list(self) -> Iterator[str]:
        """Yield the hashes of all blobs in order; other files in the folder are left out."""
        for folder in sorted(self.root.glob("[0-9a-f][0-9a-f]")):
            for path in sorted(folder.iterdir()):
                if (sha := folder.name + path.name) and _SHA.fullmatch(sha):
                    yield sha

    def _has(self, sha: str, size: int) -> bool:
        return sha in self and self.path(sha).stat().st_size == size

    @contextlib.contextmanager
    def _draft(self) -> Iterator[tuple[BinaryIO, Path]]:
        """Open a new file in the folder that is removed at the end unless it was renamed."""
        draft: Path | None = None
        try:
            self.root.mkdir(parents=True, exist_ok=True)
            descriptor, name = tempfile.mkstemp(prefix=_DRAFT, dir=self.root)
            draft = Path(name)
            with os.fdopen(descriptor, "wb") as file:
                yield file, draft
        except OSError as error:
            raise FileError(self.root, f"a blob cannot be written: {error.strerror or error}") from error
        finally:
            if draft is not None:
                draft.unlink(missing_ok=True)

    def _keep(self, file: BinaryIO, draft: Path, sha: str) -> None:
        """Move a complete draft to its place, so that it survives a loss of power."""
        file.flush()
        os.fsync(file.fileno())
        file.close()
        goal = self.path(sha)
        if not goal.parent.is_dir():
            goal.parent.mkdir(exist_ok=True)
            self._sync(self.root)
        draft.chmod(0o644)
        draft.replace(goal)
        self._sync(goal.parent)

    def _sync(self, folder: Path) -> None:
        """Flush the names in a folder, now or at the end of `synced_at_end`."""
        if self._unsynced is None:
            sync_folder(folder)
        else:
            self._unsynced.add(folder)
