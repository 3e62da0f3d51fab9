"""Robots from and to TOML, the format of the library's files."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._io.strict import LARGEST, parse_toml
from truepose._io.units import split_unit
from truepose._typing import FloatArray
from truepose.errors import DataError, FileError, RobotError
from truepose.geometry.angles import euler
from truepose.geometry.transforms import make_transform
from truepose.robots.chain import Chain
from truepose.robots.data_sheet import DataSheet
from truepose.robots.robot import Robot

_POSE: Final = ("x_mm", "y_mm", "z_mm", "quaternion_wxyz")
KEYS: Final = {
    "": ("name", "maker", "model", "source", "kinematics", "limits", "data_sheet", "base", "flange"),
    "kinematics": (
        *("convention", "alpha_deg", "a_mm", "d_mm", "offset_deg", "beta_deg", "sign", "gear_ratio"),
        "coupling",
    ),
    "limits": ("lower_deg", "upper_deg"),
    "data_sheet": tuple(field.name for field in fields(DataSheet)),
    "base": _POSE,
    "flange": _POSE,
}
_OPTIONAL: Final = ("beta_deg", "sign", "gear_ratio", "lower_deg", "upper_deg")
_THETA: Final = (
    'use "offset_deg", the angle theta [deg] when the controller shows 0 (theta = sign q + offset); '
    'a table may have "offset_rad"'
)
_OTHER_NAMES: Final = {
    "theta": _THETA,
    "theta_deg": _THETA,
    "theta_rad": _THETA,
    "theta_offset_deg": _THETA,
    "r_mm": 'use "a_mm", the length of the link',
    "r": 'use "a_mm", the length of the link',
    "alpha": 'use "alpha_deg"',
    "alpha_rad": 'use "alpha_deg", in degrees',
    "offset_rad": 'use "offset_deg", in degrees',
    "a_m": 'use "a_mm", in mm',
    "d_m": 'use "d_mm", in mm',
    "type": 'use "convention": "mdh" (Craig\'s modified D-H) or "dh" (standard D-H); all joints are revolute',
    "couplings": 'use "coupling"',
    "joints": "state one list for each column in [kinematics]; `truepose robots --template` shows how",
    **{key: f'use "{key}_mm", with its unit' for key in ("a", "d")},
    **{key: f'use "{key}_deg", with its unit' for key in ("offset", "beta", "lower", "upper")},
}


def parse_robot(text: str, *, path: str | Path = "robot.toml") -> Robot:
    """Return the robot that the text of a library file describes; error messages name `path`.

    Parameters
    ----------
    text : str
        The text of the file.
    path : str or Path
        The file's name in error messages.

    Raises
    ------
    FileError
        If the text is not TOML, a key is missing or unknown (the message names the nearest one), a value is not a
        number, or the parameters are invalid.
    """
    return parse_table(parse_toml(text, path), path)


def parse_table(table: Mapping[str, Any], path: str | Path) -> Robot:
    """Return the robot of the content of a library file; errors as `parse_robot`."""
    _check_keys(path, "", table)
    for section in ("kinematics", "limits", "data_sheet", "base", "flange"):
        if section in table and not isinstance(table[section], dict):
            raise FileError(path, f"{section} must be a table: [{section}]")
        _check_keys(path, section, table.get(section, {}))
    name = table.get("name")
    kinematics: Mapping[str, Any] = table.get("kinematics", {})
    if not isinstance(name, str) or not kinematics:
        raise FileError(path, 'expected name = "maker-model" and a table [kinematics]')

    columns = _columns(path, table)
    optional: dict[str, Any] = {key: str(table[key]) for key in ("maker", "model", "source") if key in table}
    optional |= {key: columns[key] for key in ("sign", "gear_ratio") if key in columns}
    optional |= {"beta": np.deg2rad(columns["beta_deg"])} if "beta_deg" in columns else {}
    if "coupling" in kinematics:
        optional["coupling"] = _coupling(path, kinematics["coupling"])
    if "limits" in table:
        if not {"lower_deg", "upper_deg"} <= columns.keys():
            raise FileError(path, "limits needs both lower_deg and upper_deg")
        optional["limits"] = np.deg2rad(np.column_stack([columns["lower_deg"], columns["upper_deg"]]))
    for section, key in (("base", "tf_base_first"), ("flange", "tf_last_flange")):
        if section in table:
            optional[key] = _pose(path, section, table[section])
    try:
        if "data_sheet" in table:
            optional["data_sheet"] = _data_sheet(path, table["data_sheet"])
        return Robot(
            name=name,
            alpha=np.deg2rad(columns["alpha_deg"]),
            a=columns["a_mm"],
            d=columns["d_mm"],
            offset=np.deg2rad(columns["offset_deg"]),
            convention=kinematics.get("convention", "mdh"),
            **optional,
        )
    except RobotError as error:
        raise FileError(path, str(error)) from None


def to_toml(robot: Chain) -> str:
    """Return a robot as the text of a library file (mm and deg, all digits), which `load_robot` reads back.

    Examples
    --------
    >>> arm = Robot("one", alpha=[0], a=[250.0], d=[0], offset=[0])
    >>> parse_robot(to_toml(arm)).a
    array([250.])
    """
    columns = {
        "alpha_deg": np.rad2deg(robot.alpha),
        "a_mm": robot.a,
        "d_mm": robot.d,
        "offset_deg": np.rad2deg(robot.offset),
        "beta_deg": np.rad2deg(robot.beta),
        "sign": robot.sign,
    }
    columns |= {"gear_ratio": robot.gear_ratio} if robot.gear_ratio.size else {}
    lines = [f"{key} = {_quoted(getattr(robot, key))}" for key in ("name", "maker", "model", "source")]
    lines += ["", "[kinematics]", f"convention = {_quoted(robot.convention)}"]
    lines += [f"{key} = {_listed(column)}" for key, column in columns.items()]
    if robot.coupling is not None:
        rows = ", ".join(f"[{joint}, {other}, {factor!r}]" for joint, other, factor in robot.coupling)
        lines += [f"coupling = [{rows}]"]
    lines += ["", "[limits]"]
    limits = zip(KEYS["limits"], np.rad2deg(robot.limits.T), strict=True)
    lines += [f"{key} = {_listed(column)}" for key, column in limits]
    if robot.data_sheet is not None:
        stated = {key: value for key, value in robot.data_sheet.to_dict().items() if value is not None}
        lines += ["", "[data_sheet]"]
        lines += [f"{key} = {_quoted(value) if isinstance(value, str) else value}" for key, value in stated.items()]
    for section, tf in (("base", robot.tf_base_first), ("flange", robot.tf_last_flange)):
        if not np.array_equal(tf, np.eye(4)):
            lines += ["", f"[{section}]"]
            lines += [f"{key} = {float(value)!r}" for key, value in zip(_POSE[:3], tf[:3, 3], strict=True)]
            lines += [f"{_POSE[3]} = {_listed(euler('abb', Rotation.from_matrix(tf[:3, :3])))}"]
    return "\n".join(lines) + "\n"


def unknown_key(path: str | Path, key: str, known: Sequence[str], where: str = "") -> FileError:
    """Return the error of an unknown key; it names the key to use."""
    home = next((section for section, keys in KEYS.items() if key in keys), None)
    plain = "_".join(part for part in split_unit(key) if part)
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.0)
    if home is not None:
        hint = f"it belongs in [{home}]" if home else "it belongs above the tables"
    else:
        hint = _OTHER_NAMES.get(plain, f'did you mean "{near[0]}"?')
    return FileError(path, f'unknown key "{key}"{f" in {where}" if where else ""}; {hint}')


def _check_keys(path: str | Path, section: str, table: Mapping[str, Any]) -> None:
    for key in table:
        if key not in KEYS[section]:
            raise unknown_key(path, key, KEYS[section], f"[{section}]" if section else "")


def _columns(path: str | Path, table: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Return the lists of numbers, one for each joint, by key."""
    columns: dict[str, FloatArray] = {}
    for section, keys in (("kinematics", KEYS["kinematics"][1:-1]), ("limits", KEYS["limits"])):
        for key in keys:
            value = table.get(section, {}).get(key)
            if value is not None or key not in _OPTIONAL:
                dof = len(columns["alpha_deg"]) if columns else None
                columns[key] = _numbers(path, f"{section}.{key}", value, dof, "as in alpha_deg")
    return columns


def _coupling(path: str | Path, value: object) -> Any:
    """Return the rows of a coupling, whose joints and factors the robot checks."""
    rows = value if isinstance(value, list) else [None]
    if not all(isinstance(row, list) and len(row) == 3 and all(type(x) in (int, float) for x in row) for row in rows):
        wanted = "a list of rows [joint, other joint, factor], such as [[3, 2, 1.0]]"
        raise FileError(path, f"kinematics.coupling must be {wanted}; got {value!r}")
    return rows


def _data_sheet(path: str | Path, table: Mapping[str, Any]) -> DataSheet:
    for key, value in table.items():
        if key != "reach_at" and type(value) not in (int, float):
            raise FileError(path, f"data_sheet.{key} must be a number; got {value!r}")
    return DataSheet(**table)


def _numbers(path: str | Path, key: str, value: object, count: int | None, why: str = "") -> FloatArray:
    if value is None:
        raise FileError(path, f"{key} is missing")
    values = value if isinstance(value, list) else []
    plain = all(type(x) in (int, float) and not LARGEST < abs(x) < float("inf") for x in values)
    if values and count in (None, len(values)) and plain:
        return np.array(value, dtype=np.float64)
    wanted = "a list of numbers, one for each joint" if count is None else f"a list of {count} numbers {why}".rstrip()
    raise FileError(path, f"{key} must be {wanted}; got {value!r}")


def _pose(path: str | Path, section: str, table: Mapping[str, Any]) -> FloatArray:
    p = _numbers(path, f"{section} x_mm, y_mm, z_mm", [table.get(key, 0.0) for key in _POSE[:3]], 3)
    quaternion = _numbers(path, f"{section}.{_POSE[3]}", table.get(_POSE[3], [1.0, 0.0, 0.0, 0.0]), 4)
    try:
        return make_transform(euler("abb", quaternion), p)
    except DataError as error:
        raise FileError(path, f"{section}: {error}") from None


def _listed(values: FloatArray) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
