"""The conditions of commanded configurations, as predictors take them: see `truepose.predictors.conditions`."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.predictors import Predictor
from truepose.predictors.abilities import Conditional
from truepose.predictors.conditions import joined
from truepose.samples import Poses

_REVERSALS: Final = 3  # samples from each side that tell the backlash of a joint


def conditions_of(poses: Poses) -> dict[str, FloatArray]:
    """Return the conditions that poses state: ``approach`` (n, dof)."""
    return {} if poses.approach is None else {"approach": poses.approach}


def conditions_told(samples: Poses) -> dict[str, FloatArray]:
    """Return the conditions whose effects samples can tell: approaches of at least one joint from both sides."""
    known = conditions_of(samples)
    if samples.approach is not None:
        both = np.minimum((samples.approach > 0).sum(axis=0), (samples.approach < 0).sum(axis=0))
        if both.max() < _REVERSALS:
            del known["approach"]
    return known


def with_conditions(x: FloatArray, predictor: Predictor, poses: Poses) -> FloatArray:
    """Return coordinates of poses (n, d) with the conditions that a predictor uses; NaN where poses state none."""
    used = predictor.conditions if isinstance(predictor, Conditional) else ()
    return joined(x, used, conditions_of(poses)) if used else x
