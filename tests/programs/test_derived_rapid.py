"""Points from which RAPID programs derive others by constant shifts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import RefusedError
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program
from truepose.programs.core.alternatives import alternatives

RT = "[[600,0,800],[0.5,0.5,-0.5,0.5],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
RT2 = RT.replace("600", "700")
FRAMES = FrameTable(tools={"tGrip": np.eye(4)}, bases={"wFix": np.eye(4)})
DATA = f"CONST robtarget p1:={RT};\nCONST robtarget p2:={RT2};\nVAR robtarget pApp;\nVAR robtarget pSet:={RT2};\n"
END = ",v1,z1,tGrip\\WObj:=wFix;\n"
HERE = f"MoveL p1{END}"


def read(path: Path, code: str, data: str = DATA, **options: Any) -> Program:
    path = path / "a.mod"
    path.write_text(f"MODULE m\n{data}PROC main()\n{code}ENDPROC\nENDMODULE\n")
    return read_program(path, FRAMES, ReadOptions(**{"whole_task": True, **options}))


def p1(program: Program) -> Any:
    return next(target for target in program.targets if target.name == "p1")


DERIVED = {
    "Offs": (f"MoveL Offs(p1,0,0,50){END}", {"frame": [(0, 0, 50)]}),
    "RelTool": (f"MoveL RelTool(p1,0,0,-50){END}", {"tool": [(0, 0, -50)]}),
    "nested": (f"MoveL RelTool(Offs(p1,0,30,-40),0,0,5){END}", {"both": [(0, 30, -40, 0, 0, 5)]}),
    "sums": (f"MoveL Offs(p1,2*25,-(10+5),50-1){END}", {"frame": [(50, -15, 49)]}),
    "a constant": (f"MoveL Offs(p1,0,0,nUp){END}", {"frame": [(0, 0, 120)]}),
    "an array of constants": (
        f"FOR i FROM 1 TO 2 DO\nMoveL Offs(p1,aX{{i}},0,0){END}ENDFOR\n",
        {"frame": [(10, 0, 0), (20, 0, 0)]},
    ),
    "a table of offsets": (
        f"FOR i FROM 1 TO 2 DO\nMoveL Offs(p1,aXY{{i,1}},aXY{{i,2}},0){END}ENDFOR\n",
        {"frame": [(0, 5, 0), (100, 6, 0)]},
    ),
    "a pallet": (
        f"FOR i FROM 0 TO nRows-1 DO\nFOR j FROM 1 TO 0 DO\nMoveL Offs(p1,i*100,j*80,0){END}ENDFOR\nENDFOR\n",
        {"frame": [(0, 0, 0), (0, 80, 0), (100, 0, 0), (100, 80, 0)]},
    ),
    "a variable": (f"pApp:=Offs(p1,0,0,50);\nMoveJ pApp{END}", {"frame": [(0, 0, 50)]}),
    "a component": (f"pApp:=p1;\npApp.trans.z:=pApp.trans.z+50;\nMoveL pApp{END}", {"frame": [(0, 0, 50)]}),
    "a variable with numbers": (f"pSet:=Offs(p1,0,5,0);\nMoveL pSet{END}", {"frame": [(0, 5, 0)]}),
    "of a variable": (f"pApp:=p1;\nMoveL Offs(pApp,0,0,20){END}", {"frame": [(0, 0, 20)]}),
    "either way": (
        f"IF di1=1 THEN\npApp:=Offs(p1,0,0,5);\nELSE\npApp:=Offs(p1,0,0,9);\nENDIF\nMoveL pApp{END}",
        {"frame": [(0, 0, 5), (0, 0, 9)]},
    ),
    "a number": (f"n:=3;\nn:=n*2;\nMoveL Offs(p1,0,0,n){END}", {"frame": [(0, 0, 6)]}),
}
NUMBERS = "CONST num nUp:=120;\nCONST num nRows:=2;\nCONST num aX{2}:=[10,20];\nVAR num n;\n"
NUMBERS += "CONST num aXY{2,3}:=[[0,5,0],[100,6,0]];\n"


@pytest.mark.promise("Points from which RAPID derives others by constant shifts are corrected with --derived.")
@pytest.mark.parametrize("option", ["derived", "offsets"])
@pytest.mark.parametrize("name", DERIVED)
def test_constant_shifts(name: str, option: str, tmp_path: Path) -> None:
    code, shifts = DERIVED[name]
    program = read(tmp_path, code + HERE, DATA + NUMBERS, **{option: True})
    target = p1(program)
    assert (target.verdict, target.reason) == ("correct", "")
    found: dict[str, list[Any]] = {}
    for one in target.derived:
        found.setdefault(one.axes, []).extend(one.shifts)
    assert {axes: sorted(some) for axes, some in found.items()} == {
        axes: sorted(tuple(map(float, shift)) for shift in some) for axes, some in shifts.items()
    }
    assert [t.follows for t in program.targets if t.follows] == [("p1",)]
    assert not [t for t in program.targets if t.verdict == "refuse"]


@pytest.mark.promise("Without --derived such a point is left, and the reason names the option.")
@pytest.mark.parametrize("name", DERIVED)
def test_the_option_is_named(name: str, tmp_path: Path) -> None:
    target = p1(read(tmp_path, DERIVED[name][0] + HERE, DATA + NUMBERS))
    direct = ":=p1" not in DERIVED[name][0] and "=Offs" not in DERIVED[name][0]
    assert target.verdict == ("skip" if direct else "refuse")
    assert "--derived" in target.reason
    assert ("moved to with an offset (largest " if direct else "both moved to") in target.reason


@pytest.mark.parametrize("derived", [False, True])
@pytest.mark.parametrize("goal", ["Offs(pSet,0,0,0)", "RelTool(pSet,0,0,-0.0)", "Offs(Offs(pSet,0,0,5),0,0,-5)"])
@pytest.mark.parametrize("kind", ["CONST", "VAR", "TASK PERS"])
def test_a_motion_with_a_shift_of_zero_goes_to_the_point_itself(
    kind: str, goal: str, derived: bool, tmp_path: Path, make_map: Any
) -> None:
    data = f"{kind} robtarget pSet:={RT};\n"
    corrected = correct_program(read(tmp_path, f"MoveL {goal}{END}", data, derived=derived), make_map([1, 0, 0]))
    assert [outcome.verdict for outcome in corrected.targets] == ["correct", "skip"]
    assert corrected.targets[1].reason == "derived from pSet: gets the correction of that point"
    assert corrected.coverage == (2, 2)


SPOILED = {
    "a measured offset": f"MoveL Offs(p1,0,0,nMeasured){END}",
    "a stored number": f"MoveL Offs(p1,0,0,nStored){END}",
    "a number that changes": f"Incr n;\nMoveL Offs(p1,0,0,n){END}",
    "a number of a routine": f"n:=5;\nmeasure n;\nMoveL Offs(p1,0,0,n){END}",
    "a turn": f"MoveL RelTool(p1,0,0,5\\Rz:=25){END}",
    "a variable that is set by its name": f'pApp:=Offs(p1,0,0,50);\nSetDataVal "pApp",p2;\nMoveL pApp{END}',
    "a height that is set": f"pApp:=p1;\npApp.trans.z:=500;\nMoveL pApp{END}",
    "an orientation that is set": f"pApp:=p1;\npApp.rot:=orient;\nMoveL pApp{END}",
    "a condition": "IF p1.trans.z>500 Stop;\n",
    "a condition on the copy": f"pApp:=p1;\nIF pApp.trans.z>500 Stop;\nMoveL pApp{END}",
    "a procedure": f"pApp:=p1;\nput pApp;\nMoveL pApp{END}",
    "a circle of a variable": f"pSet:=p1;\nMoveC pSet,p2{END}",
    "an endless loop": f"pApp:=p1;\nWHILE TRUE DO\npApp:=Offs(pApp,0,0,1);\nMoveL pApp{END}ENDWHILE\n",
    "a loop over an input": f"FOR i FROM 1 TO nMeasured DO\nMoveL Offs(p1,0,0,i){END}ENDFOR\n",
    "a set by a name": f"pApp:=p1;\nSetDataVal name,pNew;\nMoveL pApp{END}",
    "a module that is loaded": f'pApp:=p1;\nLoad "HOME:/other.mod";\nMoveL pApp{END}',
}


@pytest.mark.promise("A RAPID point whose digits reach anything but a constant shift stays as it is with --derived.")
@pytest.mark.parametrize("name", SPOILED)
def test_what_the_data_decide(name: str, tmp_path: Path) -> None:
    data = f"{DATA}{NUMBERS}VAR num nMeasured;\nPERS num nStored:=5;\n"
    more = "ENDPROC\nPROC measure(INOUT num x)\nx:=9;\nENDPROC\nPROC put(INOUT robtarget p)\np.trans.z:=0;\n"
    target = p1(read(tmp_path, HERE + SPOILED[name] + more, data, derived=True))
    assert target.verdict in ("skip", "refuse")
    assert not target.reason.startswith("derived from")


def test_a_displacement_at_the_derived_motion(tmp_path: Path) -> None:
    code = f"{HERE}PDispOn p2,tGrip;\nMoveL Offs(p1,0,0,5){END}PDispOff;\n"
    target = p1(read(tmp_path, code, derived=True))
    assert (target.verdict, "displacement" in target.reason) == ("refuse", True)


def test_another_workobject_at_the_derived_motion(tmp_path: Path) -> None:
    target = p1(read(tmp_path, f"{HERE}MoveL Offs(p1,0,0,5),v1,z1,tGrip;\n", derived=True))
    assert target.verdict == "refuse"
    assert "wFix" in target.reason
    assert "wobj0" in target.reason


@pytest.mark.promise("A circle through a derived position is corrected with its point, or not at all.")
def test_a_circle(tmp_path: Path, make_map: Any) -> None:
    code = f"MoveL p1{END}MoveC Offs(p1,0,20,0),p2{END}"
    program = read(tmp_path, code, derived=True)
    assert [t.verdict for t in program.targets if t.name in ("p1", "p2")] == ["correct", "correct"]
    assert correct_program(program, make_map([0.5, 0.0, 0.0])).coverage.corrected == 3
    left = correct_program(program, make_map([0.5, 0.0, 0.0], guarded={1: "no"}), on_guard="skip")
    assert left.coverage.corrected == 0


@pytest.mark.promise("A derived position lies in its path with the correction of its point.")
def test_a_path_through_a_derived_position(tmp_path: Path, make_map: Any) -> None:
    code = f"MoveL p1{END}MoveL Offs(p1,50,0,0){END}MoveL p2{END}"
    program = read(tmp_path, code, derived=True)
    corrected = correct_program(program, make_map([0.5, 0.0, 0.0]))
    assert np.nanmax(corrected.continuity.bend) < 1e-9
    steps = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 9.0, 0.0]])

    class Kinked(make_map):
        def correct(self, poses: np.ndarray, **more: Any) -> Any:
            answer = super().correct(poses, **more)
            answer.p_command = answer.p_target + steps[(poses[:, 0, 3] > 680).astype(int) * 2]
            answer.std[:] = 0.01
            return answer

    with pytest.raises(RefusedError, match=r"bend the path"):
        correct_program(program, Kinked())


def test_the_places_at_which_the_map_is_asked(tmp_path: Path) -> None:
    program = read(tmp_path, f"{HERE}{DERIVED['nested'][0]}", derived=True)
    ((_, columns),) = program.correctable_columns()
    (others,) = alternatives(columns, np.arange(len(columns)))
    (target,) = [t for t in program.targets if t.name == "p1"]
    rotation = target.rotation.as_matrix()
    expected = np.array([600.0, 30.0, 760.0]) + rotation @ [0.0, 0.0, 5.0]
    assert np.allclose(others.poses[0, :3, 3], expected)
    assert np.allclose(others.lever[0], rotation @ [0.0, 0.0, 5.0])
    turn = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.01]])
    given = others.corrections(turn)
    assert np.allclose(given[0, :3], np.cross([0.0, 0.0, 0.01], others.lever[0]), atol=1e-3)


@pytest.mark.promise("A correction that derived positions share is not smoothed along a path.")
def test_a_point_of_a_smoothed_path(tmp_path: Path, make_map: Any) -> None:
    data = "".join(f"CONST robtarget q{i}:={RT.replace('600', str(500 + 40 * i))};\n" for i in range(7))
    path = "".join(f"MoveL q{i}{END}" for i in range(7))

    class Rough(make_map):
        def correct(self, poses: np.ndarray, **more: Any) -> Any:
            answer = super().correct(poses, **more)
            answer.p_command = answer.p_target + np.where(np.isclose(poses[:, :1, 3], 620.0), [0.0, 0.5, 0.0], 0.2)
            answer.std[:] = 0.05
            return answer

    def moved(code: str) -> dict[str, Any]:
        corrected = correct_program(read(tmp_path, path + code, data, derived=True), Rough())
        return {
            outcome.name: (outcome.correction, corrected.targets.notes.get(k, ""))
            for k, outcome in enumerate(corrected.targets)
        }

    free = moved("")
    assert "smoothed along its path" in free["q3"][1]
    shared = moved(f"MoveJ Offs(q3,0,0,10){END}")
    assert "smoothed" not in shared["q3"][1]
    assert np.allclose(shared["q3"][0], [0.0, 0.5, 0.0], atol=1e-3)
    assert "smoothed" in shared["q2"][1]


@pytest.mark.parametrize("opener", ["WHILE up(1) DO", "WHILE n<3 AND up(2) DO"])
def test_the_condition_of_while_is_evaluated_again_behind_each_turn(opener: str, tmp_path: Path) -> None:
    target = f"[[600,0,500],[1,0,0,0],[0,0,0,0],[{','.join(['9E9'] * 6)}]]"
    path = tmp_path / "m.mod"
    body = f"pa:=p1;\n{opener}\nMoveL pa,v100,fine,tool0;\nENDWHILE\nMoveL p1,v100,fine,tool0;\n"
    up = "FUNC bool up(num k)\npa.trans.z:=pa.trans.z+50;\nRETURN TRUE;\nENDFUNC\n"
    data = f"CONST robtarget p1:={target};\nLOCAL VAR robtarget pa;\nVAR num n;\n"
    for code, verdict in ((body, "refuse"), (body.replace("WHILE", "IF").replace(" DO", " THEN"), "correct")):
        path.write_text(f"MODULE m\n{data}PROC main()\n{code}ENDPROC\nLOCAL {up}ENDMODULE\n")
        program = read_program(path, None, ReadOptions(derived=True, whole_task=True))
        assert p1(program).verdict == verdict
