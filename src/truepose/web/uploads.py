"""Uploads: their limits, and their names, which are never paths."""

from __future__ import annotations

import re
import unicodedata
from pathlib import PurePosixPath
from typing import Final

from starlette.responses import Response

from truepose.web.problems import WebError, problem_response

MB: Final = 1 << 20
LARGEST_FILE, LARGEST_READINGS, LARGEST_ZIP = 64 * MB, 256 * MB, 1024 * MB
_LARGEST_JSON: Final = 4 * MB
_LARGEST: Final = {
    "/programs": LARGEST_ZIP,
    "/readings": LARGEST_READINGS,
    "/verifications": LARGEST_READINGS,
    "/meshes": LARGEST_FILE,
}
_NOT_IN_NAMES: Final = re.compile(r'[\x00-\x1f\x7f<>:"/\\|?*]')
_RESERVED: Final = re.compile(r"(?i)^(con|prn|aux|nul|com\d|lpt\d)(\.|$)")
_LONGEST_NAME: Final = 150


def largest_body(path: str) -> int:
    """Return the largest body in bytes that an address accepts."""
    return next(
        (size for part, size in _LARGEST.items() if part in path), LARGEST_FILE if "/files" in path else _LARGEST_JSON
    )


class BodyTooLargeError(WebError):
    """A body beyond the limit of its address."""

    def __init__(self, limit: int) -> None:
        super().__init__(413, "Too large", f"more than {limit // MB} MB; send fewer or smaller files")

    def response(self) -> Response:
        """Return the answer."""
        return problem_response(self.status, self.title, str(self))


def safe_name(name: str) -> str:
    r"""Return a file name without folders and without characters that a system refuses.

    Examples
    --------
    >>> safe_name("../../etc/passwd"), safe_name("C:\\temp\\a<b>.src"), safe_name("..")
    ('passwd', 'a_b_.src', 'file')
    """
    last = PurePosixPath(unicodedata.normalize("NFC", name).replace("\\", "/")).name
    clean = _NOT_IN_NAMES.sub("_", last).strip(" .")[-_LONGEST_NAME:]
    return "file" if not clean else f"_{clean}" if _RESERVED.match(clean) else clean
