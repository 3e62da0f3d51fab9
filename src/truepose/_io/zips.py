"""Read the members of .zip files where they are, by paths that lead into them: ``backup.zip/KRC/R1/a.src``.

Nothing is unpacked to the disk, and one member is held in memory at a time. A .zip comes from anywhere; therefore its
directory is checked before a member is read: names that lead out of it, names that are one file on some systems,
encrypted members, and sizes that no backup has are refused. A .zip inside of a .zip is read in the same way.
"""

from __future__ import annotations

import io
import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, Final

from truepose.errors import FileError

LARGEST_UNPACKED: Final = 2**31
"""The largest size of all members together in bytes: 2 GiB, more than any controller stores."""
_LARGEST_NESTED: Final = 2**28  # a .zip in a .zip is held in memory while its members are read
_LARGEST_RATIO: Final = 100
_SMALL: Final = 2**20  # bytes that may be unpacked at any ratio
_LARGEST_DIRECTORY: Final = 2**25
_DEEPEST: Final = 3
_END: Final = struct.Struct("<4s4H2LH")
_END_MARK: Final = b"PK\x05\x06"
_LOCAL: Final = struct.Struct("<4s5H3L2H")
_LOCAL_MARK: Final = b"PK\x03\x04"
_ENCRYPTED: Final = 0x1 | 0x40 | 0x2000
_UTF8: Final = 0x800
_DRIVE: Final = re.compile(r"[A-Za-z]:")
_REMEDY: Final = "unpack it and give the folder"


@dataclass(frozen=True, eq=False)
class Directory:
    """The directory of a .zip after its checks.

    Attributes
    ----------
    members : mapping of str to ZipInfo
        The files by their paths in the .zip, with slashes, in their order; links and folders are left out.
    start, end : int
        The first byte of the directory, and that of its end record.
    links : tuple of str
        The links, which are never followed.
    """

    members: Mapping[str, zipfile.ZipInfo]
    start: int
    end: int
    links: tuple[str, ...] = ()


def is_zip(path: str | Path) -> bool:
    """Return whether a name is that of a .zip."""
    return Path(path).suffix.lower() == ".zip"


def on_disk(path: Path) -> Path:
    """Return the .zip on the disk that a path leads into, or the path itself."""
    for parent in (path, *path.parents):
        try:
            status = parent.stat()
        except (OSError, ValueError):
            continue
        return parent if parent == path or stat.S_ISREG(status.st_mode) else path
    return path


def read_member(path: Path, largest: int) -> bytes | None:
    """Return the content of a member by a path that leads into a .zip; None where no part of the path is a .zip.

    Raises
    ------
    FileError
        If the .zip is refused, the member is missing, damaged or larger than `largest` bytes.
    """
    outer = on_disk(path)
    if outer == path or not is_zip(outer):
        return None
    return _read(outer, path.relative_to(outer).as_posix(), path, largest)


def member_size(path: Path) -> int:
    """Return the size of a member in bytes, by a path that leads into a .zip."""
    outer = on_disk(path)
    place, inner = _split(outer, path.relative_to(outer).as_posix())
    if (info := directory(place).members.get(inner)) is None:
        raise FileError(path, "no such file")
    return info.file_size


def directory(path: Path) -> Directory:
    """Return the directory of a .zip, which may lie in another one; a FileError says why it is refused."""
    outer = on_disk(path)
    try:
        status = outer.stat()
    except (OSError, ValueError) as error:
        missing = isinstance(error, FileNotFoundError | NotADirectoryError)
        reason = "no such file" if missing else f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise FileError(path, reason) from None
    if not stat.S_ISREG(status.st_mode):
        raise FileError(path, "is a device or a pipe, not a file; save its content as a file")
    return _directory(outer, path.relative_to(outer).as_posix(), status.st_mtime_ns, status.st_size)


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a .zip, which may lie in another one, for reading."""
    outer = on_disk(path)
    if outer == path:
        with path.open("rb") as file:
            yield file
    else:
        status = outer.stat()
        yield io.BytesIO(_nested(outer, path.relative_to(outer).as_posix(), status.st_mtime_ns, status.st_size))


def within(path: Path, depth: int = 1) -> tuple[list[Path], list[str]]:
    """Return the files of a .zip and of those in it, and warnings about those that cannot be read.

    Raises
    ------
    FileError
        If the .zip itself is refused.
    """
    found: list[Path] = []
    here = directory(path)
    told = [f"{path / name}: is a link and is left out" for name in here.links]
    for name in here.members:
        if not is_zip(name):
            found.append(path / name)
        elif depth == _DEEPEST:
            told.append(f"{path / name}: lies in {_DEEPEST} other .zip files and is left out; {_REMEDY}")
        else:
            more, warnings = nested_within(path / name, depth + 1)
            found, told = found + more, told + warnings
    return found, told


def nested_within(path: Path, depth: int = 1) -> tuple[list[Path], list[str]]:
    """Return what `within` does; one that is refused counts as a file, with a warning."""
    try:
        return within(path, depth)
    except FileError as error:
        return [path], [f"{error}; it is left out"]


def _read(outer: Path, name: str, path: Path, largest: int) -> bytes:
    """Return a member of a .zip on the disk; a part of its name may be that of a .zip in it."""
    place, inner = _split(outer, name)
    members = directory(place).members
    if (info := members.get(inner)) is None:
        raise FileError(path, "no such file")
    if info.file_size > largest:
        size = f"{info.file_size / 2**20:,.0f} MiB"
        raise FileError(path, f"has {size}, expected at most {largest / 2**20:,.0f} MiB; is it the right file?")
    with opened(place) as file:
        return unpacked(file, info, path)


def _split(outer: Path, name: str) -> tuple[Path, str]:
    """Return the innermost .zip that a name leads into, and the name in it."""
    place, rest = outer, name
    while True:
        members = directory(place).members
        parts = rest.split("/")
        heads = ("/".join(parts[:k]) for k in range(1, len(parts)))
        head = next((head for head in heads if is_zip(head) and head in members), "")
        if not head:
            return place, rest
        place, rest = place / head, rest[len(head) + 1 :]


def packed(file: BinaryIO, info: zipfile.ZipInfo, path: Path) -> tuple[bytes, bytes]:
    """Return the header of a member, its name and extra field included, and its packed bytes."""
    file.seek(info.header_offset)
    fixed = file.read(_LOCAL.size)
    if len(fixed) < _LOCAL.size or not fixed.startswith(_LOCAL_MARK):
        raise FileError(path, "is damaged or truncated in its .zip; copy the .zip again")
    *_, name_size, extra_size = _LOCAL.unpack(fixed)
    more = file.read(name_size + extra_size)
    if more[:name_size] != info.orig_filename.encode("utf-8" if info.flag_bits & _UTF8 else "cp437"):
        raise FileError(path, "has another name in its own header than in the directory of the .zip; pack it again")
    data = file.read(info.compress_size)
    if len(data) < info.compress_size:
        raise FileError(path, "is truncated in its .zip; copy the .zip again")
    return fixed + more, data


def unpacked(file: BinaryIO, info: zipfile.ZipInfo, path: Path) -> bytes:
    """Return the content of a member, never more than its stated size; a FileError names one that is damaged."""
    _, data = packed(file, info, path)
    if info.compress_type == zipfile.ZIP_DEFLATED:
        inflate = zlib.decompressobj(-zlib.MAX_WBITS)
        try:
            data = inflate.decompress(data, info.file_size + 1)
        except zlib.error as error:
            raise FileError(path, f"is damaged in its .zip ({error}); copy the .zip again") from None
    elif info.compress_type != zipfile.ZIP_STORED:
        raise FileError(path, f"is packed by a method that is not read (number {info.compress_type}); {_REMEDY}")
    if len(data) != info.file_size or zlib.crc32(data) != info.CRC:
        raise FileError(path, "is damaged in its .zip: size or check sum are not as stated; copy the .zip again")
    return data


@lru_cache(maxsize=2)
def _nested(outer: Path, name: str, _changed: int, _size: int) -> bytes:
    return _read(outer, name, outer / name, _LARGEST_NESTED)


@lru_cache(maxsize=16)
def _directory(outer: Path, name: str, _changed: int, _size: int) -> Directory:
    path = outer if name == "." else outer / name
    with opened(path) as file:
        return checked_directory(file, path)


def checked_directory(file: BinaryIO, path: Path) -> Directory:
    """Return the directory of a .zip; a FileError says why it is refused, and names the member."""
    try:
        end = _end_record(file)
        with zipfile.ZipFile(file) as archive:
            infos, start = archive.infolist(), archive.start_dir
    except FileError:
        raise
    # damaged headers raise errors of struct and codecs, too
    except Exception as error:
        raise FileError(path, f"is no .zip or is truncated ({error}); copy it again") from None
    members: dict[str, zipfile.ZipInfo] = {}
    links: list[str] = []
    for info in infos:
        name = _checked_name(info, path)
        if info.flag_bits & _ENCRYPTED:
            raise FileError(path, f"{name} is encrypted; {_REMEDY}")
        if info.create_system == 3 and stat.S_ISLNK(info.external_attr >> 16):
            links.append(name)
        elif not name.endswith("/"):
            if name in members:
                raise FileError(path, f"holds two files of the name {name}; {_REMEDY}")
            members[name] = info
    check_names(members, path)
    _check_sizes(infos, path, file.seek(0, io.SEEK_END), start)
    return Directory(members, start, end, tuple(links))


def _end_record(file: BinaryIO) -> int:
    """Return the place of the end record, after a check that the directory is of a size that a backup can have."""
    size = file.seek(0, io.SEEK_END)
    begin = max(0, size - _END.size - 0xFFFF)
    file.seek(begin)
    tail = file.read()
    at = tail.rfind(_END_MARK)
    if at < 0 or len(tail) - at < _END.size:
        raise zipfile.BadZipFile("it has no end record")
    _, disk, _, _, count, directory_size, offset, comment = _END.unpack_from(tail, at)
    if 0xFFFF in (disk, count) or 0xFFFFFFFF in (directory_size, offset):
        raise zipfile.BadZipFile("it is in the format for more than 65,000 files or 4 GiB")
    if directory_size > _LARGEST_DIRECTORY or at + _END.size + comment > len(tail):
        raise zipfile.BadZipFile("its directory has an impossible size")
    return begin + at


def _checked_name(info: zipfile.ZipInfo, path: Path) -> str:
    """Return the path of a member with slashes; that of a folder ends with one."""
    name = info.orig_filename.replace("\\", "/")
    parts = [part for part in name.split("/") if part not in ("", ".")]
    if name.startswith("/") or _DRIVE.match(name) or ".." in parts or "\0" in name or not parts:
        raise FileError(path, f"the name {name!r} leads out of the .zip; {_REMEDY} if you trust its source")
    return "/".join(parts) + ("/" if name.endswith("/") else "")


def check_names(names: Mapping[str, object] | list[str], path: Path) -> None:
    """Refuse names that are one file, or a file and a folder, on systems that do not distinguish case.

    Raises
    ------
    FileError
        If there are such names.
    """
    known: dict[str, str] = {}
    for name in names:
        if (other := known.setdefault(name.casefold(), name)) != name:
            raise FileError(path, f"{other} and {name} differ only in case; keep the one that the controller uses")
    for name in names:
        folded = name.casefold()
        folders = (folded[:k] for k, letter in enumerate(folded) if letter == "/")
        if folder := next((known[one] for one in folders if one in known), ""):
            raise FileError(path, f"{folder} is a file and, for {name}, a folder; {_REMEDY}")


def _check_sizes(infos: list[zipfile.ZipInfo], path: Path, size: int, start: int) -> None:
    """Refuse a .zip that unpacks to more than a backup can have, or whose members overlap."""
    for info in infos:
        if info.file_size > max(_SMALL, _LARGEST_RATIO * info.compress_size):
            what = f"{info.filename} would unpack from {info.compress_size} to {info.file_size} bytes"
            raise FileError(path, f"{what}, more than {_LARGEST_RATIO} times its size: no file of a controller")
    if not infos:
        raise FileError(path, "is empty: it holds no file")
    total = sum(info.file_size for info in infos)
    if total > min(LARGEST_UNPACKED, max(_SMALL, _LARGEST_RATIO * size)):
        raise FileError(path, f"would unpack from {size} to {total} bytes: no backup of a controller")
    ends = sorted((info.header_offset, info.compress_size, info.filename) for info in infos)
    borders = [offset for offset, _, _ in ends[1:]] + [start]
    for (offset, packed_size, name), border in zip(ends, borders, strict=True):
        if offset < 0 or offset + _LOCAL.size + packed_size > border:
            raise FileError(path, f"{name} overlaps another member: the .zip is damaged; copy it again")
