"""A backup of FANUC: its frames and programs are found, and every corrected digit is computed anew."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.programs.backups import fanuc as corpus
from tests.programs.backups.compare import Gradient, listing, transform, zero_changes_no_byte

from truepose.programs import FrameTable, Program, ReadOptions, correct_program, read_programs
from truepose.programs.backups import fanuc
from truepose.programs.core.program import MotionGroups
from truepose.programs.tp.reader import read

POSITION = re.compile(r"(?s)P\[(\d+)[^\]]*\]\{(.*?)\};")
GROUP1 = re.compile(r"(?s)GP1:\s*UF : (\w+), UT : (\w+),(.*?)(?=GP2:|$)")
NUMBER = {key: re.compile(rf"(?<!\w){key}\s*=\s*(-?[\d.]+)") for key in "XYZWPR"}


@pytest.fixture(scope="module")
def backup(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return corpus.write_backup(tmp_path_factory.mktemp("fanuc") / "all")


def programs(root: Path, groups: MotionGroups | None = None, **options: Any) -> dict[str, Program]:
    """All programs of a controller, as the reading of backups asks for them."""
    own, stored = listing(root), fanuc.stored_frames(root, listing(root))
    tables = [{key: frame.tf for key, frame in table.items()} for table in (stored.tools, stored.bases)]
    frames = FrameTable(*tables, groups=groups or MotionGroups(1, frozenset([2])))
    more = fanuc.for_reader(root, own)
    readers = {
        file.stem: partial(read, file, frames, ReadOptions(**options), **more)
        for (file,) in fanuc.contents(root, own).programs
    }
    return {name: replace(again(), again=again, language="tp") for name, again in readers.items()}


class Pose(NamedTuple):
    """A position of group 1 as plain regular expressions read it."""

    number: int
    uf: str
    xyz: tuple[float, ...]
    wpr: tuple[float, ...]


def poses(text: str) -> Iterator[Pose]:
    for m in POSITION.finditer(text):
        group = GROUP1.search(m[2])
        found = [NUMBER[key].search(group[3]) for key in "XYZWPR"] if group else []
        if group and all(found):
            values = tuple(float(one[1]) for one in found if one)
            yield Pose(int(m[1]), group[1], values[:3], values[3:])


def rotation(wpr: tuple[float, ...]) -> np.ndarray:
    return transform((0.0, 0.0, 0.0, *reversed(wpr)), "zyx")[:3, :3]


def user_frames(root: Path) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """The user frames of group 1, read without the library."""
    text = (root / "SYSFRAME.VA").read_text("latin-1").split("$MNUFRAME  ")[1].split("$MNUTOOL")[0]
    found = {}
    for m in re.finditer(r"\[1,(\d+)\] = \n.*\n(.*)\n(.*)\n", text.replace("\r\n", "\n")):
        values = [float(v) for v in re.findall(r"-?\d+\.\d+", m[2] + m[3])]
        found[int(m[1])] = (rotation(tuple(values[3:])), np.array(values[:3]))
    return found


def test_the_controller_is_recognised(backup: Path) -> None:
    own = listing(backup)
    assert fanuc.roots(own) == [backup]
    found = fanuc.contents(backup, own)
    assert len(found.programs) == len(corpus.PROGRAMS) >= 30
    assert (found.robot, found.version) == ("M-10iA/12, POSITIONER", "V8.30P/21")
    assert {file.name for file, kind in found.others.items() if kind == "log"} == {"ERRALL.LS", "LOGBOOK.LS"}
    (warning,) = found.warnings
    assert warning.endswith(
        "-BCKED1-; save them in text form (.LS), which the controller does with the option ASCII upload"
    )
    assert {file.suffix for file in found.others} >= {".TP", ".SV", ".VR", ".PC", ".VA", ".DG", ".DT"}


def test_frames_are_those_of_sysframe_with_the_names_of_framevar(backup: Path) -> None:
    stored = fanuc.stored_frames(backup, listing(backup))
    for number, (turn, origin) in user_frames(backup).items():
        frame = stored.bases[number]
        np.testing.assert_allclose(frame.tf[:3, :3], turn, atol=1e-12)
        np.testing.assert_allclose(frame.tf[:3, 3], origin)
        assert frame.name == corpus.FRAMES.get(number, ("",))[0]
    assert stored.tools[2].name == "Torch"
    np.testing.assert_allclose(stored.tools[2].tf[:3, 3], [0.0, -35.2, 312.75])
    assert stored.bases[1].place == "SYSFRAME.VA, line 6"
    assert {"gp2-1", "gp2-9"} <= stored.bases.keys()


@pytest.mark.exhaustive
@pytest.mark.promise("FANUC: a zero correction leaves every program of a backup as it was, byte for byte")
def test_a_zero_correction_changes_no_byte(backup: Path, record_property: Callable[..., None]) -> None:
    cases = zero_changes_no_byte(programs(backup).values())
    assert cases >= 25
    record_property("cases", cases)


def expected(value: float, change: float) -> str:
    """The number that the controller writes after a change; it keeps three decimals."""
    return corpus.number(float(f"{value + change:.3f}") + 0.0)


def test_corrected_digits_agree_with_a_computation_of_their_own(backup: Path) -> None:
    frames, checked = user_frames(backup), 0
    for name, program in programs(backup).items():
        corrected = {t.name for t in program.targets if t.verdict == "correct"}
        if not corrected:
            continue
        result = correct_program(program, Gradient(), on_guard="skip").files  # type: ignore[arg-type]
        before = program.path.read_bytes().decode("latin-1")
        after = result[program.path].decode("latin-1")
        assert re.sub(r"[-\d. ]{10}  mm", "", after) == re.sub(r"[-\d. ]{10}  mm", "", before)
        assert len(after) == len(before)
        for old, new in zip(poses(before), poses(after), strict=True):
            assert (old.wpr, old.uf) == (new.wpr, new.uf)
            if f"P[{old.number}]" not in corrected:
                assert old == new
                continue
            turn, origin = frames[int(old.uf) if old.uf != "F" else 1]
            p_base = turn @ np.array(old.xyz) + origin
            change = turn.T @ Gradient().shift(p_base)
            for before_mm, mm, after_mm in zip(old.xyz, change, new.xyz, strict=True):
                steps = (before_mm + mm) * 1000.0
                if abs(steps - np.floor(steps) - 0.5) > 1e-6:  # not between two digits
                    assert corpus.number(after_mm) == expected(before_mm, mm), (name, old.number)
            checked += 1
    assert checked > 1500


@pytest.mark.exhaustive
@pytest.mark.promise("FANUC: 85 % of the motions of a backup to Cartesian targets are corrected, or follow such")
def test_the_share_that_is_corrected(backup: Path, record_property: Callable[..., None]) -> None:
    shares, reasons = {}, set()
    for derived in (False, True):
        corrected = total = 0
        for program in programs(backup, derived=derived).values():
            for i, target in enumerate(program.targets):
                if not target.motions or target.reason.startswith("joint target"):
                    continue
                follow = program.targets.follows.get(i)
                owners = [program.targets[j] for j in follow.sources] if follow else [target]
                total += 1
                corrected += all(owner.verdict == "correct" for owner in owners)
                if derived and any(owner.verdict != "correct" for owner in owners):
                    reasons.add(target.reason.split(" (line")[0])
        shares[derived] = corrected / total
    record_property("cases", total)
    assert 0.85 < shares[False] < shares[True]
    assert reasons == {
        "Search: the motion ends at what it touches",
        "Touch Offset PR[30:Found]",
        "VOFFSET: shifted by what a camera sees",
        "external axis E1 in group 1 has no model; allow external_axes if it does not move it",
        "position register, which LAYERS may write: known at run time only",
        "position register: its value stands in POSREG.VA, which is not written; teach a position instead",
        "remote TCP: tool and frame change roles",
    }


def test_without_a_statement_about_the_positioner_coordinated_programs_are_refused(backup: Path) -> None:
    found = programs(backup, MotionGroups())
    assert {target.verdict for target in found["RING01"].targets} == {"refuse"}
    assert found["WELD01"].counts()["refuse"] == 0


@pytest.mark.exhaustive
def test_a_zip_with_the_texts_in_a_zip_of_its_own(backup: Path, tmp_path: Path) -> None:
    inner, outer = tmp_path / "ENGLISH.ZIP", tmp_path / "all.zip"
    with zipfile.ZipFile(inner, "w") as texts, zipfile.ZipFile(outer, "w") as whole:
        for file in listing(backup):
            (texts if file.stem in corpus.PROGRAMS and file.suffix == ".LS" else whole).write(file, file.name)
    with zipfile.ZipFile(outer, "a") as whole:
        whole.write(inner, inner.name)
    frames, options = FrameTable(groups=MotionGroups(1, frozenset([2]))), ReadOptions(derived=True)
    found = [read_programs([path], frames, options) for path in (backup, outer)]
    counts = [{one.path.name: one.counts() for one in reading.programs} for reading in found]
    assert counts[0] == counts[1]
    assert not found[0].unreadable
    assert not found[1].unreadable
    assert len(counts[0]) == len(corpus.PROGRAMS)


REGISTER = re.compile(r"PR\[(\d+)(?:,(\d))?\]=(?:(P)\[(\d)|PR\[\d+,\d\]([+-])(?:R\[(\d+)\]|([\d.]+)))")


def positions_of_a_pallet(lines: list[str]) -> set[tuple[float, float, float]]:
    """Run the loops of a pallet as the controller does; return the shifts of its motions from its first position."""
    body, found = lines[lines.index("FOR R[12:col]=0 TO 2") + 1 : lines.index("ENDFOR")], set()
    for row in range(4):
        for column in range(3):
            shift, numbers = [0.0, 0.0, 0.0], {11: float(row), 12: float(column)}
            for code in body:
                if m := re.match(r"R\[(\d+)\]=R\[(\d+)\]\*([\d.]+)", code):
                    numbers[int(m[1])] = numbers[int(m[2])] * float(m[3])
                elif (m := REGISTER.match(code)) and m[2]:
                    by = numbers[int(m[6])] if m[6] else float(m[7])
                    shift[int(m[2]) - 1] += by if m[5] == "+" else -by
                elif code.startswith("L PR["):
                    found.add((shift[0], shift[1], shift[2]))
    return found


def test_pallets_are_followed_as_the_controller_runs_them(backup: Path) -> None:
    program = programs(backup, derived=True)["PAL01"]
    text = program.path.read_text("latin-1").split("/MN")[1].split("/POS")[0]
    lines = [re.sub(r"^ *\d+:|;$", "", line.strip()).strip() for line in text.splitlines()]
    (first,) = [target for target in program.targets if target.name == "P[1]"]
    assert {shift for one in first.derived for shift in one.shifts} == positions_of_a_pallet(lines)
    assert len(positions_of_a_pallet(lines)) == 24


KRL = "DEF a()\nBAS(#TOOL,0)\nBAS(#BASE,0)\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n"


@pytest.mark.promise("A single file of FANUC makes no backup of the programs beside it; all of them are read or named.")
@pytest.mark.parametrize("name", ["cam/OLD.TP", "posreg.va", "VERSION.DG"])
def test_a_single_file_makes_no_backup(tmp_path: Path, name: str) -> None:
    for file, text in {name: "x", "a.src": KRL, "cell/b.src": KRL.replace("a()", "b()"), "cell/C.LS": ""}.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
    found = read_programs([tmp_path])
    assert not found.backups
    assert [one.counts()["correct"] for one in found.programs] == [2]
    compiled = [f"{tmp_path / name} is a compiled FANUC program; export it as .ls and correct that"]
    assert [text for text in found.left_out if "C.LS" not in text] == (compiled if name.endswith("TP") else [])


def test_a_controller_beside_other_programs_leaves_none_out(backup: Path, tmp_path: Path) -> None:
    folder = tmp_path / "both"
    shutil.copytree(backup, folder / "fanuc")
    (folder / "fanuc/CAM/deep").mkdir(parents=True)
    shutil.copy(next((folder / "fanuc").glob("*.LS")), folder / "fanuc/CAM/deep/ELSE.LS")
    (folder / "a.src").write_text(KRL)
    alone, found = read_programs([backup]), read_programs([folder])
    assert len(found.programs) == len(alone.programs) + 2
    assert {one.path for one in found.programs if one.controller is None} == {folder, folder / "fanuc/CAM/deep/ELSE.LS"}
