"""The noise of rounded numbers is known, and no error of the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.error_map.arm_check import check_arm
from truepose.error_map.rounding import rounding_variance
from truepose.simulation import PRESETS


def measured(decimals_mm: int, decimals_deg: int, n: int = 60, seed: int = 3) -> tuple[tp.VirtualCell, tp.Samples]:
    preset = replace(PRESETS["rounding"], decimals_mm=decimals_mm, decimals_deg=decimals_deg)
    virtual = tp.VirtualCell(preset, seed=seed)
    return virtual, virtual.measure(virtual.design(n, seed=seed), seed=seed)


def variance(virtual: tp.VirtualCell, samples: tp.Samples) -> np.ndarray:
    tool = virtual.cell.tf_flange_tool
    return rounding_variance(virtual.robot, samples, tool, check_arm(virtual.robot, samples, tool))


def test_it_is_that_of_readings_and_of_joints_at_the_end_of_the_arm() -> None:
    virtual, samples = measured(1, 2)
    q = virtual.design(60, seed=3)
    exact = virtual.robot.forward(q, tool=virtual.tf_flange_tool)[:, :3, 3]
    rounded = virtual.robot.forward(samples.q, tool=virtual.tf_flange_tool)[:, :3, 3]
    expected = np.mean((rounded - exact) ** 2, axis=0) + 0.1**2 / 12.0
    np.testing.assert_allclose(variance(virtual, samples).mean(axis=0), expected, rtol=0.35)


def test_joints_with_few_digits_that_agree_with_the_commands_are_exact() -> None:
    """As those of a program that was planned so: the command has digits of its own."""
    virtual, samples = measured(1, 2)
    p_cmd = np.round(virtual.robot.forward(samples.q, tool=virtual.tf_flange_tool)[:, :3, 3], 3)
    exact = variance(virtual, replace(samples, p_cmd=p_cmd))
    np.testing.assert_allclose(exact, 0.1**2 / 12.0, rtol=1e-3)
    alone = variance(virtual, replace(samples, p_cmd=None, rotation_cmd=None))  # not known
    np.testing.assert_allclose(alone, 0.1**2 / 12.0, rtol=1e-9)


def test_samples_with_all_digits_have_none() -> None:
    virtual = tp.VirtualCell("hard", seed=3)
    assert not variance(virtual, virtual.measure(virtual.design(40))).any()


@pytest.mark.promise("95 % intervals hold true errors, and are not too wide, where all numbers were rounded")
@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.exhaustive) for seed in range(4, 8))])
def test_a_map_of_rounded_numbers_is_not_far_too_cautious(seed: int) -> None:
    virtual, samples = measured(1, 2, seed=seed)
    found = tp.fit_cell(virtual.cell, samples, "kinematic-kriging")
    assert found.rounding(found.samples, found.arm_check).mean() > 0.05**2
    first, step = virtual.preset.first_reading_s, virtual.preset.seconds_per_reading
    time = np.linspace(first, first + step * 59, 150)
    new = virtual.measure(virtual.design(150, seed=seed + 50), seed=seed + 50, time=time)
    assert 0.9 < found.validate(new)["coverage"]["within_95"] < 0.99
    # 0.083 mm of rounding in each direction are no error of the arm
    assert np.sqrt(found.unexplained.mean()) < 0.06
