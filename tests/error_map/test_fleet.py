"""Maps of earlier robots of a type as a prior for the next one: accuracy, honesty, files, commands, bad input."""

import json
from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.error_map.fleet import fleet_of
from truepose.errors import DataError, TrueposeError
from truepose.geometry import apply_transform, invert_transform
from truepose.predictors.kinematic.fleet import ANGLES, Fleet
from truepose.samples import Distances, Poses, write_samples
from truepose.simulation import VirtualFleet

FEW, EARLIER = 20, 80
PREDICTOR = "kinematic-kriging"


def fitted(cell, n, seed, **options):
    return tp.fit_cell(cell.cell, cell.measure(cell.design(n, seed=seed), seed=seed), PREDICTOR, **options)


def miss(cell, error_map):
    """Return the errors of predictions against the truth without noise, and their deviations, (m, 3) [mm]."""
    q = cell.design(150, seed=999)
    readings = apply_transform(invert_transform(cell.truth.tf_base_tracker), cell.true_position(q))
    true = error_map.registration.apply(readings) - cell.robot.forward(q, tool=error_map.tf_flange_tool)[:, :3, 3]
    predicted, std = error_map.predict_errors(Poses(q=q))
    return predicted - true, std


def mean_miss(cell, error_map):
    return np.linalg.norm(miss(cell, error_map)[0], axis=1).mean()


@pytest.fixture(scope="module")
def alike():
    """A fleet that has most in common."""
    return VirtualFleet("hard", share=0.9, seed=1)


@pytest.fixture(scope="module")
def earlier(alike, tmp_path_factory):
    """Maps of three robots, read from their files."""
    folder = tmp_path_factory.mktemp("fleet")
    for number in (1, 2, 3):
        fitted(alike.cell(number), EARLIER, number).save(folder / f"robot-{number}.truepose")
    return [tp.load_map(folder / f"robot-{number}.truepose") for number in (1, 2, 3)]


@pytest.fixture(scope="module")
def following(alike, earlier):
    return fitted(alike.cell(0), FEW, 7, like=earlier)


@pytest.mark.exhaustive
def test_a_fleet_that_has_much_in_common_helps(alike, following):
    cell = alike.cell(0)
    assert following.predictor.fleet_["taken"] == "mean"
    assert 0.5 < following.predictor.fleet_["scale"] <= 1.0
    assert mean_miss(cell, following) < 0.8 * mean_miss(cell, fitted(cell, FEW, 7))
    left, std = miss(cell, following)
    assert np.mean(np.abs(left) <= 1.96 * std) > 0.9


@pytest.mark.exhaustive
def test_distances_enter_a_fit_with_a_fleet(alike, earlier, following, tmp_path):
    """A map keeps its fleet and its distances, and both help."""
    cell = alike.cell(0)
    further = cell.measure(cell.design(60, seed=8), seed=8)
    origin = apply_transform(
        invert_transform(cell.truth.tf_base_tracker),
        np.array([[2500.0, -1500.0, 200.0], [2500.0, 1500.0, 800.0], [900.0, 0.0, 1500.0]]),
    )[np.arange(60) % 3]
    distance = np.linalg.norm(further.p_meas - origin, axis=1)
    wires = Distances(q=further.q, distance=distance, distance_std=np.full(60, 0.02), p_origin=origin)
    samples = replace(cell.measure(cell.design(FEW, seed=7), seed=7), distances=wires)
    both = tp.fit_cell(cell.cell, samples, PREDICTOR, like=earlier)
    assert both.predictor.fleet_["taken"] == "mean"
    assert len(both.predictor.distance_rows) == 60
    assert mean_miss(cell, both) < mean_miss(cell, following)
    both.save(tmp_path / "both.truepose")
    read = tp.load_map(tmp_path / "both.truepose")
    poses = Poses(q=cell.design(20, seed=3))
    for a, b in zip(read.predict_errors(poses), both.predict_errors(poses), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-6)


@pytest.mark.exhaustive
def test_robots_with_nothing_in_common_do_not_harm():
    """Three fleets: what is not common is not believed."""
    ratio = []
    for seed in range(3):
        fleet = VirtualFleet("hard", share=0.0, seed=seed)
        cell, other = fleet.cell(0), fitted(fleet.cell(1), EARLIER, 1)
        ratio.append(mean_miss(cell, fitted(cell, FEW, 7, like=[other])) / mean_miss(cell, fitted(cell, FEW, 7)))
    assert max(ratio) < 1.1


@pytest.mark.exhaustive
def test_contributions_and_curves_include_the_mean(following):
    model, q = following.predictor, following.samples.q
    parts = model.explain(q)
    assert "fleet" in parts
    assert np.abs(sum(parts.values()) - model.predict(q)).max() < 1e-9
    without = Fleet.from_dict({**model.with_fitted_parameters().fleet, "level": "nothing"}, 6)
    assert np.abs(without.curve(1, q[:, 1])).max() == 0.0
    assert max(np.abs(curve.error).max() for curve in model.joint_curves()) > 1e-5


@pytest.mark.exhaustive
def test_a_map_needs_no_other_file(following, tmp_path):
    """It states its ancestry, predicts the same from its file, and freezes with the mean of the fleet."""
    path = tmp_path / "map.truepose"
    following.save(path)
    again, q = tp.load_map(path), following.samples.q
    assert np.abs(again.predictor.predict(q) - following.predictor.predict(q)).max() < 1e-9
    assert again.predictor.fleet_ == following.predictor.fleet_
    assert [one["name"] for one in again.predictor.fleet_["maps"]] == [f"robot-{k}.truepose" for k in (1, 2, 3)]
    assert all(len(one["sha256"]) == 64 for one in again.predictor.fleet_["maps"])
    frozen = again.freeze()
    p_frozen = np.array([frozen.predict(joints) for joints in q])[:, :3]
    assert np.abs(p_frozen - again.predictor.predict(q)).max() < 1e-3


@pytest.mark.exhaustive
def test_a_child_may_be_a_parent(alike, following):
    """The curves of a robot that was fitted with a mean include it."""
    member = following.predictor.member("child")
    plain = fitted(alike.cell(0), FEW, 7).predictor.member("plain")
    assert member.curves.shape == plain.curves.shape == (6, ANGLES)
    assert np.abs(member.curves).max() > 1e-5


def another_type():
    virtual = tp.VirtualCell("paper", robot="kuka-kr20-r1810-2")
    return tp.fit_cell(virtual.cell, virtual.measure(virtual.design(30)), PREDICTOR)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("maps", "told"),
    [
        (lambda cell, maps: [another_type()], "not of a kuka"),
        (lambda cell, maps: [maps[0], maps[0]], "same samples as robot-1.truepose"),
        (lambda cell, maps: [fitted(cell, FEW, 7)], "made of the samples that are to be fitted"),
        (lambda cell, maps: [with_predictor(cell, "idw")], "its predictor is idw"),
        (lambda cell, maps: [with_predictor(cell, f"{PREDICTOR}:convention=dh")], "convention 'dh'"),
        (lambda cell, maps: [], "at least one"),
    ],
)
def test_maps_that_do_not_belong_are_named(alike, earlier, maps, told):
    cell = alike.cell(0)
    samples = cell.measure(cell.design(FEW, seed=7), seed=7)
    with pytest.raises(DataError, match=told):
        fleet_of(maps(cell, earlier), cell.robot, samples)


def with_predictor(cell, predictor):
    return tp.fit_cell(cell.cell, cell.measure(cell.design(40, seed=70), seed=70), predictor)


@pytest.mark.parametrize(
    "wrong",
    [
        {"curves": [[0.0] * ANGLES] * 5},
        {"curves": [[float("nan")] * ANGLES] * 6},
        {"curves": []},
        {"level": "all"},
        {"scale": "much"},
        {"maps": [{}]},
        {"drift": None},
    ],
)
def test_a_fleet_with_a_wrong_part_is_refused(following, wrong):
    with pytest.raises(TrueposeError, match=r"fit the map again"):
        Fleet.from_dict({**following.predictor.with_fitted_parameters().fleet, **wrong}, 6)


@pytest.mark.exhaustive
def test_the_command(run, alike, earlier, tmp_path):
    cell, table, out = (tmp_path / name for name in ("cell.toml", "samples.csv", "map.truepose"))
    virtual = alike.cell(0)
    cell.write_text(virtual.cell.to_toml())
    write_samples(table, virtual.measure(virtual.design(FEW, seed=7), seed=7))
    like = [word for one in earlier for word in ("--like", one.stored.path)]
    done = run("fit", cell, table, "--predictor", PREDICTOR, "--out", out, *like)
    assert done.code == 0, done.err
    assert "of the mean error were taken of them" in " ".join(done.out.split())
    explained = run("explain", out, "--json").json
    assert explained["fleet"]["taken"] == "mean"
    assert "curves" not in json.dumps(explained["hyperparameters"])
    refused = run("fit", cell, table, "--predictor", "idw", "--out", tmp_path / "other.truepose", *like)
    assert refused.code == 1
    assert "leave out --like" in refused.err
