import io
import json
import zipfile
import zlib

import numpy as np
import pytest

import truepose
from truepose._io import archive
from truepose.errors import FileError

CONTENT = {"name": "cell", "values": [1, 2.5, None], "text": "Größe"}
ARRAYS = {"q": np.arange(12.0).reshape(4, 3), "flag": np.array([True, False])}


@pytest.fixture
def packed() -> bytes:
    return archive.pack(CONTENT, ARRAYS)


def rewrite(data: bytes, name: str, new: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as made:
        for member in old.namelist():
            made.writestr(member, new if member == name else old.read(member))
    return out.getvalue()


def test_comes_back_as_it_was(packed):
    content, arrays = archive.unpack(packed, "m.truepose")
    assert content == CONTENT
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array)
        assert arrays[name].dtype == array.dtype


def test_same_content_gives_same_bytes(packed):
    assert archive.pack(CONTENT, dict(reversed(ARRAYS.items()))) == packed


@pytest.mark.parametrize("length", [0, 10, 200, -30])
def test_truncated_file_is_told(packed, length):
    with pytest.raises(FileError, match=r"m\.truepose: .*truncated.*fit and save the map again"):
        archive.unpack(packed[:length], "m.truepose")


def test_tampered_array_is_named(packed):
    other = archive.pack(CONTENT, {**ARRAYS, "q": ARRAYS["q"] + 1e-9})
    with zipfile.ZipFile(io.BytesIO(other)) as z:
        changed = z.read("arrays/q.npy")
    with pytest.raises(FileError, match=r"changed after it was written \(arrays/q\.npy\)"):
        archive.unpack(rewrite(packed, "arrays/q.npy", changed), "m.truepose")


def test_flipped_byte_anywhere_never_passes_unnoticed(packed, rng):
    for position in rng.integers(0, len(packed), size=150):
        damaged = bytearray(packed)
        damaged[position] ^= 0x55
        try:
            content, arrays = archive.unpack(bytes(damaged), "m.truepose")
        except FileError:
            continue
        # bytes of the zip that carry no content (dates, attributes) may change without harm
        assert content == CONTENT
        np.testing.assert_array_equal(arrays["q"], ARRAYS["q"])


def test_pickled_array_is_refused(packed):
    buffer = io.BytesIO()
    np.save(buffer, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(io.BytesIO(packed)) as z:
        manifest = json.loads(z.read("manifest.json"))
    import hashlib

    manifest["sha256"]["arrays/q.npy"] = hashlib.sha256(buffer.getvalue()).hexdigest()
    forged = rewrite(rewrite(packed, "arrays/q.npy", buffer.getvalue()), "manifest.json", json.dumps(manifest).encode())
    with pytest.raises(FileError, match=r"arrays/q\.npy is not a plain array"):
        archive.unpack(forged, "m.truepose")


def test_a_map_names_the_software_that_wrote_it(packed):
    with zipfile.ZipFile(io.BytesIO(packed)) as z:
        assert json.loads(z.read("manifest.json"))["written_by"] == f"truepose {truepose.__version__}"


def test_newer_schema_is_told(packed):
    with zipfile.ZipFile(io.BytesIO(packed)) as z:
        manifest = json.loads(z.read("manifest.json"))
    manifest["schema"] = 99
    with pytest.raises(FileError, match=r"map schema 99, this version reads schema 1"):
        archive.unpack(rewrite(packed, "manifest.json", json.dumps(manifest).encode()), "m.truepose")


def test_other_zip_is_told():
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as z:
        z.writestr("manifest.json", "{}")
    with pytest.raises(FileError, match="not a truepose map"):
        archive.unpack(out.getvalue(), "m.truepose")


def test_nan_in_content_is_refused():
    with pytest.raises(ValueError, match="not JSON compliant"):
        archive.pack({"a": float("nan")}, {})


def repacked(data: bytes, way: str) -> bytes:
    """Return a file packed by another program."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(out, "w") as new:
        infos = old.infolist()
        for info in reversed(infos) if way == "order" else infos:
            method = zipfile.ZIP_STORED if way == "stored" else zipfile.ZIP_DEFLATED
            time = (2026, 1, 2, 3, 4, 6) if way == "times" else info.date_time
            level = {"level 9": 9, "level 1": 1}.get(way)
            new.writestr(zipfile.ZipInfo(info.filename, time), old.read(info), method, level)
    return out.getvalue()


WAYS = ("order", "stored", "times", "level 1", "level 9")


@pytest.mark.promise("A map that another program packed again is the same map.")
@pytest.mark.parametrize("way", WAYS)
def test_a_file_packed_again_is_the_same(way: str) -> None:
    rng = np.random.default_rng(4)
    content = {"notes": [f"sample {k} at {x:.4f} mm" for k, x in enumerate(rng.normal(size=300))]}
    data = archive.pack(content, {"e": rng.normal(size=(40, 3)), "e.b": np.arange(9)})
    other = repacked(data, way)
    assert other != data
    assert archive.as_written(other, "m") == archive.as_written(data, "m") == data


def test_a_file_of_another_zlib_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    real = zlib.compressobj
    data = archive.pack({"notes": ["a"] * 50 + list(range(50))}, {})
    with monkeypatch.context() as patch:  # two strategies of zlib stand for two programs
        patch.setattr(archive.zlib, "compressobj", lambda *_: real(9, zlib.DEFLATED, -15, 9, zlib.Z_HUFFMAN_ONLY))
        assert archive.as_written(data, "m") == data


@pytest.mark.parametrize("end", [0, 30, -30])
def test_a_damaged_file_is_refused(end: int) -> None:
    with pytest.raises(FileError):
        archive.as_written(archive.pack({}, {})[:end], "m")
