"""RAPID data are global to the task: points are judged over all modules, and alone only what no other can see."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, Target, correct_program, read_program, read_programs

RT = "[[600,0,800],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])
FRAMES = FrameTable(tools={"tGrip": np.eye(4)}, bases={"wFix": TURNED, "wOther": np.eye(4)})
WHOLE = ReadOptions(whole_task=True)
POINT = f"CONST robtarget p1:={RT};"
MOVE = f"MoveL {RT},v1,z1,tGrip;"


def module(name: str, data: str = "", code: str = "", *, routine: str = "", more: str = "") -> str:
    return f"MODULE {name}\n{data}\nPROC {routine or f'r{name}'}()\n{code}\nENDPROC\n{more}\nENDMODULE\n"


def lay(folder: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def task(folder: Path, *modules: str, **options: Any) -> Program:
    """Read modules as one task; the first is main's."""
    shutil.rmtree(folder / "task", ignore_errors=True)
    files = {f"{'abcdef'[k]}.mod": text for k, text in enumerate(modules)}
    return read_program(lay(folder / "task", files), FRAMES, ReadOptions(**options))


def only(program: Program, name: str) -> Target:
    (found,) = (target for target in program.targets if target.name == name)
    return found


def judged(program: Program, start: str = "MoveL") -> list[str]:
    return [target.verdict for target in program.targets if target.name.startswith(start)]


@pytest.mark.promise("A robtarget that another module moves to has that module's work object.")
def test_a_point_of_another_module_has_the_frame_of_its_motion(tmp_path: Path, make_map: Any) -> None:
    a = module("A", POINT, "rB;", routine="main")
    b = module("B", "", "MoveL p1,v1,z1,tGrip\\WObj:=wFix;")
    program = task(tmp_path, a, b)
    assert (only(program, "p1").verdict, only(program, "p1").frame) == ("correct", "wFix")
    corrected = correct_program(program, make_map([0.5, 0.0, 0.0]))
    assert b"[[599.5,0," in corrected.files[tmp_path / "task" / "a.mod"]  # wFix is turned by 180 deg


@pytest.mark.promise("A robtarget that two modules move to under different work objects is refused.")
def test_a_point_under_two_frames_names_both_places(tmp_path: Path) -> None:
    a = module("A", POINT, "MoveL p1,v1,z1,tGrip;\nrB;", routine="main")
    target = only(task(tmp_path, a, module("B", "", "MoveL p1,v1,z1,tGrip\\WObj:=wFix;")), "p1")
    assert target.verdict == "refuse"
    assert "moved to under wobj0 (a.mod, line 4) and wFix (b.mod, line 4)" in target.reason


@pytest.mark.promise("Without the whole task only LOCAL robtargets and those written in the motion are corrected.")
def test_a_module_alone(tmp_path: Path, make_map: Any) -> None:
    code = f"MoveL p1,v1,z1,tGrip;\nMoveL q,v1,z1,tGrip;\n{MOVE}\nMoveC p1,q,v1,z1,tGrip;"
    path = lay(tmp_path, {"a.mod": module("A", f"{POINT}LOCAL CONST robtarget q:={RT};", code)}) / "a.mod"
    alone = read_program(path, FRAMES)
    assert {t.name: t.verdict for t in alone.targets} == {"p1": "refuse", "q": "refuse", "MoveL:6": "correct"}
    assert "give the files of the whole task, state that these are all (--whole-task), or declare it LOCAL" in next(
        t.reason for t in alone.targets if t.name == "p1"
    )
    path.write_text(path.read_text().replace("MoveC p1,q,v1,z1,tGrip;", ""))
    assert only(read_program(path, FRAMES), "q").verdict == "correct"
    for whole in (read_program(path, FRAMES, WHOLE), read_program(tmp_path, FRAMES)):
        assert whole.counts() == {"correct": 3, "skip": 0, "refuse": 0}
    corrected = correct_program(path, make_map([0.5, 0, 0]), frames=FRAMES, on_guard="skip")
    assert [t.name for t in corrected.targets if t.verdict == "correct"] == ["q", "MoveL:6"]


@pytest.mark.promise("Modules that are named together are one task.")
def test_modules_named_together_are_one_task(tmp_path: Path, make_map: Any) -> None:
    a = module("A", POINT, "rB;", routine="main")
    folder = lay(tmp_path / "cell", {"a.mod": a, "sub/b.mod": module("B", "", "MoveL p1,v1,z1,tGrip\\WObj:=wFix;")})
    found = read_programs([folder / "a.mod", folder / "sub/b.mod"], FRAMES)
    (program,) = found.programs
    assert (only(program, "p1").frame, found.unreadable) == ("wFix", [])
    written = correct_program(program, make_map([1, 0, 0])).write(tmp_path / "out")
    names = ["a.mod", "sub/b.mod", "a.corrections.json", "a.corrections.csv"]
    assert [p.relative_to(tmp_path / "out").as_posix() for p in written] == names


def test_tasks_of_a_backup_are_several(tmp_path: Path) -> None:
    same = {
        "PROGMOD/a.mod": module("A", POINT, "MoveL p1,v1,z1,tGrip\\WObj:=wFix;", routine="main"),
        "SYSMOD/u.sys": "",
    }
    same["SYSMOD/u.sys"] = module("user", "", "")
    files = {f"RAPID/TASK{k}/{name}": text for k in (1, 2) for name, text in same.items()}
    folder = lay(tmp_path / "backup", files)
    found = read_programs([folder], FRAMES)
    assert [p.path.name for p in found.programs] == ["TASK1", "TASK2"]
    assert [p.counts()["correct"] for p in found.programs] == [1, 1]
    # PERS data of one name are shared by the tasks
    (folder / "RAPID/TASK2/PROGMOD/a.mod").write_text(module("A", "", "wFix.uframe:=x;", routine="main"))
    first, _ = read_programs([folder], FRAMES).programs
    assert "wFix is changed by the program" in only(first, "p1").reason


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (module("A"), r"module A is in .*a\.mod, too; give the files of one task at a time"),
        (module("B", POINT), r"p1 is declared twice, first in a\.mod, line 2; keep one or give the files of one task"),
        (
            module("B", POINT.replace("p1", "p2").replace("[[", "[[1.2.3", 1)),
            r"b\.mod:2: p2: '1\.2\.3.*' is not a number",
        ),
        (module("B", "", "", routine="main"), r"MAIN is defined twice, first in a\.mod, line 3; give the files of one"),
    ],
)
def test_what_is_no_task(tmp_path: Path, other: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        task(tmp_path, module("A", POINT, "", routine="main"), other)


def test_local_names_of_two_modules_are_two(tmp_path: Path) -> None:
    data, local = f"LOCAL {POINT}", "LOCAL PROC go()\nMoveL p1,v1,z1,tGrip"
    a = module("A", data, "rB;\ngo;", routine="main", more=f"{local};\nENDPROC")
    b = module("B", data, "go;", more=f"{local}\\WObj:=wFix;\nENDPROC")
    assert [(t.verdict, t.frame) for t in task(tmp_path, a, b).targets] == [("correct", "wobj0"), ("correct", "wFix")]


@pytest.mark.promise("A displacement that another module, an interrupt program or an error handler sets is followed.")
@pytest.mark.parametrize(
    "on",
    ["PDispSet d;", "PDispOn p1,tGrip;", "EOffsSet e;", "FCAct f,tGrip;"],
)
def test_displacements_across_modules(tmp_path: Path, on: str) -> None:
    a = module("A", "", f"{MOVE}\nrB;\n{MOVE}\nPDispOff;\nEOffsOff;\nFCDeact;\n{MOVE}", routine="main")
    assert judged(task(tmp_path, a, module("B", "", on))) == ["correct", "refuse", "correct"]
    inside = module("A", "", f"{on}\nrB;\nPDispOff;\nEOffsOff;\nFCDeact;", routine="main")
    assert judged(task(tmp_path, inside, module("B", "", MOVE))) == ["refuse"]
    function = "FUNC num f(num x)\nPDispSet d;\nRETURN x;\nENDFUNC"
    assert judged(task(tmp_path, module("A", "", f"n:=2*f(3);\n{MOVE}", routine="main", more=function))) == ["refuse"]


def test_interrupt_programs(tmp_path: Path) -> None:
    a = module("A", "", MOVE, routine="main")
    setting = module("B", more="TRAP t\nPDispSet d;\nENDTRAP")
    assert judged(task(tmp_path, a, setting)) == ["refuse"]
    returning = module("B", more="TRAP t\nIF x THEN\nPDispSet d;\nRETURN;\nENDIF\nERROR\nRETRY;\nENDTRAP")
    assert judged(task(tmp_path, a, returning)) == ["refuse"]
    harmless = module("B", more="TRAP t\nStopMove;\nENDTRAP")
    assert judged(task(tmp_path, a, harmless)) == ["correct"]
    # what moves in an interrupt program moves under whatever it interrupts
    shifting = module("A", "", f"PDispSet d;\nWaitTime 1;\nPDispOff;\n{MOVE}", routine="main")
    moving = module("B", more=f"TRAP t\n{MOVE}\nENDTRAP")
    assert judged(task(tmp_path, shifting, moving)) == ["correct", "refuse"]


def test_error_handlers(tmp_path: Path) -> None:
    body = f"PDispSet d;\n{MOVE}\nPDispOff;\n{MOVE}\nERROR\n{MOVE}\n"
    assert judged(task(tmp_path, module("A", "", body + "RETRY;", routine="main"))) == ["refuse", "correct", "refuse"]
    called = module("A", "", f"rB;\n{MOVE}", routine="main")
    retry, back = (module("B", "", f"PDispSet d;\nPDispOff;\nERROR\n{word};") for word in ("RETRY", "RETURN"))
    assert judged(task(tmp_path, called, retry)) == ["correct"]
    assert judged(task(tmp_path, called, back)) == ["refuse"]
    undo = module("B", "", "PDispSet d;\nPDispOff;\nUNDO\nPDispSet d;")
    assert judged(task(tmp_path, called, undo)) == ["refuse"]
    setting = module("A", "", f"{MOVE}\nERROR\nPDispSet d;\nTRYNEXT;", routine="main")
    assert judged(task(tmp_path, setting)) == ["refuse"]
    # of several handlers, the one that sets a displacement is the one that goes on with it
    harmless = module("A", "", f"rB;\n{MOVE}\nERROR\nRETRY;", routine="main")
    assert judged(task(tmp_path, harmless, module("B", "", "ERROR\nPDispSet d;\nTRYNEXT;"))) == ["refuse"]
    assert judged(task(tmp_path, harmless, module("B", "", "ERROR\nTRYNEXT;"))) == ["correct"]


def test_a_main_program_runs_in_cycles(tmp_path: Path) -> None:
    assert judged(task(tmp_path, module("A", "", f"{MOVE}\nPDispSet d;", routine="main"))) == ["refuse"]
    again = module("A", "", f"{MOVE}\nIF x THEN\nPDispSet d;\nExitCycle;\nENDIF", routine="main")
    assert judged(task(tmp_path, again)) == ["refuse"]


@pytest.mark.promise("A late-bound call counts as a call of every procedure whose name may be meant.")
@pytest.mark.parametrize(
    ("call", "verdict"),
    [
        ('%"rB"%;', "refuse"),
        ('%"r"+n%;', "refuse"),
        ("%n%;", "refuse"),
        ('%"B:rB"%;', "refuse"),
        ('CallByVar "r",n;', "refuse"),
        ("CallByVar n,1;", "refuse"),
        ('%"rC"%;', "correct"),
        ('%"x"+n%;', "correct"),
    ],
)
def test_late_bound_calls(tmp_path: Path, call: str, verdict: str) -> None:
    a, c = module("A", "", f"{call}\n{MOVE}", routine="main"), module("C")
    local = module("B", "", "PDispSet d;").replace("\nPROC", "\nLOCAL PROC")
    for b in (module("B", "", "PDispSet d;"), local) if ":" not in call else (local,):
        assert judged(task(tmp_path, a, b, c)) == [verdict]
    moved = module("B", "", MOVE)
    shifted = module("A", "", f"PDispSet d;\n{call}\nPDispOff;", routine="main")
    assert judged(task(tmp_path, shifted, moved, c)) == [verdict]


@pytest.mark.promise("Alone, a call of a routine that is not in the file may set a displacement.")
@pytest.mark.parametrize("call", ["rElsewhere;", "%n%;", 'CallByVar "r",1;', '%"rElsewhere"%;'])
def test_calls_that_leave_a_module_read_alone(tmp_path: Path, call: str) -> None:
    text = module("A", "", f'{MOVE}\n{call}\n{MOVE}\nWaitTime 1;\nSet do1;\nTPWrite "x";')
    path = lay(tmp_path, {"a.mod": text}) / "a.mod"
    assert judged(read_program(path, FRAMES)) == ["correct", "refuse"]
    for options in (WHOLE, ReadOptions(calls_keep_frames=True)):
        assert judged(read_program(path, FRAMES, options)) == ["correct", "correct"]
    path.write_text(module("A", "", f'{MOVE}\nrB;\n%"rB"%;\n{MOVE}', more="PROC rB()\nENDPROC"))
    assert judged(read_program(path, FRAMES)) == ["correct", "correct"]


@pytest.mark.promise("MoveAbsJ CalcJointT(p) reads the point p.")
@pytest.mark.parametrize(
    "code",
    [
        "MoveAbsJ CalcJointT(p1,tGrip),v1,z1,tGrip;",
        "MoveAbsJ CalcJointT(Offs(p1,0,0,10),tGrip\\WObj:=wobj0),v1,z1,tGrip;",
        "x:=p1.trans.x;",
        'GetDataVal "p1",q;',
        "GetDataVal n,q;",
    ],
)
def test_points_that_another_module_reads(tmp_path: Path, code: str) -> None:
    a = module("A", POINT, "MoveL p1,v1,z1,tGrip;\nrB;", routine="main")
    target = only(task(tmp_path, a, module("B", "", code)), "p1")
    assert target.verdict == "refuse"
    assert "both moved to (a.mod, line 4) and read by " in target.reason
    assert "(b.mod, line 4)" in target.reason
    assert only(task(tmp_path, a, module("B", "", code), ambiguous="skip"), "p1").verdict == "skip"


def test_a_point_that_a_constant_of_another_module_copies(tmp_path: Path) -> None:
    b = module("B", POINT)
    a = module("A", "CONST robtarget q:=p1;", "MoveL p1,v1,z1,tGrip;", routine="main")
    assert "read by arithmetic (a.mod, line 2)" in only(task(tmp_path, a, b), "p1").reason


@pytest.mark.promise("A work object that a procedure may change is refused.")
@pytest.mark.parametrize(
    ("call", "head", "verdict"),
    [
        ("rB wFix;", "INOUT wobjdata w", "refuse"),
        ("rB wFix;", "PERS wobjdata w", "refuse"),
        ("rB 5,wFix\\a;", "num n\\switch a,VAR wobjdata w", "refuse"),
        ("rB\\w:=wFix;", "\\INOUT wobjdata w", "refuse"),
        ("x:=fB(wFix);", "INOUT wobjdata w", "refuse"),
        ('%"rB"% wFix;', "wobjdata w", "refuse"),
        ("rB wFix;", "wobjdata w", "correct"),
        ("rB wOther;", "INOUT wobjdata w", "correct"),
        ('SetDataVal "wFix",x;', "", "refuse"),
        ("SetDataVal n,x;", "", "refuse"),
        ("wFix:=wOther;", "", "refuse"),
    ],
)
def test_work_objects_that_are_handed_on(tmp_path: Path, call: str, head: str, verdict: str) -> None:
    a = module("A", "", f"MoveL {RT},v1,z1,tGrip\\WObj:=wFix;\n{call}", routine="main")
    b = f"MODULE B\nPROC rB({head})\nw.uframe:=x;\nENDPROC\nFUNC num fB({head})\nRETURN 1;\nENDFUNC\nENDMODULE\n"
    program = task(tmp_path, a, b)
    assert judged(program) == [verdict]
    if verdict == "refuse":
        shown = "tGrip" if call == "SetDataVal n,x;" else "wFix"
        assert f"{shown} is changed by the program (a.mod, line 5)" in program.targets[0].reason


def test_names_of_a_routine_hide_work_objects(tmp_path: Path) -> None:
    move = f"MoveL {RT},v1,z1,tGrip\\WObj:=wFix;"
    a = f"MODULE A\nPROC main(wobjdata wFix)\n{move}\nENDPROC\nPROC b()\nVAR wobjdata wFix;\n{move}\nENDPROC\nENDMODULE"
    assert [t.reason for t in task(tmp_path, a).targets] == ["workobject wFix is known at run time only"] * 2


def test_a_work_object_that_is_declared_twice_is_refused(tmp_path: Path) -> None:
    data = 'PERS wobjdata wFix:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];'
    a = module("A", data, f"MoveL {RT},v1,z1,tGrip\\WObj:=wFix;", routine="main")
    assert "wFix is declared twice" in task(tmp_path, a, module("B", data)).targets[0].reason


@pytest.mark.promise("Motions of RAPID that a conveyor, a sensor or forces may shift at run time are refused.")
@pytest.mark.parametrize(
    ("on", "off"),
    [
        ("WaitWObj wCnv;", "DropWObj wCnv;"),
        ("ActUnit CNV1;", "DeactUnit CNV1;"),
        ("CorrCon id;", "CorrDiscon id;"),
        ("SyncToSensor s\\On;", "SyncToSensor s\\Off;"),
        ("EGMActPose id;", "EGMReset id;"),
        ("SoftAct 1,50;", "SoftDeact;"),
        ("CSSAct s;", "CSSDeactMoveL;"),
        ("FCAct f,tGrip;", "FCDeact;"),
    ],
)
def test_run_time_shifts(tmp_path: Path, on: str, off: str) -> None:
    a = module("A", "", f"{MOVE}\nrB;\n{MOVE}\n{off}\n{MOVE}", routine="main")
    program = task(tmp_path, a, module("B", "", on))
    assert judged(program) == ["correct", "refuse", "correct"]
    assert "(b.mod, line 4) may shift it at run time" in program.targets[1].reason


@pytest.mark.promise("A path that a sensor corrects at run time is refused.")
def test_sensor_corrections(tmp_path: Path) -> None:
    program = task(tmp_path, module("A", "", f"MoveL\\Corr,{RT},v1,z1,tGrip;\nMoveL {RT},v1,z1,tGrip\\Corr;"))
    assert [t.reason for t in program.targets] == ["\\Corr: a sensor shifts the path at run time"] * 2


@pytest.mark.promise("A task that loads modules at run time is whole only if they are at hand.")
def test_modules_that_are_loaded(tmp_path: Path) -> None:
    b = module("B", "", "MoveL p1,v1,z1,tGrip;")
    for code, verdict in (
        ('Load\\Dynamic,"HOME:/parts/b.mod";', "correct"),
        ('Load\\Dynamic,diskhome\\File:="B.MOD";', "correct"),
        ('StartLoad "HOME:"\\File:="z.mod",ls;', "refuse"),
        ("Load\\Dynamic,name;", "refuse"),
    ):
        a = module("A", POINT, f'{code}\n%"rB"%;', routine="main")
        target = only(task(tmp_path, a, b), "p1")
        assert target.verdict == verdict, code
    assert "loads a module that is not here: Load (a.mod, line 4)" in target.reason


@pytest.mark.promise("Points of a PUBLIC data list are corrected only where the whole project is read.")
def test_points_that_a_krl_module_shares(tmp_path: Path) -> None:
    pose = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
    src = "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN XP\nEND\n"
    for head, word, reason in (
        ("A PUBLIC", "DECL", "its data list is PUBLIC: other modules may import it"),
        ("A PUBLIC", "DECL GLOBAL", "GLOBAL: other modules may use it"),
        ("A", "DECL", ""),
    ):
        lay(tmp_path, {"a.src": src, "a.dat": f"DEFDAT {head}\n{word} E6POS XP={pose}\nENDDAT\n"})
        target = only(read_program(tmp_path / "a.src"), "XP")
        assert (target.verdict == "refuse") == bool(reason)
        assert reason in target.reason
        for program in (read_program(tmp_path / "a.src", None, WHOLE), read_program(tmp_path)):
            assert only(program, "XP").verdict == "correct"
