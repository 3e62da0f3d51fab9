"""A store knows of which robot a map and a cell are, and refuses the map of one robot for another."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from tests.store.plant import plant
from tests.store.test_watch import corrections, krl

import truepose as tp
from truepose.store import schema
from truepose.store.store import Store
from truepose.store.verify import verify

pytestmark = pytest.mark.usefixtures("quick_hashes")
_OPTIONS = ("--on-guard", "skip", "--accept-weak-map")
REASON = "the arm was exchanged"


def stated(text: str, robot_id: str | None) -> str:
    """Return a cell file with another id of its robot."""
    cell = tp.Cell.from_toml(text)
    robot = cell.robot.model_copy(update={"id": robot_id})
    report = cell.report.model_copy(update={"robot_serial": None})
    return cell.model_copy(update={"robot": robot, "report": report}).to_toml()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The cells of two robots of a type, each with its map; the first map states no id."""
    made = tmp_path / "line"
    for name, robot_id in (("a", None), ("b", "B-2")):
        shutil.copytree(plant().folder, made / name)
        text = stated((made / name / "cell.toml").read_text(), robot_id)
        (made / name / "cell.toml").write_text(text)
        error_map = tp.load_map(made / name / "map.truepose")
        error_map.changed(cell=tp.Cell.from_toml(text)).save(made / name / "map.truepose")
        for more in ("updated.truepose", "later.csv"):
            (made / name / more).unlink()
    (made / "part.src").write_text(krl())
    return made


def serials(address: str) -> dict[str, str | None]:
    with Store.open(address) as store:
        assert verify(store).faults == []
        with store.reading() as connection:
            return {row.name: row.serial for row in connection.execute(sa.select(schema.robot))}


@pytest.mark.promise("A store compares the robot of a map with that of the cell, by its id and by the cell file.")
def test_the_map_of_another_robot_is_refused(run: Callable[..., Any], folder: Path, address: str) -> None:
    assert run("store", "import", folder, "--store", address).code == 0
    assert serials(address) == {"a": None, "b": "B-2"}
    later = folder / "later.toml"  # the store alone knows that this is the cell of another robot
    later.write_text((folder / "a" / "cell.toml").read_text())
    common = (folder / "part.src", *_OPTIONS, "--store", address)
    for map_name, cell in (("a", folder / "b" / "cell.toml"), ("b", later)):
        command = ("correct", folder / map_name / "map.truepose", *common, "--cell", cell, "--out", folder / map_name)
        refused = run(*command).failed()
        assert "--other-robot REASON" in refused
        assert f"as of the robot {map_name}" in refused
        (folder / "in").mkdir(exist_ok=True)
        watched = ("watch", folder / map_name / "map.truepose", folder / "in", folder / "out", "--once", *_OPTIONS)
        assert "as of the robot" in run(*watched, "--store", address, "--cell", cell).failed()
        done = run(*command, "--other-robot", REASON)
        assert done.code == 0, done
    assert len(corrections(address)) == 2
    (sha,) = {tp.load_map(folder / "a" / "map.truepose").hash}
    shown = run("store", "recall", sha, "--store", address)
    assert f"part.src: corrected with the map of another robot, a: {REASON}" in " ".join(shown.out.split())
    listed = run("store", "recall", sha, "--store", address, "--json").json
    assert [one["other_robot"] for one in listed["corrections"]] == [REASON]
    assert REASON in run("store", "recall", sha, "--store", address, "--csv").out


@pytest.mark.promise("A store takes no correction with a map of another robot from a folder, unless it states why.")
@pytest.mark.parametrize("reason", ["", REASON])
def test_a_record_of_another_robot(run: Callable[..., Any], folder: Path, address: str, reason: str) -> None:
    assert run("store", "import", folder, "--store", address).code == 0
    (folder / "b" / "samples.csv").unlink()
    own = tp.load_map(folder / "a" / "map.truepose")
    cell = tp.load_cell(folder / "b" / "cell.toml")
    settings: dict[str, Any] = {"on_guard": "skip", "accept_weak_map": True, "other_robot": reason}
    tp.correct_program(folder / "part.src", own, cell, **settings).write(folder / "out")
    done = run("store", "import", folder, "--store", address)
    assert ("the store has this map as of the robot a" in done.out) is not bool(reason)
    assert len(corrections(address)) == bool(reason)


@pytest.mark.promise("An id that is stated later is kept, and a cell whose robot was exchanged needs another name.")
def test_an_id_that_is_stated_later(run: Callable[..., Any], folder: Path, address: str) -> None:
    assert run("store", "import", folder / "a", "--store", address).code == 0
    path = folder / "a" / "cell.toml"
    for robot_id, kept in (("A-1", "A-1"), (" a-1", " a-1"), ("A-9", " a-1")):
        path.write_text(stated(path.read_text(), robot_id))
        done = run("store", "import", path, "--store", address)
        assert done.code == 0, done
        assert serials(address) == {"a": kept}
        assert ("keep the cell of another robot under another name" in done.out) is (robot_id == "A-9")
