"""Uploads as they arrive: each file goes to the disk piece by piece, and nothing is seen before all of it is there.

Files are written to a hidden folder beside their goal, on the same disk. It is renamed when the body has ended, so that
an upload that is cut off, a full disk or a killed server leaves no half file behind. The hidden folder of a killed
server is removed by a later upload.
"""

from __future__ import annotations

import contextlib
import math
import os
import secrets
import shutil
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, Final

from anyio import CancelScope, to_thread
from python_multipart import MultipartParser
from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import parse_options_header
from starlette.requests import ClientDisconnect, Request

from truepose._io.zips import check_names, is_zip
from truepose.errors import FileError
from truepose.web.problems import WebError
from truepose.web.uploads import MB, MOST_FILES, check_zip, largest_file, safe_path

DRAFT: Final = ".upload-"
"""How the names of hidden folders begin."""
FORM: Final[dict[str, Any]] = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["files"],
                    "properties": {
                        "files": {
                            "type": "array",
                            "items": {"type": "string", "format": "binary"},
                            "description": "Files; the relative path of a dropped folder is the file name.",
                        }
                    },
                }
            }
        },
    }
}
"""The body of an upload in the contract, since the routes read it themselves."""
_FORGOTTEN_S: Final = 3600.0
_LARGEST_FIELD, _MOST_FIELDS = 1 << 16, 100
_PIECE: Final = 1 << 20


@dataclass
class Upload:
    """The files and fields of a body that has arrived.

    Attributes
    ----------
    folder : Path
        The hidden folder of the files, which is removed at the end unless `keep` renames it.
    files : dict of PurePosixPath to str
        The files by their safe paths in the folder, each with the name that the browser gave.
    fields : dict of str to str
        The other fields.
    """

    folder: Path
    files: dict[PurePosixPath, str] = field(default_factory=dict)
    fields: dict[str, str] = field(default_factory=dict)

    def paths(self) -> list[Path]:
        """Return the paths of the files while the upload is not kept."""
        return [self.folder / name for name in self.files]

    def keep(self, goal: Path, part: PurePosixPath) -> Path:
        """Rename a file or folder in it, or itself (``.``), to its final name; that of an existing file is refused."""
        if os.path.lexists(goal):
            raise FileError(goal, "exists already; repeat the upload")
        goal.parent.mkdir(parents=True, exist_ok=True)
        return (self.folder / part).rename(goal)


@asynccontextmanager
async def received(
    request: Request,
    parent: Path,
    *,
    least: int = 1,
    largest: Callable[[PurePosixPath], int] = largest_file,
) -> AsyncIterator[Upload]:
    """Receive a multipart body into a hidden folder in `parent`; what the block does not keep is removed.

    Parameters
    ----------
    request : Request
        The request; its body must not have been read.
    parent : Path
        The folder of the final files; made if it does not exist.
    least : int
        The least number of files.
    largest : callable
        The largest size in bytes of a file of a name.

    Raises
    ------
    WebError
        If the body is no multipart form, is cut off, or a file or their number is beyond the limits.
    FileError
        If names differ in case only, or a .zip is refused.
    """
    folder = await to_thread.run_sync(_draft, parent)
    try:
        writer = _Writer(Upload(folder), _boundary(request), largest)
        try:
            await _feed(request, writer)
            await to_thread.run_sync(_check, writer.upload, least)
        finally:
            writer.close()
        yield writer.upload
    finally:
        with CancelScope(shield=True):
            await to_thread.run_sync(lambda: shutil.rmtree(folder, ignore_errors=True))
        with contextlib.suppress(OSError):  # a folder that was made for nothing
            parent.rmdir()


async def _feed(request: Request, writer: _Writer) -> None:
    piece = bytearray()
    try:
        async for chunk in request.stream():
            piece += chunk
            if len(piece) >= _PIECE:
                await to_thread.run_sync(writer.write, bytes(piece))
                piece.clear()
    except ClientDisconnect:
        raise _cut() from None
    await to_thread.run_sync(writer.write, bytes(piece))
    if not writer.ended:
        raise _cut()


def _cut() -> WebError:
    return WebError(400, "Upload cut off", "the upload ended before its end; nothing was kept; upload again")


def _boundary(request: Request) -> bytes:
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    if kind != b"multipart/form-data" or b"boundary" not in options:
        raise WebError(415, "No form", "expected a multipart form with files")
    return options[b"boundary"]


def _draft(parent: Path) -> Path:
    """Return a new hidden folder, and remove those of servers that were killed long ago."""
    parent.mkdir(parents=True, exist_ok=True)
    for old in parent.glob(f"{DRAFT}*"):
        if time.time() - max(_times(old), default=math.inf) > _FORGOTTEN_S:  # one that is gone has no times
            shutil.rmtree(old, ignore_errors=True)
    folder = parent / f"{DRAFT}{secrets.token_hex(8)}"
    folder.mkdir()
    return folder


def _times(folder: Path) -> Iterator[float]:
    """Yield when a folder and what is in it changed; another upload may end and remove it meanwhile."""
    for place, _, files in os.walk(folder):
        for path in (Path(place), *(Path(place, file) for file in files)):
            with contextlib.suppress(OSError):
                yield path.lstat().st_mtime


def _check(upload: Upload, least: int) -> None:
    if len(upload.files) < least:
        raise WebError(422, "No file", "the upload holds no file; choose one and upload again")
    check_names([str(name) for name in upload.files], Path("upload"))
    for name, given in upload.files.items():
        if is_zip(Path(name)):
            check_zip(upload.folder / name, given)


class _Writer:
    """Writes the files of a multipart body while it arrives."""

    def __init__(self, upload: Upload, boundary: bytes, largest: Callable[[PurePosixPath], int]) -> None:
        self.upload, self.ended, self._largest = upload, False, largest
        self._file: BinaryIO | None = None
        self._room, self._size = 0, 0
        self._field = ""
        self._data = bytearray()
        self._header, self._value, self._disposition = b"", b"", b""
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._part_begins,
                "on_part_data": self._part_data,
                "on_part_end": self._part_ends,
                "on_header_field": self._header_field,
                "on_header_value": self._header_value,
                "on_header_end": self._header_ends,
                "on_headers_finished": self._headers_end,
                "on_end": self._body_ends,
            },
        )

    def write(self, data: bytes) -> None:
        """Take a piece of the body."""
        try:
            self._parser.write(data)
        except MultipartParseError:
            raise WebError(400, "No form", "the body is no readable multipart form; upload again") from None

    def close(self) -> None:
        """Close the file that is open."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _part_begins(self) -> None:
        self._disposition, self._field, self._size = b"", "", 0
        self._data.clear()

    def _header_field(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _header_ends(self) -> None:
        if self._header.lower() == b"content-disposition":
            self._disposition = self._value
        self._header, self._value = b"", b""

    def _headers_end(self) -> None:
        _, options = parse_options_header(self._disposition)
        self._field = options.get(b"name", b"").decode("utf-8", "replace")
        if b"filename" not in options:
            return
        given = options[b"filename"].decode("utf-8", "replace")
        name = safe_path(given)
        if len(self.upload.files) == MOST_FILES:
            raise WebError(413, "Too large", f"more than {MOST_FILES:,} files; upload a part of them, or a .zip")
        path = self.upload.folder / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("xb")
        except (FileExistsError, NotADirectoryError, IsADirectoryError):
            detail = f"two files of the upload have the name {name}, or names that differ in case only; rename one"
            raise WebError(422, "File not accepted", detail) from None
        self._room = self._largest(name)
        self.upload.files[name] = given

    def _part_data(self, data: bytes, start: int, end: int) -> None:
        self._size += end - start
        if self._file is None:
            self._data += data[start:end]
            if len(self._data) > _LARGEST_FIELD:
                raise WebError(413, "Too large", f"the field {self._field} is longer than {_LARGEST_FIELD} bytes")
        elif self._size > self._room:
            name = list(self.upload.files.values())[-1]
            raise WebError(413, "Too large", f"{name} has more than {self._room // MB} MB; send a smaller file")
        else:
            self._file.write(memoryview(data)[start:end])

    def _part_ends(self) -> None:
        if self._file is not None:
            self.close()
        elif len(self.upload.fields) < _MOST_FIELDS:
            self.upload.fields[self._field] = self._data.decode("utf-8", "replace")

    def _body_ends(self) -> None:
        self.ended = True
