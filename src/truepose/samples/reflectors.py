"""Several reflectors on one tool, with one row for each reading: which rows are one pose, and whether they moved.

Distances between the reflectors of a pose do not depend on the arm and its errors. They show a reflector that moved on
the flange, and positions in the cell file that are not those of the tool.
"""

from __future__ import annotations

from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.cell import Cell
from truepose.samples.table import Poses, Samples

_SAME_JOINTS: Final = 2e-3  # rad; joints as measured differ a little while the arm stands still
_SAME_KELVIN: Final = 2.0
_FEWEST: Final = 4  # readings on each side of a move
_SIGMAS: Final = 6.0
_LEAST_MM: Final = 0.05  # smaller moves are left to the fit
_READING_MM: Final = 0.05  # of a reading whose standard deviation is not known
_SPREAD: Final = 1.4826  # standard deviation of a normal number over its median absolute deviation


def visits(poses: Poses) -> IntArray:
    """Return the number of the visit to a pose that each row belongs to, (n,); from 0.

    Rows in sequence belong to one visit if they have the same name (without names, the same joints), and each another
    reflector. Without reflectors every row is a visit of its own.

    Examples
    --------
    >>> q = np.array([[0.1], [0.1], [0.2], [0.2], [0.2]])
    >>> visits(Poses(q=q, reflector=np.array(["A", "B", "A", "B", "A"])))
    array([0, 0, 1, 1, 2])
    """
    if poses.reflector is None:
        return np.arange(len(poses))
    follows = _follows(poses)
    number, seen = np.zeros(len(poses), np.int64), {str(poses.reflector[0])}
    for i, name in enumerate(poses.reflector[1:].tolist(), start=1):
        new = not follows[i] or name in seen
        number[i] = number[i - 1] + new
        seen = {name} if new else seen | {name}
    return number


def _follows(poses: Poses) -> BoolArray:
    """Return whether each row is of the same pose as the row before, (n,)."""
    named = poses.name is not None and bool((poses.name != "").all())
    same = [x for x in ((poses.name,) if named else (poses.approach, poses.load)) if x is not None]
    follows = np.ones(len(poses), np.bool_)
    follows[0] = False
    for values in same:
        equal = values[1:] == values[:-1]
        follows[1:] &= equal if equal.ndim == 1 else equal.all(axis=1)
    if not named and (q := poses.given_joints) is not None:
        follows[1:] &= np.abs(np.diff(q, axis=0)).max(axis=1) <= _SAME_JOINTS
    return follows


def check_reflector_rows(poses: Poses) -> None:
    """Refuse rows without a reflector, and readings of one pose that state different joints or conditions.

    Raises
    ------
    DataError
        With the rows and the remedy.
    """
    if poses.reflector is None:
        return
    if (empty := np.char.strip(poses.reflector) == "").any():
        raise poses.error("no reflector is named; state one in every row, or leave the column out", empty)
    if poses.given_joints is None:
        raise poses.error("readings of several reflectors need the joints (q1_deg …)")
    here = np.flatnonzero(np.diff(visits(poses), prepend=-1) == 0)
    before = here - 1
    if not len(here):
        return
    stated = {
        "joints": (poses.given_joints, _SAME_JOINTS),
        "approach": (poses.approach, 0.0),
        "load_kg": (poses.load, 0.0),
        "temp_C": (poses.temperature, _SAME_KELVIN),
    }
    for what, (values, most) in stated.items():
        if values is None:
            continue
        off = np.abs(values[here] - values[before]).reshape(len(here), -1).max(axis=1, initial=0.0) > most
        if off.any():
            rows = np.union1d(here[off], before[off])
            raise poses.error(
                f"readings of one pose have different {what}; correct them, or name the poses apart", rows
            )


def reflector_index(poses: Poses, cell: Cell) -> IntArray:
    """Return the place of each row's reflector in the cell's ``[reflectors]``, (n,).

    Raises
    ------
    DataError
        If the cell does not state a reflector of the table; with its rows.
    """
    assert poses.reflector is not None
    known = list(cell.reflectors)
    unknown = ~np.isin(poses.reflector, known)
    if unknown.any():
        name = str(poses.reflector[unknown][0])
        has = f"it has {', '.join(known)}" if known else "it has none"
        remedy = f"add [reflectors.{name}] with its position in the flange frame, or correct the name"
        raise poses.error(f"reflector {name!r} is not in the cell file ({has}); {remedy}", poses.reflector == name)
    place = {name: k for k, name in enumerate(known)}
    return np.array([place[name] for name in poses.reflector.tolist()], np.int64)


class _Pair(NamedTuple):
    """The readings of two reflectors at the same poses.

    Attributes
    ----------
    names : pair of str
        The reflectors.
    rows : (m, 2) array of int
        The rows of each pose.
    off : (m,) array [mm]
        The measured distance minus the stated one.
    std : float [mm]
        The standard deviation of one of them by the readings.
    """

    names: tuple[str, str]
    rows: IntArray
    off: FloatArray
    std: float


def check_rigid(samples: Samples, cell: Cell) -> None:
    """Refuse reflectors whose distances change during the campaign, or are not those of the cell file.

    A single reading that is wrong is left to the fit, which leaves it out.

    Raises
    ------
    DataError
        With the reflector that moved, its rows, or the distances.
    """
    pairs = _pairs(samples, cell)
    moved = [(pair, found) for pair in pairs if (found := _step(pair)) is not None]
    if moved:
        raise samples.error(_moved(samples, moved, pairs))
    for pair in pairs:
        if len(pair.off) < _FEWEST:
            continue
        a, b = (cell.reflectors[name] for name in pair.names)
        off, known = float(np.median(pair.off)), float(np.hypot(a.std_mm, b.std_mm))
        if abs(off) > _SIGMAS * known + 2.0 * pair.std:
            stated = float(np.linalg.norm(a.p_flange - b.p_flange))
            raise samples.error(
                f"reflectors {pair.names[0]} and {pair.names[1]} are {stated + off:.3f} mm apart by their readings, "
                f"{stated:.3f} ± {known:.3f} mm by the cell file; are they exchanged? Correct positions or "
                "names, or state a larger std_mm in [reflectors]"
            )


def _pairs(samples: Samples, cell: Cell) -> list[_Pair]:
    which, visit = reflector_index(samples, cell), visits(samples)
    names, found = list(cell.reflectors), []
    row = np.full((visit[-1] + 1, len(names)), -1)
    row[visit, which] = np.arange(len(samples))
    std = _READING_MM if samples.p_std is None else float(np.sqrt(2.0 * np.mean(samples.p_std**2)))
    for i, j in combinations(range(len(names)), 2):
        rows = row[(row[:, [i, j]] >= 0).all(axis=1)][:, [i, j]]
        read = np.linalg.norm(samples.p_meas[rows[:, 0]] - samples.p_meas[rows[:, 1]], axis=1)
        a, b = (cell.reflectors[names[k]].p_flange for k in (i, j))
        found.append(_Pair((names[i], names[j]), rows, read - np.linalg.norm(a - b), std))
    return found


def _step(pair: _Pair) -> tuple[int, float] | None:
    """Return the pose before which a distance changed for good, and by how much [mm]; None where it did not.

    The medians of the poses before and after are compared, so that single wrong readings do not count.
    """
    n = len(pair.off)
    best, at = 0.0, 0
    for k in range(_FEWEST, n - _FEWEST + 1):
        before, after = pair.off[:k], pair.off[k:]
        middles = np.median(before), np.median(after)
        left = np.abs(np.concatenate([before - middles[0], after - middles[1]]))
        std = max(_SPREAD * float(np.median(left)), 0.6 * pair.std)
        surprise = float(middles[1] - middles[0]) / (std * np.sqrt(1.6 / k + 1.6 / (n - k)))
        if abs(surprise) > abs(best):
            best, at = surprise, k
    size = float(np.median(pair.off[at:]) - np.median(pair.off[:at])) if at else 0.0
    return (at, size) if abs(best) > _SIGMAS and abs(size) > _LEAST_MM else None


def _moved(samples: Samples, moved: list[tuple[_Pair, tuple[int, float]]], pairs: list[_Pair]) -> str:
    """Return the sentence about reflectors whose distances changed."""
    worst, (at, size) = max(moved, key=lambda one: abs(one[1][1]))
    changed = [pair.names for pair, _ in moved]
    others = [pair.names for pair in pairs if pair.names not in changed]
    # the reflector of all changed distances, and of none that stayed
    alone = [name for name in worst.names if all(name in names for names in changed)]
    alone = [name for name in alone if not any(name in names for names in others)]
    who = f"reflector {alone[0]}" if len(alone) == 1 else f"reflector {' or '.join(worst.names)}"
    before, after = (samples.rows(worst.rows[k]) for k in (at - 1, at))
    distances = ", ".join("–".join(names) for names in changed)
    return (
        f"{who} moved on the flange between {before} and {after}: the distance {distances} changes by {abs(size):.3f} "
        "mm; fasten it and measure again, or fit the rows before and after it as two maps"
    )
