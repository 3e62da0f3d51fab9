"""The forms of an executor on this machine: same results, inputs by hash, killed processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from truepose.errors import DataError
from truepose.numerics import processes
from truepose.numerics.executor import ReadInputs, Serial, Task, run_in_order
from truepose.numerics.processes import Processes

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(autouse=True)
def two_processors(monkeypatch):
    monkeypatch.setattr(processes, "cores", lambda: 2)


def scaled(inputs, task):
    return inputs.get(task.inputs[0], np.frombuffer) * task.values[0]


def warned(inputs, task):
    warnings.warn(f"row {task.values[0]}", UserWarning, stacklevel=1)
    return task.values[0]


def killed_once(inputs, task):
    """End the process of task 5 at its first run, without a word."""
    number, folder = task.values
    (Path(folder) / f"{number}-{os.getpid()}").touch()
    if number == 5 and len(list(Path(folder).glob("5-*"))) == 1:
        os.kill(os.getpid(), signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    return number**2


def compiled(inputs, task):
    import numba

    numba.njit(parallel=True)(lambda: None)
    time.sleep(0.01)
    return task.values[0]


def killed_always(inputs, task):
    os.kill(os.getpid(), signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)


def refused(inputs, task):
    raise DataError(f"task {task.values[0]} has no data")


@pytest.mark.parametrize("form", [Serial, lambda: Processes(2)])
def test_results_come_with_the_place_of_their_task(form):
    numbers = np.arange(6.0)
    with form() as executor:
        key = executor.share(numbers.tobytes, numbers)
        found = dict(executor.run(scaled, (Task((key,), (float(k),)) for k in range(40))))
    assert sorted(found) == list(range(40))
    for k in range(40):
        np.testing.assert_array_equal(found[k], numbers * k)


def test_a_killed_process_costs_nothing_but_time(tmp_path):
    with Processes(2) as executor:
        found = dict(executor.run(killed_once, (Task((), (k, str(tmp_path))) for k in range(30))))
    assert found == {k: k**2 for k in range(30)}
    assert len(list(tmp_path.glob("5-*"))) == 2


def test_a_task_that_kills_every_process_is_an_error():
    with (
        pytest.raises(DataError, match=r"squares: one of 2 worker processes died.*use 1 worker"),
        Processes(2, "squares") as executor,
    ):
        list(executor.run(killed_always, [Task()]))


@pytest.mark.filterwarnings("default")
def test_warnings_and_errors_of_workers_arrive():
    with Processes(2) as executor:
        with pytest.warns(UserWarning, match="row 1"):
            assert dict(executor.run(warned, [Task((), (1,))])) == {0: 1}
        with pytest.raises(DataError, match="task 7 has no data"):
            list(executor.run(refused, [Task((), (7,))]))


def test_bytes_of_another_hash_are_refused():
    with pytest.raises(DataError, match="other bytes than those of the input 0000"):
        ReadInputs(lambda _: b"a map").get("0" * 64, bytes)


def test_tasks_are_read_only_as_workers_get_free():
    taken = []

    def tasks():
        for k in range(1000):
            taken.append(k)
            yield Task((), (k,))

    with Processes(2) as executor:
        assert next(executor.run(warned_never, tasks()))[1] in range(100)
        assert len(taken) < 100


def warned_never(inputs, task):
    return task.values[0]


def first_waits(inputs, task):
    """Leave a note; task 0 waits for the notes of 7 others."""
    number, folder = task.values
    while number == 0 and len(list(Path(folder).iterdir())) < 7:
        time.sleep(0.02)
    (Path(folder) / str(number)).touch()
    return number**2


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_order_and_a_slow_task_does_not_pile_up_others(tmp_path, workers):
    taken = []

    def tasks():
        for k in range(40):
            taken.append(k)
            yield f"part {k}", Task((), (k if workers == 2 else k + 1, str(tmp_path)))

    with Serial() if workers == 1 else Processes(2) as executor:
        results = run_in_order(executor, first_waits, tasks())
        first = next(results)
        assert len(taken) == (1 if workers == 1 else 8)
        found = [first, *results]
    assert found == [(f"part {k}", (k if workers == 2 else k + 1) ** 2) for k in range(40)]


def test_nothing_is_said_of_processes_that_are_ended(tmp_path):
    (tmp_path / "main.py").write_text(
        "from tests.numerics.test_executor import compiled\n"
        "from truepose.numerics import processes\n"
        "from truepose.numerics.executor import Task\n"
        "if __name__ == '__main__':\n"
        "    processes.cores = lambda: 2\n"
        "    with processes.Processes(2) as executor:\n"
        "        results = executor.run(compiled, (Task((), (k,)) for k in range(99)))\n"
        "        next(results)\n"
        "        raise SystemExit(130)\n"
    )
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, tmp_path / "main.py"], env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (130, "")
