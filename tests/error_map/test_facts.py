"""Facts of a map: one list with effects, in the map, its file, its figures and the documentation."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.error_map.facts import CODES, Fact, refuse
from truepose.error_map.figures import fit_figures
from truepose.errors import DataError, RefusedError

PAGE = Path(__file__).parents[2] / "docs" / "facts.md"


@pytest.fixture(scope="module")
def error_map() -> tp.ErrorMap:
    virtual = tp.VirtualCell("paper", seed=2)
    return tp.fit_cell(virtual.cell, virtual.measure(virtual.design(30)), "ordinary-kriging")


def test_the_page_lists_every_code_with_its_effect_and_meaning() -> None:
    rows = re.findall(r"^\| `([a-z-]+)` \| (\w+) \| (.+) \|$", PAGE.read_text("utf-8"), re.M)
    assert {code: (effect, meaning) for code, effect, meaning in rows} == {
        code: (kind.effect, kind.meaning) for code, kind in CODES.items()
    }


@pytest.mark.parametrize("code", CODES)
def test_a_stated_fact_is_kept_shown_and_has_its_effect(error_map: tp.ErrorMap, tmp_path: Path, code: str) -> None:
    fact = Fact(code, "something was found", "update", 1.5, 0.1, "mm")
    error_map.changed(stated=(fact,)).save(tmp_path / "map.truepose")
    read = tp.load_map(tmp_path / "map.truepose")
    assert read.stated == (fact,)
    assert fact in read.facts
    assert fact.to_dict() in fit_figures(read)["facts"]
    target = read.robot.forward(read.samples.q[:1], tool=read.tf_flange_tool)
    if CODES[code].effect == "refuses":
        with pytest.raises(RefusedError, match=r"something was found; .*or accept it with --accept"):
            read.correct(target)
        accepted = {"accept": {code}} if code not in ("weak", "constant-std") else {"accept_weak_map": True}
        assert len(read.correct(target, **accepted).verdict) == 1
    else:
        assert len(read.correct(target).verdict) == 1


def test_only_facts_that_refuse_are_accepted() -> None:
    for code in [code for code, kind in CODES.items() if kind.effect != "refuses"] + ["nonsense"]:
        with pytest.raises(DataError, match=f"'{code}' cannot be accepted; expected one of"):
            refuse([], {code})
    with pytest.raises(DataError, match="'nonsense' is not the code of a fact"):
        Fact("nonsense", "")
    with pytest.raises(DataError, match="size that is not a finite number"):
        Fact("scale", "", size=float("nan"))


@pytest.mark.parametrize("kind", ["moved", "drift", "scale", "reference", "alternating"])
def test_a_fault_of_the_campaign_widens_predictions_and_corrections_alike(error_map: tp.ErrorMap, kind: str) -> None:
    fault = {
        **dict.fromkeys(("shift", "shift_std", "turn", "turn_std", "scale", "scale_std"), 0.0),
        "kind": kind,
        "size": 0.3,
        "size_std": 0.02,
        "rows": [0, 29],
        "ends": [],
        "points": 0,
        "words": "a fault",
    }
    faulty = error_map.changed(campaign={**error_map.campaign, "faults": [{**fault, "stops": True}]})
    assert [fact.size for fact in faulty.facts if fact.code == kind] == [0.3]
    poses = replace(error_map.samples[:4], p_cmd=None, rotation_cmd=None)
    tf = error_map.robot.forward(poses.q, tool=error_map.tf_flange_tool)
    for std in (lambda one: one.predict(poses.q).std, lambda one: one.correct(tf, accept_weak_map=True).std):
        grown = np.sqrt(std(faulty) ** 2 - std(error_map) ** 2)
        np.testing.assert_allclose(grown, 2.0 * 0.3 / np.sqrt(3.0), rtol=0.05)


def test_each_fact_that_refuses_says_how_it_is_accepted() -> None:
    found = [Fact("weak", "it is weak"), Fact("joint-zero", "joint 2 is off"), Fact("joint-zero", "joint 3 is off")]
    with pytest.raises(RefusedError) as caught:
        refuse(found, ())
    words = str(caught.value)
    assert words.startswith("it is weak; measure more samples, try another predictor, or accept it with --accept-weak")
    assert "joint 2 is off; joint 3 is off; " in words
    assert words.count("--accept joint-zero") == 1
    assert refuse(found, {"weak", "joint-zero"}) == [f"accepted: {fact.words}" for fact in found]
