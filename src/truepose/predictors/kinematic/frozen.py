"""The mean of (10) as plain arrays, for `truepose.numerics.frozen`."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.numerics.frozen import Constants, anchored, limits_of
from truepose.predictors.kinematic.fleet import Fleet
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.summary import Form
from truepose.predictors.kinematic.terms import Terms

POINTS: Final = 8193
"""Angles of a table of a joint's error: 0.044 degrees apart. Between them it is off by less than 0.1 µm at 2 m."""


def constants_of(form: Form, terms: Terms, joints: IntArray, hyper: Hyperparameters, fleet: Fleet | None) -> Constants:
    """Return the arrays of a fitted model.

    Registration and geometry are the shifted chain and, for what the estimate moved since the shift, one twist of each
    link. Compliance and joint errors are deviations of the joints times their levers.
    """
    robot, dof = terms.robot, terms.robot.dof
    estimate = form.drift_estimate()[0] * terms.prior_std
    mean = np.zeros(len(estimate)) if fleet is None else fleet.coefficients(terms)
    estimate = estimate + terms.centre + mean
    links, twists, p = terms.linearised
    growth = terms.growth()[0]
    curved = fleet is not None and fleet.level == "mean"
    tables = np.zeros((dof, POINTS if len(joints) or curved else 0))
    angle = np.linspace(-np.pi, np.pi, POINTS)
    if fleet is not None and curved:
        tables[:] = [fleet.curve(j, angle) for j in range(dof)]
    for i, j in enumerate(joints):
        tables[j] += form.joint_mean(i, angle)
    place, weight = form.rest_mean() if len(hyper.rest_range) else (np.empty((0, 0)), np.empty((0, 3)))
    anchors, weights, scale = anchored(place, weight, _scale(terms, hyper))
    mass = np.zeros((dof + 1, 3))
    mass[:dof] = robot.link_points
    return Constants(
        links=np.stack([robot.links(terms.tf_flange_tool), links])[:, :, :3].copy(),
        sign=robot.sign.copy(),
        limits=limits_of(robot.limits),
        twist=twists @ (estimate[:p] - terms.shift[:p]) + growth @ estimate[len(estimate) - growth.shape[2] :],
        tables=tables,
        harmonics=np.concatenate([terms.wave_rows, estimate[terms.waves].reshape(-1, 2)], axis=1),
        moment=terms.moments(estimate),
        mass=mass,
        anchors=anchors,
        weights=weights,
        place_scale=scale,
        by_joints=np.array([2.0 * dof if terms.residual in ("joint", "both") else 0.0]),
        away=np.zeros(3),
        linear=np.ones(1),
    )


def _scale(terms: Terms, hyper: Hyperparameters) -> FloatArray:
    """Return the factors of Z's coordinates: 1/range, in base units of positions 1/(1000 range)."""
    if not len(hyper.rest_range):
        return np.empty(0)
    scale = 1.0 / hyper.rest_range[terms.range_of]
    if terms.residual in ("cartesian", "both"):
        scale[-3:] /= 1000.0
    return np.asarray(scale)
