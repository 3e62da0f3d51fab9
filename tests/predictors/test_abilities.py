"""The optional abilities of predictors are found by isinstance."""

from __future__ import annotations

import numpy as np
import pytest

from truepose.predictors import (
    InverseDistance,
    KinematicCalibration,
    KinematicKriging,
    LocalKriging,
    OrdinaryKriging,
    VectorKriging,
)
from truepose.predictors.abilities import (
    Differentiable,
    JointlyPredicting,
    OutlierWeighing,
    ParameterEstimating,
    Startable,
    Updatable,
)


@pytest.mark.parametrize(
    ("model", "abilities"),
    [
        (InverseDistance(), set()),
        (OrdinaryKriging(), {Differentiable, Startable}),
        (LocalKriging(), {Differentiable, Startable}),
        (VectorKriging(), {Differentiable}),
        (KinematicCalibration(), set()),
        (KinematicKriging(), {Updatable, Startable, JointlyPredicting}),
    ],
    ids=lambda value: type(value).__name__,
)
def test_abilities_of_predictors(model, abilities):
    every = (Updatable, Startable, Differentiable, JointlyPredicting, ParameterEstimating, OutlierWeighing)
    assert {one for one in every if isinstance(model, one)} == abilities


def test_fitted_attributes_are_abilities():
    model = KinematicKriging()
    model.parameters_, model.gross_ = [{"parameter": "a1"}], np.empty(0, np.int64)
    assert isinstance(model, ParameterEstimating)
    assert isinstance(model, OutlierWeighing)
