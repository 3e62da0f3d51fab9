"""The facts of a map, from what its steps found: see `truepose.error_map.facts`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter

import numpy as np

from truepose.error_map.conditions import models
from truepose.error_map.data import MapData
from truepose.error_map.facts import CODES, Fact
from truepose.error_map.repeatability import Repeatability
from truepose.samples import name_points


def facts_of(error_map: MapData) -> list[Fact]:
    """Return the facts of a map, those that refuse corrections first.

    They are those that a step stated (`MapData.stated`) and those that follow from the other parts of the map.
    """
    found = [
        *error_map.stated,
        *_of_campaign(error_map),
        *_of_arm(error_map),
        *_of_identification(error_map),
        *_of_samples(error_map),
        *_of_value(error_map),
    ]
    order = ("refuses", "transforms", "widens", "told")
    return sorted(found, key=lambda fact: order.index(fact.effect))


def _of_campaign(error_map: MapData) -> Iterator[Fact]:
    campaign = error_map.campaign
    for fault in campaign.get("faults", []):
        yield Fact(fault["kind"], fault["words"], "fit", fault["size"], fault.get("size_std"), "mm")
    if campaign and not campaign.get("tested", True):
        yield Fact("campaign-not-tested", CODES["campaign-not-tested"].meaning, "fit")
    if suspected := campaign.get("suspected_drift_mm", 0.0):
        words = f"a drift of the readings of {suspected:.3f} mm (RMS) is suspected, and too uncertain to be named"
        yield Fact("suspected-drift", words, "fit", suspected, None, "mm")


def _of_arm(error_map: MapData) -> Iterator[Fact]:
    check = error_map.arm_check
    words = check.words.rstrip(".")
    yield Fact("arm-checked" if check.checked else "arm-not-checked", words, "fit", check.residual_mm, None, "mm")
    repeatability = Repeatability.of(error_map.cell, error_map.robot)
    if repeatability.doubt:
        yield Fact("repeatability", repeatability.doubt, "fit", repeatability.stated, None, "mm")
    if error_map.registration.hint:
        yield Fact("registration", error_map.registration.hint, "fit")


def _of_identification(error_map: MapData) -> Iterator[Fact]:
    model = error_map.predictor
    if hint := getattr(getattr(model, "calibration_", model), "hint_", ""):
        yield Fact("identification", hint, "fit")


def _of_samples(error_map: MapData) -> Iterator[Fact]:
    for reason, rows in groupby(error_map.excluded, key=itemgetter("reason")):
        yield Fact("left-out", f"{name_points(list(rows))} left out of the fit: {reason}", "fit")
    approach = error_map.samples.approach
    if approach is not None and approach.any() and (approach == approach[0]).all():
        words = "every joint came from one side at all samples, so its lost motion is not known"
        yield Fact("one-sided", words, "fit")
    if models(error_map.predictor, "payload") and error_map.samples.p_load is None:
        words = (
            "the samples state payloads without their centre of mass (x_load_mm …); it is taken to lie between wrist"
        )
        yield Fact("load-centre", f"{words} and tool point", "fit")


def _of_value(error_map: MapData) -> Iterator[Fact]:
    value = error_map.worth
    if value.weak:
        yield Fact("weak", value.words, "fit", value.left_mm, None, "mm")
    elif not error_map.predictor.has_local_std:
        words = (
            f"{error_map.predictor_name} has one standard deviation for all poses, so no guard can tell where it fails"
        )
        yield Fact("constant-std", words, "fit", float(np.sqrt(np.mean(error_map.predictor.nugget_))), None, "mm")
