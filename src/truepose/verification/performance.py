"""Compute the performance figures of ISO 9283:1998 from repeated poses and paths in the robot base frame.

Pose accuracy AP and repeatability RP (7.2), multi-directional variation vAP (7.2.3), distance accuracy AD and
repeatability RD (7.3), drift dAP and dRP (7.6), path accuracy AT and repeatability RT (8.2, 8.3). Attained poses are
p_j, their barycentre p̄, the commanded pose p_c:

    AP = ‖p̄ − p_c‖,  l_j = ‖p_j − p̄‖,  RP = l̄ + 3 S_l,  AP_a = ā − a_c,  RP_a = 3 S_a (S with n − 1).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import DataError

CYCLES: Final = 30
PATH_CYCLES: Final = 10
DRIFT_CYCLES: Final = 10
DRIFT_HOURS: Final = 8.0
POSES: Final = ("P1", "P2", "P3", "P4", "P5")
DIRECTIONS: Final = 3
"""The numbers of cycles, hours, poses and approach directions that the standard requires."""


@dataclass(frozen=True, eq=False)
class Attained:
    """Repeatedly commanded poses and the attained ones.

    Attributes
    ----------
    pose : (n,) array of str
        The name of the commanded pose of each row. Names that begin with "path" are points of a path.
    p_cmd, p : (n, 3) arrays [mm], base frame
        The commanded and attained positions.
    turn : (n, 3) array [rad], optional
        The rotation vectors from commanded to attained orientation, base frame.
    direction : (n,) int array, optional
        The direction of approach of each row.
    time : (n,) array [s], optional
        The time of each row.
    """

    pose: NDArray[np.str_]
    p_cmd: FloatArray
    p: FloatArray
    turn: FloatArray | None = None
    direction: IntArray | None = None
    time: FloatArray | None = None

    def of(self, name: str) -> BoolArray:
        """Return the rows of a pose, (n,) bool."""
        return np.asarray(self.pose == name)


@dataclass(frozen=True)
class PoseFigures:
    """AP and RP of one pose: position [mm], and orientation about x, y, z [deg] if measured."""

    name: str
    n: int
    AP_mm: float
    AP_xyz_mm: tuple[float, float, float]
    RP_mm: float
    AP_abc_deg: tuple[float, float, float] | None = None
    RP_abc_deg: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Iso9283:
    """The figures of ISO 9283; None where the measurements do not suffice, with the reason in `missing`.

    Attributes
    ----------
    poses : tuple of PoseFigures
        The figures of each pose.
    AP_mm, RP_mm : float, optional
        The largest pose accuracy and repeatability of all poses.
    vAP_mm : float, optional
        The largest distance between barycentres of one pose, `vAP_pose`, approached from several directions.
    AD_mm, RD_mm : float, optional
        The mean difference between attained and commanded distance, and 3 S of the attained ones, between `AD_poses`.
    dAP_mm, dRP_mm : float, optional
        The largest change of AP and of RP from the first ten cycles, at `drift_pose`, over `drift_hours`.
    AT_mm, RT_mm : float, optional
        The largest path accuracy and repeatability of all path points.
    missing : tuple of str
        The measurements that the standard requires and that are missing.
    """

    poses: tuple[PoseFigures, ...]
    AP_mm: float | None
    RP_mm: float | None
    vAP_mm: float | None  # noqa: N815 (as the standard writes it)
    vAP_pose: str | None  # noqa: N815 (as the standard writes it)
    AD_mm: float | None
    RD_mm: float | None
    AD_poses: tuple[str, str] | None
    dAP_mm: float | None  # noqa: N815 (as the standard writes it)
    dRP_mm: float | None  # noqa: N815 (as the standard writes it)
    drift_pose: str | None
    drift_hours: float | None
    AT_mm: float | None
    RT_mm: float | None
    missing: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        return asdict(self)


def pose_accuracy(p_cmd: FloatArray, p: FloatArray) -> float:
    """Return AP = ‖p̄ − p_c‖ [mm] of attained positions (n, 3) [mm]; commanded ones (n, 3) are averaged."""
    return float(np.linalg.norm((p - p_cmd).mean(axis=0)))


def pose_repeatability(p: FloatArray) -> float:
    """Return RP = l̄ + 3 S_l [mm] of attained positions (n, 3) [mm], n > 1.

    Examples
    --------
    >>> round(pose_repeatability(np.array([[0.0, 0, 0], [2.0, 0, 0], [1.0, 3.0, 0], [1.0, -3.0, 0]])), 3)
    5.464
    """
    length = np.linalg.norm(p - p.mean(axis=0), axis=1)
    return float(length.mean() + 3.0 * length.std(ddof=1))


def distance_figures(p_1: FloatArray, p_2: FloatArray, commanded: float) -> tuple[float, float]:
    """Return AD = D̄ − D_c and RD = 3 S_D [mm] of attained pairs (n, 3), (n, 3) [mm], n > 1."""
    attained = np.linalg.norm(p_1 - p_2, axis=1)
    return float(attained.mean() - commanded), float(3.0 * attained.std(ddof=1))


def pose_drift(p_cmd: FloatArray, p: FloatArray, cycles: int = DRIFT_CYCLES) -> tuple[float, float]:
    """Return dAP = max |AP_0 − AP_t| and dRP = max |RP_0 − RP_t| [mm] over blocks of cycles in order of time."""
    blocks = [slice(k, k + cycles) for k in range(0, len(p) - cycles + 1, cycles)]
    ap = np.array([pose_accuracy(p_cmd[block], p[block]) for block in blocks])
    rp = np.array([pose_repeatability(p[block]) for block in blocks])
    return float(np.abs(ap - ap[0]).max()), float(np.abs(rp - rp[0]).max())


def path_figures(p_cmd: FloatArray, p: FloatArray) -> tuple[float, float]:
    """Return AT = max_i ‖p̄_i − p_ci‖ and RT = max_i (l̄_i + 3 S_li) [mm].

    Parameters
    ----------
    p_cmd : (m, 3) array [mm]
        The points of the commanded path.
    p : (n, m, 3) array [mm]
        The attained points of each of n > 1 cycles, see `crossings`.
    """
    mean = p.mean(axis=0)
    length = np.linalg.norm(p - mean, axis=2)
    at = np.linalg.norm(mean - p_cmd, axis=1)
    rt = length.mean(axis=0) + 3.0 * length.std(axis=0, ddof=1)
    return float(at.max()), float(rt.max())


def crossings(p_cmd: FloatArray, p: FloatArray) -> FloatArray:
    """Return the intersections of a densely read path with the planes normal to the commanded path at its points.

    Parameters
    ----------
    p_cmd : (m, 3) array [mm]
        The points of the commanded path, m > 1.
    p : (k, 3) array [mm]
        The readings along the attained path, k > 1.

    Returns
    -------
    (m, 3) array [mm]
        The intersection nearest to each commanded point.

    Raises
    ------
    DataError
        If the readings do not cross a plane.
    """
    tangent = np.gradient(p_cmd, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    along = np.einsum("kmi,mi->mk", p[:, None] - p_cmd, tangent)
    before, after = along[:, :-1], along[:, 1:]
    crosses = (before <= 0.0) & (after >= 0.0) & (after > before)
    share = np.divide(-before, after - before, out=np.zeros_like(before), where=crosses)
    at = p[None, :-1] + share[..., None] * (p[1:] - p[:-1])
    off = np.where(crosses, np.linalg.norm(at - p_cmd[:, None], axis=2), np.inf)
    if lost := np.flatnonzero(~crosses.any(axis=1)).tolist():
        message = f"the attained path does not pass the plane across point {lost[0]} of the commanded path"
        raise DataError(f"{message} ({len(lost)} of {len(p_cmd)}); read from before its start to after its end")
    nearest: FloatArray = at[np.arange(len(p_cmd)), off.argmin(axis=1)]
    return nearest


def performance_figures(attained: Attained) -> Iso9283:
    """Return all figures that the measurements allow.

    Parameters
    ----------
    attained : Attained
        The repeated poses.

    Returns
    -------
    Iso9283

    Raises
    ------
    DataError
        If no pose was measured at least twice.
    """
    names, first, counts = np.unique(attained.pose, return_index=True, return_counts=True)
    order = np.argsort(first)
    repeated = [str(name) for name in names[order][counts[order] > 1]]
    poses = [name for name in repeated if not name.lower().startswith("path")]
    if not repeated:
        message = f"none of {len(names)} poses is repeated; ISO 9283 asks for {CYCLES} cycles of each of {len(POSES)}"
        raise DataError(f"{message} poses: name them P1 … P5, or give the same commanded pose again")
    missing: list[str] = []
    each = tuple(_of_pose(attained, name) for name in poses)
    _count_cycles(each, missing)
    return Iso9283(
        poses=each,
        AP_mm=max((pose.AP_mm for pose in each), default=None),
        RP_mm=max((pose.RP_mm for pose in each), default=None),
        **_directions(attained, poses, missing),
        **_distance(attained, poses, missing),
        **_drift(attained, poses, missing),
        **_paths(attained, repeated, missing),
        missing=tuple(missing),
    )


def _of_pose(attained: Attained, name: str) -> PoseFigures:
    rows = attained.of(name)
    p, p_cmd = attained.p[rows], attained.p_cmd[rows]
    x, y, z = (p - p_cmd).mean(axis=0).tolist()
    found = PoseFigures(name, int(rows.sum()), pose_accuracy(p_cmd, p), (x, y, z), pose_repeatability(p))
    if attained.turn is None:
        return found
    turn = np.rad2deg(attained.turn[rows])
    angles = {"AP_abc_deg": tuple(turn.mean(axis=0).tolist()), "RP_abc_deg": tuple(3.0 * turn.std(axis=0, ddof=1))}
    return PoseFigures(**{**asdict(found), **angles})


def _count_cycles(each: tuple[PoseFigures, ...], missing: list[str]) -> None:
    few = [pose for pose in each if pose.n < CYCLES]
    if few:
        least = min(few, key=lambda pose: pose.n)
        missing.append(
            f"AP, RP: {len(few)} of {len(each)} poses have fewer than {CYCLES} cycles (pose {least.name}: {least.n}); "
            f"the standard asks for {CYCLES}"
        )
    if len(each) < len(POSES):
        missing.append(f"AP, RP: {len(each)} repeated poses; the standard asks for {len(POSES)}, P1 to P5 of a cube")
    if each and each[0].AP_abc_deg is None:
        missing.append("AP, RP of orientation: no orientations were measured")


def _directions(attained: Attained, poses: list[str], missing: list[str]) -> dict[str, Any]:
    nothing = {"vAP_mm": None, "vAP_pose": None}
    wanted = f"the standard asks for {DIRECTIONS} perpendicular ones at P1, P2 and P4, {CYCLES} cycles each"
    if attained.direction is None:
        missing.append(f"vAP: the directions of approach are not recorded; {wanted}")
        return nothing
    found: dict[str, float] = {}
    fewest, most = CYCLES, 0
    for name in poses:
        rows = attained.of(name)
        ways, counts = np.unique(attained.direction[rows], return_counts=True)
        if len(ways) > 1:
            centres = [attained.p[rows & (attained.direction == way)].mean(axis=0) for way in ways]
            found[name] = max(float(np.linalg.norm(a - b)) for a, b in combinations(centres, 2))
            fewest, most = min(fewest, int(counts.min())), max(most, len(ways))
    if not found:
        missing.append(f"vAP: each pose was approached from one direction; {wanted}")
        return nothing
    if fewest < CYCLES or most < DIRECTIONS or len(found) < 3:
        missing.append(f"vAP: {len(found)} poses, up to {most} directions, from {fewest} cycles on; {wanted}")
    worst = max(found, key=lambda name: found[name])
    return {"vAP_mm": found[worst], "vAP_pose": worst}


def _distance(attained: Attained, poses: list[str], missing: list[str]) -> dict[str, Any]:
    if len(poses) < 2:
        missing.append("AD, RD: fewer than two repeated poses; the standard asks for P2 and P4")
        return {"AD_mm": None, "RD_mm": None, "AD_poses": None}
    centre = {name: attained.p_cmd[attained.of(name)].mean(axis=0) for name in poses}
    pair = ("P2", "P4")
    if not set(pair) <= set(poses):
        names = np.array(poses)
        positions = np.array([centre[name] for name in poses])
        apart = np.linalg.norm(positions[:, None] - positions, axis=2)
        first, second = np.unravel_index(apart.argmax(), apart.shape)
        pair = (str(names[first]), str(names[second]))
        missing.append(
            f"AD, RD: no poses are named P2 and P4; taken between {pair[0]} and {pair[1]}, the furthest apart"
        )
    p_1, p_2 = (attained.p[attained.of(name)] for name in pair)
    n = min(len(p_1), len(p_2))
    ad, rd = distance_figures(p_1[:n], p_2[:n], float(np.linalg.norm(centre[pair[0]] - centre[pair[1]])))
    if n < CYCLES:
        missing.append(f"AD, RD: {n} pairs; the standard asks for {CYCLES}")
    return {"AD_mm": ad, "RD_mm": rd, "AD_poses": pair}


def _drift(attained: Attained, poses: list[str], missing: list[str]) -> dict[str, Any]:
    nothing = {"dAP_mm": None, "dRP_mm": None, "drift_pose": None, "drift_hours": None}
    wanted = f"the standard asks for {DRIFT_CYCLES} cycles of P1 at a time over {DRIFT_HOURS:g} hours"
    if attained.time is None:
        missing.append(f"drift: no times; {wanted}")
        return nothing
    name = "P1" if "P1" in poses else max(poses, key=lambda pose: int(attained.of(pose).sum()), default="")
    rows = np.flatnonzero(attained.of(name))
    if len(rows) < 2 * DRIFT_CYCLES:
        missing.append(f"drift: {len(rows)} cycles of one pose; {wanted}")
        return nothing
    rows = rows[np.argsort(attained.time[rows], kind="stable")]
    hours = float(np.ptp(attained.time[rows])) / 3600.0
    if hours < DRIFT_HOURS:
        missing.append(f"drift: over {hours:.3g} hours; {wanted}")
    d_ap, d_rp = pose_drift(attained.p_cmd[rows], attained.p[rows])
    return {"dAP_mm": d_ap, "dRP_mm": d_rp, "drift_pose": name, "drift_hours": hours}


def _paths(attained: Attained, repeated: list[str], missing: list[str]) -> dict[str, Any]:
    points = [name for name in repeated if name.lower().startswith("path")]
    if not points:
        missing.append(f'AT, RT: no path; name its points "path1", "path2" …, each in {PATH_CYCLES} cycles')
        return {"AT_mm": None, "RT_mm": None}
    cycles = min(int(attained.of(name).sum()) for name in points)
    if cycles < PATH_CYCLES:
        missing.append(f"AT, RT: {cycles} cycles; the standard asks for {PATH_CYCLES}")
    each = [
        path_figures(attained.p_cmd[rows].mean(axis=0)[None], attained.p[rows][:, None])
        for rows in (attained.of(name) for name in points)
    ]
    return {"AT_mm": max(at for at, _ in each), "RT_mm": max(rt for _, rt in each)}
