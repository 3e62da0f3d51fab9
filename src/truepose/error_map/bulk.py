"""Predictions of many poses by an executor: in parts of one size, in order, with constant memory."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._io.archive import LARGEST_MAP
from truepose._io.files import read_bytes
from truepose._typing import FloatArray
from truepose.error_map.encoding import from_bytes, hash_of, to_bytes
from truepose.error_map.map import ErrorMap
from truepose.errors import FileError
from truepose.numerics.executor import Executor, Inputs, Task, run_in_order
from truepose.samples import Poses

ROWS: Final = 65_536
"""The number of poses of a part: the same in all forms of execution, so that sums have the same order."""


def share_map(error_map: ErrorMap, executor: Executor) -> str:
    """Share a map, as its file, with the tasks of an executor; return its key."""
    return executor.share(lambda: map_bytes(error_map), error_map)


def shared_map(inputs: Inputs, key: str, path: Path | None) -> ErrorMap:
    """Return a shared map in a task; `path` is its file where it was read, for messages and records."""
    return inputs.get(key, partial(_map_of, path))


def map_bytes(error_map: ErrorMap) -> bytes:
    """Return the file of a map; it is read again, because a map keeps none of its bytes.

    Raises
    ------
    FileError
        If the file was changed since.
    """
    if error_map.path is None:
        return to_bytes(error_map)
    data = read_bytes(error_map.path, LARGEST_MAP)
    if hash_of(data, error_map.path) != error_map.hash:
        raise FileError(error_map.path, "changed while it was used; run again")
    return data


def _map_of(path: Path | None, data: bytes) -> ErrorMap:
    found = from_bytes(data, path or "map", ErrorMap)
    return found if path is not None else replace(found, stored=None)


def predict_parts(
    error_map: ErrorMap, parts: Iterable[tuple[Any, Poses]], executor: Executor
) -> Iterator[tuple[Any, FloatArray, FloatArray]]:
    """Predict parts of a table; yield each in order with `ErrorMap.predict_measured` of its poses.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    parts : iterable of (any, Poses)
        The parts, each with what comes back beside its prediction; they are read some at a time.
    executor : Executor
        Where they are predicted.

    Yields
    ------
    The part, and p and std, (n, 3) arrays [mm], tracker frame.
    """
    key = share_map(error_map, executor)
    tasks = ((part, _task(key, error_map.path, poses)) for part, poses in parts)
    for part, found in run_in_order(executor, predict_task, tasks):
        p, std = np.split(found, 2, axis=1)
        yield part, p, std


def predict_task(inputs: Inputs, task: Task) -> FloatArray:
    """Return the prediction of a part, position and standard deviation, (n, 6) [mm]."""
    path, poses = task.values
    return np.concatenate(shared_map(inputs, task.inputs[0], path).predict_measured(poses), axis=1)


def _task(key: str, path: Path | None, poses: Poses) -> Task:
    values = path, poses
    return Task((key,), values, hashlib.sha256(pickle.dumps(values)).hexdigest())


def in_parts(poses: Poses) -> Iterator[tuple[slice, Poses]]:
    """Yield poses in parts of `ROWS`, each with its rows."""
    for start in range(0, len(poses), ROWS):
        rows = slice(start, min(start + ROWS, len(poses)))
        yield rows, poses if len(poses) <= ROWS else poses[rows]
