"""The choice among predictors: ranking, nested loop, workers, failures."""

import multiprocessing

import numpy as np
import pytest

import truepose as tp
from truepose.errors import DataError
from truepose.predictors import Arm, Errors, choose
from truepose.predictors.ranking import HeldOut, difference_intervals, figures, take

PLAIN = ("registration", "idw", "ordinary-kriging")


@pytest.fixture(scope="module")
def virtual():
    return tp.VirtualCell("paper", seed=101)


@pytest.fixture(scope="module")
def samples(virtual):
    return virtual.measure(virtual.design(60, seed=1), seed=1)


@pytest.fixture
def errors(rng):
    """A smooth field, and noise."""
    x = rng.uniform(0, 1000, (80, 3))
    return Errors({"cartesian": x}, np.sin(x / 400) + rng.normal(scale=0.02, size=x.shape))


def test_what_is_left_is_told_by_the_outer_loop(virtual, samples):
    choice = tp.choose([*PLAIN, "calibration"], samples, virtual.cell)
    assert [row["predictor"] for row in choice.ranking] == ["calibration", "ordinary-kriging", "idw", "registration"]
    assert choice.expected["chosen"] == {"calibration": 10}
    assert choice.expected["mean_mm"] == choice.ranking[0]["mean_mm"]  # the same candidate in every fold
    test = virtual.measure(virtual.design(200, seed=2), seed=2)
    errors = tp.fit_cell(virtual.cell, samples, "calibration").validate(test)
    low, high = choice.expected["mean_interval_mm"]
    assert low < errors["after"]["mean_mm"] < high
    assert not choice.ranking[1]["level"]
    low, high = choice.ranking[1]["worse_by_interval_mm"]
    assert 0 < low < choice.ranking[1]["worse_by_mm"] < high


def test_outer_loop_pays_for_choosing(rng):
    """Many candidates that are all alike on noise: the best of them looks better than what choosing leaves."""
    x = rng.uniform(0, 1000, (40, 3))
    noise = Errors({"cartesian": x}, rng.normal(size=x.shape))
    choice = choose(noise, ["registration", "idw", "nearest", "grid-cell", "radial-basis", "ordinary-kriging"])
    assert choice.expected["mean_mm"] >= min(row["mean_mm"] for row in choice.ranking)
    assert choice.ranking[0]["predictor"] in ("registration", "ordinary-kriging")  # a constant; nothing to learn


def test_workers_change_nothing(virtual, samples):
    candidates = ("registration", "ordinary-kriging-joint", "kinematic-kriging-no-rest", "calibration-network")
    samples = samples[:24]  # with a fold left out too few for networks
    lines = []
    one = tp.choose(candidates, samples, virtual.cell, folds=3)
    two = tp.choose(candidates, samples, virtual.cell, folds=3, workers=2, progress=lines.append)
    assert one.ranking == two.ranking
    assert "16 samples are too few for networks" in two.ranking[-1]["note"]
    assert one.expected == two.expected
    np.testing.assert_array_equal(one.predictor.predict(samples.q), two.predictor.predict(samples.q))
    assert sum(line.startswith("Cross-validation: ") for line in lines) == 24
    assert any(line.startswith("Cross-validation: 24 of 24 fits") for line in lines)


def test_a_candidate_that_fails_says_why(errors):
    joints = Errors({**errors.coordinates, "joint": np.zeros((80, 6))}, errors.e)
    choice = choose(joints, ["idw", "calibration-network"], splits=["points"])  # passed over: no arm is known
    assert [row["predictor"] for row in choice.ranking] == ["idw"]
    few = Errors({"cartesian": errors.coordinates["cartesian"][:6], "joint": np.zeros((6, 6))}, errors.e[:6], arm=ARM)
    choice = choose(few, ["registration", "kinematic-kriging"], folds=2)
    assert choice.ranking[-1]["predictor"] == "kinematic-kriging"
    assert "3 samples are too few for kinematic Kriging" in choice.ranking[-1]["note"]
    with pytest.raises(DataError, match=r"no candidate could be fitted; kinematic-kriging failed: 3 samples are"):
        choose(few, ["kinematic-kriging"], folds=2)


ARM = Arm(tp.load_robot("kuka-kr150-2"), np.eye(4))


def test_a_child_that_dies_is_an_error(errors):
    with pytest.raises(DataError, match="one of 2 worker processes died"):
        choose(Deadly({"cartesian": errors.coordinates["cartesian"]}, errors.e), ["idw"], workers=2)


class Deadly(Errors):
    def registered_by(self, rows):
        import os
        from multiprocessing import parent_process

        if parent_process() is not None:
            os._exit(3)
        return self


def test_gross_readings_do_not_decide(errors):
    e = errors.e.copy()
    e[[5, 40]] += 30.0
    choice = choose(Errors(errors.coordinates, e), PLAIN)
    clean = choose(errors, PLAIN)
    assert choice.predictor_name == clean.predictor_name == "ordinary-kriging"
    assert np.flatnonzero(choice.gross).tolist() == [5, 40]
    assert choice.expected["mean_mm"] == pytest.approx(clean.expected["mean_mm"], rel=0.2)


@pytest.mark.parametrize(
    ("candidates", "options", "message"),
    [
        (["idw", "krigin"], {}, "no predictor 'krigin'"),
        ("some", {}, 'expected "quick", "all" or a list'),
        (["calibration"], {}, "none of calibration can be fitted without joints or the arm"),
        (["idw"], {"splits": ["cubes"]}, "expected one or more of points, blocks, branches"),
        (["idw"], {"splits": ["branches"]}, 'split "branches" needs the robot and joints'),
        (["idw"], {"folds": 81}, "81 folds of 80 samples"),
    ],
)
def test_what_cannot_be(errors, candidates, options, message):
    with pytest.raises(DataError, match=message):
        choose(errors, candidates, **options)


def test_without_a_cell_positions_are_enough(samples):
    bare = tp.Samples(samples.p_meas, p_cmd=samples.p_cmd, q=samples.q)
    choice = tp.choose("quick", bare, splits=["points"])
    assert choice.predictor_name.startswith(("ordinary", "universal"))
    with pytest.raises(DataError, match="joints alone are no positions without the arm; give cell"):
        tp.choose("quick", tp.Samples(samples.p_meas, q=samples.q))


@pytest.fixture
def held_out(rng):
    """The second is better by far, the third as good, but far too sure."""
    std = np.array([1.0, 0.2, 0.2])[:, None, None, None] * np.ones((3, 2, 200, 3))
    residual = std * rng.normal(size=std.shape)
    std[2] /= 3
    return HeldOut(("a", "b", "c"), ("points", "blocks"), residual, std)


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_of_level_candidates_the_honest_one_is_taken(held_out, factor):
    held_out.residual[2] *= factor * held_out.length[1].mean() / held_out.length[2].mean()
    worse = difference_intervals(held_out, 1)
    assert worse[0, 0] > 1.0
    assert worse[2, 0] < 0 < worse[2, 1]
    assert take(held_out) == 1


def test_what_is_clearly_better_is_taken_though_it_is_too_sure(held_out):
    held_out.residual[2] *= 0.8
    assert take(held_out) == 2


def test_figures(held_out):
    found = figures(held_out.residual[1], held_out.std[1], held_out.splits)
    assert found["within_95"] == pytest.approx(0.95, abs=0.02)
    expected = 0.2 * np.sqrt(8 / np.pi)  # mean length of a normal vector
    assert found["mean_mm"] == pytest.approx(expected, rel=0.05)
    assert found["mean_interval_mm"][0] < found["mean_mm"] < found["mean_interval_mm"][1]
    assert set(found["splits"]) == {"points", "blocks"}


def test_an_interrupt_ends_the_workers(errors):
    def interrupt(line):
        raise KeyboardInterrupt

    others = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt):
        choose(errors, ["registration"], workers=2, progress=interrupt)
    for process in set(multiprocessing.active_children()) - others:
        process.join(timeout=20)
        assert not process.is_alive()
