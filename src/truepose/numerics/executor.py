"""Where tasks run: the contract of an executor, and the form that runs them in this process.

A task is a pure function of hashes and plain values, so its result does not depend on where and when it runs. Larger
inputs, such as a map, are shared once by their SHA-256, and each process decodes them once. Every form runs tasks in
one thread, so that sums have one order. The forms are `Serial`, `truepose.numerics.processes.Processes` and
``truepose.jobs.executor.cluster.Cluster``.
"""

from __future__ import annotations

import hashlib
import warnings
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from typing import Any, Final, Protocol, Self, TypeVar

from truepose.errors import DataError
from truepose.numerics.threads import one_thread

T = TypeVar("T")
AHEAD: Final = 8
"""The number of tasks for each worker that are handed over before earlier ones are finished."""
_DECODED: Final = 4  # inputs that a process keeps decoded


@dataclass(frozen=True)
class Task:
    """The input of one call of a task's function.

    Attributes
    ----------
    inputs : tuple of str
        The keys of shared inputs, as `Executor.share` returned them.
    values : tuple
        Plain values that can be pickled.
    key : str
        The identity of the task beside its function and its inputs, for executors that keep finished results; empty if
        the result is not to be kept.
    """

    inputs: tuple[str, ...] = ()
    values: tuple[Any, ...] = ()
    key: str = ""


class Inputs(Protocol):
    """The shared inputs, as a task finds them where it runs."""

    def get(self, key: str, decode: Callable[[bytes], T]) -> T:
        """Return a shared input, decoded; a process decodes it once."""


Function = Callable[[Inputs, Task], Any]
"""A function of a module, with the inputs and the task as its arguments."""


class Executor(Protocol):
    """A form of execution. As a context manager it ends what it has started."""

    @property
    def workers(self) -> int:
        """The number of tasks that run at once."""

    def share(self, encode: Callable[[], bytes], value: Any) -> str:
        """Share an input with all tasks, as bytes or, in this process, as it is; return its key."""

    def run(self, function: Function, tasks: Iterable[Task | None], *, ahead: int = AHEAD) -> Iterator[tuple[int, Any]]:
        """Run tasks; yield each result as it comes, with the place of its task.

        `tasks` is read as workers get free, at most `ahead` tasks for each worker before their results. A None among
        them says that the next task comes only after another result was taken.
        """

    def __enter__(self) -> Self: ...
    def __exit__(self, *error: Any) -> None: ...


class Waiting:
    """Tasks that are not yet handed over.

    Parameters
    ----------
    tasks : iterable of Task, optional
        The tasks, with None where the next one has to wait for another result.
    """

    def __init__(self, tasks: Iterable[Task | None]) -> None:
        self._tasks, self._places = iter(tasks), count()

    def next(self) -> tuple[int, Task] | None:
        """Return the next task with its place; None if there is none, or none before another result was taken."""
        task = next(self._tasks, None)
        return None if task is None else (next(self._places), task)


def run_in_order(
    executor: Executor, function: Function, tasks: Iterable[tuple[T, Task]], *, ahead: int = 2
) -> Iterator[tuple[T, Any]]:
    """Run tasks and yield their results in the order of the tasks, each with what is beside its task.

    A slow task delays the others once twice the tasks that are handed over at a time wait for it, so that memory does
    not grow with the number of tasks.

    Parameters
    ----------
    executor : Executor
        Where they run.
    function : Function
        The function of the tasks.
    tasks : iterable of (any, Task)
        The tasks, each with what comes back beside its result; read some at a time.
    ahead : int
        The number of tasks for each worker that are handed over before earlier ones are finished.
    """
    held, found, following = deque[T](), dict[int, Any](), 0

    def handed_over() -> Iterator[Task | None]:
        for kept, task in tasks:
            held.append(kept)
            yield task
            while len(held) >= 2 * ahead * executor.workers:
                yield None

    for place, result in executor.run(function, handed_over(), ahead=ahead):
        found[place] = result
        while following in found:
            yield held.popleft(), found.pop(following)
            following += 1


class Serial:
    """The form that runs tasks one by one in this process."""

    workers: Final = 1

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}
        self._keys = count()

    def share(self, encode: Callable[[], bytes], value: Any) -> str:
        """Keep an input as it is."""
        key = f"input {next(self._keys)}"
        self._values[key] = value
        return key

    def get(self, key: str, decode: Callable[[bytes], T]) -> T:
        """Return an input as it is."""
        found: T = self._values[key]
        return found

    def run(self, function: Function, tasks: Iterable[Task | None], *, ahead: int = AHEAD) -> Iterator[tuple[int, Any]]:
        """Run tasks in their order."""
        for index, task in enumerate(task for task in tasks if task is not None):
            with one_thread():
                result = function(self, task)
            yield index, result

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: Any) -> None:
        self._values.clear()


class ReadInputs:
    """Shared inputs of a worker, read by hash.

    Parameters
    ----------
    read : callable
        A function that returns the bytes of a SHA-256.
    """

    def __init__(self, read: Callable[[str], bytes]) -> None:
        self._read = read

    def get(self, key: str, decode: Callable[[bytes], T]) -> T:
        """Return a shared input, decoded once in this process.

        Raises
        ------
        DataError
            If the bytes are not those of the hash.
        """
        if key not in _decoded:
            data = self._read(key)
            if hashlib.sha256(data).hexdigest() != key:
                raise DataError(f"a worker got other bytes than those of the input {key[:12]}; run the command again")
            _decoded[key] = decode(data)
            while len(_decoded) > _DECODED:
                _decoded.popitem(last=False)
        _decoded.move_to_end(key)
        found: T = _decoded[key]
        return found


_decoded: Final[OrderedDict[str, Any]] = OrderedDict()


@dataclass(frozen=True)
class Returned:
    """The result of a task in a worker, and the warnings that it gave, which the process that asked repeats."""

    result: Any
    warnings: tuple[Warning, ...] = ()

    def delivered(self) -> Any:
        """Return the result after a repeat of the warnings."""
        for warning in self.warnings:
            warnings.warn(warning, stacklevel=2)
        return self.result


def work(function: Function, inputs: Inputs, task: Task) -> Returned:
    """Run a task in a worker, in one thread."""
    with warnings.catch_warnings(record=True) as caught, one_thread():
        warnings.simplefilter("always", UserWarning)
        result = function(inputs, task)
    kept = {str(one.message): one.message for one in caught if issubclass(one.category, UserWarning)}
    return Returned(result, tuple(one for one in kept.values() if isinstance(one, Warning)))
