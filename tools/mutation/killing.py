"""Run the tests that reach a mutant, each mutant in a process of its own.

The process is forked from one that has imported what the tests need, but not the package. The test files are collected
one after the other, the quickest first, so that a mutant that the first test kills costs hardly more than this test.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Literal

import pytest

from mutation.mutants import Mutant
from mutation.recording import PYTEST, RecordedTest
from mutation.settings import Settings

Outcome = Literal["default", "complete", "survived", "unreached", "equivalent"]
_LIMIT = 60.0
"""Seconds that a test may take in addition to ten times its usual time."""
_COLLECTING = 300.0
_QUICK, _FIRST = 0.5, 20
"""Seconds of a quick test, and the number of those of a file that run before all others."""


@dataclass(frozen=True)
class Result:
    """What became of a mutant.

    Attributes
    ----------
    key, file, line, before, after
        The mutant.
    outcome : {"default", "complete", "survived", "unreached", "equivalent"}
        The tier that killed it; or it survived, no test reaches it, or it was reviewed and has no effect.
    by : str
        The test that killed it, with "(time limit)" or "(process ended)" where it did not end; the reason, if it was
        reviewed.
    own : bool
        Whether the test is in the room of the file.
    tests : int
        The number of tests that reach it.
    seconds : float
        The time that its tests took.
    """

    key: str
    file: str
    line: int
    before: str
    after: str
    outcome: Outcome
    by: str
    own: bool
    tests: int
    seconds: float

    @classmethod
    def of(cls, mutant: Mutant, outcome: Outcome, by: str, tests: int = 0, seconds: float = 0.0) -> Result:
        """Return the result of a mutant."""
        known = (mutant.key, mutant.file, mutant.line, mutant.before, mutant.after)
        return cls(*known, outcome, by, is_own(mutant.file, by), tests, round(seconds, 1))


def reaching(mutant: Mutant, tests: Iterable[RecordedTest]) -> list[RecordedTest]:
    """Return the tests that reach a mutant."""
    if mutant.functions:
        wanted = {f"{mutant.file}:{name}" for name in mutant.functions}
        return [test for test in tests if not wanted.isdisjoint(test.functions)]
    return [test for test in tests if any(name.startswith(f"{mutant.file}:") for name in test.functions)]


def in_order(changed: str, tests: list[RecordedTest]) -> list[tuple[str, list[str]]]:
    """Return tests by file: first the quick ones of each, then the others.

    Files of the changed file's room are first, and those of its name; then those whose tests take the least time.
    """
    files: dict[str, list[RecordedTest]] = defaultdict(list)
    for test in sorted(tests, key=lambda test: test.seconds):
        files[test.file].append(test)
    name = f"test_{Path(changed).stem}.py"

    def rank(file: str) -> tuple[bool, bool, float]:
        own = is_own(changed, file)
        return not own, Path(file).name != name, sum(test.seconds for test in files[file])

    ranked = sorted(files, key=rank)
    quick = {file: sum(test.seconds < _QUICK for test in files[file][:_FIRST]) for file in ranked}
    turns = [(file, files[file][: quick[file]]) for file in ranked] + [
        (file, files[file][quick[file] :]) for file in ranked
    ]
    return [(file, [test.id for test in some]) for file, some in turns if some]


def is_own(file: str, test: str) -> bool:
    """Return whether a test is in the room of a file: both lie in the folder of the same name."""
    return bool(file) and Path(file).parts[0] in Path(test.partition("::")[0]).parts[1:-1]


def kill(
    settings: Settings, mutants: list[Mutant], tests: list[RecordedTest], jobs: int, done: Callable[[Result], None]
) -> None:
    """Run the tests that reach each mutant, and hand over each result."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and end the processes
    _warm_up(settings)
    with tempfile.TemporaryDirectory(prefix="mutation-") as made:
        copies = [_Copy(settings, Path(made, str(k)), Path(made, "source")) for k in range(min(jobs, len(mutants)))]
        waiting, running = list(mutants), dict[int, _Running]()
        try:
            while waiting or running:
                while waiting and copies:
                    mutant = waiting.pop(0)
                    one = _Running(copies.pop(), mutant, reaching(mutant, tests))
                    running[one.start(second=False)] = one
                pid, status = os.wait()
                one = running.pop(pid)
                result = one.ended(pid, status)
                if result is None:
                    running[one.start(second=True)] = one
                else:
                    copies.append(one.copy)
                    done(result)
        finally:
            for pid in running:
                _end_group(pid)


def failing(settings: Settings, tests: list[RecordedTest], *, second: bool) -> list[str]:
    """Return which tests fail without any change, where mutants are tried."""
    _warm_up(settings)
    with tempfile.TemporaryDirectory(prefix="mutation-") as made:
        copy = _Copy(settings, Path(made, "0"), Path(made, "source"))
        pid = copy.start(tests, in_order("", tests), second=second, stop=False)
        return copy.failed(*os.waitpid(pid, 0))


def _warm_up(settings: Settings) -> None:
    """Import what tests need, before processes are forked."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before numpy is imported: a process with threads must not be forked
    sys.dont_write_bytecode = False  # a copy is compiled once, not for each mutant
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    for plugin in entry_points(group="pytest11"):
        plugin.load()
    for name in settings.warm:
        import_module(name)


class _Copy:
    """A copy of the sources, in which one process at a time runs tests."""

    def __init__(self, settings: Settings, folder: Path, source: Path) -> None:
        self._settings, self._folder, self._source = settings, folder, folder / "source"
        shutil.copytree(settings.prepared(source), self._source)
        self._changes = 0

    def change(self, mutant: Mutant) -> None:
        """Change a file."""
        self._changes += 1
        file = self._source / self._settings.package / mutant.file
        file.write_bytes(mutant.apply(self._settings.path(mutant.file).read_bytes()))
        os.utime(file, (self._changes, self._changes))  # compiled files are known by this time

    def restore(self, mutant: Mutant) -> None:
        """Undo a change."""
        shutil.copy2(self._settings.path(mutant.file), self._source / self._settings.package / mutant.file)

    def start(self, tests: list[RecordedTest], wanted: list[tuple[str, list[str]]], *, second: bool, stop: bool) -> int:
        """Run tests in the order of `wanted`, up to the first failure if `stop`; return the process."""
        self._state.write_text(json.dumps({"now": "the start", "failed": [], "ended": not tests}), "utf-8")
        pid = os.fork()
        if pid == 0:
            code = 3
            try:
                os.setsid()
                signal.signal(signal.SIGTERM, signal.SIG_DFL)
                code = self._run(tests, wanted, second, stop) if tests else 0
            finally:
                os._exit(code)
        return pid

    @property
    def _state(self) -> Path:
        return self._folder / "state.json"

    def _run(self, tests: list[RecordedTest], wanted: list[tuple[str, list[str]]], second: bool, stop: bool) -> int:
        log = os.open(self._folder / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(log, stream)
        settings = self._settings
        sys.path[:] = [str(self._source), *(path for path in sys.path if path != str(settings.root / settings.source))]
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(self._source), os.environ.get("PYTHONPATH")]))
        os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(self._folder / "hypothesis")
        os.environ.update(settings.second_tier if second else {})
        os.chdir(settings.root)
        limits = {test.id: _LIMIT + 10.0 * test.seconds for test in tests}
        plugin = _InTurn(wanted, limits, self._state, stop)
        arguments = [*PYTEST, "--tb=short", "--basetemp", str(self._folder / "tmp"), "--hypothesis-seed=0"]
        return int(pytest.main([*arguments, *{file for file, _ in wanted}], plugins=[plugin]))

    def failed(self, pid: int, status: int) -> list[str]:
        """Return the failed tests of a process that has ended, with the one that it was ended in."""
        _end_group(pid)
        state = json.loads(self._state.read_text("utf-8"))
        failed: list[str] = state["failed"]
        if not state["ended"]:
            limit = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM
            failed.append(f"{state['now']} ({'time limit' if limit else 'process ended'})")
        return failed


class _Running:
    """The tests of one mutant."""

    def __init__(self, copy: _Copy, mutant: Mutant, tests: list[RecordedTest]) -> None:
        self.copy, self._mutant, self._tests, self._second = copy, mutant, tests, False
        self._start = time.perf_counter()
        copy.change(mutant)

    def start(self, *, second: bool) -> int:
        """Start the tests of the first tier, or those that do more in the second; return the process."""
        self._second = second
        tests = [test for test in self._tests if (test.grows if second else not test.second)]
        return self.copy.start(tests, in_order(self._mutant.file, tests), second=second, stop=True)

    def ended(self, pid: int, status: int) -> Result | None:
        """Return the result of a process that has ended; None if the second tier remains to be run."""
        failed = self.copy.failed(pid, status)
        if not failed and not self._second and any(test.grows for test in self._tests):
            return None
        self.copy.restore(self._mutant)
        outcome: Outcome = "survived" if self._tests else "unreached"
        if failed:
            outcome = "complete" if self._second else "default"
        seconds = time.perf_counter() - self._start
        return Result.of(self._mutant, outcome, failed[0] if failed else "", len(self._tests), seconds)


class _InTurn:
    """The plugin that imports and runs one file of tests after the other."""

    def __init__(self, wanted: list[tuple[str, list[str]]], limits: dict[str, float], state: Path, stop: bool) -> None:
        self._wanted, self._limits, self._state, self._stop = wanted, limits, state, stop
        self._failed: list[str] = []

    def _note(self, now: str, limit: float, *, ended: bool = False) -> None:
        """Write what runs, and end this process after the limit."""
        self._state.write_text(json.dumps({"now": now, "failed": self._failed, "ended": ended}), "utf-8")
        signal.setitimer(signal.ITIMER_REAL, limit)

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self, session: pytest.Session) -> bool:
        session.items = []
        return True

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        items = self._items(session)
        item = next(items, None)
        while item is not None and not (self._failed and self._stop):
            following = next(items, None)  # fixtures that it needs as well are kept
            self._note(item.nodeid, self._limits[item.nodeid])
            session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            item = following
        self._note("the end", _COLLECTING, ended=True)
        return True

    def _items(self, session: pytest.Session) -> Iterator[pytest.Item]:
        files = list(dict.fromkeys(file for file, _ in self._wanted))
        modules = {node.nodeid: node for node in session.perform_collect(files, genitems=False)}
        found: dict[str, dict[str, pytest.Item]] = {}
        for file, names in self._wanted:
            self._note(file, _COLLECTING)
            if file not in found:  # now it is imported
                found[file] = {item.nodeid: item for item in session.genitems(modules[file])}
            yield from (found[file][name] for name in names if name in found[file])

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self._failed.append(report.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and report.nodeid not in self._failed:
            self._failed.append(report.nodeid)


def _end_group(pid: int) -> None:
    """End what is left of a process and of those that it started."""
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
