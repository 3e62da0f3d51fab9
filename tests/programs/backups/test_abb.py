"""A controller's backup of ABB: what is in it, which modules belong to which task, and what is refused."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.backups import abb as made

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions
from truepose.programs.backups import abb
from truepose.programs.rapid.controller import robots
from truepose.programs.robot_base import own_robot, standing

RT = "[[600,0,800],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
MOVE = f"MoveL {RT},v1,z1,tool0;"
TASK1 = "RAPID/TASK1/PROGMOD/"
TWO_ROBOTS = {
    "SYSPAR/MOC.cfg": 'MOC:CFG_1.0:6:0::\n#\nROBOT:\n\n -name "ROB_1" -base_frame_pos_x 1\n\n'
    ' -name "ROB_2" -base_frame_pos_x -0.5 -base_frame_orient_u0 0\\\n -base_frame_orient_u3 1\n',
    "SYSPAR/SYS.cfg": "SYS:CFG_1.0:6:0::\n#\nCAB_TASKS:\n\n"
    ' -Name "T_ROB1" -UseMechanicalUnitGroup "rob1" -MotionTask\n\n'
    ' -Name "T_ROB2" -UseMechanicalUnitGroup "rob2" -MotionTask\n#\nMECHANICAL_UNIT_GROUP:\n\n'
    ' -Name "rob1" -Robot "ROB_1"\n\n -Name "rob2" -Robot "ROB_2"\n',
    "BACKINFO/backinfo.txt": (
        ">>TASK1: (T_ROB1,,)\nPROGMOD\\a.mod @ \n\n>>TASK2: (T_ROB2,,)\nPROGMOD\\a.mod @ \n>>EOF:\n"
    ),
    "RAPID/TASK1/PROGMOD/a.mod": f"MODULE A\nPROC main()\n{MOVE}\nENDPROC\nENDMODULE\n",
    "RAPID/TASK2/PROGMOD/a.mod": f"MODULE A\nPROC main()\n{MOVE}\nENDPROC\nENDMODULE\n",
}
Lay = Callable[[dict[str, Any]], Path]


@pytest.fixture
def lay(tmp_path: Path) -> Lay:
    def write(files: dict[str, Any]) -> Path:
        for name, content in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
        return tmp_path

    return write


def files_of(root: Path) -> list[Path]:
    return sorted(path for path in root.rglob("*") if path.is_file())


def read(root: Path, **options: Any) -> tuple[list[Program], list[FileError]]:
    return abb.read_all(root, files_of(root), FrameTable(tools={"tool0": np.eye(4)}), ReadOptions(**options))


def module(name: str, data: str = "", code: str = "", routine: str = "") -> str:
    return f"MODULE {name}\n{data}\nPROC {routine or f'r{name}'}()\n{code}\nENDPROC\nENDMODULE\n"


def task(main: str, **more: str) -> dict[str, str]:
    return {f"{TASK1}a.mod": main, **{f"{TASK1}{name}.mod": text for name, text in more.items()}}


def reasons(programs: list[Program]) -> list[str]:
    return [target.reason for program in programs for target in program.targets]


def test_the_files_of_a_controller_are_sorted(lay: Lay) -> None:
    root = lay(made.backup())
    files = files_of(root)
    assert abb.roots(files) == [root]
    found = abb.contents(root, files)
    assert [len(one) for one in found.programs] == [31, 4]
    assert Counter(found.others.values()) == {
        "machine data": 3, "other data": 2, "backup information": 1, "spare copy": 1, "program list": 1,
    }  # fmt: skip
    assert (found.robot, found.version, found.warnings) == ("IRB 4600-45/2.05", "6.08.01.00", [])
    assert sorted([*found.others, *(path for one in found.programs for path in one)]) == files
    stored = abb.stored_frames(root, files).tf_world_base
    assert stored is not None
    np.testing.assert_allclose(stored[:3, 3], [102.5, 0, 450])


def test_a_backup_is_recognised_by_its_folders_in_any_case(lay: Lay) -> None:
    root = lay({f"a/{name.upper()}": text for name, text in TWO_ROBOTS.items()})
    lay({f"b/{name.lower()}": text for name, text in TWO_ROBOTS.items()})
    lay({"a/HOME/old/RAPID/TASK1/PROGMOD/x.mod": "", "c/RAPID/task.mod": "", "c/x/TASK1/a.mod": ""})
    assert abb.roots(files_of(root)) == [root / "a", root / "b"]
    for name in "ab":
        programs, errors = read(root / name, mechanical_unit="ROB_1")
        assert (errors, [p.counts()["correct"] for p in programs]) == ([], [1, 0])


@pytest.mark.promise("In an ABB backup with several robots, only the tasks of the map's robot are corrected.")
def test_several_robots_each_with_its_place(lay: Lay) -> None:
    root = lay(TWO_ROBOTS)
    for unit, k, p in (("ROB_1", 0, [-400, 0, 800]), ("rob_2", 1, [-1100, 0, 800])):
        programs, _ = read(root, mechanical_unit=unit)
        assert [program.counts()["correct"] for program in programs] == [int(k == 0), int(k == 1)]
        np.testing.assert_allclose(programs[k].positions_base(), [p], atol=1e-9)
        assert "and the map is that of " + unit in reasons(programs)[1 - k]
    programs, _ = read(root)
    assert {target.verdict for program in programs for target in program.targets} == {"skip"}
    assert "several robots: ROB_1 (task T_ROB1), ROB_2 (task T_ROB2); name that of the map" in reasons(programs)[0]
    (root / "BACKINFO/backinfo.txt").unlink()
    programs, _ = read(root, mechanical_unit="ROB_1")
    assert "is not known: backinfo.txt and SYS.cfg state it" in reasons(programs)[0]
    assert "the names of the tasks are not known" in abb.contents(root, files_of(root)).warnings[0]


def test_the_robot_of_a_task_is_found_in_a_zip_as_in_a_folder(lay: Lay) -> None:
    root = lay({f"cell/{name}": text for name, text in TWO_ROBOTS.items()}) / "cell"
    packed = Path(shutil.make_archive(str(root), "zip", root))
    found = robots(root / "SYSPAR/MOC.cfg")
    for place in (root, packed):
        for n in (1, 2):
            own = own_robot(found, place / "SYSPAR/MOC.cfg", place / f"RAPID/TASK{n}")
            assert own is not None
            assert own.name == f"ROB_{n}"
        table = standing(FrameTable(), place / "RAPID/TASK2/PROGMOD/a.mod", "rapid")
        np.testing.assert_allclose(table.bases[0][:3, 3], [-500, 0, 0], atol=1e-9)


def test_a_robot_on_a_track_is_refused(lay: Lay) -> None:
    moc = 'MOC:CFG_1.0:6:0::\n#\nROBOT:\n\n -name "ROB_1" -base_frame_coordinated "TRACK_1"\n'
    programs, _ = read(lay({**task(module("A", "", MOVE)), "SYSPAR/MOC.cfg": moc}))
    assert reasons(programs) == ["the base of ROB_1 is carried by TRACK_1, which has no model"]


@pytest.mark.parametrize(
    ("name", "text", "message", "verdict"),
    [
        ("SYSPAR/MOC.cfg", 'ROBOT:\n\n -name "R" -base_frame_pos_x 1,5\n', r"MOC\.cfg:3: R: base_frame_pos_x", "skip"),
        ("SYSPAR/MOC.cfg", 'ROBOT:\n\n -name "R" = 5\n', r"MOC\.cfg:3: is not understood: = 5", "skip"),
        ("SYSPAR/MOC.cfg", 'ROBOT:\n\n -name "R" -name "S"\n', r"MOC\.cfg:3: gives -name twice", "skip"),
        ("SYSPAR/SYS.cfg", 'CAB_TASKS:\n\n -Name "T" -UseMechanicalUnitGroup "x"\n', r"SYS\.cfg:3: names .* x, ", ""),
        ("BACKINFO/backinfo.txt", ">>TASK1: (T,,)\nPROGMOD/a.mod\n", r"backinfo\.txt:2: lists .* without an", ""),
        ("BACKINFO/backinfo.txt", ">>TASK1: (T,,)\n>>TASK1: (U,,)\n", r"backinfo\.txt:2: lists TASK1 twice", ""),
    ],
)  # fmt: skip
def test_a_broken_file_of_the_controller_blocks_no_more_than_it_states(
    lay: Lay, name: str, text: str, message: str, verdict: str
) -> None:
    """Without MOC.cfg nobody knows where the robot stands; the modules are read all the same."""
    root = lay({**task(module("A", "", MOVE)), name: text})
    programs, _ = read(root)
    assert [target.verdict for program in programs for target in program.targets] == [verdict or "correct"]
    assert any(re.search(message, warning) for warning in abb.contents(root, files_of(root)).warnings)
    if verdict:
        assert re.search(message + r".*; correct that file, or copy it from the controller again", reasons(programs)[0])


def test_a_broken_list_of_modules_leaves_the_task_not_whole(lay: Lay) -> None:
    """A point that other modules may use is refused: which modules the task loads is not known."""
    broken = {"BACKINFO/backinfo.txt": ">>TASK1: (T,,)\nPROGMOD/a.mod\n"}
    files = task(module("A", f"CONST robtarget p1:={RT};", "MoveL p1,v1,z1,tool0;"))
    (sound,), _ = read(lay(files))
    (distrusted,), _ = read(lay({**files, **broken}))
    assert [target.verdict for target in (*sound.targets, *distrusted.targets)] == ["correct", "refuse"]


def test_two_files_that_differ_in_case_only_are_named(lay: Lay) -> None:
    root = lay({**task(module("A", "", MOVE)), f"{TASK1}A.MOD": "MODULE b\nENDMODULE\n"})
    with pytest.raises(FileError, match="differs from it in upper and lower case only"):
        read(root)


@pytest.mark.promise("System modules of an ABB backup are corrected only with --system-modules, hidden ones never.")
def test_system_modules_and_hidden_ones_are_read_and_left(lay: Lay) -> None:
    listed = ">>TASK1: (T_ROB1,,)\nPROGMOD/a.mod @ \nSYSMOD/s.sys @ \nSYSMOD/h.sys @ HIDDEN\nPROGMOD/b.mod @ \n>>EOF:\n"
    data = f"CONST robtarget pS:={RT};\nCONST robtarget pT:={RT};"
    root = lay(
        {
            **task(module("A", "", f"MoveL pS,v1,z1,tool0;\n{MOVE}"), b=module("B"), old=module("B", "", MOVE)),
            "RAPID/TASK1/SYSMOD/s.sys": module("S", data, f"{MOVE}\nMoveL pT,v1,z1,tool0;"),
            "RAPID/TASK1/SYSMOD/h.sys": module("H", "", f"{MOVE}\nMoveL pT,v1,z1,tool0\\WObj:=w;"),
            "BACKINFO/backinfo.txt": listed,
        }
    )
    assert abb.contents(root, files_of(root)).others[root / TASK1 / "old.mod"] == "not loaded"
    (program,), _ = read(root)
    found = Counter((target.path.name, target.verdict) for target in program.targets)
    assert found == {("a.mod", "correct"): 1, ("s.sys", "skip"): 3, ("h.sys", "skip"): 1}
    (program,), _ = read(root, system_modules=True)
    found = Counter((target.path.name, target.verdict) for target in program.targets)
    # pT has another workobject in the hidden module
    assert found == {
        ("a.mod", "correct"): 1, ("s.sys", "correct"): 2, ("s.sys", "refuse"): 1, ("h.sys", "skip"): 1,
    }  # fmt: skip


@pytest.mark.promise("An encoded module of a task is named, and data without LOCAL are refused because of it.")
def test_encoded_modules(lay: Lay) -> None:
    data = f"CONST robtarget p:={RT};LOCAL CONST robtarget q:={RT};TASK PERS robtarget r:={RT};"
    code = f"MoveL p,v1,z1,tool0;\nMoveL q,v1,z1,tool0;\nMoveL r,v1,z1,tool0;\n{MOVE}"
    root = lay({**task(module("A", data, code)), f"{TASK1}x.mod": b"\xfc\x01\x02"})
    found = abb.contents(root, files_of(root))
    assert found.others[root / TASK1 / "x.mod"] == "encoded"
    assert found.warnings[1:] == ["task TASK1: module PROGMOD/x.mod is encoded"]
    (program,), _ = read(root)
    assert {t.name: t.verdict for t in program.targets} == {
        "p": "refuse", "q": "correct", "r": "refuse", "MoveL:7": "correct",
    }  # fmt: skip
    assert "module PROGMOD/x.mod is encoded, and may move to it" in program.targets[0].reason
    (program,), _ = read(root, whole_task=True)
    assert {t.name: t.verdict for t in program.targets} == dict.fromkeys(["p", "q", "r", "MoveL:7"], "correct")
    listed = ">>TASK1: (T_ROB1,,)\nPROGMOD/a.mod @ \nPROGMOD/x.mod @ HIDDEN\n>>EOF:\n"
    (program,), _ = read(lay({"BACKINFO/backinfo.txt": listed}))  # it came with an option, and knows no such names
    assert {t.name: t.verdict for t in program.targets} == {
        "p": "correct", "q": "correct", "r": "skip", "MoveL:7": "correct",
    }  # fmt: skip


def test_modules_that_are_listed_and_not_there(lay: Lay) -> None:
    data, code = f"CONST robtarget p:={RT};", "MoveL p,v1,z1,tool0;"
    listed = ">>TASK1: (T_ROB1,,)\nPROGMOD/a.mod @ \nPROGMOD/gone.mod @ \n>>EOF:\n"
    (program,), _ = read(lay({**task(module("A", data, code)), "BACKINFO/backinfo.txt": listed}))
    assert "module PROGMOD/gone.mod is listed in backinfo.txt and not there" in program.targets[0].reason
    listed = ">>TASK1: (T_ROB1,,)\nPROGMOD/a.mod @ \n>>EOF:\n"
    pgf = "<Program><Module>a.mod</Module><Module>far.mod</Module></Program>"
    root = lay({"BACKINFO/backinfo.txt": listed, f"{TASK1}p.PGF": pgf})
    (program,), _ = read(root)
    assert "module far.mod is listed in p.PGF and not there" in program.targets[0].reason


@pytest.mark.promise("Modules of HOME are read only where the controller or a program loads them.")
@pytest.mark.parametrize(
    ("code", "loaded"),
    [
        ('Load\\Dynamic,"HOME:/parts/z.mod";', True),
        ('Load "HOME:"\\File:="parts/z.mod";', True),
        ('Load\\Dynamic,diskhome\\File:="parts/z.mod";', True),
        ('! Load "HOME:/parts/z.mod";', False),
        ("", False),
    ],
)
def test_modules_in_home(lay: Lay, code: str, loaded: bool) -> None:
    text = module("Z", "", "MoveL p,v1,z1,tool0\\WObj:=wobj0;", routine="rPart")
    root = lay(
        {
            **task(
                module("A", f"CONST robtarget p:={RT};", f'{code}\nMoveL p,v1,z1,tool0;\n%"rPart"%;', routine="main")
            ),
            "HOME/parts/z.mod": text,
            "HOME/z.mod": text,
        }
    )
    found = abb.contents(root, files_of(root))
    assert found.others.get(root / "HOME/parts/z.mod") == (None if loaded else "spare copy")
    assert found.others[root / "HOME/z.mod"] == "spare copy"
    (program,), _ = read(root)
    assert program.targets[0].verdict == "correct"
    assert len(program.targets[0].motions) == 1 + loaded


def test_modules_of_home_that_the_configuration_loads(lay: Lay) -> None:
    sys = 'SYS:CFG_1.0:6:0::\n#\nCAB_TASK_MODULES:\n\n -File "HOME:/{}" -ModName "m" -AllTask \n'
    home = module("M", "", MOVE)
    both = {**task(module("A", "", MOVE)), "RAPID/TASK2/PROGMOD/b.mod": module("B", "", MOVE), "HOME/m.mod": home}
    root = lay({**both, "SYSPAR/SYS.cfg": sys.format("m.mod")})
    programs, _ = read(root)
    assert [program.counts()["correct"] for program in programs] == [1, 1]
    assert reasons(programs).count("several tasks load it") == 2
    lay({"RAPID/TASK1/PROGMOD/m.mod": home + "\n", "RAPID/TASK2/PROGMOD/m.mod": home})
    found = abb.contents(root, files_of(root))
    assert found.others[root / "HOME/m.mod"] == "spare copy"
    assert [w for w in found.warnings if "differs" in w] == [
        "HOME/m.mod differs from RAPID/TASK1/PROGMOD/m.mod; the controller loads the former when it is started anew"
    ]


@pytest.mark.promise("A task that cannot be read is named; the others are read, without the data that it may write.")
def test_a_broken_task_does_not_stop_the_others(lay: Lay) -> None:
    data = f'PERS robtarget p:={RT};PERS wobjdata w:=[FALSE,TRUE,"",[[1,2,3],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];'
    main = module("A", data, f"MoveL p,v1,z1,tool0;\nMoveL {RT},v1,z1,tool0\\WObj:=w;\n{MOVE}")
    for text, expected in (("w.uframe:=x;", "refuse"), ("y:=1;", "correct")):
        root = lay({**task(main), "RAPID/TASK2/PROGMOD/b.mod": module("B", "PERS wobjdata w;", f"{text}\nMoveL ];")})
        (program,), (error,) = read(root)
        assert "] closes nothing" in str(error)
        assert [target.verdict for target in program.targets] == ["skip", expected, "correct"]
        assert "TASK2 cannot be read and may write it" in program.targets[0].reason


def test_two_modules_of_one_name_refuse_their_task_only(lay: Lay) -> None:
    files = {
        **task(module("Same", "", MOVE), b=module("SAME", "", MOVE)),
        "RAPID/TASK2/PROGMOD/b.mod": module("B", "", MOVE),
    }
    (program,), (error,) = read(lay(files))
    assert "module SAME is in" in str(error)
    assert "all 2 modules of the task are refused" in str(error)
    assert (program.path.name, program.counts()["correct"]) == ("TASK2", 1)


WOBJ = 'wobjdata w:=[FALSE,TRUE,"",[[{},2,3],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];'


@pytest.mark.promise("PERS of one name and type is one variable in all tasks of an ABB controller.")
@pytest.mark.parametrize(
    ("first", "second", "code", "reason"),
    [
        (f"PERS {WOBJ.format(1)}", f"PERS {WOBJ.format(1)}", "", ""),
        (f"PERS {WOBJ.format(1)}", "PERS wobjdata w;", "", ""),
        ("PERS wobjdata w;", f"PERS {WOBJ.format(1)}", "", ""),
        (
            f"PERS {WOBJ.format(1)}",
            f"PERS {WOBJ.format(9)}",
            "",
            "w has one value in TASK1 (line 2) and another in TASK2",
        ),
        (f"PERS {WOBJ.format(1)}", f"TASK PERS {WOBJ.format(9)}", "w.oframe:=x;", ""),
        (f"TASK PERS {WOBJ.format(1)}", f"PERS {WOBJ.format(9)}", "w.oframe:=x;", ""),
        (f"PERS {WOBJ.format(1)}", "PERS wobjdata w;", "w.oframe:=x;", "w is changed by the program"),
        (f"PERS {WOBJ.format(1)}", "PERS wobjdata w;", "w.ufprog:=FALSE;", "w is changed by the program"),
    ],
)
def test_workobjects_of_several_tasks(lay: Lay, first: str, second: str, code: str, reason: str) -> None:
    main = module("A", first, f"MoveL {RT},v1,z1,tool0\\WObj:=w;")
    programs, _ = read(lay({**task(main), "RAPID/TASK2/PROGMOD/b.mod": module("B", second, code)}))
    (target,) = programs[0].targets
    assert reason in target.reason
    assert (target.verdict == "correct") == (not reason)
    if not reason:
        np.testing.assert_allclose(programs[0].positions_base(), [[601, 2, 803]])


@pytest.mark.parametrize(
    ("second", "code", "reason"),
    [
        ("", "p:=x;", ""),  # a name that the second task does not declare: no data of the first
        ("PERS robtarget p;", "", "it is one variable with that of another task (line 2)"),
        ("TASK PERS robtarget p;", "p:=x;", ""),
        ("PERS num p;", "p:=1;", ""),
        ("", "SetDataVal n,x;", "data are set by a name that only the run time knows (line 4)"),
        ("", 'Load "HOME:/far.mod";', "a module that is loaded at run time may write it"),
    ],
)
def test_points_of_several_tasks(lay: Lay, second: str, code: str, reason: str) -> None:
    main = module("A", f"PERS robtarget p:={RT};", "MoveL p,v1,z1,tool0;")
    programs, _ = read(lay({**task(main), "RAPID/TASK2/PROGMOD/b.mod": module("B", second, code)}))
    (target,) = programs[0].targets
    assert reason in target.reason
    assert target.verdict == ("skip" if reason else "correct")
