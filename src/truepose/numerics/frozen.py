"""Predict errors of an arm from arrays alone: the mean of theory (10) and (11), compiled, without allocation.

The error at joints q is that of the real chain against the nominal one, T(q) = L_0 Rz(s_1 q_1) L_1 … L_n both. Joints
deviate by tables of their own angle, by harmonics and by the moment of gravity; the deviations either turn the joints
of the real chain (calibration) or are multiplied by its levers (kinematic Kriging, which is linear in them). Twists of
the links and the field Z are added in the second case.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray
from truepose.numerics.kernels import BLOCK, MATERN52, REORDER, compiled, correlate

UNROLLED: Final = 4  # coordinates of Z in one pass over a block of anchors
_ROUNDING: Final = 1e-9  # rad, by which a joint may exceed its limit
_FARTHEST: Final = 1e3  # rad


class Constants(NamedTuple):
    """What the prediction of an arm of d joints consists of.

    Attributes
    ----------
    links : (2, d + 1, 3, 4) array [mm]
        The links of the nominal and of the real chain, base to tool.
    sign : (d,) array of -1 or +1
        The senses of rotation.
    limits : (d, 2) array [rad]
        The limits of the joints; beyond them nothing is predicted.
    twist : (d + 1, 6) array
        The twist (v, ω) [mm, rad] of each link of the real chain, in the frame of the link.
    tables : (d, t) array [rad]
        The deviation of each joint at t equidistant angles from −π to π; t is 0 without.
    harmonics : (h, 4) array
        Joint, factor of its angle, and amplitudes [rad] of sine and cosine.
    moment : (d, d + 1) array [rad/mm]
        The deviation of joint j by mass k, per horizontal lever of the mass about its axis.
    mass : (d + 1, 3) array [mm]
        The masses in the frame of their joint; the last in that of the last joint, or at the tool point if `linear`.
    anchors : (b, c, width) array
        The coordinates of Z's anchors, times −2, then their squared length, in blocks.
    weights : (b, 3, width) array [mm]
        The weights of the anchors.
    place_scale : (c − 1,) array
        The factors of Z's coordinates (cosine and sine of the joints, position [mm]): 1/range; then zeros.
    by_joints : (1,) array
        The number of coordinates of Z that are cosines and sines.
    away : (3,) array [mm]
        The vector from the chain's tool point to the wanted one, in the frame of the tool.
    linear : (1,) array
        1 if deviations are multiplied by the levers, 0 if they turn the joints.
    """

    links: FloatArray
    sign: FloatArray
    limits: FloatArray
    twist: FloatArray
    tables: FloatArray
    harmonics: FloatArray
    moment: FloatArray
    mass: FloatArray
    anchors: FloatArray
    weights: FloatArray
    place_scale: FloatArray
    by_joints: FloatArray
    away: FloatArray
    linear: FloatArray


class Scratch(NamedTuple):
    """The memory of `predict`: one for each thread."""

    frames: FloatArray
    turns: FloatArray
    deviation: FloatArray
    masses: FloatArray
    place: FloatArray
    near: FloatArray
    error: FloatArray


def scratch(constants: Constants) -> Scratch:
    """Return the memory that `predict` needs for these constants."""
    dof = len(constants.sign)
    return Scratch(
        np.zeros((2, dof + 2, 3, 4)),
        np.zeros((dof, 2)),
        np.zeros(dof),
        np.zeros((dof + 1, 2)),
        np.zeros(len(constants.place_scale)),
        np.zeros(constants.anchors.shape[2]),
        np.zeros(6),
    )


def limits_of(limits: FloatArray) -> FloatArray:
    """Return limits (d, 2) [rad] with the rounding that forward kinematics allows, and finite numbers for infinity."""
    return np.asarray(np.clip(limits + np.array([-_ROUNDING, _ROUNDING]), -_FARTHEST, _FARTHEST))


def anchored(place: FloatArray, weight: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return `anchors`, `weights` and `place_scale` of Z from coordinates over ranges (a, c) and weights (a, 3)."""
    padded = np.zeros((len(place), -(-place.shape[1] // UNROLLED) * UNROLLED))
    padded[:, : place.shape[1]] = place
    columns = np.concatenate([-2.0 * padded, np.sum(padded**2, axis=1, keepdims=True)], axis=1)
    wide = np.zeros(padded.shape[1])
    wide[: len(scale)] = scale
    return _packed(columns), _packed(weight), wide


def _packed(columns: FloatArray) -> FloatArray:
    """Return rows in blocks (b, c, width) as `truepose.numerics.kernels.pack`, of equal size: few zeros are added."""
    n, c = columns.shape
    blocks = -(-n // BLOCK)
    width = -(-n // (16 * max(blocks, 1))) * 16
    padded = np.zeros((blocks * width, c))
    padded[:n] = columns
    return np.ascontiguousarray(padded.reshape(blocks, width, c).transpose(0, 2, 1))


@compiled(nogil=True)
def predict(q: FloatArray, out: FloatArray, constants: Constants, memory: Scratch) -> int:
    """Set out (n, 3) [mm] or (n, 6) [mm, rad] to the errors at joints q (n, d) [rad], base frame.

    Rows beyond the limits, or that are not finite, become NaN; their number is returned.
    """
    beyond = 0
    for i in range(len(q)):
        if _within(q[i], constants.limits):
            error_at(q[i], constants, memory)
            out[i] = memory.error[: out.shape[1]]
        else:
            out[i] = np.nan
            beyond += 1
    return beyond


@compiled(forceinline=True, fastmath={"contract"})
def _within(q: FloatArray, limits: FloatArray) -> bool:
    within = True  # NaN is not
    for j in range(len(q)):
        within = within and limits[j, 0] <= q[j] <= limits[j, 1]
    return within


@compiled(forceinline=True, fastmath={"contract"})
def error_at(q: FloatArray, constants: Constants, memory: Scratch) -> None:
    """Set memory.error (6,) [mm, rad] to the error at joints q (d,) [rad]."""
    nominal, real = memory.frames[0], memory.frames[1]
    linear = constants.linear[0] == 1.0
    _turn(q, constants.sign, memory.turns)
    _walk(memory.turns, constants.links[0], nominal)
    if linear:
        _walk(memory.turns, constants.links[1], real)
    _deviate(q, constants, memory, nominal, real[-1] if linear else nominal[-1])
    if not linear:
        for j in range(len(q)):
            memory.deviation[j] += q[j]
        _turn(memory.deviation, constants.sign, memory.turns)
        _walk(memory.turns, constants.links[1], real)
    _difference(nominal[-1], real[-1], constants.away, linear, memory.error)
    if linear:
        _add_levers(constants, real, memory.deviation, memory.error)
        if len(constants.weights):
            _add_rest(constants, memory, real[-1])
        _move(nominal[-1], constants.away, memory.error)


@compiled(forceinline=True, fastmath={"contract"})
def _turn(q: FloatArray, sign: FloatArray, turns: FloatArray) -> None:
    """Set turns (d, 2) to cosine and sine of the angles of rotation."""
    for j in range(len(q)):
        turns[j, 0] = math.cos(q[j])
        turns[j, 1] = sign[j] * math.sin(q[j])


@compiled(forceinline=True, fastmath={"contract"})
def _walk(turns: FloatArray, links: FloatArray, frames: FloatArray) -> None:
    """Set frames (d + 2, 3, 4) [mm] to the base, the frame after each joint's rotation, and the last frame.

    The rows of the frames do not depend on each other, so each is carried along the chain in four numbers.
    """
    dof = len(turns)
    for r in range(3):
        a, b, c, p = 1.0 * (r == 0), 1.0 * (r == 1), 1.0 * (r == 2), 0.0
        frames[0, r, 0], frames[0, r, 1], frames[0, r, 2], frames[0, r, 3] = a, b, c, p
        for k in range(dof + 1):
            p += a * links[k, 0, 3] + b * links[k, 1, 3] + c * links[k, 2, 3]
            x = a * links[k, 0, 0] + b * links[k, 1, 0] + c * links[k, 2, 0]
            y = a * links[k, 0, 1] + b * links[k, 1, 1] + c * links[k, 2, 1]
            c = a * links[k, 0, 2] + b * links[k, 1, 2] + c * links[k, 2, 2]
            a, b = x, y
            if k < dof:
                a = turns[k, 0] * x + turns[k, 1] * y
                b = turns[k, 0] * y - turns[k, 1] * x
            frames[k + 1, r, 0], frames[k + 1, r, 1], frames[k + 1, r, 2], frames[k + 1, r, 3] = a, b, c, p


@compiled(forceinline=True, fastmath={"contract"})
def _deviate(q: FloatArray, constants: Constants, memory: Scratch, frames: FloatArray, tool: FloatArray) -> None:
    """Set memory.deviation (d,) [rad] of the joints: table, harmonics, and gravity at the nominal frames."""
    (dof, points), deviation = constants.tables.shape, memory.deviation
    for j in range(dof):
        deviation[j] = _interpolated(constants.tables[j], q[j]) if points else 0.0
    for row in constants.harmonics:
        angle = row[1] * q[int(row[0])]
        deviation[int(row[0])] += row[2] * math.sin(angle) + row[3] * math.cos(angle)
    _place_masses(constants.mass, frames, tool, constants.linear[0] == 1.0, memory.masses)
    for j in range(dof):
        for k in range(j, dof + 1):
            if constants.moment[j, k] != 0.0:
                deviation[j] += constants.moment[j, k] * horizontal_lever(frames[j + 1], memory.masses[k])


@compiled(forceinline=True, fastmath={"contract"})
def _place_masses(mass: FloatArray, frames: FloatArray, tool: FloatArray, linear: bool, masses: FloatArray) -> None:
    """Set masses (d + 1, 2) to x and y of the masses [mm], base frame; the last at the tool point if `linear`."""
    dof = len(mass) - 1
    for k in range(dof + 1):
        j = min(k + 1, dof)
        for r in range(2):
            shift = frames[j, r, 0] * mass[k, 0] + frames[j, r, 1] * mass[k, 1] + frames[j, r, 2] * mass[k, 2]
            masses[k, r] = frames[j, r, 3] + shift
    if linear:
        masses[dof] = tool[:2, 3]


@compiled(forceinline=True, fastmath={"contract"})
def horizontal_lever(axis: FloatArray, mass: FloatArray) -> float:
    """Return (z × r)_z [mm] from the axis of a joint, a frame (3, 4), to a mass at x, y; gravity is along z."""
    lever: float = axis[0, 2] * (mass[1] - axis[1, 3]) - axis[1, 2] * (mass[0] - axis[0, 3])
    return lever


@compiled(forceinline=True, fastmath={"contract"})
def _interpolated(table: FloatArray, angle: float) -> float:
    """Return a table over −π to π at an angle [rad], linear between its points."""
    turns = angle / (2.0 * math.pi) + 0.5
    x = (turns - math.floor(turns)) * (len(table) - 1)
    i = min(int(x), len(table) - 2)
    value: float = table[i] + (x - i) * (table[i + 1] - table[i])
    return value


@compiled(forceinline=True, fastmath={"contract"})
def _difference(nominal: FloatArray, real: FloatArray, away: FloatArray, linear: bool, error: FloatArray) -> None:
    """Set error (6,) to the shift and the rotation vector of R_real R_nominalᵀ between two frames (3, 4).

    The shift is that of the tool point, or of the point `away` from it unless `linear`.
    """
    for r in range(3):
        error[r] = real[r, 3] - nominal[r, 3]
        if not linear:
            for c in range(3):
                error[r] += (real[r, c] - nominal[r, c]) * away[c]
        i, j = (r + 1) % 3, (r + 2) % 3  # the sine of the angle times the axis
        error[3 + r] = 0.5 * (
            (real[j, 0] * nominal[i, 0] + real[j, 1] * nominal[i, 1] + real[j, 2] * nominal[i, 2])
            - (real[i, 0] * nominal[j, 0] + real[i, 1] * nominal[j, 1] + real[i, 2] * nominal[j, 2])
        )
    sine = math.sqrt(error[3] ** 2 + error[4] ** 2 + error[5] ** 2)
    if sine > 1e-9:
        factor = math.asin(min(sine, 1.0)) / sine
        for r in range(3, 6):
            error[r] *= factor


@compiled(forceinline=True, fastmath={"contract"})
def _add_levers(constants: Constants, frames: FloatArray, deviation: FloatArray, error: FloatArray) -> None:
    """Add the effect (6,) [mm, rad] of the links' twists, and of the joints' deviations as a twist about z."""
    twist, last = constants.twist, len(frames) - 1
    for k in range(len(twist)):
        spin = twist[k, 5]
        if k:
            spin += constants.sign[k - 1] * deviation[k - 1]
        w0 = frames[k, 0, 0] * twist[k, 3] + frames[k, 0, 1] * twist[k, 4] + frames[k, 0, 2] * spin
        w1 = frames[k, 1, 0] * twist[k, 3] + frames[k, 1, 1] * twist[k, 4] + frames[k, 1, 2] * spin
        w2 = frames[k, 2, 0] * twist[k, 3] + frames[k, 2, 1] * twist[k, 4] + frames[k, 2, 2] * spin
        x = frames[last, 0, 3] - frames[k, 0, 3]
        y = frames[last, 1, 3] - frames[k, 1, 3]
        z = frames[last, 2, 3] - frames[k, 2, 3]
        error[0] += w1 * z - w2 * y
        error[1] += w2 * x - w0 * z
        error[2] += w0 * y - w1 * x
        error[3] += w0
        error[4] += w1
        error[5] += w2
        for r in range(3):
            error[r] += frames[k, r, 0] * twist[k, 0] + frames[k, r, 1] * twist[k, 1] + frames[k, r, 2] * twist[k, 2]


@compiled(forceinline=True, fastmath={"contract"})
def _add_rest(constants: Constants, memory: Scratch, tool: FloatArray) -> None:
    """Add Z (3,) [mm] at the turned joints and the tool point: the anchors' weights times their correlation."""
    place, by_joints = memory.place, int(constants.by_joints[0])
    for c in range(len(place)):
        if c < by_joints:
            value = memory.turns[c // 2, c % 2]
            if c % 2:
                value *= constants.sign[c // 2]
        elif c < by_joints + 3:
            value = tool[c - by_joints, 3]
        else:
            value = 0.0
        place[c] = value * constants.place_scale[c]
    for b in range(len(constants.anchors)):
        correlate_block(constants, memory, b)
        for a in range(3):
            memory.error[a] += _dot(constants.weights[b, a], memory.near)


@compiled(forceinline=True, fastmath={"contract"})
def correlate_block(constants: Constants, memory: Scratch, b: int) -> None:
    """Set memory.near to the correlations of Z at memory.place with the anchors of one block."""
    own = 0.0
    for value in memory.place:
        own += value * value
    _squared_distances(memory.place, own, constants.anchors[b], memory.near)
    correlate(MATERN52, 0.0, memory.near)


@compiled(fastmath=REORDER)
def _squared_distances(place: FloatArray, own: float, block: FloatArray, out: FloatArray) -> None:
    """Set out (width,) to |u|² + |v|² − 2 u·v, four coordinates in one pass."""
    last = block[len(block) - 1]
    for i in range(len(out)):
        out[i] = own + last[i]
    for c in range(0, len(place), 4):
        u0, u1, u2, u3 = place[c], place[c + 1], place[c + 2], place[c + 3]
        v0, v1, v2, v3 = block[c], block[c + 1], block[c + 2], block[c + 3]
        for i in range(len(out)):
            out[i] += u0 * v0[i] + u1 * v1[i] + u2 * v2[i] + u3 * v3[i]
    for i in range(len(out)):
        out[i] = max(out[i], 0.0)


@compiled(fastmath=REORDER)
def _dot(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@compiled(forceinline=True, fastmath={"contract"})
def _move(nominal: FloatArray, away: FloatArray, error: FloatArray) -> None:
    """Add w × r for the vector r to another point of the tool, which `away` is in the nominal frame of the tool."""
    x = nominal[0, 0] * away[0] + nominal[0, 1] * away[1] + nominal[0, 2] * away[2]
    y = nominal[1, 0] * away[0] + nominal[1, 1] * away[1] + nominal[1, 2] * away[2]
    z = nominal[2, 0] * away[0] + nominal[2, 1] * away[1] + nominal[2, 2] * away[2]
    error[0] += error[4] * z - error[5] * y
    error[1] += error[5] * x - error[3] * z
    error[2] += error[3] * y - error[4] * x
