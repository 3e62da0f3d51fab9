"""A watch with a store: each program is allowed, corrected and recorded, and waits while the store is lost."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import sqlalchemy as sa
from scipy.spatial.transform import Rotation
from tests.io.test_archive import repacked
from tests.store.people import PASSWORD, join
from tests.store.plant import plant

import truepose as tp
from truepose.cli.store_record import Recorder, recorder
from truepose.cli.store_watch import StoreKeeper
from truepose.cli.watch import _watch
from truepose.errors import RefusedError, StoreError
from truepose.programs import FolderWatch
from truepose.store import records, schema
from truepose.store.releases import withdraw_map
from truepose.store.store import Store
from truepose.store.verify import verify

pytestmark = pytest.mark.usefixtures("quick_hashes")
_SETTINGS = {"on_guard": "skip", "accept_weak_map": True}


def krl(shift: float = 0.0) -> str:
    """Return a program through the targets of the plant's table, with the tool of its map."""
    tool = tp.load_map(plant().map).tf_flange_tool
    x, y, z = tool[:3, 3]
    a, b, c = tp.euler("kuka", Rotation.from_matrix(tool[:3, :3]))
    rows = np.loadtxt(plant().program, delimiter=",", skiprows=1, usecols=range(1, 7))
    lines = [
        f"LIN {{X {r[0] + shift:.3f},Y {r[1]:.3f},Z {r[2]:.3f},A {r[3]:.3f},B {r[4]:.3f},C {r[5]:.3f}}}" for r in rows
    ]
    head = f"DEF part()\n$TOOL={{X {x:.4f},Y {y:.4f},Z {z:.4f},A {a:.4f},B {b:.4f},C {c:.4f}}}\n$BASE=$NULLFRAME\n"
    return head + "\n".join(lines) + "\nEND\n"


@pytest.fixture
def folder(run: Callable[..., Any], address: str, tmp_path: Path) -> Path:
    """The plant, whose map the store has, with a program in the folder ``in``."""
    made = Path(shutil.copytree(plant().folder, tmp_path / "robot17"))
    assert run("store", "import", made / "map.truepose", "--store", address).code == 0
    (made / "in").mkdir()
    (made / "in" / "part.src").write_text(krl())
    return made


@pytest.fixture
def watched(folder: Path, address: str) -> Iterator[FolderWatch]:
    with recorder(address, "correct") as record:
        assert record is not None
        error_map, row = record.load_map(folder / "map.truepose")
        keeper = StoreKeeper(record, row)
        yield FolderWatch(folder / "in", folder / "out", error_map, settings=dict(_SETTINGS), settle_s=0, keeper=keeper)


def corrections(address: str) -> list[tuple[str, bool]]:
    """Return the programs of the corrections of a store whose chain is whole, and whether their map was a draft."""
    correction, program = schema.correction, schema.program
    with Store.open(address) as store:
        assert verify(store).faults == []
        with store.reading() as connection:
            query = sa.select(program.c.name, correction.c.draft).join(program, program.c.id == correction.c.program_id)
            return [(name, draft) for name, draft in connection.execute(query)]


def test_the_command_corrects_and_records_once(run: Callable[..., Any], folder: Path, address: str) -> None:
    command = ("watch", folder / "map.truepose", folder / "in", folder / "out", "--once", "--settle", 0)
    command = (*command, "--on-guard", "skip", "--accept-weak-map", "--store", address)
    refused = run(*command, "--released-only")
    assert "is a draft, but only a released map may be used" in refused.failed()
    assert not (folder / "out").exists()
    done = run(*command)
    assert done.code == 0, done
    assert "6 of 6 motion targets corrected" in done.out
    assert "DRAFT" in done.out
    assert '"map_state": "draft"' in (folder / "out" / "part.corrections.json").read_text()
    assert corrections(address) == [("part.src", True)]
    assert "none of them new or changed" in run(*command).out
    (folder / "in" / "again.src").write_bytes((folder / "out" / "part.src").read_bytes())
    assert "again.src: was corrected already" in run(*command).failed()
    assert corrections(address) == [("part.src", True)]


@pytest.mark.promise("A store recognises a corrected program by its positions, under another name, on another machine.")
def test_a_renamed_module_is_not_corrected_twice(
    run: Callable[..., Any], folder: Path, address: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    options = ("--on-guard", "skip", "--accept-weak-map", "--store", address)
    assert run("correct", folder / "map.truepose", folder / "in", "--out", folder / "out", *options).code == 0
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "another machine"))
    text = (folder / "out" / "part.src").read_text().replace("DEF part()", "; edited\nDEF weld()")
    (folder / "copies").mkdir()
    copy = folder / "copies" / "weld.src"
    copy.write_text(text)
    (folder / "map.truepose.corrected").unlink()
    pattern = r"weld\.src: holds 6 positions that were corrected: on 20.* with the map map \(\w{12}\), from part\.src"
    for named in (folder / "map.truepose", "map"):
        for source in (copy, copy.parent):
            refused = run("correct", named, source, "--out", folder / "twice", *options).failed()
            assert re.search(pattern, refused)
    watched = ("watch", folder / "map.truepose", copy.parent, folder / "twice", "--once", "--settle", 0, *options)
    assert re.search(pattern, run(*watched).failed())
    assert not (folder / "twice").exists()
    lines = text.splitlines(keepends=True)
    # one of them is too far off now to be corrected
    fresh = [line.replace("Z ", "Z 1") for line in lines if line.startswith("LIN")]
    copy.write_text("".join([*lines[:5], *fresh[1:], *lines[-1:]]))
    done = run("correct", folder / "map.truepose", copy, "--out", folder / "twice", *options)
    assert "weld.src: 1 of its 5 positions are results of a correction: on 20" in done.out
    assert "1 of its 5 positions" in (folder / "twice" / "weld.corrections.json").read_text()
    assert [name for name, _ in corrections(address)] == ["part.src", "weld.src"]


@pytest.mark.promise("A store knows a map that another program packed again.")
def test_a_map_that_was_packed_again_is_the_same(
    run: Callable[..., Any], folder: Path, address: str, tmp_path: Path
) -> None:
    path = folder / "map.truepose"
    own = tp.load_map(path).hash
    path.write_bytes(repacked(path.read_bytes(), "times"))
    assert hashlib.sha256(path.read_bytes()).hexdigest() != own
    assert tp.load_map(path).hash == own
    common = ("--on-guard", "skip", "--accept-weak-map", "--store", address)
    done = run("correct", path, folder / "in" / "part.src", "--out", folder / "out", *common)
    assert done.code == 0, done
    assert f'"map_sha256": "{own}"' in (folder / "out" / "part.corrections.json").read_text()
    assert "nothing new" in run("store", "import", path, "--store", address).out
    assert len(run("store", "recall", "map", "--store", address, "--json").json["corrections"]) == 1
    other = tmp_path / "other"
    Store.open(other, create=True).close()
    assert run("store", "import", path, "--store", other).code == 0
    assert run("store", "recall", own, "--store", other).code == 0


def test_released_only_needs_a_store(run: Callable[..., Any], tmp_path: Path) -> None:
    done = run("watch", tmp_path / "map.truepose", tmp_path, tmp_path / "out", "--released-only")
    assert "--store" in done.failed()


def test_a_store_lost_before_a_correction_writes_nothing_and_the_program_waits(
    watched: FolderWatch, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(Store, "reading", _lost)
        with pytest.raises(StoreError):
            list(watched.poll(1.0))
    assert not watched.out_dir.exists()
    (event,) = watched.poll(2.0)
    assert event.refused == ""
    assert len(corrections(address)) == 1
    assert list(watched.poll(3.0)) == []


def test_a_correction_that_was_written_is_recorded_when_the_store_is_back(
    watched: FolderWatch, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(records, "put_correction", _lost)
        with pytest.raises(StoreError, match="more are written, but the store has no row of it: the watch records it"):
            list(watched.poll(1.0))
    written = (watched.out_dir / "part.src").read_bytes()
    assert corrections(address) == []
    (event,) = watched.poll(2.0)
    assert {path.name for path in event.written} >= {"part.src", "part.corrections.json"}
    assert (watched.out_dir / "part.src").read_bytes() == written
    assert len(corrections(address)) == 1
    assert list(watched.poll(3.0)) == []


def test_a_watch_that_ended_without_a_row_is_made_good_by_the_next(
    watched: FolderWatch, folder: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(records, "put_correction", _lost)
        with pytest.raises(StoreError):
            list(watched.poll(1.0))
    again = FolderWatch(
        folder / "in", folder / "out", watched.error_map, settings=dict(_SETTINGS), settle_s=0, keeper=watched.keeper
    )
    assert [event.refused for event in again.once(lambda _: None)] == [""]
    assert len(corrections(address)) == 1
    assert again.once(lambda _: None) == []


def test_a_map_that_is_withdrawn_ends_the_watch(watched: FolderWatch, folder: Path, address: str) -> None:
    keeper = watched.keeper
    assert isinstance(keeper, StoreKeeper)
    with Store.open(address) as store:
        team = join(store, ben=["program"], eva=["release"])
        keeper.record = Recorder(store, team["ben"], address, "correct")
        assert [event.refused for event in watched.once(lambda _: None)] == [""]
        withdraw_map(store, team["eva"], "map", PASSWORD, "the reflector was loose")
        _refuses_more(watched, folder)


def _refuses_more(watched: FolderWatch, folder: Path) -> None:
    (folder / "in" / "other.src").write_text(krl(2.0))
    with pytest.raises(RefusedError, match="is withdrawn; use the released map of the cell"):
        list(watched.poll(11.0))
    assert not (folder / "out" / "other.src").exists()


def _lost(*_: object, **__: object) -> Any:
    raise StoreError("the store cannot be reached")


def test_a_lost_store_is_said_once_and_again_when_it_is_back(capsys: pytest.CaptureFixture[str]) -> None:
    class Looks:
        results: Iterator[Any] = iter([StoreError("gone"), StoreError("gone"), ["part.src: 6 of 6"], []])

        def poll(self) -> Any:
            try:
                found = next(self.results)
            except StopIteration:
                raise KeyboardInterrupt from None
            if isinstance(found, StoreError):
                raise found
            return found

    with pytest.raises(KeyboardInterrupt):
        _watch(cast("FolderWatch", Looks()), 0.0)
    said = [line.partition("  ")[2] for line in capsys.readouterr().out.splitlines()]
    assert said == [
        "gone; new programs wait until the store is back",
        "part.src: 6 of 6",
        "the store is back",
    ]
