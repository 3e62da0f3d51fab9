"""Where tasks run: the contract of an executor, and the form that runs them in this process.

A task is a pure function of hashes and plain values, so its result does not depend on where and when it runs. Larger
inputs, such as a map, are shared once by their SHA-256, and each process decodes them once. Every form runs tasks in
one thread, so that sums have one order. The forms are `Serial`, `truepose.numerics.processes.Processes` and
``truepose.jobs.executor.cluster.Cluster``.
"""

from __future__ import annotations

import hashlib
import warnings
from collections import OrderedDict
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

    def run(self, function: Function, tasks: Iterable[Task]) -> Iterator[tuple[int, Any]]:
        """Run tasks; yield each result as it comes, with the place of its task. `tasks` is read as workers get free."""

    def __enter__(self) -> Self: ...
    def __exit__(self, *error: Any) -> None: ...


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

    def run(self, function: Function, tasks: Iterable[Task]) -> Iterator[tuple[int, Any]]:
        """Run tasks in their order."""
        for index, task in enumerate(tasks):
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
