"""The choice among predictors: ranking, nested loop, workers, failures."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from multiprocessing import parent_process
from pathlib import Path

import numba
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import truepose as tp
from truepose.errors import DataError
from truepose.numerics import processes
from truepose.numerics.executor import Serial
from truepose.numerics.threads import blas_threads, threads
from truepose.predictors import (
    ArmContext,
    InverseDistance,
    KinematicKriging,
    OrdinaryKriging,
    PositionalErrors,
    rank_predictors,
)
from truepose.predictors.selection import cross_validation
from truepose.predictors.selection.ranking import (
    CandidateResiduals,
    best_candidate,
    difference_intervals,
    residual_figures,
)

PLAIN = ("registration", "idw", "ordinary-kriging")


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    """Whatever the machine has: two workers are two processes."""
    monkeypatch.setattr(cross_validation, "cores", lambda: 2)
    monkeypatch.setattr(processes, "cores", lambda: 2)


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
    return PositionalErrors({"cartesian": x}, np.sin(x / 400) + rng.normal(scale=0.02, size=x.shape))


@pytest.mark.exhaustive
def test_what_is_left_is_told_by_the_outer_loop(virtual, samples):
    choice = tp.choose([*PLAIN, "calibration"], samples, virtual.cell)
    assert [row["predictor"] for row in choice.ranking] == ["calibration", "ordinary-kriging", "idw", "registration"]
    assert choice.expected["chosen"] == {"calibration": 10}
    assert repr(choice).startswith("<Choice: calibration, fitted to 60 of 60 samples; expected mean residual 0.0")
    assert [line.split()[0] for line in repr(choice).splitlines()[1:]] == [row["predictor"] for row in choice.ranking]
    assert choice.expected["mean_mm"] == choice.ranking[0]["mean_mm"]  # the same candidate in every fold
    test = virtual.measure(virtual.design(200, seed=2), seed=2)
    errors = tp.fit_cell(virtual.cell, samples, "calibration").validate(test)
    low, high = choice.expected["mean_interval_mm"]
    assert low < errors["after"]["mean_mm"] < high
    assert not choice.ranking[1]["level"]
    low, high = choice.ranking[1]["worse_by_interval_mm"]
    assert 0 < low < choice.ranking[1]["worse_by_mm"] < high


@pytest.mark.exhaustive
def test_outer_loop_pays_for_choosing(rng):
    """Many candidates that are all alike on noise: the best of them looks better than what choosing leaves."""
    x = rng.uniform(0, 1000, (40, 3))
    noise = PositionalErrors({"cartesian": x}, rng.normal(size=x.shape))
    choice = rank_predictors(["registration", "idw", "nearest", "grid-cell", "radial-basis", "ordinary-kriging"], noise)
    assert choice.expected["mean_mm"] >= min(row["mean_mm"] for row in choice.ranking)
    assert choice.ranking[0]["predictor"] in ("registration", "ordinary-kriging")  # a constant; nothing to learn


@pytest.mark.exhaustive
def test_workers_change_nothing(virtual, samples):
    candidates = ("registration", "ordinary-kriging-joint", "kinematic-kriging:residual=none", "calibration-network")
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


@pytest.mark.parametrize(("n", "processes"), [(80, 1), (2500, 2)])
def test_processes_are_started_only_where_they_pay(errors, monkeypatch, n, processes):
    used = []

    def executor(workers, purpose):
        used.append(workers)
        return Serial()

    monkeypatch.setattr(cross_validation, "local", executor)
    many = PositionalErrors(
        {"cartesian": np.resize(errors.coordinates["cartesian"], (n, 3))}, np.resize(errors.e, (n, 3))
    )
    rank_predictors(["registration"], many, workers=0, splits=["points"])
    assert used == [processes]


def test_a_candidate_that_fails_says_why(errors):
    joints = PositionalErrors({**errors.coordinates, "joint": np.zeros((80, 6))}, errors.e)
    choice = rank_predictors(["idw", "calibration-network"], joints, splits=["points"])  # passed over: no arm is known
    assert [row["predictor"] for row in choice.ranking] == ["idw"]
    few = PositionalErrors(
        {"cartesian": errors.coordinates["cartesian"][:6], "joint": np.zeros((6, 6))}, errors.e[:6], arm=ARM
    )
    choice = rank_predictors(["registration", "kinematic-kriging"], few, folds=2)
    assert choice.ranking[-1]["predictor"] == "kinematic-kriging"
    assert "3 samples are too few for kinematic Kriging" in choice.ranking[-1]["note"]
    with pytest.raises(DataError, match=r"no candidate could be fitted; kinematic-kriging failed: 3 samples are"):
        rank_predictors(["kinematic-kriging"], few, folds=2)


ARM = ArmContext(tp.load_robot("kuka-kr150-2"), np.eye(4))


@pytest.mark.exhaustive
def test_a_child_that_dies_is_an_error(errors):
    with pytest.raises(DataError, match="one of 2 worker processes died"):
        rank_predictors(["idw"], Deadly({"cartesian": errors.coordinates["cartesian"]}, errors.e), workers=2)


class Deadly(PositionalErrors):
    def registered_by(self, rows):
        import os
        from multiprocessing import parent_process

        if parent_process() is not None:
            os._exit(3)
        return self


@pytest.mark.exhaustive
def test_gross_readings_do_not_decide(errors):
    e = errors.e.copy()
    e[[5, 40]] += 30.0
    choice = rank_predictors(PLAIN, PositionalErrors(errors.coordinates, e))
    clean = rank_predictors(PLAIN, errors)
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
        rank_predictors(candidates, errors, **options)


def test_without_a_cell_positions_are_enough(samples):
    bare = tp.Samples(samples.p_meas, p_cmd=samples.p_cmd, q=samples.q)
    choice = tp.choose("quick", bare, splits=["points"])
    assert choice.predictor_name.startswith(("ordinary", "universal"))
    with pytest.raises(DataError, match="joints without positions need the arm; pass cell"):
        tp.choose("quick", tp.Samples(samples.p_meas, q=samples.q))


@pytest.fixture
def held_out(rng):
    """The second is better by far, the third as good, but far too sure."""
    std = np.array([1.0, 0.2, 0.2])[:, None, None, None] * np.ones((3, 2, 200, 3))
    residual = std * rng.normal(size=std.shape)
    std[2] /= 3
    return CandidateResiduals(("a", "b", "c"), ("points", "blocks"), residual, std)


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_of_level_candidates_the_honest_one_is_taken(held_out, factor):
    held_out.residual[2] *= factor * held_out.length[1].mean() / held_out.length[2].mean()
    worse = difference_intervals(held_out, 1)
    assert worse[0, 0] > 1.0
    assert worse[2, 0] < 0 < worse[2, 1]
    assert best_candidate(held_out) == 1


def test_what_is_clearly_better_is_taken_though_it_is_too_sure(held_out):
    held_out.residual[2] *= 0.8
    assert best_candidate(held_out) == 2


def test_figures(held_out):
    found = residual_figures(held_out.residual[1], held_out.std[1], held_out.splits)
    assert found["within_95"] == pytest.approx(0.95, abs=0.02)
    expected = 0.2 * np.sqrt(8 / np.pi)  # mean length of a normal vector
    assert found["mean_mm"] == pytest.approx(expected, rel=0.05)
    assert found["mean_interval_mm"][0] < found["mean_mm"] < found["mean_interval_mm"][1]
    assert set(found["splits"]) == {"points", "blocks"}


def test_intervals_are_those_of_resampled_means(held_out):
    found = difference_intervals(held_out, 0, rng=5)
    length = held_out.length.mean(axis=1)
    draw, n = np.random.default_rng(5), length.shape[1]
    means = [(length - length[0])[:, draw.integers(0, n, n)].mean(axis=1) for _ in range(1000)]
    np.testing.assert_allclose(found, np.percentile(means, [2.5, 97.5], axis=0).T, atol=1e-14)


@pytest.mark.promise("An interrupt leaves no worker process behind")
def test_an_interrupt_ends_the_workers(errors):
    def interrupt(line):
        started.update(multiprocessing.active_children())
        raise KeyboardInterrupt

    started = set()
    others = set(multiprocessing.active_children())
    with pytest.raises(KeyboardInterrupt):
        rank_predictors(["registration"], errors, workers=2, progress=interrupt)
    assert len(started - others) == 2
    assert not set(multiprocessing.active_children()) - others


def test_a_keyboard_interrupt_does_not_reach_the_workers():
    """They would print tracebacks beside the one line of the command that was interrupted.

    In a process of its own: tests before this one may have started the server of worker processes in another way.
    """
    done = subprocess.run([sys.executable, "-c", _BLOCKED], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["True", "True"]), done.stderr


@pytest.mark.exhaustive
@pytest.mark.promise("A worker process ends when the program that started it is killed")
def test_workers_end_with_a_killed_parent(tmp_path):
    script = tmp_path / "killed.py"
    script.write_text(_KILLED, "utf-8")
    done = subprocess.run([sys.executable, script], stdout=subprocess.PIPE, timeout=100, check=False)
    assert done.returncode == -signal.SIGKILL
    # the pipe's end is read only when every process that holds it has ended: `run` returned, so they have
    assert len(done.stdout.split()) == 2


_BLOCKED = """
import signal
from concurrent.futures import ProcessPoolExecutor
from truepose.numerics import processes

context = processes.start_method("truepose.numerics.processes")
before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
with ProcessPoolExecutor(1, context) as pool:
    print(signal.SIGINT in pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result())
print(signal.pthread_sigmask(signal.SIG_BLOCK, []) == before)
"""
_KILLED = """
import multiprocessing, os, signal
import numpy as np
from truepose.predictors import PositionalErrors, rank_predictors
from truepose.numerics import processes

def kill(line):
    print(*(process.pid for process in multiprocessing.active_children()), flush=True)
    os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    processes.cores = lambda: 2
    x = np.random.default_rng(0).uniform(0, 1000, (80, 3))
    rank_predictors(["registration"], PositionalErrors({"cartesian": x}, np.sin(x / 400)), workers=2, progress=kill)
"""


@pytest.mark.sampled(1)
@pytest.mark.promise("Worker processes times their threads never exceed the processors that truepose may use")
@pytest.mark.parametrize("usable", [2, 3])
def test_threads_times_workers(errors, monkeypatch, tmp_path, usable):
    monkeypatch.setattr(processes, "cores", lambda: usable)
    rank_predictors(["registration"], Noting(errors.coordinates, errors.e, folder=tmp_path), workers=8)
    notes = [json.loads(path.read_text("utf-8")) for path in tmp_path.iterdir()]
    assert 1 <= len(notes) <= usable  # a quick worker may do all there is before another has started
    assert all(count == 1 for note in notes for count in note)


@dataclass(frozen=True, eq=False)
class Noting(PositionalErrors):
    """Samples that note how many threads the worker processes have that register them."""

    folder: Path | None = None

    def registered_by(self, rows):
        if parent_process() is not None:
            counts = [numba.get_num_threads(), threads(), *(info["num_threads"] for info in threadpool_info())]
            (self.folder / str(os.getpid())).write_text(json.dumps(counts), "utf-8")
        return self


@pytest.mark.promise("Linear algebra and compiled kernels use no more threads than the processors given to the process")
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="affinity cannot be set on this system")
def test_fits_of_the_choice_use_one_thread(errors):
    used = set()

    class Watching(PositionalErrors):
        def fit(self, *arguments, **options):
            used.update(
                {
                    numba.get_num_threads(),
                    *(lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas"),
                }
            )
            return super().fit(*arguments, **options)

    with threadpool_limits(2):
        before = numba.get_num_threads()
        rank_predictors(["ordinary-kriging"], Watching(errors.coordinates, errors.e), folds=2, splits=["points"])
        assert used == {1}
        assert numba.get_num_threads() == before


def test_cores_are_those_of_the_affinity():
    code = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); "
    code += "from truepose.numerics.threads import cores; print(cores())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"


@pytest.mark.promise("A limit on the threads of linear algebra is kept, also for large matrices")
def test_a_limit_on_threads_is_never_raised():
    for around in (1, 2):
        with threadpool_limits(around, user_api="blas"), blas_threads(10**6):
            assert {info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas"} <= {1, around}
        with threadpool_limits(around, user_api="blas"), blas_threads(0), blas_threads(10**6):
            assert {info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas"} == {1}


@pytest.mark.promise("A fit of few samples uses one thread, whatever the machine has")
@pytest.mark.parametrize(
    "model", [OrdinaryKriging(), KinematicKriging(ARM.robot, ARM.tf_flange_tool), InverseDistance()]
)
def test_small_fits_use_one_thread(samples, monkeypatch, model):
    seen = {}

    def noting(name, asked):
        def call(self, *arguments):
            seen[name] = {info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas"}
            return asked(self, *arguments)

        return call

    for name in ("_fit", "_predict", "_leave_one_out", "_leave_blocks_out"):
        monkeypatch.setattr(type(model), name, noting(name, getattr(type(model), name)))
    with threadpool_limits(2, user_api="blas"):
        model.fit(samples.q[:30], samples.p_meas[:30] - samples.p_cmd[:30])
        model.predict(samples.q)
        model.leave_one_out()
        model.leave_blocks_out(np.arange(30) // 10)
    assert all(counts == {1} for counts in seen.values())
    assert len(seen) == 4
