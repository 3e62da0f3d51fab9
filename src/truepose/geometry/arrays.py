"""Checks of input arrays; their messages state the received and the expected shape, and the rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError


def as_rows(name: str, value: ArrayLike, width: int, *, single: bool = False) -> FloatArray:
    """Return `value` as a finite float array of shape (n, width) with n > 0.

    Parameters
    ----------
    name : str
        The name of the array in messages.
    value : array_like (n, width)
        The array, in any unit.
    width : int
        The expected number of columns.
    single : bool
        Whether one row of shape (width,) is accepted as well; it is returned with this shape.

    Raises
    ------
    DataError
        If it is not an array of numbers, has another shape, no rows, or NaN or infinite entries (the message names the
        rows).
    """
    array = as_floats(name, value)
    if single and array.shape == (width,):
        check_finite(name, array[None])
        return array
    if array.ndim != 2 or array.shape[1] != width:
        wanted = f"({width},) or (n, {width})" if single else f"(n, {width})"
        raise DataError(f"{name} has shape {array.shape}, expected {wanted}")
    if not len(array):
        raise DataError(f"{name} is empty, expected at least one row of {width} numbers")
    check_finite(name, array)
    return array


def as_floats(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a float array; raise `DataError` if it is not an array of numbers."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise DataError(f"{name} is not an array of numbers (got {type(value).__name__})") from None


def check_finite(name: str, array: FloatArray) -> None:
    """Raise `DataError` if rows (first axis) have NaN or infinite numbers; the message names them."""
    finite = np.isfinite(array)
    if not finite.all():
        bad = np.flatnonzero(~finite.reshape(len(array), -1).all(axis=1))
        raise DataError(f"{name} has NaN or infinite numbers in {name_rows(bad)}; remove these rows")


def name_rows(rows: IntArray, limit: int = 5) -> str:
    """Return a list of rows, counted from 0, for a message: "row 3", "rows 1, 4, 5, 6, 9 and 12 more".

    Examples
    --------
    >>> import numpy as np
    >>> name_rows(np.array([3]))
    'row 3'
    >>> name_rows(np.arange(8), limit=3)
    'rows 0, 1, 2 and 5 more'
    """
    listed = ", ".join(str(row) for row in rows[:limit])
    more = f" and {len(rows) - limit} more" if len(rows) > limit else ""
    return f"row{'s' if len(rows) > 1 else ''} {listed}{more}"
