"""Conditions of targets: corrections know what predictions know, and what no sample had is uncertain."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from truepose import Cell, VirtualCell, correct_program, fit_cell, read_program, recheck
from truepose.cell import ConditionsSection, Payload
from truepose.errors import DataError, FileError, RefusedError
from truepose.geometry import make_transform
from truepose.programs.payloads import loads_of, tools_without_payload
from truepose.robots import nearest_branch
from truepose.samples import Poses

KRIGING = "kinematic-kriging"
N = 12
HEAVY, LIGHT = 120.0, 20.0


def fitted(preset, n=60, **conditions):
    virtual = VirtualCell(preset, seed=0)
    return virtual, fit_cell(virtual.cell, virtual.measure(virtual.design(n, seed=0), seed=0, **conditions), KRIGING)


def targets(virtual):
    """Return the configurations of a design that are nearest to its middle, inside the sampled region, (N, 6) [rad]."""
    q = virtual.design(64, seed=5)
    return q[np.argsort(np.linalg.norm(q - q.mean(axis=0), axis=1))[:N]]


@pytest.fixture(scope="module")
def loaded():
    """A cell whose samples have two payloads; from which side the joints came is not stated."""
    virtual = VirtualCell("hard", seed=0)
    payload = np.where(np.arange(60) % 2, LIGHT, HEAVY)
    samples = virtual.measure(virtual.design(60, seed=0), seed=0, payload_kg=payload)
    return virtual, fit_cell(virtual.cell, replace(samples, approach=None), KRIGING)


@pytest.fixture(scope="module")
def centred(loaded):
    """The same samples with centres of mass, and a cell that states one."""
    virtual, error_map = loaded
    samples = error_map.samples
    p_load = np.where(np.arange(len(samples))[:, None] % 3, [60.0, 0.0, 220.0], [-60.0, 40.0, 220.0])
    return virtual, fit_cell(virtual.cell, replace(samples, p_load=p_load), KRIGING)


@pytest.fixture(scope="module")
def single():
    """A cell whose samples have one payload; from which side the joints came is not stated."""
    virtual = VirtualCell("hard", seed=0)
    return virtual, replace(virtual.measure(virtual.design(60, seed=0), seed=0), approach=None)


STATED = {
    "payload": ("loaded", {"load": np.full(N, HEAVY)}),
    "another payload": ("loaded", {"load": np.linspace(LIGHT, HEAVY, N)}),
    "centre of the table": ("centred", {"load": np.full(N, HEAVY), "p_load": np.tile([0.0, 90.0, 150.0], (N, 1))}),
    "centre of the cell": ("centred", {"load": np.full(N, HEAVY)}),
    "nothing": ("centred", {}),
    "temperature": ("cold-start", {"temperature": np.full(N, 27.0)}),
    "approach": ("backlash", {"approach": np.ones((N, 6))}),
}


@pytest.mark.parametrize("stated", STATED)
@pytest.mark.parametrize("orientation", [False, True])
@pytest.mark.sampled(1)
def test_a_correction_is_for_the_conditions_that_a_prediction_is_for(request, stated, orientation):
    """The error that a correction takes away is the one that is predicted at its command, with its deviation."""
    where, conditions = STATED[stated]
    known = where in ("loaded", "centred")
    virtual, error_map = request.getfixturevalue(where) if known else fitted(where)
    q = targets(virtual)
    found = error_map.correct(Poses(q=q, **conditions), orientation=orientation)
    done = found.verdict == "correct"
    assert done.mean() > 0.8
    assert np.isin(found.verdict, ["correct", "below uncertainty"]).all()
    tool = error_map.tf_flange_tool
    turned = virtual.robot.forward(q, tool=tool)[:, :3, :3]
    if orientation:
        turned = Rotation.from_rotvec(found.rotation).as_matrix() @ turned
    commands = make_transform(turned, found.p_command)
    at = Poses(q=nearest_branch(virtual.robot.inverse(commands, tool=tool), q), **conditions)
    e, std = error_map.predict_errors(at)
    np.testing.assert_allclose(found.e[done], e[done], atol=2e-4)
    np.testing.assert_allclose(found.std[done], std[done], atol=2e-4)
    if orientation:
        w, w_std = (one[:, 3:] for one in error_map.predict_pose_errors(at))
        np.testing.assert_allclose(found.rotation[done], -w[done], atol=1e-6)
        np.testing.assert_allclose(found.rotation_std[done], w_std[done], atol=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("predictor", [KRIGING, "calibration", "ordinary-kriging"])
@pytest.mark.parametrize("condition", [{"load": 30.0}, {"temperature": 35.0}])
def test_a_pose_under_conditions_that_no_sample_had_is_uncertain(single, predictor, condition):
    virtual, samples = single
    error_map = fit_cell(virtual.cell, samples, predictor)
    q = targets(virtual)
    plain = np.linalg.norm(error_map.predict(Poses(q=q)).std, axis=1)
    (name, value), size = next(iter(condition.items())), {"load": 1.0, "temperature": 0.2}
    poses = Poses(q=q, **{name: np.full(N, value)})
    std = np.linalg.norm(error_map.predict_errors(poses)[1], axis=1)
    assert (std > np.hypot(plain, size[name])).all()
    np.testing.assert_allclose(np.linalg.norm(error_map.predict(poses).std, axis=1), std)
    found = error_map.correct(poses, accept_weak_map=True)  # the guards are tried, not what the map is worth
    assert (found.verdict == "refuse").all()
    np.testing.assert_array_equal(found.p_command, found.p_target)
    if error_map.knows_orientation:
        pose_std = error_map.predict_pose_errors(poses)[1]
        np.testing.assert_allclose(np.linalg.norm(pose_std[:, :3], axis=1), std, rtol=0.02)
        assert (pose_std[:, 3:] > error_map.predict_pose_errors(Poses(q=q))[1][:, 3:]).all()
    usual = Poses(q=q, load=np.full(N, float(samples.load[0])), temperature=np.full(N, samples.temperature.mean()))
    np.testing.assert_allclose(np.linalg.norm(error_map.predict_errors(usual)[1], axis=1), plain)


@pytest.mark.parametrize("predictor", [KRIGING, "ordinary-kriging"])
def test_samples_under_conditions_that_no_sample_had_do_not_pass_for_a_map_that_holds(single, predictor):
    """The uncertainty of a strange condition is for poses that are not measured; readings show its effect."""
    virtual, samples = single
    error_map = fit_cell(virtual.cell, samples, predictor)
    q = virtual.design(20, seed=4)
    found = recheck(error_map, virtual.measure(q, seed=4, payload_kg=30.0))
    assert found.holding.verdict != "holds"
    assert found.words[1] == (
        "20 of 20 samples have a payload of 30 kg, those of the map 120 kg, and the map does not know its effect: fit "
        "a new map with all samples."
    )
    usual = recheck(error_map, virtual.measure(q, seed=4))
    assert usual.holding.verdict == "holds"
    assert usual.strange == []


def test_loads_of_targets_are_those_of_a_table(loaded):
    virtual, error_map = loaded
    q = targets(virtual)
    load = np.where(np.arange(N) % 2, LIGHT, np.nan)
    found = error_map.correct(virtual.robot.forward(q, tool=error_map.tf_flange_tool), load=load)
    light = error_map.correct(Poses(q=q, load=np.full(N, LIGHT)))
    usual = error_map.correct(Poses(q=q))
    for odd, other in ((True, light), (False, usual)):
        rows = np.arange(N) % 2 == odd
        np.testing.assert_allclose(found.p_command[rows], other.p_command[rows], atol=1e-6)
    with pytest.raises(DataError, match=r"load has shape \(3,\); expected \(12,\)"):
        error_map.correct(q, load=np.zeros(3))
    with pytest.raises(DataError, match="cannot be combined with a table of poses"):
        error_map.correct(Poses(q=q), load=load)


# --- tools of a program -----------------------------------------------------------------------------------------------


RAPID = """MODULE A
  PERS tooldata tGun:=[TRUE,TOOL,[5,[0,0,50],[1,0,0,0],0,0,0]];
  PERS tooldata tNew:=[TRUE,TOOL,[5,[0,0,50],[1,0,0,0],0,0,0]];
  LOCAL CONST robtarget p1:=[[1700,0,900],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p2:=[[1700,10,900],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveL p1,v100,fine,tGun\\WObj:=wobj0;
    MoveL p2,v100,fine,tNew\\WObj:=wobj0;
  ENDPROC
ENDMODULE
"""


def stating_payloads(cell, payloads):
    return cell.model_copy(update={"conditions": ConditionsSection(payloads=payloads)})


def with_tools(virtual, payloads):
    tool = {key: value for key, value in virtual.cell.tool.model_dump(exclude_unset=True).items() if key != "fit"}
    rows = virtual.cell.model_dump(exclude_unset=True)
    return Cell.model_validate(
        {**rows, "frames": {"tools": {"1": tool, "2": tool}}, "conditions": {"payloads": payloads}}
    )


def changing_tools(virtual, q):
    """Return a KRL program whose first half of targets is reached with tool 1, and the other with tool 2."""
    lines = ["DEF a()", "$BASE=$NULLFRAME"]
    for i, pose in enumerate(virtual.robot.forward(q, tool=virtual.tf_flange_tool)):
        if i % (len(q) // 2) == 0:
            lines.append(f"$TOOL=TOOL_DATA[{1 + i // (len(q) // 2)}]")
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
        numbers = ",".join(f"{name} {x:.4f}" for name, x in zip("XYZABC", [*pose[:3, 3], *angles], strict=True))
        lines.append(f"PTP {{{numbers}}}")
    return "\n".join([*lines, "END", ""])


def test_each_target_has_the_payload_of_its_tool(loaded, tmp_path):
    virtual, error_map = loaded
    path, q = tmp_path / "a.src", targets(virtual)
    path.write_text(changing_tools(virtual, q))
    cell = with_tools(virtual, {"1": {"mass_kg": LIGHT}, "2": {"mass_kg": HEAVY}})
    corrected = correct_program(path, error_map, cell=cell)
    kg = np.where(np.arange(N) < N // 2, LIGHT, HEAVY)
    expected = error_map.correct(Poses(q=q, load=kg))
    done = corrected.targets.corrected
    np.testing.assert_array_equal(done, expected.verdict == "correct")
    assert done.mean() > 0.8
    np.testing.assert_allclose(corrected.targets.after[done, :3], expected.p_command[done], atol=2e-3)
    other = error_map.correct(Poses(q=q))
    assert np.linalg.norm(other.p_command - expected.p_command, axis=1).max() > 0.3
    assert any("payload with tool 1 20 kg, payload with tool 2 120 kg" in warning for warning in corrected.warnings)
    assert not any("states no payload" in warning for warning in corrected.warnings)
    read = Cell.from_toml(cell.to_toml())
    assert read.conditions.payloads[2].mass_kg == HEAVY


def test_a_payload_that_no_sample_had_is_not_corrected(single, tmp_path):
    """Of a map that does not know payloads; one that is fitted for the tools knows them, and how badly."""
    virtual, samples = single
    path, q = tmp_path / "a.src", targets(virtual)
    path.write_text(changing_tools(virtual, q))
    cell = with_tools(virtual, {"2": {"mass_kg": LIGHT}})
    for error_map in (fit_cell(virtual.cell, samples, KRIGING), fit_cell(cell, samples, KRIGING)):
        with pytest.raises(RefusedError, match="standard deviation"):
            correct_program(path, error_map, cell=cell)
        corrected = correct_program(path, error_map, cell=cell, on_guard="skip")
        assert corrected.targets.corrected.tolist() == [True] * (N // 2) + [False] * (N // 2)
        assert any("states no payload with TOOL_DATA[1]: their" in one for one in corrected.warnings)


def test_payloads_belong_to_tools_by_name_too(loaded, tmp_path):
    """Of an ABB program, whose tools have names; a name that no tool has is told."""
    text = RAPID.replace("TOOL", "[[110,0,360],[1,0,0,0]]")
    path = tmp_path / "A.mod"
    path.write_text(text)
    for names, missing in ((("tGun", "TNEW"), ""), (("tGnu", "tNew"), "tGun")):
        payloads = {names[0]: Payload(mass_kg=LIGHT, x_mm=10.0), names[1]: Payload(mass_kg=HEAVY)}
        cell = stating_payloads(loaded[0].cell, payloads)
        program, corrector = read_program(path), loaded[1].at_work(cell.conditions)
        (_, columns), *more = program.targets.chunks()
        found = loads_of(columns, corrector)
        assert more == []
        np.testing.assert_array_equal(found["load"], [np.nan if missing else LIGHT, HEAVY])
        assert np.isnan(found["p_load"][1]).all()
        if not missing:
            np.testing.assert_array_equal(found["p_load"][0], [10.0, 0.0, 0.0])
        told = tools_without_payload(program, corrector)
        assert [missing in one for one in told] == ([True] if missing else [])


def test_payloads_with_tools_are_checked(single):
    virtual, samples = single
    with pytest.raises(FileError, match=r"conditions\.payloads\.3.*mass_kg.*is missing"):
        Cell.from_toml(virtual.cell.to_toml() + "\n[conditions.payloads.3]\nx_mm = 20.0\n", source="cell.toml")
    no_mass = virtual.cell.model_copy(update={"payload": type(virtual.cell.payload)()})
    error_map = fit_cell(no_mass, replace(samples, load=None), "calibration")
    with pytest.raises(DataError, match="no column load_kg"):
        error_map.at_work(ConditionsSection.model_validate({"payloads": {"1": {"mass_kg": 3.0}}}))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("load", [-5.0, float("inf"), float("-inf")])
def test_a_mass_that_cannot_be_is_refused(load: float) -> None:
    virtual = VirtualCell("paper", seed=1)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(30)), "ordinary-kriging")
    q = virtual.design(2, seed=3)
    with pytest.raises(DataError, match="negative or infinite"):
        error_map.correct(virtual.robot.forward(q, tool=virtual.tf_flange_tool), load=np.array([1.0, load]))
    with pytest.raises(DataError, match=r"load_kg is negative|load is not finite"):
        error_map.predict(Poses(q=q, load=np.array([1.0, load])))


@pytest.mark.parametrize("kg", [-5.0, float("inf"), float("nan")])
def test_a_payload_that_cannot_be_is_refused_everywhere(loaded, run, kg: float, tmp_path) -> None:
    """In tables, cells, at work, at targets, by the command line, and in the input of a predictor."""
    virtual, error_map = loaded
    q, bad = virtual.design(2, seed=3), np.full(2, kg)
    cell = virtual.cell.model_dump(exclude_unset=True)
    predictor = error_map.predictor
    columns = np.full((2, predictor.points_.shape[1] - 6), 1.0)
    columns[:, -1] = kg
    assert predictor.conditions[-1] == "payload"
    stated = virtual.cell.model_copy(update={"conditions": ConditionsSection.model_construct(payload_kg=kg)})
    error_map.save(tmp_path / "map.truepose")
    surfaces = {
        "samples": lambda: replace(virtual.measure(q), load=bad),
        "poses": lambda: Poses(q=q, load=bad),
        "[payload]": lambda: Cell.model_validate({**cell, "payload": {"mass_kg": kg}}),
        "[conditions]": lambda: Cell.model_validate({**cell, "conditions": {"payload_kg": kg}}),
        "payloads": lambda: Cell.model_validate({**cell, "conditions": {"payloads": {"1": {"mass_kg": kg}}}}),
        "at_work": lambda: error_map.at_work(ConditionsSection.model_construct(payload_kg=kg)),
        "fit_cell": lambda: fit_cell(stated, error_map.samples, "registration"),
        "work": lambda: predictor.at_work({"payload": kg}),
    }
    if not np.isnan(kg):  # NaN stands for what is not known
        surfaces["load"] = lambda: error_map.correct(virtual.robot.forward(q), load=bad)
        surfaces["X"] = lambda: predictor.predict(np.column_stack([q, columns]))
    accepted = []
    for name, refused in surfaces.items():
        with contextlib.suppress(DataError, ValueError):
            refused()
            accepted.append(name)
    assert accepted == []
    (tmp_path / "poses.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,-75,95,0,50,0\n")
    done = run("predict", tmp_path / "map.truepose", tmp_path / "poses.csv", "--payload", str(kg))
    assert done.code in (1, 2)
    assert "0 kg or more" in done.err or "finite number" in done.err


def test_a_model_without_compliance_does_not_claim_to_know_payloads(loaded):
    """Before, it said that it models payload, and had the same error and deviation for 0 and 400 kg."""
    virtual, error_map = loaded
    stiff = fit_cell(virtual.cell, error_map.samples, f"{KRIGING}:compliance=no")
    assert "payload" not in stiff.predictor.conditions
    assert not stiff.predictor.models("payload")
    q = targets(virtual)
    near, far = (np.linalg.norm(stiff.predict(Poses(q=q, load=np.full(N, kg))).std, axis=1) for kg in (LIGHT, 400.0))
    assert (far > 1.0 + near).all()
