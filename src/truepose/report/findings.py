"""The findings of a similarity study in words, for a reader who does not know geostatistics."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from truepose.report.explained import Explained
from truepose.report.locale import Locale, load_locale
from truepose.report.study import SimilarityStudy, StudyPart
from truepose.similarity import LikelihoodFit, VariogramModel, verdict

DIRECTIONAL: Final = 1.5
"""Ranges that differ by less than this factor are described as similar."""


def study_to_dict(study: SimilarityStudy) -> dict[str, Any]:
    """Return the figures of a study and its findings in English as plain values, for JSON."""
    parts = [part_to_dict(part, load_locale("en")) for part in study.parts]
    joints = {"joints": [joint.to_dict() for joint in study.joints]} if study.joints else {}
    return {"variograms": parts, **joints}


def part_to_dict(part: StudyPart, say: Locale) -> dict[str, Any]:
    """Return the figures of one space and its findings as plain values."""
    return {
        "title": title(part, say),
        **part.to_dict(),
        "findings": dict(findings(part, say)),
        "verdict": structure_verdict(part, say),
    }


def title(part: StudyPart, say: Locale) -> str:
    """Return the title of the picture of one space."""
    return say(f"space.{part.space}")


def structure_verdict(part: StudyPart, say: Locale) -> str:
    """Return a sentence on whether there is similarity, how far it reaches and how much of the variance is noise."""
    return verdict(part.model, part.envelope, part.unit, nugget=part.nugget, words=say.words("similarity"))


def findings(part: StudyPart, say: Locale) -> list[tuple[str, str]]:
    """Return the usual questions about the similarity in one space, each with its answer."""
    chance = part.envelope.by_chance or part.model.sill == 0
    answers = {
        "structure": structure_verdict(part, say),
        "curve": _curve(part.model, part.unit, part.sampled.lag, say),
        "reach": say("finding.chance") if chance else _reach(part, say),
        "noise": _noise(part, chance, say),
        "directions": say("finding.chance") if chance else _directions(part, say),
        "trend": _trend(part, say),
    }
    if part.explained is not None:
        answers["kinematics"] = _kinematics(part, part.explained, say)
    return [(say(f"finding.{question}"), answer) for question, answer in answers.items()]


def _curve(model: VariogramModel, unit: str, lag: float, say: Locale) -> str:
    def describe(part: VariogramModel) -> str:
        if part.practical_range > lag and part.isotropic:
            reached = float(part.semivariance(lag))
            return say("finding.curve_part_open", family=part.family, semivariance=reached, lag=lag, unit=unit)
        return say("finding.curve_part", family=part.family, sill=part.sill, range=part.practical_range, unit=unit)

    parts = say("finding.list").join(map(describe, model.structures))
    if not (model.overridden and model.fit is not None):
        return say("finding.curve_fitted", parts=parts) if parts else say("finding.curve_flat", nugget=model.nugget)
    curve = say("finding.curve_text", nugget=model.nugget, parts=parts or "0")
    found = model.from_dict(model.fit.fitted)
    return curve + " " + say("finding.curve_by_hand", nugget=found.nugget, sill=found.sill, range=found.practical_range)


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
    return say("finding.reach_text", family=model.family, reach=reach, unit=part.unit, share=share)


def _noise(part: StudyPart, chance: bool, say: Locale) -> str:
    fit, found = part.likelihood.fit, part.sampled
    if chance:
        total = math.sqrt(found.variance / part.components)
        return say("finding.noise_chance", total=total, lag=found.lag, unit=part.unit)
    small = not part.model.overridden and fit is not None and fit.bounds_hit.get("nugget") == "lower"
    return say(
        "finding.noise_small" if small else "finding.noise_text",
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
    if all(a > extent for a, extent in zip(ranges, part.extent.tolist(), strict=True)):
        return say("finding.directions_beyond")
    listed = say("finding.list").join(
        say("finding.range" if a <= extent else "finding.range_beyond", axis=axis, range=a, unit=part.unit)
        for axis, a, extent in zip(part.axes, ranges, part.extent.tolist(), strict=True)
    )
    if max(ranges) < DIRECTIONAL * min(ranges):
        return say("finding.directions_alike", ranges=listed)
    short, long = part.axes[int(np.argmin(ranges))], part.axes[int(np.argmax(ranges))]
    return say("finding.directions_differ", ranges=listed, short=short, long=long)


def _trend(part: StudyPart, say: Locale) -> str:
    key = "finding.trend_sill" if part.sampled.sill else "finding.trend_rises"
    return say(key, share=100 * max(part.trend.adjusted, 0.0))


def _kinematics(part: StudyPart, explained: Explained, say: Locale) -> str:
    measured, left = part.envelope.variogram, explained.residual
    used = measured.pairs > 0
    plateau = float(np.average(left.vector[used], weights=measured.pairs[used]))
    whole = float(np.average(measured.vector[used], weights=measured.pairs[used]))
    share = 100 * max(explained.share, 0.0)
    return say("finding.kinematics_text", rank=explained.rank, share=share, left=100 * plateau / whole)
