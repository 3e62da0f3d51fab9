"""Error vectors, slices and volumes of maps as float32, little-endian, for the 3-D view."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.report.region import plane_at, predict_positions

ArrowSet = Literal["samples", "leave-one-out", "grid"]
PlaneName = Literal["xy", "xz", "yz"]
_CHUNK: Final = 4096  # positions at a time, so that memory stays small


def arrows(error_map: ErrorMap, which: ArrowSet, n: int) -> bytes:
    """Return rows of position, error and length of the standard deviation, (m, 7) [mm], base frame.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    which : str
        ``samples``: measured errors after registration, and the std of the prediction there. ``leave-one-out``: the
        errors left of each sample predicted from the others, and their std. ``grid``: predictions on a grid in the
        samples' bounding box; positions out of reach are left out.
    n : int
        The largest number of points of the grid.
    """
    if which == "grid":
        p = _grid(error_map, n)
        e, std = _predicted(error_map, p)
        reached = np.isfinite(e).all(axis=1)
        return _rows(p[reached], e[reached], std[reached])
    if which == "samples":
        return _rows(error_map.p_cmd, error_map.e, error_map.predict_errors(error_map.samples)[1])
    left = error_map.leave_one_out()
    return _rows(error_map.p_cmd, left.residual, left.std)


def slices(error_map: ErrorMap, plane: PlaneName, at: float, n: int) -> bytes:
    """Return lengths of predicted errors and of their std on a plane, (2, n, n) [mm]; NaN out of reach.

    Rows go along the second axis of the plane's name, both over the samples' bounding box.
    """
    i, j = ("xyz".index(letter) for letter in plane)
    found = plane_at(error_map, i, j, at, n)
    return _float32(np.stack([found.error, found.std]))


def volume(error_map: ErrorMap, n: int) -> bytes:
    """Return lengths of the std on a grid over the samples' bounding box, (n, n, n) [mm] in the order z, y, x."""
    low, high = box(error_map)
    z, y, x = np.meshgrid(*(np.linspace(low[k], high[k], n) for k in (2, 1, 0)), indexing="ij")
    std = _predicted(error_map, np.column_stack([x.ravel(), y.ravel(), z.ravel()]))[1]
    return _float32(np.linalg.norm(std, axis=1))


def box(error_map: ErrorMap) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and the highest corner of the samples' bounding box, (3,) [mm], base frame."""
    return error_map.p_cmd.min(axis=0), error_map.p_cmd.max(axis=0)


def _grid(error_map: ErrorMap, n: int) -> FloatArray:
    """Return at most n positions on a grid with nearly equal steps along each axis."""
    low, high = box(error_map)
    extent = np.maximum(high - low, 1e-3)
    flat = high - low <= 0
    step = (np.prod(extent[~flat]) / n) ** (1 / max(1, int((~flat).sum()))) if not flat.all() else 1.0
    counts = np.where(flat, 1, np.maximum(1, np.floor(extent / step))).astype(int)
    axes = [np.linspace(low[k], high[k], counts[k]) if counts[k] > 1 else [(low[k] + high[k]) / 2] for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)[:n]


def _predicted(error_map: ErrorMap, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    parts = [predict_positions(error_map, p[start : start + _CHUNK]) for start in range(0, len(p), _CHUNK)]
    return np.concatenate([e for e, _ in parts]), np.concatenate([std for _, std in parts])


def _rows(p: FloatArray, e: FloatArray, std: FloatArray) -> bytes:
    return _float32(np.column_stack([p, e, np.linalg.norm(std, axis=1)]))


def _float32(values: FloatArray) -> bytes:
    return values.astype("<f4").tobytes()
