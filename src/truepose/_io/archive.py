"""The container of a map file: a zip of JSON and .npy with schema version and hashes. Loading never executes anything.

Layout: ``manifest.json`` names the format, the schema version and the SHA-256 of each other member; ``content.json``
holds everything that is not an array; ``arrays/NAME.npy`` the arrays. The same content always gives the same bytes.

The hashes detect damage, not intent: anyone can write a file with matching hashes. Therefore the reader trusts nothing
in the file. Sizes are limited before unpacking, only members of the manifest are read, an array's header must have
exactly the form written here, and `truepose.error_map.encoding` checks the values.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import re
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.strict import LARGEST, parse_json
from truepose._version import version
from truepose.errors import DataError, FileError

FORMAT: Final = "truepose map"
SCHEMA: Final = 1
FROZEN: Final = "truepose frozen map"
LARGEST_MAP: Final = 2**30
"""The largest size of a map file in bytes, packed or unpacked."""

_MANIFEST, _CONTENT = "manifest.json", "content.json"
_LARGEST_RATIO: Final = 100  # of all members together; measured data compress little
_SMALL: Final = 2**20  # bytes that may be unpacked at any ratio
_MOST_MEMBERS: Final = 100
_METHODS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_END: Final = 22  # bytes of the end record of a zip without comment; bytes 12 to 16 are the size of the directory
_LOCAL: Final = 30  # bytes of the head of a member, before its name and its extra field
_WIDEST: Final = 1000  # columns of an array; its rows are bounded by the file's size
_WRITTEN_BY: Final = {FORMAT: "'truepose fit'", FROZEN: "FrozenMap.save"}
_EPOCH: Final = (1980, 1, 1, 0, 0, 0)
_HEADER: Final = re.compile(
    rb"\x93NUMPY\x01\x00(..)\{'descr': '(<f8|<i8|\|b1|<U[1-9][0-9]{0,3})', 'fortran_order': False, "
    rb"'shape': \(([0-9]{1,9}(?:, [0-9]{1,9}){0,2})?,?\), \} *\n",
    re.DOTALL,
)
_TYPES: Final = ("f8", "i8", "b1")


def pack(content: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], form: str = FORMAT) -> bytes:
    """Return the bytes of a map file, or of another form of file in the same container.

    Parameters
    ----------
    content : mapping
        The values that JSON can represent; NaN and infinity are refused.
    arrays : mapping of str to array
        The arrays of finite floats, integers, booleans or text.
    form : str
        The format that the manifest names.

    Raises
    ------
    DataError
        If an array has another type.
    """
    members = {_CONTENT: _json(content)}
    for name, array in sorted(arrays.items()):
        buffer = io.BytesIO()
        np.lib.format.write_array(buffer, np.ascontiguousarray(_native(name, array)), allow_pickle=False)
        members[f"arrays/{name}.npy"] = buffer.getvalue()
    manifest = {
        "format": form,
        "schema": SCHEMA,
        "written_by": f"truepose {version()}",
        "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in members.items()},
    }
    return _zipped({_MANIFEST: _json(manifest), **members})


def _zipped(members: Mapping[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), data, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def as_written(data: bytes, path: str | Path, form: str = FORMAT) -> bytes:
    """Return the bytes of a file as `pack` wrote them, also if another program has packed it again.

    Members in another order, with other times or packed in another way are the same content. A file that another zlib
    wrote stays as it is. Arguments and errors are those of `unpack`.
    """
    infos, members = _members(data, path, form)
    order = sorted(members, key=lambda name: (name != _MANIFEST, name != _CONTENT, name.removesuffix(".npy")))
    wanted = [(name, _EPOCH, zipfile.ZIP_DEFLATED) for name in order]
    if [(info.filename, info.date_time, info.compress_type) for info in infos] == wanted:
        packed = {info.filename: _packed(data, info) for info in infos}
        if all(packed[name] == _deflated(members[name]) for name in order):
            return data
        if not any(packed[_CONTENT] == _deflated(members[_CONTENT], level) for level in range(10)):
            return data
    return _zipped({name: members[name] for name in order})


def _packed(data: bytes, info: zipfile.ZipInfo) -> bytes:
    """Return a member of a zip as it is packed."""
    at = info.header_offset + _LOCAL
    start = at + int.from_bytes(data[at - 4 : at - 2], "little") + int.from_bytes(data[at - 2 : at], "little")
    return data[start : start + info.compress_size]


def _deflated(data: bytes, level: int = zlib.Z_DEFAULT_COMPRESSION) -> bytes:
    pack = zlib.compressobj(level, zlib.DEFLATED, -zlib.MAX_WBITS)
    return pack.compress(data) + pack.flush()


def unpack(data: bytes, path: str | Path, form: str = FORMAT) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the content and the arrays of a map file; the inverse of `pack`.

    Parameters
    ----------
    data : bytes
        The content of the file.
    path : str or Path
        The file, for messages.
    form : str
        The format that the manifest must name.

    Raises
    ------
    FileError
        If the file is not of this format, is truncated, was changed after it was written, is of a newer version, or
        would unpack to more than `LARGEST_MAP` bytes or 100 times its own size.
    """
    _, members = _members(data, path, form)
    del members[_MANIFEST]
    content = _parse(members.pop(_CONTENT, b""), path, _CONTENT)
    if not isinstance(content, dict):
        raise FileError(path, f"{_CONTENT} is not an object; fit and save the map again")
    return content, {
        name.removeprefix("arrays/").removesuffix(".npy"): _array(m, path, name) for name, m in members.items()
    }


def _members(data: bytes, path: str | Path, form: str) -> tuple[list[zipfile.ZipInfo], dict[str, bytes]]:
    """Return the entries of a file, and its members by name."""
    try:
        _check_directory(data)
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            infos = archive.infolist()
            return infos, _read_members(archive, path, len(data), form)
    except FileError:
        raise
    # zlib.error is not an OSError, and damaged headers raise errors of struct and codecs
    except Exception as error:
        raise FileError(path, f"is not a map file, or is truncated ({error}); fit and save the map again") from None


def _json(content: Any) -> bytes:
    text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False)
    return text.encode("utf-8", "backslashreplace")  # undecodable bytes of a file name as \udcff


def _native(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind != "U" and array.dtype.str[1:] not in _TYPES:
        raise DataError(f"{name} is an array of {array.dtype}, which a map cannot contain")
    return array.astype(array.dtype.newbyteorder("<"), copy=False)


def _check_directory(data: bytes) -> None:
    """Refuse a zip with a long directory before `zipfile` creates an object per entry."""
    end = data[-_END:]
    if len(end) < _END or not end.startswith(b"PK\x05\x06") or data[-_END - 20 : -_END].startswith(b"PK\x06\x07"):
        raise zipfile.BadZipFile("no end record of a small zip at its end")
    if int.from_bytes(end[12:16], "little") > _SMALL or int.from_bytes(end[10:12], "little") > _MOST_MEMBERS:
        raise zipfile.BadZipFile(f"more than {_MOST_MEMBERS} members")


def _read_members(archive: zipfile.ZipFile, path: str | Path, size: int, form: str) -> dict[str, bytes]:
    """Return the manifest and its members by name."""
    infos = {info.filename: info for info in archive.infolist()}
    if len(infos) != len(archive.infolist()):
        raise FileError(path, "contains a member twice: it was not written by truepose; fit and save the map again")
    unpacked = sum(info.file_size for info in infos.values())
    if unpacked > min(LARGEST_MAP, max(_SMALL, _LARGEST_RATIO * size)):
        raise FileError(path, f"would unpack from {size} to {unpacked} bytes: not a truepose map")
    if any(info.compress_type not in _METHODS for info in infos.values()):
        raise FileError(path, "uses an unknown compression method: it was not written by truepose")
    manifest = _member(archive, infos[_MANIFEST]) if _MANIFEST in infos else b""
    hashes = _hashes(manifest, path, form)
    if stray := sorted(infos.keys() - hashes.keys() - {_MANIFEST}):
        raise FileError(path, f"was changed after it was written ({stray[0]} was added); fit and save the map again")
    members = {name: _member(archive, infos[name]) for name in hashes if name in infos}
    changed = [name for name in hashes if hashlib.sha256(members.get(name, b"")).hexdigest() != hashes[name]]
    if changed:
        what = ", ".join(sorted(changed))
        raise FileError(path, f"was changed after it was written ({what}); fit and save the map again")
    return {_MANIFEST: manifest, **members}


def _member(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    """Return the content of a member, at most one byte more than its stated size."""
    with archive.open(info) as member:
        return member.read(info.file_size + 1)


def _hashes(manifest: bytes, path: str | Path, form: str) -> dict[str, str]:
    """Return the SHA-256 of each member by the manifest."""
    found = _parse(manifest, path, _MANIFEST)
    if not isinstance(found, dict) or found.get("format") != form:
        raise FileError(path, f"is a zip but not a {form}; name the file that {_WRITTEN_BY[form]} wrote")
    if (schema := found.get("schema")) != SCHEMA or isinstance(schema, bool):
        raise FileError(
            path,
            f"has map schema {schema!r}, this version reads schema {SCHEMA}; "
            f"use the version that wrote it ({found.get('written_by', 'unknown')}), or fit the map again",
        )
    hashes = found.get("sha256")
    if not isinstance(hashes, dict) or not all(isinstance(value, str) for value in hashes.values()):
        raise FileError(path, f"{_MANIFEST} contains no hashes; fit and save the map again")
    if odd := [name for name in hashes if name != _CONTENT and not re.fullmatch(r"arrays/[\w.]+\.npy", name)]:
        raise FileError(path, f"{_MANIFEST} names {odd[0]}, which is not part of a map; fit and save the map again")
    return hashes


def _parse(data: bytes, path: str | Path, name: str) -> Any:
    try:
        return parse_json(data)
    except ValueError as error:
        raise FileError(path, f"{name} is missing or not JSON ({error}): not a truepose map, or damaged") from None


def _array(data: bytes, path: str | Path, name: str) -> NDArray[Any]:
    """Return an array after a check that its header, length and values are as `pack` writes them."""
    header = _HEADER.match(data)
    if header is None or int.from_bytes(header[1], "little") != header.end() - 10:
        raise FileError(path, f"{name} is not a plain array of truepose; fit and save the map again")
    kind = header[2].decode()
    shape = tuple(map(int, header[3].split(b", "))) if header[3] else ()
    if len(data) - header.end() != math.prod(shape) * np.dtype(kind).itemsize or max(shape[1:], default=1) > _WIDEST:
        raise FileError(path, f"{name} does not contain {kind} of shape {shape} as stated; fit and save the map again")
    array = np.frombuffer(data, kind, offset=header.end()).reshape(shape)
    if not _plausible(array):
        raise FileError(path, f"{name} contains values that are not finite or not {kind}; fit and save the map again")
    return array.copy()


def _plausible(array: NDArray[Any]) -> bool:
    """Return whether numbers are finite and within `LARGEST`, booleans 0 or 1, and characters valid Unicode."""
    if array.dtype.kind == "f":
        return bool((np.abs(array) <= LARGEST).all())
    if array.dtype.kind == "b":
        return bool((array.view(np.uint8) <= 1).all())
    if array.dtype.kind == "U" and array.size:
        letters = array.reshape(-1).view(np.uint32)
        return bool(((letters < 0xD800) | ((letters > 0xDFFF) & (letters <= 0x10FFFF))).all())
    return True
