"""Every row of the catalogue of hazards that concerns Yaskawa INFORM and Stäubli VAL3, by name, with its verdict."""

# ruff: noqa: E501
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_program

XYZ = "600.000,-0.500,800.000,180.0000,0.0000,-90.0000"
FRAMES = FrameTable(tools={1: np.eye(4), 2: np.eye(4)}, bases={3: np.eye(4)})
MEASURED = replace(FRAMES, tool="map")
Read = Callable[..., Program]


@pytest.fixture
def job(tmp_path: Path) -> Read:
    def reading(code: str, positions: str, **options: Any) -> Program:
        path = tmp_path / "a.jbi"
        head = "/JOB\n//NAME A\n//POS\n///NPOS 3,0,0,0,0,0\n///TOOL 1\n"
        path.write_text(f"{head}{positions}\n//INST\n///DATE 2024/01/01 10:00\nNOP\n{code}\nEND\n")
        return read_program(path, FRAMES, ReadOptions(**options))

    return reading


def verdicts(program: Program) -> dict[str, str]:
    return {target.name: target.verdict for target in program.targets}


def test_postype_is_modal_and_switches_inside_a_job(job: Read) -> None:
    positions = (
        f"///POSTYPE PULSE\n///PULSE\nC00000=1,2,3,4,5,6\n///POSTYPE BASE\n///RECTAN\n///RCONF 1,0,0,0,0\nC00001={XYZ}\n"
        f"C00002={XYZ}\n///POSTYPE ROBOT\n///TOOL 2\nC00003={XYZ}\n///POSTYPE USER\n///USER 3\nC00004={XYZ}\n///USER 9\nC00005={XYZ}"
    )
    program = job("\n".join(f"MOVL C0000{k} V=100.0" for k in range(6)), positions)
    assert [(t.verdict, t.frame, t.tool) for t in program.targets] == [
        ("skip", "", ""),
        ("correct", "BASE", "TOOL 1"),
        ("correct", "BASE", "TOOL 1"),
        ("correct", "ROBOT", "TOOL 2"),
        ("correct", "USER 3", "TOOL 2"),
        ("refuse", "USER 9", "TOOL 2"),
    ]
    assert program.targets[1].configuration == "1,0,0,0,0"


@pytest.mark.promise("P variables of INFORM are corrected only where no other job uses them.")
def test_p_variables_are_those_of_all_jobs(job: Read) -> None:
    program = job("MOVL P002 V=1.0\nMOVL C00001 V=1.0", f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}\nP00002={XYZ}")
    assert verdicts(program) == {"C00001": "correct", "P00002": "refuse"}
    reason = next(t.reason for t in program.targets if t.name == "P00002")
    assert "P variables are those of all jobs" in reason
    assert "--whole-task" in reason


def test_p_variables_shifts_increments_and_mframe(job: Read) -> None:
    positions = f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}\nP00002={XYZ}"
    assert verdicts(job("MOVL P002 V=1.0", positions, whole_task=True))["P00002"] == "correct"
    for code in ("SET P002 (1) 5", "GETS PX002 $PX001", "ADD P002 P003", "CNVRT PX002 PX003 BF"):
        assert verdicts(job(f"{code}\nMOVL P002 V=1.0", positions))["P00002"] == "skip", code
    assert verdicts(job("MOVL P[I001] V=1.0", positions))["P[I001]"] == "skip"
    shifted = job("MOVL C00001 V=1.0\nSFTON P009\nMOVL C00001 V=1.0\nSFTOF", positions)
    assert verdicts(shifted)["C00001"] == "refuse"
    assert verdicts(job("SFTON P009\nMOVL C00001 V=1.0\nSFTOF", positions))["C00001"] == "skip"
    assert verdicts(job("SFTON P009\nSFTOF\nMOVL C00001 V=1.0", positions))["C00001"] == "correct"
    assert verdicts(job("*A\nMOVL C00001 V=1.0\nSFTON P009\nJUMP *A IF IN#(1)=ON", positions))["C00001"] == "skip"
    assert verdicts(job("IMOV P002 V=1.0 BF", positions)) == {"IMOV:13": "skip", "P00002": "skip", "C00001": "skip"}
    user = f"///POSTYPE USER\n///USER 3\n///RECTAN\nC00001={XYZ}"
    assert verdicts(job("MOVL C00001 V=1.0\nMFRAME UF#(3) P001 P002 P003", user))["C00001"] == "refuse"


def test_circles_other_motions_comments_and_tracks(job: Read) -> None:
    rectangular = f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}\nC00002={XYZ}\n"
    pulse = "///POSTYPE PULSE\n///PULSE\nC00003=1,2,3,4,5,6\n"
    arc = job("MOVC C00001 V=1.0\nMOVC C00002 V=1.0\nMOVC C00003 V=1.0\nMOVJ C00001 VJ=5.0", rectangular + pulse)
    assert set(verdicts(arc).values()) == {"skip"}
    assert "refuse" in verdicts(job("GLIDE C00001 V=5.0", rectangular)).values()
    assert verdicts(job("'MOVL C00001 V=1 600.000\nREFP 1 C00002", rectangular)) == {"C00001": "skip", "C00002": "skip"}
    track = rectangular + "BC00001=100.000\nBC00002=0.000"
    program = job("MOVL C00001 BC00001 V=1.0\nMOVL C00002 BC00002 V=1.0", track)
    assert verdicts(program) == {"C00001": "refuse", "C00002": "correct"}
    assert verdicts(job("MOVL C00001 BC00001 V=1.0", track, external_axes=True))["C00001"] == "correct"


@pytest.mark.parametrize(
    ("positions", "message"),
    [
        ("///POSTYPE BASE\nC00001=1,2,3", "has 3 numbers, expected 6"),
        (f"///POSTYPE BASE\nC00001={XYZ}\nC00001={XYZ}", "is given twice, first in line 7"),
        (f"///POSTYPE BASE\nC00001={XYZ.replace('600.000', '1.2.3')}", r"a\.jbi:7: X: 1\.2\.3 is not a number"),
        ("nonsense", "a line under //POS that is not understood"),
    ],
)
def test_broken_jobs(job: Read, positions: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        job("MOVL C00001 V=1.0", positions)


def test_truncated_and_other_jobs(tmp_path: Path) -> None:
    path = tmp_path / "a.jbi"
    path.write_text("/JOB\n//POS\n//INST\nNOP\n")
    with pytest.raises(FileError, match="has no END: the file is truncated"):
        read_program(path)
    path.write_text("MODULE m\nENDMODULE")
    with pytest.raises(FileError, match="does not start with /JOB"):
        read_program(path)


POSE = 'x="600" y="-.5" z="800.000" rx="0" ry="180" rz="0"'


@pytest.fixture
def dtx(tmp_path: Path) -> Read:
    def reading(data: str, program: str | None = None, frames: FrameTable = MEASURED) -> Program:
        path = tmp_path / "a.dtx"
        path.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n<Database><Datas>\n{data}\n</Datas></Database>\n')
        (tmp_path / "start.pgx").unlink(missing_ok=True)
        if program is not None:
            (tmp_path / "start.pgx").write_text(f"<Program><Code><![CDATA[begin\n{program}\nend]]></Code></Program>")
        return read_program(path, frames)

    return reading


def item(kind: str, name: str, father: str = "world[0]", pose: str = POSE) -> str:
    return f'<Data name="{name}" access="private" type="{kind}" size="1"><Value key="0" {pose} fatherId="{father}" /></Data>'


def test_point_when_the_father_frame_is_known(dtx: Read) -> None:
    turned = 'x="0" y="0" z="10" rx="0" ry="0" rz="90"'
    data = [
        item("pointRx", "p1"),
        item("pointRx", "p2", "fA[0]"),
        item("pointRx", "p3", "fLost[0]"),
        item("frame", "fA", "fB[0]", turned),
        item("frame", "fB", pose='x="1000" y="0" z="0" rx="0" ry="0" rz="0"'),
        item("frame", "fLost", "lib:fX[0]"),
    ]
    program = dtx("\n".join(data))
    assert verdicts(program) == {"p1": "correct", "p2": "correct", "p3": "refuse"}
    np.testing.assert_allclose(program.positions_base()[1], [1000.5, 600, 810])
    assert (program.targets[1].frame, program.targets[1].tool) == ("fA", "as measured")


def test_numbers_that_are_not_written_are_zero_and_stay_unwritten(dtx: Read) -> None:
    data = [item("pointRx", "p1", "fA[0]", 'x="1" y="2" z="3" rz="90"'), item("pointRx", "p2", pose='x="1"')]
    program = dtx("\n".join([*data, item("frame", "fA", pose='y="100"')]))
    assert verdicts(program) == {"p1": "correct", "p2": "skip"}
    assert program.targets[1].reason == "y, z not written, so 0: nothing is added to a file"
    np.testing.assert_allclose(program.positions_base(), [[1, 102, 3]])
    (path,) = {source.path for source in program.sources}
    turning = read_program(path, MEASURED, ReadOptions(orientation=True))
    assert turning.targets[0].reason == "rx, ry not written, so 0: nothing is added to a file"


def test_frames_tools_and_joints(dtx: Read) -> None:
    joints = '<Data name="j" type="jointRx"><Value key="0" j1="0" j2="0" j3="0" j4="0" j5="0" j6="0" /></Data>'
    program = dtx(item("frame", "f") + item("tool", "t", "flange[0]") + joints)
    assert [(t.name, t.reason) for t in program.targets] == [("j", "joint target")]


def test_programs_beside_the_data_say_how_points_are_used(dtx: Read) -> None:
    data = "\n".join([*(item("pointRx", f"p{k}") for k in range(1, 7)), item("tool", "t", "flange[0]")])
    code = (
        "movej(p1, t, mNom)\n movel(appro(p2,{0,0,-100,0,0,0}),t,m)\n movec(p3,p4,t,m)\n // movel(p5,t,m)\n"
        "movel(p6,t,m)\n x=p6.trsf.x"
    )
    program = dtx(data, code)
    assert verdicts(program) == {
        "p1": "correct", "p2": "skip", "p3": "correct", "p4": "correct", "p5": "skip", "p6": "refuse",
    }  # fmt: skip
    assert (program.targets[0].tool, program.targets[0].motions) == ("t", ("movej",))
    np.testing.assert_allclose(program.tools()[0, :3, 3], [600, -0.5, 800])
    moved = dtx(
        item("pointRx", "p1", "f[0]") + item("frame", "f") + item("tool", "t", "flange[0]"), "f.trsf.x=5\nmovel(p1,t,m)"
    )
    assert verdicts(moved) == {"p1": "refuse"}


def test_attributes_are_patched_in_place(tmp_path: Path, make_map: Any) -> None:
    text = (
        b"<?xml version='1.0' encoding='iso-8859-1'?>\r\n<Database  xmlns='x'><!-- gr\xfcn -->\r\n<Datas><Data access=\"private\" type=\"pointRx\" name='p'>"
        b'<Value  key="0"\r\n  z = \'800.000\' x="600" y="-.5" rx="0" ry="180" rz="0" fatherId="world[0]"/></Data></Datas></Database>'
    )
    path = tmp_path / "a.dtx"
    path.write_bytes(text)
    corrected = correct_program(path, make_map([0.5, 0.25, -0.125]), frames=MEASURED)
    assert corrected.files[path] == text.replace(b"800.000", b"799.875").replace(b'"600"', b'"600.5"').replace(
        b"-.5", b"-.25"
    )


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("<Data", r"a\.dtx:4: is broken XML"),
        (item("pointRx", "p") * 2, "p is declared twice, first in line 3"),
        (item("pointRx", "p").replace('"600"', '"1.2.3"'), r"a\.dtx:3: p x: 1\.2\.3 is not a number"),
        ("", "has no <Data>"),
    ],
)
def test_broken_data(dtx: Read, data: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        dtx(data)


def test_entities_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.dtx"
    path.write_text('<!DOCTYPE x [<!ENTITY a "1">]><Database><Data name="p" type="pointRx"></Data></Database>')
    with pytest.raises(FileError, match="has a DOCTYPE"):
        read_program(path)


@pytest.mark.promise("INFORM: positions in reach of a run-time shift are refused by its name")
def test_inform_run_time_shifts(job: Read, record_property: Any) -> None:
    positions = f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}\nC00002={XYZ}\nC00003={XYZ}"
    regions = {
        "SYSTART CV#(1) STP=10.0": "SYEND CV#(1)",
        "COMARCON #(1)": "COMARCOF",
        "TRTON": "TRTOF",
        "TRT ON": "TRT OF",
        "FLOATON FL#(1)": "FLOATOF",
        "SENSON": "SENSOF",
        "FORCEON": "FORCEOF",
    }
    record_property("cases", 2 * len(regions) + 1)
    for begin, end in regions.items():
        code = f"MOVL C00001 V=1.0\n{begin}\nMOVL C00002 V=1.0\n{end}\nMOVL C00003 V=1.0"
        program = job(code, positions)
        assert verdicts(program) == {"C00001": "correct", "C00002": "refuse", "C00003": "correct"}, begin
        assert program.targets[1].reason.startswith(f"{begin} (line 15) may shift it")
        maybe = code.replace(f"\n{begin}\n", f"\nIFTHENEXP I000=0\n{begin}\nENDIF\n")
        assert verdicts(job(maybe, positions)) == verdicts(program), begin
    assert verdicts(job("MOVL C00001 V=1.0 CV#(1) CTP=5.0", positions))["C00001"] == "refuse"


STRAYS = (
    "MOVL C00000 V=10.0 MOVL C00001 V=10.0",
    "MOVL C00000 V=10.0 SMOVL C00001 V=10.0",
    "DOUT OT#(1) ON MOVJ C00001 VJ=1.0",
    "*A WAIT IN#(1)=ON IMOV P001 V=1 MOVC C00001",
    "MOVL C00000 V=10.0 SFTON P001",
)
HARMLESS = ("'MOVL C00001 V=1", "MOVL C00000 V=1.0 'MOVL C00001", 'MSG "MOVL C00001 V=1"', "JUMP *MOVL IF IN#(1)=ON")


@pytest.mark.promise("An INFORM job with a motion or shift inside another instruction is not read.")
def test_inform_motion_inside_another_instruction(job: Read, record_property: Any) -> None:
    positions = f"///POSTYPE BASE\n///RECTAN\n///RCONF 1,0,0,0,0\nC00000={XYZ}\nC00001={XYZ}"
    for code in STRAYS:
        with pytest.raises(FileError, match=r"a\.jbi:\d+: a motion or shift inside another instruction"):
            job(f"MOVL C00000 V=10.0\n{code}", positions)
    for code in HARMLESS:
        assert verdicts(job(f"MOVL C00000 V=10.0\n{code}\nMOVL C00001 V=1.0", positions))["C00001"] == "correct", code
    record_property("cases", len(STRAYS) + len(HARMLESS))


@pytest.mark.promise("INFORM: a rectangular position with another number of values than six is refused")
def test_inform_seventh_number(job: Read) -> None:
    program = job("MOVL C00001 V=1.0", "///POSTYPE BASE\n///RECTAN\nC00001=600,5,-0.500,800.000,180.0,0.0,-90.0")
    assert (program.targets[0].verdict, program.targets[0].reason[:9]) == ("refuse", "7 numbers")


@pytest.mark.promise("VAL3: compliant and altered motions refuse their points by name")
def test_val3_run_time_shifts(dtx: Read, record_property: Any) -> None:
    data = item("pointRx", "p1") + item("pointRx", "p2") + item("tool", "t", "flange[0]")
    programs = {
        "movelf(p1,t,m,f)\nmovel(p2,t,m)": ("refuse", "correct", "movelf (line 2 of start.pgx) yields to forces"),
        "movejf(p1,t,m)\nmovel(p2,t,m)": ("refuse", "correct", "movejf (line 2 of start.pgx) yields to forces"),
        "alterMovel(p1,t,m)\nmovel(p2,t,m)": ("refuse", "refuse", "alterMovel (line 2 of start.pgx) may shift it"),
        "alterBegin(f,m)\nmovel(p1,t,m)\nalterEnd()": (
            "refuse",
            "skip",
            "alterBegin (line 2 of start.pgx) may shift it",
        ),
    }
    record_property("cases", len(programs))
    for code, (first, second, reason) in programs.items():
        program = dtx(data, code)
        assert verdicts(program) == {"p1": first, "p2": second}, code
        assert program.targets[0].reason.startswith(reason)


@pytest.mark.promise("VAL3: a parameter or local variable is never read as the application's point of its name")
def test_val3_parameters_and_local_variables(dtx: Read, tmp_path: Path) -> None:
    data = item("pointRx", "p1") + item("pointRx", "p2") + item("tool", "t", "flange[0]")
    dtx(data, "movel(p1,t,m)")
    (tmp_path / "other.pgx").write_text(
        '<Program name="other"><Parameters><Parameter name="P1" type="pointRx" /></Parameters>'
        '<Locals><Local type="pointRx" name="p2" size="1" /></Locals>'
        "<Code><![CDATA[begin\np1.trsf.x=5\nmovel(appro(p1,x),t,m)\nmovel(p2,t,m)\nend]]></Code></Program>"
    )
    found = verdicts(read_program(tmp_path / "a.dtx", FRAMES))
    local = {"appro(p1,x) (line 3 of other.pgx)": "skip", "p2 (line 4 of other.pgx)": "skip"}
    assert found == {"p1": "correct", "p2": "skip", **local}


@pytest.mark.promise("VAL3: public points are corrected only when every application that may use them is read")
def test_val3_public_points(dtx: Read, tmp_path: Path) -> None:
    public = item("pointRx", "p1", "f[0]").replace("private", "public")
    data = public + item("pointRx", "p2") + item("frame", "f").replace("private", "public")
    unsaid = item("pointRx", "p3").replace('access="private" ', "")
    program = dtx(data + unsaid + item("tool", "t", "flange[0]"), "movel(p1,t,m)\nmovel(p2,t,m)\nmovel(p3,t,m)")
    assert verdicts(program) == {"p1": "refuse", "p2": "correct", "p3": "refuse"}
    assert "--whole-task" in program.targets[0].reason
    assert "make it private" in program.targets[0].reason
    correct = dict.fromkeys(("p1", "p2", "p3"), "correct")
    assert verdicts(read_program(tmp_path / "a.dtx", FRAMES, ReadOptions(whole_task=True))) == correct
    assert verdicts(read_program(tmp_path, FRAMES)) == correct
    other = tmp_path / "other"
    other.mkdir()
    code = "<Program><Code><![CDATA[begin\n{}\nend]]></Code></Program>"
    for line, refused in {
        "movel(lib:p1,t,m)": ["p1"],
        "lib:P3[0].trsf.x=5": ["p3"],
        "x=lib:p1.trsf.x+lib:p3.trsf.x": ["p1", "p3"],
        "lib:f.trsf.x=5": ["p1"],
        "x=lib:p2.trsf.x // lib:p1": [],  # private: another one of that name
    }.items():
        (other / "start.pgx").write_text(code.format(line))
        judged = read_program(tmp_path, FRAMES)
        assert [t.name for t in judged.targets if t.verdict == "refuse"] == refused, line
        if line.startswith("movel"):
            assert "lib:p1 (line 2 of other/start.pgx)" in judged.targets[0].reason


@pytest.mark.parametrize(
    ("code", "shifted"),
    [
        ("SWITCH I000 CASE 1\nSFTON P009\nCASE 2\nSFTOF\nENDSWITCH\n{}", True),
        ("SWITCH I000\nCASE 1\nSFTON P009\nDEFAULT\nSFTOF\nENDSWITCH\n{}", True),
        ("SFTON P009\nIFTHENEXP I000=0\nSFTOF\nELSE\nSFTOF\nENDIF\n{}", False),
        ("SFTON P009\nIFTHENEXP I000=0\nSFTOF\nELSEIFEXP I000=1\nSFTOF\nENDIF\n{}", True),
        ("SFTON P009\nWHILEEXP I000<5\nSFTOF\nENDWHILE\n{}", True),
        ("FOR I000 = 1 TO 3\n{}\nSFTON P009\nNEXT I000\nSFTOF", True),
        ("FOR I000 = 1 TO 3\nSFTON P009\nSFTOF\nNEXT I000\n{}", False),
        ("SFTON P009\nIF B000>5 JUMP *A\nSFTOF\n*A\n{}", True),
        ("SFTON P009\nRET IF IN#(1)=ON\nSFTOF\n{}", False),
        ("SFTON P009\nJUMP JOB:B IF IN#(1)=ON\nSFTOF\n{}", False),
    ],
)
def test_inform_shifts_reach_what_control_may_reach(job: Read, code: str, shifted: bool) -> None:
    positions = f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}"
    found = job(code.format("MOVL C00001 V=1.0"), positions)
    assert verdicts(found)["C00001"] == ("skip" if shifted else "correct")


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("IFTHENEXP I000=0", "IF of line 12 is not closed"),
        ("NEXT I000", "NEXT without FOR"),
        ("ELSE", "ELSE without IF"),
    ],
)
def test_inform_blocks_that_are_not_closed(job: Read, code: str, message: str) -> None:
    with pytest.raises(FileError, match=message):
        job(code, f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}")


def test_inform_groups_and_stations(job: Read) -> None:
    positions = f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}\nC00002={XYZ}\nEC00001=5"
    station = "///GROUP1 RB1\n///GROUP2 ST1\n"
    assert verdicts(job(f"{station}MOVL C00001 V=1.0 +MOVJ EC00001 VJ=5.0", positions))["C00001"] == "correct"
    assert verdicts(job(f"{station}MOVL C00001 EC00001 V=1.0", positions))["C00001"] == "correct"
    assert verdicts(job(f"{station}MOVL C00001 V=1.0\n+MOVJ EC00001 VJ=5.0", positions))["C00001"] == "correct"
    assert verdicts(job("MOVL C00001 EC00001 V=1.0", positions))["C00001"] == "refuse"  # no station is named
    assert verdicts(job(f"{station}SMOVL C00001 V=1.0 +MOVJ EC00001 VJ=5.0", positions))["C00001"] == "refuse"
    both = job("///GROUP1 RB1\n///GROUP2 RB2\nMOVL C00001 V=1.0 +MOVL C00002 V=1.0", positions)
    assert verdicts(both) == {"C00001": "correct", "C00002": "skip"}
    track = positions.replace("EC00001", "BC00001")
    assert verdicts(job("MOVJ BC00001 VJ=5.0\nMOVL C00001 V=1.0", track))["C00001"] == "refuse"


def test_two_inform_jobs_in_one_file_are_refused(job: Read) -> None:
    with pytest.raises(FileError, match=r":13: a second job in the file"):
        job("END\n/JOB\n//NAME B", f"///POSTYPE BASE\n///RECTAN\nC00001={XYZ}")
