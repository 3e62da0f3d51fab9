"""A neural network for what calibration leaves, theory (11): inputs the joints' angles, and the approach signs."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.predictors.base import LeaveOneOut, Predictor
from truepose.predictors.calibration import KinematicCalibration
from truepose.predictors.folds import random_folds
from truepose.robots import Robot

Layers = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

_FOLDS: Final = 5
_STEPS: Final = 300


class ResidualNetwork(Predictor):
    """Calibrate, then teach networks of one hidden layer what is left.

    One network is trained without each fifth of the samples, and their mean predicts; each fifth, predicted by the
    network that has not seen it, gives the standard deviation and how far the networks are to be trusted: their answer
    is shrunk by the slope of the left-out residuals on it, to nothing where they have found nothing.

    Parameters
    ----------
    robot, tf_flange_tool, terms
        See `KinematicCalibration`. X may hold approach signs, (n, 2 dof).
    hidden : int
        Neurons of the hidden layer.
    decay : float
        Penalty of squared weights, on scaled inputs and outputs.
    random_state : int
        Of folds and starting weights.
    misfit_std, identified, shrink, noise, weights
        What was found before: nothing is trained then.

    Attributes
    ----------
    calibration_ : KinematicCalibration
    shrink_ : float
        0 where the networks are of no use, 1 where they are right.
    noise_ : (3,) array [mm]
        Standard deviation of left-out samples.
    """

    arm_parameters: ClassVar[tuple[str, ...]] = ("robot", "tf_flange_tool")

    def __init__(
        self,
        robot: Robot | None = None,
        tf_flange_tool: ArrayLike | None = None,
        terms: Sequence[str] = (),
        hidden: int = 40,
        decay: float = 0.3,
        random_state: int = 0,
        misfit_std: float | None = None,
        identified: Sequence[float] | None = None,
        shrink: float | None = None,
        noise: Sequence[float] | None = None,
        weights: Sequence[Any] | None = None,
    ) -> None:
        self.robot = robot
        self.tf_flange_tool = tf_flange_tool
        self.terms = terms
        self.hidden = hidden
        self.decay = decay
        self.random_state = random_state
        self.misfit_std = misfit_std
        self.identified = identified
        self.shrink = shrink
        self.noise = noise
        self.weights = weights

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        if len(X) < 4 * _FOLDS:
            raise DataError(f"{len(X)} samples are too few for networks, expected at least {4 * _FOLDS}, better 200")
        self.calibration_ = KinematicCalibration(
            self.robot, self.tf_flange_tool, terms=self.terms, misfit_std=self.misfit_std, identified=self.identified
        ).fit(X, e, noise_std)
        left, _ = self.calibration_.leave_one_out()
        inputs = self._inputs(X)
        fold = random_folds(len(X), _FOLDS, rng=self.random_state)
        if self.weights is None:
            self.weights_ = [self._train(inputs[fold != k], left[fold != k], k) for k in range(_FOLDS)]
        else:
            self.weights_ = [tuple(np.asarray(layer, float) for layer in net) for net in self.weights]  # type: ignore[misc]
        unseen = np.empty_like(e)
        for k, net in enumerate(self.weights_):
            unseen[fold == k] = _answer(net, inputs[fold == k])
        square = float((unseen**2).sum())
        slope = float((unseen * left).sum()) / square if square > 0 else 0.0
        self.shrink_ = float(np.clip(slope, 0.0, 1.0)) if self.shrink is None else self.shrink
        self._unseen = left - self.shrink_ * unseen
        found = np.sqrt((self._unseen**2).mean(axis=0))
        self.noise_ = found if self.noise is None else np.asarray(self.noise, float)

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        e, std = self.calibration_.predict(X, return_std=True)
        answers = np.array([_answer(net, self._inputs(X)) for net in self.weights_])
        e = e + self.shrink_ * answers.mean(axis=0)
        if not return_std:
            return e, None
        variance = std**2 + (self.shrink_ * answers.std(axis=0, ddof=1)) ** 2
        return e, np.sqrt(variance)

    def _nugget_variance(self) -> FloatArray:
        X, _, reading = self._given
        _, field = self._predict(X, True)
        assert field is not None
        known = np.mean(field**2, axis=0)  # samples left out differ from their prediction by that as well
        if reading is not None:
            known = known + np.mean(reading**2, axis=0)
        return np.asarray(np.maximum(self.noise_**2 - known, 0.0))

    def _leave_one_out(self) -> LeaveOneOut:
        """Each fifth by the network that has not seen it, after the calibration without the sample itself."""
        return LeaveOneOut(self._unseen, np.broadcast_to(self.noise_, self._unseen.shape).copy())

    def _fitted_parameters(self) -> dict[str, Any]:
        return {
            **self.calibration_._fitted_parameters(),
            "shrink": self.shrink_,
            "noise": tuple(self.noise_.tolist()),
            "weights": tuple(tuple(layer.tolist() for layer in net) for net in self.weights_),
        }

    def _to_fit_again(self) -> Self:
        copy: Self = clone(self)
        return copy  # what was learnt would know the samples left out

    def _inputs(self, X: FloatArray) -> FloatArray:
        """Return cosine and sine of each joint, and the approach signs where there are any."""
        assert self.robot is not None
        q, rest = X[:, : self.robot.dof], X[:, self.robot.dof :]
        return np.column_stack([np.cos(q), np.sin(q), rest])

    def _train(self, inputs: FloatArray, left: FloatArray, k: int) -> Layers:
        from sklearn.neural_network import MLPRegressor

        centre, width = inputs.mean(axis=0), inputs.std(axis=0)
        width = np.where(width > 1e-9, width, 1.0)
        size = float(left.std()) or 1.0
        net = MLPRegressor(
            hidden_layer_sizes=(self.hidden,),
            activation="tanh",
            solver="lbfgs",
            alpha=self.decay,
            max_iter=_STEPS,
            max_fun=10 * _STEPS,
            random_state=self.random_state + k,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # stopping early is part of the method
            net.fit((inputs - centre) / width, left / size)
        first, second = net.coefs_
        # scales go into the weights: what is kept is one plain network
        return (
            first / width[:, None],
            net.intercepts_[0] - (centre / width) @ first,
            second * size,
            net.intercepts_[1] * size,
        )


def _answer(net: Layers, inputs: FloatArray) -> FloatArray:
    first, first_bias, second, second_bias = net
    return np.asarray(np.tanh(inputs @ first + first_bias) @ second + second_bias)
