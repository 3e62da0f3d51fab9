"""Write several files all together or not at all, even if the process is killed, the disk is full or a call fails.

New contents are written to drafts beside their files. Before the first rename, a journal is flushed to the disk; it
names every file, its draft, a second link to its old content, and the SHA-256 of both contents. If the renames are
interrupted, the old contents are restored by hash, at once or by the next run in that folder (`recover`). A journal is
locked while its process lives. All temporary names of one commit begin with ``.truepose-TOKEN``.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import secrets
import shutil
import signal
import stat
import threading
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any, BinaryIO, Final

from truepose._io.locks import lock
from truepose.errors import FileError, RecoveryWarning

_FORMAT: Final = "truepose journal 1"
_JOURNAL: Final = re.compile(r"\.truepose-([0-9a-f]{16})\.journal")
_NEW: Final = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
_HELD: Final = ("SIGTERM", "SIGHUP", "SIGBREAK", "SIGINT")
_NO_FOLDER_SYNC: Final = (errno.EINVAL, errno.ENOTSUP, errno.EBADF)  # of some network file systems
_NO_LINK: Final = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK)  # of FAT and others


@dataclass(frozen=True)
class _Change:
    """File number `place` of the commit `token`; a hash is None if there is no file."""

    token: str
    place: int
    goal: Path
    before: str | None
    after: str

    @property
    def draft(self) -> Path:
        """The file with the new content until the rename."""
        return self.goal.with_name(f".truepose-{self.token}-{self.place}.draft")

    @property
    def old(self) -> Path:
        """The second link to the old content."""
        return self.draft.with_suffix(".old")

    @property
    def journal(self) -> Path:
        """The journal of the commit in the folder."""
        return _journal(self.goal.parent, self.token)


def _journal(folder: Path, token: str) -> Path:
    return folder / f".truepose-{token}.journal"


written: Final[list[Path]] = []
"""The files that this command or process has written, for the message of an interrupt."""


class Commit:
    """Files that are written all together or not at all.

    As a context manager: the files opened in the block replace their goals when the block succeeds; otherwise nothing
    remains of them. SIGINT and SIGTERM during the renames are delivered after them.

    Raises
    ------
    FileError
        If a file cannot be written. No file is changed then, unless the message says that the next run will restore it.
    """

    def __init__(self) -> None:
        self._token = secrets.token_hex(8)
        self._journals: dict[Path, int] = {}  # descriptors by folder; the first one holds the content
        self._files: list[tuple[Path, str | None]] = []
        self._at = Path()
        self._pending = False  # renames began and are neither all done nor undone

    def __enter__(self) -> Commit:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        try:
            if error is None:
                self._finish()
        except OSError as failure:
            error = failure
        finally:
            self._close()
        if isinstance(error, OSError):
            reason = error.strerror or str(error)
            raise FileError(self._at, f"cannot be written: {reason}; choose another output path") from error

    @contextlib.contextmanager
    def open(self, goal: Path, *, like: Path | None = None, expected: str | None = None) -> Iterator[BinaryIO]:
        """Open a file of the commit for writing; missing folders are created.

        Parameters
        ----------
        goal : Path
            The file to create or replace.
        like : Path, optional
            The file whose permissions a new file gets.
        expected : str, optional
            The SHA-256 of the content to replace; any other content is an error.
        """
        self._at = goal
        self._enter(goal.parent)
        draft = _Change(self._token, len(self._files), goal, None, "").draft
        self._files.append((goal, expected))
        model = goal if goal.exists() else like
        file = os.fdopen(os.open(draft, _NEW, 0o666 if model is None else 0o600), "wb")
        try:
            if model is not None:
                draft.chmod(model.stat().st_mode & 0o777)
            yield file
            file.flush()
            os.fsync(file.fileno())
        except BaseException:
            with contextlib.suppress(OSError):
                file.close()
            raise
        file.close()

    def _enter(self, folder: Path) -> None:
        """Begin in a folder: finish or undo what was interrupted there, and mark drafts to come as those of a run."""
        key = Path(os.path.realpath(folder))
        if key in self._journals:
            return
        folder.mkdir(parents=True, exist_ok=True)
        recover(folder)
        self._journals[key] = descriptor = _new_journal(_journal(key, self._token))
        if (main := next(iter(self._journals))) != key:
            _write(descriptor, {"format": _FORMAT, "journal": _relative(_journal(main, self._token), key)})

    def _finish(self) -> None:
        if not self._files:
            return
        changes = [self._change(k, *file) for k, file in enumerate(self._files)]
        main, descriptor = next(iter(self._journals.items()))
        if len(changes) > 1:  # one rename needs no journal
            entries = [{**asdict(change), "goal": _relative(change.goal, main)} for change in changes]
            _write(descriptor, {"format": _FORMAT, "files": entries})
            for folder in self._journals:
                sync_folder(folder)
        with _signals_held():
            self._pending = True
            try:
                for change in changes:
                    self._at = change.goal
                    change.draft.replace(change.goal)
                for folder in self._journals:
                    sync_folder(folder)
            except BaseException as error:
                self._undo(changes, main, error)
                raise
            self._pending = False
            written.extend(change.goal for change in changes)
            with contextlib.suppress(OSError):
                os.ftruncate(descriptor, 0)  # nothing is to be undone from here on

    def _change(self, place: int, goal: Path, expected: str | None) -> _Change:
        """Return a change with its hashes; the old content is kept by a second link or a copy."""
        self._at = goal
        change = _Change(self._token, place, goal, None, "")
        if goal.exists():
            _link(goal, change.old)
        change = replace(change, before=_digest(change.old), after=_digest(change.draft) or "")
        if expected is not None and change.before != expected:
            raise FileError(goal, "was changed by another program while this one ran; run again")
        return change

    def _undo(self, changes: Sequence[_Change], main: Path, error: BaseException) -> None:
        try:
            _restore(changes)
        except OSError as failure:
            raise FileError(
                self._at,
                f"cannot be written ({_reason(error)}), and the files written before it cannot be restored "
                f"({_reason(failure)}); the next run of truepose in {main} completes or restores them",
            ) from None
        self._pending = False

    def _close(self) -> None:
        """Remove the temporary files of a commit, unless the next run needs them; the next run removes the rest."""
        for folder, descriptor in reversed(self._journals.items()):
            with contextlib.suppress(OSError), _closing(descriptor, [] if self._pending else [folder], self._token):
                if not self._pending:
                    _remove_files(folder, self._token)


def recover(folder: Path) -> None:
    """Restore or complete the files of an interrupted run in a folder, remove its temporary files, and warn about it.

    Raises
    ------
    FileError
        If this is not possible because files were changed since or cannot be written.
    """
    here = Path(os.path.realpath(folder))
    try:
        journals = sorted(path for path in here.iterdir() if _JOURNAL.fullmatch(path.name))
    except OSError:
        return
    for journal in journals:
        try:
            if done := _recover(journal):
                warnings.warn(done, RecoveryWarning, stacklevel=2)
        except OSError as error:
            raise FileError(
                folder,
                f"an earlier run was interrupted here and cannot be undone: {_reason(error)}; "
                "give truepose write access to this folder and run it again",
            ) from None


def recover_below(folder: Path) -> list[str]:
    """Recover in a folder and in those below it; return a sentence about each run, also where it is not possible."""
    said: list[str] = []
    for place in sorted({path.parent for path in folder.rglob(".truepose-*.journal")}):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RecoveryWarning)
            try:
                recover(place)
            except FileError as error:
                said.append(str(error))
        said += [str(one.message) for one in caught]
    return said


def _recover(path: Path) -> str:
    """Recover from one journal, unless its process lives; return a sentence about it."""
    flags = getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        descriptor = os.open(path, flags | (os.O_RDWR if os.access(path, os.W_OK) else os.O_RDONLY))
    except FileNotFoundError:  # another run was quicker
        return ""
    if not lock(descriptor):
        os.close(descriptor)
        return ""
    token, folders = _token(path), [path.parent]
    with _closing(descriptor, folders, token):
        if hasattr(os, "geteuid") and os.fstat(descriptor).st_uid != os.geteuid():
            raise PermissionError(errno.EPERM, f"{path.name} is another user's")
        main, changes = _read(path, descriptor)
        done = "" if main is None else _recover(main)
        if main is not None and main.exists():  # its process lives
            folders.clear()
            return done
        done = done or _settle(changes, path)
        folders[:0] = sorted({change.goal.parent for change in changes} - {path.parent})
        removed = sum(_remove_files(folder, token) for folder in folders)
        return done or (f"{path.parent}: removed {removed} temporary files of an interrupted run" if removed else "")


@contextlib.contextmanager
def _closing(descriptor: int, folders: Sequence[Path], token: str) -> Iterator[None]:
    """Close a journal; if the block succeeds, remove it and those of other folders, closed first because of Windows."""
    try:
        yield
    finally:
        os.close(descriptor)
    for folder in folders:
        _journal(folder, token).unlink(missing_ok=True)


def _settle(changes: Sequence[_Change], path: Path) -> str:
    """Complete or undo the changes of a journal; return a sentence about it."""
    if not changes:
        return ""
    names = ", ".join(change.goal.name for change in changes[-3:]) + (" and others" if len(changes) > 3 else "")
    if all(_digest(change.goal) == change.after for change in changes):
        return f"{path.parent}: an earlier run was interrupted after it had written {names}; these files are complete"
    _restore(changes)
    return f"{path.parent}: an earlier run was interrupted while it wrote {names}; these files were restored"


def _restore(changes: Sequence[_Change]) -> None:
    """Restore the old content of all files, last ones first; of none if another program changed one."""
    back = [change for change in reversed(changes) if _digest(change.goal) != change.before]
    for change in back:
        if _digest(change.goal) not in (change.after, None):
            what = f"was changed after an interrupted run had written it; its earlier content is in {change.old.name}"
        elif change.before is not None and _digest(change.old) != change.before:
            what = f"was written by an interrupted run, and its earlier content, {change.old.name}, is lost"
        elif not change.journal.exists():
            what = "is named by the journal of another folder"
        else:
            continue
        raise FileError(change.goal, f"{what}; repair the file by hand and remove the journal {change.journal}")
    for change in back:
        if change.before is None:
            change.goal.unlink()
        else:
            change.old.replace(change.goal)
    for folder in {change.goal.parent for change in changes}:
        sync_folder(folder)


def _remove_files(folder: Path, token: str) -> int:
    """Remove the drafts and links of a commit; return their number."""
    found = [path for path in folder.iterdir() if path.name.startswith(f".truepose-{token}-")]
    for path in found:
        path.unlink(missing_ok=True)
    return len(found)


def _digest(path: Path) -> str | None:
    """Return the SHA-256 of a file; None without a file, "" if it is not a regular file."""
    try:
        if not stat.S_ISREG(path.lstat().st_mode):
            return ""
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        return None


def _link(goal: Path, old: Path) -> None:
    try:
        os.link(goal, old)
    except OSError as error:
        if error.errno not in _NO_LINK:
            raise
        shutil.copy2(goal, old)
        with old.open("rb+") as file:
            os.fsync(file.fileno())


def _relative(path: Path, folder: Path) -> str:
    real = Path(os.path.realpath(path.parent)) / path.name
    try:
        return os.path.relpath(real, folder)
    except ValueError:  # on another drive
        return str(real)


def _write(descriptor: int, content: dict[str, Any]) -> None:
    data = memoryview(json.dumps(content, indent=1).encode())
    while data:
        data = data[os.write(descriptor, data) :]
    os.fsync(descriptor)


def _read(path: Path, descriptor: int) -> tuple[Path | None, list[_Change]]:
    """Return the main journal that another one names, or the changes of a main one: none if it was not completed."""
    with os.fdopen(os.dup(descriptor), "rb") as file:
        text = file.read()
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return None, []
    try:
        if content["format"] != _FORMAT:
            raise ValueError
        if "journal" in content:
            return Path(os.path.normpath(path.parent / content["journal"])).with_name(path.name), []
        return None, [
            _Change(
                _token(path),
                int(entry["place"]),
                Path(os.path.normpath(path.parent / entry["goal"])),
                None if entry["before"] is None else str(entry["before"]),
                str(entry["after"]),
            )
            for entry in content["files"]
        ]
    except (KeyError, TypeError, ValueError):
        raise FileError(path, "is no journal of this version of truepose; run the version that wrote it") from None


def _token(path: Path) -> str:
    return path.name.removeprefix(".truepose-").removesuffix(".journal")


def sync_folder(folder: Path) -> None:
    """Flush a folder's entries to the disk, where the system can."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_FOLDER_SYNC:
            raise
    finally:
        os.close(descriptor)


def _new_journal(path: Path) -> int:
    """Create a journal and lock it; another run may take it for one that was left, and remove it before the lock."""
    while True:
        descriptor = os.open(path, _NEW, 0o644)
        if lock(descriptor) and path.exists():
            return descriptor
        os.close(descriptor)


@contextlib.contextmanager
def _signals_held() -> Iterator[None]:
    """Delay signals that would end the process until after the block (they reach the main thread only)."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    handlers: dict[int, Any] = {}

    def hold(number: int, _frame: FrameType | None) -> None:
        received.append(number)

    try:
        for name in _HELD:
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not None:
                handlers[number] = signal.signal(number, hold)
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(received):
            signal.raise_signal(number)


def _reason(error: BaseException) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
