"""Conditions of poses from samples to corrected programs: approach, temperature, payload."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose import VirtualCell, correct_program, fit_cell, load_map, read_samples, update_map, write_samples
from truepose.error_map.approaching import approach_on_lines
from truepose.errors import DataError
from truepose.geometry import apply_transform, invert_transform
from truepose.robots import Load, nearest_branch
from truepose.robots.nongeometric import gravity_torque, rough_masses
from truepose.samples import Poses, Samples, approach_from_order, check

KRIGING = "kinematic-kriging"


def stating(cell, **conditions):
    return cell.model_copy(update={"conditions": cell.conditions.model_copy(update=conditions)})


def left(virtual, error_map, poses, **conditions):
    """The errors that a map leaves at poses, and the share of components inside their 95 % intervals."""
    p = apply_transform(invert_transform(virtual.truth.tf_base_tracker), virtual.true_position(poses.q, **conditions))
    e = error_map.registration.apply(p) - virtual.robot.forward(poses.q, tool=error_map.tf_flange_tool)[:, :3, 3]
    predicted, std = error_map.predict_errors(poses)
    miss = predicted - e
    return np.linalg.norm(miss, axis=1).mean(), np.mean(np.abs(miss) < 1.96 * std)


@pytest.fixture(scope="module")
def reversing():
    virtual = VirtualCell("backlash", seed=0)
    return virtual, virtual.measure(virtual.design(80, seed=0), seed=0)


@pytest.fixture(scope="module")
def reversing_map(reversing):
    virtual, samples = reversing
    return fit_cell(virtual.cell, samples, KRIGING)


def test_a_stated_approach_is_predicted_and_an_unknown_one_is_told(reversing, reversing_map):
    virtual, _ = reversing
    q = virtual.design(100, seed=9)
    signs = np.sign(np.diff(q, axis=0, prepend=[virtual._home]))
    known, inside = left(virtual, reversing_map, Poses(q=q, approach=signs), approach=signs)
    unknown, covered = left(virtual, reversing_map, Poses(q=q), approach=signs)
    assert known < 0.05 < 0.3 < unknown
    assert inside > 0.85
    assert covered > 0.9


def test_the_approach_from_the_order_of_rows_is_as_good_as_the_stated_one(reversing, reversing_map):
    virtual, samples = reversing
    said: list[str] = []
    error_map = fit_cell(
        stating(virtual.cell, approach="from-order"), replace(samples, approach=None), KRIGING, progress=said.append
    )
    assert "Finding the directions of approach from the order of rows" in said
    q = virtual.design(50, seed=9)
    signs = np.sign(np.diff(q, axis=0, prepend=[virtual._home]))
    poses = Poses(q=q, approach=signs)
    found, stated = (left(virtual, one, poses, approach=signs)[0] for one in (error_map, reversing_map))
    assert found < 1.2 * stated


def test_the_approach_can_be_left_out(reversing):
    virtual, samples = reversing
    assert fit_cell(stating(virtual.cell, approach="none"), samples, KRIGING).predictor.conditions == ()
    assert fit_cell(virtual.cell, samples, f"{KRIGING}:conditions=none").predictor.conditions == ()


def test_a_map_of_conditions_is_read_as_it_was_written(reversing, reversing_map, tmp_path):
    samples = reversing[1]
    again = load_map(reversing_map.save(tmp_path / "map.truepose") or tmp_path / "map.truepose")
    poses = Poses(q=samples.q, approach=samples.approach)
    for one, other in zip(reversing_map.predict_errors(poses), again.predict_errors(poses), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_samples_without_an_approach_update_a_map_that_knows_it(reversing, reversing_map):
    virtual, _ = reversing
    q = virtual.design(20, seed=5)
    new = replace(virtual.measure(q, seed=5), approach=None)
    updated = update_map(reversing_map, new)
    assert updated.samples.approach is not None
    assert (updated.samples.approach[-len(q) :] == 0).all()


def test_approaches_from_one_side_are_no_condition():
    virtual = VirtualCell("hard", seed=0)
    assert fit_cell(virtual.cell, virtual.measure(virtual.design(40)), KRIGING).predictor.conditions == ()


def program_of(virtual, q, length):
    """A KRL program that comes to each target straight along its tool axis, from `length` mm away, and both poses."""
    poses = virtual.robot.forward(q, tool=virtual.tf_flange_tool)
    starts = poses.copy()
    starts[:, :3, 3] -= length * poses[:, :3, 2]
    lines = ["DEF a()", "$TOOL=TOOL_DATA[1]", "$BASE=$NULLFRAME"]
    for pair in zip(starts, poses, strict=True):
        for motion, pose in zip(("PTP", "LIN"), pair, strict=True):
            c = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
            numbers = ",".join(f"{name} {x:.4f}" for name, x in zip("XYZABC", [*pose[:3, 3], *c], strict=True))
            lines.append(f"{motion} {{{numbers}}}")
    return "\n".join([*lines, "END", ""]), starts, poses


def test_a_straight_motion_tells_the_side_from_which_a_program_comes(reversing, reversing_map, tmp_path):
    virtual, _ = reversing
    q = virtual.design(12, seed=7)
    text, starts, poses = program_of(virtual, q, 60.0)
    path = tmp_path / "a.src"
    path.write_text(text)
    error_map = reversing_map
    corrected = correct_program(path, error_map, cell=with_tool(virtual), on_guard="skip")
    near = nearest_branch(virtual.robot.inverse(starts + 0.67 * (poses - starts), tool=virtual.tf_flange_tool), q)
    signs = np.sign(q - near)
    outcomes = corrected.targets
    reached = np.arange(1, len(outcomes.std), 2)
    p_command = outcomes.after[reached, :3]
    done = outcomes.corrected[reached]
    assert done.mean() > 0.6
    commands = poses.copy()
    commands[done, :3, 3] = p_command[done]
    q_command = nearest_branch(virtual.robot.inverse(commands, tool=virtual.tf_flange_tool), q)
    p = apply_transform(
        invert_transform(virtual.truth.tf_base_tracker), virtual.true_position(q_command, approach=signs)
    )
    miss = np.linalg.norm(error_map.registration.apply(p) - poses[:, :3, 3], axis=1)[done]
    assert miss.mean() < 0.15


def with_tool(virtual):
    from truepose.cell.sections import FramesSection

    tool = {key: getattr(virtual.cell.tool, key) for key in type(virtual.cell.tool).model_fields if key != "fit"}
    frames = FramesSection.model_validate({"tools": {1: {k: v for k, v in tool.items() if v is not None}}})
    return virtual.cell.model_copy(update={"frames": frames})


def test_a_stated_temperature_is_predicted_and_an_unknown_one_is_told():
    virtual = VirtualCell("cold-start", seed=0)
    samples = virtual.measure(virtual.design(80, seed=0), seed=0)
    error_map = fit_cell(virtual.cell, samples, KRIGING)
    q, warm = virtual.design(60, seed=9), np.full(60, virtual.preset.work_s)
    celsius = 20.0 + virtual.preset.warm_up_kelvin * (1.0 - np.exp(-4.0))
    known, inside = left(virtual, error_map, Poses(q=q, temperature=np.full(60, celsius)), time=warm)
    unknown, covered = left(virtual, error_map, Poses(q=q), time=warm)
    assert known < 0.05 < 0.1 < unknown
    assert inside > 0.85
    assert covered > 0.8  # the arm is warmer than it was at any sample
    stated = fit_cell(stating(virtual.cell, temperature_C=celsius), samples, KRIGING)
    assert left(virtual, stated, Poses(q=q), time=warm)[0] == pytest.approx(known, rel=0.05)


def test_a_station_that_moved_slowly_is_modelled():
    virtual = VirtualCell("creep", seed=2)
    samples = virtual.measure(virtual.design(100, seed=2), seed=2)
    with pytest.raises(DataError, match="drift"):
        fit_cell(virtual.cell, samples, f"{KRIGING}:conditions=none")
    said = fit_cell(virtual.cell, samples, KRIGING)
    assert said.predictor.conditions == ("time",)
    assert [fault["kind"] for fault in said.campaign["faults"]] == ["drift"]
    mean, inside = left(virtual, said, Poses(q=virtual.design(60, seed=9)))
    assert mean < 0.04
    assert inside > 0.85
    # on a clock of their own, the new samples are seen from the station at the end of the campaign
    end = np.full(10, samples.time[-1])
    updated = update_map(said, replace(virtual.measure(virtual.design(10, seed=3), seed=3, time=end), time=None))
    assert (np.diff(updated.samples.time) > 0).all()
    mean, inside = left(virtual, updated, Poses(q=virtual.design(60, seed=9)))
    assert mean < 0.06
    assert inside > 0.8


def test_an_arm_that_warmed_up_is_not_taken_for_a_station_that_moved():
    virtual = VirtualCell("cold-start", seed=0)
    samples = replace(virtual.measure(virtual.design(100, seed=0), seed=0), temperature=None)
    error_map = fit_cell(virtual.cell, samples, KRIGING)
    assert error_map.predictor.conditions == ("time",)
    warm = np.full(60, virtual.preset.work_s)
    _, inside = left(virtual, error_map, Poses(q=virtual.design(60, seed=9)), time=warm)
    assert inside > 0.9


def test_two_payloads_predict_a_third():
    virtual = VirtualCell("hard", seed=0)
    q = virtual.design(80, seed=0)
    samples = virtual.measure(q, seed=0, payload_kg=np.where(np.arange(80) % 2, 120.0, 20.0))
    error_map = fit_cell(virtual.cell, samples, KRIGING)
    there = virtual.design(60, seed=9)
    mean, inside = left(virtual, error_map, Poses(q=there, load=np.full(60, 70.0)), payload_kg=70.0)
    assert mean < 0.05
    assert inside > 0.85


@pytest.mark.parametrize("predictor", [KRIGING, "ordinary-kriging"])
def test_another_payload_than_measured_is_uncertain_and_not_corrected(predictor):
    virtual = VirtualCell("other-payload", seed=0)
    samples = virtual.measure(virtual.design(60, seed=0), seed=0)
    error_map = fit_cell(stating(virtual.cell, payload_kg=30.0), samples, predictor)
    q = virtual.design(40, seed=9)
    _, inside = left(virtual, error_map, Poses(q=q), payload_kg=30.0)
    assert inside > 0.9
    targets = virtual.robot.forward(q, tool=error_map.tf_flange_tool)
    assert not np.isin(error_map.correct(targets, on_guard="skip").verdict, ["correct", "clip"]).any()


def test_a_condition_at_work_that_samples_do_not_state_is_refused():
    virtual = VirtualCell("paper", seed=0)
    samples = virtual.measure(virtual.design(20))
    for name, column in (("temperature_C", "temp_C"), ("payload_kg", "load_kg")):
        with pytest.raises(DataError, match=f"no column {column}; add it, or take"):
            fit_cell(stating(virtual.cell, **{name: 25.0}), samples, KRIGING)


def samples_of(**conditions):
    rng = np.random.default_rng(0)
    q = rng.uniform(-1, 1, (30, 6))
    return Samples(rng.uniform(500, 1500, (30, 3)), q=q, **{k: v(q) for k, v in conditions.items()})


@pytest.mark.parametrize(
    ("conditions", "part"),
    [
        ({"temperature": lambda q: np.full(30, 293.0)}, "temp_C is 293 °C; is it kelvin"),
        ({"temperature": lambda q: np.full(30, 71.0)}, "temp_C is 71 °C; is it °F"),
        ({"load": lambda q: np.full(30, -1.0)}, "load_kg is negative"),
        ({"approach": lambda q: np.full((30, 6), 0.5)}, "approach must be -1, 0 or \\+1"),
        ({"approach": lambda q: np.ones((30, 4))}, "approach has 4 columns for 6 joints"),
        ({"approach": lambda q: -np.sign(np.diff(q, axis=0, prepend=q[:1]))}, "opposite to the order of rows"),
    ],
)
def test_conditions_that_cannot_be_are_named(conditions, part):
    with pytest.raises(DataError, match=part):
        check(samples_of(**conditions))


def test_approaches_of_their_own_ways_are_not_compared_with_the_order():
    check(samples_of(approach=lambda q: np.ones((30, 6))))
    check(samples_of(approach=lambda q: np.random.default_rng(1).choice([-1.0, 1.0], (30, 6))))


def test_a_time_that_runs_backwards_gives_no_order():
    samples = samples_of(time=lambda q: np.r_[np.arange(20.0), 5.0 + np.arange(10.0)])
    with pytest.raises(DataError, match=r"row 20.*time runs backwards; sort the rows"):
        approach_from_order(samples)


def test_a_missing_row_leaves_the_next_approach_unknown():
    samples = samples_of()
    signs = approach_from_order(samples[np.delete(np.arange(30), 10)])
    assert (signs[10] == 0).all()
    np.testing.assert_array_equal(signs[11:], approach_from_order(samples)[12:])


def test_only_an_effect_in_the_model_takes_a_drift_out_of_the_deviation():
    virtual = VirtualCell("creep", seed=2)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(100, seed=2), seed=2), KRIGING)
    predictor = error_map.predictor
    assert predictor.models("time")
    assert not predictor.models("approach")
    moved = {**error_map.campaign, "faults": [{**fault, "kind": "moved"} for fault in error_map.campaign["faults"]]}
    assert (error_map.changed(campaign=moved).unexplained > error_map.unexplained + 1e-3).all()
    tolerance = predictor.hyper_.tolerance.copy()
    tolerance[2:] = predictor.hyper_.least_tolerance[2:]
    without = predictor.with_fitted_parameters().set_params(
        hyper={**predictor.hyper_.to_dict(), "tolerance": tolerance.tolist()}
    )
    without.fit(error_map.fitted_inputs, error_map.e, predictor.noise_std_)
    assert not without.models("time")
    assert (error_map.changed(predictor=without).unexplained > error_map.unexplained + 1e-3).all()


def test_a_long_turn_on_a_line_counts_by_its_end():
    robot = VirtualCell("paper", seed=0).robot
    q = np.deg2rad([[0.0, -75.0, 95.0, 20.0, 50.0, 30.0]])
    poses = robot.forward(q)
    before = poses.copy()
    turn = Rotation.from_euler("xyz", [50.0, -70.0, 60.0], degrees=True)
    before[0, :3, :3] = turn.as_matrix() @ poses[0, :3, :3]
    near = poses.copy()
    near[0, :3, :3] = Rotation.from_rotvec(0.01 * turn.as_rotvec()).as_matrix() @ poses[0, :3, :3]
    end = nearest_branch(robot.inverse(near), q)
    signs = approach_on_lines(robot, q, poses, before)
    moved = np.abs(q - end) > 1e-4
    np.testing.assert_array_equal(signs[moved], np.sign(q - end)[moved])


def loaded(n, seed, kg, centres, noise=0.01):
    """Samples of a plain arm that bends under payloads with centres of mass of their own (n, 3) [mm], and the truth."""
    virtual = VirtualCell("hard", seed=4, effects={"geometry", "tool"})
    q = virtual.design(n, seed=seed)
    own = rough_masses(virtual.robot)
    loads = [Load(mass, centre, own) for mass, centre in zip(kg, centres, strict=True)]
    torque = np.array([gravity_torque(virtual.robot, row[None], one)[0] for row, one in zip(q, loads, strict=True)])
    bent = q + np.array([2e-7, 4e-7, 4e-7, 2e-6, 2e-6, 2e-6]) * torque
    p = virtual.truth.robot.forward(bent, tool=virtual.truth.tf_flange_tool)[:, :3, 3]
    read = apply_transform(invert_transform(virtual.truth.tf_base_tracker), p)
    read += noise * np.random.default_rng(seed).normal(size=read.shape)
    return virtual, Samples(read, q=q, load=kg, p_load=centres, source="loads.csv")


@pytest.fixture(scope="module")
def loads():
    rng = np.random.default_rng(1)
    kg, side = rng.choice([20.0, 120.0], 100), rng.choice([-400.0, 400.0], 100)
    return loaded(100, 1, kg, np.column_stack([side, 0 * side, 200.0 + 0 * side]))


@pytest.mark.exhaustive
def test_centres_of_mass_are_used(loads, tmp_path):
    """Of payloads on either side of the flange; in files and maps, at poses, and in the cell for poses without."""
    virtual, samples = loads
    known = fit_cell(virtual.cell, samples, "kinematic-kriging")
    unstated = replace(samples, p_load=None)
    with pytest.raises(DataError, match="or the centres of mass of the payloads differ, which no column states"):
        fit_cell(virtual.cell, unstated, "kinematic-kriging")
    unknown = fit_cell(virtual.cell, unstated, "kinematic-kriging", accept_campaign=True)
    assert "centre" in known.predictor.conditions
    assert "centre" not in unknown.predictor.conditions
    kg, centre = np.full(60, 80.0), np.tile([300.0, 0.0, 250.0], (60, 1))
    _, truth = loaded(60, 2, kg, centre, noise=0.0)
    poses = Poses(q=truth.q, load=kg, p_load=centre)

    def miss(error_map, poses):
        return np.linalg.norm(error_map.errors(truth) - error_map.predict_errors(poses)[0], axis=1).mean()

    assert miss(known, poses) < 0.03
    assert miss(known, poses) < 0.3 * miss(unknown, replace(poses, p_load=None))
    payload = type(virtual.cell.payload)(mass_kg=80.0, x_mm=300.0, y_mm=0.0, z_mm=250.0)
    stated = known.changed(cell=known.cell.model_copy(update={"payload": payload}))
    assert miss(stated, Poses(q=truth.q, load=kg)) == pytest.approx(miss(known, poses))
    write_samples(tmp_path / "loads.csv", samples)
    np.testing.assert_allclose(read_samples(tmp_path / "loads.csv").p_load, samples.p_load)
    known.save(tmp_path / "map.truepose")
    again = load_map(tmp_path / "map.truepose")
    np.testing.assert_allclose(again.predict_errors(poses)[0], known.predict_errors(poses)[0], atol=1e-9)
    with pytest.raises(DataError, match="cannot be frozen"):
        known.freeze()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"load": None}, "there is no load_kg"),
        ({"p_load": np.full((100, 3), 2500.0)}, "4330 mm from the flange"),
    ],
)
def test_centres_without_mass_or_far_away_are_refused(loads, changes, message):
    _, samples = loads
    with pytest.raises(DataError, match=message):
        check(replace(samples, **changes))


@pytest.mark.exhaustive
def test_payloads_without_a_centre_are_told(run, loads, tmp_path):
    virtual, samples = loads
    cell, table, out = (tmp_path / name for name in ("cell.toml", "samples.csv", "map.truepose"))
    cell.write_text(virtual.cell.to_toml())
    for one, told in ((samples, False), (replace(samples, p_load=None), True)):
        write_samples(table, one)
        accepted = ["--accept-campaign"] * told  # loads on either side of the flange make two populations
        done = run("fit", cell, table, "--predictor", KRIGING, "--out", out, "--force", *accepted)
        assert done.code == 0, done.err
        assert ("without their centre of mass" in " ".join(done.out.split())) == told


@pytest.mark.exhaustive
def test_a_series_from_one_side_is_told(run, tmp_path):
    """Nothing in it shows lost motion, which has a prior."""
    virtual = VirtualCell("paper")
    cell, table, out = (tmp_path / name for name in ("cell.toml", "samples.csv", "map.truepose"))
    cell.write_text(virtual.cell.to_toml())
    q = virtual.design(24)
    for signs, told in ((np.ones_like(q), True), (np.where(np.arange(24)[:, None] % 2, 1.0, -1.0) + 0 * q, False)):
        write_samples(table, virtual.measure(q, approach=signs, seed=1))
        done = run("fit", cell, table, "--predictor", "registration", "--out", out, "--force")
        assert done.code == 0, done.err
        shown = " ".join(done.out.split())
        assert ("Fact one-sided" in shown and "measure from both sides" in shown) == told
