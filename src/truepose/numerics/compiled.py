"""How kernels are compiled: cached on disk, IEEE division, and fast-math only as far as sums may be reordered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

F = TypeVar("F", bound=Callable[..., Any])

REORDER: Final = {"reassoc", "contract", "nsz"}
"""Fast-math flags that let a sum be vectorised; NaN and infinity keep their meaning."""

BLOCK: Final = 256
"""Points in one block of `pack`: a distance buffer of 2 kB, well inside the first-level cache."""


def compiled(**options: Any) -> Callable[[F], F]:
    """Return numba's `njit` with this project's options, typed."""
    return cast("Callable[[F], F]", numba.njit(cache=True, error_model="numpy", **options))


def pack(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rows of an (n, c) array in blocks (blocks, c, BLOCK) padded with zeros: inner loops run over points.

    Examples
    --------
    >>> pack(np.ones((300, 3))).shape
    (2, 3, 256)
    """
    n, c = columns.shape
    blocks = -(-n // BLOCK)
    padded = np.zeros((blocks * BLOCK, c))
    padded[:n] = columns
    return np.ascontiguousarray(padded.reshape(blocks, BLOCK, c).transpose(0, 2, 1))
