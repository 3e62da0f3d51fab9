"""Similarity in words, for a reader who does not know geostatistics; and what kinematics explains of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.errors import RobotError
from truepose.report.locale import Locale
from truepose.similarity import (
    ExperimentalVariogram,
    LikelihoodFit,
    VariogramModel,
    experimental_variogram,
    model_based_variogram,
)

if TYPE_CHECKING:
    from truepose.error_map import ErrorMap
    from truepose.report.study import StudyPart


TYPICAL_MM: Final = 0.3
TYPICAL_RAD: Final = 3e-4
"""Typical errors of the parameters of an arm (docs/virtual-cell.md); only their ratio matters here."""

DIRECTIONAL: Final = 1.5
"""Ranges that differ by less than this factor are told as equal."""


@dataclass(frozen=True, eq=False)
class Explained:
    """What errors of the kinematic parameters explain.

    Attributes
    ----------
    share : float
        Of the sum of squared errors, taken away by a least-squares fit of the parameters, less chance.
    rank : int
        Parameters that the samples can tell.
    theory : ExperimentalVariogram
        Theory (6) of typical parameter errors, of a size that fits their share: the similarity that they imply.
    residual : ExperimentalVariogram
        Of what the fit leaves.
    """

    share: float
    rank: int
    theory: ExperimentalVariogram
    residual: ExperimentalVariogram


def kinematic_columns(error_map: ErrorMap) -> FloatArray | None:
    """Return the effect of one typical error of each parameter after registration, (n, 3, p) [mm]; nothing without q.

    What registration (and the fit of the tool) would take away is projected out, since errors are told after it.
    """
    robot, q = error_map.robot, error_map.samples.q
    if q is None:
        return None
    fitted = ["base", "tool"] if error_map.tool_fitted else ["base"]
    try:
        J = robot.error_jacobian(q, tool=error_map.tf_flange_tool)
        G = robot.error_jacobian(q, tool=error_map.tf_flange_tool, parameters=fitted)
    except RobotError:  # a chain that has no Denavit-Hartenberg parameters
        return None
    std = [TYPICAL_RAD if name.startswith(("theta", "alpha", "beta")) else TYPICAL_MM for name in robot.parameter_names]
    columns, taken = (J * std).reshape(-1, J.shape[2]), G.reshape(-1, G.shape[2])
    taken = taken / np.maximum(np.linalg.norm(taken, axis=0), 1e-300)
    left = columns - taken @ np.linalg.lstsq(taken, columns, rcond=1e-10)[0]
    return np.asarray(left.reshape(J.shape))


def explained_by_kinematics(
    x: FloatArray, e: FloatArray, effect: FloatArray, edges: FloatArray, measured: ExperimentalVariogram
) -> Explained | None:
    """Return what `kinematic_columns` (n, 3, p) explain of errors e (n, 3); nothing with too few samples."""
    n, c, p = effect.shape
    columns = effect.reshape(n * c, p)
    solution, _, rank, _ = np.linalg.lstsq(columns, e.ravel(), rcond=1e-8)
    if n * c <= 2 * rank:
        return None
    residual = e - (columns @ solution).reshape(n, c)
    left = float((residual**2).sum() / (e**2).sum())
    implied = model_based_variogram(x, effect, np.ones(p), edges)
    weights = measured.pairs / np.maximum(np.nan_to_num(measured.vector), 1e-30) ** 2
    used = measured.pairs > 0
    share = 1 - left * n * c / (n * c - int(rank))
    theory_size = max(share, 0.0) * _ratio(measured.vector[used], implied.vector[used], weights[used])
    theory = ExperimentalVariogram(
        implied.lag,
        theory_size * implied.semivariance,
        theory_size * implied.vector,
        implied.pairs,
        implied.edges,
        implied.repeats,
        implied.repeat_semivariance,
        implied.dimensions,
        "model",
    )
    return Explained(share, int(rank), theory, experimental_variogram(x, residual, edges))


def _ratio(measured: FloatArray, implied: FloatArray, weights: FloatArray) -> float:
    return float((weights * measured) @ implied / ((weights * implied) @ implied))


def findings(part: StudyPart, say: Locale) -> list[tuple[str, str]]:
    """Return questions and answers about one space, in a language."""
    answers = {
        "structure": part.verdict_in(say.words("similarity")),
        "curve": _curve(part.model, part.unit, part.sampled.lag, say),
        "reach": _reach(part, say),
        "noise": _noise(part, say),
        "directions": _directions(part, say),
        "trend": _trend(part, say),
    }
    if part.explained is not None:
        answers["kinematics"] = _kinematics(part, part.explained, say)
    return [(say(f"finding.{question}"), answer) for question, answer in answers.items()]


def _curve(model: VariogramModel, unit: str, lag: float, say: Locale) -> str:
    def told_of(part: VariogramModel) -> str:
        if part.practical_range > lag and part.isotropic:
            reached = float(part.semivariance(lag))
            return say("finding.curve_part_open", family=part.family, semivariance=reached, lag=lag, unit=unit)
        return say("finding.curve_part", family=part.family, sill=part.sill, range=part.practical_range, unit=unit)

    parts = say("finding.list").join(map(told_of, model.structures))
    if not (model.overridden and model.fit is not None):
        return say("finding.curve_fitted", parts=parts or "0")
    told = say("finding.curve_told", nugget=model.nugget, parts=parts or "0")
    found = model.from_dict(model.fit.fitted)
    return told + " " + say("finding.curve_by_hand", nugget=found.nugget, sill=found.sill, range=found.practical_range)


def _reach(part: StudyPart, say: Locale) -> str:
    model = part.likelihood
    fit = model.fit
    assert isinstance(fit, LikelihoodFit)
    if fit.bounds_hit.get("sill") == "lower":
        return say("finding.reach_nowhere")
    found = part.sampled
    if not found.sill:
        return say("finding.reach_beyond", lag=found.lag, unit=part.unit)
    if model.practical_range > found.lag:
        return say("finding.reach_open", lag=found.lag, range=part.model.practical_range, unit=part.unit)
    error = fit.standard_error.get("range", math.nan) * model.practical_range / float(np.max(model.range))
    reach = say.number(model.practical_range, ".3g")
    if not math.isnan(error):
        reach += f" ± {say.number(error, '.2g')}"
    share = 100 * float(model.signal_covariance(model.practical_range / 2)) / model.partial_sill
    return say("finding.reach_told", family=model.family, reach=reach, unit=part.unit, share=share)


def _noise(part: StudyPart, say: Locale) -> str:
    fit, found = part.likelihood.fit, part.sampled
    small = not part.model.overridden and fit is not None and fit.bounds_hit.get("nugget") == "lower"
    return say(
        "finding.noise_small" if small else "finding.noise_told",
        total=math.sqrt(found.variance / part.components),
        noise=math.sqrt(found.nugget / part.components),
        share=100 * found.noise_share,
        lag=found.lag,
        unit=part.unit,
    )


def _directions(part: StudyPart, say: Locale) -> str:
    if part.directional is None:
        return say("finding.directions_flat")
    ranges = part.directional.practical_ranges
    told = say("finding.list").join(
        say("finding.range" if a <= extent else "finding.range_beyond", axis=axis, range=a, unit=part.unit)
        for axis, a, extent in zip(part.axes, ranges, part.extent.tolist(), strict=True)
    )
    if max(ranges) < DIRECTIONAL * min(ranges):
        return say("finding.directions_alike", ranges=told)
    short, long = part.axes[int(np.argmin(ranges))], part.axes[int(np.argmax(ranges))]
    return say("finding.directions_differ", ranges=told, short=short, long=long)


def _trend(part: StudyPart, say: Locale) -> str:
    key = "finding.trend_sill" if part.sampled.sill else "finding.trend_rises"
    return say(key, share=100 * max(part.trend.adjusted, 0.0))


def _kinematics(part: StudyPart, explained: Explained, say: Locale) -> str:
    measured, left = part.envelope.variogram, explained.residual
    used = measured.pairs > 0
    plateau = float(np.average(left.vector[used], weights=measured.pairs[used]))
    whole = float(np.average(measured.vector[used], weights=measured.pairs[used]))
    share = 100 * max(explained.share, 0.0)
    return say("finding.kinematics_told", rank=explained.rank, share=share, left=100 * plateau / whole)
