"""The conditions of configurations: the direction of approach from the order of rows, and checks of what is stated."""

from __future__ import annotations

from typing import Final

import numpy as np

from truepose._typing import FloatArray
from truepose.samples.table import Poses, Samples

_MOVES: Final = 2e-4  # rad; a shorter motion may not take up the lost motion
_FEWEST: Final = 20  # motions that show whether the signs are reversed
_REVERSED: Final = 0.1  # share of equal signs below which they are
_FARTHEST: Final = 3000.0  # mm, of a centre of mass
_COLDEST, _HOTTEST, _KELVIN = -30.0, 60.0, 220.0


def approach_from_order(samples: Samples) -> FloatArray:
    """Return the sign of each joint's last motion, (n, dof), if every row was reached straight from the row before.

    A joint that did not move keeps its sign. The first row, and a row after one that is missing, are unknown: 0. Rows
    are in the order of their times, where these are known.

    Raises
    ------
    DataError
        If the joints are not known, or times run backwards.

    Examples
    --------
    >>> approach_from_order(Samples(np.zeros((3, 3)), q=np.deg2rad([[0.0, 5.0], [2.0, 5.0], [1.0, 7.0]])))
    array([[ 0.,  0.],
           [ 1.,  0.],
           [-1.,  1.]])
    """
    if samples.q is None:
        raise samples.error("directions of approach need the joints (q1_deg …)")
    if samples.time is not None and (back := np.flatnonzero(np.diff(samples.time) < 0.0) + 1).size:
        raise samples.error("time runs backwards; sort the rows by time, or state approach1 …", back)
    assert samples.row is not None
    signs = np.zeros_like(samples.q)
    for i in range(1, len(signs)):
        if samples.row[i] == samples.row[i - 1] + 1:
            moved = samples.q[i] - samples.q[i - 1]
            signs[i] = np.where(np.abs(moved) > _MOVES, np.sign(moved), signs[i - 1])
    return signs


def check_conditions(poses: Poses) -> None:
    """Refuse conditions that cannot be: see the functions for approach, temperature and payload.

    Raises
    ------
    DataError
        With the rows and the remedy.
    """
    if poses.approach is not None:
        _check_approach(poses, poses.approach)
    if poses.temperature is not None:
        _check_temperature(poses, poses.temperature)
    if poses.p_load is not None:
        _check_centre(poses, poses.p_load)


def _check_centre(poses: Poses, p_load: FloatArray) -> None:
    if poses.load is None:
        raise poses.error("x_load_mm … state a centre of mass, but there is no load_kg; state the mass as well")
    far = np.linalg.norm(p_load, axis=1) > _FARTHEST
    if far.any():
        size = float(np.linalg.norm(p_load[far][0]))
        raise poses.error(f"the centre of mass is {size:.0f} mm from the flange; state x_load_mm … in its frame", far)


def _check_approach(poses: Poses, approach: FloatArray) -> None:
    """Refuse signs that are none of −1, 0 and 1, or opposite to the order of rows nearly everywhere.

    Signs that agree with the order neither way belong to a campaign that approaches each pose on a way of its own.
    """
    wrong = np.asarray(~np.isin(approach, (-1.0, 0.0, 1.0)).all(axis=1))
    if wrong.any():
        raise poses.error("approach must be -1, 0 or +1, the sign of each joint's last motion", wrong)
    if (q := poses.given_joints) is None:
        return
    if approach.shape != q.shape:
        raise poses.error(f"approach has {approach.shape[1]} columns for {q.shape[1]} joints; state one for each")
    if poses.q is None:
        return  # signs are those of the model's joints
    moved, stated = np.diff(poses.q, axis=0), approach[1:]
    telling = (np.abs(moved) > _MOVES) & (stated != 0.0) & (np.ptp(approach, axis=0) == 2.0)
    if telling.sum() >= _FEWEST and np.mean(np.sign(moved)[telling] == stated[telling]) < _REVERSED:
        raise poses.error(
            "the signs of approach are opposite to the order of rows; +1 means that the joint's angle grew on the last "
            "motion"
        )


def _check_temperature(poses: Poses, temperature: FloatArray) -> None:
    far = (temperature < _COLDEST) | (temperature > _HOTTEST)
    if far.any():
        worst = float(temperature[far][0])
        unit = "kelvin" if worst > _KELVIN else "°F" if worst > _HOTTEST else "another unit"
        raise poses.error(f"temp_C is {worst:g} °C; is it {unit}? State the temperature of the air in °C", far)
