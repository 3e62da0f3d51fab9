"""Similarity in the report: one set of figures, of the distances that were sampled."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from truepose.error_map.fit import fit_cell
from truepose.errors import VariogramWarning
from truepose.report.findings import findings
from truepose.report.locale import LOCALES, load_locale
from truepose.report.study import StudyPart, similarity_study
from truepose.simulation import VirtualCell

NO_SILL = {"en": "no sill within the samples", "de": "(keine|ohne) Schwelle", "zh": "没有基台"}


@pytest.fixture(scope="module")
def part() -> StudyPart:
    """Smooth errors of an arm: the fitted sill is far above all that was sampled."""
    virtual = VirtualCell("paper", seed=3)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(100, seed=1)), "registration")
    with warnings.catch_warnings():
        warnings.simplefilter("error", VariogramWarning)
        (part,) = similarity_study(error_map, space="cartesian", family="gaussian").parts
    return part


def told(part: StudyPart, question: str, language: str = "en") -> str:
    say = load_locale(language)
    return dict(findings(part, say))[say(f"finding.{question}")]


@pytest.mark.sampled(1)
@pytest.mark.promise("the report says in each language that there is no sill within the samples")
@pytest.mark.parametrize("language", LOCALES)
def test_no_sill_is_said(part: StudyPart, language: str):
    assert part.model.practical_range > part.sampled.lag
    for question in ("structure", "curve", "reach", "trend"):
        assert re.search(NO_SILL[language], told(part, question, language)), question


@pytest.mark.promise("structure, variance and noise in the report are one set of figures of the sampled distances")
def test_one_set_of_figures(part: StudyPart, record_property: Any):
    record_property("cases", 3)
    structure = float(re.search(r"([\d.]+) % is similarity", told(part, "structure"))[1])  # type: ignore[index]
    total, noise, share = (
        float(re.search(pattern, told(part, "noise"))[1])  # type: ignore[index]
        for pattern in (r"([\d.]+) mm in total", r"([\d.]+) mm by noise", r"^([\d.]+) % of")
    )
    assert structure + share == pytest.approx(100.0, abs=0.5)
    assert 100 * (noise / total) ** 2 == pytest.approx(share, rel=0.15)
    last = part.envelope.variogram.vector[-1]
    assert total == pytest.approx(math.sqrt(last / 3), rel=0.15)
    assert 3 * total**2 < 0.5 * part.model.partial_sill


def test_figures_by_hand_are_those_of_the_curve(part: StudyPart):
    own = replace(part, model=replace(part.model, nugget=0.03, sill=0.27, range=150.0))
    assert own.sampled.noise_share == pytest.approx(0.1, rel=0.01)
    assert "90 % is similarity" in told(own, "structure")
    assert told(own, "noise").startswith("10 % of the variance")
    assert "0.1 mm by noise" in told(own, "noise")
    assert "Set by hand" in told(own, "curve")
    assert np.isfinite(own.sampled.variance)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("language", LOCALES)
def test_what_chance_explains_has_no_reach_no_direction_and_no_share(language):
    """Noise alone: no answer may speak of a reach, directions or a share of noise."""
    virtual = VirtualCell("ideal", seed=5)
    error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(12)), "registration")
    say = load_locale(language)
    parts = similarity_study(error_map).parts
    for part in parts:
        assert part.envelope.by_chance
        assert told(part, "reach", language) == told(part, "directions", language) == say("finding.chance")
        assert "%" not in told(part, "noise", language)
    flat = [told(part, "curve", language) for part in parts if part.model.sill == 0 or not part.model.structures]
    assert flat == [say("finding.curve_flat", nugget=part.model.nugget) for part in parts if not part.model.structures]
    assert flat != []
