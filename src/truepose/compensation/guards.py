"""Guard corrections: refuse those that the samples do not support, with the reason (theory, compensation)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from truepose._io.tables import by_axis, data_frame, html_table
from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.compensation.joint_coverage import JointCoverage

if TYPE_CHECKING:
    from pandas import DataFrame

Policy = Literal["refuse", "skip", "clip"]
_LEVERAGE_MARGIN: Final = 1.5
_SPACING_MARGIN: Final = 1.5
BELOW: Final = "below uncertainty"
"""The verdict of a target that stays nominal because its correction is too small for its standard deviation."""
TOO_UNCERTAIN: Final = "predicted standard deviation"
"""How the reason of a target begins whose prediction is too uncertain."""
ARM_BRANCH: Final = 0b111
"""Bits 0 to 2 of KUKA's Status, which name the branch (conventions.md)."""


@dataclass(frozen=True)
class Limits:
    """The limits of corrections.

    Attributes
    ----------
    max_std : float [mm]
        The largest length of the predicted standard deviation (sx, sy, sz). It does not depend on the samples, so a bad
        campaign cannot raise it.
    min_correction_stds : float
        The smallest length of a correction as a multiple of the length of its standard deviation. Below it the target
        stays nominal, because the correction could as well move it away: with a probability of Φ(−√3 k/2) at the limit
        k, where the deviation is equal in all directions. This is 4 % for 2, and 19 % for 1.
    max_correction : float [mm]
        The largest length of a correction.
    max_distance : float [mm or rad], optional
        The largest distance to the nearest sample, in the predictor's coordinates. Default: 1.5 times the largest
        distance of a sample to its nearest neighbour.
    max_joint_gap : float [rad], optional
        The largest distance of the angle of a joint to that of a sample. Default: for each joint as
        `truepose.compensation.JointCoverage` finds it.
    max_angle : float [rad]
        The largest rotation between the orientation of a target and the nearest orientation of a sample.
    max_tool : float [mm]
        The largest distance between the tool point of a target and the measured one, for maps of positions only.
    max_rotation : float [rad]
        The largest angle of a correction of orientation.
    max_rotation_std : float [rad]
        The largest length of the predicted standard deviation of orientation, if orientation is corrected.
    """

    max_std: float = 0.25
    min_correction_stds: float = 2.0
    max_correction: float = 5.0
    max_distance: float | None = None
    max_joint_gap: float | None = None
    max_angle: float = float(np.deg2rad(20.0))
    max_tool: float = 50.0
    max_rotation: float = 0.01
    max_rotation_std: float = 0.003


class Region:
    """The sampled region: near a sample, and without extrapolation of a linear trend.

    Parameters
    ----------
    x : (n, d) array
        The samples in the predictor's coordinates: positions [mm] or joints [rad].
    max_distance : float, optional
        The largest distance to a sample, see `Limits`.

    Notes
    -----
    The leverage of x0 is f0ᵀ(FᵀF)⁻¹f0 with the row f = (1, x), the squared Mahalanobis distance of regression. Its
    limit is 1.5 times the largest leverage among the samples.
    """

    def __init__(self, x: FloatArray, max_distance: float | None = None) -> None:
        self._tree = KDTree(x)
        if max_distance is None:
            spacing = _nearest(self._tree, x, k=2)[:, 1] if len(x) > 1 else np.zeros(1)
            max_distance = _SPACING_MARGIN * float(spacing.max())
        self.max_distance = max_distance
        self._mean = x.mean(axis=0)
        # directions that the samples do not span have no trend; the distance guards them
        _, scale, self._axes = np.linalg.svd(x - self._mean, full_matrices=False)
        spanned = scale > scale.max(initial=0.0) * 1e-6
        self._axes, self._scale = self._axes[spanned], scale[spanned]
        self._n = len(x)
        self.max_leverage = _LEVERAGE_MARGIN * float(self.leverage(x).max())

    def leverage(self, x: FloatArray) -> FloatArray:
        """Return the leverage of (m, d) points in a linear trend through the samples, (m,)."""
        scores = (x - self._mean) @ self._axes.T / self._scale
        leverage: FloatArray = 1.0 / self._n + np.einsum("ij,ij->i", scores, scores)
        return leverage

    def distance(self, x: FloatArray) -> FloatArray:
        """Return the distance of (m, d) points to the nearest sample, (m,)."""
        return _nearest(self._tree, x)[:, 0]

    def reasons(self, x: FloatArray, unit: str) -> list[str]:
        """Return the reason why each of (m, d) points is outside, or an empty string; `unit` is the unit of x."""
        distance, leverage = self.distance(x), self.leverage(x)
        reasons = [""] * len(x)
        for i in np.flatnonzero(leverage > self.max_leverage):
            reasons[i] = f"outside the sampled region: leverage {leverage[i]:.2g}, limit {self.max_leverage:.2g}"
        for i in np.flatnonzero(distance > self.max_distance):
            reasons[i] = (
                f"outside the sampled region: nearest sample {distance[i]:.4g} {unit} away, "
                f"limit {self.max_distance:.4g} {unit}"
            )
        return reasons


class Guards:
    """All guards of a map, made once from its samples.

    Parameters
    ----------
    x : (n, d) array
        The samples in the predictor's coordinates: commanded positions [mm] or joints [rad].
    limits : Limits
        The limits of corrections.
    p_flange_tool : (3,) array [mm], flange frame
        The measured point.
    rotation : Rotation of length n, optional
        The orientations of the samples' tool, base frame.
    status : array of int, optional
        The arm branches of the samples (KUKA Status, bits 0 to 2).
    coverage : JointCoverage, optional
        The angles of each joint that samples cover, for predictors that know the error of each joint.
    """

    def __init__(
        self,
        x: FloatArray,
        limits: Limits,
        p_flange_tool: FloatArray,
        rotation: Rotation | None = None,
        status: IntArray | None = None,
        coverage: JointCoverage | None = None,
    ) -> None:
        self.limits = limits
        self._coverage = coverage
        self.region = Region(x, limits.max_distance)
        self._p_flange_tool = p_flange_tool
        self._orientations = None
        if rotation is not None:
            quaternions = rotation.as_quat()
            self._orientations = KDTree(np.concatenate([quaternions, -quaternions]))
        self._status = None if status is None else np.unique(status & ARM_BRANCH)

    def reasons(
        self,
        x: FloatArray,
        unit: str,
        std: FloatArray,
        converged: BoolArray,
        rotation: Rotation | None = None,
        p_flange_tool: FloatArray | None = None,
        status: IntArray | None = None,
    ) -> list[str]:
        """Return the reason why each target must not be corrected, or an empty string.

        Parameters
        ----------
        x : (m, d) array
            The solved commands in the predictor's coordinates.
        unit : str
            The unit of x.
        std : (m, 3) array [mm] or (m, 6) array [mm, rad], base frame
            The predicted standard deviations at the commands.
        converged : (m,) array of bool
            Whether the command was found, see `Solution`.
        rotation : Rotation of length m, optional
            The orientations of the targets, base frame.
        p_flange_tool : (m, 3) array [mm], flange frame, optional
            The tool points of the targets.
        status : (m,) array of int, optional
            The KUKA Status of the targets; −1 if not given.

        Returns
        -------
        list of m str
        """
        reasons = self.region.reasons(x, unit)

        def flag(where: BoolArray, reason: Callable[[int], str]) -> None:
            for i in np.flatnonzero(where).tolist():
                reasons[i] = reasons[i] or reason(i)

        if self._coverage is not None:
            uncovered = self._coverage.reasons(x)
            flag(np.array([bool(reason) for reason in uncovered], bool), lambda i: uncovered[i])
        size, turned, limits = np.linalg.norm(std[:, :3], axis=1), np.linalg.norm(std[:, 3:], axis=1), self.limits
        flag(
            ~(size <= limits.max_std),
            lambda i: f"{TOO_UNCERTAIN} of {size[i]:.3f} mm is above the limit of {limits.max_std:.3f} mm",
        )
        flag(
            ~(turned <= limits.max_rotation_std),
            lambda i: (
                f"predicted standard deviation of orientation of {1e3 * turned[i]:.2f} mrad is above the limit of "
                f"{1e3 * limits.max_rotation_std:g} mrad"
            ),
        )
        flag(~converged, lambda _: "no command was found whose predicted outcome is the target")
        if rotation is not None and self._orientations is not None:
            angle = _angle_of_chord(_nearest(self._orientations, rotation.as_quat())[:, 0])
            limit = f"limit {np.rad2deg(limits.max_angle):.3g}°"
            flag(
                angle > limits.max_angle,
                lambda i: f"orientation is {np.rad2deg(angle[i]):.1f}° from that of any sample, {limit}",
            )
        if p_flange_tool is not None:
            away = np.linalg.norm(p_flange_tool - self._p_flange_tool, axis=1)
            limit_tool = f"limit {limits.max_tool:g} mm: measure with this tool"
            flag(
                away > limits.max_tool,
                lambda i: f"tool point is {away[i]:.1f} mm from the measured one, {limit_tool}",
            )
        if status is not None and self._status is not None:
            branch, measured = status & ARM_BRANCH, self._status
            flag(
                (status >= 0) & ~np.isin(branch, measured),
                lambda i: f"no sample was on arm branch (Status) {branch[i]}, only on {', '.join(map(str, measured))}",
            )
        return reasons


def _nearest(tree: KDTree, x: FloatArray, k: int = 1) -> FloatArray:
    """Return the distances of points (m, d) to their k nearest in the tree, (m, k)."""
    return np.asarray(tree.query(x, k=range(1, k + 1))[0])


def _angle_of_chord(chord: FloatArray) -> FloatArray:
    """Return the angle between orientations from |q ± q'| = 2 sin(angle / 4) of their unit quaternions."""
    angle: FloatArray = 4.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))
    return angle


@dataclass(frozen=True, repr=False)
class Corrections:
    """Commands for targets, each with its verdict.

    Attributes
    ----------
    p_target, p_command : (n, 3) arrays [mm], base frame
        The targets and their commands; both are equal unless the verdict is correct or clip.
    p_mirror : (n, 3) array [mm], base frame
        The one-step commands (15), for comparison.
    e, std : (n, 3) arrays [mm], base frame
        The predicted errors at the commands and their standard deviations; NaN without a prediction.
    verdict : (n,) array of str
        The verdicts: ``correct``, ``clip``, ``skip``, ``refuse`` or ``below uncertainty``.
    reason : list of str
        The reasons of verdicts other than ``correct``; empty for ``correct``.
    rotation : (n, 3) array [rad], base frame, optional
        The rotation vectors of the commands, R_c = exp(rotation) R_t; None if orientation is not corrected.
    rotation_mirror, rotation_std : (n, 3) arrays [rad], base frame, optional
        The rotation vectors of one step (15), and the standard deviations of the predicted orientation errors.
    """

    p_target: FloatArray
    p_command: FloatArray
    p_mirror: FloatArray
    e: FloatArray
    std: FloatArray
    verdict: NDArray[np.str_]
    reason: list[str]
    rotation: FloatArray | None = None
    rotation_mirror: FloatArray | None = None
    rotation_std: FloatArray | None = None

    def __repr__(self) -> str:
        verdicts, counts = np.unique(self.verdict, return_counts=True)
        listed = ", ".join(f"{count} {verdict}" for verdict, count in zip(verdicts, counts, strict=True))
        if not (used := np.isin(self.verdict, ("correct", "clip"))).any():
            return f"<Corrections of {len(self.verdict)} targets: {listed or 'none'}>"
        length = np.linalg.norm(self.correction[used], axis=1)
        return (
            f"<Corrections of {len(self.verdict)} targets: {listed}; lengths have mean {length.mean():.3f} mm, "
            f"max {length.max():.3f} mm>"
        )

    def _repr_html_(self) -> str:
        length = np.linalg.norm(self.correction, axis=1)
        rows = [
            (verdict, int(which.sum()), float(length[which].mean()), float(length[which].max()))
            for verdict, which in ((verdict, self.verdict == verdict) for verdict in np.unique(self.verdict))
        ]
        return html_table(f"Corrections of {len(length)} targets [mm]", ["verdict", "targets", "mean", "max"], rows)

    def to_frame(self) -> DataFrame:
        """Return a pandas table with one row for each target, in mm and mrad; needs pandas."""
        columns: dict[str, Any] = {
            **by_axis(self.p_target, "{}_target_mm"),
            **by_axis(self.p_command, "{}_command_mm"),
            **by_axis(self.e, "{}_error_mm"),
            **by_axis(self.std, "{}_std_mm"),
        }
        if self.rotation is not None:
            columns |= by_axis(1e3 * self.rotation, "r{}_command_mrad")
        return data_frame({**columns, "verdict": self.verdict, "reason": self.reason})

    @property
    def correction(self) -> FloatArray:
        """The displacements of the targets, (n, 3) [mm], base frame."""
        return self.p_command - self.p_target

    @property
    def mirror_miss(self) -> FloatArray:
        """The distances between the commands of (15) and (16), (n,) [mm]; NaN where (16) is not used."""
        miss = np.linalg.norm(self.p_mirror - self.p_command, axis=1)
        return np.where(self.verdict == "correct", miss, np.nan)

    def to_rows(self) -> list[dict[str, Any]]:
        """Return one record per target, with units in the keys."""
        rows = [
            {
                **{f"{axis}_target_mm": self.p_target[i, k] for k, axis in enumerate("xyz")},
                **{f"{axis}_command_mm": self.p_command[i, k] for k, axis in enumerate("xyz")},
                "correction_mm": float(np.linalg.norm(self.correction[i])),
                "std_mm": float(np.linalg.norm(self.std[i])),
                "mirror_miss_mm": float(self.mirror_miss[i]),
                "verdict": str(self.verdict[i]),
                "reason": self.reason[i],
            }
            for i in range(len(self.p_target))
        ]
        if self.rotation is not None and self.rotation_std is not None:
            for row, vector, std in zip(rows, self.rotation, self.rotation_std, strict=True):
                row |= {f"r{axis}_rad": float(vector[k]) for k, axis in enumerate("xyz")}
                row["rotation_std_rad"] = float(np.linalg.norm(std))
        return rows


class Verdicts(NamedTuple):
    """The verdicts of targets; the result of `apply_policy`.

    Attributes
    ----------
    share : (n,) array
        The used share of each correction: 1 for all of it, 0 for none.
    verdict : (n,) array of str
        The verdicts, see `Corrections`.
    reason : list of n str
        The reasons of the guards, and those of too large or too small corrections; empty without one.
    """

    share: FloatArray
    verdict: NDArray[np.str_]
    reason: list[str]


def apply_policy(
    correction: FloatArray, std: FloatArray, reasons: Sequence[str], limits: Limits, policy: Policy
) -> Verdicts:
    """Return the verdict of each target and the share of its correction that is used.

    Under ``refuse`` and ``skip``, a target with a reason keeps its nominal command and gets that verdict. Under
    ``clip``, a correction that is only too long is shortened to the limit; any other reason skips its target. A
    correction without a reason that is below `Limits.min_correction_stds` is not used under any policy; if orientation
    is corrected as well, both parts must be below.

    Parameters
    ----------
    correction, std : (n, 3) arrays [mm] or (n, 6) arrays [mm, rad]
        The corrections and the standard deviations of the predicted errors.
    reasons : sequence of n str
        The reasons of the guards; empty for targets without one. The size of the corrections is checked here.
    limits : Limits
        The limits of corrections.
    policy : {"refuse", "skip", "clip"}
        The treatment of targets with a reason.

    Returns
    -------
    Verdicts
    """
    length, angle = np.linalg.norm(correction[:, :3], axis=1), np.linalg.norm(correction[:, 3:], axis=1)
    excess = np.maximum(length / limits.max_correction, angle / limits.max_rotation)
    reason = list(reasons)
    for i in np.flatnonzero(excess > 1.0):
        what = f"{length[i]:.3f} mm is larger than the limit of {limits.max_correction:g} mm"
        if length[i] <= limits.max_correction:
            what = f"{1e3 * angle[i]:.3f} mrad is larger than the limit of {1e3 * limits.max_rotation:g} mrad"
        reason[i] = reason[i] or f"correction of {what}"
    guarded = np.array([bool(r) for r in reason], dtype=bool)
    verdict = np.where(guarded, "skip" if policy == "clip" else policy, "correct").astype(f"<U{len(BELOW)}")
    share = np.where(guarded, 0.0, 1.0)
    if policy == "clip":
        clipped = (excess > 1.0) & ~np.array([bool(r) for r in reasons], dtype=bool)
        share[clipped] = 1.0 / excess[clipped]
        verdict[clipped] = "clip"
    below = (length < limits.min_correction_stds * np.linalg.norm(std[:, :3], axis=1)) & (verdict == "correct")
    if correction.shape[1] > 3:
        below &= angle < limits.min_correction_stds * np.linalg.norm(std[:, 3:], axis=1)
    share[below], verdict[below] = 0.0, BELOW
    times = "" if limits.min_correction_stds == 1.0 else f"{limits.min_correction_stds:g} times "
    for i in np.flatnonzero(below):
        deviation = f"{times}its standard deviation of {np.linalg.norm(std[i, :3]):.3f} mm"
        reason[i] = f"correction of {length[i]:.3f} mm is smaller than {deviation}"
    return Verdicts(share, verdict, reason)
