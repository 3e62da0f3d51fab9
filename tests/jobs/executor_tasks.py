"""Tasks that workers of the tests import."""

from __future__ import annotations

import os
import threading
import time
import uuid
from pathlib import Path

import numpy as np

from truepose._typing import FloatArray
from truepose.numerics.executor import Inputs, Task


def slow(inputs: Inputs, task: Task) -> str:
    """Return the shared input with a number after some seconds."""
    number, seconds = task.values
    time.sleep(seconds)
    return inputs.get(task.inputs[0], bytes.decode) + str(number)


def counted(inputs: Inputs, task: Task) -> int:
    """Return a square, and leave a note for each time that it is computed."""
    number, folder = task.values
    (Path(folder) / uuid.uuid4().hex).touch()
    time.sleep(0.03)
    return int(number**2)


def held_back(inputs: Inputs, task: Task) -> int:
    """Leave a note and return a number; all but the first tasks wait for a file."""
    number, first, folder = task.values
    (Path(folder) / f"{number}.started").touch()
    while number >= first and not (Path(folder) / "go").exists():
        time.sleep(0.02)
    return int(number)


def full_disk(inputs: Inputs, task: Task) -> bytes:
    """Return more bytes than this process may write from now on into one file, for a second."""
    import resource

    (size,) = task.values
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size // 2, hard))
    threading.Timer(1.0, lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))).start()
    return os.urandom(size)


def random_product(inputs: Inputs, task: Task) -> FloatArray:
    """Return the solution of a system with random numbers of a seed."""
    rng = np.random.default_rng(task.values[0])
    return np.asarray(np.linalg.solve(rng.normal(size=(300, 300)), rng.normal(size=(300, 3))))
