"""What VAL3 programs hand to each other: tools and frames that a call may change, variables that others move to."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.programs.backups.small import lay

from truepose.programs import ReadOptions, read_programs
from truepose.programs.core.target import Target

XML = '<?xml version="1.0" encoding="utf-8" ?>\n'
ARM = 'shoulder="lefty" elbow="epositive" wrist="wpositive" fatherId="fA[0]"'
MOVE = "movel(pA,tA,mN)\nmovel(pB,tA,mN)"


def datum(kind: str, name: str, *values: str) -> str:
    rows = "".join(f'<Value key="{k}" {value} />\n' for k, value in enumerate(values))
    return f'<Data name="{name}" access="public" type="{kind}" size="{len(values)}">\n{rows}</Data>\n'


def place(x: float, z: float, more: str) -> str:
    return f'x="{x}" y="10" z="{z}" rx="0" ry="0" rz="0" {more}'


DATA = (
    datum("frame", "fA", *(place(x, 0, 'fatherId="world[0]"') for x in (500, 600)))
    + datum("tool", "tA", *(place(0, z, 'fatherId="flange[0]"') for z in (100, 150)))
    + datum("tool", "tB", place(0, 200, 'fatherId="flange[0]"'))
    + datum("pointRx", "pA", place(100, 300, ARM))
    + datum("pointRx", "pB", place(150, 300, ARM))
    + datum("pointRx", "pT", place(0, 300, ARM), place(1, 300, ARM))
)


def program(name: str, code: str, parameters: str = "") -> str:
    body = f"<Code><![CDATA[begin\n{code}\nend]]></Code>"
    return f'{XML}<Programs>\n<Program name="{name}">\n{parameters}{body}</Program></Programs>'


def targets(folder: Path, code: str, **others: str) -> dict[str, Target]:
    """Return the targets of an application by their names; `others` are the texts of its other programs."""
    programs = {"start": program("start", code), **others}
    listed = "".join(f'<Program file="{name}.pgx" />\n' for name in programs)
    project = f'{XML}<Project>\n<Programs>{listed}</Programs><Database><Data file="a.dtx" /></Database></Project>\n'
    files = {f"usr/usrapp/a/{name}.pgx": text for name, text in programs.items()}
    files["usr/usrapp/a/a.pjx"] = project
    files["usr/usrapp/a/a.dtx"] = f"{XML}<Database><Datas>\n{DATA}</Datas></Database>\n"
    root = lay(folder, {name: text.encode() for name, text in files.items()})
    (found,) = read_programs([root], None, ReadOptions(derived=True)).programs
    return {target.name: target for target in found.targets}


PARAMETER = '<Parameters><Parameter name="tX" type="tool" {0} /></Parameters>'
SETS = "tX.trsf.z=50"


@pytest.mark.parametrize(
    ("code", "other"),
    [
        ("call set(tA)", program("set", SETS, PARAMETER.format('use="reference"'))),
        ("call set(tA)", program("set", SETS, PARAMETER.format(""))),
        ("call set(tA)", program("set", "call again(tX)", PARAMETER.format('use="reference"'))),
        ("call set(1,tA)", program("set", "x=1", PARAMETER.format('use="value"'))),
        ("call gone(tA)", program("set", SETS)),
        ("call lib:set(tA)", program("set", "x=1", PARAMETER.format('use="value"'))),
        ('taskCreate "t",10,set(tA)', program("set", SETS, PARAMETER.format('use="reference"'))),
        ("call set(fA)", program("set", SETS, PARAMETER.format('use="reference"'))),
        ("link(tA,flange)", ""),
        ("link(fA,world)", ""),
        ("tA[nI].trsf.z=5", ""),
    ],
)
def test_a_tool_or_frame_that_a_call_may_change_is_not_the_stored_one(tmp_path: Path, code: str, other: str) -> None:
    found = targets(tmp_path, f"{MOVE}\n{code}", set=other or program("set", ""))["pA"]
    assert found.verdict == "refuse"
    assert "A is changed by the program (a/start.pgx, line " in found.reason


@pytest.mark.parametrize(
    ("code", "parameters"),
    [(SETS, 'use="value"'), ("movel(pB,tX,mN)", 'use="reference"'), ("x=1", "")],
)
def test_a_call_that_leaves_its_argument_is_no_hindrance(tmp_path: Path, code: str, parameters: str) -> None:
    other = program("set", code.replace("pB", "pT"), PARAMETER.format(parameters))
    found = targets(tmp_path, f"{MOVE}\ncall set(tA)\ncall set(tB)\ncall set(tA[1])", set=other)
    assert found["pA"].verdict == "correct"


def test_an_element_that_the_run_time_knows_may_be_any(tmp_path: Path) -> None:
    found = targets(tmp_path, "movel(pA,tA[1],mN)\nmovel(pB,tB,mN)\ntA[nI].trsf.z=5")
    assert "tA[1] is changed by the program" in found["pA"].reason
    assert found["pB"].verdict == "correct"


@pytest.mark.parametrize("goal", ["pT", "appro(pT,{0,0,-500,0,0,0})"])
def test_a_variable_to_which_another_program_moves_spoils_its_point(tmp_path: Path, goal: str) -> None:
    found = targets(tmp_path, f"{MOVE}\npT=pA\ncall go()", go=program("go", f"movel({goal},tB,mN)"))
    assert (found["pA"].verdict, found["pB"].verdict) == ("refuse", "correct")
    assert "read by arithmetic" in found["pA"].reason


def test_an_array_without_an_index_is_its_first_element(tmp_path: Path) -> None:
    code = "pT[0]=appro(pA,{0,0,-50,0,0,0})\npT=appro(pB,{0,0,-90,0,0,0})\nmovel(pT[0],tA,mN)"
    found = targets(tmp_path, f"{MOVE}\n{code}")
    assert not found["pA"].derived
    assert found["pB"].derived[0].shifts == ((0.0, 0.0, -90.0),)


def test_an_element_that_the_run_time_knows_may_be_one_that_was_set(tmp_path: Path) -> None:
    code = "pT[0]=appro(pA,{0,0,-50,0,0,0})\npT[nI]=appro(pB,{0,0,-90,0,0,0})\nmovel(pT[0],tA,mN)"
    found = targets(tmp_path, f"{MOVE}\n{code}")
    assert [found[name].verdict for name in ("pA", "pB")] == ["refuse", "refuse"]
