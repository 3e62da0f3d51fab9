"""The form of an executor that runs tasks in processes of this machine."""

from __future__ import annotations

import hashlib
import multiprocessing
import multiprocessing.context
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Self

from truepose.errors import DataError
from truepose.numerics.executor import AHEAD, Executor, Function, ReadInputs, Returned, Serial, Task, Waiting, work
from truepose.numerics.threads import become_worker, cores

_DEATHS: Final = 3
"""The number of times that the processes are started again after one of them was killed."""


class Processes:
    """The form that runs tasks in processes, each with one thread.

    A process that is killed costs the time of its task: finished results stay, the others are computed again.

    Parameters
    ----------
    workers : int
        The number of processes; never more than the processors available to this process. A script that asks for more
        than one needs the usual ``if __name__ == "__main__":``.
    purpose : str
        What the tasks are for, in the message of an error.
    """

    def __init__(self, workers: int, purpose: str = "tasks") -> None:
        self.workers = max(1, min(workers, cores()))
        self._purpose = purpose
        self._pool: ProcessPoolExecutor | None = None
        self._others: set[Any] = set()

    @cached_property
    def _folder(self) -> TemporaryDirectory[str]:
        return TemporaryDirectory(prefix="truepose-inputs-")

    def share(self, encode: Callable[[], bytes], value: Any) -> str:
        """Write an input where the processes read it."""
        data = encode()
        key = hashlib.sha256(data).hexdigest()
        (Path(self._folder.name) / key).write_bytes(data)
        return key

    def run(self, function: Function, tasks: Iterable[Task | None], *, ahead: int = AHEAD) -> Iterator[tuple[int, Any]]:
        """Run tasks; a task whose process was killed runs again.

        Raises
        ------
        DataError
            If processes are killed again and again.
        """
        waiting, again = Waiting(tasks), list[tuple[int, Task]]()
        pending: dict[Future[Returned], tuple[int, Task]] = {}
        deaths = 0
        while True:
            while len(pending) < ahead * self.workers:
                if (following := again.pop(0) if again else waiting.next()) is None:
                    break
                try:
                    pending[self._submit(function, following[1])] = following
                except BrokenProcessPool:
                    again.insert(0, following)
                    break
            if not (pending or again):
                return
            finished, broken = wait(pending, return_when=FIRST_COMPLETED)[0], not pending
            for future in finished:
                index, task = pending.pop(future)
                try:
                    returned = future.result()
                except BrokenProcessPool:
                    again.append((index, task))
                    broken = True
                else:
                    yield index, returned.delivered()
            if broken:
                again = sorted([*again, *pending.values()], key=lambda one: one[0])
                pending.clear()
                self._end()
                if (deaths := deaths + 1) > _DEATHS:
                    raise DataError(
                        f"{self._purpose}: one of {self.workers} worker processes died, and again after "
                        f"{_DEATHS} new starts, perhaps out of memory; use 1 worker"
                    )

    def _submit(self, function: Function, task: Task) -> Future[Returned]:
        if self._pool is None:
            self._others = set(multiprocessing.active_children())
            context = start_method(function.__module__)
            self._pool = ProcessPoolExecutor(self.workers, context, _start, (self._folder.name,))
        return self._pool.submit(_work, function, task)

    def _end(self) -> None:
        """End the processes at once."""
        if self._pool is not None:
            for process in set(multiprocessing.active_children()) - self._others:
                process.terminate()
            self._pool.shutdown(cancel_futures=True)  # waits until the pool itself has seen the end of each process
            self._pool = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is not None:
            self._end()
        elif self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        if "_folder" in self.__dict__:
            self._folder.cleanup()


def local(workers: int, purpose: str = "tasks") -> Executor:
    """Return the executor of this machine for a number of workers: this process for one."""
    return Serial() if workers <= 1 or cores() == 1 else Processes(workers, purpose)


def start_method(preload: str) -> multiprocessing.context.BaseContext:
    """Return the way to start processes: a server that has imported the code once, where the system supports it."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    from multiprocessing import forkserver, resource_tracker  # not on Windows

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, "numba", preload])  # workers import numba at their start
    resource_tracker.ensure_running()  # first, because it unblocks signals
    # processes inherit what is blocked: Ctrl-C ends this process only, and this process ends the others
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    return context


_inputs: ReadInputs | None = None  # of a worker process


def _start(folder: str) -> None:
    global _inputs
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where it is not blocked: Windows
    # with a method that forks, numba makes a semaphore, which a worker that is ended leaves behind
    multiprocessing.set_start_method("spawn", force=True)
    become_worker()
    _inputs = ReadInputs(lambda key: (Path(folder) / key).read_bytes())


def _work(function: Function, task: Task) -> Returned:
    assert _inputs is not None
    return work(function, _inputs, task)
