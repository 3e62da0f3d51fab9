"""The facts of a map, from what its steps found: see `truepose.error_map.facts`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter

import numpy as np

from truepose.error_map.conditions import conditions_of, models, not_covered
from truepose.error_map.facts import CODES, Fact
from truepose.error_map.judgement import judged
from truepose.error_map.lost_motion import from_other_sides
from truepose.error_map.prediction import PredictingMap
from truepose.error_map.repeatability import Repeatability
from truepose.samples import name_points


def facts_of(error_map: PredictingMap) -> list[Fact]:
    """Return the facts of a map, those that refuse corrections first.

    They are those that a step stated (`truepose.error_map.data.MapData.stated`) and those that follow from the other
    parts of the map.
    """
    found = [
        *error_map.stated,
        *_of_campaign(error_map),
        *_of_arm(error_map),
        *_of_identification(error_map),
        *_of_samples(error_map),
        *_of_work(error_map),
        *_of_value(error_map),
        *judged(error_map),
    ]
    order = ("refuses", "transforms", "widens", "told")
    return sorted(found, key=lambda fact: order.index(fact.effect))


def _of_campaign(error_map: PredictingMap) -> Iterator[Fact]:
    campaign = error_map.campaign
    for fault in campaign.get("faults", []):
        yield Fact(fault["kind"], fault["words"], "fit", fault["size"], fault.get("size_std"), "mm")
    if campaign and not campaign.get("tested", True):
        yield Fact("campaign-not-tested", CODES["campaign-not-tested"].meaning, "fit")
    if suspected := campaign.get("suspected_drift_mm", 0.0):
        words = f"a drift of the readings of {suspected:.3f} mm (RMS) is suspected, and too uncertain to be named"
        yield Fact("suspected-drift", words, "fit", suspected, None, "mm")


def _of_arm(error_map: PredictingMap) -> Iterator[Fact]:
    check = error_map.arm_check
    words = check.words.rstrip(".")
    yield Fact("arm-checked" if check.checked else "arm-not-checked", words, "fit", check.residual_mm, None, "mm")
    repeatability = Repeatability.of(error_map.cell, error_map.robot)
    if repeatability.doubt:
        yield Fact("repeatability", repeatability.doubt, "fit", repeatability.stated, None, "mm")
    if error_map.registration.hint:
        yield Fact("registration", error_map.registration.hint, "fit")


def _of_identification(error_map: PredictingMap) -> Iterator[Fact]:
    model = error_map.predictor
    if hint := getattr(getattr(model, "calibration_", model), "hint_", ""):
        yield Fact("identification", hint, "fit")


def _of_samples(error_map: PredictingMap) -> Iterator[Fact]:
    for reason, rows in groupby(error_map.excluded, key=itemgetter("reason")):
        yield Fact("left-out", f"{name_points(list(rows))} left out of the fit: {reason}", "fit")
    if models(error_map.predictor, "payload") and error_map.samples.p_load is None:
        words = (
            "the samples state payloads without their centre of mass (x_load_mm …); it is taken to lie between wrist"
        )
        yield Fact("load-centre", f"{words} and tool point", "fit")
    yield from _of_sides(error_map)


def _of_sides(error_map: PredictingMap) -> Iterator[Fact]:
    """Yield what the samples do not tell about the lost motion of joints."""
    lost, q = error_map.lost_motion, error_map.samples.q
    if q is None:
        return
    if lost.any():
        other = from_other_sides(
            error_map.robot, lost, q, np.broadcast_to(-np.sign(lost), q.shape), error_map.tf_flange_sampled[:3, 3]
        )
        size = float(np.sqrt(np.mean(np.sum(other[:, :3], axis=1))))
        joints = ", ".join(str(j + 1) for j in np.flatnonzero(lost))
        words = (
            f"joints {joints} came from one side at all samples, so their lost motion is not known: from the other "
            f"side it is taken to be {1e3 * np.abs(lost).max():.2f} mrad each, {size:.2f} mm at the tool; measure "
            "from both sides, as programs of 'truepose plan' do"
        )
        yield Fact("one-sided", words, "fit", size, None, "mm")
    approach = conditions_of(error_map.samples, error_map.cell).get("approach")
    if approach is None or not approach.any():
        words = (
            "the samples do not state from which side the joints came (approach1 …): their lost motion is part of the "
            "noise, or not known"
        )
        yield Fact("sides-not-stated", words, "fit")


def _of_work(error_map: PredictingMap) -> Iterator[Fact]:
    """Yield the conditions at work that the samples do not cover."""
    for name, samples, work, size in not_covered(error_map.predictor, error_map.samples, error_map.cell):
        unit = "K" if name == "temperature" else "kg"
        if work:
            words = f"the {name} at work is {work}, that of the samples {samples}"
            yield Fact("work-not-measured", words, "fit", size, None, unit)
        else:
            key = "temperature_C" if name == "temperature" else "payload_kg"
            words = f"the {name} of the samples is {samples}, and [conditions] {key} does not state it for work"
            yield Fact("work-not-stated", words, "fit", size, None, unit)


def _of_value(error_map: PredictingMap) -> Iterator[Fact]:
    value = error_map.worth
    if value.weak:
        yield Fact("weak", value.words, "fit", value.left_mm, None, "mm")
    elif not error_map.predictor.has_local_std:
        words = (
            f"{error_map.predictor_name} has one standard deviation for all poses, so no guard can tell where it fails"
        )
        yield Fact("constant-std", words, "fit", float(np.sqrt(np.mean(error_map.predictor.nugget_))), None, "mm")
