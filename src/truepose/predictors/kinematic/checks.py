"""The checks of what kinematic Kriging is given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol

from truepose._typing import FloatArray
from truepose.errors import DataError, KrigingError
from truepose.predictors.conditions import CONDITIONS
from truepose.predictors.distances import DistanceRows
from truepose.predictors.kinematic.terms import Residual
from truepose.predictors.kinematic.turned import turned_rows
from truepose.predictors.reflectors import REFLECTOR
from truepose.robots import Robot

FEWEST: Final = 6
"""The smallest number of samples."""


class Given(Protocol):
    """The parameters of `KinematicKriging` that are checked."""

    robot: Robot | None
    solver: str
    residual: Residual
    conditions: Sequence[str]
    random_state: int
    weight: Sequence[float] | None
    distances: bool
    distance_rows: DistanceRows | None


def check(given: Given, e: FloatArray, X: FloatArray) -> None:
    """Refuse parameters that are none, and errors (n, k) [mm] at X (n, d) that are too few or of other components.

    Raises
    ------
    DataError, KrigingError
        With what was expected.
    """
    if given.robot is None:
        raise KrigingError("kinematic Kriging needs the nominal robot; pass KinematicKriging(robot, …)")
    if given.solver not in ("auto", "covariance", "basis"):
        raise DataError(f'solver is {given.solver!r}; expected "auto", "covariance" or "basis"')
    if given.residual not in ("joint", "cartesian", "both", "none"):
        raise DataError(f'residual is {given.residual!r}; expected "joint", "cartesian", "both" or "none"')
    if given.random_state < 0:
        raise DataError(f"random_state must be at least 0, got {given.random_state}")
    if e.shape[1] != 3:
        raise DataError(f"kinematic Kriging predicts the 3 components of positional errors, but y has {e.shape[1]}")
    if len(e) < FEWEST:
        raise KrigingError(f"{len(e)} samples are too few for kinematic Kriging; measure {FEWEST} or more, better 60")
    for name in given.conditions:
        if name not in (*CONDITIONS, REFLECTOR):
            raise DataError(f"condition {name!r} is unknown; expected one of: {', '.join(CONDITIONS)}")
    expected = len(X) + len(turned_rows(X, given.conditions, given.robot.dof))
    more = 0 if given.distance_rows is None or not given.distances else len(given.distance_rows)
    if given.weight is not None and len(given.weight) not in (expected, expected + more):
        raise DataError(f"expected {expected} weights, one for each sample, got {len(given.weight)}")
