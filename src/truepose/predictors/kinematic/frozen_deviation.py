"""The standard deviation of (10) as plain arrays, for `truepose.numerics.frozen_deviation`."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.numerics.frozen import Constants
from truepose.numerics.frozen_deviation import Deviation, table_angles
from truepose.predictors.kinematic.covariance_form import tolerances
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.summary import Form
from truepose.predictors.kinematic.terms import Terms

_ANGLES: Final = (1024, 4096)  # fewest and most of a table; cubic between them
_PER_LENGTH: Final = 58.0  # of the shortest length of a joint's error: the variance is off by about 1e-7 mm²
_MOST: Final = 256  # combinations of the readings; twice as many with orientations
_STEP: Final = 32
_ABOVE: Final = 1.01  # the ratio of standard deviations that is good enough
_SHARE: Final = 0.99  # of the poses, where it has to be


def deviation_of(
    form: Form,
    terms: Terms,
    joints: IntArray,
    hyper: Hyperparameters,
    constants: Constants,
    poses: FloatArray,
    inflation: float,
    added: FloatArray,
) -> Deviation:
    """Return the arrays of a fitted model.

    The combinations of the readings are those that tell most at the given poses (the first singular vectors): as few
    as keep the standard deviation within 1 % of the full one at 99 % of the poses.

    Parameters
    ----------
    form, terms, joints, hyper
        The fitted model.
    constants : Constants
        The arrays of its mean.
    poses : (m, dof) array [rad]
        The poses.
    inflation : float
        The factor of the variances.
    added : (3,) array [mm²]
        The variance that is added to the field's.

    Raises
    ------
    DataError
        If the payload at work is not known.
    """
    dof, design = terms.robot.dof, terms.at(poses)
    if design.mass.shape[2]:
        raise DataError(
            "the deviation of a map of several payloads cannot be frozen without the payload at work; state it in "
            "[conditions] payload_kg, or mass_kg in [payload]"
        )
    effect_size = terms.effect_size(*form.drift_estimate())  # of conditions, which a frozen map does not know
    told = form.told(design)
    most = 2 * _MOST if form.design.turn.any() else _MOST
    vector = np.linalg.eigh(told @ told.T)[1][:, ::-1][:, :most]
    full = np.maximum(np.einsum("maa->ma", form.covariance(design)), 0.0) + added / inflation
    kept = _enough(vector.T @ told, told, full.reshape(-1))
    wanted = _PER_LENGTH * 2.0 * np.pi / hyper.joint_length.min(initial=np.pi)
    angle = table_angles(int(np.clip(2 ** np.ceil(np.log2(wanted)), *_ANGLES)))
    drift, tables, rest = form.projected(vector[:, :kept], angle)
    links, p = terms.linearised[1], terms.linearised[2]
    std = terms.prior_std * tolerances(terms, hyper)
    known, unknown = (one.reshape(6 * len(links), -1) for one in terms.growth())
    g, effect = known.shape[1], effect_size * terms.prior_std[terms.conditional]
    rows = np.concatenate([links.reshape(-1, p), known], axis=1)
    own = np.r_[:p, len(std) - g : len(std)]
    missing = unknown * effect[len(effect) - g :]
    every = np.zeros((dof, len(angle), kept))
    for j, table in zip(joints, tables, strict=True):
        every[j] = table
    prior_joint = np.zeros(dof)
    prior_joint[joints] = hyper.joint_std**2
    np.add.at(prior_joint, terms.turning, effect[: len(effect) - g] ** 2 / inflation)  # no harmonic exceeds 1
    of_wave = terms.wave_rows[:, 0].astype(int)
    np.add.at(prior_joint, of_wave, (std[terms.waves] ** 2)[::2])  # sin² + cos² = 1
    wide = np.zeros((3, constants.anchors.shape[0] * constants.anchors.shape[2], kept))
    if len(hyper.rest_range):
        wide[:, : rest.shape[1]] = rest
    return Deviation(
        drift=(rows * terms.prior_std[own]) @ drift[own],
        gravity=terms.moments(terms.prior_std[:, None] * drift),
        tables=every,
        rest=wide,
        prior_drift=(rows * std[own] ** 2) @ rows.T + missing @ missing.T / inflation,
        prior_gravity=terms.moments(std**2, power=2),
        prior_joint=prior_joint,
        prior_rest=np.array([hyper.rest_std**2 if len(hyper.rest_range) else 0.0]),
        inflation=np.array([inflation]),
        added=np.array(added),
        margin=np.zeros(1),
        waves=(terms.prior_std[terms.waves, None] * drift[terms.waves]).reshape(len(of_wave), 2, kept),
    )


def _enough(part: FloatArray, told: FloatArray, full: FloatArray) -> int:
    """Return how many rows of the projections (k, 3 m) tell enough, for full variances (3 m,)."""
    missing = np.sum(told**2, axis=0) - np.cumsum(part**2, axis=0)
    for kept in range(_STEP, len(part), _STEP):
        if np.quantile(np.sqrt(1.0 + missing[kept - 1] / full), _SHARE) <= _ABOVE:
            return kept
    return len(part)
