"""Runs of INFORM positions and of VAL3 values are read, corrected and recorded as line by line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.programs.test_runs import BLANK, GOOD, ODD, facts, pick
from tests.tiers import examples

from truepose.errors import TrueposeError
from truepose.programs import FrameTable, ReadOptions, correct_program, read_program
from truepose.programs.core import forms
from truepose.programs.core.forms import Run

FRAMES = FrameTable(tools={0: np.eye(4), 1: np.eye(4)}, bases={0: np.eye(4), 1: np.eye(4), "fOwn": np.eye(4)})
PROPERTY = settings(max_examples=examples(40), suppress_health_check=[HealthCheck.function_scoped_fixture])


def told(path: Path, make_map: Any, fewest: int, **options: Any) -> list[Any]:
    """Return all targets, and the bytes of the corrected program and its record."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(forms, "FEWEST", fewest)
        try:
            program = read_program(path, FRAMES, ReadOptions(**options))
            found = facts(program)
            corrected = correct_program(program, make_map([0.5, -0.25, 0.125]), on_guard="skip")
        except TrueposeError as error:
            return [str(error)]
        return [*found, corrected.files, corrected.to_csv(), corrected.to_dict()]


def numbers(draw: Any, wild: bool) -> list[str]:
    return [draw(ODD if wild and draw(st.integers(0, 9)) == 0 else GOOD) for _ in range(6)]


@st.composite
def jobs(draw: Any) -> str:
    """Return an INFORM job whose positions and motions are alike, or nearly."""
    wild = draw(st.integers(0, 3)) == 0
    chosen = draw(st.lists(st.integers(0, 20), unique=True, min_size=1, max_size=12))
    chosen = sorted(chosen) if draw(st.booleans()) else chosen
    positions, motions = [], []
    modal = [
        "///POSTYPE BASE",
        "///POSTYPE USER\n///USER 1",
        "///TOOL 0",
        "///POSTYPE PULSE",
        "///RCONF 1,0",
        "BC00001=5",
    ]
    for number in chosen:
        if draw(st.integers(0, 5)) == 0:
            positions.append(draw(st.sampled_from(modal)))
        name = pick(draw, wild, [f"C{number:05d}"] * 20 + [f"C{number:04d}", f"P{number:05d}"], "C00001")
        more = pick(draw, wild, [""] * 20, ",5", "x")
        positions.append(f"{name}={draw(BLANK)}" + ",".join(numbers(draw, wild)) + more)
    ends = ["V=100.0", "V=100.0 PL=1", "V=10 PL=0", "VJ=5.0", "BC00001 V=9.0", "V=1.0 CV#(1) CTP=5.0"]
    others = [
        *("SFTON P003", "SFTOF", "REFP 1 C{:05d}", "GETS PX000 $PX001", "IFTHENEXP I000=0", "ENDIF", "*A", "JUMP *A"),
        *("MOVC C{:05d} V=5.0", "SMOVL C{:05d} V=5.0", "MOVL C{:04d} V=5.0", "SYSTART CV#(1)", "MOVJ EC00001 VJ=1.0"),
        *("CALL JOB:B", "'MOVL C{:05d} V=1.0", "MOVL P00001 V=1.0", "RET IF IN#(1)=ON", "SFTON P003 TF"),
    ]
    for number in draw(st.permutations(chosen)) if draw(st.booleans()) else chosen:
        word, end = draw(st.sampled_from(["MOVL", "MOVL", "MOVL", "MOVJ"])), draw(st.sampled_from(ends[:2] * 4 + ends))
        motions.append(f"{word} C{number:05d} {end}")
        if draw(st.integers(0, 6)) == 0:
            motions.append(draw(st.sampled_from(others)).format(draw(st.sampled_from(chosen))))
    head = ["/JOB", "//NAME A", "//POS", "///NPOS 1,0,0,0,0,0", "///TOOL 1", "///POSTYPE BASE", "///RECTAN"]
    return "\n".join([*head, *positions, "//INST", "///GROUP1 RB1", "NOP", *motions, "END", ""])


@PROPERTY
@given(text=jobs(), options=st.sampled_from([{}, {"external_axes": True}, {"derived": True, "whole_task": True}]))
def test_inform_runs_and_single_lines_agree(
    text: str, options: dict[str, bool], tmp_path_factory: pytest.TempPathFactory, make_map: Any
) -> None:
    path = tmp_path_factory.mktemp("runs") / "a.jbi"
    path.write_bytes(text.encode())
    assert told(path, make_map, 1, **options) == told(path, make_map, 10**9, **options)


def test_an_open_block_is_reported_at_the_last_line_of_a_run(tmp_path: Path, make_map: Any) -> None:
    """A run of motions ends the job: its last line is where the block should have been closed."""
    positions = "".join(f"C{k:05d}={k}.000,0.000,0.000,0.000,0.000,0.000\n" for k in range(40))
    motions = "".join(f"MOVL C{k:05d} V=100.0\n" for k in range(40))
    head = "/JOB\n//NAME A\n//POS\n///NPOS 40,0,0,0,0,0\n///TOOL 1\n///POSTYPE BASE\n///RECTAN\n"
    path = tmp_path / "a.jbi"
    path.write_text(f"{head}{positions}//INST\n///GROUP1 RB1\nNOP\nIFTHENEXP I000=0\n{motions}END\n")
    last = path.read_text().splitlines().index("END")
    assert f"a.jbi:{last}: IF of line {last - 40} is not closed" in str(told(path, make_map, 1))
    assert told(path, make_map, 1) == told(path, make_map, 10**9)


@st.composite
def data_and_code(draw: Any) -> tuple[str, str]:
    """Return VAL3 data whose values are alike, or nearly, and a program, which may be empty."""
    wild = draw(st.integers(0, 3)) == 0
    rows = ["<Database><Datas>"]
    for name in ("pA", "pB"):
        access = draw(st.sampled_from(["private", "private", "public"]))
        kind = draw(st.sampled_from(["pointRx"] * 5 + ["trsf"]))
        rows.append(f'  <Data name="{name}" access="{access}" type="{kind}" size="9">')
        keys = draw(st.lists(st.integers(0, 12), unique=not wild, min_size=1, max_size=9))
        for key in sorted(keys) if draw(st.integers(0, 3)) else keys:
            x, y, z, rx, ry, rz = numbers(draw, wild)
            father = pick(draw, wild, ["world[0]"] * 6 + ["fOwn[0]", "fLost"], "1+2")
            shape = draw(st.sampled_from(['wrist="wpositive" ', "", 'shoulder="lefty" ']))
            turn = f'rx="{rx}" ry="{ry}" rz="{rz}" {shape}fatherId="{father}"'
            row = f'    <Value key="{key}" x="{x}" y="{y}" z="{z}" {turn} />'
            rows.append(pick(draw, wild, [row] * 20, "<!-- -->", f"<!-- {row} -->", row.replace("rz=", "z="), row[:-1]))
        rows.append("  </Data>")
    code = [
        *("movel(pA[nI],flange,m)", "movel(pA[3],flange,m)", "movej(pB,flange,m)"),
        *("movel(appro(pA[nI],{0,0,5,0,0,0}),flange,m)", "x=pA[2].trsf.x", "pA[nI].trsf.z=3"),
        *("movec(pA[1],pA[2],flange,m)", "call f(pA)", "pA[1]=pA[2]"),
    ]  # fmt: skip
    lines = draw(st.lists(st.sampled_from(code[:1] * 4 + code), max_size=4))
    text = "<Programs><Code><![CDATA[\nbegin\n" + "\n".join(lines) + "\nend]]></Code></Programs>" if lines else ""
    return "\n".join([*rows, "</Datas></Database>"]), text


@PROPERTY
@given(
    files=data_and_code(), options=st.sampled_from([{}, {"whole_task": True}, {"derived": True, "whole_task": True}])
)
def test_val3_runs_and_single_lines_agree(
    files: tuple[str, str], options: dict[str, bool], tmp_path_factory: pytest.TempPathFactory, make_map: Any
) -> None:
    path = tmp_path_factory.mktemp("runs") / "a.dtx"
    path.write_bytes(files[0].encode())
    if files[1]:
        path.with_suffix(".pgx").write_bytes(files[1].encode())
    assert told(path, make_map, 1, **options) == told(path, make_map, 10**9, **options)


@pytest.mark.parametrize("goal", ["appro(pA[nI],{0,0,5,0,0,0})", "pA[nI]"])
def test_a_shift_of_any_element_is_known_to_all(tmp_path: Path, make_map: Any, goal: str) -> None:
    """A motion near an element of which only the run time knows the number derives a position from each of them."""
    turn = 'rx="0.000" ry="0.000" rz="0.000" wrist="wpositive" fatherId="world[0]"'
    values = "".join(f'    <Value key="{k}" x="{k}.000" y="0.000" z="0.000" {turn} />\n' for k in range(20))
    path, code = tmp_path / "a.dtx", f"begin\nmovel({goal},flange,m)\nend"
    head = '<Database><Datas>\n  <Data name="pA" access="private" type="pointRx" size="20">\n'
    path.write_text(f"{head}{values}  </Data>\n</Datas></Database>")
    path.with_suffix(".pgx").write_text(f"<Programs><Code><![CDATA[\n{code}\n]]></Code></Programs>")
    options = {"derived": True, "whole_task": True}
    targets = [one for one in read_program(path, FRAMES, ReadOptions(**options)).targets if one.name.startswith("pA")]
    assert len(targets) >= 20
    assert all(bool(one.derived) == goal.startswith("appro") for one in targets[:20])
    assert told(path, make_map, 1, **options) == told(path, make_map, 10**9, **options)


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.exhaustive
def test_long_programs_are_read_in_runs(tmp_path: Path, make_map: Any, ending: str) -> None:
    rows = np.random.default_rng(1).uniform(-180, 180, (2_500, 3))
    head = "/JOB\n//NAME A\n//POS\n///TOOL 1\n///POSTYPE BASE\n///RECTAN\n"
    positions = "".join(f"C{k:05d}={x:.3f},{y:.3f},{z:.3f},180.0,0.0,-90.0\n" for k, (x, y, z) in enumerate(rows))
    motions = "".join(f"MOVL C{k:05d} V={k % 7}.0 PL=1\n" for k in range(2_500))
    job = tmp_path / "a.jbi"
    job.write_bytes(f"{head}{positions}//INST\nNOP\n{motions}END\n".replace("\n", ending).encode())
    values = "".join(
        f'<Value key="{k}" x="{x:.3f}" y="{y:.3f}" z="{z:.3f}" rx="180" ry="0" rz="5.5" fatherId="world[0]" />\n'
        for k, (x, y, z) in enumerate(rows)
    )
    data = tmp_path / "v" / "a.dtx"
    data.parent.mkdir()
    opening = '<Database><Datas>\n<Data name="pA" access="private" type="pointRx" size="2500">\n'
    text = f"{opening}{values}</Data>\n</Datas></Database>"
    data.write_bytes(text.replace("\n", ending).encode())
    code = "begin\nmovej(pA[1200],flange,m)\nmovel(pA[nI],flange,m)\nend"
    (data.parent / "start.pgx").write_text(f"<Code><![CDATA[\n{code}]]></Code>")
    for path, lengths in ((job, [2048, 452]), (data, [1, 1199, 1, 847, 452])):
        pieces = [piece for piece, _ in read_program(path, FRAMES).targets._pieces]
        assert [len(piece) for piece in pieces] == lengths
        assert [isinstance(piece, Run) for piece in pieces] == [length > 1 for length in lengths]
        assert told(path, make_map, 16) == told(path, make_map, 10**9)
