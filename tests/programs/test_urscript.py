"""Every row of the catalogue of hazards that concerns URScript, by name, with its verdict."""

# ruff: noqa: E501
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program

P = "p[0.3,-0.1,.25,0,3.14159,0]"
Read = Callable[..., Program]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    def reading(code: str, frames: FrameTable | None = None, **options: Any) -> Program:
        path = tmp_path / "a.script"
        path.write_text(code if "def " in code else f"def prog():\n{code}\nend\n")
        return read_program(path, frames or FrameTable(tool="map"), ReadOptions(**options))

    return reading


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def of_all(program: Program) -> dict[str, str]:
    """Verdicts by name, and by line where a name is given twice."""
    names = [target.name for target in program.targets]
    return {f"{t.name} (line {t.line})" if names.count(t.name) > 1 else t.name: t.verdict for t in program.targets}


@pytest.mark.parametrize("call", ["movel({}, a=1.2, v=0.25)", "movej({})", "movep({}, r=0.05)", "movel( {} )"])
def test_a_pose_is_a_target_by_its_use(read: Read, call: str) -> None:
    program = read(call.format(P))
    target = program.targets[0]
    assert (target.verdict, target.frame, target.tool, target.motions) == (
        "correct",
        "base",
        "as measured",
        (call[:5],),
    )
    np.testing.assert_allclose(target.p, [300, -100, 250])


def test_circle_both_or_neither(read: Read) -> None:
    assert verdicts(read(f"movec({P},{P}, a=1)")) == {"movec:2 via": "correct", "movec:2 end": "correct"}
    assert verdicts(read(f"movec(pose_trans(f,{P}),{P}, a=1)")) == {"movec:2 via": "skip", "movec:2 end": "skip"}


def test_tcp_features_and_wrenches_are_no_targets(read: Read) -> None:
    code = f"set_tcp({P})\nfeature={P}\nwrench={P}\nforce_mode(wrench,[0,0,1,0,0,0],{P},2)\nset_payload(1,[0,0,0.1])\nx=get_inverse_kin({P})"
    assert len(read(code).targets) == 0


def test_expressions_are_skipped(read: Read) -> None:
    for target in (
        f"pose_trans(f,{P})",
        f"pose_add({P},d)",
        "p[x,0,0,0,0,0]",
        "p[0.1+0.2,0,0,0,0,0]",
        "get_actual_tcp_pose()",
        "q",
    ):
        assert list(verdicts(read(f"movel({target}, a=1)")).values()) == ["skip"], target


def test_named_pose_assigned_once_and_only_moved_to(read: Read) -> None:
    assert verdicts(
        read(f"global w1={P}\nmovel(w1)\nmovej(w1,a=1)\nmovej(get_inverse_kin(w1,qnear=[0,0,0,0,0,0]))")
    ) == {"w1": "correct"}
    assert verdicts(read(f"w1={P}\nw1={P}\nmovel(w1)")) == {"w1": "skip"}
    assert verdicts(read(f"w1={P}\nw1[2]=w1[2]+0.1\nmovel(w1)"))["w1"] == "refuse"
    assert verdicts(read(f"w1={P}\nw1[2]=0.1\nmovel(w1)"))["w1"] == "skip"
    read_too = f"w1={P}\nmovel(w1)\nmovel(pose_trans(w1,p[0,0,0.1,0,0,0]))"
    assert verdicts(read(read_too))["w1"] == "refuse"
    assert verdicts(read(read_too, ambiguous="skip"))["w1"] == "skip"


def test_joints_and_run_time_motions(read: Read) -> None:
    program = read(
        f"movej([0,-1.5,1.5,0,0,0], a=1)\nservoj([0,0,0,0,0,0])\nspeedl([0,0,0,0,0,0],0.5)\nservoj(get_inverse_kin({P}))\nmovel({{{{pose}}}})\nservoc({P})"
    )
    assert set(verdicts(program).values()) == {"skip"}
    assert len(program.targets) == 6


def test_the_tool_is_followed(read: Read) -> None:
    tcp = "set_tcp(p[0,0,{},0,0,0])\n"
    program = read(f"{tcp.format(0.1)}movel({P})\n{tcp.format(0.2)}movel({P})")
    np.testing.assert_allclose(program.tools()[:, 2, 3], [100, 200])
    either = read(f"{tcp.format(0.1)}if x:\n{tcp.format(0.2)}end\nmovel({P})")
    assert (either.targets[0].verdict, "depends on the way" in either.targets[0].reason) == ("refuse", True)
    assert read(f"set_tcp(tool)\nmovel({P})").targets[0].verdict == "refuse"
    loop = read(f"{tcp.format(0.1)}while True:\nmovel({P})\n{tcp.format(0.2)}end")
    assert loop.targets[0].verdict == "refuse"
    nested = read(
        f"def main():\n{tcp.format(0.1)}def sub():\n{tcp.format(0.2)}end\nmovel({P})\nsub()\nmovel({P})\nend\n"
    )
    np.testing.assert_allclose(nested.tools()[:, 2, 3], [100, 200])
    assert read(f"movel({P})", FrameTable(tools={1: np.eye(4)}, tool=1)).targets[0].tool == "1"


def test_rotation_vector_keeps_its_branch_and_metres_their_digits(tmp_path: Path, make_map: Any) -> None:
    text = b"def a():\n  movel(p[0.3, -.1000, 1e-1, 2.2214, -2.2214, 0.0])\nend"
    path = tmp_path / "a.script"
    path.write_bytes(text)
    corrected = correct_program(path, make_map([0.5, 0.25, -0.125]), frames=FrameTable(tool="map"))
    assert corrected.files[path] == text.replace(b"0.3, -.1000, 1e-1", b"0.3005, -.09975, 0.099875")


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("movel(p[1.2.3,0,0,0,0,0])", r"a\.script:2: movel:2: X '1\.2\.3' is not a number"),
        ("movel(p[--5,0,0,0,0,0])", r"'--5' is not a number"),
        (f"movel(p[{'9' * 400},0,0,0,0,0])", "has 400 characters"),
        ("movel(p[0,0,0,0,0])", "a pose has 6 numbers, this has 5"),
        ("movel(p[0,0,0,0,180,0])", "looks like degrees"),
        ("movel(p[0,0,0,0,0,0]", "a bracket is not closed"),
        ("movel(p[0,0,0,0,0,0]))", r"a\.script:2: \) closes nothing"),
        ('textmsg("x)', "is not closed; close it"),
        ("if x:", "has no end: the file is truncated"),
        ("end", "end closes nothing"),
        ("elif x:", "ELSE without IF"),
    ],
)
def test_broken_scripts(read: Read, code: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        read(code)


Q = "p[0.4,-0.1,.25,0,3.14159,0]"


@pytest.mark.promise("URScript: a parameter or local variable is never read as the global of its name")
def test_parameters_and_local_variables_hide_globals(read: Read, record_property: Any) -> None:
    cases = {
        "parameter": (f"global w={P}\ndef f(w):\nmovel(w)\nend\nf({Q})\nmovel(w)", {"w": "correct", "f:6 argument 1": "correct"}),
        "only the parameter": (f"global w={P}\ndef f(w):\nmovel(w)\nend\nf({Q})", {"f:6 argument 1": "correct"}),
        "default value": (f"global w={P}\ndef f(a, w = 1):\nmovel(w)\nend\nmovel(w)", {"w": "correct", "movel:4": "skip"}),
        "arithmetic on a parameter": (f"global w={P}\ndef f(w):\nmovel(pose_add(w,{Q}))\nend\nmovel(w)", {"w": "correct", "movel:4": "skip"}),
        "assigned parameter": (f"global w={P}\ndef f(w):\nw=get_actual_tcp_pose()\nmovel(w)\nend\nmovel(w)", {"w": "correct", "movel:5": "skip"}),
        # the manual says that g sees the global
        "parameter of an outer function": (f"global w={P}\ndef f(w):\ndef g():\nmovel(w)\nend\ng()\nend\nmovel(w)", {"w": "refuse", "movel:5": "skip"}),
        "local": (
            f"global w={P}\ndef f():\nlocal w={Q}\nmovel(w)\nend\nmovel(w)",
            {"w (line 2)": "skip", "w (line 4)": "correct"},
        ),
        "two locals": (
            f"def f():\nlocal w={P}\nmovel(w)\nend\ndef g():\nlocal w={Q}\nmovel(w)\nend",
            {"w (line 3)": "correct", "w (line 7)": "correct"},
        ),
        "local from the run time": (f"def f():\nlocal w=get_actual_tcp_pose()\nmovel(w)\nend\nmovel({P})", {"movel:4": "skip", "movel:6": "correct"}),
        "thread": (f"global w={P}\nthread t(w):\nmovel(w)\nend\nmovel(w)", {"w": "correct", "movel:4": "skip"}),
        "assigned above": (f"w=get_actual_tcp_pose()\nmovel(w)\nw={P}\nmovel(w)", {"w": "skip"}),
    }  # fmt: skip
    record_property("cases", len(cases))
    for name, (code, wanted) in cases.items():
        program = read(f"def prog():\n{code}\nend\n")
        assert of_all(program) == wanted, (name, [(t.name, t.line, t.reason) for t in program.targets])


@pytest.mark.promise("URScript: targets in reach of a run-time shift are refused by its name")
def test_run_time_shifts(read: Read, record_property: Any) -> None:
    regions = {
        "track_conveyor_linear(p[0,1,0,0,0,0], 100)": "stop_conveyor_tracking()",
        "track_conveyor_circular(p[0,1,0,0,0,0], 100, True)": "stop_conveyor_tracking(a=15)",
        "path_offset_enable()": "path_offset_disable()",
        "path_offset_set([0,0,0.01,0,0,0], 3)": "path_offset_disable(a=20)",
        "force_mode(tool_pose(), [0,0,1,0,0,0], [0,0,5,0,0,0], 2, [1,1,1,1,1,1])": "end_force_mode()",
        "freedrive_mode()": "end_freedrive_mode()",
        "screw_driving(5, 1)": "end_screw_driving()",
    }
    record_property("cases", len(regions) + 4)
    for begin, end in regions.items():
        program = read(f"movel({P})\n{begin}\nmovel({P})\nw={Q}\nmovel(w)\n{end}\nmovel({P})")
        assert verdicts(program) == {"movel:2": "correct", "movel:4": "refuse", "w": "refuse", "movel:8": "correct"}, (
            begin
        )
        assert program.targets[1].reason.startswith(begin.partition("(")[0] + " (line 3) may shift it")
    both = read(
        f"path_offset_enable()\nforce_mode(a,b)\npath_offset_disable()\nmovel({P})\nend_force_mode()\nmovel({P})"
    )
    assert verdicts(both) == {"movel:5": "refuse", "movel:7": "correct"}
    called = read(f"def prog():\nstart()\nmovel({P})\nend\ndef start():\nforce_mode(a,b)\nend\n")
    assert verdicts(called) == {"movel:3": "refuse"}
    threaded = read(
        f"def prog():\nthread t():\npath_offset_set(x,1)\npath_offset_disable()\nend\nrun t()\nmovel({P})\nend\n"
    )
    assert verdicts(threaded) == {"movel:7": "refuse"}
    maybe = read(f"if x:\nforce_mode(a,b)\nend\nmovel({P})")
    assert verdicts(maybe) == {"movel:5": "refuse"}


@pytest.mark.promise("URScript: poses handed to functions of the program are listed")
def test_poses_handed_to_own_functions_are_listed(read: Read) -> None:
    code = f"def my_move(t):\nmovel(t)\nend\ndef prog():\nmy_move({P})\nw={Q}\nmy_move(w)\npick(3, {P}, pose_add({Q}, w))\nmovel({P})\nend\n"
    program = read(code)
    assert verdicts(program) == {
        "my_move:5 argument 1": "correct", "w": "refuse", "pick:8 argument 2": "skip", "pick:8 argument 3": "skip",
        "movel:9": "correct",
    }  # fmt: skip
    assert program.targets[2].reason == "handed to pick(): where that moves is known at run time only"
    assert verdicts(read(f"w={P}\nmovel(w)\npick(w)")) == {"w": "refuse"}
    assert verdicts(read(f"move_there({P})")) == {"move_there:2": "refuse"}
    assert len(read(f'textmsg("a", {P})\nx=pose_dist({P},{Q})\nset_tcp({P})').targets) == 0


@pytest.mark.promise("URScript: motions of a thread have the TCP of the program that it runs beside")
def test_threads_have_the_tcp_of_what_they_run_beside(read: Read, record_property: Any) -> None:
    first, second = "set_tcp(p[0,0,0.1,0,0,0])", "set_tcp(p[0,0,0.2,0,0,0])"
    body = f"def prog():\nthread t():\n{{}}\nend\n{{}}\nmovel({P})\nend\n"
    cases = {
        (f"movel({P})", f"{first}\nrun t()"): ["correct", "correct"],
        (f"movel({P})", f"run t()\n{first}"): ["refuse", "correct"],
        (f"movel({P})", f"{first}\nrun t()\n{second}"): ["refuse", "correct"],
        (f"{second}\n{first}", f"{first}\nrun t()"): ["refuse"],
        (f"{first}", f"{first}\nrun t()"): ["correct"],
    }
    record_property("cases", len(cases))
    for (thread, main), expected in cases.items():
        program = read(body.format(thread, main))
        assert [t.verdict for t in program.targets] == expected, (thread, main)
        assert program.targets[0].verdict == "refuse" or {target.tool for target in program.targets} == {first}
