"""Uploads: their limits, and their names, which are never paths."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path, PurePosixPath
from typing import Final

from truepose._io.zips import directory, is_zip
from truepose.errors import FileError
from truepose.web.problems import WebError

MB: Final = 1 << 20
LARGEST_FILE, LARGEST_READINGS, LARGEST_ZIP = 64 * MB, 256 * MB, 1024 * MB
_LARGEST_JSON: Final = 4 * MB
_LARGEST: Final = {
    "/readings": LARGEST_READINGS,
    "/verifications": LARGEST_READINGS,
    "/meshes": LARGEST_READINGS,
}
_NOT_IN_NAMES: Final = re.compile(r'[\x00-\x1f\x7f<>:"/\\|?*]')
_SHEET: Final = re.compile(r"(?i)(\.xls[xm])#")  # what follows would be taken for a sheet of a workbook
_RESERVED: Final = re.compile(r"(?i)^(con|prn|aux|nul|com\d|lpt\d)(\.|$)")
_LONGEST_NAME: Final = 150
_DEEPEST: Final = 20
MOST_FILES: Final = 20_000
"""The largest number of files of one upload, and of members of one .zip."""


def largest_body(path: str) -> int:
    """Return the largest body in bytes that an address accepts."""
    if path.endswith("/programs"):  # what follows it takes options, no files
        return LARGEST_ZIP
    return next(
        (size for part, size in _LARGEST.items() if part in path), LARGEST_FILE if "/files" in path else _LARGEST_JSON
    )


class BodyTooLargeError(WebError):
    """A body beyond the limit of its address."""

    def __init__(self, limit: int) -> None:
        super().__init__(413, "Too large", f"more than {limit // MB} MB; send fewer or smaller files")


def safe_name(name: str) -> str:
    r"""Return a file name without folders and without characters that a system refuses.

    Examples
    --------
    >>> safe_name("../../etc/passwd"), safe_name("C:\\temp\\a<b>.src"), safe_name("..")
    ('passwd', 'a_b_.src', 'file')
    """
    last = PurePosixPath(unicodedata.normalize("NFC", name).replace("\\", "/")).name
    clean = _SHEET.sub(r"\1_", _NOT_IN_NAMES.sub("_", last)).strip(" .")[-_LONGEST_NAME:]
    return "file" if not clean else f"_{clean}" if _RESERVED.match(clean) else clean


def safe_path(name: str) -> PurePosixPath:
    r"""Return the path of a file in a dropped folder, each part as `safe_name` makes it; it never leads upwards.

    Examples
    --------
    >>> safe_path("KRC\\R1/a.src"), safe_path("/../../etc/passwd")
    (PurePosixPath('KRC/R1/a.src'), PurePosixPath('etc/passwd'))
    """
    parts = [part for part in name.replace("\\", "/").split("/") if part.strip(" .")] or [name]
    if len(parts) > _DEEPEST:
        raise WebError(422, "File not accepted", f"a file lies in more than {_DEEPEST} folders; upload an inner folder")
    return PurePosixPath(*map(safe_name, parts))


def largest_file(name: str | PurePosixPath) -> int:
    """Return the largest size in bytes of an uploaded file of this name."""
    return LARGEST_ZIP if is_zip(Path(name)) else LARGEST_FILE


def check_zip(path: Path, name: str) -> None:
    """Refuse a .zip that truepose would not read in place, before it is kept; `name` is that of the user.

    Raises
    ------
    FileError
        If its names lead out of it, it would unpack to an impossible size, it is damaged or holds too many files.
    """
    try:
        count = len(directory(path).members)
    except FileError as error:
        raise FileError(name, str(error).removeprefix(f"{path}: ").replace(f"{path}/", "")) from None
    if count > MOST_FILES:
        raise FileError(name, f"holds {count:,} files, at most {MOST_FILES:,} are accepted; upload a part of it")
