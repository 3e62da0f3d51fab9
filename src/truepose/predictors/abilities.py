"""Optional abilities of predictors: protocols that are tested with ``isinstance``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, Self, runtime_checkable

from numpy.typing import ArrayLike

from truepose._typing import FloatArray, IntArray
from truepose.numerics.frozen import Constants
from truepose.numerics.frozen_deviation import Deviation
from truepose.predictors.distances import DistanceRows
from truepose.predictors.estimates import ParameterEstimates
from truepose.predictors.tails import Tails


@runtime_checkable
class Updatable(Protocol):
    """A predictor that takes further samples into a fit without starting again."""

    def update(self, X: ArrayLike, y: ArrayLike, noise_std: ArrayLike | None = None) -> Self:
        """Add samples to the fit; the arguments are those of `Predictor.fit`."""


@runtime_checkable
class Startable(Protocol):
    """A predictor whose search for hyperparameters can start at their optimum for similar samples."""

    def optimum(self) -> Any:
        """Return the optimum of this fit; it can be pickled."""

    def start_from(self, optimum: Any) -> None:
        """Let the next fits start at the `optimum` of a model of equal parameters."""


@runtime_checkable
class Conditional(Protocol):
    """A predictor whose input may have columns of conditions after the joints, see `truepose.predictors.conditions`."""

    conditions: Sequence[str]

    def models(self, condition: str) -> bool:
        """Return whether the effect of a condition is in the fitted model, not negligible."""

    def at_work(self, work: Mapping[str, float]) -> Self:
        """Return the fitted model for another ``temperature`` [°C] or ``payload`` [kg] at work."""


@runtime_checkable
class TurnTaking(Protocol):
    """A fitted predictor that can take measured orientations in addition."""

    def with_turns(self, X: ArrayLike, conditions: Sequence[str]) -> tuple[Self, bool]:
        """Return the fit with the orientations in X, and whether left-out positions gain from them."""


@runtime_checkable
class DistanceTaking(Protocol):
    """A fitted predictor that can take distances in addition."""

    distances: bool
    distance_rows: DistanceRows | None
    gross_distances_: IntArray

    def with_distances(self, rows: DistanceRows) -> tuple[Self, bool]:
        """Return the fit with distances, and whether left-out readings gain from them."""


@runtime_checkable
class Differentiable(Protocol):
    """A predictor whose prediction has a derivative in closed form."""

    def gradient(self, X: ArrayLike) -> FloatArray:
        """Return the derivative of the prediction by the coordinates, (m, k, d)."""


@runtime_checkable
class JointlyPredicting(Protocol):
    """A predictor that knows how its errors at different poses vary together."""

    def predict_together(self, X: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return predicted errors (m, 3) [mm] and the covariance of all of them, (3m, 3m) [mm²]."""


@runtime_checkable
class Freezable(Protocol):
    """A predictor whose errors follow from arrays alone, see `truepose.numerics.frozen`."""

    def constants(self) -> Constants:
        """Return the arrays of the fitted model's mean, at the measured point."""


@runtime_checkable
class DeviationFreezable(Protocol):
    """A predictor whose standard deviation has a bound that follows from arrays alone."""

    def deviation(self, constants: Constants, poses: FloatArray, added: FloatArray) -> Deviation:
        """Return the arrays of the bound, tight at poses such as these (m, dof) [rad]; a variance (3,) is added."""


@runtime_checkable
class ParameterEstimating(Protocol):
    """A fitted predictor that estimated parameters of the arm."""

    parameters_: Sequence[dict[str, Any]]

    def parameter_estimates(self) -> ParameterEstimates:
        """Return the parameters with the covariance of all of them, and with their priors."""


@runtime_checkable
class JointwisePredicting(Protocol):
    """A fitted predictor that knows an error of each joint as a function of its own angle."""

    joints_: IntArray

    @property
    def joint_length_(self) -> FloatArray:
        """The length of the error of each of `joints_`, (k,) [rad]: angles farther apart err nearly independently."""


@runtime_checkable
class OutlierWeighing(Protocol):
    """A fitted predictor that weighs outliers down itself."""

    gross_: IntArray


@runtime_checkable
class RobustlyJudging(Protocol):
    """A fitted predictor that can judge its readings by a robust fit, which gross ones hardly pull."""

    def robust_surprise(self) -> FloatArray:
        """Return the length of each reading's residual in standard deviations, both by the robust fit, (n,)."""


@runtime_checkable
class TailKnowing(Protocol):
    """A fitted predictor that knows whether readings have heavier tails than normal noise."""

    def tails(self) -> Tails:
        """Return the tails of the noise of the readings of the samples."""
