"""What the layouts share when they write samples: names and times of the rows."""

from __future__ import annotations

import numpy as np

from truepose._io.delimited import escaped
from truepose._typing import FloatArray
from truepose.samples import Samples

_SECONDS_PER_ROW = 15.0


def row_names(samples: Samples) -> list[str]:
    """Return a name for each row, as a cell that is no formula: its own, else the number of its pose, from 1."""
    assert samples.row is not None
    if samples.name is None:
        return [str(row + 1) for row in samples.row.tolist()]
    return [escaped(name) for name in samples.name.tolist()]


def row_times(samples: Samples) -> FloatArray:
    """Return the times of rows, (n,) [s]; one reading each quarter of a minute where they are not known."""
    if samples.time is not None:
        return samples.time
    return _SECONDS_PER_ROW * np.arange(float(len(samples)))
