"""Write a .zip again with some members changed; every other byte stays as it is.

Members that do not change keep their packed bytes, order, names, time stamps, attributes and comments: the bytes of the
.zip are copied, and only the places of members behind a changed one are moved. A changed member keeps its name, time
stamp, attributes and method of packing.
"""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import BinaryIO, Final

from truepose._io.zips import checked_directory, is_zip, opened, packed, unpacked
from truepose.errors import FileError, RefusedError

_ENTRY: Final = struct.Struct("<4s6H3L5H2L")
_ENTRY_MARK: Final = b"PK\x01\x02"
_DESCRIPTOR_MARK: Final = b"PK\x07\x08"
_DESCRIPTOR: Final = 0x8
Content = Callable[[], bytes]
_FAR: Final = 0xFFFFFFFF
_BLOCK: Final = 2**20
_KEPT: Final = ("orig_filename", "date_time", "compress_type", "comment", "extra", "create_system", "external_attr")
_REPORT: Final = "please report this .zip"


def write_changed(path: Path, contents: Mapping[str, Content], out: BinaryIO) -> None:
    """Write a .zip with the new contents of some members; a name may lead into a .zip in it.

    Parameters
    ----------
    path : Path
        The .zip.
    contents : mapping of str to callable
        Functions that return the new contents, by the names of the members, with slashes.
    out : binary file
        The file to write.

    Raises
    ------
    FileError
        If the .zip is damaged, a name is not in it, or it is of a form that cannot be changed.
    """
    with opened(path) as file:
        _splice(file, contents, out, path)
        out.flush()
        with os.fdopen(os.dup(out.fileno()), "rb") as made:
            _prove(file, made, contents, path)


def _prove(file: BinaryIO, made: BinaryIO, contents: Mapping[str, Content], path: Path) -> None:
    """Read a .zip that was written, and require that only the members with new contents differ."""
    before, after = checked_directory(file, path).members, checked_directory(made, path).members
    if list(before) != list(after):
        raise RefusedError(f"{path}: the .zip that was written has other members; nothing was written; {_REPORT}")
    for name, old in before.items():
        new = after[name]
        if name in contents:
            same = unpacked(made, new, path / name) == contents[name]()
        elif any(one.startswith(f"{name}/") for one in contents):
            same = True  # a .zip whose own members were written and proven like these
        else:
            same = packed(file, old, path / name) == packed(made, new, path / name)
        if not same or any(getattr(old, what) != getattr(new, what) for what in _KEPT):
            raise RefusedError(f"{path / name}: was not written as intended; nothing was written; {_REPORT}")


def _splice(file: BinaryIO, contents: Mapping[str, Content], out: BinaryIO, path: Path) -> None:
    known = checked_directory(file, path)
    new = {known.members[name].header_offset: (name, made) for name, made in _members(file, contents, path).items()}
    by_place = {info.header_offset: info for info in known.members.values()}
    done = 0
    moved: list[tuple[int, int]] = []  # ends of changed members, with the change of place of what follows
    heads: dict[int, tuple[int, int, int]] = {}
    for offset in sorted(new):
        name, data = new[offset][0], new[offset][1]()
        info = by_place[offset]
        _copy(file, out, done, offset)
        header, old = packed(file, info, path / name)
        body = _packed_as(info, data, path / name)
        heads[offset] = (zlib.crc32(data), len(body), len(data))
        written = _patched_header(header, *heads[offset], path / name)
        out.write(written + body)
        done = offset + len(header) + len(old) + _descriptor_size(file, info, offset + len(header) + len(old))
        moved.append((done, len(written) + len(body) - (done - offset)))
    _copy(file, out, done, known.start)
    file.seek(known.start)
    directory, tail = file.read(known.end - known.start), bytearray(file.read())
    (stated,) = struct.unpack_from("<L", tail, 16)
    for entry, place in _entries(directory, known.start - stated, path):
        out.write(_patched_entry(entry, heads.get(place), sum(change for end, change in moved if place >= end)))
    struct.pack_into("<L", tail, 16, stated + sum(change for _, change in moved))
    out.write(tail)


def _members(file: BinaryIO, contents: Mapping[str, Content], path: Path) -> dict[str, Content]:
    """Return the new contents of members; those that lead into a .zip in this one as that .zip, written again."""
    known = checked_directory(file, path).members
    direct = {name: data for name, data in contents.items() if name in known}
    nested: dict[str, dict[str, Content]] = {}
    for name, data in contents.items():
        if name in direct:
            continue
        parts = name.split("/")
        heads = ("/".join(parts[:k]) for k in range(1, len(parts)))
        head = next((head for head in heads if is_zip(head) and head in known), "")
        if not head:
            raise FileError(path / name, "no such file")
        nested.setdefault(head, {})[name[len(head) + 1 :]] = data
    for head, inner in nested.items():
        direct[head] = partial(_rewritten, file, known[head], inner, path / head)
    return direct


def _rewritten(file: BinaryIO, info: zipfile.ZipInfo, contents: Mapping[str, Content], path: Path) -> bytes:
    """Return a .zip in a .zip with changed members."""
    old, made = io.BytesIO(unpacked(file, info, path)), io.BytesIO()
    _splice(old, contents, made, path)
    _prove(old, made, contents, path)
    return made.getvalue()


def _packed_as(info: zipfile.ZipInfo, data: bytes, path: Path) -> bytes:
    if info.compress_type == zipfile.ZIP_STORED:
        return data
    if info.compress_type != zipfile.ZIP_DEFLATED:
        raise FileError(path, f"is packed by a method that is not written (number {info.compress_type})")
    deflate = zlib.compressobj(wbits=-zlib.MAX_WBITS)
    return deflate.compress(data) + deflate.flush()


def _patched_header(header: bytes, crc: int, size: int, length: int, path: Path) -> bytes:
    """Return the header of a member with new sizes, which it states itself from now on."""
    made = bytearray(header)
    if _FAR in struct.unpack_from("<2L", made, 18):
        raise FileError(path, "is in the format for more than 4 GiB; pack the .zip again without it")
    struct.pack_into("<H", made, 6, struct.unpack_from("<H", made, 6)[0] & ~_DESCRIPTOR)
    struct.pack_into("<3L", made, 14, crc, size, length)
    return bytes(made)


def _descriptor_size(file: BinaryIO, info: zipfile.ZipInfo, place: int) -> int:
    """Return the size of the record that some programs write behind a member."""
    if not info.flag_bits & _DESCRIPTOR:
        return 0
    file.seek(place)
    return 16 if file.read(4) == _DESCRIPTOR_MARK else 12


def _entries(directory: bytes, before: int, path: Path) -> Iterator[tuple[bytes, int]]:
    """Yield each entry of a directory with the place of its member; `before` bytes stand in front of the .zip."""
    at = 0
    while directory.startswith(_ENTRY_MARK, at):
        *_, name, extra, comment, _, _, _, place = _ENTRY.unpack_from(directory, at)
        if place == _FAR:
            raise FileError(path, "is in the format for more than 4 GiB; pack it again without it")
        size = _ENTRY.size + name + extra + comment
        yield directory[at : at + size], before + place
        at += size
    if at < len(directory):  # a signature
        yield directory[at:], -1


def _patched_entry(entry: bytes, head: tuple[int, int, int] | None, change: int) -> bytes:
    """Return an entry of the directory for a member at another place; `head`: its check sum and sizes if it changed."""
    made = bytearray(entry)
    if not entry.startswith(_ENTRY_MARK):
        return entry
    if head is not None:
        struct.pack_into("<H", made, 8, struct.unpack_from("<H", made, 8)[0] & ~_DESCRIPTOR)
        struct.pack_into("<3L", made, 16, *head)
    struct.pack_into("<L", made, 42, struct.unpack_from("<L", made, 42)[0] + change)
    return bytes(made)


def _copy(file: BinaryIO, out: BinaryIO, start: int, end: int) -> None:
    """Copy the bytes from `start` to `end`."""
    file.seek(start)
    while start < end:
        block = file.read(min(_BLOCK, end - start))
        if not block:
            raise FileError(getattr(file, "name", "the .zip"), "was truncated while it was read; run again")
        out.write(block)
        start += len(block)
