"""Files that hold their text packed by gzip.

Readers, patches and the proof work on the text. The file is packed again when it is written, with the header of the
original; if the text is the original one, so are the bytes of the file.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final, Self

from truepose._io import files
from truepose.errors import FileError
from truepose.programs.core.source import Source, replacement

LARGEST_RATIO: Final = 100
"""Largest size of the text, in sizes of the file; more is no program but an attempt to fill the memory."""
_FREE: Final = 2**20
"""Size in bytes up to which any ratio is accepted: short texts of blanks pack well."""
_MAGIC: Final = b"\x1f\x8b"
_HEADER, _TRAILER = 10, 8
_HAS_SUM, _HAS_EXTRA, _HAS_NAME, _HAS_COMMENT = 2, 4, 8, 16


@dataclass(frozen=True, eq=False)
class PackedSource(Source):
    """A file whose text, `data`, is packed.

    Parameters
    ----------
    packed : bytes
        The bytes of the file.
    header : bytes
        The header of gzip in it; empty where the file is not packed.
    """

    packed: bytes = b""
    header: bytes = b""

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read a file; a FileError says if it is truncated, broken, or far larger when it is unpacked."""
        path = Path(path)
        packed = files.read_bytes(path)
        header = _header(path, packed) if packed.startswith(_MAGIC) else b""
        text = replacement(path)
        if text is None:
            text = _unpacked(path, packed, len(header)) if header else packed
        return cls(path, text, packed, header)

    @cached_property
    def sha256(self) -> str:
        """Hash of the file's bytes."""
        return hashlib.sha256(self.packed).hexdigest()

    def stored(self, text: Iterable[bytes]) -> Iterator[bytes]:
        """Yield the bytes of the file that holds a text."""
        data = b"".join(text)
        if data == self.data:
            yield self.packed
        elif not self.header:
            yield data
        else:
            pack = zlib.compressobj(9, zlib.DEFLATED, -zlib.MAX_WBITS)
            ends = zlib.crc32(data).to_bytes(4, "little") + (len(data) & 0xFFFFFFFF).to_bytes(4, "little")
            yield self.header + pack.compress(data) + pack.flush() + ends


def _header(path: Path, packed: bytes) -> bytes:
    """Return the header of gzip, with its optional fields."""
    flags, end = packed[3] if len(packed) > _HEADER else 0, _HEADER
    if flags & _HAS_EXTRA:
        end += 2 + int.from_bytes(packed[end : end + 2], "little")
    for flag in (_HAS_NAME, _HAS_COMMENT):
        if flags & flag:
            end = packed.find(b"\0", end) + 1
            if not end:
                raise FileError(path, "is truncated: its header has no end; copy it from the controller again")
    end += 2 if flags & _HAS_SUM else 0
    if len(packed) < end + _TRAILER:
        raise FileError(path, "is truncated; copy it from the controller again")
    return packed[:end]


def _unpacked(path: Path, packed: bytes, start: int) -> bytes:
    largest = min(max(LARGEST_RATIO * len(packed), _FREE), files.LARGEST_FILE)
    unpack = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        text = unpack.decompress(memoryview(packed)[start:], largest + 1)
    except zlib.error:
        raise FileError(path, "is broken: it cannot be unpacked; copy it from the controller again") from None
    if len(text) > largest:
        raise FileError(path, f"has more than {largest:,} bytes when it is unpacked; that is no program")
    if not unpack.eof:
        raise FileError(path, "is truncated; copy it from the controller again")
    end = unpack.unused_data
    if len(end) != _TRAILER:
        raise FileError(path, "holds bytes behind its end; copy it from the controller again")
    sums = zlib.crc32(text), len(text) & 0xFFFFFFFF
    if sums != (int.from_bytes(end[:4], "little"), int.from_bytes(end[4:], "little")):
        raise FileError(path, "is broken: its check sum is wrong; copy it from the controller again")
    return text
