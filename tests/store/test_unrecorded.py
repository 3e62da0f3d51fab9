"""A run that is killed between the files and the rows of its corrections: the next run writes the rows."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.store.plant import plant
from tests.store.test_watch import corrections, krl

from truepose.cli import store_record
from truepose.store import records, unrecorded
from truepose.store.store import Store

pytestmark = [
    pytest.mark.usefixtures("quick_hashes"),
    pytest.mark.skipif(not hasattr(os, "fork"), reason="the run that is killed is forked"),
]
_OPTIONS = ("--on-guard", "skip", "--accept-weak-map")
_KILLED = 77
_STEPS = {
    "contents": (unrecorded, "prepare"),
    "first rename": (Path, "replace"),
    "second rename": (Path, "replace"),
    "last rename": (Path, "replace"),
    "rows": (store_record, "record_corrections"),
    "one row": (records, "put_correction"),
    "removal of the note": (unrecorded.RowsNote, "remove"),
}
_CALL = {"second rename": 2, "last rename": 4}


@pytest.fixture
def folder(run: Callable[..., Any], address: str, tmp_path: Path) -> Path:
    made = Path(shutil.copytree(plant().folder, tmp_path / "robot17"))
    assert run("store", "import", made / "map.truepose", "--store", address).code == 0
    (made / "in").mkdir()
    (made / "in" / "part.src").write_text(krl())
    return made


def killed(monkeypatch: pytest.MonkeyPatch, step: str, work: Callable[[], Any]) -> None:
    """Do some work in a process that is killed before a step."""
    place, name = _STEPS[step]
    left, real = _CALL.get(step, 1), getattr(place, name)

    def dies(*arguments: Any, **named: Any) -> Any:
        nonlocal left
        left -= 1
        return os._exit(_KILLED) if left == 0 else real(*arguments, **named)

    if (child := os.fork()) == 0:
        try:
            monkeypatch.setattr(place, name, dies)
            if step == "rows":  # the names that commands have imported
                monkeypatch.setattr("truepose.cli.programs.record_corrections", dies)
                monkeypatch.setattr("truepose.cli.store_watch.record_corrections", dies)
            work()
        finally:
            os._exit(1)  # never back into pytest in a child
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == _KILLED


@pytest.mark.promise("After a run that was killed at any step, each corrected program has its row after the next run.")
@pytest.mark.parametrize("step", [pytest.param(s, marks=() if s == "rows" else pytest.mark.exhaustive) for s in _STEPS])
@pytest.mark.parametrize("way", ["correct", pytest.param("watch", marks=pytest.mark.exhaustive)])
def test_the_next_run_writes_the_rows(
    run: Callable[..., Any], folder: Path, address: str, monkeypatch: pytest.MonkeyPatch, step: str, way: str
) -> None:
    out, source = folder / "out", folder / "in"
    more = ("--once", "--settle", 0) if way == "watch" else ()
    places = (source, out) if way == "watch" else (source, "--out", out)
    command = (way, folder / "map.truepose", *places, *more, *_OPTIONS, "--store", address)
    killed(monkeypatch, step, lambda: run(*command))
    (source / "part.src").unlink()  # the note needs no original
    done = run("store", "recall", "map", "--store", address)
    assert done.code == 0, done
    written = [path.name for path in out.glob("*")] if out.exists() else []
    rows = corrections(address)
    assert len(rows) == len(set(written) & {"part.src"}) == (step not in ("contents", *_CALL, "first rename"))
    assert ("recorded 1 correction of" in done.err) == bool(rows) or step == "removal of the note"
    assert not list(out.glob(".truepose-*.rows"))
    assert "part.src" in done.out or not rows
    assert run("store", "recall", "map", "--store", address).err == ""


@pytest.mark.promise("Until the rows are written, runs in the folder say that they are missing.")
def test_missing_rows_are_said_and_written_by_another_user(
    run: Callable[..., Any], folder: Path, address: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    command = ("correct", folder / "map.truepose", folder / "in" / "part.src", *_OPTIONS, "--out", folder / "out")
    killed(monkeypatch, "rows", lambda: run(*command, "--store", address))
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "another user"))
    other = tmp_path / "other"
    Store.open(other, create=True).close()
    assert run("store", "import", folder / "map.truepose", "--store", other).code == 0
    (folder / "in" / "more.src").write_text(krl(1.0))
    more = ("correct", folder / "map.truepose", folder / "in" / "more.src", *_OPTIONS, "--out", folder / "out")
    for store in ((), ("--store", other)):
        said = run(*more, "--force", *store)
        assert said.code == 0, said
        assert "corrections of an interrupted run have no row in the store" in said.err
    assert corrections(address) == []
    assert "recorded 1 correction of" in run(*command, "--force", "--store", address).err
    assert corrections(address) == [("part.src", True)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("lost", ["record", "program"])
def test_a_row_that_cannot_be_written_is_said_until_it_is(
    run: Callable[..., Any], folder: Path, address: str, monkeypatch: pytest.MonkeyPatch, lost: str
) -> None:
    out = folder / "out"
    program = folder / "in" / "part.src"
    command = ("correct", folder / "map.truepose", program, *_OPTIONS, "--out", out, "--store", address)
    killed(monkeypatch, "rows", lambda: run(*command))
    gone = out / ("part.corrections.json" if lost == "record" else "part.src")
    gone.rename(folder / "kept")
    for _ in range(2):
        said = run("store", "recall", "map", "--store", address)
        assert said.code == 0
        if lost == "record":
            assert "part.corrections.json: is missing; put it back, or remove" in said.err
    assert len(corrections(address)) == (lost == "program")  # whose content the store has
    (folder / "kept").rename(gone)
    run("store", "recall", "map", "--store", address)
    assert corrections(address) == [("part.src", True)]


@pytest.mark.exhaustive
def test_a_program_that_was_corrected_in_place(
    run: Callable[..., Any], folder: Path, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ("correct", folder / "map.truepose", folder / "in", *_OPTIONS, "--in-place", "--store", address)
    killed(monkeypatch, "rows", lambda: run(*command))
    again = run(*command)
    assert again.code == 1
    assert "was corrected already" in again.err
    assert "recorded 1 correction of" in again.err
    assert corrections(address) == [("part.src", True)]
