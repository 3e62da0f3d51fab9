"""The limits that a user states hold, whoever asks, and the record says who stated them."""

import json

import numpy as np
import pytest

import truepose as tp
from truepose.cell.sections import Correction
from truepose.errors import DataError, RefusedError
from truepose.programs import read_program

TIGHT = "max_correction_mm = 0.05\n"


def with_correction(text: str, lines: str) -> str:
    return text + f"\n[correction]\n{lines}"


@pytest.mark.promise("The limits of `truepose correct --cell FILE` hold, and the record names their origin.")
def test_the_cell_file_of_correct_limits_the_corrections(run, krl, map_path, cell_text, tmp_path):
    path, cell = krl(), tmp_path / "cell.toml"
    assert run("correct", map_path, path, "--out", tmp_path / "free").code == 0
    cell.write_text(with_correction(cell_text, TIGHT))
    arguments = ("correct", map_path, path, "--cell", cell, "--out", tmp_path / "out")
    assert "larger than the limit of 0.05 mm" in run(*arguments).failed()
    done = run(*arguments, "--on-guard", "clip", "--json")
    assert done.code == 0, done.err
    record = json.loads((tmp_path / "out" / "a.corrections.json").read_text())
    corrections = [np.linalg.norm(target["correction_mm"]) for target in record["targets"]]
    assert {target["verdict"] for target in record["targets"]} == {"clip"}
    assert max(corrections) <= 0.05 + 2e-3  # the digits of the program
    assert record["limits"]["max_correction_mm"] == {"value": 0.05, "origin": "cell file"}
    assert record["limits"]["on_guard"] == {"value": "clip", "origin": "option"}
    assert record["limits"]["max_tool_mm"]["origin"] == "default"
    assert "max_correction_mm 0.05 (cell file)" in run(*arguments[:-1], tmp_path / "again", "--on-guard", "clip").out


LIMITS = {
    "max_std_mm": 1e-4,
    "max_correction_mm": 1e-3,
    "max_distance_mm": 1e-6,
    "max_angle_deg": 1e-6,
    "max_tool_mm": 1e-6,
}


@pytest.mark.promise("Every limit of [correction] in a cell file has an effect on a correction.")
def test_every_limit_of_a_cell_file_has_an_effect(error_map, cell_text, krl, virtual, record_property):
    own = tp.Cell.from_toml(cell_text)
    other_tool = own.frames.tools[1].model_copy(update={"x_mm": float(virtual.tf_flange_tool[0, 3]) + 0.5})
    frames = own.frames.model_copy(update={"tools": {1: other_tool}})
    path = krl(turn=0.1)
    for key, value in LIMITS.items():
        free = own.model_copy(update={"frames": frames, "correction": Correction(max_angle_deg=90.0)})
        assert tp.correct_program(path, error_map, free, on_guard="skip").summary()["corrected"] == 2
        stated = Correction(**{"max_angle_deg": 90.0, key: value})
        limited = free.model_copy(update={"correction": stated})
        with pytest.raises(RefusedError):
            tp.correct_program(path, error_map, limited)
        assert error_map.limits_in_force(limited).to_dict()[key] == {"value": value, "origin": "cell file"}
    record_property("cases", len(LIMITS))


@pytest.mark.promise("Without a cell the limits of the map's cell hold; a cell file changes only what it states.")
def test_origins_are_told_apart(cell_text, samples, tmp_path):
    cell = tp.Cell.from_toml(with_correction(cell_text, "max_correction_mm = 5.0\nmax_std_mm = 0.3\n"))
    tp.fit_cell(cell, samples, "idw").save(tmp_path / "map.truepose")
    error_map = tp.load_map(tmp_path / "map.truepose")  # what was stated is told from defaults in the file, too
    other = tp.Cell.from_toml(with_correction(cell_text, "max_std_mm = 0.2\n"))
    found = error_map.limits_in_force(other, on_guard="skip")
    assert found.origin["max_correction_mm"] == "map"
    assert found.origin["max_tool_mm"] == "default"
    assert found.origin["max_distance_mm"].startswith("default: ")
    assert (found.values["max_std_mm"], found.origin["max_std_mm"]) == (0.2, "cell file")
    assert (found.on_guard, found.origin["on_guard"]) == ("skip", "option")
    assert found.limits.max_std == 0.2
    assert error_map.limits_in_force().limits.max_std == 0.3


@pytest.mark.promise("A limit that can have no effect on the map is refused.")
def test_a_distance_of_the_other_space_is_refused():
    from truepose.compensation import LimitsInForce

    with pytest.raises(DataError, match=r"max_distance_mm \(cell file\) has no effect on a map in joint space"):
        LimitsInForce.of(("cell file", {"max_distance_mm": 200.0, "on_guard": "refuse"}), space="joint")
    both = ("cell file", {"max_distance_mm": 200.0, "max_distance_deg": 30.0})
    assert LimitsInForce.of(both, space="joint").limits.max_distance == pytest.approx(np.deg2rad(30.0))
    assert LimitsInForce.of(both).limits.max_distance == 200.0


@pytest.mark.promise("`tp.correct_program(path, map, cell)` and the command give the same result, `on_guard` included.")
def test_function_and_command_give_the_same(run, krl, map_path, error_map, cell_text, tmp_path, record_property):
    policies = [None, "skip", "clip"]
    path = krl(rows=slice(4))
    for k, policy in enumerate(policies):
        lines = TIGHT.replace("0.05", "0.3") + (f'on_guard = "{policy}"\n' if policy else "")
        file = tmp_path / f"{k}.toml"
        file.write_text(with_correction(cell_text, lines))
        out = tmp_path / f"out{k}"
        done = run("correct", map_path, path, "--cell", file, "--out", out)
        if policy is None:
            with pytest.raises(RefusedError) as refused:
                tp.correct_program(path, error_map, tp.load_cell(file))
            assert done.failed().strip() == f"truepose: {refused.value}"
            continue
        corrected = tp.correct_program(path, error_map, tp.load_cell(file))
        assert done.code == 0, done.err
        assert corrected.on_guard == policy
        assert corrected.files[path] == (out / "a.src").read_bytes()
        record = json.loads((out / "a.corrections.json").read_text())
        assert corrected.to_dict() == record
    record_property("cases", len(policies))


@pytest.mark.promise("Without a cell `correct_program` uses the frames and the policy of the map's own cell.")
def test_the_maps_own_cell_is_used(run, krl, cell_text, samples, tmp_path):
    cell = tp.Cell.from_toml(with_correction(cell_text, TIGHT + 'on_guard = "clip"\n'))
    error_map = tp.fit_cell(cell, samples, "ordinary-kriging")
    error_map.save(tmp_path / "own.truepose")
    path = krl()  # its tool is number 1, which only the cell knows
    corrected = tp.correct_program(path, error_map)
    assert corrected.on_guard == "clip"
    assert corrected.limits.origin["on_guard"] == "map"
    assert set(corrected.targets.code.tolist()) == {2}
    assert run("correct", tmp_path / "own.truepose", path, "--out", tmp_path / "out").code == 0
    assert corrected.files[path] == (tmp_path / "out" / "a.src").read_bytes()


@pytest.mark.promise("Settings that cannot have an effect on a program that was read already are refused.")
def test_settings_of_the_reader_come_too_late(krl, error_map, cell_text):
    from truepose.programs import FrameTable, ReadOptions

    frames = FrameTable.from_cell(tp.Cell.from_toml(cell_text))
    program = read_program(krl(), frames)
    assert tp.correct_program(program, error_map).summary()["corrected"] == 2
    for more in ({"frames": frames}, {"options": ReadOptions()}):
        with pytest.raises(DataError, match="was read already: frames and options have no effect"):
            tp.correct_program(program, error_map, **more)
    with pytest.raises(DataError, match="was read for positions"):
        tp.correct_program(program, error_map, orientation=True)
