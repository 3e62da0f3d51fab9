"""Threads of linear algebra and of compiled kernels: at most those of this process, one where the work is small."""

from __future__ import annotations

import itertools
import math
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Any, Final

from threadpoolctl import ThreadpoolController

LARGE: Final = 512
"""Rows of a matrix from which several threads are faster than one."""

RANGES: Final = 4
"""Ranges of a compiled loop for each thread: a thread that is ready early takes another."""

CGROUPS: Final = Path("/sys/fs/cgroup")
"""The control group of a container, as it sees itself."""
_FIRST: Final = ("quota", "period")

_is_worker = False


@cache
def cores() -> int:
    """Return how many processors this process may use: its CPU affinity and its container's limit count."""
    affinity = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limit = _container_limit(CGROUPS)
    return max(1, affinity if limit is None else min(affinity, limit))


def _container_limit(folder: Path) -> int | None:
    """Return the processors that the control group of this process may use, rounded up; None without a limit."""
    try:
        if (current := folder / "cpu.max").exists():
            quota, period = current.read_text(encoding="ascii").split()
        else:  # the first version of control groups
            quota, period = ((folder / f"cpu/cpu.cfs_{name}_us").read_text(encoding="ascii") for name in _FIRST)
        return math.ceil(int(quota) / int(period)) if int(quota) > 0 else None
    except (OSError, ValueError):  # no control group, or "max"
        return None


def threads() -> int:
    """Return how many threads a computation may use: all `cores`, or one in a worker process."""
    return 1 if _is_worker else cores()


@contextmanager
def blas_threads(n: int, large: float = LARGE) -> Iterator[None]:
    """Let BLAS work on n-row matrices in one thread where n is small; in all usable threads otherwise.

    A limit that holds already is never raised: that of an outer context, of the caller's own threadpoolctl, or of a
    variable such as OPENBLAS_NUM_THREADS.
    """
    most = threads() if n >= large else 1
    raised = [(library, before) for library in _blas() if (before := library.num_threads) > most]
    for library, _ in raised:  # threadpoolctl's own context takes longer than a small prediction
        library.set_num_threads(most)
    try:
        yield
    finally:
        for library, before in raised:
            library.set_num_threads(before)


def kernel_count() -> int:
    """Return how many threads may run compiled kernels at once: `threads`, or fewer where numba has a limit."""
    import numba

    return min(int(numba.get_num_threads()), threads())


@contextmanager
def kernel_threads(n: int, large: int = LARGE) -> Iterator[None]:
    """Let compiled kernels over n² pairs work in one thread where n is small; their results are the same."""
    import numba

    before = numba.get_num_threads()
    numba.set_num_threads(min(before, threads()) if n >= large else 1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


@contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS and compiled kernels work in one thread."""
    with blas_threads(0), kernel_threads(0):
        yield


def in_threads(kernel: Callable[..., None], parts: int, *arguments: Any) -> None:
    """Call ``kernel(start, stop, *arguments)`` for ranges that cover 0 … parts, in the threads that kernels may use.

    The kernel is compiled with ``nogil=True`` and writes its results into arrays. numba's own parallel loops take
    three times as long to compile.
    """
    import numba

    count = min(numba.get_num_threads(), parts)
    if count <= 1:
        kernel(0, parts, *arguments)
        return
    limits = [parts * i // (count * RANGES) for i in range(count * RANGES + 1)]
    ranges = iter([(start, stop) for start, stop in itertools.pairwise(limits) if stop > start])

    def work() -> None:
        while (limit := next(ranges, None)) is not None:
            kernel(*limit, *arguments)

    others = [_pool().submit(work) for _ in range(count - 1)]
    work()
    for other in others:
        other.result()


@cache
def _pool() -> ThreadPoolExecutor:
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork
    return ThreadPoolExecutor(cores(), "truepose-kernel")


def become_worker() -> None:
    """Make this process a worker: one thread, an interrupt is left to its parent, and it ends when its parent ends."""
    import numba

    global _is_worker
    _is_worker = True
    numba.set_num_threads(1)
    ThreadpoolController().limit(limits=1)  # for the life of the process: the limiter is not used as a context
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@cache
def _blas() -> list[Any]:
    """Return the BLAS libraries of numpy and scipy, each with its number of threads."""
    import scipy.linalg  # noqa: F401  its BLAS has to be loaded to be found

    return list(ThreadpoolController().select(user_api="blas").lib_controllers)
