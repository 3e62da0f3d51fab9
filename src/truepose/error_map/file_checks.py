"""Check that the parts of a map file agree with each other.

A file with correct hashes may still hold anything. The parts from which a map is made (samples, station, tool,
hyperparameters) can only be checked for being possible. All others are computed again from these and compared: `agree`
compares every member of the file, also those that a later version adds, so a part that is not read or that contradicts
the others is an error.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from truepose._typing import FloatArray
from truepose.error_map.data import MapData
from truepose.error_map.registration import reading_noise
from truepose.geometry import check_transforms
from truepose.predictors import Predictor
from truepose.robots import list_robots
from truepose.samples import check_against

_SAME_MM: Final = 1e-6
_TRIED: Final = 10  # samples at which a predictor is evaluated
_SAME: Final = 1e-9  # relative; processors differ by less


class _Record(BaseModel):
    """Information on how a map was made, for people; later versions may add to it."""

    model_config = ConfigDict(strict=True, extra="allow")


class _Ranked(_Record):
    predictor: str
    mean_mm: float | None = None
    mean_interval_mm: list[float] | None = Field(None, min_length=2, max_length=2)
    p95_mm: float | None = None
    splits: dict[str, dict[str, float]] = Field(default_factory=dict)
    within_95: float = Field(0.0, ge=0.0, le=1.0)
    worse_by_mm: float = 0.0
    worse_by_interval_mm: list[float] = Field(default=[0.0, 0.0], min_length=2, max_length=2)
    level: bool = False
    note: str = ""


class _Expected(_Record):
    mean_mm: float
    mean_interval_mm: list[float] = Field(min_length=2, max_length=2)
    chosen: dict[str, int]


class _Sample(_Record):
    row: int
    point: str | None = None
    line: int | None = None


class _Fault(_Record):
    kind: Literal["moved", "drift", "scale", "reference"]
    shift: float
    shift_std: float
    turn: float
    turn_std: float
    scale: float
    scale_std: float
    rows: list[int] = Field(min_length=2, max_length=2)
    ends: list[_Sample] = Field(default_factory=list, max_length=2)
    points: int
    words: str
    stops: bool


class _Campaign(_Record):
    tested: int = Field(0, ge=0)
    limit_mm: float = Field(0.0, ge=0.0)
    suspected_drift_mm: float = Field(0.0, ge=0.0)
    faults: list[_Fault] = Field(default_factory=list)


class _Worth(_Record):
    n: int = Field(ge=1)
    nothing_mm: float
    left_mm: float | None = None
    registration_mm: float | None = None
    gain_over_nothing: tuple[float, float] | None = None
    gain_over_registration: tuple[float, float] | None = None
    note: str = ""


class _Excluded(_Sample):
    reason: str


def agree(stored: Any, remade: Any, where: str) -> None:
    """Require stored values to be those of the map that was read from them.

    Parameters
    ----------
    stored, remade : mapping, list, array or plain value
        The stored values and those computed again. Keys of a mapping that an older version did not write are ignored.
    where : str
        The place in the file, for messages.

    Raises
    ------
    ValueError
        If they differ, with the place and both values.
    """
    if isinstance(stored, Mapping) and isinstance(remade, Mapping):
        for key in stored:
            if key not in remade:
                raise ValueError(f"{where or 'the file'} holds {key!r}, which is not part of a map")
            agree(stored[key], remade[key], f"{where}.{key}" if where else str(key))
    elif isinstance(stored, np.ndarray) and isinstance(remade, np.ndarray):
        _agree_arrays(stored, remade, where)
    elif isinstance(stored, list) and isinstance(remade, list) and len(stored) == len(remade):
        for k, (one, other) in enumerate(zip(stored, remade, strict=True)):
            agree(one, other, f"{where}[{k}]")
    elif type(stored) is not type(remade) or stored != remade:
        raise ValueError(f"{where} is {stored!r}, the rest of the map says {remade!r}")


def _agree_arrays(stored: NDArray[Any], remade: NDArray[Any], where: str) -> None:
    if (stored.dtype.kind, stored.shape) != (remade.dtype.kind, remade.shape):
        kind = f"{stored.dtype} of shape {stored.shape}"
        raise ValueError(f"{where} is {kind}, the rest of the map says {remade.dtype} of shape {remade.shape}")
    if stored.dtype.kind != "f":
        off = stored != remade
    else:
        off = np.abs(stored - remade) > _SAME_MM * (where == "e") + _SAME * np.abs(remade).max(initial=0.0)
    if off.any():
        at = tuple(int(k) for k in np.argwhere(off)[0])
        raise ValueError(f"{where}{list(at)} is {stored[at]}, the rest of the map says {remade[at]}")


def check(error_map: MapData) -> None:
    """Require the parts of a map to be possible, and to agree where one follows from another.

    Raises
    ------
    ValueError
        If a part is impossible or contradicts another; the part is named.
    """
    _check_samples(error_map)
    _check_frames(error_map)
    _check_registration(error_map)
    _check_parameters(error_map.predictor_name, error_map.predictor)
    ranked = TypeAdapter(list[_Ranked]).validate_python(error_map.ranking)
    TypeAdapter(list[_Excluded]).validate_python(error_map.excluded)
    _Campaign.model_validate(error_map.campaign)
    if ranked and ranked[0].predictor != error_map.predictor_name:
        raise ValueError(f"the ranking chose {ranked[0].predictor}, the predictor is {error_map.predictor_name}")
    if error_map.known_worth is not None:
        _Worth.model_validate(asdict(error_map.known_worth))
    if error_map.expected:
        _Expected.model_validate(error_map.expected)


def _check_frames(error_map: MapData) -> None:
    check_transforms("tf_base_tracker", error_map.registration.tf_base_tracker[None])
    check_transforms("tf_flange_tool", error_map.tf_flange_tool[None])
    stated, sampled, fit = error_map.cell.tf_flange_tool, error_map.tf_flange_sampled, error_map.cell.tool.fit
    if error_map.tool_fitted != (fit != "none"):
        raise ValueError(f'tool_fitted is {error_map.tool_fitted}, the cell says [tool] fit = "{fit}"')
    if fit != "pose" and (fit == "none" or error_map.samples.reflector is None):
        agree(sampled[:3, :3], stated[:3, :3], "tf_flange_tool")
    if fit == "none":
        agree(sampled[:3, 3], stated[:3, 3], "the tool point")


def _check_registration(error_map: MapData) -> None:
    found, n = error_map.registration, len(error_map.samples)
    rows = len(found.outliers)
    if not n <= rows <= n + len(error_map.excluded) or found.outliers.dtype != np.bool_:
        raise ValueError(f"registration.outliers has {rows} rows, there are {n} samples")
    if found.residuals.shape != (rows, 3):
        raise ValueError(f"registration.residuals has shape {found.residuals.shape}, expected {(rows, 3)}")
    if not _in_order(error_map.e, found.residuals):
        raise ValueError("registration.residuals do not agree with station and samples")
    width = 9 if error_map.tool_fitted and len(found.covariance) == 9 else 6
    if found.covariance.shape != (width, width) or found.covariance.dtype.kind != "f":
        raise ValueError(f"registration.covariance has shape {found.covariance.shape}, expected {(width, width)}")
    scale = np.sqrt(np.maximum(np.diag(found.covariance), np.finfo(float).tiny))
    relative = found.covariance / np.outer(scale, scale)
    if not np.allclose(relative, relative.T, atol=1e-6) or np.linalg.eigvalsh(relative).min() < -1e-6:
        raise ValueError("registration.covariance is not a covariance")
    swapped = found.swapped
    if swapped.dtype.kind != "i" or swapped.shape != (len(swapped), 2) or len(swapped) > rows:
        raise ValueError(f"registration.swapped is {swapped.dtype} of shape {swapped.shape}, expected pairs of rows")
    if swapped.size and not (swapped.min() >= 0 and swapped.max() < rows):
        raise ValueError(f"registration.swapped names rows beyond the {rows} of the file")
    if type(found.noise_std) is not float or not found.noise_std >= 0.0 or not isinstance(found.hint, str):
        raise ValueError(f"registration.noise_std is {found.noise_std!r}, expected a standard deviation [mm]")


def _in_order(e: FloatArray, residuals: FloatArray) -> bool:
    """Return whether the errors are rows of the residuals, in order, with rows of left-out readings between them."""
    if len(e) == len(residuals):
        return bool((np.abs(e - residuals) <= _SAME_MM).all())
    at = 0
    for row in residuals:
        at += bool((np.abs(e[at] - row) <= _SAME_MM).all())
        if at == len(e):
            return True
    return False


def _check_samples(error_map: MapData) -> None:
    robot, samples, named = error_map.robot, error_map.samples, error_map.cell.robot.model
    if named in list_robots() and named != robot.name:
        raise ValueError(f"the robot is {robot.name}, the cell names {named}")
    if not isinstance(samples.source, str):
        raise ValueError(f"samples.source is {samples.source!r}, expected a string")
    check_against(samples, robot)


def _check_parameters(name: str, predictor: Predictor) -> None:
    """Require parameters of the type of their default, where that is a plain type."""
    for key, parameter in inspect.signature(type(predictor)).parameters.items():
        value, default = getattr(predictor, key), parameter.default
        expected = (int, float) if type(default) is float or parameter.annotation == "float" else (type(default),)
        if type(default) in (bool, int, float, str) and type(value) not in expected:
            raise ValueError(f"the parameter {key} of {name} is {value!r}, expected one such as {default!r}")


def check_fitted(error_map: MapData) -> None:
    """Require a predictor with finite predictions, and with the noise that the samples and cell state.

    Raises
    ------
    ValueError
        If it has not.
    """
    samples = error_map.samples
    known = reading_noise(error_map.cell, samples, error_map.registration)
    if error_map.predictor.noise_std_ is None and known is not None:
        raise ValueError("noise_std is missing, although samples or cell state the noise of readings")
    tried = error_map.fitted_inputs[:_TRIED]
    e, std = error_map.predictor.predict(tried, return_std=True, include_nugget=True)
    if not (np.isfinite(e).all() and np.isfinite(std).all() and (std >= 0.0).all()):
        raise ValueError("the predictor's parameters give errors that are not finite numbers")
