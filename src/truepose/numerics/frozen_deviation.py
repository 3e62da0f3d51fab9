"""The standard deviation of theory (10) from arrays alone, never below the true one but for rounding.

The variance of the error at q is its prior variance less what the samples tell. Of that, m linear combinations of the
readings tell nearly all; the variance given these alone is an upper bound for any choice of them, because knowing less
never lowers it. Each combination's covariance with the error is linear in the columns of the drift, in the levers times
a function of each joint's own angle, which is a table, and in the correlations of Z.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from truepose._typing import FloatArray
from truepose.numerics.frozen import Constants, Scratch, correlate_block, error_at, horizontal_lever, scratch
from truepose.numerics.kernels import REORDER, compiled


class Deviation(NamedTuple):
    """What the standard deviation of an arm of d joints consists of, for m combinations of the readings.

    Attributes
    ----------
    drift : (6 (d + 1), m) array
        The covariance with each combination of the twists of the links (v, ω).
    gravity : (d, d + 1, m) array
        That of the deviation of joint j by mass k, per horizontal lever.
    tables : (d, t + 3, m) array
        That of the deviation of each joint, at t equidistant angles from −π, one before and two after them.
    rest : (3, c, m) array
        That of Z for each anchor.
    prior_drift : (6 (d + 1), 6 (d + 1)) array
        The prior covariance of the twists.
    prior_gravity : (d, d + 1) array
        The prior variances of the deviations by masses.
    prior_joint : (d,) array [rad²]
        The prior variances of the joints' own errors.
    prior_rest : (1,) array [mm²]
        The prior variance of Z.
    inflation : (1,) array
        The factor of the variances.
    added : (3,) array [mm²]
        The variance that is added in each direction.
    margin : (1,) array [mm]
        What is added to the standard deviation for the error of the tables.
    waves : (h, 2, m) array
        The covariance with each combination of the sine and cosine of each of the constants' harmonics.
    """

    drift: FloatArray
    gravity: FloatArray
    tables: FloatArray
    rest: FloatArray
    prior_drift: FloatArray
    prior_gravity: FloatArray
    prior_joint: FloatArray
    prior_rest: FloatArray
    inflation: FloatArray
    added: FloatArray
    margin: FloatArray
    waves: FloatArray


def table_angles(points: int) -> FloatArray:
    """Return the angles of a table of t points, (t + 3,) [rad]."""
    return np.asarray((np.arange(-1, points + 2) / points * 2.0 - 1.0) * np.pi)


def deviations(q: FloatArray, constants: Constants, deviation: Deviation) -> FloatArray:
    """Return the standard deviations (n, 3) [mm] of the errors at joints q (n, d) [rad] within the limits."""
    n, m = len(q), deviation.drift.shape[1]
    moved = np.empty((3, n, len(deviation.drift)))
    near, told, prior = np.empty((n, deviation.rest.shape[1])), np.empty((3, n, m)), np.empty((n, 3))
    _features(q, constants, deviation, scratch(constants), moved, near, told, prior)
    told += moved @ deviation.drift
    told += near @ deviation.rest
    prior += np.einsum("anr,anr->na", moved @ deviation.prior_drift, moved) + deviation.prior_rest
    variance = np.maximum(prior - np.einsum("anm,anm->na", told, told), 0.0)
    return np.asarray(np.sqrt(deviation.inflation * variance + deviation.added) + deviation.margin)


@compiled(nogil=True)
def _features(
    q: FloatArray,
    constants: Constants,
    deviation: Deviation,
    memory: Scratch,
    moved: FloatArray,
    near: FloatArray,
    told: FloatArray,
    prior: FloatArray,
) -> None:
    """Set the columns of the twists, the correlations of Z, and what the joints' deviations add to told and prior."""
    width = constants.anchors.shape[2]
    for i in range(len(q)):
        error_at(q[i], constants, memory)
        nominal, real = memory.frames[0], memory.frames[1]
        for k in range(len(q[i]) + 1):
            _columns(real[k], real[-1], moved[:, i, 6 * k : 6 * k + 6])
        for b in range(len(constants.anchors)):
            correlate_block(constants, memory, b)
            near[i, b * width : b * width + width] = memory.near
        told[:, i] = 0.0
        prior[i] = 0.0
        for j in range(len(q[i])):
            lever = constants.sign[j] * moved[:, i, 6 * j + 11]
            variance = deviation.prior_joint[j]
            if variance > 0.0:
                _add_table(deviation.tables[j], q[i, j], lever, told[:, i])
            for h in range(len(deviation.waves)):
                if constants.harmonics[h, 0] == j:
                    angle = constants.harmonics[h, 1] * q[i, j]
                    _add_row(deviation.waves[h, 0], math.sin(angle), lever, told[:, i])
                    _add_row(deviation.waves[h, 1], math.cos(angle), lever, told[:, i])
            for k in range(j, len(constants.mass)):
                if deviation.prior_gravity[j, k] > 0.0:
                    horizontal = horizontal_lever(nominal[j + 1], memory.masses[k])
                    variance += deviation.prior_gravity[j, k] * horizontal * horizontal
                    _add_row(deviation.gravity[j, k], horizontal, lever, told[:, i])
            for r in range(3):
                prior[i, r] += variance * lever[r] * lever[r]


@compiled()
def _columns(frame: FloatArray, tool: FloatArray, out: FloatArray) -> None:
    """Set out (3, 6) to the shift of the tool point by unit twists (v, ω) in a frame (3, 4)."""
    x, y, z = tool[0, 3] - frame[0, 3], tool[1, 3] - frame[1, 3], tool[2, 3] - frame[2, 3]
    for c in range(3):
        w0, w1, w2 = frame[0, c], frame[1, c], frame[2, c]
        out[0, c], out[1, c], out[2, c] = w0, w1, w2
        out[0, 3 + c] = w1 * z - w2 * y
        out[1, 3 + c] = w2 * x - w0 * z
        out[2, 3 + c] = w0 * y - w1 * x


@compiled(fastmath=REORDER)
def _add_table(table: FloatArray, angle: float, lever: FloatArray, told: FloatArray) -> None:
    """Add lever (3,) times a table (t + 3, m) at an angle [rad] to told (3, m); cubic through four points."""
    points = len(table) - 3
    turns = angle / (2.0 * math.pi) + 0.5
    x = (turns - math.floor(turns)) * points
    i = min(int(x), points - 1)
    t = x - i
    w0, w1 = -t * (t - 1.0) * (t - 2.0) / 6.0, (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0
    w2, w3 = -(t + 1.0) * t * (t - 2.0) / 2.0, (t + 1.0) * t * (t - 1.0) / 6.0
    a, b, c, d = table[i], table[i + 1], table[i + 2], table[i + 3]
    l0, l1, l2 = lever
    x_row, y_row, z_row = told[0], told[1], told[2]
    for s in range(told.shape[1]):
        value = w0 * a[s] + w1 * b[s] + w2 * c[s] + w3 * d[s]
        x_row[s] += l0 * value
        y_row[s] += l1 * value
        z_row[s] += l2 * value


@compiled(fastmath=REORDER)
def _add_row(row: FloatArray, factor: float, lever: FloatArray, told: FloatArray) -> None:
    """Add factor times lever (3,) times a row (m,) to told (3, m)."""
    l0, l1, l2 = factor * lever[0], factor * lever[1], factor * lever[2]
    x_row, y_row, z_row = told[0], told[1], told[2]
    for s in range(len(row)):
        x_row[s] += l0 * row[s]
        y_row[s] += l1 * row[s]
        z_row[s] += l2 * row[s]
