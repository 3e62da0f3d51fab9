"""A backup of FANUC: its frames and programs are found, and every corrected digit is computed anew."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.programs.backups import fanuc as corpus

from truepose.programs import FrameTable, Program, ReadOptions, correct_program
from truepose.programs.backups import fanuc
from truepose.programs.core.program import MotionGroups
from truepose.programs.tp.reader import read

POSITION = re.compile(r"(?s)P\[(\d+)[^\]]*\]\{(.*?)\};")
GROUP1 = re.compile(r"(?s)GP1:\s*UF : (\w+), UT : (\w+),(.*?)(?=GP2:|$)")
NUMBER = {key: re.compile(rf"(?<!\w){key}\s*=\s*(-?[\d.]+)") for key in "XYZWPR"}
GRADIENT = np.array([[2.0, -1.0, 0.5], [0.3, 1.7, -0.8], [-0.6, 0.4, 1.1]]) * 2e-4


@pytest.fixture(scope="module")
def backup(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return corpus.write_backup(tmp_path_factory.mktemp("fanuc") / "all")


def files(folder: Path) -> list[Path]:
    return sorted(file for file in folder.rglob("*") if file.is_file())


def programs(root: Path, groups: MotionGroups | None = None, **options: Any) -> dict[str, Program]:
    """All programs of a controller, as the reading of backups asks for them."""
    own, stored = files(root), fanuc.stored_frames(root, files(root))
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
    w, p, r = np.deg2rad(wpr)
    about_x = np.array([[1, 0, 0], [0, np.cos(w), -np.sin(w)], [0, np.sin(w), np.cos(w)]])
    about_y = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    about_z = np.array([[np.cos(r), -np.sin(r), 0], [np.sin(r), np.cos(r), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def user_frames(root: Path) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """The user frames of group 1, read without the library."""
    text = (root / "SYSFRAME.VA").read_text("latin-1").split("$MNUFRAME  ")[1].split("$MNUTOOL")[0]
    found = {}
    for m in re.finditer(r"\[1,(\d+)\] = \n.*\n(.*)\n(.*)\n", text.replace("\r\n", "\n")):
        values = [float(v) for v in re.findall(r"-?\d+\.\d+", m[2] + m[3])]
        found[int(m[1])] = (rotation(tuple(values[3:])), np.array(values[:3]))
    return found


def test_the_controller_is_recognised(backup: Path) -> None:
    own = files(backup)
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
    stored = fanuc.stored_frames(backup, files(backup))
    for number, (turn, origin) in user_frames(backup).items():
        frame = stored.bases[number]
        np.testing.assert_allclose(frame.tf[:3, :3], turn, atol=1e-12)
        np.testing.assert_allclose(frame.tf[:3, 3], origin)
        assert frame.name == corpus.FRAMES.get(number, ("",))[0]
    assert stored.tools[2].name == "Torch"
    np.testing.assert_allclose(stored.tools[2].tf[:3, 3], [0.0, -35.2, 312.75])
    assert stored.bases[1].place == "SYSFRAME.VA, line 6"
    assert {"gp2-1", "gp2-9"} <= stored.bases.keys()


@pytest.mark.promise("FANUC: a zero correction leaves every program of a backup as it was, byte for byte")
def test_a_zero_correction_changes_no_byte(backup: Path, make_map: Any, record_property: Callable[..., None]) -> None:
    found = programs(backup)
    for program in found.values():
        if program.counts()["correct"]:
            patched = correct_program(program, make_map(), on_guard="skip").files
            assert all(data == path.read_bytes() for path, data in patched.items())
    record_property("cases", len(found))


class Gradient:
    """A map whose correction depends on the place: each target gets another one."""

    hash = "1" * 64

    def correct(self, poses: np.ndarray, **more: Any) -> Any:
        from tests.programs.conftest import Answer

        p, n = poses[:, :3, 3], len(poses)
        shift = p @ GRADIENT.T
        return Answer(p, p + shift, -shift, np.full((n, 3), 2.0), np.full(n, "correct", "<U7"), [""] * n)


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
        before = program.path.read_text("latin-1")
        after = result[program.path].decode("latin-1") if program.path in result else before
        for old, new in zip(poses(before), poses(after), strict=True):
            assert (old.wpr, old.uf) == (new.wpr, new.uf)
            if f"P[{old.number}]" not in corrected:
                assert old == new
                continue
            turn, origin = frames[int(old.uf) if old.uf != "F" else 1]
            p_base = turn @ np.array(old.xyz) + origin
            change = turn.T @ (GRADIENT @ p_base)
            for before_mm, mm, after_mm in zip(old.xyz, change, new.xyz, strict=True):
                steps = (before_mm + mm) * 1000.0
                if abs(steps - np.floor(steps) - 0.5) > 1e-6:  # not between two digits
                    assert corpus.number(after_mm) == expected(before_mm, mm), (name, old.number)
            checked += 1
    assert checked > 1500


def test_nothing_but_digits_of_corrected_positions_changes(backup: Path) -> None:
    for program in programs(backup).values():
        if program.counts()["correct"]:
            for path, data in correct_program(program, Gradient(), on_guard="skip").files.items():  # type: ignore[arg-type]
                old, new = path.read_bytes(), data
                assert len(old) == len(new)
                assert re.sub(rb"[-\d. ]+ mm", b"", old) == re.sub(rb"[-\d. ]+ mm", b"", new)


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
