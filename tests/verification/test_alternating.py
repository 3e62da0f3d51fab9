"""Two populations of readings that alternate: reflectors on the tool, or trackers, used in turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import truepose as tp
from truepose.error_map.campaign import check_campaign
from truepose.error_map.selection import CellSamples
from truepose.errors import DataError

N = 60


def second(how: str, seed: int) -> np.ndarray:
    """Return which readings are of the second population."""
    if how == "in turn":
        return np.arange(N) % 2 > 0
    if how == "every third":
        return np.arange(N) % 3 == 1
    return np.random.default_rng(seed).random(N) < {"irregular": 0.5, "a few": 0.2}[how]


def measured(frame: str, how: str, seed: int, size: float = 0.5, kind: str = "hard"):
    """Return a cell, its samples with two populations `size` mm apart in a frame, and which are of the second."""
    virtual = tp.VirtualCell(kind, seed=seed)
    samples = virtual.measure(virtual.design(N, seed=seed), seed=seed)
    away = np.random.default_rng(seed).normal(size=3)
    away *= size / np.linalg.norm(away)
    off = virtual.robot.forward(samples.q)[:, :3, :3] @ away if frame == "flange" else np.tile(away, (N, 1))
    other = second(how, seed)
    turned = off @ virtual.truth.tf_base_tracker[:3, :3]
    return virtual, replace(samples, p_meas=samples.p_meas + other[:, None] * turned), other


def checked(virtual: tp.VirtualCell, samples: tp.Samples):
    cell = CellSamples(virtual.cell, virtual.robot, samples)
    return check_campaign(virtual.cell, virtual.robot, samples, *cell.register())


@pytest.mark.promise("two reflectors or trackers that were used in turn are found, with their readings")
@pytest.mark.parametrize(
    ("frame", "how"),
    [
        ("flange", "in turn"),
        ("base", "irregular"),
        *(
            pytest.param(frame, how, marks=pytest.mark.exhaustive)
            for frame in ("flange", "base")
            for how in ("in turn", "irregular", "every third", "a few")
            if (frame, how) not in (("flange", "in turn"), ("base", "irregular"))
        ),
    ],
)
def test_two_populations_are_found_with_size_and_rows(frame: str, how: str, record_property) -> None:
    record_property("cases", 1)
    virtual, samples, other = measured(frame, how, seed=1)
    found = checked(virtual, samples)
    assert [change.kind for change in found.changes] == ["alternating"]
    change = found.changes[0]
    assert change.shift == pytest.approx(0.5, abs=0.1)
    smaller = np.flatnonzero(other if other.mean() <= 0.5 else ~other)
    larger = np.setdiff1d(np.arange(N), smaller)
    best = min((np.setxor1d(change.members, samples.row[rows]) for rows in (smaller, larger)), key=len)
    assert len(best) <= 3
    m = len(change.members)
    assert f" mm apart in the frame of the {change.frame}, {m} against {N - m}: two " in found.words[0]
    assert found.to_dict()["faults"][0]["members"] == list(change.members)


def test_a_fit_of_two_populations_is_refused_and_where_accepted_it_is_a_fact_that_widens() -> None:
    virtual, samples, _ = measured("flange", "in turn", seed=2)
    with pytest.raises(
        DataError, match=r"two populations 0\.\d+ ± .*probably used in turn.*column reflector.*--accept"
    ):
        tp.fit_cell(virtual.cell, samples, "kinematic-kriging")
    found = tp.fit_cell(virtual.cell, samples, "kinematic-kriging", accept_campaign=True)
    fact = next(fact for fact in found.facts if fact.code == "alternating")
    assert fact.effect == "widens"
    assert fact.size == pytest.approx(0.25, abs=0.06)
    assert np.sqrt(found.unexplained.min()) > fact.size


@pytest.mark.parametrize(
    ("kind", "seeds"),
    [
        ("hard", range(2)),
        *(
            pytest.param(kind, range(10), marks=pytest.mark.exhaustive)
            for kind in ("paper", "hard", "heavy-tails", "rounding", "joint-step", "pedestal", "backlash", "ripple")
        ),
    ],
)
def test_sound_campaigns_have_one_population(kind: str, seeds: range) -> None:
    for seed in seeds:
        virtual = tp.VirtualCell(kind, seed=seed)
        found = checked(virtual, virtual.measure(virtual.design(N, seed=seed), seed=seed))
        assert "alternating" not in [change.kind for change in found.changes], (kind, seed)


@pytest.mark.parametrize("apart", [0.0, 0.5])
def test_several_payloads_are_no_populations_and_hide_none(apart: float) -> None:
    virtual = tp.VirtualCell("hard", seed=3)
    payload = np.random.default_rng(3).choice([0.0, 0.5, 1.0], N) * virtual.preset.payload_kg
    samples = virtual.measure(virtual.design(N, seed=3), seed=3, payload_kg=payload)
    other = second("irregular", 7)
    off = virtual.robot.forward(samples.q)[:, :3, :3] @ [apart, 0.0, 0.0] @ virtual.truth.tf_base_tracker[:3, :3]
    found = checked(virtual, replace(samples, p_meas=samples.p_meas + other[:, None] * off))
    assert [change.kind for change in found.changes] == ["alternating"] * (apart > 0.0)


def test_a_single_gross_reading_is_no_population() -> None:
    virtual = tp.VirtualCell("hard", seed=4)
    samples = virtual.measure(virtual.design(N, seed=4), seed=4)
    p_meas = samples.p_meas.copy()
    p_meas[[7, 30]] += [20.0, -5.0, 3.0]
    assert "alternating" not in [change.kind for change in checked(virtual, replace(samples, p_meas=p_meas)).changes]
