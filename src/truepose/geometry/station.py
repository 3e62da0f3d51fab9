"""The tracker's station relative to the robot base, and the tool offset: closed forms, Gauss-Newton, identifiability.

A reading P_i at the flange pose (R_i, p_i) is explained by the station (R, t) and the tool offset a:

    residual_i = R P_i + t - (p_i + R_i a)                                                      [mm], base frame

With a known, the best (R, t) is closed form (Kabsch 1976; Umeyama 1991). With a unknown, the residual is linear in the
nine entries of R, t and a, which gives a start without an initial guess; Gauss-Newton on the rotation vector, t and a
completes the fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import IdentifiabilityError
from truepose.geometry.robust import trusted_count
from truepose.geometry.transforms import cross_matrix

STATION_NAMES: Final = tuple(f"station {kind} {axis}" for kind in ("translation", "rotation") for axis in "xyz")
TOOL_NAMES: Final = tuple(f"tool {axis}" for axis in "xyz")
MINIMAL: Final = 3
"""The minimum number of readings that determine the station, or station and tool."""
MINIMAL_LINEAR: Final = 5
"""The minimum number of readings that determine the fifteen unknowns of the linear start."""

_DEGENERATE: Final = 1e-6  # singular values below this part of the largest count as zero
_CONVERGED: Final = 1e-9  # size of the last step of a candidate, relative to the largest coordinate
_WEAK: Final = 5.0  # mm: standard deviation of a direction that causes a hint
_SUBSETS: Final = 300  # probability that all contain an outlier, with 30 % outliers and subsets of 8: 2e-8
_SCORED: Final = 500  # readings with which the candidates are compared


@dataclass(frozen=True)
class StationPoses:
    """Commanded flange positions (…, n, 3) [mm] and rotations (…, n, 3, 3), and the readings (…, n, 3) [mm].

    Without `rotations` the commanded positions are those of the TCP, and no tool offset is fitted.
    """

    p_commanded: FloatArray
    p_measured: FloatArray
    rotations: FloatArray | None = None

    def __getitem__(self, rows: IntArray | BoolArray) -> StationPoses:
        rotations = None if self.rotations is None else self.rotations[rows]
        return StationPoses(self.p_commanded[rows], self.p_measured[rows], rotations)


@dataclass(frozen=True)
class Station:
    """Station rotation (…, 3, 3), translation (…, 3) [mm] and tool offset (…, 3) [mm]; leading axes hold candidates."""

    rotation: FloatArray
    translation: FloatArray
    p_flange_tool: FloatArray

    def measured(self, poses: StationPoses) -> FloatArray:
        """Return the readings in the base frame, (…, n, 3) [mm]."""
        return np.asarray(poses.p_measured @ np.swapaxes(self.rotation, -1, -2) + self.translation[..., None, :])

    def tcp(self, poses: StationPoses) -> FloatArray:
        """Return the commanded positions of the TCP, (…, n, 3) [mm]."""
        if poses.rotations is None:
            return poses.p_commanded
        return np.asarray(poses.p_commanded + np.einsum("...nij,...j->...ni", poses.rotations, self.p_flange_tool))

    def residuals(self, poses: StationPoses) -> FloatArray:
        """Return measured minus commanded positions in the base frame, (…, n, 3) [mm]."""
        return np.asarray(self.measured(poses) - self.tcp(poses))

    def norms(self, poses: StationPoses) -> FloatArray:
        """Return the norms of the residuals, (…, n) [mm]."""
        return np.asarray(np.linalg.norm(self.residuals(poses), axis=-1))


class ToolPrior(NamedTuple):
    """A tool that is roughly known: its offset p_flange_tool (3,) [mm], and its standard deviation by axis [mm]."""

    p_flange_tool: FloatArray
    std: float


def kabsch(p_from: FloatArray, p_to: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation (…, 3, 3) and translation (…, 3) that best map points (…, n, 3) with weights (…, n).

    Umeyama (1991), equations (39)-(42) without scale: the determinant is kept at +1.
    """
    w = (weights / weights.sum(axis=-1, keepdims=True))[..., None]
    mean_from, mean_to = (w * p_from).sum(axis=-2), (w * p_to).sum(axis=-2)
    spread_from, spread_to = p_from - mean_from[..., None, :], p_to - mean_to[..., None, :]
    u, _, vt = np.linalg.svd(np.swapaxes(w * spread_to, -1, -2) @ spread_from)
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    rotation = u @ vt
    return rotation, mean_to - np.einsum("...ij,...j->...i", rotation, mean_from)


def design(poses: StationPoses, station: Station) -> tuple[FloatArray, FloatArray]:
    """Return the derivative of the residuals, (…, 3n, 6 or 9), and its centre (…, 3) [mm].

    Columns: translation; rotation vector about the centre (mean reading, base frame); tool offset.
    """
    measured = station.measured(poses)
    centre = measured.mean(axis=-2)
    arm = measured - centre[..., None, :]
    columns = np.zeros((*arm.shape, 6 if poses.rotations is None else 9))
    columns[..., :3] = np.eye(3)
    columns[..., 3:6] = -cross_matrix(arm)
    if poses.rotations is not None:
        columns[..., 6:] = -poses.rotations
    return columns.reshape(*arm.shape[:-2], -1, columns.shape[-1]), centre


def refine_station(
    poses: StationPoses,
    weights: FloatArray,
    station: Station,
    steps: int = 50,
    prior: ToolPrior | None = None,
    noise_std: float = 0.0,
) -> Station:
    """Return the weighted least-squares station (and tool): closed form, or Gauss-Newton from `station`.

    A prior of the tool counts as three more readings of it, against readings with `noise_std` [mm].
    """
    if poses.rotations is None:
        return Station(*kabsch(poses.p_measured, poses.p_commanded, weights), station.p_flange_tool)
    root = np.repeat(np.sqrt(weights), 3)
    for _ in range(steps):
        columns, centre = design(poses, station)
        length = np.linalg.norm(columns, axis=0)
        weighted, wanted = root[:, None] * columns / length, -root * station.residuals(poses).ravel()
        if prior is not None:
            share = noise_std / prior.std
            weighted = np.concatenate([weighted, share * np.eye(9)[6:] / length])
            wanted = np.concatenate([wanted, share * (prior.p_flange_tool - station.p_flange_tool)])
        scaled = np.linalg.lstsq(weighted, wanted, rcond=None)[0]
        station = _moved(station, np.asarray(scaled / length), centre)
        if np.linalg.norm(scaled) <= 1e-11 * np.linalg.norm(poses.p_commanded):
            break
    return station


def _moved(station: Station, step: FloatArray, centre: FloatArray) -> Station:
    turn = Rotation.from_rotvec(step[..., 3:6]).as_matrix()
    lever = np.einsum("...ij,...j->...i", turn, station.translation - centre)
    return Station(turn @ station.rotation, centre + lever + step[..., :3], station.p_flange_tool + step[..., 6:])


def start(poses: StationPoses, p_flange_tool: FloatArray | None, robust: bool, rng: np.random.Generator) -> Station:
    """Return a start for station (and tool), chosen from fits to all readings and to random subsets.

    The candidate with the smallest h-th residual is chosen (least quantile of squares, Rousseeuw 1984).
    """
    n = len(poses.p_measured)
    groups = [np.arange(n)[None]]
    if robust and n > MINIMAL:
        size = MINIMAL if poses.rotations is None else min(8, max(MINIMAL_LINEAR, 2 * n // 3))
        groups.append(rng.integers(n, size=(_SUBSETS, size)))
    candidates = [found for rows in groups for found in _candidates(poses[rows], p_flange_tool)]
    scored = poses if n <= _SCORED else poses[rng.choice(n, _SCORED, replace=False)]
    h = trusted_count(len(scored.p_measured), MINIMAL) - 1
    scores = [np.partition(found.norms(scored), h, axis=-1)[:, h] for found in candidates]
    best = int(np.argmin([score.min() for score in scores]))
    one = int(np.argmin(scores[best]))
    won = candidates[best]
    return Station(won.rotation[one], won.translation[one], won.p_flange_tool[one])


def _candidates(poses: StationPoses, p_flange_tool: FloatArray | None) -> list[Station]:
    """Return fits to each of k subsets, poses (k, m, …), from several starts of the rotation."""
    k, m = poses.p_measured.shape[:2]
    guess = np.zeros((k, 3)) if p_flange_tool is None else np.tile(p_flange_tool, (k, 1))
    tcp = Station(np.eye(3), np.zeros(3), guess).tcp(poses)
    rigid = Station(*kabsch(poses.p_measured, tcp, np.ones((k, m))), guess)
    if poses.rotations is None:
        return [rigid]
    linear = _linear_rotation(poses)
    return [_damped_steps(poses, _given_rotation(poses, rotation)) for rotation in (linear, rigid.rotation)]


def _linear_rotation(poses: StationPoses) -> FloatArray:
    """Return the rotations (k, 3, 3) nearest to the best matrices: R P + t - R_i a = p is linear in R, t and a."""
    assert poses.rotations is not None
    k, m = poses.p_measured.shape[:2]
    centred = poses.p_measured - poses.p_measured.mean(axis=1, keepdims=True)
    size = np.abs(centred).max(axis=(1, 2), keepdims=True) + np.finfo(float).tiny
    columns = np.zeros((k, m, 3, 15))
    for row in range(3):
        columns[:, :, row, 3 * row : 3 * row + 3] = centred / size
    columns[..., 9:12] = np.eye(3)
    columns[..., 12:] = -poses.rotations
    # least norm where few or coplanar readings leave entries undetermined: the projection to rotations completes them
    solution = np.linalg.pinv(columns.reshape(k, 3 * m, 15)) @ poses.p_commanded.reshape(k, 3 * m, 1)
    u, _, vt = np.linalg.svd(solution[:, :9, 0].reshape(k, 3, 3))
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    return np.asarray(u @ vt)


def _given_rotation(poses: StationPoses, rotation: FloatArray) -> Station:
    """Return the best translation and tool for given rotations (k, 3, 3), a linear problem."""
    assert poses.rotations is not None
    k, m = poses.p_measured.shape[:2]
    columns = np.concatenate([np.broadcast_to(np.eye(3), (k, m, 3, 3)), -poses.rotations], axis=-1).reshape(k, 3 * m, 6)
    wanted = poses.p_commanded - poses.p_measured @ np.swapaxes(rotation, -1, -2)
    solution = (np.linalg.pinv(columns) @ wanted.reshape(k, 3 * m, 1))[..., 0]
    return Station(rotation, solution[:, :3], solution[:, 3:])


def _damped_steps(poses: StationPoses, station: Station, steps: int = 15) -> Station:
    """Apply a few Gauss-Newton steps to k subsets; the damping only keeps degenerate subsets solvable."""
    for _ in range(steps):
        columns, centre = design(poses, station)
        normal = np.swapaxes(columns, -1, -2) @ columns
        diagonal = np.einsum("kii->ki", normal)
        diagonal *= 1.0 + 1e-9
        diagonal += 1e-9 * diagonal.max(axis=-1, keepdims=True)
        k = len(centre)
        gradient = np.swapaxes(columns, -1, -2) @ station.residuals(poses).reshape(k, -1, 1)
        step = np.linalg.solve(normal, -gradient)[..., 0]
        station = _moved(station, np.asarray(step, dtype=np.float64), centre)
        if np.abs(step).max() <= _CONVERGED * np.abs(poses.p_commanded).max():  # the chosen candidate is refined later
            break
    return station


def covariance(poses: StationPoses, station: Station, noise_std: float, prior: ToolPrior | None = None) -> FloatArray:
    """Return the covariance of (translation [mm], rotation vector [rad], tool [mm]), (6, 6) or (9, 9).

    The true station is (exp(δω) R, t + δt): the rotation vector turns about the base's origin axes.
    """
    columns, centre = design(poses, station)
    if prior is not None:
        columns = np.concatenate([columns, noise_std / prior.std * np.eye(9)[6:]])
    length = np.linalg.norm(columns, axis=0)
    r_inverse = np.linalg.inv(np.linalg.qr(columns / length, mode="r")) / length[:, None]
    # a rotation about the centre, expressed at the base origin: δt = δt' + δω × (t - centre)
    change = np.eye(columns.shape[-1])
    change[:3, 3:6] = -cross_matrix(station.translation - centre)
    root = change @ r_inverse * noise_std
    return np.asarray(root @ root.T)


class OpenDirections(NamedTuple):
    """The directions of station and tool that poses cannot determine.

    Attributes
    ----------
    names : str
        The directions, such as "tool z with station translation z"; empty when there is none.
    std : float [mm]
        The largest standard deviation of a direction.
    rank : int
        The number of directions that are determined.
    condition : float
        The condition number.
    """

    names: str
    std: float
    rank: int
    condition: float


def open_directions(poses: StationPoses, station: Station, noise_std: float, limit: float) -> OpenDirections:
    """Find the directions of station and tool that the poses cannot determine.

    Parameters
    ----------
    poses : StationPoses
        The commanded poses and readings.
    station : Station
        The station fitted to them.
    noise_std : float [mm]
        The standard deviation of one axis of the residuals.
    limit : float [mm]
        The standard deviation above which a direction counts as open; rotations are taken at the mean distance of the
        points.
    """
    columns, _ = design(poses, station)
    length = np.linalg.norm(columns, axis=0)
    length[3:6] = (
        length[3:6].max() or 1.0
    )  # the same length for the three rotations, so that a line is not scaled up to a plane
    _, s, vt = np.linalg.svd(columns / length, full_matrices=False)
    condition = float(s[0] / s[-1]) if s[-1] > 0 else np.inf
    std = noise_std / np.maximum(s, np.finfo(float).tiny) / np.sqrt(len(poses.p_measured))
    closed = (s > _DEGENERATE * s[0]) & (std <= limit)
    names = STATION_NAMES + (TOOL_NAMES if poses.rotations is not None else ())
    listed = "; ".join(_named(vector, names) for vector in _echelon(vt[~closed]))
    return OpenDirections(listed, float(std[-1]), int(closed.sum()), condition)


def check_identifiable(poses: StationPoses, station: Station, noise_std: float = 0.0, limit: float = np.inf) -> None:
    """Raise `IdentifiabilityError` if there are `open_directions`; the message states rank, condition and remedy."""
    found = open_directions(poses, station, noise_std, limit)
    if not found.names:
        return
    if poses.rotations is None:
        remedy = "the points lie on a line or at one place; measure points that span an area"
    else:
        remedy = (
            "measure more poses, with the flange turned about at least two axes and the points not on one line, "
            "or state the tool and register without fitting it"
        )
    count = 6 if poses.rotations is None else 9
    raise IdentifiabilityError(
        f"registration: the {len(poses.p_measured)} poses cannot determine {found.names} "
        f"(rank {found.rank} of {count}, condition number {found.condition:.1e}); {remedy}"
    )


def weak_hint(poses: StationPoses, station: Station, noise_std: float) -> str:
    """Return a hint at directions with a large uncertainty, or an empty text."""
    found = open_directions(poses, station, noise_std, _WEAK)
    if not found.names:
        return ""
    return f"{found.names}: known only to ±{found.std:.2g} mm; turn the flange more between poses"


def _echelon(null: FloatArray) -> FloatArray:
    """Return the open directions (k, p) in echelon form, so that each has few parameters: tool, then rotation."""
    null = null.copy()
    order = [6, 7, 8, 3, 4, 5, 0, 1, 2] if null.shape[1] == 9 else [3, 4, 5, 0, 1, 2]
    done = 0
    for group in (order[i : i + 3] for i in range(0, len(order), 3)):
        for _ in range(3):
            if done == len(null):
                break
            rest = np.abs(null[done:][:, group])
            row, column = divmod(int(np.argmax(rest)), rest.shape[1])
            if rest[row, column] < 1e-3:
                break
            null[[done, done + row]] = null[[done + row, done]]
            pivot = group[column]
            null[done] /= null[done, pivot]
            others = np.arange(len(null)) != done
            null[others] -= null[others, pivot, None] * null[done]
            done += 1
    return null


def _named(vector: FloatArray, names: tuple[str, ...]) -> str:
    large = [name for name, weight in zip(names, np.abs(vector), strict=True) if weight > 0.2 * np.abs(vector).max()]
    return " with ".join(reversed(large))
