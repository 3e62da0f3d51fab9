"""The system modules of KUKA's controllers of today do not hinder the programs that are taught on them."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.programs.backups import kuka as corpus
from tests.programs.backups import kuka_system as system
from tests.programs.backups.small import lay

from truepose.programs import Program, ReadOptions, read_programs

SYSTEM = {
    "KRC/R1/System/bas.src": system.BAS,
    "KRC/R1/System/sps.sub": system.SUBMIT,
    "KRC/R1/System/collmonlib.src": system.COLLISIONS,
    "KRC/R1/TP/Service/tool_service.src": system.TOOLS,
}
PROBE = {"KRC/R1/Program/probe.src": system.PROBE_SRC, "KRC/R1/Program/probe.dat": system.PROBE_DAT}
SPLINES = {
    "KRC/R1/Program/splines.src": system.SPLINES_SRC,
    "KRC/R1/Program/splines.dat": system.PROBE_DAT.replace("PROBE", "SPLINES"),
}


def read(folder: Path, *files: dict[str, str], small: bool = True) -> Program:
    """Read a backup with other files in it; `small`: without the programs of its user."""
    kept = {name: data for name, data in corpus.backup().items() if not small or "/Program/" not in name}
    more = {name: text.encode("latin-1") for some in files for name, text in some.items()}
    found = read_programs([lay(folder, {**kept, **more})], options=ReadOptions())
    assert not found.unreadable
    (program,) = found.programs
    return program


def verdicts(program: Program, stem: str) -> list[tuple[str, str]]:
    return [(target.verdict, target.reason) for target in program.targets if target.path.stem == stem]


@pytest.mark.parametrize(
    "call",
    [
        "",
        "of_integrator( )",
        "setFixedBaseIfLinked( )",
        "USE_CD_PARAMS(1)",
        "N=LK_OFFS(1,1).X",
        "wear( )",
        "CollMonLib( )",
    ],
)
def test_a_taught_program_is_corrected_whatever_reads_bas(tmp_path: Path, call: str) -> None:
    other = {"KRC/R1/Program/other.src": f"DEF other( )\nDECL REAL N\n{call}\nEND\n"}
    program = read(tmp_path, SYSTEM, PROBE, SPLINES, other)
    assert verdicts(program, "probe") == [("correct", "")] * 2
    assert verdicts(program, "splines") == [("correct", "")] * 2


def test_the_programs_of_the_user_are_corrected_as_with_the_older_system(tmp_path: Path) -> None:
    older = read(tmp_path / "a", small=False)
    submit = {"KRC/R1/System/sps.sub": corpus.backup()["KRC/R1/System/sps.sub"].decode("latin-1")}
    assert read(tmp_path / "b", SYSTEM, submit, small=False).counts() == older.counts()


def test_functions_of_the_system_keep_tool_and_base(tmp_path: Path) -> None:
    calls = ("ERR_CLEAR($ERR)", "MBX_REC(1,N)", 'EKI_GETREAL("cam","r",R)', 'MD_CMD("m","c",N)', "RSI_CREATE(N)")
    body = "\n".join(["DEF plain( )", "INT N", "REAL R", "BAS(#TOOL,1)", "BAS(#BASE,1)", *calls, "LIN XP1", "END", ""])
    files = {"KRC/R1/Program/plain.src": body, "KRC/R1/Program/plain.dat": system.PROBE_DAT.replace("PROBE", "PLAIN")}
    files["KRC/R1/Program/plain.dat"] = "\n".join(
        line for line in files["KRC/R1/Program/plain.dat"].splitlines() if "DECL FDAT" not in line
    )
    assert verdicts(read(tmp_path, SYSTEM, files), "plain")[0] == ("correct", "")


def test_what_writes_to_a_tool_still_counts(tmp_path: Path) -> None:
    writing = ("never_called( )", "STRTOFRAME(S[],TOOL_DATA[1])", 'EKI_GETFRAME("c","p",TOOL_DATA[1])')
    calls = {**dict.fromkeys(writing, "TOOL_DATA[1] is changed by the program"), "other_kind( )": ""}
    for k, (call, reason) in enumerate(calls.items()):
        other = {"KRC/R1/Program/other.src": f"DEF other( )\nDECL CHAR S[80]\n{call}\nEND\n"}
        found = verdicts(read(tmp_path / f"{k}", SYSTEM, PROBE, other), "probe")
        assert {verdict for verdict, _ in found} == {"refuse"}, call
        assert all(reason in why for _, why in found)


def test_a_base_on_a_conveyor_or_a_linked_robot_is_known_at_run_time_only(tmp_path: Path) -> None:
    for function in ("EK", "LK", "EB", "EO"):
        src = f"DEF moving( )\nBAS(#TOOL,1)\n$BASE={function}(MACHINE_DEF[1].ROOT,1,BASE_DATA[1])\nLIN XP1\nEND\n"
        dat = "DEFDAT MOVING\nDECL POS XP1={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}\nENDDAT\n"
        files = {"KRC/R1/Program/moving.src": src, "KRC/R1/Program/moving.dat": dat}
        ((verdict, why),) = verdicts(read(tmp_path / function, SYSTEM, files), "moving")
        assert verdict == "refuse"
        assert "$BASE is known at run time only" in why


def test_a_routine_of_the_user_with_the_name_of_a_function_of_the_system_is_that_routine(tmp_path: Path) -> None:
    own = {"KRC/R1/Program/own.src": "DEF own( )\nEND\nGLOBAL DEF MD_CMD(N:IN)\nINT N\nTOOL_DATA[1].X=N\nEND\n"}
    found = verdicts(read(tmp_path, SYSTEM, PROBE, own), "probe")
    assert {verdict for verdict, _ in found} == {"refuse"}


def test_a_home_that_no_file_defines_is_told_as_such(tmp_path: Path) -> None:
    files = {"KRC/R1/Program/home.src": "DEF home( )\nPTP XHOME99\nPTP XHOME5\nPTP XHOME\nEND\n"}
    program = read(tmp_path, SYSTEM, files)
    reasons = {target.name: target.reason for target in program.targets if target.path.stem == "home"}
    assert reasons == dict.fromkeys(("XHOME99", "XHOME5"), "not defined in the files at hand")
