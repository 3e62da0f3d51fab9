"""Every reader with every hostile file: one typed error on one line, in bounded time and memory."""

from __future__ import annotations

import contextlib
import json
import os
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.tiers import examples

import truepose as tp
from truepose.cell import load_cell
from truepose.errors import FileError, TrueposeError
from truepose.programs import read_program
from truepose.programs.krl.controller import read_config_dat
from truepose.report.records import read_record
from truepose.robots import load_robot
from truepose.samples import Samples, append_columns, read_poses, read_samples, write_samples
from truepose.trackers import read_plan, read_readings
from truepose.trackers.columns import Columns

READERS: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "map": (".truepose", tp.load_map),
    "cell": (".toml", load_cell),
    "robot": (".toml", load_robot),
    "urdf": (".urdf", load_robot),
    "samples": (".csv", read_samples),
    "poses": (".csv", read_poses),
    "readings": (".txt", read_readings),
    "told readings": (".txt", lambda path: read_readings(path, Columns(x=1, y=2, z=3))),
    "columns": (".toml", Columns.load),
    "plan": (".csv", read_plan),
    "record": (".json", read_record),
    **{
        ending: (ending, read_program)
        for ending in (".src", ".mod", ".ls", ".script", ".jbi", ".dtx", ".csv", ".apt", ".nc")
    },
}
BYTES = {
    "empty": b"",
    "zero bytes": bytes(3000),
    "random": random.Random(3).randbytes(5000),
    "UTF-16 without mark": "q1_deg,x_meas_mm\n1,2\n".encode("utf-16-le"),
    "brackets": b"[" * 10**6,
    "braces": b"{" * 10**6,
    "parentheses": b"(" * 10**5,
    "quotes": b'"' * 10**6,
    "one long line": b"x" * 10**7,
    "one long number": b"1" * 10**6,
    "commas": b"," * 200_000 + b"\n" + b"," * 200_000,
    "dots": b"a." * 300_000 + b"a = 1",
    "a long number with a letter": b"1" * 10**6 + b"x = 1",
    "lines of long numbers with a letter": (b"1" * 19_000 + b"x\n") * 50,
    "fields of long numbers with a letter": b"P;1;2;" + b"1" * 19_000 + b"x\n" + b"P,1,2," + b"1" * 19_000 + b"x\n",
    "lines of letters": (b"x" * 19_000 + b"\n") * 50,
    "lines of blanks": (b"Pos" + b" " * 19_000 + b"b\n" + b"x [" + b" " * 19_000 + b"\n") * 20,
    "a header of a long number": b"j" + b"1" * 5000 + b";x\n1;2\n",
    "signs without an end": b"-\n" * 40_000,
    "separators of records": b"\x1c\x1d\x1e\x85\n" * 9,
    "entities": b'<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><robot name="&b;"/>',
    "elements": b"<a>" * 10**5,
}


def one_error(read: Callable[[Path], Any], path: Path) -> str:
    with pytest.raises(TrueposeError) as caught:
        read(path)
    told = str(caught.value)
    assert told.isprintable()
    assert len(told) < 8000
    return told


@pytest.mark.promise("Every reader answers every broken or hostile file with one typed error on one line")
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.sampled(2)
def test_content(reader, tmp_path, record_property):
    ending, read = READERS[reader]
    told: list[str] = []
    for k, data in enumerate(BYTES.values()):
        path = tmp_path / f"f{k}{ending}"
        path.write_bytes(data)
        try:
            read(path)
        except TrueposeError as error:
            told.append(str(error))
        else:  # a G-code or APT file of letters or brackets that moves to no point may be read
            assert ending in (".src", ".nc", ".apt", ".script", ".csv", ".dtx"), data[:20]
    assert told
    assert all(map(str.isprintable, told))
    record_property("cases", len(BYTES))


@pytest.mark.promise("A path that is no regular file, or too large, is refused before it is opened, so no reader waits")
@pytest.mark.parametrize("reader", READERS)
def test_places(reader, tmp_path, record_property):
    ending, read = READERS[reader]
    pipe, sparse, folder = (tmp_path / f"{name}{ending}" for name in ("pipe", "sparse", "folder"))
    os.mkfifo(pipe)
    folder.mkdir()
    with sparse.open("wb") as file:
        file.truncate(2**40)
    here, round_, away = (tmp_path / f"{name}{ending}" for name in ("here", "round", "away"))
    here.symlink_to(round_)
    round_.symlink_to(here)
    away.symlink_to(tmp_path / "absent")
    assert "pipe" in one_error(read, pipe)
    assert "at most" in one_error(read, sparse)
    for path in (
        folder,
        here,
        away,
        tmp_path / f"absent{ending}",
        Path(f"a\0b{ending}"),
        tmp_path / f"{'x' * 300}{ending}",
    ):
        one_error(read, path)
    record_property("cases", 8)


NOT_NUMBERS = ["1_000", "٣", "１２", "²", "1e", "0x10", "1,2,3", "--1", "∞", "1 2", "½"]


@pytest.mark.promise("1_000 and digits of other scripts are no numbers in tables, readings, cells, robots and programs")
def test_numbers_that_are_none(tmp_path, record_property):
    for text in NOT_NUMBERS:
        files = {
            "a.csv": ("q1_deg;x_meas_mm;y_meas_mm;z_meas_mm\n{};1;2;3\n0;2;3;4\n", read_samples),
            "b.txt": ("P1;{};2;3\nP2;1;2;3\n", lambda path: read_readings(path, Columns(x=2, y=3, z=4))),
            "c.toml": ('[robot]\nmodel = "ur10"\n[tool]\nx_mm = {}\n', load_cell),
            "e.src": (
                "DEF e()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {{X {},Y 2,Z 3,A 0,B 0,C 0}}\nEND\n",
                read_program,
            ),
            "f.csv": ("x_mm;y_mm;z_mm;a_deg;b_deg;c_deg\n{};2;3;0;0;0\n", read_program),
        }
        for name, (form, read) in files.items():
            if (text, name) in {("1,2,3", "c.toml"), ("0x10", "c.toml"), ("1,2,3", "e.src")}:
                continue
            path = tmp_path / name
            path.write_text(form.format(text), encoding="utf-8")
            try:
                found = read(path)
            except TrueposeError:
                continue
            assert name == "e.src"  # what is no number is an expression: the point is not corrected
            assert found.counts()["correct"] == 0, (text, name)
    record_property("cases", 5 * len(NOT_NUMBERS))


@pytest.mark.promise("Numbers beyond any cell, and nested or endless TOML, are refused in a cell file with their line")
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("x_mm = 1e300", "less than or equal to"),
        ("x_mm = -1e300", "greater than or equal to"),
        (f"x_mm = 1{'0' * 35}", "less than or equal to"),
        (f"x_mm = {'9' * 5000}", "expected at most 40"),
        ("x_mm = inf", "finite"),
        ("x_mm = nan", "finite"),
        ("x_mm = 1_000", "without underscores"),
        ("x_mm = [" + "[" * 100000, "nested"),
        ("a" + ".a" * 100000 + " = 1", "nested"),
        ("x_mm = " + "{a = " * 100000, "nested"),
    ],
)
def test_cell_files(tmp_path, line, message):
    path = tmp_path / "cell.toml"
    path.write_text(f'[robot]\nmodel = "ur10"\n[tool]\n{line}\n')
    told = one_error(load_cell, path)
    assert "cell.toml:4: " in told
    assert message in told


def test_tiny_numbers_are_no_standard_deviations(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text('[robot]\nmodel = "ur10"\n[tracker]\nstd_mm = 1e-300\n')
    assert "greater than or equal to 0.000001" in one_error(load_cell, path)


@pytest.mark.promise("Wide tables and long fields are refused, with the line, before they fill the memory")
def test_wide_tables_and_long_fields(tmp_path):
    wide, long = tmp_path / "wide.csv", tmp_path / "long.csv"
    wide.write_text(",".join(f"c{k}" for k in range(1000)) + "\n" + ",".join("1" * 1000) + "\n")
    assert "wide.csv:2: has 1000 columns" in one_error(read_samples, wide)
    long.write_text(f"q1_deg,comment\n0,{'x' * 50_000_000}\n")
    assert "long.csv:2: has 50000002 characters" in one_error(read_samples, long)
    long.write_text("q1_deg,x_meas_mm,y_meas_mm,z_meas_mm\n1e300,1,2,3\n")
    assert "beyond 1e+12" in one_error(read_samples, long)


@pytest.mark.promise("CSV cells that a spreadsheet would take for a formula are escaped, and read back as they were")
def test_formulas(tmp_path):
    names = ["=1+2", "+x", "-5", "@a", "'=b", "''=c", "plain", "a=b"]
    n = len(names)
    p = np.arange(3.0 * n).reshape(n, 3) * 100
    path, out = tmp_path / "s.csv", tmp_path / "out.csv"
    write_samples(path, Samples(p + 1, q=np.zeros((n, 6)) + np.arange(n)[:, None] * 0.1, name=np.array(names)))
    assert not any(cell[:1] in "=+@" for line in path.read_text().splitlines() for cell in line.split(","))
    assert read_samples(path).name.tolist() == names
    path.write_text(path.read_text().replace("'=1+2", "=1+2").replace("'-5", "-5x"))
    append_columns(path, out, {"std_mm": np.zeros(n)})
    cells = [line.split(",")[1] for line in out.read_text().splitlines()[1:]]
    assert cells == ["'=1+2", "'+x", "'-5x", "'@a", "''=b", "'''=c", "plain", "a=b"]


def test_names_that_are_not_utf8(tmp_path, run):
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9\n[x].csv"))
    told = one_error(read_samples, path)
    assert r"caf\xe9 [x].csv" in told
    path.write_text("q1_deg\n")
    assert run("predict", "absent", path).failed()


@pytest.mark.exhaustive
@pytest.mark.promise("Names of files that are not UTF-8 pass through messages and JSON output without an error")
def test_names_in_json(tmp_path):
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9[b].src"))
    path.write_text("DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n")
    for options in (["--json"], []):
        done = subprocess.run(
            [sys.executable, "-c", "from truepose.cli import main; main()", "check", path, *options],
            capture_output=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        if options:
            assert json.loads(done.stdout)["programs"][0]["file"] == str(path)
        else:
            assert rb"caf\udce9[b].src" in done.stdout


@pytest.mark.promise("Options take plain finite numbers only")
@pytest.mark.parametrize(
    "arguments",
    [
        ("demo", "x", "--seed", "1_0"),
        ("demo", "x", "--seed=٣"),
        ("demo", "x", "--seed", "-1"),
        ("study", "x", "--seeds", "²"),
        ("iso9283", "x", "--edge", "nan"),
        ("iso9283", "x", "--edge", "inf"),
        ("similarity", "x", "y", "--max-lag", "1_0"),
        ("fit", "x", "y", "--workers", "-1"),
    ],
)
def test_options(run, arguments):
    done = run(*arguments)
    assert done.code == 2
    assert "Traceback" not in done.err


@pytest.mark.promise("Errors that no command expects end in one line, too")
@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "not enough memory"),
        (RecursionError("maximum recursion depth"), "nested too deeply"),
        (OSError(28, "No space left on device"), "the output: cannot be read or written: No space left on device"),
        (OSError(13, "Permission denied", "a\nb"), "a b: cannot be read or written: Permission denied"),
        (RuntimeError("two\nlines"), "internal error (RuntimeError: two lines)"),
        (KeyboardInterrupt(), "interrupted"),
    ],
)
def test_unexpected_errors(run, monkeypatch, error, message):
    def fail(*_args: object, **_options: object) -> None:
        raise error

    monkeypatch.setattr("truepose.robots.list_robots", fail)
    monkeypatch.setattr("truepose.robots.io.library.list_robots", fail)
    done = run("robots")
    assert done.code in (1, 130)
    assert done.err.count("\n") == 1
    assert message in done.err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.promise("A full disk behind the output ends in one line without a traceback")
def test_full_output():
    code = "from truepose.cli import main; main()"
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run([sys.executable, "-c", code, "robots"], stdout=full, stderr=subprocess.PIPE, check=False)
    assert done.returncode == 1
    assert done.stderr.count(b"\n") == 1
    assert b"No space left" in done.stderr


GOOD = {
    "samples": "name,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_meas_mm,y_meas_mm,z_meas_mm\n"
    + "".join(f"P{k},{k},{2 * k},3,4,5,6,{100 + 10 * k}.5,{20 * k},{30 * k}\n" for k in range(6)),
    "cell": '[robot]\nmodel = "ur10"\n[tool]\nx_mm = 1.5\nfit = "position"\n[frames.tools.1]\nz_mm = 20.0\n',
    "urdf": '<robot name="a"><link name="b"/><link name="c"/><joint name="j" type="revolute"><parent link="b"/>'
    '<child link="c"/><axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint></robot>',
    "readings": "".join(f"P{k};{100 + 10 * k}.5;{20 * k};{30 * k};;\n" for k in range(6)),
}


@pytest.mark.promise("Random mutations of good tables, cells, robots and readings give a result or one typed error")
@settings(max_examples=examples(250), derandomize=True, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_mutated_text(tmp_path_factory, data):
    reader = data.draw(st.sampled_from(sorted(GOOD)))
    broken = bytearray(GOOD[reader].encode())
    for _ in range(data.draw(st.integers(1, 4))):
        at, size = data.draw(st.integers(0, len(broken))), data.draw(st.integers(1, 30))
        kind = data.draw(st.sampled_from(["flip", "cut", "double", "drop", "insert"]))
        if kind == "flip" and at < len(broken):
            broken[at] ^= 1 << data.draw(st.integers(0, 7))
        elif kind == "cut":
            del broken[at:]
        elif kind == "double":
            broken[at:at] = broken[at : at + size]
        elif kind == "drop":
            del broken[at : at + size]
        else:
            broken[at:at] = data.draw(
                st.sampled_from([b"1e300", b"_0", b"[", b'"', b"\0", b"nan", b"\xff", b"'", b";"])
            )
    ending, read = READERS[reader]
    path = tmp_path_factory.getbasetemp() / f"mutated{ending}"
    path.write_bytes(bytes(broken))
    with contextlib.suppress(TrueposeError):  # any other error fails the test
        read(path)


def test_errors_are_one_line():
    assert str(FileError("a\nb", "x\x1b[31m\udcff")) == r"a b: x\x1b[31m\xff"
    assert len(str(TrueposeError("x" * 10**7))) < 5000


@pytest.mark.skipif(not hasattr(os, "pipe"), reason="needs pipes")
@pytest.mark.promise(
    "A reader of the output that goes away ends a command silently, with the exit code of a broken pipe"
)
@pytest.mark.parametrize("arguments", [["robots"], ["robots", "--json"], ["--help"], ["--version"]])
@pytest.mark.sampled(1)
def test_broken_pipe(arguments):
    read, write = os.pipe()
    os.close(read)
    code = "from truepose.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code, *arguments], stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.promise("1_000 and digits of other scripts are no numbers in files about controllers, robots and times")
def test_numbers_of_other_files_that_are_none(tmp_path, run, record_property):
    src = "DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n"
    rt = "[[600,0,800],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    mod = f"MODULE a\nPROC main()\nMoveL {rt},v1,fine,tool0;\nENDPROC\nENDMODULE\n"
    joint = '<joint name="j" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>'
    forms: dict[str, tuple[str, Callable[[Path], Any]]] = {
        "$config.dat": ("DEFDAT $CONFIG\nTOOL_DATA[1]={{X {},Y 2,Z 3,A 0,B 0,C 0}}\nENDDAT\n", read_config_dat),
        "$machine.dat": ("$ROBROOT={{X {},Y 2,Z 3,A 0,B 0,C 0}}\n", lambda path: read_program(path.with_name("a.src"))),
        "MOC.cfg": (
            'ROBOT:\n\n  -name "R" -base_frame_pos_x {}\n',
            lambda path: read_program(path.with_name("a.mod")),
        ),
        "r.urdf": (
            f'<robot name="r"><link name="b"/><link name="c"/>{joint}<limit lower="{{}}" upper="9"/></joint></robot>',
            load_robot,
        ),
        "index.mod": (mod.replace("MoveL", "MoveL p{{{}}},v1,fine,tool0;\nMoveL"), read_program),
        "t.txt": ("P1;1;2;3;{}\nP2;1;2;30;5\n", lambda path: read_readings(path, Columns(x=2, y=3, z=4, time=5))),
    }
    for k, (name, (form, read)) in enumerate(forms.items()):
        for text in ("1_000", "٣", "１２", "²", "1_0"):
            folder = tmp_path / f"{k}{ord(text[1:2] or text):x}{len(text)}"
            folder.mkdir(exist_ok=True)
            (folder / "a.src").write_text(src)
            (folder / "a.mod").write_text(mod)
            path = folder / name
            path.write_text(form.format("1"), encoding="utf-8")
            read(path)  # a number
            path.write_text(form.format(text), encoding="latin-1" if text == "²" else "utf-8")
            if name == "index.mod":
                assert read(path).targets[0].verdict != "correct"
            elif name == "$config.dat":  # an expression: the tool is not known
                with contextlib.suppress(TrueposeError):
                    assert read(path)[0] == {}
            else:
                one_error(read, path)
    for text in ("1_000", "٣", "²", "0,1_0,20"):
        assert run("similarity", "x", "y", "--bins", text).code in (1, 2)
    record_property("cases", 5 * len(forms) + 4)
