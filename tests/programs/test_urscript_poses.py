"""URScript: poses that go through features, functions, lists and names, each by what the robot would do."""

# ruff: noqa: E501

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program

P = "p[0.3,-0.1,.25,0,3.14159,0]"
Q = "p[0.4,-0.1,.25,0,3.14159,0]"
F = "p[0.5,0.1,0.02,0.1,-0.2,1.1]"
MEASURED = FrameTable(tool="map")
"""The tool in force is the one that the map was measured with."""


def reading(folder: Path, code: str, frames: FrameTable | None = None, ending: str = ".script") -> Program:
    path = folder / f"a{ending}"
    path.write_text(f"def prog():\n{code}\nend\n")
    return read_program(path, frames or MEASURED)


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def pose(text: str) -> np.ndarray:
    """Return the transform [mm] of a pose as a robot reads it."""
    values = [float(number) for number in text.strip("p[]").split(",")]
    return make_transform(euler("ur", values[3:]), 1000.0 * np.array(values[:3]))


@pytest.mark.parametrize(
    ("code", "where"),
    [
        (f"f={F}\nmovel(pose_trans(f,{P}))", pose(F) @ pose(P)),
        (f"movel(pose_trans({F},{P}), a=1.2)", pose(F) @ pose(P)),
        (f"f={F}\nw={P}\nmovep(pose_trans(f,w), r=0.01)", pose(F) @ pose(P)),
        (f"f={F}\ng={Q}\nmovel(pose_trans(f,pose_trans(pose_inv(g),{P})))", pose(F) @ np.linalg.inv(pose(Q)) @ pose(P)),
        (f"f={F}\ng=pose_trans(f,{Q})\nmovel(pose_trans(g,{P}))", pose(F) @ pose(Q) @ pose(P)),
        (f"f={F}\nw=pose_trans(f,{P})\nmovel(w)", pose(F) @ pose(P)),
        (f"f={F}\nw=pose_trans(f,{P})\nmovej(get_inverse_kin(w, qnear=[0,0,0,0,0,0]))", pose(F) @ pose(P)),
        (f"f={F}\nq=get_inverse_kin(pose_trans(f,{P}))\nmovej(q)", pose(F) @ pose(P)),
        (f"def go(w, v):\nmovel(pose_trans(f, w), v=v)\nend\nf={F}\ngo({P}, 0.1)", pose(F) @ pose(P)),
        (f"def go(f, w):\nmovel(pose_trans(f, w))\nend\ngo({F}, {P})", pose(F) @ pose(P)),
        (f"def go(w):\nmovel(w)\nend\ndef via(u):\ngo(u)\nend\nvia({P})", pose(P)),
        (f"def go(w):\nmovel(w)\nend\ngo(w={P})", pose(P)),
        (f"movel(a=1.2, pose={P})", pose(P)),
        (f"movej(get_inverse_kin(x={P}))", pose(P)),
    ],
)  # fmt: skip
def test_the_numbers_that_are_corrected_and_their_frame(tmp_path: Path, code: str, where: np.ndarray) -> None:
    program = reading(tmp_path, code)
    assert list(verdicts(program).values()) == ["correct"], list(program.targets)
    np.testing.assert_allclose(program.poses_base()[0], where, atol=1e-9)


def test_corrections_are_turned_into_the_feature(tmp_path: Path, make_map: Any) -> None:
    program = reading(tmp_path, f"f={F}\nmovel(pose_trans(f,{P}))\nmovel({Q})")
    shift = np.array([0.5, -0.25, 0.125])
    corrected = correct_program(program, make_map(shift))
    text = corrected.files[program.path].decode()
    assert text.splitlines()[1] == f"f={F}"
    assert text.splitlines()[3] == "movel(p[0.4005,-0.10025,.250125,0,3.14159,0])"
    written = text.splitlines()[2].removeprefix("movel(pose_trans(f,").removesuffix("))")
    np.testing.assert_allclose((pose(F) @ pose(written))[:3, 3] - (pose(F) @ pose(P))[:3, 3], shift, atol=2e-3)


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (f"f=get_actual_tcp_pose()\nmovel(pose_trans(f,{P}))", {"movel:3": "skip"}),
        (f"f={F}\nf=get_actual_tcp_pose()\nmovel(pose_trans(f,{P}))", {"movel:4": "skip"}),
        (f"f={F}\nf[2]=0.1\nmovel(pose_trans(f,{P}))", {"movel:4": "skip"}),
        (f"f={F}\nmovel(pose_trans(f,p[x,0,0,0,0,0]))", {"movel:3": "skip"}),
        (f"f={F}\nmovel(pose_trans(f,w))", {"movel:3": "skip"}),
        (f"f={F}\nw={P}\nmovel(pose_trans(f,w))\nmovel(w)", {"w": "refuse"}),
        (f"f={F}\nw={P}\nmovel(pose_trans(f,w))\nx=pose_dist(w,f)", {"w": "refuse"}),
        (f"f={F}\nmovel(f)\nmovel(pose_trans(f,{P}))", {"f": "refuse", "movel:4": "skip"}),
        (f"movel(pose_trans({P},w)[0])", {"movel:2": "skip"}),
        (f"movel(pose_sub({P},{Q}))", {"movel:2": "skip"}),
        (f"movej(get_inverse_kin({P}, tcp=p[0,0,0.3,0,0,0]))", {"movej:2": "skip"}),
        (f"w=pose_trans(w,{P})\nmovel(w)", {"movel:3": "skip"}),
        (f"def go(w):\nw=pose_add(w,{Q})\nmovel(w)\nend\ngo({P})", {"movel:4": "skip", "go:6 argument 1": "skip"}),
        (f"def go(w):\nmovel(w)\nx=w[2]+1\nend\ngo({P})", {"go:6 argument 1": "refuse"}),
        (f"def go(w):\nmovel(w)\nend\ngo({P})\ngo(where())", {"go:5 argument 1": "correct", "go:6 argument 1": "skip"}),
        (f"def go(w):\nx=pose_dist(w,{Q})\nend\ngo({P})", {"go:5 argument 1": "skip"}),
        (f"w={P}\ndef go(w):\nmovel(w)\nend\ngo(w)\nmovel(w)\nw[2]=0.3", {"w": "skip"}),
        (f"movel(f({P}))", {"movel:2": "skip", "f:2 argument 1": "skip"}),
        (f"movel(a=1.2, q={P})", {"movel:2": "refuse"}),
        (f"w={P}\nmovel(w)\nmovel(pose_trans(w, f(w)))", {"w": "refuse", "movel:4": "skip"}),
        (f"w={P}\nmovel(w)\nmovel(pose_trans({Q}, p[g(w),0,0,0,0,0]))", {"w": "refuse", "movel:4": "skip"}),
        (f"w={P}\nmovel(w)\nx=pose_trans({Q}, g(w))", {"w": "refuse"}),
    ],
)  # fmt: skip
def test_what_is_known_at_run_time_only_stays(tmp_path: Path, code: str, expected: dict[str, str]) -> None:
    program = reading(tmp_path, code)
    assert verdicts(program) == expected, list(program.targets)


def test_a_feature_of_the_controller_is_found_by_its_name(tmp_path: Path) -> None:
    code = f"movel(pose_trans(Plane_1,{P}))"
    unknown = reading(tmp_path, code).targets[0]
    assert (unknown.verdict, "[frames.bases.Plane_1]" in unknown.reason) == ("skip", True)
    known = reading(tmp_path, code, FrameTable(bases={"Plane_1": pose(F)}, tool="map"))
    assert (known.targets[0].frame, known.targets[0].verdict) == ("Plane_1", "correct")
    np.testing.assert_allclose(known.poses_base()[0], pose(F) @ pose(P), atol=1e-9)
    own = reading(tmp_path, f"Plane_1={Q}\n{code}", FrameTable(bases={"Plane_1": pose(F)}, tool="map"))
    np.testing.assert_allclose(own.poses_base()[0], pose(Q) @ pose(P), atol=1e-9)


@pytest.mark.parametrize("code", ["movej({})", "q={}\nmovej(q, a=1)", "q={}\nmovej(q)\nmovej(get_inverse_kin(w, qnear=q))"])  # fmt: skip
def test_joints_are_joint_targets(tmp_path: Path, code: str) -> None:
    path = tmp_path / "a.script"
    path.write_text(
        f"def prog():\nw={P}\nforce=[0,0,10,0,0,0]\nforce_to(force)\n{code.format('[0.1,-1.5, 1.5,-1,-1.5,0]')}\nend\n"
    )
    for allowed, verdict in ((False, "skip"), (True, "correct")):
        found = [
            t for t in read_program(path, MEASURED, ReadOptions(joint_targets=allowed)).targets if t.joints is not None
        ]
        assert [(t.verdict, t.joints) for t in found] == [(verdict, (0.1, -1.5, 1.5, -1.0, -1.5, 0.0))], found


@pytest.mark.parametrize(
    "code",
    ["q={}\nq[5]=q[5]+0.1\nmovej(q)", "q={}\nmovej(q)\nx=q[1]", "movel(pose_trans({}, p[0,0,0,0,0,0]))", "q={}\nmovel(pose_trans(w, q))"],
)  # fmt: skip
def test_joints_that_the_program_computes_with_stay(tmp_path: Path, code: str) -> None:
    path = tmp_path / "a.script"
    path.write_text(f"def prog():\nw={P}\n{code.format('[0.1,-1.5, 1.5,-1,-1.5,0]')}\nend\n")
    assert read_program(path, MEASURED, ReadOptions(joint_targets=True)).counts()["correct"] == 0


def test_lists_of_poses(tmp_path: Path) -> None:
    loop = f"pts=[{P}, {Q}]\ni=0\nwhile i < size(pts):\n{{}}\ni=i+1\nend"
    for body in ("movel(pts[i])", "w=pts[i]\nmovel(w)", "go(pts[i])\nend\ndef go(w):\nmovel(w)"):
        code = loop.format(body) if "def" not in body else f"def go(w):\nmovel(w)\nend\n{loop.format('go(pts[i])')}"
        assert verdicts(reading(tmp_path, code)) == {"pts[0]": "correct", "pts[1]": "correct"}, body
    assert verdicts(reading(tmp_path, f"pts=[{P},{Q}]\nmovel(pts[1])")) == {"pts[1]": "correct"}
    for write in ("pts[1]=get_actual_tcp_pose()", f"pts=[{Q}]", "pts=read()"):
        assert set(verdicts(reading(tmp_path, f"pts=[{P},{Q}]\n{write}\nmovel(pts[i])")).values()) == {"skip"}, write
    assert set(verdicts(reading(tmp_path, f"pts=[{P},{Q}]\nmovel(pts[i])\nx=pts[0]")).values()) == {"refuse"}
    assert verdicts(reading(tmp_path, f"pts=[{P},{Q}]\nmovel(pts[2])")) == {"movel:3": "skip"}


def test_tcps_by_name_and_through_functions(tmp_path: Path) -> None:
    for code in (
        f"t=p[0,0,0.1,0,0,0]\nset_tcp(t)\nmovel({P})",
        f'set_tcp(p[0,0,0.1,0,0,0], "grip")\nmovel({P})',
        f"def use():\nset_tcp(p[0,0,0.1,0,0,0])\nend\nuse()\nmovel({P})",
        f"def use(t):\nset_tcp(t)\nend\nuse(p[0,0,0.1,0,0,0])\nmovel({P})",
        f"def go(w):\nmovel(w)\nend\nset_tcp(p[0,0,0.1,0,0,0])\ngo({P})",
    ):
        program = reading(tmp_path, code)
        assert set(verdicts(program).values()) == {"correct"}, (code, list(program.targets))
        np.testing.assert_allclose(program.tools()[0][:3, 3], [0, 0, 100], atol=1e-9)
    for code in (
        f"t=p[0,0,0.1,0,0,0]\nt[2]=0.2\nset_tcp(t)\nmovel({P})",
        f"def use(t):\nset_tcp(t)\nend\nuse(p[0,0,0.1,0,0,0])\nuse(p[0,0,0.2,0,0,0])\nmovel({P})",
        f"def go(w):\nmovel(w)\nend\nset_tcp(p[0,0,0.1,0,0,0])\ngo({P})\nset_tcp(p[0,0,0.2,0,0,0])\ngo({Q})",
        f"t={P}\nset_tcp(t)\nmovel(t)",
    ):
        assert "refuse" in verdicts(reading(tmp_path, code)).values(), code


def test_calls_inside_expressions_are_seen(tmp_path: Path) -> None:
    """A function that sets another TCP is called, wherever in a statement the call stands."""
    helper = "def other(x):\nset_tcp(p[0,0,0.2,0,0,0])\nreturn x\nend\nset_tcp(p[0,0,0.1,0,0,0])\n"
    for call in (
        f"movel(pose_trans({Q}, other({P})))",
        f"movej(get_inverse_kin({P}, qnear=other(1)))",
        f"movel(pose_trans({Q}, p[other(1),0,0,0,0,0]))",
        f"x=pose_trans({Q}, other({P}))",
        "set_payload(other(1))",
    ):
        program = reading(tmp_path, f"{helper}{call}\nmovel({P})")
        last = program.targets[len(program.targets) - 1]
        assert last.tool == "set_tcp(p[0,0,0.2,0,0,0])", (call, last)


@pytest.mark.exhaustive
def test_calls_of_calls_end(tmp_path: Path) -> None:
    deep = "".join(f"def f{k}(w):\n" + f"f{k + 1}(w)\n" * 8 + "end\n" for k in range(9))
    program = reading(tmp_path, f"def f9(w):\nmovel(w)\nend\n{deep}f0({P})")
    assert program.counts()["correct"] == 0
    again = reading(tmp_path, f"def go(w):\ngo(w)\nmovel(w)\nend\ngo({P})")
    assert len(again.targets) > 0


def test_circles_through_features_are_corrected_whole(tmp_path: Path) -> None:
    program = reading(tmp_path, f"f={F}\nmovec(pose_via=pose_trans(f,{P}), pose_to={Q}, a=1)")
    assert verdicts(program) == {"movec:3 via": "correct", "movec:3 end": "correct"}
    assert len(program.circles) == 1
    half = reading(tmp_path, f"f={F}\nmovec(pose_trans(f,{P}), where(), a=1)")
    assert set(verdicts(half).values()) == {"skip"}


def test_the_other_ending(tmp_path: Path) -> None:
    assert reading(tmp_path, f"movel({P})", ending=".urscript").language == "urscript"


@pytest.mark.parametrize(
    ("code", "shift", "axes"),
    [
        ("movel(pose_trans(w, p[0,0,-0.1,0,0,0]))", (0, 0, -100), "tool"),
        ("movel(pose_add(w, p[0.01,0,0.05,0,0,0]))", (10, 0, 50), "frame"),
        ("up=p[0,0,0.05,0,0,0]\nmovel(pose_add(w, up))", (0, 0, 50), "frame"),
        ("above=pose_add(w, p[0,0,0.05,0,0,0])\nmovej(above)\nmovel(above)", (0, 0, 50), "frame"),
        ("movel(pose_add(pose_add(w, p[0,0,0.05,0,0,0]), p[0,0.02,0,0,0,0]))", (0, 20, 50), "frame"),
        ("above=w\nabove[2]=above[2]+0.05\nmovel(above)", (0, 0, 50), "frame"),
        ("above=w\nabove[2] = w[2] - 0.05\nabove[0]=above[0]+0.01\nmovel(above)", (10, 0, -50), "frame"),
        ("def near(u):\nmovel(pose_trans(u, p[0,0,-0.1,0,0,0]))\nmovel(u)\nend\nnear(w)", (0, 0, -100), "tool"),
    ],
)  # fmt: skip
def test_what_is_derived_from_a_point_shares_its_correction(
    tmp_path: Path, make_map: Any, code: str, shift: tuple[float, ...], axes: str
) -> None:
    path = tmp_path / "a.script"
    path.write_text(f"def prog():\nw={P}\nmovel(w)\n{code}\nend\n")
    left = read_program(path, MEASURED)
    assert verdicts(left)["w"] == "refuse"
    assert all("--derived" in target.reason for target in left.targets if target.name == "w")
    program = read_program(path, MEASURED, ReadOptions(derived=True))
    point = next(target for target in program.targets if target.name == "w")
    assert (point.verdict, {one.axes for one in point.derived}) == ("correct", {axes}), point
    np.testing.assert_allclose(point.derived[0].shifts, [shift], atol=1e-9)
    followers = [target for target in program.targets if target.follows]
    assert followers
    assert len(followers) + 1 == len(program.targets)
    corrected = correct_program(program, make_map([0.5, 0.25, -0.125]))
    assert corrected.coverage.corrected == corrected.coverage.targets == len(program.targets)
    assert corrected.files[path] == path.read_bytes().replace(
        b"p[0.3,-0.1,.25,0,3.14159,0]", b"p[0.3005,-0.09975,.249875,0,3.14159,0]", 1
    )


@pytest.mark.parametrize(
    "code",
    [
        "movel(pose_trans(w, p[0,0,-0.1,0,0,0.2]))",
        "movel(pose_add(w, offset))",
        "above=w\nabove[2]=above[2]+h\nmovel(above)",
        "above=w\nmovel(above)\nabove[2]=above[2]+0.05\nmovel(above)",
        "above=w\nabove[2]=0.5\nmovel(above)",
        "above=w\nabove[3]=above[3]+0.1\nmovel(above)",
        "above=w\nabove[2]=above[2]+0.05\nabove[2]=w[2]+0.05\nmovel(above)",
        "above=w\nabove[2]=above[2]+0.05\nx=above[2]\nmovel(above)",
        "movel(pose_add(w, p[0,0,0.1,0,0,0]))\ny=pose_dist(w, w)",
        "movel(pose_trans(pose_add(w, p[0,0,0.1,0,0,0]), p[0,0,0.1,0,0,0]))",
    ],
)
def test_what_is_no_constant_shift_stays_refused(tmp_path: Path, code: str) -> None:
    path = tmp_path / "a.script"
    path.write_text(f"def prog():\nw={P}\nmovel(w)\n{code}\nend\n")
    found = {target.name: target for target in read_program(path, MEASURED, ReadOptions(derived=True)).targets}
    assert found["w"].verdict == "refuse", list(found.values())


@pytest.mark.parametrize(
    "code",
    [
        f"{{0}}q=get_inverse_kin({P})\n{{1}}movej(q)",
        f"w={P}\n{{0}}q=get_inverse_kin(w)\nr=q\n{{1}}movej(r)",
        f"def go(q):\n{{1}}movej(q)\nend\nw={P}\n{{0}}go(get_inverse_kin(w))",
        f"w={P}\n{{0}}if x:\nset_tcp(p[0,0,0.3,0,0,0])\nend\nq=get_inverse_kin(w)\n{{1}}set_tcp(p[0,0,0.2,0,0,0])\nmovej(q)",
    ],
)
def test_joints_are_those_of_the_tcp_in_force_where_they_are_computed(tmp_path: Path, code: str) -> None:
    one, other = "set_tcp(p[0,0,0.1,0,0,0])\n", "set_tcp(p[0,0,0.2,0,0,0])\n"
    target = reading(tmp_path, code.format(one, other)).targets[0]
    assert target.verdict == "refuse"
    assert "the TCP depends on the way through the program" in target.reason
    if "0.3" not in code:
        assert reading(tmp_path, code.format(one, "")).targets[0].verdict == "correct"


@pytest.mark.parametrize("depth", ["1", "n"])
def test_the_positions_of_a_function_that_calls_itself_are_not_all_known(tmp_path: Path, depth: str) -> None:
    again = "go(pose_add(t, p[0,0,0.1,0,0,0]), n - 1)"
    path = tmp_path / "a.script"
    path.write_text(f"def go(t, n):\nif n > 0:\n{again}\nend\nmovel(t)\nend\nw={P}\nmovel(w)\ngo(w, {depth})\n")
    program = read_program(path, MEASURED, ReadOptions(derived=True))
    assert verdicts(program)["w"] == "refuse", list(program.targets)


def test_options_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.script"
    path.write_text(f"def a():\nw={P}\nmovel(w)\nx=w[2]\nend\n")
    assert read_program(path, MEASURED, ReadOptions(ambiguous="skip")).targets[0].verdict == "skip"


@pytest.mark.parametrize(
    "call", ["get_inverse_kin()", "pose_trans()", "pose_add( )", "pose_inv()", "get_inverse_kin", "f()"]
)
def test_calls_without_arguments_are_known_at_run_time_only(tmp_path: Path, call: str) -> None:
    path = tmp_path / "a.script"
    path.write_text(f"def a():\n  x={call}\n  movel({call})\n  movej(x)\n  movel()\n  movec()\n  set_tcp()\nend\n")
    assert read_program(path, MEASURED).counts()["correct"] == 0
