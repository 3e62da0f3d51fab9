"""A description of a map: parameters, joint errors, noise, uncertainty, and the poses to measure next."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from truepose._typing import FloatArray
from truepose.compensation import Gap
from truepose.error_map import ErrorMap
from truepose.error_map.figures import facts_data, fleet_data
from truepose.predictors import KinematicKriging
from truepose.predictors.abilities import JointlyPredicting, ParameterEstimating
from truepose.predictors.kinematic import JointCurve
from truepose.predictors.kinematic.gears import amplitudes
from truepose.report.evaluated_poses import evaluated_poses
from truepose.samples import Poses


@dataclass(frozen=True, eq=False)
class Knowledge:
    """A description of a map; made by `knowledge`.

    Attributes
    ----------
    error_map : ErrorMap
        The map.
    noise_mm : float
        The standard deviation of a reading about the predicted error field per axis, averaged over the samples.
    std_mm : dict
        The length of the standard deviation of a corrected position (`ErrorMap.predict_errors`) at the evaluated poses:
        mean, 95th percentile, maximum.
    where : str
        Where the evaluated poses are: in the work region of the cell file, between the samples, or at the samples.
    parameters : list of dict
        The drift of kinematic Kriging or the parameters of a calibration, estimate ± std; empty for other predictors.
    curves : list of JointCurve
        The joints' own errors; empty for predictors without them.
    shares_mm : dict
        The RMS length of the contribution of each term to the predictions at the samples.
    hyperparameters : dict
        The settings of the predictor (its `to_dict`), without values of single samples.
    fleet : dict
        What the fit took of the maps of other robots; empty if it got none.
    std_unknown_approach_mm : float, optional
        The mean length of the standard deviation where the direction of approach is not known; None for maps that do
        not know the backlash of joints.
    gaps : list of Gap
        The angles of joints that no sample covers, where corrections are refused; without the angles beyond all samples
        of a joint.
    next_poses : list of dict
        The poses to measure next, the most useful first: joints or position, and the std of a corrected
        position there.
    """

    error_map: ErrorMap
    noise_mm: float
    std_mm: dict[str, float]
    where: str
    parameters: list[dict[str, Any]]
    curves: list[JointCurve]
    shares_mm: dict[str, float]
    hyperparameters: dict[str, Any]
    fleet: dict[str, Any]
    std_unknown_approach_mm: float | None
    gaps: list[Gap]
    next_poses: list[dict[str, Any]]

    @property
    def effects(self) -> list[dict[str, Any]]:
        """The parameters of backlash and expansion, and the amplitudes of the gears' harmonics if the map has them."""
        linear = [row for row in self.parameters if row.get("group") in ("backlash", "expansion")]
        waves = [[row for row in self.parameters if row.get("group") == name] for name in ("backlash shape", "gear")]
        return linear + [row for rows in waves for row in amplitudes(rows)]

    def to_dict(self) -> dict[str, Any]:
        """Return the description as plain values, with units in the names."""
        return {
            "predictor": self.error_map.predictor_name,
            "samples": len(self.error_map.samples),
            "excluded": self.error_map.excluded,
            "noise_mm": self.noise_mm,
            "std_mm": self.std_mm,
            "std_where": self.where,
            "std_unknown_approach_mm": self.std_unknown_approach_mm,
            "shares_mm": self.shares_mm,
            "parameters": self.parameters,
            "joints": [_curve_data(curve) for curve in self.curves],
            "hyperparameters": self.hyperparameters,
            "fleet": self.fleet,
            "joint_gaps": [gap.to_dict() for gap in self.gaps],
            "measure_next": self.next_poses,
            "facts": facts_data(self.error_map),
        }


def knowledge(error_map: ErrorMap, *, suggestions: int = 5, rng: int = 0) -> Knowledge:
    """Return the description of a map.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    suggestions : int
        The number of poses to suggest for measurement.
    rng : int
        The seed of the evaluated poses, from which the suggestions are chosen.
    """
    model = error_map.predictor
    samples = error_map.samples
    candidates, where = evaluated_poses(error_map, np.random.default_rng(rng))
    size = np.linalg.norm(error_map.predict_errors(candidates)[1], axis=1)
    unknown = None
    if candidates.approach is not None:
        unsure = error_map.predict_errors(replace(candidates, approach=np.zeros_like(candidates.approach)))[1]
        unknown = float(np.linalg.norm(unsure, axis=1).mean())
    curves, shares = [], {}
    if isinstance(model, KinematicKriging):
        curves = model.joint_curves()
        parts = model.explain(error_map.inputs(samples))
        shares = {name: float(np.sqrt(np.mean(np.sum(e**2, axis=1)))) for name, e in parts.items()}
    values = {name: value for name, value in model.to_dict().items() if name not in ("weight", "identified", "fleet")}
    return Knowledge(
        error_map,
        noise_mm=float(np.sqrt(np.mean(_about_field(error_map)))),
        std_mm={"mean": float(size.mean()), "p95": float(np.quantile(size, 0.95)), "max": float(size.max())},
        where=where,
        parameters=list(model.parameters_) if isinstance(model, ParameterEstimating) else [],
        curves=curves,
        shares_mm=shares,
        hyperparameters=values,
        fleet=fleet_data(model),
        std_unknown_approach_mm=unknown,
        gaps=[] if error_map.joint_coverage is None else error_map.joint_coverage.gaps(),
        next_poses=_measure_next(error_map, candidates, suggestions),
    )


def _about_field(error_map: ErrorMap) -> FloatArray:
    """Return the variance of readings of the samples about the predictor's field, (n, 3) [mm²]."""
    samples = error_map.samples
    (_, noisy), (_, std) = error_map.predict_reading(samples), error_map.predict_errors(samples)
    return np.asarray(noisy**2 - std**2 + error_map.unexplained)


def _measure_next(error_map: ErrorMap, candidates: Poses, count: int) -> list[dict[str, Any]]:
    """Choose candidates one by one, each with the largest reduction of the variance over all candidates.

    A reading at candidate i with noise R reduces the covariance of all by C_·i (C_ii + R)⁻¹ C_i·. For predictors
    without joint covariance, the most uncertain candidates are chosen.
    """
    predictor = error_map.predictor
    _, std = error_map.predict_errors(candidates)
    size = np.linalg.norm(std, axis=1)
    if not isinstance(predictor, JointlyPredicting) or error_map.p_flange_sampled is not None:
        chosen = np.argsort(-size)[:count].tolist()
        return [_pose_data(candidates, i, size[i]) for i in chosen]
    _, covariance = predictor.predict_together(error_map.inputs(candidates))
    noise = np.mean(_about_field(error_map))
    n, found = len(size), []
    for _ in range(count):
        own = np.einsum("iaib->iab", covariance.reshape(n, 3, n, 3))
        rows = covariance.reshape(n, 3, 3 * n)
        gain = np.linalg.solve(np.linalg.cholesky(own + noise * np.eye(3)), rows)
        best = int(np.argmax(np.einsum("nak,nak->n", gain, gain)))
        found.append(_pose_data(candidates, best, size[best]))
        covariance = covariance - gain[best].T @ gain[best]
    return found


def _pose_data(candidates: Poses, i: int, std: float) -> dict[str, Any]:
    if candidates.q is not None:
        place = {f"q{j + 1}_deg": round(float(angle), 4) for j, angle in enumerate(np.rad2deg(candidates.q[i]))}
    else:
        assert candidates.p_cmd is not None
        place = {f"{axis}_mm": round(float(value), 1) for axis, value in zip("xyz", candidates.p_cmd[i], strict=True)}
    return {**place, "std_mm": float(std)}


def _curve_data(curve: JointCurve) -> dict[str, Any]:
    return {
        "joint": curve.joint + 1,
        "angle_deg": np.rad2deg(curve.angle).tolist(),
        "error_mrad": (1e3 * curve.error).tolist(),
        "std_mrad": (1e3 * curve.std).tolist(),
        "rms_mrad": float(1e3 * np.sqrt(np.mean(curve.error**2))),
    }
