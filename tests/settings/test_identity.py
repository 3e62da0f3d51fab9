"""A map is that of one robot, not of its type: the cell file of a twin is refused unless a reason is given."""

from __future__ import annotations

import json

import pytest

import truepose as tp
from truepose.cell import load_cell, template, write_template
from truepose.errors import DataError, RefusedError

SAME = (("A-17", "A-17"), ("A-17", " a-17"))
OTHERS = (("A-17", "A-18"), ("robot-1f3a9c22", "robot-77aa0b13"))


def named(cell: tp.Cell, robot_id: str | None, serial: str | None = None) -> tp.Cell:
    robot, report = (
        cell.robot.model_copy(update={"id": robot_id}),
        cell.report.model_copy(update={"robot_serial": serial}),
    )
    return cell.model_copy(update={"robot": robot, "report": report})


@pytest.fixture
def of_robot(error_map):
    return lambda robot_id, serial=None: error_map.changed(cell=named(error_map.cell, robot_id, serial))


@pytest.mark.parametrize(("mine", "theirs"), OTHERS)
@pytest.mark.parametrize("by_serial", [False, True])
def test_the_cell_of_a_twin_is_refused(of_robot, krl, mine, theirs, by_serial):
    error_map = of_robot(mine)
    cell = named(error_map.cell, None, theirs) if by_serial else named(error_map.cell, theirs)
    with pytest.raises(RefusedError, match=f"map is of the robot '{mine}', the cell file of '{theirs}'.*--other-robot"):
        tp.correct_program(krl(), error_map, cell)
    done = tp.correct_program(krl(), error_map, cell, other_robot="the arm was exchanged, checked on 4 points")
    assert [one for one in done.warnings if "exchanged" in one]


@pytest.mark.parametrize(("mine", "theirs"), SAME)
def test_the_same_robot_is_corrected_without_a_word(of_robot, krl, mine, theirs):
    error_map = of_robot(mine)
    done = tp.correct_program(krl(), error_map, named(error_map.cell, theirs))
    assert not [one for one in done.warnings if "robot of the map" in one]


def test_an_unknown_identity_is_said(of_robot, krl):
    for mine, theirs, why in (("A", None, "the cell file states none"), (None, "A", "the map was fitted without one")):
        error_map = of_robot(mine)
        done = tp.correct_program(krl(), error_map, named(error_map.cell, theirs))
        assert [one for one in done.warnings if why in one]
    error_map = of_robot(None)
    done = tp.correct_program(krl(), error_map, named(error_map.cell, None))
    assert not [one for one in done.warnings if "robot of the map" in one]


def test_a_new_cell_has_an_identity(run, tmp_path):
    ids = set()
    for name in ("one", "two"):
        assert run("init", tmp_path / name, "--robot", "kuka-kr150-2").code == 0
        ids.add(load_cell(tmp_path / name / "cell.toml").robot_id)
    assert len(ids) == 2
    assert None not in ids
    assert run("init", tmp_path / "three", "--robot", "kuka-kr150-2", "--id", 'S "7"').code == 0
    assert load_cell(tmp_path / "three" / "cell.toml").robot_id == 'S "7"'
    assert load_cell(write_template(tmp_path / "four", "kuka-kr150-2")).robot_id
    assert tp.Cell.from_toml(template("kuka-kr150-2")).robot_id is None


def test_the_commands_refuse_and_record(run, of_robot, krl, tmp_path):
    of_robot("A-17").save(tmp_path / "map.truepose")
    cell = of_robot("A-18").cell
    (tmp_path / "b.toml").write_text(cell.to_toml())
    path = krl()
    common = ("correct", tmp_path / "map.truepose", path, "--cell", tmp_path / "b.toml", "--out", tmp_path / "out")
    refused = run(*common)
    assert "take the map of this robot" in refused.failed()
    assert not (tmp_path / "out").exists()
    done = run(*common, "--other-robot", "same arm, new plate")
    assert done.code == 0, done.err
    record = json.loads((tmp_path / "out" / "a.corrections.json").read_text("utf-8"))
    assert any("same arm, new plate" in one for one in record["warnings"])


@pytest.mark.promise("Of which robot an old map is, is asked for once: what is stated is kept, and another is refused.")
@pytest.mark.parametrize("other_user", [False, True])
def test_an_old_map_is_asked_about_once(of_robot, krl, tmp_path, monkeypatch, other_user):
    of_robot(None).save(tmp_path / "map.truepose")
    error_map = tp.load_map(tmp_path / "map.truepose")
    cell, other = named(error_map.cell, "A-17"), named(error_map.cell, "A-18")

    def question(**how):
        return [one for one in tp.correct_program(krl(), error_map, cell, **how).warnings if "is not known" in one]

    assert "state it once with --this-robot (Python: this_robot=True)" in question()[0]
    assert question() != []  # nothing was stated
    tp.correct_program(krl(), error_map, cell, this_robot=True).write(tmp_path / "out")
    if other_user:  # who has the map, too
        monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "other"))
    assert question() == []
    with pytest.raises(RefusedError, match="map is of the robot 'A-17', the cell file of 'A-18'"):
        tp.correct_program(krl(), error_map, other)
    with pytest.raises(RefusedError, match="A-17"):  # one statement does not replace another
        tp.correct_program(krl(), error_map, other, this_robot=True)
    record = json.loads((tmp_path / "out" / "a.corrections.json").read_text("utf-8"))
    assert record["robot"] == {"cell": "A-17", "stated": "A-17"}


def test_an_old_cell_says_what_to_write(of_robot, krl):
    error_map = of_robot("A-17")
    done = tp.correct_program(krl(), error_map, named(error_map.cell, None))
    assert [one for one in done.warnings if 'write id = "A-17" under [robot] in the cell file' in one]
    with pytest.raises(DataError, match=r'names no robot; write id = "A-17" under \[robot\]'):
        tp.correct_program(krl(), error_map, named(error_map.cell, None), this_robot=True)
