"""Calibration with a neural network for its residuals (theory (11)); inputs are joint angles and approach signs."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose._extras import needed
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
    """Calibrate, then train networks with one hidden layer on the residuals.

    Five networks are trained, each without one fifth of the samples, and their mean is the prediction. Each fifth is
    also predicted by the network that has not seen it: these residuals give the standard deviation, and their slope
    scales the networks' output, down to 0 if the networks have learnt nothing.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    tf_flange_tool : (4, 4) array or (3,) array [mm], optional
        The measured point.
    terms : sequence of str
        The joint terms of the calibration, see `KinematicCalibration`.
    hidden : int
        The number of neurons of the hidden layer.
    decay : float
        The penalty of squared weights, on scaled inputs and outputs.
    random_state : int
        The seed of the folds and of the initial weights.
    misfit_std, identified, shrink, noise, weights
        The values of a previous fit; nothing is trained then.

    Attributes
    ----------
    calibration_ : KinematicCalibration
        The fitted calibration.
    shrink_ : float
        The factor of the networks' output: 0 if they have learnt nothing, 1 if they are right.
    noise_ : (3,) array [mm]
        The standard deviation of left-out samples.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> robot = load_robot("kuka-kr150-2")
    >>> q = np.random.default_rng(0).uniform(-1, 1, (60, 6))
    >>> e = 0.3 * robot.error_jacobian(q, parameters=["a3"])[:, :, 0]
    >>> model = ResidualNetwork(robot, hidden=4).fit(q, e)
    >>> bool(np.abs(model.predict(q) - e).max() < 0.01)
    True
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
        for name, value, least in (
            ("hidden", self.hidden, 1),
            ("decay", self.decay, 0),
            ("random_state", self.random_state, 0),
        ):
            if not value >= least:
                raise DataError(f"{name} of ResidualNetwork must be at least {least}, got {value}")
        self.calibration_ = KinematicCalibration(
            self.robot, self.tf_flange_tool, terms=self.terms, misfit_std=self.misfit_std, identified=self.identified
        ).fit(X, e, noise_std)
        left, _ = self.calibration_.leave_one_out()
        inputs = self._inputs(X)
        fold = random_folds(len(X), _FOLDS, rng=self.random_state)
        if self.weights is None:
            self.weights_ = [self._train(inputs[fold != k], left[fold != k], k) for k in range(_FOLDS)]
        else:
            self.weights_ = [tuple(np.asarray(layer, float) for layer in net) for net in self.weights]  # type: ignore[misc]  # three arrays
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
        known = np.mean(field**2, axis=0)  # left-out residuals include the uncertainty of the field
        if reading is not None:
            known = known + np.mean(reading**2, axis=0)
        return np.asarray(np.maximum(self.noise_**2 - known, 0.0))

    def _leave_one_out(self) -> LeaveOneOut:
        """Predict each fifth by the network that has not seen it, after the calibration without the sample itself."""
        return LeaveOneOut(self._unseen, np.broadcast_to(self.noise_, self._unseen.shape).copy())

    def _fitted_parameters(self) -> dict[str, Any]:
        return {
            **self.calibration_._fitted_parameters(),
            "shrink": self.shrink_,
            "noise": tuple(self.noise_.tolist()),
            "weights": tuple(tuple(layer.tolist() for layer in net) for net in self.weights_),
        }

    def _to_fit_again(self) -> Self:
        return self._unfitted()  # trained weights have seen the samples left out

    def _inputs(self, X: FloatArray) -> FloatArray:
        """Return cosine and sine of each joint, and the approach signs if there are any."""
        assert self.robot is not None
        q, rest = X[:, : self.robot.dof], X[:, self.robot.dof :]
        return np.column_stack([np.cos(q), np.sin(q), rest])

    def _train(self, inputs: FloatArray, left: FloatArray, k: int) -> Layers:
        with needed("the training of a neural network", "network", "choose another predictor"):
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
        # fold the scales into the weights, so that a plain network remains
        return (
            first / width[:, None],
            net.intercepts_[0] - (centre / width) @ first,
            second * size,
            net.intercepts_[1] * size,
        )


def _answer(net: Layers, inputs: FloatArray) -> FloatArray:
    first, first_bias, second, second_bias = net
    return np.asarray(np.tanh(inputs @ first + first_bias) @ second + second_bias)
