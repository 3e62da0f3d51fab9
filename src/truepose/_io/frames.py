"""Tables for pandas, which is optional: ``pip install truepose[pandas]``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from truepose.errors import DataError

if TYPE_CHECKING:
    from pandas import DataFrame


def data_frame(columns: Mapping[str, Any], **facts: Any) -> DataFrame:
    """Return a pandas table of columns (n,) by name; `facts` are kept in its ``attrs``.

    Raises
    ------
    DataError
        If pandas is not installed.

    Examples
    --------
    >>> data_frame({"lag": [1.0, 2.0]}, estimator="matheron").attrs
    {'estimator': 'matheron'}
    """
    try:
        from pandas import DataFrame
    except ImportError:
        raise DataError("pandas is not installed; install it with: pip install truepose[pandas]") from None
    frame = DataFrame(dict(columns))
    frame.attrs.update(facts)
    return frame


def by_axis(values: NDArray[Any], name: str) -> dict[str, NDArray[Any]]:
    """Return the columns of a (n, 3) array by name: ``{}`` in it stands for x, y, z.

    Examples
    --------
    >>> import numpy as np
    >>> list(by_axis(np.zeros((5, 3)), "{}_std_mm"))
    ['x_std_mm', 'y_std_mm', 'z_std_mm']
    """
    return {name.format(axis): values[:, k] for k, axis in enumerate("xyz")}
