"""A stated repeatability that no such robot has makes no map too sure of itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import truepose as tp
from truepose.cell import Cell
from truepose.error_map.campaign import check_campaign
from truepose.error_map.repeatability import USUAL_RP_MM, Repeatability
from truepose.error_map.validation import motion_noise
from truepose.robots.data_sheet import DataSheet
from truepose.simulation import VirtualCell


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("hard", seed=4)


@pytest.fixture(scope="module")
def samples(virtual: VirtualCell) -> Any:
    return virtual.measure(virtual.design(40, seed=1), seed=1)


def stating(cell: Cell, repeatability_mm: float | None) -> Cell:
    return cell.model_copy(update={"robot": cell.robot.model_copy(update={"repeatability_mm": repeatability_mm})})


@pytest.mark.sampled(1)
@pytest.mark.parametrize("predictor", ["kinematic-kriging", "ordinary-kriging", "calibration"])
def test_a_slip_is_as_the_data_sheet(virtual: VirtualCell, samples: Any, predictor: str) -> None:
    wanted = tp.fit_cell(stating(virtual.cell, USUAL_RP_MM), samples, predictor)
    q = virtual.design(10, seed=2)
    for slip in (3.1 * USUAL_RP_MM, 0.51, 5.1, 60.0):
        found = tp.fit_cell(stating(virtual.cell, slip), samples, predictor)
        np.testing.assert_array_equal(found.predict(q).std, wanted.predict(q).std)
        assert found.limits_in_force().values == wanted.limits_in_force().values
        assert found.campaign == wanted.campaign
        fact = next(fact for fact in found.facts if fact.code == "repeatability")
        assert (fact.effect, fact.size, fact.unit) == ("widens", slip, "mm")
        assert f"repeatability_mm = {slip:g} is not believed" in fact.words
        np.testing.assert_array_equal(motion_noise(found, samples), motion_noise(wanted, samples))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("share", [0.5, 1.0, 2.9])
def test_a_credible_value_is_believed(virtual: VirtualCell, samples: Any, share: float) -> None:
    found = tp.fit_cell(stating(virtual.cell, share * USUAL_RP_MM), samples, "ordinary-kriging")
    assert "repeatability" not in {fact.code for fact in found.facts}
    assert found.limits_in_force().values["max_std_mm"] == pytest.approx(4.0 * share * USUAL_RP_MM)


def test_a_slip_in_the_cell_file_of_correct_raises_no_limit(virtual: VirtualCell, samples: Any) -> None:
    fitted = tp.fit_cell(stating(virtual.cell, USUAL_RP_MM), samples, "ordinary-kriging")
    limits = fitted.limits_in_force(stating(virtual.cell, 5.1))
    assert limits.values["max_std_mm"] == fitted.limits_in_force().values["max_std_mm"]
    assert limits.origin["max_std_mm"] == "default: 4 times the usual repeatability"


def test_a_robot_with_a_data_sheet_is_held_to_it(virtual: VirtualCell, samples: Any) -> None:
    fitted = tp.fit_cell(stating(virtual.cell, 0.03), samples, "ordinary-kriging")
    robot = replace(fitted.robot, data_sheet=DataSheet(reach_mm=2700, repeatability_mm=0.03))
    found = {stated: Repeatability.of(stating(virtual.cell, stated), robot) for stated in (0.08, 0.1, 0.3)}
    assert [one.known for one in found.values()] == [0.08, 0.03, 0.03]
    assert "the data sheet of this robot says 0.03 mm; 0.03 mm is used" in found[0.3].doubt
    limits = [
        check_campaign(stating(virtual.cell, stated), robot, samples, fitted.registration, fitted.tf_flange_tool).limit
        for stated in (0.03, 0.3)
    ]
    assert limits[0] == limits[1]


def test_the_commands_say_it(virtual: VirtualCell, samples: Any, tmp_path: Path, run: Any) -> None:
    (tmp_path / "cell.toml").write_text(stating(virtual.cell, 5.1).to_toml(), "utf-8")
    tp.write_samples(tmp_path / "samples.csv", samples)
    out = tmp_path / "cell.truepose"
    fitted = run("fit", tmp_path / "cell.toml", tmp_path / "samples.csv", "--out", out, "--predictor", "idw")
    assert fitted.code == 0, fitted.err
    assert "repeatability_mm = 5.1 is not believed" in " ".join((fitted.out + fitted.err).split())
