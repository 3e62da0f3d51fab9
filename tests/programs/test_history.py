"""A program that holds corrected digits is recognised wherever it lies."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.programs.corpus import CORPUS

from truepose.errors import FileError, RefusedError
from truepose.programs import correct_program, history, read_programs
from truepose.programs.corrected import write
from truepose.programs.record import json_pieces

N = 12


@pytest.fixture
def path(tmp_path: Path) -> Path:
    lines = [f"LIN {{X {800 + 7 * i}.25,Y {i}.5,Z 900.0,A 0.0,B 90.0,C 0.0}}" for i in range(N)]
    file = tmp_path / "a.src"
    file.write_text("DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\n" + "\n".join(lines) + "\nEND\n")
    return file


@pytest.fixture
def corrected(path: Path, make_map: Any, tmp_path: Path) -> Path:
    """The corrected program in a folder of its own, without its record."""
    correct_program(path, make_map([0.2, -0.1, 0.3])).write(tmp_path / "out")
    moved = tmp_path / "elsewhere" / "b.src"
    moved.parent.mkdir()
    (tmp_path / "out" / "a.src").replace(moved)
    return moved


@pytest.mark.promise("A corrected program that was moved and renamed is not corrected again, whatever the map.")
def test_moved_and_renamed(corrected: Path, path: Path, make_map: Any, state: Path) -> None:
    with pytest.raises(
        RefusedError, match=r"b\.src: was corrected already \(a\.src, .*; .* take the original"
    ) as error:
        correct_program(corrected, make_map([0.0, 0.0, 1.0], hash="1" * 64))
    assert str(state / "corrected.jsonl") in str(error.value)
    assert correct_program(path, make_map([0.2, 0.0, 0.0])).summary()["corrected"] == N


@pytest.mark.promise(
    "A corrected program is refused also when lines were edited, as long as three corrected positions are left."
)
@pytest.mark.parametrize("kept", range(N + 1))
def test_edited(corrected: Path, make_map: Any, kept: int) -> None:
    head, *moves = corrected.read_text().split("LIN ")
    moves = [move if i < kept else move.replace("900.3", "950.0") for i, move in enumerate(moves)]
    corrected.write_text("; edited\n".join(["", head]) + "LIN " + "LIN ".join(moves))
    if kept >= 3:
        with pytest.raises(RefusedError, match=f"b.src: holds {kept} positions that were corrected"):
            correct_program(corrected, make_map([0.2, 0.0, 0.0]))
    else:
        assert correct_program(corrected, make_map([0.2, 0.0, 0.0])).summary()["corrected"] == N


@pytest.mark.promise("A program of a few targets is recognised by half of them.")
def test_few_targets(corrected: Path, make_map: Any) -> None:
    head, first, *_ = corrected.read_text().split("LIN ")
    fresh = "LIN {X 1000.0,Y 2.0,Z 3.0,A 0.0,B 90.0,C 0.0}\n"
    for others, refused in ((0, True), (1, True), (2, False)):
        corrected.write_text(f"{head}LIN {first}{fresh * others}END\n")
        if others == 2:
            corrected.write_text(f"{head}LIN {first}{fresh}{fresh.replace('1000', '1010')}END\n")
        if refused:
            with pytest.raises(RefusedError, match="holds 1 positions"):
                correct_program(corrected, make_map([0.2, 0.0, 0.0]))
        else:
            correct_program(corrected, make_map([0.2, 0.0, 0.0]))


@pytest.mark.promise("The record beside the map tells another user of the map.")
def test_beside_the_map(path: Path, make_map: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    error_map = make_map([0.2, 0.0, 0.0])
    error_map.path = tmp_path / "m.truepose"
    correct_program(path, error_map).write(tmp_path / "out")
    (tmp_path / "out" / "a.src").rename(tmp_path / "b.src")
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "other"))
    with pytest.raises(RefusedError, match=r"listed in .*m\.truepose\.corrected"):
        correct_program(tmp_path / "b.src", error_map)
    assert json.loads((tmp_path / "m.truepose.corrected").read_text())["file"] == "a.src"


def test_what_was_not_written_or_not_changed_is_not_remembered(
    path: Path, make_map: Any, tmp_path: Path, state: Path
) -> None:
    correct_program(path, make_map([0.2, 0.0, 0.0])).diff()
    correct_program(path, make_map([0.0, 0.0, 0.0])).write(tmp_path / "out")
    assert not (state / "corrected.jsonl").exists()


@pytest.mark.promise("Where corrections cannot be remembered nothing is written.")
def test_a_store_that_cannot_be_written(path: Path, make_map: Any, tmp_path: Path, state: Path) -> None:
    (state / "corrected.jsonl").mkdir()
    made = correct_program(path, make_map([0.2, 0.0, 0.0]))
    with pytest.raises(FileError, match=r"corrected programs are remembered there.*set TRUEPOSE_STATE"):
        made.write(tmp_path / "out")
    with pytest.raises(FileError, match="set TRUEPOSE_STATE"):
        made.write_in_place()
    assert [p.name for p in tmp_path.iterdir()] == ["a.src"]


def test_a_damaged_store_still_counts(corrected: Path, make_map: Any, state: Path) -> None:
    store = state / "corrected.jsonl"
    whole = store.read_bytes()
    store.write_bytes(b'{"date": "2\n[1]\n\xff\n{}\n' + b"[" * 100_000 + b"\n" + whole + whole[:40])
    with pytest.warns(UserWarning, match="is no readable record"), pytest.raises(RefusedError):
        correct_program(corrected, make_map([0.2, 0.0, 0.0]))


@pytest.mark.promise("All programs of one command are written, or none.")
def test_several_programs_at_once(path: Path, make_map: Any, tmp_path: Path) -> None:
    second = tmp_path / "b.src"
    second.write_text(path.read_text().replace("LIN", "PTP"))
    both = [correct_program(p, make_map([0.2, 0.0, 0.0])) for p in (path, second)]
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "b.src").write_bytes(b"earlier")
    with pytest.raises(FileError, match=r"b\.src: exists already"):
        write(both, tmp_path / "out")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["b.src"]
    write(both, tmp_path / "out", force=True)
    assert len(list((tmp_path / "out").iterdir())) == 6


@pytest.mark.parametrize("seed", range(5))
def test_positions_shared_with_each_entry_are_counted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    listed, owner = rng.integers(0, 50, 300).astype(np.uint64), rng.integers(0, 7, 300)
    order = np.argsort(listed, kind="stable")
    entries = tuple(history.Entry("", "", str(i)) for i in range(8))
    own = np.unique(rng.integers(0, 70, 20).astype(np.uint64))
    found = history.KnownCorrections(entries, listed[order], owner[order]).shared(own)
    assert found.tolist() == np.bincount(owner[np.isin(listed, own)], minlength=8).tolist()


def test_a_correction_that_was_repeated_is_listed_once(tmp_path: Path) -> None:
    line = '{"date": "2026-01-02", "file": "a.src", "sha256_after": "%s", "positions": "AQAAAAAAAAA="}\n'
    (tmp_path / "list").write_text((line % "aa") * 5 + line % "bb" + line.replace("AQAA", "AgAA") % "aa")
    found = history._listed(tmp_path / "list")
    assert [entry.after for entry in found.entries] == ["aa", "bb", "aa"]
    assert found.positions.tolist() == [1, 1, 2]


ONE_OF_EACH = {
    Path(next(iter(example.files))).suffix.lower(): example
    for example in CORPUS.values()
    if example.correct > 0 and example.refuse == 0
}
"""A program of each ending, with targets that can be corrected."""


@pytest.mark.promise(
    "A corrected program is recognised by its positions in every language, by a list and by a record alone, "
    "under another name and with other text."
)
@pytest.mark.parametrize("ending", sorted(ONE_OF_EACH))
def test_every_language(ending: str, make_map: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example, error_map = ONE_OF_EACH[ending], make_map([0.21, -0.13, 0.34])
    for name, data in example.data().items():
        (tmp_path / name).write_bytes(data)
    asked = {"frames": example.frames, "options": example.options}
    first = tmp_path / next(iter(example.files))
    done = correct_program(first, error_map, on_guard="skip", **asked)
    assert done.summary()["corrected"] >= 1
    done.write(tmp_path / "out")
    (record,) = (tmp_path / "out").glob("*.corrections.json")
    older = json.loads(record.read_text())
    assert all(
        entry.pop("positions", "") or entry["sha256_before"] == entry["sha256_after"] for entry in older["files"]
    )
    head = {key: value for key, value in older.items() if key != "targets"}
    lines = json_pieces(head, [[json.dumps(one) for one in older["targets"]]])
    for name, text in (("new", record.read_bytes()), ("old", b"".join(lines)), ("listed", None)):
        folder = tmp_path / name
        folder.mkdir()
        for source in done.program.sources:
            data = (tmp_path / "out" / source.path.name).read_bytes()
            (folder / f"renamed{source.path.suffix}").write_bytes(data + b"\n")
        with monkeypatch.context() as patch:
            if text is not None:
                (folder / record.name).write_bytes(text)
                patch.setenv("TRUEPOSE_STATE", str(tmp_path / "of another user"))
            where = "listed in" if text is None else f"see {record.name}"
            with pytest.raises(RefusedError, match=rf"holds \d+ positions that were corrected.*{where}"):
                correct_program(folder / f"renamed{first.suffix}", error_map, on_guard="skip", **asked)


@pytest.mark.promise("Single targets that an earlier correction wrote are named.")
@pytest.mark.parametrize("kept", [1, 2])
def test_single_corrected_targets_are_named(corrected: Path, make_map: Any, kept: int) -> None:
    head, *moves = corrected.read_text().split("LIN ")
    corrected.write_text(
        head + "".join(f"LIN {m if i < kept else m.replace('900.3', '950')}" for i, m in enumerate(moves))
    )
    found = correct_program(corrected, make_map([0.2, 0.0, 0.0])).warnings
    assert f"{kept} of its {N} positions are results of a correction (a.src, " in found[0]
    assert found[0].count("in line ") == kept
    assert "line 4" in found[0]


def test_a_small_module_of_a_large_project_is_recognised(corrected: Path, make_map: Any, tmp_path: Path) -> None:
    head, *moves = corrected.read_text().split("LIN ")
    project = tmp_path / "project"
    project.mkdir()
    (project / "small.src").write_text(head.replace("a()", "small()") + f"LIN {moves[0]}LIN {moves[1]}END\n")
    fresh = "".join(f"LIN {{X {700 + 3 * i},Y 2,Z 3,A 0,B 90,C 0}}\n" for i in range(50))
    (project / "large.src").write_text(head.replace("a()", "large()") + fresh + "small()\nEND\n")
    found = read_programs([project]).programs
    assert max(len(program.sources) for program in found) == 2
    with pytest.raises(RefusedError, match=r"small\.src: holds 2 positions that were corrected"):
        correct_program(found[0], make_map([0.2, 0.0, 0.0]), on_guard="skip")
