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
