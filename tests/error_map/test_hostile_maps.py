"""Map files whose hashes agree and whose content lies: each is one typed error, on one line."""

from __future__ import annotations

import copy
import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.tiers import examples

import truepose as tp
from truepose._io import archive
from truepose.error_map.encoding import from_bytes, to_bytes
from truepose.errors import FileError

Arrays = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def good() -> bytes:
    virtual = tp.VirtualCell("paper", seed=4)
    samples = virtual.measure(virtual.design(40, seed=1))
    return to_bytes(
        tp.fit_cell(virtual.cell, samples, "auto", candidates=["ordinary-kriging", "idw"], splits=["points"])
    )


@pytest.fixture(scope="module")
def parts(good) -> tuple[dict[str, Any], Arrays]:
    return archive.unpack(good, "m")


def refused(data: bytes) -> str:
    """Return the message of a map that must be refused."""
    with pytest.raises(FileError) as caught:
        from_bytes(data, "m.truepose", tp.ErrorMap)
    told = str(caught.value)
    assert told.startswith("m.truepose: ")
    assert told.isprintable()
    return told


def zipped(members: dict[str, bytes], **manifest: Any) -> bytes:
    """Return a map of any members, with right hashes."""
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in members.items()}
    told = {"format": archive.FORMAT, "schema": archive.SCHEMA, "written_by": "x", "sha256": hashes} | manifest
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in {"manifest.json": json.dumps(told).encode(), **members}.items():
            made.writestr(name, data)
    return out.getvalue()


def members_of(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as opened:
        return {name: opened.read(name) for name in opened.namelist() if name != "manifest.json"}


ARRAYS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "negated": lambda x: -x,
    "moved by 1": lambda x: x + 1,
    "one row less": lambda x: x[:-1],
    "scaled": lambda x: 1.001 * x,
    "of numbers that are too large": lambda x: np.full_like(x, 1e300),
    "flat": lambda x: x.ravel(),
}


@pytest.mark.exhaustive
@pytest.mark.promise("No array of a map file that contradicts samples, station and tool is believed, hashes or not")
def test_altered_arrays_are_refused(parts, record_property):
    content, arrays = parts
    names = ["e", "registration.residuals", "registration.tf_base_tracker", "tf_flange_tool", "samples.q"]
    cases = [(name, alter) for name in names for alter in ARRAYS.values()]
    cases += [(name, ARRAYS["one row less"]) for name, array in arrays.items() if array.size]
    for name, alter in cases:
        refused(archive.pack(content, {**arrays, name: alter(arrays[name])}))
    for name in arrays:
        refused(archive.pack(content, {key: value for key, value in arrays.items() if key != name}))
    record_property("cases", len(cases) + len(arrays))


@pytest.mark.promise("The station and the samples of a map file must give its errors e")
def test_negated_errors_are_refused(parts):
    content, arrays = parts
    assert "e[0, 0]" in refused(archive.pack(content, {**arrays, "e": -arrays["e"]}))
    one = arrays["e"].copy()
    one[7, 1] += 0.01
    assert "e[7, 1]" in refused(archive.pack(content, {**arrays, "e": one}))


def test_a_part_that_nobody_reads_is_refused(parts):
    content, arrays = parts
    assert "'more', which is not part" in refused(archive.pack(content, {**arrays, "more": np.zeros(3)}))
    assert "'more', which is not part" in refused(archive.pack({**content, "more": 1}, arrays))


@pytest.mark.exhaustive
@pytest.mark.promise("A value of another type anywhere in the content of a map file is refused")
def test_values_of_another_type_are_refused(parts, record_property):
    content, arrays = parts
    optional = {"cell", "robot", "splits", "log_density"}
    places = [place for place, value in _leaves(content) if value is not None and not optional & set(place)]
    places = [place for place in places if place[0] != "expected" or place[1] in ("mean_mm", "mean_interval_mm")]
    for place in places:
        refused(archive.pack(_put(content, place, {"a": 1}), arrays))
    assert len(places) > 30
    record_property("cases", len(places))


def _leaves(value: Any, place: tuple[Any, ...] = ()) -> Any:
    if isinstance(value, dict | list):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(one, (*place, key))
    else:
        yield place, value


def _put(content: dict[str, Any], place: tuple[Any, ...], value: Any) -> dict[str, Any]:
    changed = copy.deepcopy(content)
    inner: Any = changed
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return changed


def _npy(header: str, data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    text = header.encode("latin-1") + b"\n"
    size = len(text).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    return b"\x93NUMPY" + version + size + text + data


def _shaped(shape: str, kind: str = "<f8", fortran: str = "False") -> str:
    return f"{{'descr': '{kind}', 'fortran_order': {fortran}, 'shape': {shape}, }}"


NPY = {
    "objects": _npy(_shaped("(1,)", "|O"), b"cos\nsystem\n"),
    "huge shape": _npy(_shaped("(999999999, 999999999)")),
    "shape beyond any number": _npy(_shaped("(" + "9" * 400 + ",)")),
    "empty with a huge second axis": _npy(_shaped("(0, 999999999)")),
    "many axes": _npy(_shaped("(" + "1, " * 200 + ")"), bytes(8)),
    "negative shape": _npy(_shaped("(-1, 3)"), bytes(24)),
    "columns first": _npy(_shaped("(2, 3)", fortran="True"), bytes(48)),
    "big-endian": _npy(_shaped("(1,)", ">f8"), bytes(8)),
    "structured": _npy("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (1,), }", bytes(8)),
    "complex": _npy(_shaped("(1,)", "<c16"), bytes(16)),
    "half": _npy(_shaped("(1,)", "<f2"), bytes(2)),
    "dates": _npy(_shaped("(1,)", "<M8[s]"), bytes(8)),
    "version 2": _npy(_shaped("(1,)"), bytes(8), b"\x02\x00"),
    "version 9": _npy(_shaped("(1,)"), bytes(8), b"\x09\x00"),
    "nested header": _npy("(" * 60000),
    "operators in the header": _npy("-" * 60000 + "1"),
    "no header": b"\x93NUMPY\x01\x00",
    "bytes left": _npy(_shaped("(1,)"), bytes(9)),
    "bytes missing": _npy(_shaped("(1,)"), bytes(7)),
    "not finite": _npy(_shaped("(1,)"), np.array([np.nan]).tobytes()),
    "neither true nor false": _npy(_shaped("(1,)", "|b1"), b"\x07"),
    "no letter": _npy(_shaped("(1,)", "<U1"), b"\xff\xff\xff\xff"),
    "pickle": b"\x80\x04cos\nsystem\n.",
}


@pytest.mark.promise("No .npy member with another header, shape, type or length than we write is read")
@pytest.mark.parametrize("which", NPY)
def test_arrays_with_other_headers_are_refused(good, which):
    members = members_of(good) | {"arrays/e.npy": NPY[which]}
    assert "arrays/e.npy" in refused(zipped(members))


CONTENTS = {
    "nested lists": b"[" * 10**6,
    "nested objects": b'{"a":' * 10**6,
    "a key twice": b'{"cell": 1, "cell": 2}',
    "nan": b'{"cell": NaN}',
    "infinity": b'{"cell": 1e999}',
    "a number of a million digits": b'{"cell": ' + b"1" * 10**6 + b"}",
    "not UTF-8": b'{"cell": "\xff"}',
    "a list": b"[]",
    "nothing": b"",
}


@pytest.mark.promise("JSON nested a million deep, double keys and numbers that are none are refused in bounded time")
@pytest.mark.parametrize("which", CONTENTS)
def test_hostile_json_is_refused(good, which):
    told = refused(zipped(members_of(good) | {"content.json": CONTENTS[which]}))
    assert "content.json" in told or "would unpack" in told


@pytest.mark.promise("A map file is unpacked only within limits of its total size and of its ratio")
def test_bombs_are_refused_before_they_are_unpacked(good, monkeypatch):
    bomb = zipped(members_of(good) | {"arrays/e.npy": bytes(64 * 2**20)})
    assert len(bomb) < 2**20
    read = []
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_args, **_kw: read.append(1))
    assert "would unpack from" in refused(bomb)
    assert not read


def test_members_that_say_less_than_they_hold_are_refused(good):
    out = zipped(members_of(good) | {"arrays/e.npy": bytes(4 * 2**20)})
    lying = out.replace((4 * 2**20).to_bytes(4, "little"), (100).to_bytes(4, "little"))
    assert lying != out
    refused(lying)


@pytest.mark.promise("Members that the manifest does not name, or names outside the map, are refused unread")
def test_only_members_of_the_manifest_are_read(good):
    members = members_of(good)
    hashes = {name: hashlib.sha256(data).hexdigest() for name, data in members.items()}
    assert "was added" in refused(zipped(members | {"extra.txt": b"x"}, sha256=hashes))
    assert "not part of a map" in refused(zipped(members | {"../../evil": b"x"}))
    assert "100 members" in refused(zipped(members | {f"arrays/a{k}.npy": b"" for k in range(3000)}))
    for odd in (None, [], {"content.json": 1}, "x"):
        refused(zipped(members, sha256=odd))
    assert "schema" in refused(zipped(members, schema=True))


def test_other_packing_is_refused(good):
    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        out = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(good)) as old, zipfile.ZipFile(out, "w", method) as made:
            for name in old.namelist():
                made.writestr(name, old.read(name))
        assert "unknown compression method" in refused(out.getvalue())


@pytest.mark.promise("No flipped bit, cut or doubled member of a map file gives anything but the map or one error")
@settings(max_examples=examples(150), derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_mutated_archives(good, parts, data):
    broken = bytearray(good)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(broken) - 1))
        kind = data.draw(st.sampled_from(["flip", "cut", "double", "drop"]))
        size = data.draw(st.integers(1, 400))
        if kind == "flip":
            broken[at] ^= 1 << data.draw(st.integers(0, 7))
        elif kind == "cut" and at:
            del broken[at:]
        elif kind == "double":
            broken[at:at] = broken[at : at + size]
        elif len(broken) > size + 1:
            del broken[at : at + size]
        if not broken:
            break
    try:
        content, arrays = archive.unpack(bytes(broken), "m.truepose")
    except FileError:
        return
    assert content == parts[0]
    assert all(np.array_equal(arrays[name], value) for name, value in parts[1].items())
