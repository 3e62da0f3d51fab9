"""Points are named in messages, and readings match the plan by name."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.samples import Poses, name_points
from truepose.trackers import Readings, match
from truepose.trackers.by_name import BY_NAME


@pytest.fixture
def plan(rng: np.random.Generator) -> Poses:
    names = np.array([f"P{k}" for k in range(1, 31)])
    return Poses(p_cmd=rng.uniform(-600, 600, (30, 3)), name=names, line=np.arange(2, 32), source="plan.csv")


def measured(plan: Poses, rng: np.random.Generator, order: FloatArray | None = None) -> Readings:
    assert plan.p_cmd is not None
    assert plan.name is not None
    p = plan.p_cmd[:, [1, 2, 0]] + 2500.0 + rng.normal(scale=0.2, size=(30, 3))
    places = np.arange(30) if order is None else order.astype(int)
    return Readings(p=p[places], line=np.arange(1, 31), source="r.txt", name=plan.name[places])


def test_a_shuffled_file_is_matched_by_name(plan: Poses, rng: np.random.Generator) -> None:
    order = rng.permutation(30)
    readings = measured(plan, rng, order)
    assert readings.name is not None
    for names in (readings.name, np.array([f"Station1::Main::{name.lower()}" for name in readings.name])):
        samples, summary = match(replace(readings, name=names), plan)
        np.testing.assert_array_equal(samples.p_meas[order], readings.p)
        assert summary.reordered == ()
        assert BY_NAME in summary.sentences()
        assert samples.line is not None
        assert samples.line[order].tolist() == list(range(1, 31))


def test_a_missing_point_is_named_with_its_line_and_the_option(plan: Poses, rng: np.random.Generator) -> None:
    readings = measured(plan, rng)[np.delete(np.arange(30), 11)]
    with pytest.raises(DataError, match=r"without a reading: point P12 \(line 13\) of plan\.csv; .* with --missing"):
        match(readings, plan)
    unnamed = replace(readings, name=None)
    with pytest.raises(DataError, match=r"point P12 \(line 13\) of plan\.csv"):
        match(unnamed, plan)
    _, summary = match(readings, plan, missing=True)
    assert summary.missing == (11,)
    assert summary.missing_points == ("P12 (line 13)",)
    assert "Points of the plan without a reading, left out: P12 (line 13)." in summary.sentences()


def test_numbers_that_the_tracker_gave_are_no_names(plan: Poses, rng: np.random.Generator) -> None:
    readings = measured(plan, rng)
    assert readings.name is not None
    shifted = replace(readings[np.delete(np.arange(30), 11)], name=readings.name[:29])
    _, summary = match(shifted, plan, missing=True)
    assert summary.missing_points == ("P12 (line 13)",)
    assert any("do not agree with the plan's positions" in sentence for sentence in summary.notes)


def test_one_name_for_two_points(plan: Poses, rng: np.random.Generator) -> None:
    readings = measured(plan, rng)
    assert readings.name is not None
    twice = readings.name.copy()
    twice[7] = "P3"
    message = r"one name for several readings, .* mm apart: points P3 \(line 3\), P3 \(line 8\); correct .* line 8"
    with pytest.raises(DataError, match=message):
        match(replace(readings, name=twice), plan)


def test_a_name_twice_in_the_plan(plan: Poses, rng: np.random.Generator) -> None:
    assert plan.name is not None
    readings = measured(plan, rng)
    names = plan.name.copy()
    names[7] = "P3"
    _, summary = match(readings, replace(plan, name=names))
    sentence = "The plan repeats a name (points P3 (line 4), P3 (line 9)), so readings were matched by their positions."
    assert sentence in summary.notes


def test_repeats_of_one_name_are_averaged(plan: Poses, rng: np.random.Generator) -> None:
    order = np.append(rng.permutation(30), [4, 4])
    _, summary = match(replace(measured(plan, rng, order), line=np.arange(1, 33)), plan)
    assert (summary.averaged, summary.samples) == (2, 30)


def test_a_reading_of_no_point(plan: Poses, rng: np.random.Generator) -> None:
    readings = measured(plan, rng)
    assert readings.name is not None
    names = np.array([*readings.name[:29], "REF1"])
    with pytest.raises(DataError, match=r"point REF1 \(line 30\) fits no point of the plan; remove"):
        match(replace(readings, name=names), plan, missing=True)


def test_names_of_the_readings_name_samples_of_an_unnamed_plan(plan: Poses, rng: np.random.Generator) -> None:
    samples, _ = match(measured(plan, rng), replace(plan, name=None))
    assert samples.rows(np.array([11])) == "point P12 (line 12)"


def test_point_is_a_name_and_lines_are_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("# plan\nPoint;q1_deg;q2_deg\nA1;10;20\n\nA2;11;21\n")
    poses = tp.read_poses(path)
    assert poses.rows(np.array([0, 1])) == "points A1 (line 3), A2 (line 5)"
    assert poses.identify(1) == {"row": 1, "point": "A2", "line": 5}


def test_the_plan_of_a_controller_has_lines(tmp_path: Path) -> None:
    path = tmp_path / "targets.mod"
    target = "CONST jointtarget {} := [[10,20,30,40,{},60],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    path.write_text("MODULE m\n" + "".join(target.format(f"j{k}", k) for k in range(3)) + "ENDMODULE\n")
    from truepose.trackers import read_plan

    assert read_plan(path).rows(np.array([2])) == "point j2 (line 4)"


def test_many_points_are_counted() -> None:
    known = [{"row": k, "point": None, "line": k + 2} for k in range(9)]
    assert name_points(known) == "lines 2, 3, 4, 5, 6, 7 and 3 more"
    assert re.fullmatch(r"points A, B", name_points([{"point": "A"}, {"point": "B"}]))


def test_swapped_names_are_found(plan: Poses, rng: np.random.Generator) -> None:
    readings = measured(plan, rng)
    assert readings.name is not None
    names = readings.name.copy()
    names[[4, 19]] = names[[19, 4]]
    _, summary = match(replace(readings, name=names), plan)
    sentence = "The names of points P5 (line 20), P20 (line 5) of r.txt seem to be swapped."
    assert sentence in summary.sentences()
    gross = replace(readings, p=readings.p + np.where(np.arange(30) == 7, 40.0, 0.0)[:, None])
    assert not any("swapped" in line for line in match(gross, plan)[1].sentences())


def test_one_repeat_is_one_reading(plan: Poses, rng: np.random.Generator) -> None:
    readings = measured(plan, rng)[np.array([*range(30), 11])]
    assert "1 reading repeats another and was averaged with it" in " ".join(match(readings, plan)[1].sentences())
