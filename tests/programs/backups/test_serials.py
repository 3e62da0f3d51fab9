"""A backup that names the serial number of its robot is compared with the robot of the map."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest
from tests.programs.backups import kuka, small

from truepose.cell import Cell, template
from truepose.errors import RefusedError
from truepose.programs import read_programs
from truepose.programs.agreement import check_serial
from truepose.programs.backups.backup import Controller
from truepose.programs.batch import correct_programs

CELL = Cell.from_toml(template("kuka-kr16-2"))


def named(robot_id: str | None = None, serial: str | None = None) -> Cell:
    robot = CELL.robot.model_copy(update={"id": robot_id})
    return CELL.model_copy(update={"robot": robot, "report": CELL.report.model_copy(update={"robot_serial": serial})})


def correct(folder: Path, make_map: Any, own: Cell, cell: Cell | None = None, **settings: Any) -> list[str]:
    """Correct a backup with the map of a cell; return what is said of serial numbers."""
    error_map = make_map([0.2, 0.0, 0.1])
    error_map.robot, error_map.cell, error_map.path = own.load_robot(), own, None
    error_map.tf_flange_tool = own.tf_flange_tool
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        correct_programs([folder], error_map, cell, on_guard="skip", keep_going=True, **settings)
    return [str(one.message) for one in caught if "serial number" in str(one.message)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("backup")
    small.lay(made, kuka.backup())
    return made


@pytest.fixture(scope="module")
def controller(folder: Path) -> Controller:
    (found,) = read_programs([folder]).backups[0].controllers
    return found


def test_the_serial_number_is_read(controller: Controller) -> None:
    assert controller.contents.serial == "500123"


@pytest.mark.promise("A backup of a robot with another serial number is refused, or named where the map states none.")
@pytest.mark.parametrize(
    ("own", "cell", "said"),
    [
        (named("500123"), None, ""),
        (named("0500123"), None, ""),
        (named(), None, ""),
        (named("left arm", "500123"), None, ""),
        (named("left arm"), named("left arm", "500123"), ""),
        (named("left arm"), None, 'write robot_serial = "500123" under [report] in the cell file'),
        (named("left arm"), named("left arm"), "the map is of 'left arm'"),
    ],
)
def test_the_serial_number_is_compared(controller: Controller, own: Cell, cell: Cell | None, said: str) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_serial(controller, [own, cell] if cell else [own])
    found = [str(one.message) for one in caught]
    assert len(found) == bool(said)
    assert said in "".join(found)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("own", "cell"),
    [(named(None, "7"), None), (named("left arm", "7"), None), (named("left arm"), named("left arm", "7"))],
)
def test_another_serial_number_is_refused(folder: Path, make_map: Any, own: Cell, cell: Cell | None) -> None:
    with pytest.raises(RefusedError, match=r"serial number 500123, the map .* of 7; .*--other-robot"):
        correct(folder, make_map, own, cell)
    (said,) = correct(folder, make_map, own, cell, other_robot="a new arm")
    assert "accepted, with the reason: a new arm" in said
