"""Identified parameters are judged before they are used: zeros, lengths, lost motion, load, residual."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.error_map import judgement
from truepose.errors import RefusedError
from truepose.simulation.presets import PRESETS

CASE = Path(__file__).parents[3] / "shared" / "cases" / "zero-of-a-joint"
JUDGED = ("joint-zero", "link-off", "negative-lost-motion", "rises-under-load", "unexplained")


def judged(error_map):
    """Return the facts about parameters by code."""
    return {fact.code: fact for fact in error_map.facts if fact.code in JUDGED}


def with_zero(preset, joint, degrees, n=60):
    """Return a cell and samples of an arm one joint of which stands elsewhere than its controller says."""
    virtual = tp.VirtualCell(preset, seed=2)
    q = virtual.design(n, seed=1)
    away = np.deg2rad(degrees) * (np.arange(q.shape[1]) == joint)
    return virtual.cell, replace(virtual.measure(q + away), q=q, p_cmd=None, rotation_cmd=None)


def with_link(preset, which, link, mm, n=60):
    """Return a cell and samples of an arm one length of which differs from its model's."""
    virtual = tp.VirtualCell(preset, seed=2)
    real = virtual.truth.robot
    lengths = getattr(real, which) + mm * (np.arange(real.dof) == link)
    virtual.truth = replace(virtual.truth, robot=replace(real, **{which: lengths}))
    return virtual.cell, virtual.measure(virtual.design(n, seed=1))


@pytest.mark.parametrize("predictor", ["kinematic-kriging", "calibration"])
@pytest.mark.parametrize(("preset", "joint", "degrees"), [("hard", 3, 1.4), ("paper", 2, -1.4), ("hard", 1, 0.6)])
@pytest.mark.sampled(2)
def test_the_zero_of_a_joint_is_named(predictor, preset, joint, degrees):
    cell, samples = with_zero(preset, joint, degrees)
    error_map = tp.fit_cell(cell, samples, predictor)
    fact = judged(error_map)["joint-zero"]
    assert fact.words.startswith(f"joint {joint + 1}: ")
    assert fact.unit == "deg"
    own = error_map.robot.sign[joint] * degrees
    assert abs(fact.size - own) < max(3.0 * fact.std, 0.05)
    with pytest.raises(RefusedError, match=f"joint {joint + 1}: .*° ± .*°.*--accept joint-zero"):
        error_map.refuse_to_correct()
    assert error_map.refuse_to_correct({"joint-zero"})


@pytest.mark.skipif(not CASE.exists(), reason="the shared cases are not here")
@pytest.mark.parametrize("predictor", ["kinematic-kriging", "calibration"])
def test_the_joint_that_was_mastered_again(predictor):
    cell = tp.load_cell(CASE / "cell" / "cell.toml")
    now, before = (
        judged(tp.fit_cell(cell, tp.read_samples(CASE / name), predictor)) for name in ("samples.csv", "old.csv")
    )
    assert not before
    assert [*now] == ["joint-zero"]
    fact = now["joint-zero"]
    assert "joint 4: −1.398° ± 0.00" in fact.words
    assert "mastered again" in fact.words
    assert fact.size == pytest.approx(-1.4, abs=0.005)
    assert fact.std < 0.006


@pytest.mark.parametrize(
    ("predictor", "preset"),
    [("kinematic-kriging", "hard"), ("calibration:terms=compliance", "hard"), ("calibration", "paper")],
)
@pytest.mark.parametrize(("which", "link", "mm"), [("a", 2, -5.0), ("a", 1, 5.0)])
@pytest.mark.sampled(2)
def test_a_wrong_length_is_named(predictor, preset, which, link, mm):
    cell, samples = with_link(preset, which, link, mm)
    error_map = tp.fit_cell(cell, samples, predictor)
    fact = judged(error_map)["link-off"]
    assert f"link {link + 1}: the length {which}{link + 1} is off by" in fact.words
    assert "D-H table" in fact.words
    assert fact.size == pytest.approx(mm, abs=0.6)
    with pytest.raises(RefusedError, match="accept link-off"):
        error_map.correct(samples)


@pytest.fixture(scope="module")
def reversing():
    """A cell with lost motion, and samples that its joints reached from both sides."""
    virtual = tp.VirtualCell("backlash", seed=2)
    return virtual.cell, virtual.measure(virtual.design(100, seed=1))


@pytest.mark.parametrize("wrong", [(0, 1, 2, 3, 4, 5), (2,)])
@pytest.mark.sampled(1)
def test_negative_lost_motion_is_refused(reversing, wrong):
    """With directions of approach of the wrong sign, of all joints or of one."""
    cell, samples = reversing
    sign = np.where(np.isin(np.arange(6), wrong), -1.0, 1.0)
    error_map = tp.fit_cell(cell, replace(samples, approach=sign * samples.approach), "kinematic-kriging")
    fact = judged(error_map)["negative-lost-motion"]
    assert f"joint {wrong[-1] + 1} −0.0" in fact.words or len(wrong) > 1
    assert fact.size < -3.0 * fact.std
    with pytest.raises(RefusedError, match=r"check the directions of approach \(approach1 …\)"):
        error_map.correct(samples)


def test_an_arm_that_rises_under_load_is_refused():
    """With the payloads of the other rows, the arm seems to rise when it is loaded."""
    virtual = tp.VirtualCell("hard", seed=2)
    q = virtual.design(80, seed=1)
    samples = virtual.measure(q, payload_kg=np.where(np.arange(80) % 2, 0.0, 120.0))
    assert not judged(tp.fit_cell(virtual.cell, samples, "kinematic-kriging"))
    swapped = replace(samples, load=120.0 - samples.load)
    error_map = tp.fit_cell(virtual.cell, swapped, "kinematic-kriging")
    fact = judged(error_map)["rises-under-load"]
    assert fact.size > 1.0
    assert fact.unit == "mm"
    assert "most by joint 2" in fact.words
    with pytest.raises(RefusedError, match="check the payloads"):
        error_map.correct(samples)


def test_a_joint_that_turns_against_gravity_is_refused():
    """Calibration knows compliance in rad/Nm; a negative mass is what a wrong sign comes to."""
    virtual = tp.VirtualCell("hard", seed=2)
    cell, samples = virtual.cell, virtual.measure(virtual.design(60, seed=1))
    model = tp.fit_cell(cell, samples, "calibration:terms=compliance").predictor
    found = model.parameter_estimates()
    own = [k for k, kind in enumerate(found.kinds) if kind == "compliance"]
    assert not [*judgement._of_load(found, found.mean, found.covariance)]
    mean = np.where(np.isin(np.arange(len(found.mean)), own), -found.mean, found.mean)
    (fact,) = judgement._of_load(found, mean, found.covariance)
    assert "turns against gravity" in fact.words
    assert fact.unit == "µrad/Nm"


def test_readings_of_other_rows_are_unexplained():
    """Where even the identified arm leaves ten times the repeatability, the readings are not those of this arm."""
    virtual = tp.VirtualCell("hard", seed=2)
    samples = virtual.measure(virtual.design(60, seed=1))
    noisy = samples.p_meas + np.random.default_rng(0).normal(0.0, 1.0, samples.p_meas.shape)
    error_map = tp.fit_cell(virtual.cell, replace(samples, p_meas=noisy), "kinematic-kriging")
    fact = judged(error_map)["unexplained"]
    assert "another robot than the model's" in fact.words
    assert fact.size > 1.0


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("n", [15, 60])
@pytest.mark.parametrize("predictor", ["kinematic-kriging", "calibration:terms=compliance"])
@pytest.mark.sampled(3)
def test_no_virtual_cell_in_its_ordinary_state_is_judged(preset, n, predictor):
    """Also with few samples."""
    virtual = tp.VirtualCell(preset, seed=5)
    samples = virtual.measure(virtual.design(n, seed=1))  # a station that creeps is a fault of the campaign
    assert not judged(tp.fit_cell(virtual.cell, samples, predictor, accept_campaign=True))


def test_the_misfit_to_the_prior_stands_beside_each_parameter():
    """How many prior standard deviations a parameter is from where the prior has it."""
    cell, samples = with_zero("paper", 2, 1.4)
    for predictor, key in (("kinematic-kriging", "name"), ("calibration", "parameter")):
        rows = tp.fit_cell(cell, samples, predictor).predictor.parameters_
        row = next(row for row in rows if row[key] == "theta3")
        assert row["off"] == pytest.approx(row.get("estimate", row.get("change")) / row["prior_std"])


def with_reflector(preset, off, seed=4):
    """Return a cell and samples whose reflector sits elsewhere than the controller's tool, which is stated."""
    virtual = tp.VirtualCell(preset, seed=seed)
    stated = virtual.cell.tf_flange_tool
    real = stated.copy()
    real[:3, 3] += off
    virtual.truth = replace(virtual.truth, tf_flange_tool=real)
    samples = virtual.measure(virtual.design(60, seed=1))
    return virtual.cell, replace(samples, p_cmd=samples.p_cmd.round(3))  # as a controller shows them


@pytest.mark.parametrize("predictor", ["kinematic-kriging", "calibration", "ordinary-kriging"])
@pytest.mark.sampled(1)
def test_a_reflector_that_is_not_at_the_tool_is_refused(predictor):
    """Commanded positions prove the controller's tool, and the arm is checked; the reflector is another fact."""
    cell, samples = with_reflector("hard", np.array([9.0, -9.0, 0.0]))
    error_map = tp.fit_cell(cell, samples, predictor)
    facts = {fact.code: fact for fact in error_map.facts}
    assert {"arm-checked", "reflector-off"} <= facts.keys()
    assert facts["reflector-off"].size == pytest.approx(9.0 * np.sqrt(2.0), abs=1.5)
    assert facts["reflector-off"].std < 1.0
    with pytest.raises(RefusedError, match=r"the readings put the reflector 1.*accept reflector-off"):
        error_map.correct(samples)
    assert len(error_map.correct(samples[:2], accept={"reflector-off"}, accept_weak_map=True).verdict) == 2


def test_a_reflector_near_the_tool_is_told():
    error_map = tp.fit_cell(*with_reflector("hard", np.array([1.0, 1.0, 0.0])), "kinematic-kriging")
    (fact,) = [fact for fact in error_map.facts if fact.code.startswith("reflector")]
    assert fact.code == "reflector-checked"
    assert fact.size == pytest.approx(np.sqrt(2.0), abs=1.0)


def test_with_one_orientation_the_reflector_is_not_checked():
    error_map = tp.fit_cell(*with_reflector("paper", np.array([9.0, -9.0, 0.0])), "kinematic-kriging")
    (fact,) = [fact for fact in error_map.facts if fact.code.startswith("reflector")]
    assert fact.code == "reflector-not-checked"
    assert "do not tell the tool from the station" in fact.words
