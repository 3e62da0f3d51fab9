"""A backup of a KUKA controller: recognised, read with its frames, corrected; checked by a reader of its own."""

from __future__ import annotations

import re
import zipfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.programs.backups import kuka as corpus
from tests.programs.backups.compare import Gradient, listing, transform
from tests.programs.backups.small import lay

from truepose.errors import FileError, RefusedError
from truepose.programs import Program, ReadOptions, correct_programs, read_programs
from truepose.programs.backups import kuka
from truepose.programs.batch import CorrectedBatch


def read(folder: Path, name: str = "", **options: Any) -> Program:
    """Read the programs of a controller with its frames."""
    found = read_programs([folder], options=ReadOptions(**options), controllers=[name] if name else [])
    if found.unreadable:
        raise found.unreadable[0]
    (program,) = found.programs
    return program


# a reader of its own: regular expressions, no code of the library


class Taught(NamedTuple):
    """A pose in the text: its file and line, its base, its six numbers and their bytes in the file."""

    file: str
    line: int
    base: int
    numbers: tuple[float, ...]
    spans: tuple[tuple[int, int], ...]


N = rb"(-?\d+\.?\d*)"
POSE = rb"X +" + N + rb", *Y +" + N + rb", *Z +" + N + rb", *A +" + N + rb", *B +" + N + rb", *C +" + N
POINT = re.compile(rb"(?im)^(?:DECL (?:GLOBAL )?E6POS )?(X\w+)(?:\[\d\])?=\{" + POSE)
FDAT = re.compile(rb"(?im)^DECL (?:GLOBAL )?FDAT F(\w+)=\{TOOL_NO \d+,BASE_NO (\d+)")
MOTION = re.compile(rb"(?im)^ *(?:S?PTP|S?LIN|S?CIRC|P_LOCAL=)[ {][^\r\n]*")
BASE = re.compile(rb"(?i)\$BASE=BASE_DATA\[(\d+)\]|BAS\(#BASE,(\d+)\)")


def matrix(values: tuple[float, ...]) -> np.ndarray:
    return transform(values, "zyx")


def taught(files: dict[str, bytes]) -> Iterator[Taught]:
    """Yield every complete pose of the user's data lists and motions, with the number of its base."""
    for name, data in files.items():
        stem = name.rsplit(".", 1)[0].lower()
        own_src = next((d for n, d in files.items() if n.lower() == stem + ".src"), b"")
        found = BASE.search(own_src)
        base_of_module = int(found[1] or found[2]) if found else 0
        if name.lower().endswith(".dat"):
            base_of = {m[1].upper(): int(m[2]) for m in FDAT.finditer(data)}
            for m in POINT.finditer(data):
                yield one(name, data, m, base_of.get(m[1][1:].upper(), base_of_module), 2)
        elif name.lower().endswith(".src"):
            for line in MOTION.finditer(data):
                for m in re.finditer(POSE, line[0]):
                    before = list(BASE.finditer(data, 0, line.start()))
                    base = int(before[-1][1] or before[-1][2]) if before else 0
                    yield one(name, data, m, base, 1, line.start())


def one(name: str, data: bytes, m: re.Match[bytes], base: int, first: int, offset: int = 0) -> Taught:
    groups = range(first, first + 6)
    spans = tuple((m.start(k) + offset, m.end(k) + offset) for k in groups)
    return Taught(name, data.count(b"\n", 0, spans[0][0]) + 1, base, tuple(float(m[k]) for k in groups), spans)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lay(tmp_path_factory.mktemp("kuka"), corpus.backup())


@pytest.fixture(scope="module")
def program(folder: Path) -> Program:
    return read(folder)


def reasons(program: Program) -> Counter[str]:
    return Counter(
        f"{t.verdict}: {re.sub(r'[0-9]+', '#', t.reason)}" for t in program.targets if t.verdict != "correct"
    )


def test_the_controller_is_recognised_and_its_files_are_sorted(folder: Path) -> None:
    files = listing(folder)
    (root,) = kuka.roots(files)
    assert root == folder / "KRC/R1"
    found = kuka.contents(root, files)
    (programs,) = found.programs
    of_user = {f"KRC/R1/{name}" for name in corpus.user_programs()}
    assert {path.relative_to(folder).as_posix() for path in programs} == of_user
    assert len([path for path in programs if path.suffix == ".src"]) >= 30
    assert set(found.others) | set(programs) == set(files)
    words = {path.relative_to(folder).as_posix(): word for path, word in found.others.items()}
    assert words["KRC/STEU/$config.dat"] == "controller data"
    assert words["KRC/R1/System/sps.sub"] == "submit"
    assert words["KRC/R1/TP/p00.src"] == "technology package"
    assert words["KRC/R1/Mada/$machine.dat"] == "machine data"
    assert (found.robot, found.version, list(found.warnings)) == ("KR16R1610 C4 FLR Cell4 left", "V8.6.2", [])


def test_no_file_of_the_controller_is_told_as_one_of_another(folder: Path) -> None:
    (backup,) = read_programs([folder]).backups
    assert (backup.warnings, [one.name for one in backup.controllers]) == ((), ["KRC/R1"])


def test_tools_and_bases_are_read_with_names_lines_and_problems(folder: Path) -> None:
    files = listing(folder)
    stored = kuka.stored_frames(folder / "KRC/R1", files)
    assert stored.in_world
    np.testing.assert_allclose(stored.tf_world_base, matrix(corpus.ROBROOT), atol=1e-9)
    lines = corpus.config_dat().decode("cp1252").split("\r\n")
    for table, given, word in ((stored.tools, corpus.TOOLS, "TOOL"), (stored.bases, corpus.BASES, "BASE")):
        for number, (name, _, values) in given.items():
            frame = table[number]
            np.testing.assert_allclose(frame.tf, matrix(values), atol=1e-7)
            line = next(i for i, text in enumerate(lines, 1) if text.startswith(f"{word}_DATA[{number}]="))
            assert (frame.name, frame.place) == (name, f"R1/System/$config.dat, line {line}")
    assert [stored.tools[5].of_held_part, stored.tools[5].problem] == [True, ""]
    assert "it moves with DKP 400 (EASYS)" in stored.bases[17].problem
    assert not any(one.problem for number, one in stored.bases.items() if number != 17)
    assert stored.bases[9].name == ""


@pytest.mark.exhaustive
def test_every_target_that_is_corrected_stands_in_the_base_of_an_independent_reader(program: Program) -> None:
    files = {f"{source.path}": source.data for source in program.sources}
    known = {(pose.file, pose.spans[0]): pose for pose in taught(files)}
    root = np.linalg.inv(matrix(corpus.ROBROOT))
    indices, found = program.correctable(), program.positions_base()
    assert len(indices) > 1000
    for target, p in zip((program.targets[int(i)] for i in indices), found, strict=True):
        pose = known[str(target.path), target.spans[0]]
        assert target.line == pose.line
        tf = root @ matrix(corpus.BASES[pose.base][2]) @ matrix(pose.numbers)
        np.testing.assert_allclose(p, tf[:3, 3], atol=1e-9)


def test_system_modules_and_their_points_are_no_targets(program: Program) -> None:
    folders = Counter(target.path.parent.name for target in program.targets)
    assert not {"TP", "GripTech", "Mada"} & set(folders)
    of_system = sorted(target.name for target in program.targets if target.path.parent.name == "System")
    assert of_system == ["XGCHANGE", "XGCLEAN", "XGPARK", "XHOME"]
    assert [t.reason for t in program.targets if t.name == "XSEEN"] == ["its value is known at run time only"]


# the whole backup, corrected


def corrected(folder: Path, out: Path, scale: float = 1.0, **options: Any) -> tuple[CorrectedBatch, dict[str, bytes]]:
    """Correct a backup; return the result, and all files of the whole corrected backup by their names."""
    batch = correct_programs([folder], Gradient(scale), options=ReadOptions(**options), on_guard="skip")
    batch.write(out, whole=True)
    whole = out / folder.name
    return batch, {path.relative_to(whole).as_posix(): path.read_bytes() for path in listing(whole)}


@pytest.mark.exhaustive
def test_a_correction_of_zero_returns_the_backup_byte_for_byte(folder: Path, tmp_path: Path) -> None:
    _, after = corrected(folder, tmp_path / "out", 0.0, derived=True)
    assert after == corpus.backup()


def test_corrected_targets_agree_with_an_independent_reader_to_the_digit(folder: Path, tmp_path: Path) -> None:
    """In the base frame: the new numbers are those of the old place plus the correction there, to half a digit."""
    batch, after = corrected(folder, tmp_path / "out", derived=True)
    program = batch.corrected[0].program
    before = corpus.backup()
    own = {f"KRC/R1/{name}" for name in corpus.user_programs()}
    assert {name for name in before if after[name] != before[name]} < own
    left = {(str(t.path.relative_to(folder)), t.line) for t in program.targets if t.verdict != "correct"}
    root = np.linalg.inv(matrix(corpus.ROBROOT))
    texts = [{name: files[name] for name in own} for files in (before, after)]
    n = 0
    for old, new in zip(*map(taught, texts), strict=True):
        assert (old.file, old.line) == (new.file, new.line)
        if old.numbers == new.numbers:
            assert (old.file, old.line) in left
            continue
        n += 1
        tf = root @ matrix(corpus.BASES[old.base][2])
        wanted = (tf @ matrix(old.numbers))[:3, 3]
        wanted = wanted + Gradient().shift(wanted)
        decimals = [len(after[new.file][a:b].partition(b".")[2]) for a, b in new.spans]
        there = np.linalg.inv(tf) @ np.append(wanted, 1.0)
        for axis in range(3):
            kept = new.numbers[axis] == old.numbers[axis]  # a change below half a micrometre is none
            half = 0.5e-3 if kept else 0.5 * 10.0 ** -decimals[axis]
            assert abs(there[axis] - new.numbers[axis]) <= half * (1 + 1e-6), old
            assert decimals[axis] >= 3
        assert old.numbers[3:] == new.numbers[3:]
    assert n == program.counts()["correct"]
    digits = re.compile(rb"[0-9.+-]")
    for name in own:
        assert digits.sub(b"", after[name]) == digits.sub(b"", before[name])


KINDS = {
    "weld": (r"weld_\d+", 100.0, 100.0),
    "handling": (r"pick\d", 25.0, 100.0),
    "pallets": (r"pallet_\d", 0.0, 100.0),
    "milling": (r"mill\d", 100.0, 100.0),
    "splines": (r"glue_\d", 100.0, 100.0),
    "by hand": (r"station\d", 100.0, 100.0),
    "global points": (r"global_points", 100.0, 100.0),
    "positioner": (r"turn_table", 0.0, 0.0),
    "camera": (r"camera", 0.0, 0.0),
}
"""Kinds of programs, each with the share of Cartesian targets that must be correct without and with `derived` [%]."""


def shares(program: Program) -> dict[str, float]:
    """Return the share of the Cartesian motion targets of each kind of program that are correct [%].

    Relative motions and joint targets do not count; a target that follows a corrected one does.
    """
    found: dict[str, list[bool]] = {kind: [] for kind in KINDS}
    correct = {(t.path.stem, t.name) for t in program.targets if t.verdict == "correct"}
    for target in program.targets:
        if not target.motions or "joint" in target.reason or target.reason.startswith("relative"):
            continue
        (kind,) = [kind for kind, (stem, *_) in KINDS.items() if re.fullmatch(stem, target.path.stem.lower())]
        follows = bool(target.follows) and all(
            any(name == other and stem.lower() == target.path.stem.lower() for stem, other in correct)
            for name in target.follows
        )
        found[kind] += [target.verdict == "correct" or follows] * len(target.motions)
    return {kind: 100.0 * sum(ok) / len(ok) for kind, ok in found.items()}


def test_most_targets_of_each_kind_of_program_are_corrected(folder: Path, program: Program) -> None:
    derived = shares(read(folder, derived=True))
    plain = shares(program)
    for kind, (_, least, with_derived) in KINDS.items():
        assert plain[kind] == pytest.approx(least, abs=1.0), kind
        assert derived[kind] == with_derived, kind


def test_what_is_left_has_a_reason_that_names_what_and_the_remedy(folder: Path) -> None:
    found = reasons(read(folder, derived=True))
    left = [why for why in found if not re.search(r"derived from|joint target|relative:", why)]
    known = (
        r"base BASE_DATA\[#\] cannot be used \(R#/System/\$config.dat, line #\): it moves with DKP # \(EASYS\)",
        r"external axis E# is in use and has no model; allow external_axes if it moves neither",
        r"taught on an absolutely accurate robot .* switch that option off and allow absolute_accuracy",
        r"its value is known at run time only",
    )
    assert len(left) == len(known)
    assert all(any(re.search(pattern, why) for why in left) for pattern in known)


# variants and bad input

NAME = "KRC/R1/Program/Weld/weld_01.src"


def changed(folder: Path, **more: bytes | None) -> Path:
    """Lay the backup with some files replaced, or left out; names with / are given by a dictionary."""
    return lay(folder, {name: data for name, data in {**corpus.backup(), **more}.items() if data is not None})


def test_an_older_controller_in_lower_case_gives_the_same_targets(tmp_path: Path, program: Program) -> None:
    folder = lay(tmp_path, corpus.older())
    older = read(folder)
    assert older.counts() == program.counts()
    a, b = (
        {(t.path.name.lower(), t.line, t.name): (t.verdict, t.xyz) for t in one.targets} for one in (program, older)
    )
    assert a == b
    stored = kuka.stored_frames(folder / "krc/r1", listing(folder))
    assert "may move with the external axis E1" in stored.bases[17].problem


@pytest.mark.exhaustive
def test_two_robots_have_their_own_programs_frames_and_places(tmp_path: Path, program: Program) -> None:
    folder = lay(tmp_path, corpus.two_robots())
    files = listing(folder)
    assert kuka.roots(files) == [folder / "KRC/R1", folder / "KRC/R2"]
    first, second = (read(folder, name) for name in ("KRC/R1", "KRC/R2"))
    assert first.counts() == second.counts() == program.counts()
    np.testing.assert_allclose(first.positions_base(), program.positions_base(), atol=1e-9)
    assert np.abs(second.positions_base() - first.positions_base()).max() > 500.0
    for root in kuka.roots(files):
        found = kuka.contents(root, files)
        other = "R2" if root.name == "R1" else "R1"
        assert not [path for path in (*found.others, *found.programs[0]) if other in path.parts]


def test_a_folder_is_recognised_by_what_it_holds(tmp_path: Path) -> None:
    assert kuka.roots(listing(lay(tmp_path / "a", {"R1/Program/a.src": b"DEF a()\nEND\n"}))) == [tmp_path / "a/R1"]
    assert kuka.roots(listing(lay(tmp_path / "b", {"a.src": b"", "RAPID/TASK1/PROGMOD/m.mod": b""}))) == []
    renamed = {f"left robot/{name}": data for name, data in corpus.robot_folder().items()}
    assert kuka.roots(listing(lay(tmp_path / "c", renamed))) == [tmp_path / "c/left robot"]
    steu = {name: data for name, data in corpus.backup().items() if "STEU" in name}
    assert kuka.roots(listing(lay(tmp_path / "d", steu))) == []


def test_without_config_dat_the_backup_is_recognised_and_says_what_is_missing(tmp_path: Path) -> None:
    folder = changed(tmp_path, **{"KRC/R1/System/$config.dat": None})
    (root,) = kuka.roots(listing(folder))
    assert "has no System/$config.dat" in kuka.contents(root, listing(folder)).warnings[0]
    assert not kuka.stored_frames(root, listing(folder)).bases
    assert "is not known; give it in [frames" in " ".join(reasons(read(folder)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            {"KRC/R1/Program/Old/WELD_01.SRC": b"DEF weld_01()\nEND\n"},
            r"(?i)weld_01.src is another module of this name",
        ),
        ({"KRC/R1/Program/Old/other.src": b"DEF weld_01()\nEND\n"}, r"WELD_01 is defined twice"),
        ({NAME: corpus.backup()[NAME][:3000]}, r"weld_01\.src:5: weld_01 has no END: the file is truncated"),
        (
            {"KRC/R1/Program/g.dat": b"DEFDAT G PUBLIC\nDECL GLOBAL E6POS XGPARK={X 1,Y 2,Z 3,A 0,B 0,C 0}\nENDDAT\n"},
            r"XGPARK is GLOBAL here and in line 2 of another file",
        ),
    ],
)
def test_modules_that_contradict_each_other_are_refused(tmp_path: Path, more: dict[str, bytes], message: str) -> None:
    with pytest.raises(FileError, match=message):
        read(changed(tmp_path, **more))


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("Mada/$machine.dat", b"$ROBROOT={X 250", b"$ROBROOT={X 251", r"MACHINE_DEF\[1\] has another place .* make"),
        ("Mada/$machine.dat", b"FRAME $ROBROOT={X", b"FRAME $ROBROOT={N 1,X", r"ROBROOT is not the null frame, nor"),
    ],
)
def test_places_of_the_robot_that_are_broken_or_contradict_each_other(
    tmp_path: Path, name: str, old: bytes, new: bytes, message: str
) -> None:
    path = f"KRC/R1/{name}"
    assert old in corpus.backup()[path]
    folder = changed(tmp_path, **{path: corpus.backup()[path].replace(old, new)})
    with pytest.raises(FileError, match=message):
        kuka.stored_frames(folder / "KRC/R1", listing(folder))


@pytest.mark.parametrize(
    ("new", "unknown", "message"),
    [
        (b"BASE_DATA[1]={X ", {1, 2}, r"dat:\d+: BASE_DATA\[1\] was given in line \d+"),
        (b"BASE_DATA[2]={X 1.2.", {2}, r"dat:\d+: X 1\.2\.\S+ is not a number"),
    ],
)
def test_a_broken_frame_of_config_dat_is_named_and_blocks_no_other(
    tmp_path: Path, new: bytes, unknown: set[int], message: str
) -> None:
    path = "KRC/R1/System/$config.dat"
    folder = changed(tmp_path, **{path: corpus.backup()[path].replace(b"BASE_DATA[2]={X ", new)})
    (controller,) = read_programs([folder]).backups[0].controllers
    (warning,) = [one for one in controller.contents.warnings if re.search(message, one)]
    assert warning.endswith(": the frame is not known")
    program, sound = read(folder), read(changed(tmp_path / "sound"))
    states = {of: Counter((one.frame_number in unknown, one.verdict) for one in of.targets) for of in (program, sound)}
    assert states[sound][True, "correct"] > 0
    assert states[program][True, "correct"] == 0
    assert states[program][False, "correct"] == states[sound][False, "correct"] > 0
    assert any(re.search(message, target.reason) for target in program.targets)


def test_a_robot_on_a_track_has_no_base_that_can_be_used(tmp_path: Path) -> None:
    folder = changed(tmp_path, **{"KRC/R1/Mada/$machine.dat": corpus.machine_dat(carried=True)})
    bases = kuka.stored_frames(folder / "KRC/R1", listing(folder)).bases
    assert bases.keys() >= {0, 1, 17}
    assert all("external axis E1 carries (#ERSYS)" in one.problem for one in bases.values())


def test_what_a_called_system_module_does_counts(tmp_path: Path) -> None:
    grip = corpus.backup()["KRC/R1/TP/GripTech/grip.src"]
    moved = grip.replace(b"$OUT[21]=TRUE", b"BASE_DATA[4].Z=$POS_ACT.Z")
    found = reasons(read(changed(tmp_path, **{"KRC/R1/TP/GripTech/grip.src": moved})))
    assert any("BASE_DATA[#] is changed by the program (grip.src, line #)" in why for why in found)
    broken = grip.replace(b"WAIT FOR $IN[21]", b'LIN XGPARK\nHALT "')
    program = read(changed(tmp_path, **{"KRC/R1/TP/GripTech/grip.src": broken}))
    (why,) = [target.reason for target in program.targets if target.name == "XGPARK"]
    assert "named by GRIP, which cannot be read (grip.src, line 1)" in why
    (why,) = [target.reason for target in program.targets if target.name == "XGCLEAN"]
    assert not why


def test_what_a_submit_does_to_a_point_counts(tmp_path: Path) -> None:
    sub = corpus.backup()["KRC/R1/System/sps.sub"].replace(b"XSEEN.X=N", b"XGPARK.X=N")
    program = read(changed(tmp_path, **{"KRC/R1/System/sps.sub": sub}))
    (why,) = [target.reason for target in program.targets if target.name == "XGPARK"]
    assert "component .X set at run time" in why


def test_an_encoded_module_is_named_and_may_use_every_global_point(tmp_path: Path) -> None:
    folder = changed(tmp_path, **{"KRC/R1/Program/Special.src": b"\0\1\2\3" * 40})
    (root,) = kuka.roots(listing(folder))
    found = kuka.contents(root, listing(folder))
    assert found.others[root / "Program/Special.src"] == "encoded"
    assert "Special.src is encoded" in found.warnings[0]
    of_global = {target.reason for target in read(folder).targets if target.name.startswith("XG")}
    assert all("named by SPECIAL, which cannot be read" in why for why in of_global)


def test_a_point_of_config_dat_is_never_written(tmp_path: Path) -> None:
    path = "KRC/R1/System/$config.dat"
    pose = b"DECL E6POS XSEEN={X 1.0,Y 2.0,Z 3.0,A 0.0,B 0.0,C 0.0}"
    files = corpus.backup()
    sub = files["KRC/R1/System/sps.sub"].replace(b"XSEEN.X=N", b"N=N+1")
    config = files[path].replace(b"DECL E6POS XSEEN", pose)
    program = read(changed(tmp_path, **{path: config, "KRC/R1/System/sps.sub": sub}))
    (target,) = [target for target in program.targets if target.name == "XSEEN"]
    assert (target.verdict, target.path.name) == ("skip", "$config.dat")
    assert "system file of the controller, which is never written" in target.reason


def test_of_two_robots_the_one_that_is_named_is_corrected(tmp_path: Path) -> None:
    folder = lay(tmp_path / "in", {name: data for name, data in corpus.two_robots().items() if "MILL" not in name})
    with pytest.raises(RefusedError, match=r"KRC/R1.*KRC/R2"):
        correct_programs([folder], Gradient(), on_guard="skip")
    with pytest.warns(UserWarning, match="left as they are: KRC/R1"):
        batch = correct_programs([folder], Gradient(), on_guard="skip", controllers=["krc/r2"])
    batch.write(tmp_path / "out")
    written = [path.relative_to(tmp_path / "out") for path in listing(tmp_path / "out") if path.suffix != ".csv"]
    assert {path.parts[:2] for path in written} == {("KRC", "R2"), ("KRC", "R2.corrections.json")}


def test_a_zip_is_corrected_like_the_folder_and_keeps_its_other_members(tmp_path: Path) -> None:
    files = corpus.few()
    folder, path = lay(tmp_path / "cell", files), tmp_path / "cell.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name in reversed(files):
            file.writestr(zipfile.ZipInfo(name, (2020, 5, 17, 8, 30, 2)), files[name])
    _, expected = corrected(folder, tmp_path / "a", derived=True)
    correct_programs([path], Gradient(), options=ReadOptions(derived=True), on_guard="skip").write(
        tmp_path / "b", whole=True
    )
    (output,) = [one for one in listing(tmp_path / "b") if one.suffix == ".zip"]
    with zipfile.ZipFile(output) as file:
        assert file.namelist() == list(reversed(files))
        assert {info.date_time for info in file.infolist()} == {(2020, 5, 17, 8, 30, 2)}
        assert {name: file.read(name) for name in file.namelist()} == expected
    assert expected != files


def test_a_file_with_an_endless_line_blocks_nothing_else(tmp_path: Path, program: Program) -> None:
    more = {"KRC/R1/Program/Long.src": b"DEF long()\n" + b"X" * 70_000, "KRC/R1/Program/curve.dat": b"1 " * 40_000}
    found = read_programs([changed(tmp_path, **more)])
    assert "at most 65536 are read" in str(found.unreadable[0])
    assert len(found.unreadable) == 1
    assert found.programs[0].counts() == program.counts()
    (backup,) = found.backups
    assert backup.controllers[0].contents.others[tmp_path / "KRC/R1/Program/curve.dat"] == "no program"
