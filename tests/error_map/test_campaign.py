"""Faults of a measuring campaign: `fit` and `import` name each with estimate and standard error, and stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import truepose as tp
from truepose.error_map.campaign import CampaignCheck, check_campaign
from truepose.error_map.registration import register_samples
from truepose.errors import DataError
from truepose.samples import Samples, write_samples
from truepose.simulation import VirtualCell

Fault = Callable[[Samples], Samples]


def shifted(samples: Samples, by: np.ndarray) -> Samples:
    return replace(samples, p_meas=samples.p_meas + by)


def moved(samples: Samples, shift: float = 10.0) -> Samples:
    """The tracker stands elsewhere for the second half."""
    late = np.arange(len(samples)) >= len(samples) // 2
    return shifted(samples, late[:, None] * shift * np.array([0.6, -0.8, 0.0]))


def turned(samples: Samples, angle: float = 0.2e-3) -> Samples:
    """The tracker turns about its own vertical axis for the second half."""
    late = np.arange(len(samples)) >= len(samples) // 2
    there = Rotation.from_rotvec([0.0, 0.0, angle]).apply(samples.p_meas)
    return replace(samples, p_meas=np.where(late[:, None], there, samples.p_meas))


def creeping(samples: Samples, path: float = 0.5) -> Samples:
    share = np.linspace(0.0, 1.0, len(samples))
    return shifted(samples, share[:, None] * path * np.array([0.6, 0.0, 0.8]))


def scaled(samples: Samples, scale: float = 5e-3) -> Samples:
    return replace(samples, p_meas=samples.p_meas * (1.0 + scale))


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("paper", seed=5)


@pytest.fixture(scope="module")
def sound(virtual: VirtualCell) -> Samples:
    return virtual.measure(virtual.design(60, seed=1), seed=1)


def checked(cell: tp.Cell, samples: Samples) -> CampaignCheck:
    robot = cell.load_robot()
    registration, tf_flange_tool, _ = register_samples(cell, robot, samples)
    return check_campaign(cell, robot, samples, registration, tf_flange_tool)


def only_change(cell: tp.Cell, samples: Samples) -> Any:
    (change,) = checked(cell, samples).changes
    return change


@pytest.mark.promise("fit refuses samples between whose halves the tracker moved by 10 mm, and says by how much")
def test_a_moved_tracker_stops_the_fit(virtual: VirtualCell, sound: Samples):
    told = r"moved between row 29 and row 30, by (9\.99|10\.0)\d* ± 0\.0\d\d mm and .* mrad .*; fit the samples before"
    with pytest.raises(DataError, match=told):
        tp.fit_cell(virtual.cell, moved(sound), "registration")
    change = only_change(virtual.cell, moved(sound))
    assert change.shift == pytest.approx(10.0, abs=4 * change.shift_std)
    assert change.rows == (29, 30)


@pytest.mark.promise("fit refuses samples with a scale of 0.5 %, and says how large it is")
def test_a_scale_stops_the_fit(virtual: VirtualCell, sound: Samples):
    told = (
        r"measured lengths are 0\.\d\d ± 0\.\d\d % longer than commanded ones, from row 0 to row 59 .*; check the unit"
    )
    with pytest.raises(DataError, match=told):
        tp.fit_cell(virtual.cell, scaled(sound), "registration")
    change = only_change(virtual.cell, scaled(sound))
    assert change.scale == pytest.approx(5e-3, abs=4 * change.scale_std)
    assert only_change(virtual.cell, scaled(sound, -5e-3)).scale < 0


@pytest.mark.promise("fit refuses samples that creep by 0.5 mm during the campaign, and says by how much")
def test_a_creep_stops_the_fit(virtual: VirtualCell, sound: Samples):
    told = r"the readings drift by 0\.\d+ ± 0\.\d+ mm .* from row 0 to row 59 .*; warm the robot up"
    with pytest.raises(DataError, match=told):
        tp.fit_cell(virtual.cell, creeping(sound), "registration")
    change = only_change(virtual.cell, creeping(sound))
    assert change.shift == pytest.approx(0.5, abs=4 * change.shift_std)


@pytest.mark.promise("fit refuses samples between whose halves the tracker turned by 0.2 mrad, and says by how much")
def test_a_turned_tracker_stops_the_fit(virtual: VirtualCell, sound: Samples):
    with pytest.raises(DataError, match=r"moved between row 29 and row 30, by 0\.\d+ ± .* mm and 0\.\d+ ± .* mrad"):
        tp.fit_cell(virtual.cell, turned(sound), "registration")
    change = only_change(virtual.cell, turned(sound))
    assert change.turn == pytest.approx(0.2e-3, abs=4 * change.turn_std)


@pytest.mark.parametrize("fault", [moved, scaled, creeping, turned])
@pytest.mark.promise("a fault of a campaign is found behind every effect of a virtual cell, orientations included")
@pytest.mark.exhaustive
def test_faults_are_found_behind_all_effects(fault: Fault, record_property: Any):
    record_property("cases", 2)
    for seed in range(2):
        virtual = VirtualCell("hard", seed=seed)
        found = checked(virtual.cell, fault(virtual.measure(virtual.design(100))))
        assert [change.size > found.limit for change in found.changes] == [True]


@pytest.mark.parametrize("preset", ["paper", "hard"])
@pytest.mark.promise("a sound campaign raises no alarm, whether its plan is mixed or runs from one end to the other")
@pytest.mark.sampled(1)
def test_sound_campaigns_raise_no_alarm(preset: str, record_property: Any):
    record_property("cases", 6)
    for seed in range(3):
        virtual = VirtualCell(preset, seed=seed)
        q = virtual.design(60)
        along = np.argsort(virtual.robot.forward(q, tool=virtual.tf_flange_tool)[:, 0, 3])
        for plan in (q, q[along]):
            assert checked(virtual.cell, virtual.measure(plan)).words == []


@pytest.mark.promise("estimates of a campaign's faults lie about the truth as their standard errors say")
@pytest.mark.exhaustive
def test_standard_errors_are_honest(record_property: Any):
    record_property("cases", 8)
    far = []
    for seed in range(4):
        virtual = VirtualCell("paper", seed=seed)
        samples = virtual.measure(virtual.design(50))
        drift = only_change(virtual.cell, creeping(samples))
        scale = only_change(virtual.cell, scaled(samples))
        far += [(drift.shift - 0.5) / drift.shift_std, (scale.scale - 5e-3) / scale.scale_std]
    assert 0.5 < np.sqrt(np.mean(np.square(far))) < 1.6


@pytest.mark.promise("a drift along a plan that is sorted in space has a standard error that says it is hardly known")
def test_a_drift_along_a_sorted_plan_is_known_badly(virtual: VirtualCell):
    q = virtual.design(60, seed=1)
    along = np.argsort(virtual.robot.forward(q, tool=virtual.tf_flange_tool)[:, 0, 3])
    drifting = (creeping(virtual.measure(plan, seed=1), 10.0) for plan in (q, q[along]))
    mixed, in_order = (only_change(virtual.cell, samples) for samples in drifting)
    assert in_order.shift_std > 10 * mixed.shift_std
    assert in_order.shift == pytest.approx(10.0, abs=4 * in_order.shift_std)


@pytest.mark.promise("a map that is fitted to a faulty campaign keeps what was found")
def test_an_accepted_campaign_keeps_its_faults(virtual: VirtualCell, sound: Samples, tmp_path: Path):
    fitted = tp.fit_cell(virtual.cell, moved(sound), "registration", accept_campaign=True)
    fitted.save(tmp_path / "m.truepose")
    again = tp.load_map(tmp_path / "m.truepose")
    assert again.campaign == fitted.campaign
    (fault,) = again.campaign["faults"]
    assert fault["kind"] == "moved"
    assert fault["stops"]
    assert "the tool moved between row 29 and row 30" in fault["words"]


@pytest.mark.promise("a creep too small to stop the fit is a warning of fit and of validate")
def test_a_small_creep_is_a_warning(virtual: VirtualCell, sound: Samples, tmp_path: Path, run: Any):
    cell, samples, made = tmp_path / "cell.toml", tmp_path / "samples.csv", tmp_path / "m.truepose"
    cell.write_text(virtual.cell.to_toml())
    write_samples(samples, creeping(sound, 0.08))
    write_samples(tmp_path / "test.csv", virtual.measure(virtual.design(20, seed=9), seed=9))
    fitted = run("fit", cell, samples, "--predictor", "registration", "--out", made)
    assert fitted.code == 0, fitted.err
    told = "Warning: the readings drift by 0.0"
    assert told in fitted.out
    assert told in run("validate", made, tmp_path / "test.csv").out


@pytest.mark.promise("a drift too uncertain to be named widens the deviation of the map; noise alone does not")
def test_a_suspected_drift_widens_the_deviation(virtual: VirtualCell, record_property: Any):
    campaigns = [virtual.measure(virtual.design(60, seed=seed), seed=seed) for seed in range(8)]
    plain = [checked(virtual.cell, samples) for samples in campaigns]
    assert sum(found.suspected_drift == 0.0 for found in plain) >= 7
    faint = [checked(virtual.cell, creeping(samples, 0.06)) for samples in campaigns]
    unnamed = [found for found in faint if not found.changes]
    assert len(unnamed) >= 4
    suspected = np.array([found.suspected_drift for found in unnamed])
    assert np.mean(suspected > 0.0) >= 0.75
    assert np.median(suspected) == pytest.approx(0.06, rel=0.3)
    i = next(i for i, found in enumerate(faint) if found.suspected_drift > 0.0)
    sound, drifting = (
        tp.fit_cell(virtual.cell, each, "registration") for each in (campaigns[i], creeping(campaigns[i], 0.06))
    )
    added = (2.0 * faint[i].suspected_drift) ** 2
    assert np.sum(drifting.unexplained - drifting.predictor.nugget_) > 0.5 * added
    assert drifting.unexplained.sum() > sound.unexplained.sum() + 0.5 * added
    record_property("cases", len(campaigns))


@pytest.mark.promise("fit and import refuse the same campaigns, and --accept-campaign takes them")
def test_the_command_line_refuses_and_accepts(virtual: VirtualCell, sound: Samples, tmp_path: Path, run: Any):
    cell, samples = tmp_path / "cell.toml", tmp_path / "samples.csv"
    cell.write_text(virtual.cell.to_toml())
    write_samples(samples, scaled(sound))
    fit = ("fit", cell, samples, "--predictor", "registration", "--out", tmp_path / "m.truepose")
    read = ("import", cell, samples, "--plan", samples, "--out", tmp_path / "again.csv")
    for command in (fit, read):
        refused = run(*command).failed()
        assert "samples.csv: measured lengths are 0." in refused
        assert "--accept-campaign" in refused
        accepted = run(*command, "--accept-campaign")
        assert accepted.code == 0, accepted.err
        assert "Warning: measured lengths are 0." in accepted.out


def test_similarity_warns_of_a_faulty_campaign(virtual: VirtualCell, sound: Samples, tmp_path: Path, run: Any):
    cell, samples = tmp_path / "cell.toml", tmp_path / "samples.csv"
    cell.write_text(virtual.cell.to_toml())
    write_samples(samples, moved(sound))
    done = run("similarity", cell, samples, "--space", "cartesian")
    assert done.code == 0, done.err
    assert "Warning: the tracker, the robot base or the tool moved between line 31 and line 32" in done.out


@pytest.mark.promise("reference points that are measured before and after the campaign are compared directly")
def test_reference_points_are_compared(virtual: VirtualCell):
    """Four points before and after six others: too few samples for the other tests."""
    q = virtual.design(10, seed=3)
    plan = np.concatenate([q[:4], q[4:], q[:4]])
    samples = virtual.measure(plan, seed=3)
    assert checked(virtual.cell, samples).words == []
    late = np.arange(14) >= 10
    found = checked(virtual.cell, shifted(samples, late[:, None] * np.array([0.0, 0.3, 0.4])))
    (change,) = found.changes
    assert change.kind == "reference"
    assert change.points == 4
    assert change.shift == pytest.approx(0.5, abs=4 * change.shift_std)
    assert found.words[0].startswith("4 reference points moved by 0.")


def test_one_reference_point_is_compared_with_the_noise_of_the_campaign(virtual: VirtualCell):
    q = virtual.design(30, seed=3)
    samples = virtual.measure(np.concatenate([q, q[:1]]), seed=3)
    late = np.arange(31) == 30
    found = checked(virtual.cell, shifted(samples, late[:, None] * np.array([0.0, 0.3, 0.4])))
    assert [(change.kind, change.points) for change in found.changes] == [("reference", 1)]
    assert checked(virtual.cell, samples).words == []


def test_readings_repeated_at_once_are_no_reference(virtual: VirtualCell):
    q = np.repeat(virtual.design(10, seed=3), 2, axis=0)
    assert [change.kind for change in checked(virtual.cell, virtual.measure(q, seed=3)).changes] == []


@pytest.mark.promise("campaigns of commanded positions without joints are tested as well")
@pytest.mark.parametrize(("fault", "kind"), [(moved, "moved"), (creeping, "drift"), (scaled, "scale")])
def test_positions_without_joints(virtual: VirtualCell, sound: Samples, fault: Fault, kind: str):
    plain = replace(sound, q=None, rotation_cmd=None)
    assert checked(virtual.cell, plain).words == []
    assert only_change(virtual.cell, fault(plain)).kind == kind


@pytest.mark.promise("the order of a campaign is that of its times, where they are known")
def test_times_give_the_order(virtual: VirtualCell, sound: Samples):
    faulty = replace(creeping(sound), time=15.0 * np.arange(60))
    mixed = faulty[np.random.default_rng(0).permutation(60)]
    change = only_change(virtual.cell, mixed)
    assert change.kind == "drift"
    assert change.rows == (0, 59)
    assert change.shift == pytest.approx(0.5, abs=4 * change.shift_std)
    assert "drift" not in [change.kind for change in checked(virtual.cell, replace(mixed, time=None)).changes]


@pytest.mark.promise("a gross reading is no fault of the campaign, and faults are found beside it")
def test_gross_readings(virtual: VirtualCell, sound: Samples):
    gross = np.zeros((60, 3))
    gross[[7, 40], [0, 2]] = [30.0, -4.0]
    assert checked(virtual.cell, shifted(sound, gross)).words == []
    assert only_change(virtual.cell, creeping(shifted(sound, gross))).kind == "drift"


def test_another_load_is_no_moved_tracker():
    virtual = VirtualCell("hard", seed=3)
    load = np.where(np.arange(80) < 40, 120.0, 20.0)
    samples = virtual.measure(virtual.design(80), payload_kg=load)
    assert [change.kind for change in checked(virtual.cell, samples).changes] == []


def test_the_limit_is_the_stated_one(virtual: VirtualCell, sound: Samples):
    correction = virtual.cell.correction.model_copy(update={"max_std_mm": 0.8})
    tolerant = virtual.cell.model_copy(update={"correction": correction})
    found = checked(tolerant, creeping(sound))
    assert found.limit == 0.8
    found.refuse("samples.csv")
    assert len(found.words) == 1


@pytest.mark.promise("samples too few to test are said to be untested")
def test_few_samples_are_untested(virtual: VirtualCell, sound: Samples):
    found = checked(virtual.cell, sound[:10])
    assert (found.tested, found.words) == (0, [])
    assert repr(found) == "<CampaignCheck of 0 samples: no faults>"
    assert checked(virtual.cell, sound).tested == 60
