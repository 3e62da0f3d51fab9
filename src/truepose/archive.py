"""The container of a map file: a zip of JSON and .npy with schema version and hashes. Loading never executes anything.

Layout: ``manifest.json`` names the format, the schema version and the SHA-256 of each other member; ``content.json``
holds everything that is not an array; ``arrays/NAME.npy`` the arrays. The same content always gives the same bytes.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._version import __version__
from truepose.errors import FileError

FORMAT: Final = "truepose map"
SCHEMA: Final = 1
_MANIFEST, _CONTENT = "manifest.json", "content.json"
_LARGEST_MEMBER: Final = 4 * 2**30  # bytes; what is larger is not a map of ours
_EPOCH: Final = (1980, 1, 1, 0, 0, 0)


def pack(content: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return the bytes of a map file.

    Parameters
    ----------
    content : mapping
        Anything that JSON can hold; NaN and infinity are refused.
    arrays : mapping of str to array
        Numeric arrays (no objects).
    """
    members = {_CONTENT: _json(content)}
    for name, array in sorted(arrays.items()):
        buffer = io.BytesIO()
        np.lib.format.write_array(buffer, np.ascontiguousarray(array), allow_pickle=False)
        members[f"arrays/{name}.npy"] = buffer.getvalue()
    manifest = {
        "format": FORMAT,
        "schema": SCHEMA,
        "written_by": f"truepose {__version__}",
        "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in members.items()},
    }
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in {_MANIFEST: _json(manifest), **members}.items():
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), data, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def unpack(data: bytes, path: str | Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return content and arrays of a map file; the inverse of `pack`.

    Parameters
    ----------
    data : bytes
    path : str or Path
        Named in the errors.

    Raises
    ------
    FileError
        If the file is not a map, is truncated, was changed since it was written, or comes from a newer version.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = _read_members(archive, path)
    except (zipfile.BadZipFile, EOFError, OSError, RuntimeError, NotImplementedError) as error:
        raise FileError(path, f"is not a map file, or is truncated ({error}); fit and save the map again") from None
    manifest = _parse(members.pop(_MANIFEST, b""), path, _MANIFEST)
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise FileError(path, "is a zip but not a truepose map; name the file that 'truepose fit' wrote")
    if manifest.get("schema") != SCHEMA:
        raise FileError(
            path,
            f"has map schema {manifest.get('schema')!r}, this version reads schema {SCHEMA}; "
            f"use the version that wrote it ({manifest.get('written_by', 'unknown')}), or fit the map again",
        )
    hashes = manifest.get("sha256")
    found = {name: hashlib.sha256(member).hexdigest() for name, member in members.items()}
    if found != hashes:
        expected = hashes if isinstance(hashes, dict) else {}
        changed = sorted(name for name in {*found, *expected} if found.get(name) != expected.get(name))
        raise FileError(path, f"was changed after it was written ({', '.join(changed)}); fit and save the map again")
    content = _parse(members.pop(_CONTENT, b""), path, _CONTENT)
    if not isinstance(content, dict):
        raise FileError(path, f"{_CONTENT} does not hold an object; fit and save the map again")
    return content, {
        name.removeprefix("arrays/").removesuffix(".npy"): _array(m, path, name) for name, m in members.items()
    }


def _json(content: Any) -> bytes:
    return json.dumps(content, indent=1, sort_keys=True, allow_nan=False, ensure_ascii=False).encode()


def _read_members(archive: zipfile.ZipFile, path: str | Path) -> dict[str, bytes]:
    names = archive.namelist()
    if len(set(names)) != len(names):
        raise FileError(path, "holds a member twice: it was not written by truepose; fit and save the map again")
    for info in archive.infolist():
        if info.file_size > _LARGEST_MEMBER:
            raise FileError(path, f"member {info.filename} claims {info.file_size} bytes: not a truepose map")
    try:
        return {name: archive.read(name) for name in names}
    except Exception as error:  # zlib.error is no OSError, and struct errors come from damaged headers
        raise FileError(path, f"is damaged ({error}); fit and save the map again") from None


def _parse(data: bytes, path: str | Path, name: str) -> Any:
    try:
        return json.loads(data)
    except ValueError:
        raise FileError(path, f"{name} is missing or is no JSON: not a truepose map, or damaged") from None


def _array(data: bytes, path: str | Path, name: str) -> NDArray[Any]:
    try:
        return np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    except ValueError as error:
        raise FileError(path, f"{name} is no plain array ({error}); fit and save the map again") from None
