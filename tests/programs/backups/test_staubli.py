"""A backup of a Stäubli controller: recognised, read as a whole, corrected; checked by a reader of its own."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.programs.backups import staubli as corpus
from tests.programs.backups.compare import (
    Own,
    digits_agree,
    listing,
    places_agree,
    transform,
    zero_changes_no_byte,
)
from tests.programs.backups.small import lay

from truepose.programs import Program, ReadOptions, Target, read_programs
from truepose.programs.backups import staubli


def read(folder: Path, **options: Any) -> dict[str, Program]:
    """Read a backup; the programs by the names of their data."""
    found = read_programs([folder], None, ReadOptions(**options))
    assert not found.unreadable
    return {program.path.stem: program for program in found.programs}


def changed(tmp_path: Path, name: str, old: bytes, new: bytes) -> Path:
    files = corpus.backup()
    assert old in files[f"usr/usrapp/{name}"]
    files[f"usr/usrapp/{name}"] = files[f"usr/usrapp/{name}"].replace(old, new)
    return lay(tmp_path, files)


# a reader of its own: regular expressions, no code of the library


class Taught(NamedTuple):
    """A point in a .dtx: its frame, its six numbers and the bytes of its position."""

    frame: str
    numbers: tuple[float, ...]
    spans: tuple[tuple[int, int], ...]


N = rb'"([-\d.]+)"'
VALUE = re.compile(
    rb"<Value key=\"\d+\" x=" + N + rb" y=" + N + rb" z=" + N + rb" rx=" + N + rb" ry=" + N + rb" rz=" + N
    + rb" shoulder=[^>]* fatherId=\"geo:(\w+)\[0\]\""
)  # fmt: skip


def taught(data: bytes) -> Iterator[Taught]:
    """Yield every complete point."""
    for m in VALUE.finditer(data):
        yield Taught(m[7].decode(), tuple(float(m[k]) for k in range(1, 7)), tuple(m.span(k) for k in (1, 2, 3)))


def matrix(values: tuple[float, ...]) -> np.ndarray:
    return transform(values, "xyz")


def base_of(frame: str) -> np.ndarray:
    father, values = corpus.FRAMES[frame]
    above = father.removesuffix("[0]")
    return matrix(values) if above == "world" else base_of(above) @ matrix(values)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay(tmp_path_factory.mktemp("staubli") / "cell", corpus.backup())


@pytest.fixture(scope="module")
def programs(folder: Path) -> dict[str, Program]:
    return read(folder, derived=True)


def reason_of(programs: dict[str, Program], application: str, name: str) -> str:
    return next(t.reason for t in programs[application].targets if t.name == name)


def test_the_controller_is_recognised_and_its_files_are_sorted(folder: Path, tmp_path: Path) -> None:
    files = listing(folder)
    assert staubli.roots(files) == [folder]
    found = staubli.contents(folder, files)
    assert {path.name for (path,) in found.programs} == {"geo.dtx", "load1.dtx", "load2.dtx", "deburr.dtx"}
    words = Counter(found.others.values())
    assert words["program code"] >= 30
    assert words == {"program code": words["program code"], "project": 4, "machine data": 1, "log": 1}
    assert (found.robot, found.version, found.warnings) == ("TX2-90L", "s7.7.2", [])
    copied = {name.removeprefix("usr/usrapp/"): data for name, data in corpus.backup().items() if "usrapp" in name}
    assert staubli.roots(listing(lay(tmp_path, copied))) == [tmp_path]  # the applications alone


def own(program: Program) -> Callable[[Target], Own]:
    """Return what finds the targets of a program in its text."""
    known = {one.spans: one for one in taught(program.path.read_bytes())}

    def find(target: Target) -> Own:
        one = known[target.spans[:3]]
        assert target.frame == f"geo:{one.frame}"
        return Own(base_of(one.frame), matrix(one.numbers), one.spans)

    return find


def test_every_target_that_is_corrected_stands_in_the_base_of_an_independent_reader(
    programs: dict[str, Program],
) -> None:
    assert sum(places_agree(program, own(program)) for program in programs.values()) > 500


def test_a_zero_correction_changes_no_byte(programs: dict[str, Program]) -> None:
    assert zero_changes_no_byte(programs.values()) >= 3


def test_corrected_digits_agree_with_a_computation_of_their_own(programs: dict[str, Program]) -> None:
    """Every target that may be corrected, to the digit; nothing else in the file changes."""
    assert sum(digits_agree(program, own(program)) for program in programs.values()) > 500


def test_most_targets_are_corrected_and_the_others_have_a_reason(programs: dict[str, Program]) -> None:
    moved = [t for one in programs.values() for t in one.targets if t.motions or t.derived]
    cartesian = [t for t in moved if "joint" not in t.reason and not t.follows]
    assert sum(t.verdict == "correct" for t in cartesian) >= 0.85 * len(cartesian)
    kinds = Counter(re.sub(r"\d+", "#", t.reason) for t in cartesian if t.reason)
    assert kinds == {
        "geo:fVision is changed by the program (geo/see.pgx, line #); --frame-tolerance corrects with the stored "
        "frame": 2,
        "x, z not written, so #: nothing is added to a file": 2,
        "moved to under geo:tGripA (part#.pgx, line #) and geo:tSpindle (deburr/enter.pgx, line #): teach two "
        "points": 1,
        "target computed at run time: compose(pSide,geo:fMachine,{#,#,nHeight,…": 1,
    }


def test_what_programs_derive_from_a_point_belongs_to_it(programs: dict[str, Program]) -> None:
    named = {t.name: t for t in programs["load1"].targets}
    assert [(one.shifts, one.axes) for one in named["pPart0"].derived] == [
        (((0.0, 0.0, -80.0),), "tool"),
        (((0.0, 0.0, -120.0),), "tool"),
    ]
    assert [(one.shifts, one.axes) for one in named["pPart1"].derived] == [
        (((0.0, 0.0, -80.0),), "tool"),
        (((0.0, 0.0, 95.5),), "frame"),
    ]
    assert named["pUp (line 18 of part1.pgx)"].follows == ("pPart1",)
    assert named["pTray[7]"].derived[0].shifts == ((0.0, 0.0, -40.0),)
    assert named["pTray[7]"].motions == ("movel",)


def test_points_in_structures_and_elements_that_are_not_written(programs: dict[str, Program]) -> None:
    named = {t.name: t for t in programs["load2"].targets}
    assert (named["stPress.pWait"].verdict, named["stPress.pWait"].tool) == ("correct", "geo:tGripA")
    assert named["pOdd[1]"].motions == ("movel",)


ADDED = b"movel(pSeen,geo:tGripA,mSlow)"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("code", "name", "reason"),
    [
        (b"pUp=appro(pPart0,{0,0,nUp,0,0,0})\n  movel(pUp,geo:tGripA,mSlow)", "pPart0", "read by arithmetic"),
        (b"movel(appro(pPart0,{0,0,-5,0,10,0}),geo:tGripA,mSlow)", "pPart0", "read by arithmetic"),
        (b"call other(pPart0)", "pPart0", "read by arithmetic"),
        (b"pPart0=here(geo:tGripA,world)", "pPart0", "assigned at run time"),
        (b"pPart0.trsf.z=pPart0.trsf.z+1", "pPart0", "read by arithmetic"),
        (b"pVia0[nI].trsf.x=3", "pVia0[1]", "assigned"),
        (b"geo:fMachine.trsf.z=3", "pPart2", "geo:fMachine is changed by the program (load1/seen.pgx, line "),
        (
            b"geo:fCell.trsf.z=3",
            "pPart2",
            "geo:fMachine hangs on fcell, which is changed by the program (load1/seen.pgx",
        ),
        (b"setFrame(pA,pB,pC,geo:fCell)", "pPart2", "geo:fMachine hangs on fcell, which is changed by the program"),
        (b"geo:tFlange.trsf.z=3", "pPath0[3]", "geo:tSpindle is changed by the program (load1/seen.pgx, line "),
    ],
)
def test_what_a_program_does_to_points_and_frames_counts(tmp_path: Path, code: bytes, name: str, reason: str) -> None:
    found = read(changed(tmp_path, "load1/seen.pgx", ADDED, code), derived=True)
    application = "deburr" if name.startswith("pPath") else "load1"
    target = next(t for t in found[application].targets if t.name == name)
    assert target.verdict in ("skip", "refuse")
    assert reason in target.reason


def test_a_value_is_not_followed_past_a_place_that_control_may_come_to(tmp_path: Path) -> None:
    loop = b"pUp=pPart1\n  while true\n  pUp.trsf.z=pUp.trsf.z+95.5"
    found = read(changed(tmp_path, "load1/part1.pgx", b"pUp=pPart1\n  pUp.trsf.z=pUp.trsf.z+95.5", loop), derived=True)
    assert "pUp (line 19 of part1.pgx)" in {t.name for t in found["load1"].targets}
    assert "read by arithmetic" in reason_of(found, "load1", "pPart1")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("step", [b"951.2.3.5", b".", b"1..5", b"9" * 400])
def test_a_value_is_not_followed_by_a_step_that_is_no_number(tmp_path: Path, step: bytes) -> None:
    code = b"pUp=pPart1\n  pUp.trsf.z=pUp.trsf.z+"
    found = read(changed(tmp_path, "load1/part1.pgx", code + b"95.5", code + step), derived=True)
    assert "read by arithmetic" in reason_of(found, "load1", "pPart1")


def test_an_element_without_a_value_is_named(tmp_path: Path) -> None:
    found = read(changed(tmp_path, "load1/odd.pgx", b"pOdd[1]", b"pOdd[0]"))
    assert reason_of(found, "load1", "podd[0]").startswith("it has no <Value> in the file")


def test_a_library_that_is_not_there_is_named(tmp_path: Path) -> None:
    files = {name: data for name, data in corpus.backup().items() if "/geo/" not in name}
    folder = lay(tmp_path, files)
    warnings = staubli.contents(folder, listing(folder)).warnings
    assert warnings[0].startswith("deburr.pjx: the library geo (geo) is not in the backup")
    reason = reason_of(read(folder), "load1", "pVia0")
    assert "tool geo:tGripB is not known" in reason
    assert "base geo:fBelt is not known" in reason


@pytest.mark.exhaustive
def test_frames_that_go_in_a_circle_are_not_known(tmp_path: Path) -> None:
    found = read(changed(tmp_path, "geo/geo.dtx", b'fatherId="world[0]" />\r\n    </Data>\r\n    <Data name="fMachine"',
                         b'fatherId="fChuck[0]" />\r\n    </Data>\r\n    <Data name="fMachine"'))  # fmt: skip
    assert "base geo:fChuck is not known" in reason_of(found, "deburr", "pIn")


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("load1/load1.pjx", b'millimeterUnit="true"', b'millimeterUnit="false"', "states lengths in inches"),
        ("load1/load1.dtx", b"</Datas>", b"", r"load1\.dtx:\d+: is broken XML: mismatched tag"),
        ("load1/load1.dtx", b'<Value key="7" ', b'<Value key="6" ', r"pTray\[6\] is given twice, first in line \d+"),
        ("load1/load1.dtx", b' y="', b' y="1.', r"load1\.dtx:\d+: pPart0 y: 1\.[-\d.]+ is not a number"),
    ],
)
def test_broken_data_are_named_and_do_not_stop_the_others(
    tmp_path: Path, name: str, old: bytes, new: bytes, message: str
) -> None:
    found = read_programs([changed(tmp_path, name, old, new)])
    assert {program.path.stem for program in found.programs} == {"geo", "load2", "deburr"}
    (error,) = found.unreadable
    assert re.search(message, str(error))


def test_two_applications_of_one_name_are_no_library(tmp_path: Path) -> None:
    files = corpus.backup()
    twin = {name.replace("/geo/", "/old/"): data for name, data in files.items() if "/geo/" in name}
    found = read(lay(tmp_path, {**files, **twin}))
    assert not any(t.verdict == "correct" for t in found["load1"].targets)
