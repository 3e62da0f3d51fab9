"""The turns of the tool that positions alone do not show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose._typing import FloatArray
from truepose.predictors.kinematic.design import Design
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.orientation import rotation_per_mm, unknown_rotations


def unknown_turns(hyper: Hyperparameters, unseen: Sequence[int], design: Design) -> FloatArray:
    """Return columns of the unknown rotations due to Z and to joints without a visible error, (m, 6, k).

    Parameters
    ----------
    hyper : Hyperparameters
        The hyperparameters of the fit.
    unseen : sequence of int
        The joints without a visible error, which is assumed to be of the size of the others.
    design : Design
        The columns of poses.
    """
    found = [unknown_rotations(hyper.rest_std * rotation_per_mm(design.lever))]
    if unseen:
        axis = np.zeros((len(design.q), 6, len(unseen)))
        axis[:, 3:] = design.lever[:, 3:, unseen]
        found.append(axis * np.sqrt(np.mean(np.square(hyper.joint_std))) if len(hyper.joint_std) else 0 * axis)
    return np.concatenate(found, axis=2)
