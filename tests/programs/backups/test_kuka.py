"""A backup of a KUKA controller: recognised, read with its frames, corrected; checked by a reader of its own."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.programs.backups import kuka as corpus

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions
from truepose.programs.backups import kuka
from truepose.programs.krl.reader import read_project

SHIFT = np.array([0.41, -0.33, 0.27])
GRADIENT = 1e-4 * np.array([[1.0, -0.5, 0.0], [0.25, 0.75, -1.0], [0.5, 0.0, 0.6]])


def lay(folder: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder


def listing(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def read(folder: Path, root: Path | None = None, **options: Any) -> Program:
    """Read the programs of a robot with the frames of its controller."""
    files = listing(folder)
    root = root or kuka.roots(files)[0]
    stored = kuka.stored_frames(root, files)
    tools = {key: one.tf for key, one in stored.tools.items() if not one.problem}
    bases = {key: one.tf for key, one in stored.bases.items() if not one.problem}
    table = FrameTable(tools, bases, in_world=frozenset(bases))
    assert stored.tf_world_base is not None
    table = table.standing_at(stored.tf_world_base, "$machine.dat")
    (programs,) = kuka.contents(root, files).programs
    return read_project(root, programs, table, ReadOptions(**options), **kuka.for_reader(root, files))


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
    a, b, c = np.deg2rad(values[3:])
    z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    x = np.array([[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]])
    tf = np.eye(4)
    tf[:3, :3], tf[:3, 3] = z @ y @ x, values[:3]
    return tf


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
    assert "fixed" not in stored.tools[5].problem
    assert "a part in the gripper (TOOL_TYPE[5]=#TCP)" in stored.tools[5].problem
    assert "it moves with DKP 400 (EASYS)" in stored.bases[17].problem
    assert not any(one.problem for number, one in stored.bases.items() if number != 17)
    assert stored.bases[9].name == ""


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


def test_two_robots_have_their_own_programs_frames_and_places(tmp_path: Path, program: Program) -> None:
    folder = lay(tmp_path, corpus.two_robots())
    files = listing(folder)
    assert kuka.roots(files) == [folder / "KRC/R1", folder / "KRC/R2"]
    first, second = (read(folder, root) for root in kuka.roots(files))
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
        ("System/$config.dat", b"BASE_DATA[2]={", b"BASE_DATA[1]={", r"dat:\d+: BASE_DATA\[1\] was given in line \d+"),
        ("System/$config.dat", b"BASE_DATA[2]={X ", b"BASE_DATA[2]={X 1.2.", r"dat:\d+: X 1\.2\.\S+ is not a number"),
        ("Mada/$machine.dat", b"$ROBROOT={X 250", b"$ROBROOT={X 251", r"MACHINE_DEF\[1\] has another place .* make"),
        ("Mada/$machine.dat", b"FRAME $ROBROOT={X", b"FRAME $ROBROOT={N 1,X", r"ROBROOT is not the null frame, nor"),
    ],
)
def test_frames_that_are_broken_or_contradict_each_other(
    tmp_path: Path, name: str, old: bytes, new: bytes, message: str
) -> None:
    path = f"KRC/R1/{name}"
    assert old in corpus.backup()[path]
    folder = changed(tmp_path, **{path: corpus.backup()[path].replace(old, new)})
    with pytest.raises(FileError, match=message):
        kuka.stored_frames(folder / "KRC/R1", listing(folder))


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
    assert "named by a system module that cannot be read (grip.src, line 1)" in why
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
    assert all("named by a system module that cannot be read" in why for why in of_global)


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
