"""Divide samples into folds for cross-validation: random points, blocks of space, branches of the arm (theory (14))."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.robots import Robot

SPLITS: Final = ("points", "blocks", "branches")
"""The names of the ways to divide samples into folds."""

_SAME_PLACE: Final = 1e-3  # of the spread of each coordinate


def random_folds(n: int, folds: int = 5, *, rng: np.random.Generator | int = 0) -> IntArray:
    """Return the fold of each of n samples, sizes equal to within one.

    Parameters
    ----------
    n : int
        The number of samples.
    folds : int
        The number of folds.
    rng : Generator or int
        The seed.

    Returns
    -------
    (n,) array of int
        Folds from 0 to folds − 1.
    """
    _check(n, folds)
    return np.random.default_rng(rng).permutation(np.arange(n) % folds)


def point_folds(x: ArrayLike, folds: int = 5, *, rng: np.random.Generator | int = 0) -> IntArray:
    """Return the fold of each sample for random folds that keep repeats of a point together.

    Points nearer to each other than a thousandth of the spread count as repeats.

    Parameters
    ----------
    x : (n, d) array
        The positions [mm] or joints [rad].
    folds : int
        The number of folds.
    rng : Generator or int
        The seed.

    Returns
    -------
    (n,) array of int
        Folds from 0 to folds − 1.
    """
    points = _scaled(x)
    n = len(points)
    _check(n, folds)
    pairs = cKDTree(points).query_pairs(_SAME_PLACE, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    places, place = connected_components(links, directed=False)
    if places < folds:
        return random_folds(n, folds, rng=rng)
    return np.asarray(random_folds(places, folds, rng=rng)[place])


def block_folds(x: ArrayLike, folds: int = 5, *, rng: np.random.Generator | int = 0) -> IntArray:
    """Return the fold of each sample for compact blocks of space, sizes equal to within one.

    Neighbouring samples have similar errors, so random folds favour an interpolator; blocks ask it to predict a region
    that it has not seen. After a random rotation of the scaled coordinates, the samples are cut across their widest
    extent, and so is each part, until there are as many blocks as folds.

    Parameters
    ----------
    x : (n, d) array
        The positions [mm] or joints [rad].
    folds : int
        The number of folds.
    rng : Generator or int
        The seed.

    Returns
    -------
    (n,) array of int
        Folds from 0 to folds − 1.
    """
    scaled = _scaled(x)
    n, d = scaled.shape
    _check(n, folds)
    turned = scaled @ np.linalg.qr(np.random.default_rng(rng).normal(size=(d, d)))[0]
    fold = np.zeros(n, np.int64)
    parts = [(np.arange(n), 0, folds)]
    while parts:
        rows, first, count = parts.pop()
        fold[rows] = first
        if count > 1:
            half = count // 2
            widest = np.argmax(np.ptp(turned[rows], axis=0))
            along = rows[np.argsort(turned[rows, widest], kind="stable")]
            cut = round(len(rows) * half / count)
            parts += [(along[:cut], first, half), (along[cut:], first + half, count - half)]
    return fold


def branch_folds(robot: Robot, q: ArrayLike) -> IntArray:
    """Return the branch of the inverse kinematics of each sample as its fold.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    q : (n, dof) array [rad]
        The joints of the samples.

    Returns
    -------
    (n,) array of int
        Branches, numbered from 0.

    Raises
    ------
    DataError
        If all samples are on one branch.
    RobotError
        If the robot's branches are not known.
    """
    joints = robot.check_joints(q)
    turned = robot.inverse(robot.forward(joints)) - joints[:, None]
    distance = np.linalg.norm(np.remainder(turned + np.pi, 2 * np.pi) - np.pi, axis=2)  # full turns are no branch
    branch = np.argmin(np.where(np.isnan(distance), np.inf, distance), axis=1)
    found, fold = np.unique(branch, return_inverse=True)
    if len(found) < 2:
        raise DataError(f'all {len(joints)} samples are on one branch of the arm; take "blocks" or "points" as splits')
    return fold.astype(np.int64)


def split_samples(
    splits: Sequence[str],
    coordinates: Mapping[str, FloatArray],
    *,
    robot: Robot | None = None,
    folds: int = 5,
    rng: np.random.Generator | int = 0,
    pose: IntArray | None = None,
) -> dict[str, IntArray]:
    """Return the folds of the samples for each named split.

    Parameters
    ----------
    splits : sequence of str
        Names from `SPLITS`: random points, blocks of the workspace, branches of the arm (one fold per branch).
    coordinates : mapping
        The positions ``cartesian`` (n, 3) [mm], and the joints ``joint`` (n, dof) [rad] where known.
    robot : Robot, optional
        The nominal robot, for branches.
    folds : int
        The number of folds of points and blocks.
    rng : Generator or int
        The seed of points and blocks.
    pose : (n,) array of int, optional
        The pose of each sample; samples of one pose stay together. By default each is a pose of its own.

    Raises
    ------
    DataError
        If a split is not known, or there are fewer samples than folds.
    """
    own = np.arange(len(coordinates["cartesian"])) if pose is None else pose
    _, first, number = np.unique(own, return_index=True, return_inverse=True)
    position, q = coordinates["cartesian"][first], coordinates.get("joint")
    q = None if q is None else q[first]
    place = position if q is None else np.column_stack([position, q])

    def branches() -> IntArray:
        if robot is None or q is None:
            raise DataError('the split "branches" needs the robot and joints; take "blocks" or "points"')
        return branch_folds(robot, q)

    known: dict[str, Callable[[], IntArray]] = {
        "points": lambda: point_folds(place, folds, rng=rng),
        "blocks": lambda: block_folds(position, folds, rng=rng),
        "branches": branches,
    }
    unknown = [name for name in splits if name not in known]
    if unknown or not splits:
        raise DataError(f"splits are {list(splits)}; expected one or more of {', '.join(SPLITS)}")
    return {name: known[name]()[number] for name in splits}


def blocks_by_size(labels: NDArray[Any]) -> list[IntArray]:
    """Return the rows of each block, with all blocks of one size m in one array (g, m).

    Parameters
    ----------
    labels : (n,) array
        The block of each row.
    """
    count = np.unique_counts(labels).counts
    order = np.argsort(labels, kind="stable")
    start = np.cumsum(count) - count
    return [order[start[count == m][:, None] + np.arange(m)] for m in np.unique(count)]


def _scaled(x: ArrayLike) -> FloatArray:
    points = np.asarray(x, float)
    spread = points.std(axis=0) if len(points) else np.ones(points.shape[1:])
    return np.asarray(points / np.where(spread > 0, spread, 1.0))


def _check(n: int, folds: int) -> None:
    if not 2 <= folds <= n:
        raise DataError(f"got {folds} folds of {n} samples; expected at least 2 folds and as many samples as folds")
