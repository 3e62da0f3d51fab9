"""Angles of a joint that no sample covers at the scale of the joint's own error."""

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.compensation import JointCoverage
from truepose.report.knowledge import knowledge

LENGTH = np.deg2rad([5.0])
ONE = np.array([0])


def coverage(*angles_deg):
    return JointCoverage(np.deg2rad(np.concatenate(angles_deg))[:, None], ONE, LENGTH)


def refused(found, *angles_deg):
    return [bool(reason) for reason in found.reasons(np.deg2rad(angles_deg)[:, None])]


def test_a_gap_is_told_with_joint_angle_nearest_sample_and_remedy():
    found = coverage(np.arange(-100, -39, 4), np.arange(40, 101, 4))
    assert refused(found, -110, -90, -21, -19, 0, 19, 21, 90, 110, 125) == [0, 0, 0, 1, 1, 1, 0, 0, 0, 1]
    reason = found.reasons(np.deg2rad([[10.0]]))[0]
    assert reason == (
        "no sample covers joint 1 at 10.0°: the nearest has joint 1 at 40.0°, limit 20.0°; "
        "measure a pose with joint 1 near 10°"
    )
    (gap,) = found.gaps()
    assert gap.to_dict() == {
        "joint": 1, "low_deg": -40.0, "high_deg": 40.0, "uncovered_low_deg": -20.0, "uncovered_high_deg": 20.0,
        "measure_deg": 0.0,
    }  # fmt: skip


@pytest.mark.parametrize("angle", [-179.0, 179.0])
def test_the_other_side_of_half_a_turn_is_not_near_unless_samples_show_it(angle):
    one_side = coverage(np.sign(angle) * np.arange(90, 176, 3))
    assert refused(one_side, angle, -angle) == [False, True]
    assert "a full turn away do not count" in one_side.reasons(np.deg2rad([[-angle]]))[0]
    both = coverage(np.sign(angle) * np.arange(90, 206, 3), -np.sign(angle) * np.arange(160, 180, 6))
    assert both.periodic == [True]
    assert refused(both, angle, -angle, -np.sign(angle) * 200.0) == [False, False, False]


def test_gaps_of_a_joint_that_turns_fully_are_found_once():
    found = coverage(np.arange(-350, -199, 3), np.arange(-160, 351, 3))
    assert found.periodic == [True]
    assert found.gaps() == []
    holed = coverage(np.arange(-350, -269, 3), np.arange(10, 90, 3), np.arange(190, 260, 3))
    assert [round(float(np.rad2deg(gap.high - gap.low))) for gap in holed.gaps()] == [102, 111]


def test_few_scattered_samples_widen_the_limit(rng):
    angle, new = rng.uniform(-170, 170, 40), rng.uniform(-170, 170, 2000)
    assert np.mean(refused(coverage(angle), *new)) < 0.02


def test_a_single_sample_covers_its_own_neighbourhood():
    assert refused(coverage([30.0]), 11, 30, 49, 51) == [False, False, False, True]
    assert coverage([30.0]).gaps() == []


@pytest.fixture(scope="module")
def holed():
    """The samples that were left out because of joint 4, and the map of others; a measured arm."""
    example = tp.load_example("ur10")
    angle = example.samples.q[:, 3]
    middle = np.median(angle)
    out = np.abs(angle - middle) < np.deg2rad(35.0)
    kept = np.flatnonzero(~out)
    rng = np.random.default_rng(0)
    error_map = tp.fit_cell(example.cell, example.samples[rng.permutation(kept)[:120]], "kinematic-kriging")
    return example.samples[np.abs(angle - middle) < np.deg2rad(5.0)], middle, error_map


def test_targets_in_a_gap_are_refused_whatever_the_deviation_is(holed):
    left_out, _, error_map = holed
    guards = error_map.guards_of(replace(error_map.limits_in_force().limits, max_std=np.inf, max_distance=10.0))
    reasons = guards.reasons(left_out.q, "rad", np.zeros((len(left_out), 3)), np.ones(len(left_out), bool))
    assert len(reasons) > 3
    assert all("no sample covers joint 4 at" in reason or "leverage" in reason for reason in reasons)
    assert any("measure a pose with joint 4 near" in reason for reason in reasons)
    known = error_map.samples.q
    assert not any(guards.reasons(known, "rad", np.zeros((len(known), 3)), np.ones(len(known), bool)))


def test_a_stated_gap_replaces_those_of_the_samples(holed):
    """In the limits of a correction, and in the cell that a map was fitted with; 360 switches the guard off."""
    left_out, _, error_map = holed
    limits = replace(error_map.limits_in_force().limits, max_std=np.inf, max_distance=10.0)

    def told(limit_deg):
        guards = error_map.guards_of(replace(limits, max_joint_gap=np.deg2rad(limit_deg)))
        reasons = guards.reasons(left_out.q, "rad", np.zeros((len(left_out), 3)), np.ones(len(left_out), bool))
        return any("no sample covers" in reason for reason in reasons)

    assert [told(one) for one in (5.0, 60.0, 360.0)] == [True, False, False]
    correction = error_map.cell.correction.model_copy(update={"max_joint_gap_deg": 360.0})
    off = error_map.changed(cell=error_map.cell.model_copy(update={"correction": correction}))
    assert off.joint_coverage is not None
    assert off.joint_coverage.gaps() == []
    assert off.limits_in_force().limits.max_joint_gap == pytest.approx(2.0 * np.pi)


def test_explain_lists_the_gap(holed, run, tmp_path):
    _, middle, error_map = holed
    assert any(gap.joint == 3 and gap.uncovered_low < middle < gap.uncovered_high for gap in knowledge(error_map).gaps)
    error_map.save(tmp_path / "map.truepose")
    done = run("explain", tmp_path / "map.truepose")
    assert done.code == 0, done.err
    assert "Angles that no sample covers" in done.out
    assert max(map(len, done.out.splitlines())) <= 80
    listed = run("explain", tmp_path / "map.truepose", "--json").json["joint_gaps"]
    assert 4 in [row["joint"] for row in listed]


def test_maps_without_joint_errors_have_no_such_guard():
    virtual = tp.VirtualCell("paper")
    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(20)), "registration")
    assert error_map.joint_coverage is None
    assert knowledge(error_map).gaps == []
