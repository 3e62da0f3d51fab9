"""Commands tell other programs in JSON lines on stderr what they do, and end when these programs end."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from truepose.cli import app, events
from truepose.cli.output import working
from truepose.errors import FileError, RefusedError
from truepose.problem import problem

LONG = 120.0
"""Seconds after which a test waits in vain."""
SLOW = ("study", "--seeds", "1000", "--per-axis", "4", "--json")
"""A command that takes minutes."""


@pytest.fixture
def wanted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRUEPOSE_EVENTS", "json")


def told(err: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in err.splitlines()]


@pytest.fixture
def study(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A slow command whose first count has been read."""
    environment = {
        **os.environ,
        "TRUEPOSE_EVENTS": "json",
        "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)),
    }
    with subprocess.Popen(
        [sys.executable, "-m", "truepose", *SLOW],
        cwd=tmp_path,
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        while json.loads(process.stderr.readline())["event"] != "step":
            pass
        yield process
        process.kill()


@pytest.mark.usefixtures("wanted")
@pytest.mark.parametrize("quiet", [True, False])
def test_steps_and_the_last_count_of_each_are_events(capsys: pytest.CaptureFixture[str], quiet: bool) -> None:
    with working("Reading", quiet=quiet) as steps:
        for step, total in (("First", 1000), ("Second", 3)):
            steps(step)
            for done in range(1, total):
                steps.count(done, total)
    out, err = capsys.readouterr()
    found = told(err)
    assert out == ""
    assert [one["step"] for one in found if one["event"] == "step"] == ["Reading", "First", "Second"]
    second = found.index({"event": "step", "step": "Second"})
    assert found[second - 1] == {"event": "count", "done": 999, "total": 1000}
    assert found[-1] == {"event": "count", "done": 2, "total": 3}


@pytest.mark.usefixtures("wanted")
def test_counts_are_rare_but_a_complete_one_is_written_at_once(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter(range(1000))
    monkeypatch.setattr("truepose.cli.events.time.monotonic", lambda: next(clock) / 100)
    steps = events.EventSteps("Fitting")
    for done in range(1, 101):  # 0.01 s apart
        steps.count(done, 100)
    counts = [one["done"] for one in told(capsys.readouterr().err) if one["event"] == "count"]
    assert counts[-1] == 100
    assert 9 <= len(counts) <= 12
    assert counts == sorted(counts)


@pytest.mark.usefixtures("wanted")
def test_the_compilation_of_kernels_is_a_step(capsys: pytest.CaptureFixture[str]) -> None:
    from truepose.numerics import first_use

    with working("Fitting", quiet=True):
        first_use._announcements[-1]()
    assert told(capsys.readouterr().err)[-1]["step"].startswith("Fitting (compiling")


@pytest.mark.usefixtures("wanted")
def test_warnings_and_the_error_of_a_file_are_events(run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        warnings.warn("few digits\nleft", stacklevel=1)
        error = FileError(tmp_path / "a.csv", "has no header", line=3)
        error.add_note("--keep-going reads the others")
        raise error

    monkeypatch.setattr("truepose.robots.list_robots", fail)
    monkeypatch.setattr("truepose.robots.io.library.list_robots", fail)
    done = run("robots")
    warned, failed = told(done.err)
    assert done.code == 1
    assert warned == {"event": "warning", "message": "few digits left"}
    assert failed.pop("event") == "problem"
    assert failed["type"] == "FileError"
    assert (failed["file"], failed["line"]) == (str(tmp_path / "a.csv"), 3)
    assert failed["remedy"] == "--keep-going reads the others"
    assert failed["detail"].startswith(f"{tmp_path / 'a.csv'}:3: has no header")


@pytest.mark.parametrize("arguments", [("fit",), ("no-such-command",), ("study", "--seeds", "many"), ("--no-option",)])
def test_wrong_usage_is_one_problem(run: Any, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]) -> None:
    shown = run(*arguments)
    monkeypatch.setenv("TRUEPOSE_EVENTS", "json")
    done = run(*arguments)
    (found,) = told(done.err)
    assert done.code == shown.code == 2
    assert (found["event"], found["type"], done.out) == ("problem", "UsageError", "")


@pytest.mark.usefixtures("wanted")
@pytest.mark.parametrize(
    ("error", "kind", "status"),
    [
        (MemoryError(), "MemoryError", 507),
        (OSError(28, "No space left on device"), "DiskFullError", 507),
        (PermissionError(13, "Permission denied", "a.csv"), "OSError", 500),
        (RefusedError("too weak"), "RefusedError", 409),
        (RuntimeError("two\nlines"), "InternalError", 500),
        (KeyboardInterrupt(), "Interrupted", 503),
    ],
)
def test_every_error_has_a_kind_and_a_status(
    run: Any, monkeypatch: pytest.MonkeyPatch, error: BaseException, kind: str, status: int
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.setattr("truepose.robots.list_robots", fail)
    monkeypatch.setattr("truepose.robots.io.library.list_robots", fail)
    done = run("robots")
    (found,) = told(done.err)
    assert (found["type"], found["status"]) == (kind, status)
    assert found["title"]
    assert done.code == (130 if kind == "Interrupted" else 1)


def test_errors_with_a_status_and_title_of_their_own_keep_them() -> None:
    class MissingError(FileError):
        status, title = 404, "Not found"

    found = problem(MissingError("a.csv", "is not here"))
    assert (found["type"], found["status"], found["title"]) == ("FileError", 404, "Not found")


def test_results_and_exit_codes_are_the_same_with_events(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = run("robots", "--json")
    monkeypatch.setenv("TRUEPOSE_EVENTS", "json")
    assert run("robots", "--json") == plain
    assert run("--version").out.startswith("truepose ")
    assert {command.name for command in app.registered_commands} >= {"robots"}


@pytest.mark.exhaustive
def test_a_command_ends_as_by_an_interrupt_when_its_parent_is_gone(study: subprocess.Popen[str]) -> None:
    assert study.stdin is not None
    study.stdin.close()
    assert study.wait(timeout=LONG) == 130
    assert study.stderr is not None
    last = json.loads(study.stderr.read().splitlines()[-1])  # compiled code may have written texts of its own
    assert (last["event"], last["type"]) == ("problem", "Interrupted")


def test_a_command_that_does_not_react_ends_a_little_later() -> None:
    code = (
        "import os, signal, time; from truepose import cli, robots; from truepose.cli import events\n"
        "os.environ[events.VARIABLE], events._GRACE = 'json', 0.2\n"
        "def stuck():\n"
        "    signal.signal(signal.SIGINT, signal.SIG_IGN); print('begun', flush=True); time.sleep(300)\n"
        "    print('not ended')\n"
        "robots.list_robots = stuck; cli.main()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, "robots"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        process.stdin.close()
        assert process.stdout.read() == ""
    assert process.returncode == 130


def test_an_interrupt_that_compiled_code_ignores_ends_the_command() -> None:
    code = (
        "import ctypes, signal; from truepose import cli, robots\n"
        "def ignored(): signal.raise_signal(signal.SIGINT)\n"
        "def fail(): ctypes.CFUNCTYPE(None)(ignored)(); return ['wrong']\n"
        "robots.list_robots = fail; cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code, "robots", "--json"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "truepose: interrupted; no file was written\n"


@pytest.mark.exhaustive
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="needs signals")
def test_a_command_whose_parent_is_killed_is_gone(tmp_path: Path) -> None:
    code = (
        "import subprocess, sys; p = subprocess.Popen([sys.executable, '-m', 'truepose', *sys.argv[1:]],"
        " stdin=subprocess.PIPE, stderr=subprocess.PIPE); p.stderr.readline(); print(p.pid, flush=True); p.wait()"
    )
    environment = {
        **os.environ,
        "TRUEPOSE_EVENTS": "json",
        "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path)),
    }
    parent = subprocess.Popen(
        [sys.executable, "-c", code, *SLOW], cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    ends = time.monotonic() + LONG
    while _lives(child) and time.monotonic() < ends:
        time.sleep(0.05)
    assert not _lives(child)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{process}/stat")
    return not (state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z")  # nobody waits for it
