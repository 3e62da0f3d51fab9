"""The step to which numbers of a table are rounded."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray

_POWERS: Final = range(-6, 1)  # of ten, of a step
_FEWEST: Final = 30  # numbers other than 0; with fewer, all may end in zeros by chance
_EXACT: Final = 1e-6  # of a step, or of the last digits of the number


def decimal_step(values: FloatArray, units: tuple[float, ...] = (1.0,)) -> float:
    """Return the decimal step of which all values are multiples, in the unit of the values; 0 if there is none.

    The step is a power of ten, from 1 to 1e-6, of one of the given units.

    Parameters
    ----------
    values : array
        The values, of any shape.
    units : tuple of float
        The units that the values may have been written in, as in the unit of the values.

    Examples
    --------
    >>> decimal_step(np.arange(40) * 0.3)
    0.1
    >>> decimal_step(np.deg2rad(np.arange(40) * 0.25), (1.0, np.pi / 180)) == np.pi / 180 * 0.01
    True
    >>> decimal_step(np.sqrt(np.arange(40)))
    0.0
    """
    known = values[values != 0.0]
    if len(known) < _FEWEST:
        return 0.0
    steps = [10.0**power * unit for unit in units for power in _POWERS]
    for step in sorted(steps, reverse=True):
        ratio = known / step
        if (np.abs(ratio - np.round(ratio)) <= _EXACT + 1e-12 * np.abs(ratio)).all():
            return float(step)
    return 0.0
