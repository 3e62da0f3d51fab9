"""An error map to the bytes of its file and back (`truepose._io.archive` is the container).

The file holds what the map was made from (cell, robot, samples, registration) and the predictor's fitted
hyperparameters. Reading it fits the predictor to the samples again with these, which estimates nothing.
"""

from __future__ import annotations

import hashlib
import inspect
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._io import archive
from truepose.cell import Cell
from truepose.error_map import file_checks
from truepose.error_map.arm_check import UNCHECKED, ArmCheck
from truepose.error_map.data import MapData, StoredFile
from truepose.error_map.distances import distance_rows
from truepose.error_map.facts import Fact
from truepose.error_map.selection import arm_of
from truepose.error_map.worth import Worth
from truepose.errors import FileError
from truepose.geometry import Registration
from truepose.predictors import FORMER_NAMES, LATER_PARAMETERS, make_predictor, predictor_spec
from truepose.robots import parse_robot, to_toml
from truepose.samples import Distances, Samples

_ROTATIONS = ("rotation_cmd", "rotation_meas")
_NOT_STATED: Final = {"reference", "registration"}
_REGISTRATION = ("tf_base_tracker", "residuals", "outliers", "covariance", "swapped")
_WRONG: Final = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    MemoryError,
    RecursionError,
    TypeError,
    ValueError,
)
"""The errors of code that gets other input than it was written for."""

_Map = TypeVar("_Map", bound=MapData)


def to_bytes(error_map: MapData) -> bytes:
    """Return the bytes of a map's file; the same map always gives the same bytes."""
    content = _content(error_map)
    if error_map.cell.config_dat is not None:  # relative to the cell file, which the map leaves behind
        content["cell"]["frames"]["config_dat"] = str(error_map.cell.config_dat.resolve())
    content |= {"robot": to_toml(replace(error_map.robot, data_sheet=None)), "worth": error_map.worth.to_dict()}
    return archive.pack(content, _arrays(error_map))


def _content(error_map: MapData) -> dict[str, Any]:
    """Return all that is not an array, without the robot, whose text may differ in the last digit after reading."""
    samples, registration = error_map.samples, error_map.registration
    return {
        "cell": error_map.cell.model_dump(mode="json", exclude_unset=True),  # stated values stay distinct from defaults
        "predictor": {"name": error_map.predictor_name, "parameters": error_map.predictor.to_dict()},
        "samples": {"source": samples.source, "columns": samples.columns(), **_distances(samples)},
        "registration": {
            "noise_std": registration.noise_std,
            "hint": registration.hint,
            "tool_fitted": error_map.tool_fitted,
        },
        "ranking": error_map.ranking,
        "expected": error_map.expected,
        "excluded": error_map.excluded,
        "campaign": error_map.campaign,
        "arm_check": error_map.arm_check.to_dict(),
        **({"facts": [fact.to_dict() for fact in error_map.stated]} if error_map.stated else {}),
        **({} if error_map.known_worth is None else {"worth": error_map.known_worth.to_dict()}),
    }


def _arrays(error_map: MapData) -> dict[str, NDArray[Any]]:
    samples, registration = error_map.samples, error_map.registration
    arrays = {f"samples.{name}": _array(getattr(samples, name)) for name in samples.columns()}
    arrays |= {f"registration.{name}": getattr(registration, name) for name in _REGISTRATION}
    if (distances := samples.distances) is not None:
        arrays |= {f"distances.{name}": _array(getattr(distances, name)) for name in distances.columns()}
    if error_map.predictor.noise_std_ is not None:
        arrays["noise_std"] = error_map.predictor.noise_std_
    if error_map.p_flange_sampled is not None:
        arrays["p_flange_sampled"] = error_map.p_flange_sampled
    return arrays | {"tf_flange_tool": error_map.tf_flange_tool, "e": error_map.e}


def _distances(samples: Samples) -> dict[str, Any]:
    return {} if samples.distances is None else {"distances": samples.distances.columns()}


def from_bytes(data: bytes, path: str | Path, kind: type[_Map]) -> _Map:
    """Return the map in the bytes of a file.

    Every part of the file must be one that is read, and parts that repeat each other must agree: see
    `truepose.error_map.file_checks`.

    Parameters
    ----------
    data : bytes
        The content of the file.
    path : str or Path
        The file's path, for messages.
    kind : type
        The class of the map.

    Raises
    ------
    FileError
        As `truepose._io.archive.unpack`, and if a part of the map is missing, of a wrong kind, or contradicts another.
    """
    content, arrays = archive.unpack(data, path)
    try:
        _replace_former_names(content)
        _add_later_parameters(content["predictor"])
        error_map = kind(**_fields(content, arrays, path), stored=StoredFile(Path(path), hash_of(data, path)))
        if len(arrays["e"]) != len(error_map.samples):
            raise ValueError(f"e has {len(arrays['e'])} rows, there are {len(error_map.samples)} samples")
        file_checks.check(error_map)
        file_checks.agree(arrays["e"], error_map.e, "e")
        error_map.predictor.fit(error_map.fitted_inputs, arrays["e"], arrays.get("noise_std"))
        file_checks.check_fitted(error_map)
        remade = json.loads(json.dumps(_content(error_map)))
        file_checks.agree({key: value for key, value in content.items() if key != "robot"}, remade, "")
        file_checks.agree(remade["predictor"], content["predictor"], "predictor")
        file_checks.agree(arrays, _arrays(error_map), "")
    except FileError:
        raise
    except _WRONG as error:
        what = f"has no {error}" if isinstance(error, KeyError) else str(error)
        raise FileError(path, f"does not hold a whole map ({what}); fit and save the map again") from None
    return error_map


def hash_of(data: bytes, path: str | Path) -> str:
    """Return what names the map in a file: the SHA-256 of the file as truepose wrote it, also if it was packed again.

    Raises
    ------
    FileError
        As `truepose._io.archive.unpack`.
    """
    return hashlib.sha256(archive.as_written(data, path)).hexdigest()


def _replace_former_names(content: dict[str, Any]) -> None:
    """Replace predictor names of version 0.1 that are options today, in place."""
    for row, key in [(content["predictor"], "name"), *((row, "predictor") for row in content["ranking"])]:
        row[key] = FORMER_NAMES.get(row[key], row[key])
    if chosen := content["expected"].get("chosen"):
        content["expected"]["chosen"] = {FORMER_NAMES.get(name, name): count for name, count in chosen.items()}


def _add_later_parameters(predictor: dict[str, Any]) -> None:
    """Add the parameters of the predictor that came after version 0.2, in place, if the file has none of them.

    Those of `_NOT_STATED` are later still: files of any version may lack them.
    """
    later = LATER_PARAMETERS.keys() & inspect.signature(predictor_spec(predictor["name"]).family).parameters.keys()
    for name in later & _NOT_STATED:
        predictor["parameters"].setdefault(name, LATER_PARAMETERS[name])
    later -= _NOT_STATED
    if not later & predictor["parameters"].keys():
        predictor["parameters"] |= {name: LATER_PARAMETERS[name] for name in later}


def _fields(content: dict[str, Any], arrays: dict[str, NDArray[Any]], path: str | Path) -> dict[str, Any]:
    """Return the fields of a map whose predictor has its hyperparameters, but was not fitted."""
    robot = parse_robot(content["robot"], path=path)
    source, distances = content["samples"]["source"], None
    if "distances" in content["samples"]:
        own = _columns(arrays, "distances", content["samples"]["distances"])
        distances = Distances(**own, source=source)
    columns = _columns(arrays, "samples", content["samples"]["columns"])
    samples = Samples(**columns, source=source, distances=distances)
    tf_flange_tool = arrays["tf_flange_tool"]
    if type(content["registration"]["tool_fitted"]) is not bool:
        raise TypeError("registration.tool_fitted is not a boolean")
    registration = Registration(
        **{name: arrays[f"registration.{name}"] for name in _REGISTRATION},
        noise_std=content["registration"]["noise_std"],
        hint=content["registration"]["hint"],
        p_flange_tool=tf_flange_tool[:3, 3] if content["registration"]["tool_fitted"] else None,
    )
    name = content["predictor"]["name"]
    cell = Cell.model_validate(content["cell"], context={"robot": robot})
    tf_flange_sampled = tf_flange_tool.copy()
    tf_flange_sampled[:3, 3] = arrays.get("p_flange_sampled", tf_flange_tool[:3, 3])
    rows = distance_rows(cell, samples, registration)
    arm = replace(arm_of(cell, robot, tf_flange_sampled), distance_rows=rows)
    return {
        "cell": cell,
        "robot": robot,
        "samples": samples,
        "registration": registration,
        "tf_flange_tool": tf_flange_tool,
        "predictor_name": name,
        "predictor": make_predictor(name, content["predictor"]["parameters"], arm),
        "ranking": content["ranking"],
        "expected": content["expected"],
        "excluded": content["excluded"],
        "campaign": content.get("campaign", {}),
        "arm_check": ArmCheck.from_dict(content["arm_check"]) if "arm_check" in content else UNCHECKED,
        "stated": tuple(Fact.from_dict(found) for found in content.get("facts", [])),
        "known_worth": Worth.from_dict(content["worth"]) if "worth" in content else None,
        "p_flange_sampled": arrays.get("p_flange_sampled"),
    }


def _columns(arrays: dict[str, NDArray[Any]], table: str, names: list[str]) -> dict[str, Any]:
    """Return the columns of a stored table by name."""
    columns: dict[str, Any] = {name: arrays[f"{table}.{name}"] for name in names}
    return columns | {name: Rotation.from_quat(columns[name]) for name in _ROTATIONS if name in columns}


def _array(value: Any) -> NDArray[Any]:
    return value.as_quat() if isinstance(value, Rotation) else np.asarray(value)
