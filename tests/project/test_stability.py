"""docs/stability.md says what is so, and files of earlier versions are read as it says."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import truepose as tp
from truepose import cli
from truepose._io import archive
from truepose.errors import FileError, RefusedError
from truepose.predictors import LATER_PARAMETERS
from truepose.programs import ProgramVerification, record, verified
from truepose.programs.record import hashes_of, head_of
from truepose.report.records import read_record

HERE = Path(__file__).parent
PAGE = (HERE.parents[1] / "docs" / "stability.md").read_text("utf-8")
MAP = "kinematic-kriging.truepose"
VERSIONS = sorted(path.stem for path in (HERE / "versions").glob("*.zip"))


def block(title: str) -> list[str]:
    """Return the names in the text block that follows the paragraph with this title."""
    after = PAGE.partition(f"**{title}.**")[2].partition("```text\n")[2].partition("```")[0]
    return [" ".join(name.split()) for name in after.split(",")]


def rows(head: str) -> list[list[str]]:
    """Return the rows of the table with a head, as cells."""
    (found,) = re.findall(rf"^\| {re.escape(head)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.M)
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in found.splitlines()]


def test_the_page_lists_the_names_of_truepose() -> None:
    assert block("Names of `truepose`") == tp.__all__


def test_the_page_lists_the_commands() -> None:
    assert block("Commands and options") == sorted(commands(cli.app))


def commands(app: Any, before: str = "") -> list[str]:
    """Return the names of the commands of an application, with those of its groups."""
    own = [before + command.name for command in app.registered_commands]
    groups = [(group.typer_instance, f"{before}{group.name} ") for group in app.registered_groups]
    return own + [name for group in groups for name in commands(*group)]


def test_the_page_lists_the_exit_codes() -> None:
    assert [int(row[0]) for row in rows("code")] == [0, 1, 2, cli._INTERRUPTED, cli._BROKEN_PIPE]


def test_the_page_states_the_numbers_of_files() -> None:
    schema = pytest.importorskip("truepose.store.schema")
    stated = {row[0]: int(row[1]) for row in rows("file | number")}
    assert list(stated.values()) == [archive.SCHEMA, record.SCHEMA, verified.SCHEMA, schema.VERSION]
    number = schema.VERSION
    assert f"| store | number {number}; older ones, from 1 on," in PAGE
    assert f"numbers 1 to {number}; `store restore` brings it to number {number}" in PAGE


@pytest.fixture(scope="module", params=VERSIONS)
def kept(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files of a version, see tools/keep_version.py."""
    folder = tmp_path_factory.mktemp(request.param)
    with zipfile.ZipFile(HERE / "versions" / f"{request.param}.zip") as files:
        files.extractall(folder)
    return folder


def test_maps_of_earlier_versions_predict_the_same(kept: Path) -> None:
    stated = json.loads((kept / "predictions.json").read_text("utf-8"))
    assert len(stated["maps"]) >= 5
    for name, expected in stated["maps"].items():
        error_map = tp.load_map(kept / name)
        assert error_map.hash == expected["sha256"], name
        p, std = error_map.predict_measured(np.array(stated["q_rad"]))
        np.testing.assert_allclose(p, expected["p_mm"], rtol=0, atol=1e-6, err_msg=name)
        # 0.2.0 added a standard error of the nugget, which made deviations too large
        share = std / np.array(expected["std_mm"])
        assert 0.75 < share.min() <= share.max() <= 1.0 + 1e-6, name


def test_maps_of_earlier_versions_can_be_written_again(kept: Path, tmp_path: Path) -> None:
    error_map = tp.load_map(kept / MAP)
    error_map.save(tmp_path / "again.truepose")
    again = tp.load_map(tmp_path / "again.truepose")
    np.testing.assert_allclose(again.e, error_map.e)
    assert repr(again.predictor) == repr(error_map.predictor)


@pytest.mark.parametrize("change", ["without loss", "without terms", "with gear_harmonics only"])
def test_only_the_parameters_that_a_version_lacks_may_be_missing(kept: Path, tmp_path: Path, change: str) -> None:
    how, name = change.split()[:2]
    source = kept / ("calibration.truepose" if how == "without" else MAP)
    content, arrays = archive.unpack(source.read_bytes(), source)
    parameters = {
        key: value for key, value in content["predictor"]["parameters"].items() if key not in LATER_PARAMETERS
    }
    if how == "without":
        del parameters[name]
    else:
        parameters[name] = False
    path = tmp_path / "changed.truepose"
    predictor = {**content["predictor"], "parameters": parameters}
    path.write_bytes(archive.pack({**content, "predictor": predictor}, arrays))
    with pytest.raises(FileError, match=r"predictor\.parameters holds '\w+', which is not part of a map"):
        tp.load_map(path)


def test_records_of_earlier_versions_are_read(kept: Path) -> None:
    path = kept / "corrected" / "panel.corrections.json"
    found = read_record(path)
    assert (found.summary.corrected, found.program) == (2, "program/panel.src")
    assert [target.verdict for target in found.targets] == ["correct", "correct"]
    assert {name for name, _ in found.hashes} == {"panel.dat"}
    assert head_of(path)["map_sha256"] == tp.load_map(kept / MAP).hash
    assert len(hashes_of(path)) == 2


@pytest.mark.parametrize("by", ["record", "list"])
def test_programs_that_an_earlier_version_corrected_are_recognised(kept: Path, tmp_path: Path, by: str) -> None:
    """The record lies beside the program; the list beside the map, for a copy of the program elsewhere."""
    program = kept / "corrected" / "panel.src"
    if by == "list":
        for name in ("panel.src", "panel.dat"):
            (tmp_path / name).write_bytes((kept / "corrected" / name).read_bytes())
        program = tmp_path / "panel.src"
    frames = tp.FrameTable.from_config_dat(kept / "program" / "$config.dat")
    error_map = tp.load_map(kept / MAP)
    with pytest.raises(RefusedError, match="was corrected already"):
        tp.correct_program(program, error_map, frames=frames)
    assert tp.correct_program(kept / "program" / "panel.src", error_map, frames=frames).summary()["corrected"] == 2


def test_a_program_of_an_earlier_version_gets_the_same_correction(kept: Path) -> None:
    """Guards may become stricter; what passes them is corrected by the same map in the same way."""
    frames = tp.FrameTable.from_config_dat(kept / "program" / "$config.dat")
    error_map = tp.load_map(kept / MAP)
    corrected = tp.correct_program(kept / "program" / "panel.src", error_map, frames=frames)
    data = {path.name: content for path, content in corrected.files.items()}
    assert data == {name: (kept / "corrected" / name).read_bytes() for name in ("panel.src", "panel.dat")}


PROGRAM = ("program/panel.src", "--config-dat", "program/$config.dat")
OUTPUTS: dict[str, tuple[str, ...]] = {
    "fit": ("fit", "cell.toml", "samples.csv", "--predictor", "idw", "--out", "new.truepose"),
    "validate": ("validate", MAP, "samples.csv"),
    "explain": ("explain", MAP),
    "predict": ("predict", MAP, "samples.csv", "--out", "predicted.csv"),
    "update": ("update", MAP, "samples.csv"),
    "check": ("check", *PROGRAM),
    "frames": ("frames", *PROGRAM),
    "correct": ("correct", MAP, *PROGRAM, "--out", "new"),
    "plan": ("plan", "cell.toml", "--n", "12", "--out", "plan"),
    "similarity": ("similarity", "cell.toml", "samples.csv"),
}
SLOW = {"plan", "similarity"}
NEWEST = pytest.mark.parametrize("kept", VERSIONS[-1:], indirect=True)


def listed_keys() -> dict[str, set[str]]:
    return {output.strip("`"): set(re.findall(r"`(\w+)`", keys)) for output, keys in rows("output | keys")}


@NEWEST
@pytest.mark.parametrize(
    "output", [pytest.param(one, marks=[pytest.mark.exhaustive] * (one in SLOW)) for one in OUTPUTS]
)
def test_the_page_lists_the_keys_at_the_top_of_json(
    output: str, kept: Path, run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(kept)
    done = run(*OUTPUTS[output], "--json")
    assert done.code == 0, done.err
    assert listed_keys()[output] == done.json.keys()


@NEWEST
def test_the_page_lists_the_keys_of_files(kept: Path) -> None:
    frames = tp.FrameTable.from_config_dat(kept / "program" / "$config.dat")
    error_map = tp.load_map(kept / MAP)
    made = tp.correct_program(kept / "program" / "panel.src", error_map, frames=frames).to_dict()
    found = listed_keys()
    assert found["record of a correction"] == made.keys()
    assert found["target of a record"] == made["targets"][0].keys()
    fixed = {"format", "schema", "counts", "decision", "figures", "rule"}
    assert found["verification, `verify"] == fixed | {one.name for one in fields(ProgramVerification)}
    assert found.keys() == OUTPUTS.keys() | {"record of a correction", "target of a record", "verification, `verify"}
