"""Every maker's backup: as a .zip it reads as its folder does, and a correction of zero gives the same bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.programs.backups import abb, fanuc, kuka, small, staubli, universal_robots, yaskawa
from tests.programs.backups.test_output import raw, tree
from tests.programs.conftest import FakeMap

from truepose.programs import Program, read_programs
from truepose.programs.batch import correct_programs

Corpus = Callable[[Path], dict[str, bytes]]
CORPORA: dict[str, Corpus] = {
    "KUKA": lambda _: kuka.backup(),
    "ABB": lambda _: abb.backup(),
    "FANUC": lambda folder: tree(fanuc.write_backup(folder)),
    "Yaskawa": lambda _: yaskawa.backup(),
    "Stäubli": lambda _: staubli.backup(),
    "Universal Robots": lambda _: universal_robots.backup(),
}


@pytest.fixture(autouse=True)
def own_state(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path_factory.mktemp("state")))


def told(program: Program, root: Path) -> list[tuple[str, int, str, str, str]]:
    return [
        (str(t.path.relative_to(root)), t.line, t.name, t.verdict, t.reason.replace(str(root), ""))
        for t in program.targets
    ]


@pytest.mark.exhaustive
@pytest.mark.parametrize("maker", CORPORA)
def test_a_zip_reads_as_its_folder_does_and_zero_changes_nothing(maker: str, tmp_path: Path) -> None:
    files = CORPORA[maker](tmp_path / "made")
    folder = small.lay(tmp_path / "cell", files)
    archive = tmp_path / "cell.zip"
    archive.write_bytes(small.packed(files))
    one, other = read_programs([folder]), read_programs([archive])
    assert not one.unreadable
    assert not other.unreadable
    (controller,) = other.backups[0].controllers
    assert controller.maker == maker
    assert one.backups[0].controllers[0].left == controller.left
    assert [told(p, folder) for p in one.programs] == [told(p, archive) for p in other.programs]
    assert sum(program.counts()["correct"] for program in other.programs) > 50

    batch = correct_programs([archive], FakeMap(), on_guard="skip", keep_going=True)
    batch.write(tmp_path / "zero", whole=True)
    assert (tmp_path / "zero" / "cell.zip").read_bytes() == archive.read_bytes()
    assert (tmp_path / "zero" / "changed-files.csv").read_text().count("\n") == 1


@pytest.mark.exhaustive
@pytest.mark.parametrize("maker", CORPORA)
def test_a_correction_changes_files_with_programs_alone(maker: str, tmp_path: Path) -> None:
    files = CORPORA[maker](tmp_path / "made")
    archive = tmp_path / "cell.zip"
    archive.write_bytes(small.packed(files))
    batch = correct_programs([archive], FakeMap((0.25, -0.5, 0.125)), on_guard="skip", keep_going=True)
    batch.write(tmp_path / "out")
    batch.write(tmp_path / "whole", whole=True)
    before, after = raw(archive), raw(tmp_path / "whole" / "cell.zip")
    changed = {name for name in before if before[name] != after[name]}
    written = {name for name in tree(tmp_path / "out") if ".corrections." not in name} - {"changed-files.csv"}
    assert changed == written
    (controller,) = read_programs([archive]).backups[0].controllers
    programs = {file.relative_to(archive).as_posix() for some in controller.contents.programs for file in some}
    assert changed
    assert changed <= programs
