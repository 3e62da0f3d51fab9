"""Summarise a fitted model of (10): the error curve of each joint, and the table of drift parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose._typing import FloatArray
from truepose.predictors.estimates import ParameterEstimates
from truepose.predictors.kinematic.basis_form import BasisForm
from truepose.predictors.kinematic.covariance_form import CovarianceForm, tolerances
from truepose.predictors.kinematic.fleet import Fleet
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.terms import GROUPS, REGISTRATION, Terms

Form = CovarianceForm | BasisForm


@dataclass(frozen=True, eq=False)
class JointCurve:
    """The error of one joint as a function of its own angle.

    Attributes
    ----------
    joint : int
        The joint, counted from 0.
    angle : (m,) array [rad]
        The angles.
    error, std : (m,) arrays [rad]
        The error f_j and its standard deviation, without its constant and first harmonic over these angles, because
        offset and eccentricity of the joint cannot be separated from geometry.
    """

    joint: int
    angle: FloatArray
    error: FloatArray
    std: FloatArray


def joint_curve(
    form: Form, i: int, joint: int, inflation: float, points: int, mean: Callable[[int, FloatArray], FloatArray] | None
) -> JointCurve:
    """Return the curve of the i-th visible joint over the sampled angles, with the mean of a fleet if there is one."""
    sampled = form.design.q[:, joint]
    angle = np.linspace(sampled.min(), sampled.max(), points)
    slow = np.linalg.qr(np.stack([np.ones(points), np.cos(angle), np.sin(angle)], axis=1))[0]
    own = np.eye(points) - slow @ slow.T
    error, covariance = form.joint_error(i, angle)
    if mean is not None:
        error = error + mean(joint, angle)
    variance = np.einsum("ab,bc,ac->a", own, covariance, own, optimize=True)
    return JointCurve(joint, angle, own @ error, np.sqrt(inflation * np.maximum(variance, 0.0)))


def drift_table(form: Form, terms: Terms, hyper: Hyperparameters, fleet: Fleet | None = None) -> list[dict[str, Any]]:
    """Return one row per drift column: estimate and standard deviation, and whether the data determine it.

    ``prior_std`` is that of the fit, and ``off`` how many of these the estimate is from its prior mean.
    """
    found, scale = estimates(form, terms, hyper, fleet), terms.prior_std
    std = found.std
    determined = np.where(terms.group == REGISTRATION, std < 0.5 * scale, std < 0.8 * found.prior_std)
    return [
        {
            "name": terms.names[k],
            "group": GROUPS[terms.group[k]],
            "estimate": float(found.mean[k]),
            "std": float(std[k]),
            "unit": terms.units[k],
            "told": bool(determined[k]),
            "prior_std": float(found.prior_std[k]),
            "off": float((found.mean[k] - found.prior_mean[k]) / found.prior_std[k]),
        }
        for k in range(len(std))
    ]


def estimates(
    form: Form, terms: Terms, hyper: Hyperparameters, fleet: Fleet | None, inflation: float = 1.0
) -> ParameterEstimates:
    """Return the drift coefficients in their units, with the covariance of all of them, and with their priors."""
    estimate, covariance = form.drift_estimate()
    scale = terms.prior_std
    prior = terms.centre + (0.0 if fleet is None else fleet.coefficients(terms))
    return ParameterEstimates(
        names=tuple(terms.names),
        kinds=terms.kinds,
        units=tuple(terms.units),
        mean=estimate * scale + prior,
        covariance=covariance * scale[:, None] * scale,
        prior_mean=prior,
        prior_std=scale * tolerances(terms, hyper),
        inflation=inflation,
        rise=terms.rise(form.design),
    )
