"""Every system call of a commit fails, ends the process, or is interrupted; the files are whole each time."""

import contextlib
import errno
import io
import os
import shutil
import signal
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from truepose._io import commits, files
from truepose.errors import FileError, RecoveryWarning
from truepose.programs import corrected as corrected_module
from truepose.programs import history
from truepose.programs.core.source import Source

HOW = ("fails", "killed", "stops", "fails from then on", "interrupted before", "interrupted after", "signal")
WHERE = ("in place", "new folder", "over results")
CASES = [
    (how, where, n)
    for how in HOW
    for where in WHERE
    for n in ((1, 2) if how == "killed" else (1, 2, 10))  # forks are slow; "stops" is as good
    if n < 10 or how == "fails" or where == "in place"
]
CALLS = ("open", "write", "fsync", "chmod", "mkdir", "link", "replace", "unlink", "ftruncate")
KILLED = 9


class Stopped(BaseException):
    """Comes from every call after one, so that nothing is done any more, as in a process that was killed."""


class Faults:
    """Counts the system calls of a commit, and does something at the one with number `at`."""

    def __init__(self, patch: pytest.MonkeyPatch, how: str, at: int) -> None:
        self.how, self.at, self.count, self.log = how, at, 0, list[str]()
        real = {name: getattr(os, name) for name in CALLS}
        real["fsync"] = lambda _descriptor: None  # slow, and of no effect unless the power fails
        for name, call in real.items():
            patch.setattr(os, name, self.around(name, call))
        faults, fdopen = self, os.fdopen

        class Raw(io.FileIO):
            def write(self, data: Any) -> int | None:
                return faults.around("write", super().write)(data)

        def opened(descriptor: int, mode: str) -> Any:
            return io.BufferedWriter(Raw(descriptor, "w")) if mode == "wb" else fdopen(descriptor, mode)

        patch.setattr(os, "fdopen", opened)

    def around(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*arguments: Any, **options: Any) -> Any:
            self.count += 1
            self.log.append(name)
            now = self.count == self.at
            if self.count > self.at and self.how == "stops":
                raise Stopped
            if (now and self.how == "fails") or (self.count >= self.at and self.how == "fails from then on"):
                raise OSError(errno.ENOSPC, "No space left on device")
            if now and self.how == "interrupted before":
                raise KeyboardInterrupt
            try:
                return call(*arguments, **options)
            finally:
                if now and self.how == "killed":
                    os._exit(KILLED)
                if now and self.how == "stops":
                    raise Stopped
                if now and self.how == "interrupted after":
                    raise KeyboardInterrupt
                if now and self.how == "signal":
                    os.kill(os.getpid(), signal.SIGINT)

        return counted


class Case:
    """A program of n files, and its corrected version to be written in place, to a new folder, or over old results."""

    def __init__(self, folder: Path, n: int, where: str) -> None:
        self.folder, self.where, self.out = folder, where, folder / "out"
        self.paths = [folder / f"p{i}.src" for i in range(n)]
        self.sources = [Source(path, f"old {path.name}\n".encode()) for path in self.paths]
        program = SimpleNamespace(
            sources=self.sources,
            path=self.paths[0],
            folder=folder,
            place=Path(),
            controller=None,
            names=lambda: [Path(p.name) for p in self.paths],
        )
        self.corrected: Any = SimpleNamespace(
            robot={},
            program=program,
            refused={},
            hashes={s.path: Source(s.path, self.new(s)).sha256 for s in self.sources},
            content=lambda source: [self.new(source)],
            write_records=lambda a, b: (a.write(b"record"), b.write(b"record")),
        )
        names = [path.name for path in corrected_module.names(program)]  # type: ignore[arg-type]
        in_place = where == "in place"
        kept = [f"{path.name}.original" for path in self.paths] if in_place else []
        self.goals = [(folder if in_place else self.out) / name for name in (*kept, *names)]

    def new(self, source: Source) -> bytes:
        return source.data.replace(b"old", b"new")

    def prepare(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        for source in self.sources:
            source.path.write_bytes(source.data)
        if self.where == "over results":
            self.out.mkdir()
            for goal in self.goals:
                goal.write_bytes(b"earlier")
        self.before = {goal: goal.read_bytes() if goal.exists() else None for goal in self.goals}

    def write(self) -> None:
        if self.where == "in place":
            corrected_module.write_in_place([self.corrected])
        else:
            corrected_module.write([self.corrected], self.out, force=True)

    def check_safe(self) -> None:
        """Require that no program is lost: what is not the original has its original beside it."""
        for source in self.sources:
            if source.path.read_bytes() != source.data:
                assert self.where == "in place"
                assert source.path.read_bytes() == self.new(source)
                assert source.path.with_name(f"{source.path.name}.original").read_bytes() == source.data

    def is_corrected(self) -> bool:
        """Return whether all is as written; it must be either that or as before."""
        now = {goal: goal.read_bytes() if goal.exists() else None for goal in self.goals}
        if now == self.before:
            return False
        sources = {source.path.name: source for source in self.sources}
        for goal, content in now.items():
            if goal.name in sources:
                assert content == self.new(sources[goal.name]), (goal, now)
            elif goal.suffix == ".original":
                assert content == sources[goal.stem].data
            else:
                assert content == b"record"
        return True

    def leftovers(self) -> list[Path]:
        return [path for path in self.folder.rglob("*") if path.name.startswith(".truepose")]

    def recover(self) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecoveryWarning)
            files.recover(self.folder)
            files.recover(self.out)


@pytest.fixture
def fast_folder(tmp_path: Path) -> Iterator[Path]:
    """Return a folder in memory, where the system has that."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if os.access(memory, os.W_OK) else tmp_path) as folder:
        yield Path(folder) / "cell"


@contextlib.contextmanager
def light(monkeypatch: pytest.MonkeyPatch) -> Iterator[pytest.MonkeyPatch]:
    with monkeypatch.context() as patch:
        patch.setattr(history, "remember", lambda _: None)
        yield patch


def run(case: Case, patch: pytest.MonkeyPatch, how: str, at: int) -> tuple[Faults | None, BaseException | None]:
    """Write with one fault; return the count of calls (None: the process was killed), and what was raised."""
    if how == "killed":
        child = os.fork()
        if not child:
            try:
                Faults(patch, how, at)
                case.write()
                os._exit(0)
            except BaseException:
                os._exit(1)  # never back into pytest in a child
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert status in (0, KILLED)
        return None, SystemExit(status) if status else None
    raised: BaseException | None = None
    with patch.context() as faulty:
        faults = Faults(faulty, how, at)
        try:
            case.write()
        except (FileError, KeyboardInterrupt, Stopped) as error:
            raised = error
    return faults, raised


@pytest.mark.promise("Whatever call of a commit fails, is interrupted or is the process's last, no program is lost.")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize(("how", "where", "n"), CASES)
@pytest.mark.sampled(3)
def test_every_call_of_a_commit(
    fast_folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    record_property: Callable[[str, object], None],
    how: str,
    where: str,
    n: int,
) -> None:
    if how == "signal" and threading.current_thread() is not threading.main_thread():
        pytest.skip("signals reach only the main thread")
    case, at, outcomes = Case(fast_folder, n, where), 0, set()
    with light(monkeypatch) as patch:
        while True:
            at += 1
            case.prepare()
            faults, raised = run(case, patch, how, at)
            case.check_safe()
            if how not in ("killed", "stops", "fails from then on"):
                case.is_corrected()  # whole at once, without another run
            case.recover()
            case.check_safe()
            corrected = case.is_corrected()
            assert not case.leftovers(), (at, case.leftovers())
            assert corrected or raised is not None
            outcomes.add((type(raised).__name__, corrected))
            if isinstance(raised, FileError):
                assert "\n" not in str(raised)
                assert "No space left on device" in str(raised)
                assert not corrected or "the next run of truepose" in str(raised)
            if (raised is None) if faults is None else faults.count < at:
                break
    assert at > 5 * n
    assert any(done for _, done in outcomes)
    assert any(not done for _, done in outcomes)
    record_property("cases", at)


def killed_at(case: Case, patch: pytest.MonkeyPatch, call: str, number: int) -> None:
    """Prepare, and write until the process is killed at the given one of a call's occurrences."""
    case.prepare()
    with patch.context() as faulty:
        faults = Faults(faulty, "", -1)
        case.write()
    at = [i for i, name in enumerate(faults.log, 1) if name == call][number]
    case.prepare()
    run(case, patch, "killed", at)


@pytest.mark.promise("The next run says in one line what it did with what a killed run left.")
def test_the_next_run_says_what_it_did(fast_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(fast_folder, 2, "in place")
    with light(monkeypatch) as patch:
        for call, number, message in (
            ("replace", -2, r"interrupted while it wrote .*p0\.src, p1\.src and others; these files were restored"),
            (
                "replace",
                -1,
                r"interrupted after it had written .*p0\.src, p1\.src and others; these files are complete",
            ),
            ("write", 2, r"removed \d temporary files of an interrupted run"),
        ):
            killed_at(case, patch, call, number)
            with pytest.warns(RecoveryWarning, match=message) as told:
                files.recover(case.folder) if call == "replace" else case.write()
            assert len(told) == 1
            assert case.is_corrected() is (number != -2)
            assert not case.leftovers()


def test_recovery_goes_through_all_folders_and_says_where_it_cannot(
    fast_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    below = [Case(fast_folder / name, 2, "in place") for name in ("a", "b")]
    with light(monkeypatch) as patch:
        for case in below:
            case.folder.mkdir(parents=True, exist_ok=True)
            killed_at(case, patch, "replace", -2)
    below[0].paths[0].write_bytes(b"edited by hand")
    left, restored = commits.recover_below(fast_folder)
    assert "was changed after an interrupted run" in left
    assert "these files were restored" in restored
    assert below[0].paths[0].read_bytes() == b"edited by hand"
    assert not below[1].leftovers()


@pytest.mark.promise("A .src/.dat pair that a killed run left half-corrected is whole again when it is read next.")
def test_readers_see_no_half_corrected_pair(
    fast_folder: Path, monkeypatch: pytest.MonkeyPatch, run: Callable[..., Any]
) -> None:
    case = Case(fast_folder, 2, "in place")
    with light(monkeypatch) as patch:
        killed_at(case, patch, "replace", -2)
    assert case.paths[0].read_bytes() != case.sources[0].data
    done = run("check", case.paths[1])
    assert "truepose: warning: " in done.err
    assert "these files were restored" in done.err
    assert [path.read_bytes() for path in case.paths] == [source.data for source in case.sources]


@pytest.mark.promise("Recovery leaves alone what somebody changed since, and a run that is still going on.")
def test_recovery_overwrites_no_work(fast_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(fast_folder, 2, "in place")
    with light(monkeypatch) as patch:
        killed_at(case, patch, "replace", -2)
        case.paths[0].write_bytes(b"edited by hand")
        for _ in range(2):
            with pytest.raises(FileError, match=r"p0\.src: was changed after an interrupted run .* remove the journal"):
                files.recover(case.folder)
        assert case.paths[0].read_bytes() == b"edited by hand"
        assert case.paths[0].with_name("p0.src.original").read_bytes() == case.sources[0].data
        case.prepare()
        with files.Commit() as commit, commit.open(case.paths[0]) as file:
            file.write(b"new")
            before = case.leftovers()
            files.recover(case.folder)
            assert case.leftovers() == before
    assert case.paths[0].read_bytes() == b"new"


@pytest.mark.promise("Files of one commit in several folders are recovered from each of them.")
@pytest.mark.parametrize("first", ["a", "b", "c"])
def test_several_folders(fast_folder: Path, monkeypatch: pytest.MonkeyPatch, first: str) -> None:
    paths = [fast_folder / folder / "p.src" for folder in "abc"]
    for path in paths:
        path.parent.mkdir(parents=True)
        path.write_bytes(b"old")
    child = os.fork()
    if not child:
        Faults(monkeypatch, "killed", -1)
        faults_replace, count = os.replace, iter(range(99))
        monkeypatch.setattr(os, "replace", lambda a, b: faults_replace(a, b) if next(count) < 2 else os._exit(KILLED))
        files.write_all(dict.fromkeys(paths, b"new"))
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == KILLED
    assert [path.read_bytes() for path in paths] == [b"new", b"new", b"old"]
    with pytest.warns(RecoveryWarning, match="these files were restored"):
        files.recover(fast_folder / first)
    assert [path.read_bytes() for path in paths] == [b"old"] * 3
    assert not list(fast_folder.rglob(".truepose*"))


@pytest.mark.promise("A journal that came with foreign files changes no file in other folders.")
@pytest.mark.parametrize("content", ['{"files": 3}', '{"format": "truepose journal 1", "files": [{}]}', "[" * 100_000])
def test_foreign_journals(fast_folder: Path, content: str) -> None:
    import hashlib
    import json

    own, project, token = fast_folder / "own.txt", fast_folder / "project", "0" * 16
    project.mkdir(parents=True)
    own.write_bytes(b"mine")
    journal, old = project / f".truepose-{token}.journal", fast_folder / f".truepose-{token}-0.old"
    old.write_bytes(b"evil")
    entry = {"token": token, "place": 0, "goal": "../own.txt"}
    hashes = {"before": hashlib.sha256(b"evil").hexdigest(), "after": hashlib.sha256(b"mine").hexdigest()}
    absent = {"place": 1, "goal": "b.src", "before": None, "after": "0" * 64}
    journal.write_text(json.dumps({"format": "truepose journal 1", "files": [{**entry, **hashes}, absent]}))
    with pytest.raises(FileError, match=r"own\.txt: is named by the journal of another folder"):
        files.recover(project)
    journal.write_text(content)
    with contextlib.suppress(FileError), warnings.catch_warnings():
        warnings.simplefilter("ignore", RecoveryWarning)
        files.recover(project)
    assert own.read_bytes() == b"mine"


@pytest.mark.promise("Where a file system has no links, copies keep the old contents.")
def test_without_links(fast_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(fast_folder, 2, "in place")

    def none(*_arguments: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    with light(monkeypatch) as patch:
        patch.setattr(os, "link", none)
        for at, corrected in ((-2, False), (10**6, True)):
            killed_at(case, patch, "replace", at) if at < 0 else (case.prepare(), case.write())
            case.recover()
            assert case.is_corrected() is corrected
            assert not case.leftovers()


@pytest.mark.promise("Results that a killed run left in part are no results: the next run needs no --force.")
def test_the_next_run_to_a_folder(fast_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(fast_folder, 2, "new folder")
    with light(monkeypatch) as patch:
        killed_at(case, patch, "replace", 1)
        assert list(case.out.glob("*.src"))
        with pytest.warns(RecoveryWarning, match="these files were restored"):
            corrected_module.write([case.corrected], case.out)
        assert case.is_corrected()


@pytest.mark.promise("SIGTERM during the renames ends the process only after they are complete.")
@pytest.mark.parametrize("number", [0, 3, -1])
def test_sigterm_waits_for_the_renames(fast_folder: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    case = Case(fast_folder, 2, "in place")
    case.prepare()
    with light(monkeypatch):
        child = os.fork()
        if not child:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            rename, left = os.replace, [number % len(case.goals)]

            def ended(old: Path, new: Path) -> None:
                if not left[0]:
                    os.kill(os.getpid(), signal.SIGTERM)
                left[0] -= 1
                rename(old, new)

            monkeypatch.setattr(os, "replace", ended)
            case.write()
            os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM
    assert case.is_corrected()
    case.recover()
    assert case.is_corrected()
    assert not case.leftovers()


@contextlib.contextmanager
def nobody() -> Iterator[None]:
    """Be another user than root, who may write everywhere."""
    user = os.geteuid()
    if not user and not os.access("/dev/shm", os.W_OK):
        pytest.skip("root's temporary folders are closed to others")
    if not user:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


@pytest.mark.promise("In a folder that may not be written one line says so, and what a killed run left waits there.")
def test_a_folder_that_may_not_be_written(fast_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case(fast_folder, 2, "in place")
    with light(monkeypatch) as patch:
        case.prepare()
        fast_folder.parent.chmod(0o755)
        fast_folder.chmod(0o555)
        with nobody(), pytest.raises(FileError, match=r"original: cannot be written: Permission denied"):
            case.write()
        assert not case.is_corrected()
        fast_folder.chmod(0o755)
        killed_at(case, patch, "replace", -2)
        before = {path.name: path.read_bytes() for path in fast_folder.iterdir()}
        fast_folder.chmod(0o555)
        message = "an earlier run was interrupted here and cannot be undone: .* run it again"
        with nobody(), pytest.raises(FileError, match=message):
            files.recover(fast_folder)
        assert {path.name: path.read_bytes() for path in fast_folder.iterdir()} == before
        fast_folder.chmod(0o755)
        case.recover()
        assert not case.is_corrected()
        assert not case.leftovers()
