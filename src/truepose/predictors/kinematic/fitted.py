"""What a fitted model of (10) predicts and shows."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from truepose._typing import FloatArray, IntArray
from truepose.numerics.frozen import Constants
from truepose.numerics.frozen_deviation import Deviation
from truepose.predictors.conditioned import ConditionedPredictor
from truepose.predictors.kinematic.design import Design
from truepose.predictors.kinematic.fleet import Fleet
from truepose.predictors.kinematic.frozen import constants_of
from truepose.predictors.kinematic.frozen_deviation import deviation_of
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.summary import Form, JointCurve, joint_curve
from truepose.predictors.kinematic.terms import Terms
from truepose.predictors.kinematic.turns import unknown_turns
from truepose.predictors.orientation import at_offset


class FittedKriging(ConditionedPredictor):
    """The predictions of kinematic Kriging from its fitted terms, hyperparameters and posterior."""

    if TYPE_CHECKING:
        _terms: Terms
        _form: Form
        hyper_: Hyperparameters
        joints_: IntArray
        unseen_: list[int]
        inflation_: float
        _fleet: Fleet | None

    @property
    def joint_length_(self) -> FloatArray:
        """The lengths of the errors of `joints_`, (k,) [rad]."""
        return self.hyper_.joint_length

    def _known(self, design: Design) -> FloatArray:
        """Return the part of the errors that no coefficient multiplies, (m, r) [mm, rad]: nonlinear, and a fleet's."""
        known = self._terms.curvature(design)
        return known if self._fleet is None else known + self._fleet.errors(design, self._terms)

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        design = self._terms.at(X)
        if not return_std:
            return self._form.mean(design) + self._known(design), None
        e, covariance = self._form.posterior(design)
        variance = self.inflation_ * np.maximum(np.einsum("maa->ma", covariance), 0.0)
        return e + self._known(design), np.sqrt(variance + np.sum(self._unknown(design) ** 2, axis=2))

    def _unknown(self, design: Design) -> FloatArray:
        """Return columns of the effects of conditions that are not known, of unit variance: (m, r, c) [mm, rad]."""
        if not (design.unknown.shape[2] or design.mass.shape[2]):
            return design.unknown
        return self._terms.unknown_effects(design, *self._form.drift_estimate())

    def _nugget_variance(self) -> FloatArray:
        return np.full(3, self.inflation_ * self.hyper_.noise**2)

    def predict_covariance(self, X: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return predicted errors (m, 3) [mm] and their covariances (m, 3, 3) [mm²] at joints (m, dof) [rad]."""
        self._check_fitted()
        design = self._terms.at(self._validate(X)[0])
        e, covariance = self._form.posterior(design)
        unknown = self._unknown(design)
        added = unknown @ np.swapaxes(unknown, 1, 2)
        return e + self._known(design), self.inflation_ * covariance + added

    def _predict_pose(
        self, X: FloatArray, return_std: bool, offset: FloatArray | None
    ) -> tuple[FloatArray, FloatArray | None]:
        """Predict with all terms but Z in the rows of orientation.

        The standard deviation due to Z is that of `rotation_per_mm`. Joints whose error is not visible in positions are
        assumed to have the same error as the others.
        """
        design = self._terms.at(X, "pose")
        curvature = at_offset(self._known(design)[:, :, None], offset)[:, :, 0]
        turns = unknown_turns(self.hyper_, self.unseen_, design)
        unknown, effects = at_offset(turns, offset), at_offset(self._unknown(design), offset)
        design = replace(design, drift=at_offset(design.drift, offset), lever=at_offset(design.lever, offset))
        if not return_std:
            return self._form.mean(design) + curvature, None
        error, covariance = self._form.posterior(design)
        variance = self.inflation_ * np.maximum(np.einsum("maa->ma", covariance) + np.sum(unknown**2, axis=2), 0.0)
        return error + curvature, np.sqrt(variance + np.sum(effects**2, axis=2))

    def _lever(self, X: FloatArray) -> FloatArray:
        return self._terms.at(X).lever

    def constants(self) -> Constants:
        """Return the arrays from which `truepose.numerics.frozen.predict` computes the mean."""
        self._check_fitted()
        return constants_of(self._form, self._terms, self.joints_, self.hyper_, self._fleet)

    def deviation(self, constants: Constants, poses: FloatArray, added: FloatArray) -> Deviation:
        """Return the arrays from which `truepose.numerics.frozen_deviation.deviations` bounds the deviation.

        Parameters
        ----------
        constants : Constants
            The arrays of the mean.
        poses : (m, dof) array [rad]
            Poses like those at which the bound is tight.
        added : (3,) array [mm²]
            The variance that is added to the field's.
        """
        self._check_fitted()
        model = self._form, self._terms, self.joints_, self.hyper_
        return deviation_of(*model, constants, poses, self.inflation_, added)

    def predict_together(self, X: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return predicted errors (m, 3) [mm] and their covariance with each other (3m, 3m) [mm²].

        Conditions that are not known are the same at all poses, but for the direction of approach.
        """
        self._check_fitted()
        design = self._terms.at(self._validate(X)[0])
        e = self._form.mean(design) + self._known(design)
        covariance = self.inflation_ * self._form.covariance_together(design)
        own, common = np.split(self._unknown(design), [self._terms.sided], axis=2)
        if own.shape[2]:
            covariance = covariance + block_diag(*(own @ np.swapaxes(own, 1, 2)))
        flat = common.reshape(len(covariance), -1)
        return e, covariance + flat @ flat.T

    def explain(self, X: ArrayLike) -> dict[str, FloatArray]:
        """Return the contribution of each term to the prediction, (m, 3) [mm] each.

        Parameters
        ----------
        X : (m, dof) array_like [rad]
            The joints.

        Returns
        -------
        dict of str to (m, 3) array [mm]
            The contributions ``registration``, ``geometry``, ``compliance``, ``joint 1`` …, ``rest``, and ``fleet``
            where a mean of other robots is taken; their sum is the prediction.
        """
        self._check_fitted()
        design = self._terms.at(self._validate(X)[0])
        part = self._form.contributions(design)
        part["registration"] = part["registration"] + self._terms.curvature(design)
        if self._fleet is not None and self._fleet.level == "mean":
            part["fleet"] = self._fleet.errors(design, self._terms)
        return part

    def joint_curves(self, points: int = 181) -> list[JointCurve]:
        """Return the error curve of each visible joint over the sampled angles."""
        self._check_fitted()
        mean = None if self._fleet is None else self._fleet.curve
        return [joint_curve(self._form, i, int(j), self.inflation_, points, mean) for i, j in enumerate(self.joints_)]
