"""A frozen map is its map: the same errors to 1 µm, its own file, and nothing that a file may say is believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.tiers import examples

import truepose as tp
from truepose._io import archive
from truepose.errors import DataError, FileError, RobotError
from truepose.numerics.frozen import predict, scratch
from truepose.numerics.frozen_deviation import deviations
from truepose.predictors.kinematic import frozen_deviation
from truepose.predictors.kinematic.hyperparameters import Hyperparameters

ARM7 = tp.Robot(
    "seven-axes",
    alpha=np.deg2rad([0, -90, 90, 90, -90, -90, 90]),
    a=[0, 0, 0, 45, -45, 0, 70],
    d=[333, 0, 316, 0, 384, 0, 100],
    offset=[0, 0.2, 0, -0.5, 0, 0, 0.7],
    sign=[1, -1, 1, 1, -1, 1, 1],
    limits=np.deg2rad([[-170, 170]] * 6 + [[-400, 400]]),
)
TOOL = np.array([[0.0, 0, 1, 110], [0, 1, 0, 20], [-1, 0, 0, 360], [0, 0, 0, 1]])
COUNT = 100_000


def joints(robot: tp.Robot, n: int, seed: int = 0) -> np.ndarray:
    """Return random joints within the limits, (n, dof) [rad]."""
    return np.random.default_rng(seed).uniform(*np.clip(robot.limits, -7.0, 7.0).T, (n, robot.dof))


def kinematic(robot: tp.Robot, n: int = 60, **options) -> tp.KinematicKriging:
    """Return a fit with given hyperparameters, short lengths among them: nothing is searched."""
    rng = np.random.default_rng(5)
    moved, ranges = options.get("joint_errors", True), {"joint": robot.dof, "cartesian": 1, "both": robot.dof + 1}
    start = Hyperparameters.start(robot.dof * moved, ranges.get(options.get("residual", "joint"), 0), noise=0.02)
    hyper = start.with_vector(start.to_vector() + np.linspace(-1.5, 0.5, len(start.to_vector())))
    model = tp.KinematicKriging(
        robot, TOOL, hyper=hyper.to_dict(), robust=False, joints=range(robot.dof) if moved else (), **options
    )
    e = 1.5 * rng.normal(size=3) + rng.normal(scale=0.3, size=(n, 3))
    return model.fit(joints(robot, n, 1), e)


def calibrated(robot: tp.Robot, terms=(), **options) -> tp.KinematicCalibration:
    size = len(tp.KinematicCalibration(robot, TOOL, terms=terms, **options).fit(*few(robot)).parameters_)
    change = np.random.default_rng(3).normal(size=size) * 2e-4
    model = tp.KinematicCalibration(robot, TOOL, terms=terms, misfit_std=0.05, identified=change.tolist(), **options)
    return model.fit(*few(robot))


def few(robot: tp.Robot) -> tuple[np.ndarray, np.ndarray]:
    return joints(robot, 60, 1), np.random.default_rng(2).normal(scale=0.1, size=(60, 3))


UR10, KUKA = tp.load_robot("universal-robots-ur10"), tp.load_robot("kuka-kr210-r2700-extra")
MODELS = {
    "all terms": lambda: kinematic(KUKA),
    "all terms, basis": lambda: kinematic(KUKA, solver="basis"),
    "standard D-H": lambda: kinematic(UR10, n=300),
    "seven axes": lambda: kinematic(ARM7),
    "seven axes, basis, both": lambda: kinematic(ARM7, solver="basis", residual="both"),
    "Cartesian rest": lambda: kinematic(UR10, residual="cartesian"),
    "both rests": lambda: kinematic(KUKA, residual="both"),
    "no rest": lambda: kinematic(KUKA, residual="none"),
    "no rest, basis": lambda: kinematic(KUKA, residual="none", solver="basis"),
    "no joint errors": lambda: kinematic(KUKA, joint_errors=False),
    "no geometry, no compliance": lambda: kinematic(KUKA, geometry=False, compliance=False),
    "product of exponentials": lambda: kinematic(KUKA, convention="poe"),
    "calibration": lambda: calibrated(KUKA),
    "calibration, seven axes": lambda: calibrated(ARM7, terms=("sin1", "cos2")),
    "calibration, CPC": lambda: calibrated(UR10, convention="cpc", terms=("compliance",)),
    "calibration, all terms": lambda: calibrated(
        UR10,
        terms=("sin1", "cos1", "sin2 q3", "gearcos1 q2", "compliance"),
        gear_ratio=[101.0, 101.0, 54.5, 101.0, 80.0, 50.0],
        payload=(12.0, 10.0, -20.0, 120.0),
    ),
}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.sampled(1)
def test_arrays_predict_what_the_model_predicts(name):
    """At 10,000 random joints within the limits, positions to 1 µm and orientations to 1 µrad."""
    model = MODELS[name]()
    constants, q = model.constants(), joints(model.robot, 10_000)
    out = np.empty((len(q), 6))
    assert predict(q, out, constants, scratch(constants)) == 0
    assert np.abs(out[:, :3]).mean() > 0.01
    assert np.linalg.norm(out[:, :3] - model.predict(q), axis=1).max() < 1e-3
    assert np.linalg.norm(out[:, 3:] - model.predict_pose(q)[:, 3:], axis=1).max() < 1e-6


def test_backlash_is_refused():
    model = tp.KinematicCalibration(KUKA, TOOL, terms=("backlash q2",))
    q, e = few(KUKA)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], q.shape)
    with pytest.raises(DataError, match="backlash cannot be frozen: it needs the approach signs"):
        model.fit(np.concatenate([q, signs], axis=1), e).constants()


@pytest.fixture(scope="module")
def maps(tmp_path_factory) -> dict[str, tp.ErrorMap]:
    """Maps of virtual cells and of a measured arm, whose tool was fitted."""
    example, found = tp.load_example("ur10"), {}
    for name in ("paper", "hard"):
        virtual = tp.VirtualCell(name, seed=3)
        found[name] = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(60)), "kinematic-kriging")
    found["ur10"] = tp.fit_cell(example.cell, example.samples[::8], "kinematic-kriging")
    found["calibrated"] = tp.fit_cell(example.cell, example.samples[::8], "calibration:terms=sin1+cos1")
    return found


@pytest.mark.promise("A frozen map equals its map to 1 µm at 100,000 random poses")
@pytest.mark.parametrize("name", ["paper", "hard", "ur10", "calibrated"])
@pytest.mark.exhaustive
def test_a_frozen_map_equals_its_map(maps, name):
    error_map = maps[name]
    frozen, q = error_map.freeze(), joints(error_map.robot, COUNT)
    difference = np.linalg.norm(frozen.predict(q) - error_map.predict_errors(tp.Poses(q=q))[0], axis=1)
    assert difference.max() < 1e-3
    assert 0.0 <= frozen.difference_mm < 1e-3
    assert frozen.map_sha256 == error_map.hash
    frozen.check_map(error_map)


@pytest.mark.exhaustive
@settings(max_examples=examples(30))
@given(
    st.sampled_from(["paper", "ur10", "calibrated"]),
    st.lists(st.floats(-400.0, 400.0), min_size=3, max_size=3),
    st.integers(0, 1000),
)
def test_a_tool_of_ones_own(maps, name, offset, seed):
    """Another point of the tool moves with the predicted turn of the tool, for any offset up to half a metre."""
    error_map = maps[name]
    tool = error_map.tf_flange_tool.copy()
    tool[:3, 3] += offset
    q = joints(error_map.robot, 20, seed)
    expected = error_map.predict_with_tool(q, tool)[0]
    np.testing.assert_allclose(error_map.freeze(tool).predict(q), expected, atol=1e-3)


@pytest.mark.exhaustive
def test_one_pose_many_poses_and_given_memory_agree(maps):
    frozen = maps["paper"].freeze()
    q = joints(maps["paper"].robot, 9000)
    many, out, one = frozen.predict(q), np.empty((9000, 3)), np.empty(3)
    frozen.predict_into(q, out)
    np.testing.assert_array_equal(many, out)
    frozen.predict_into(q[17], one)
    np.testing.assert_array_equal(one, many[17])
    np.testing.assert_array_equal(frozen.predict(q[17]), many[17])
    q.setflags(write=False)
    frozen.predict_into(q[:2], out[:2])
    np.testing.assert_array_equal(many[:2], out[:2])


def test_joints_are_checked(maps):
    frozen = maps["paper"].freeze()
    q, out = joints(maps["paper"].robot, 4), np.zeros((4, 3))
    with pytest.raises(DataError, match=r"expected joints of shape \(n, 6\) .*, got \(4, 5\)"):
        frozen.predict(q[:, :5])
    with pytest.raises(DataError, match=r"expected q \(n, 6\) and out \(n, 3\).*got \(4, 6\), \(3, 3\)"):
        frozen.predict_into(q, out[:3])
    with pytest.raises(DataError, match="contiguous arrays of float64"):
        frozen.predict_into(q[:, ::-1], out)
    with pytest.raises(DataError, match="contiguous arrays of float64"):
        frozen.predict_into(q.astype(np.float32), out)
    for value in (np.nan, np.inf):
        q[2, 1] = value
        with pytest.raises(DataError, match="NaN or infinity in row 2"):
            frozen.predict(q)
    q[2, 1] = np.deg2rad(-141)
    with pytest.raises(RobotError, match=r"row 2 joint 2 at -141\.000 deg, limits -140 to -5"):
        frozen.predict_into(q, out)
    assert np.isnan(out[2]).all()
    assert np.isfinite(out[[0, 1, 3]]).all()


def test_maps_that_do_not_know_the_arm_are_refused():
    virtual = tp.VirtualCell("paper")
    samples = virtual.measure(virtual.design(30))
    for name in ("registration", "idw:space=joint"):
        with pytest.raises(DataError, match=rf"'{name}' cannot be frozen.*kinematic-kriging or calibration"):
            tp.fit_cell(virtual.cell, samples, name).freeze()


def test_a_changed_map_is_noticed(maps, tmp_path):
    error_map, path = maps["calibrated"], tmp_path / "cell.frozen"
    frozen = error_map.freeze()
    frozen.save(path)
    again = tp.FrozenMap.load(path, error_map)
    q = joints(error_map.robot, 100)
    np.testing.assert_array_equal(again.predict(q), frozen.predict(q))
    assert repr(again) == repr(frozen)
    with pytest.raises(DataError, match="the map was changed since; freeze it again"):
        tp.FrozenMap.load(path, maps["ur10"])


def test_other_files_are_refused(maps, tmp_path):
    frozen_path, map_path, text = tmp_path / "a.frozen", tmp_path / "a.truepose", tmp_path / "a.txt"
    maps["paper"].freeze().save(frozen_path)
    maps["paper"].save(map_path)
    text.write_text("no zip")
    with pytest.raises(FileError, match=r"not a truepose frozen map; name the file that FrozenMap\.save wrote"):
        tp.FrozenMap.load(map_path)
    with pytest.raises(FileError, match="not a truepose map; name the file that 'truepose fit' wrote"):
        tp.load_map(frozen_path)
    with pytest.raises(FileError, match="is not a map file"):
        tp.FrozenMap.load(text)
    data = bytearray(frozen_path.read_bytes())
    data[len(data) // 2] ^= 1
    frozen_path.write_bytes(data)
    with pytest.raises(FileError):
        tp.FrozenMap.load(frozen_path)


LIES = {
    "nan": lambda x: np.where(np.arange(x.size).reshape(x.shape) == 0, 1e300, x),
    "cut": lambda x: x[:-1],
    "longer": lambda x: np.concatenate([x, x]),
    "flat": lambda x: x.reshape(-1),
    "moved": lambda x: x + 1.0,
    "whole numbers": lambda x: x.astype(np.int64),
}


def lies_believed(path, lies, of=""):
    """Alter each array whose name begins with `of`, with right hashes; return those that are loaded all the same."""
    content, arrays = archive.unpack(path.read_bytes(), path, archive.FROZEN)
    believed = []
    for name, array in arrays.items():
        for lie in lies:
            altered = LIES[lie](array)
            if not name.startswith(of) or (altered.dtype == array.dtype and np.array_equal(altered, array)):
                continue
            path.write_bytes(archive.pack(content, arrays | {name: altered}, archive.FROZEN))
            try:
                tp.FrozenMap.load(path)
            except FileError:
                continue
            believed.append((name, lie))
    return believed


@pytest.mark.exhaustive
@pytest.mark.promise("No array of a frozen map's file that contradicts its predictions is believed, hashes or not")
def test_files_that_lie_are_refused(maps, tmp_path):
    """Each array wrong in several ways, with right hashes."""
    path = tmp_path / "lie.frozen"
    maps["hard"].freeze().save(path)
    assert lies_believed(path, LIES) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": 7}, "must be text"),
        ({"difference_mm": "0"}, "must be text"),
        ({"more": 1}, "it has the parts"),
    ],
)
def test_facts_that_lie_are_refused(maps, tmp_path, change, words):
    path = tmp_path / "lie.frozen"
    maps["calibrated"].freeze().save(path)
    content, arrays = archive.unpack(path.read_bytes(), path, archive.FROZEN)
    path.write_bytes(archive.pack(content | change, arrays, archive.FROZEN))
    with pytest.raises(FileError, match=words):
        tp.FrozenMap.load(path)
    path.write_bytes(archive.pack(content, arrays | {"extra": np.zeros(1)}, archive.FROZEN))
    with pytest.raises(FileError, match="it holds extra, which is not part of a frozen map"):
        tp.FrozenMap.load(path)


def test_a_map_that_differs_is_not_frozen(maps, monkeypatch):
    """The comparison with the map is made, not assumed."""
    error_map = maps["calibrated"]
    constants = error_map.predictor.constants()
    longer = constants.links.copy()
    longer[1, :, :, 3] *= 1.00001
    monkeypatch.setattr(type(error_map.predictor), "constants", lambda _: constants._replace(links=longer))
    with pytest.raises(DataError, match=r"differ from the map by .* mm, more than 0\.001 mm"):
        error_map.freeze()


def test_frozen_map_is_plain(maps):
    frozen = maps["paper"].freeze()
    assert replace(frozen, robot="x").robot == "x"
    assert frozen.n_joints == 6
    assert "kinematic-kriging" in repr(frozen)


@pytest.mark.promise("The standard deviation of a frozen map is not below that of its map by more than 1 nm")
@pytest.mark.parametrize("name", ["paper", "hard", "ur10"])
@pytest.mark.exhaustive
def test_the_frozen_deviation_is_an_upper_bound(maps, name):
    """At 20,000 poses within the limits and 20,000 among the samples; there it is seldom more than 2 % above."""
    error_map, rng = maps[name], np.random.default_rng(8)
    frozen, sampled = error_map.freeze(std=True), error_map.samples.q
    one, other = rng.integers(len(sampled), size=(2, 20_000))
    among = sampled[one] + rng.uniform(size=(20_000, 1)) * (sampled[other] - sampled[one])
    for q in (joints(error_map.robot, 20_000, 9), among):
        e, std = frozen.predict(q, return_std=True)
        true = error_map.predict_errors(tp.Poses(q=q))[1]
        np.testing.assert_array_equal(e, frozen.predict(q))
        assert (std - true).min() > -1e-6
    assert np.quantile(std / true, 0.99) < 1.02
    assert np.median(std / true) < 1.005


@pytest.mark.parametrize("name", ["all terms, basis", "seven axes", "both rests", "no rest", "no joint errors"])
@pytest.mark.sampled(1)
def test_combinations_of_readings_bound_the_variance(name):
    """All options of the model, with the variance of the field alone; a cell's part beyond the field hides nothing."""
    model = MODELS[name]()
    constants, added = model.constants(), np.zeros(3)
    deviation = model.deviation(constants, joints(model.robot, 400, 3), added)
    q = joints(model.robot, 2000, 4)
    bound, true = deviations(q, constants, deviation), model.predict(q, return_std=True)[1]
    assert (bound / true).min() > 1.0 - 1e-4
    assert np.quantile(bound / true, 0.5) < 1.3


def test_one_direction_only_tells_less():
    """Fewer combinations of the readings give a larger deviation at every pose."""
    model = MODELS["all terms"]()
    constants = model.constants()
    full = model.deviation(constants, joints(KUKA, 400, 3), np.zeros(3))
    q = joints(KUKA, 500, 4)
    few = full._replace(
        **{name: getattr(full, name)[..., :40].copy() for name in ("drift", "gravity", "tables", "rest")}
    )
    assert (deviations(q, constants, few) >= deviations(q, constants, full)).all()
    assert full.drift.shape[1] > 40


@pytest.mark.exhaustive
def test_a_frozen_deviation_has_its_file(maps, tmp_path, monkeypatch):
    monkeypatch.setattr(frozen_deviation, "_ANGLES", (64, 64))  # short tables, and a margin for them
    error_map, path = maps["hard"], tmp_path / "std.frozen"
    frozen = error_map.freeze(std=True)
    frozen.save(path)
    again, q = tp.FrozenMap.load(path, error_map), joints(error_map.robot, 1500)
    np.testing.assert_allclose(again.predict(q, return_std=True)[1], frozen.predict(q, return_std=True)[1], rtol=1e-12)
    one = frozen.predict(q[3], return_std=True)
    assert [part.shape for part in one] == [(3,), (3,)]
    assert "with standard deviation" in repr(again)
    assert frozen.deviation.margin[0] > 0.0
    lies = ("cut", "flat", "whole numbers", "moved", "nan")
    assert lies_believed(path, lies, of="deviation.") == []


def test_where_no_deviation_is_frozen(maps):
    with pytest.raises(DataError, match=r"frozen without its standard deviation; use error_map\.freeze\(std=True\)"):
        maps["paper"].freeze().predict(joints(maps["paper"].robot, 2), return_std=True)
    with pytest.raises(DataError, match="has no frozen standard deviation, only kinematic-kriging has"):
        maps["calibrated"].freeze(std=True)
    tool = maps["paper"].tf_flange_tool.copy()
    tool[2, 3] += 30.0
    with pytest.raises(DataError, match="frozen at the measured point only"):
        maps["paper"].freeze(tool, std=True)
