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
from pathlib import Path
from typing import Literal

import pytest

from mutation.mutants import Mutant
from mutation.recording import PYTEST, RecordedTest
from mutation.settings import Settings

Outcome = Literal["default", "complete", "survived", "unreached", "equivalent"]
_LIMIT = 30.0
"""Seconds that a test may take in addition to ten times its usual time."""
_COLLECTING = 300.0


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
        The test that killed it, with "(time limit)" or "(process ended)" where the test did not end; of an equivalent
        mutant the reason.
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


def in_order(mutant: Mutant, tests: list[RecordedTest]) -> dict[str, list[str]]:
    """Return tests by file: those of the mutant's room first, and of the same name; then the quickest."""
    files: dict[str, list[RecordedTest]] = defaultdict(list)
    for test in tests:
        files[test.file].append(test)
    name = f"test_{Path(mutant.file).stem}.py"

    def rank(file: str) -> tuple[bool, bool, float]:
        own = is_own(mutant.file, file)
        return not own, Path(file).name != name, sum(test.seconds for test in files[file])

    quick = {file: sorted(files[file], key=lambda test: test.seconds) for file in sorted(files, key=rank)}
    return {file: [test.id for test in some] for file, some in quick.items()}


def is_own(file: str, test: str) -> bool:
    """Return whether a test is in the room of a file: both lie in the folder of the same name."""
    return Path(file).parts[0] in Path(test.partition("::")[0]).parts[1:-1]


def kill(
    settings: Settings, mutants: list[Mutant], tests: list[RecordedTest], jobs: int, done: Callable[[Result], None]
) -> None:
    """Run the tests that reach each mutant, and hand over each result."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")  # before numpy is imported: a process with threads must not be forked
    for name in settings.warm:
        import_module(name)
    with tempfile.TemporaryDirectory(prefix="mutation-") as made:
        slots = [Path(made, str(k)) for k in range(min(jobs, len(mutants)))]
        for slot in slots:
            shutil.copytree(settings.root / settings.source, slot / "source")
        waiting, running = list(enumerate(mutants, 1)), dict[int, _Running]()
        try:
            while waiting or running:
                while waiting and slots:
                    number, mutant = waiting.pop(0)
                    one = _Running(settings, mutant, reaching(mutant, tests), slots.pop(), number)
                    running[one.start(second=False)] = one
                pid, status = os.wait()
                one = running.pop(pid)
                result = one.ended(pid, status)
                if result is None:
                    running[one.start(second=True)] = one
                else:
                    slots.append(one.slot)
                    done(result)
        finally:
            for pid in running:
                _end_group(pid)


class _Running:
    """The tests of one mutant in one copy of the sources."""

    def __init__(self, settings: Settings, mutant: Mutant, tests: list[RecordedTest], slot: Path, number: int) -> None:
        self._settings, self._mutant, self._tests, self.slot = settings, mutant, tests, slot
        self._number, self._second = number, False
        self._start = time.perf_counter()

    def start(self, *, second: bool) -> int:
        """Start the tests of the first tier, or those that do more in the second; return the process."""
        self._second = second
        file, original = self._path(self._mutant.file), self._settings.path(self._mutant.file)
        file.write_bytes(self._mutant.apply(original.read_bytes()))
        os.utime(file, (self._number, self._number))  # compiled files are known by this time
        tests = [test for test in self._tests if (test.grows if second else not test.second)]
        (self.slot / "state.json").write_text(json.dumps({"by": "", "killer": "", "ended": not tests}), "utf-8")
        pid = os.fork()
        if pid == 0:
            code = 3
            try:
                os.setsid()
                code = self._child(tests)
            finally:
                os._exit(code)
        return pid

    def ended(self, pid: int, status: int) -> Result | None:
        """Return the result of a process that has ended; None if the second tier remains to be run."""
        _end_group(pid)
        state = json.loads((self.slot / "state.json").read_text("utf-8"))
        killer = state["killer"]
        if not state["ended"]:
            limit = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM
            killer = killer or f"{state['by']} ({'time limit' if limit else 'process ended'})"
        if not killer and not self._second and any(test.grows for test in self._tests):
            return None
        shutil.copy2(self._settings.path(self._mutant.file), self._path(self._mutant.file))
        outcome: Outcome = "survived" if self._tests else "unreached"
        if killer:
            outcome = "complete" if self._second else "default"
        return Result.of(self._mutant, outcome, killer, len(self._tests), time.perf_counter() - self._start)

    def _path(self, file: str) -> Path:
        return self.slot / "source" / self._settings.package / file

    def _child(self, tests: list[RecordedTest]) -> int:
        if not tests:
            return 0
        log = os.open(self.slot / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream in (1, 2):
            os.dup2(log, stream)
        source = str(self.slot / "source")
        sys.path.insert(0, source)
        sys.path[:] = [path for path in sys.path if path != str(self._settings.root / self._settings.source)]
        os.environ["PYTHONPATH"] = os.pathsep.join([source, os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
        os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = str(self.slot / "hypothesis")
        os.environ.update(self._settings.second_tier if self._second else {})
        os.chdir(self._settings.root)
        wanted, limits = in_order(self._mutant, tests), {test.id: _LIMIT + 10.0 * test.seconds for test in tests}
        plugin = _InTurn(wanted, limits, self.slot / "state.json")
        arguments = [*PYTEST, "--tb=short", "--basetemp", str(self.slot / "tmp"), "--hypothesis-seed=0"]
        return int(pytest.main([*arguments, *list(wanted)[:1]], plugins=[plugin]))


class _InTurn:
    """The plugin that collects and runs one file of tests after the other, up to the first failure."""

    def __init__(self, wanted: dict[str, list[str]], limits: dict[str, float], state: Path) -> None:
        self._wanted, self._limits, self._state = wanted, limits, state
        self._killer = ""

    def _note(self, by: str, limit: float, *, ended: bool = False) -> None:
        """Write what runs, and end this process after the limit."""
        self._state.write_text(json.dumps({"by": by, "killer": self._killer, "ended": ended}), "utf-8")
        signal.setitimer(signal.ITIMER_REAL, limit)

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self, session: pytest.Session) -> bool:
        session.items = []
        return True

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        items = self._items(session)
        item = next(items, None)
        while item is not None and not self._killer:
            following = next(items, None)  # fixtures that it needs as well are kept
            self._note(item.nodeid, self._limits[item.nodeid])
            session.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            item = following
        self._note("", _COLLECTING, ended=True)
        return True

    def _items(self, session: pytest.Session) -> Iterator[pytest.Item]:
        for file, names in self._wanted.items():
            self._note(file, _COLLECTING)
            found = {item.nodeid: item for item in session.perform_collect([file])}
            yield from (found[name] for name in names if name in found)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self._killer = self._killer or report.nodeid

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self._killer = self._killer or report.nodeid


def _end_group(pid: int) -> None:
    """End what is left of a process and of those that it started."""
    with suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)
