"""Threads of the linear algebra: a small matrix only waits for a second one, the more so on a busy machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from typing import Any, Final

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

LARGE: Final = 512


def blas_threads(n: int, large: int = LARGE) -> AbstractContextManager[Any]:
    """Return a context in which BLAS works on n-row matrices: in one thread where they are small."""
    if n >= large:
        return nullcontext()
    one: AbstractContextManager[Any] = _controller().limit(limits=1, user_api="blas")
    return one


@contextmanager
def kernel_threads(n: int, large: int = LARGE) -> Iterator[None]:
    """Let compiled kernels over n² pairs work in one thread where n is small; their results are the same."""
    import numba

    before = numba.get_num_threads()
    numba.set_num_threads(before if n >= large else 1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


@cache
def _controller() -> Any:
    import scipy.linalg  # noqa: F401  its BLAS must be there to be found

    return ThreadpoolController()
