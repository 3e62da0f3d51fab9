"""What a folder holds for a store: objects by their content, each once, and a reason for each file left out."""

from __future__ import annotations

import json
import shutil

import pytest
from tests.store.plant import plant

from truepose.errors import FileError
from truepose.store.folder import kind_of, read_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cell's folder, with a copy of the samples, a truncated map, a link and files that are no objects."""
    folder = tmp_path_factory.mktemp("mixed") / "cell"
    shutil.copytree(plant().folder, folder)
    shutil.copy(folder / "samples.csv", folder / "samples-copy.csv")
    (folder / "bad.truepose").write_bytes((folder / "map.truepose").read_bytes()[:500])
    (folder / "panel.corrections.json").write_text(json.dumps({"format": "truepose corrections", "files": 3}))
    (folder / "link.truepose").symlink_to(folder / "map.truepose")
    (folder / ".hidden").mkdir()
    shutil.copy(folder / "map.truepose", folder / ".hidden" / "map.truepose")
    return folder


def test_objects_are_recognised_and_ordered_by_what_they_depend_on(folder):
    found = read_folder(folder)
    assert [(one.kind, one.path.name) for one in found.objects] == [
        ("cell", "cell.toml"),
        ("samples", "later.csv"),
        ("samples", "samples-copy.csv"),
        ("map", "map.truepose"),
        ("map", "updated.truepose"),
    ]
    assert found.others == 2  # the program and the readings
    assert found.objects[-2].content.hash == found.objects[-2].sha256


def test_each_file_left_out_has_its_reason(folder):
    left = {one.path.name: one.reason for one in read_folder(folder).left_out}
    assert set(left) == {"samples.csv", "bad.truepose", "panel.corrections.json"}
    assert left["samples.csv"] == f"has the same content as {folder / 'samples-copy.csv'}"
    assert "record" in left["panel.corrections.json"]


def test_one_file_is_a_folder_of_one(folder):
    assert [one.kind for one in read_folder(folder / "map.truepose").objects] == ["map"]
    with pytest.raises(FileError, match="no such folder"):
        read_folder(folder / "nothing")


@pytest.mark.parametrize(
    ("name", "start", "kind"),
    [
        ("plan.csv", b"row,q1_deg\n", None),
        ("s.CSV", b"\xef\xbb\xbfx_meas_mm,y_meas_mm,z_meas_mm,q1_deg\r\n1,2,3,4", "samples"),
        ("v.json", b'{"format": "truepose verification"', "verification"),
        ("other.json", b"{}", None),
        ("pyproject.toml", b"[project]", None),
        ("robot17.toml", b"[robot]\n[tracker]\n", "cell"),
    ],
)
def test_kinds_by_name_and_first_bytes(tmp_path, name, start, kind):
    assert kind_of(tmp_path / name, start) == kind
