"""The columns of the tidy table, in the units of their names: what files and pandas tables have in common."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._io.delimited import TextTable, escaped
from truepose._typing import FloatArray
from truepose.samples.columns import QUANTITIES, full_name, gather, require

if TYPE_CHECKING:
    from pandas import DataFrame

COMMANDED: Final = {
    "row",
    "name",
    "reflector",
    "q",
    "q_shown",
    "p_cmd",
    "rpy_cmd",
    "approach",
    "temperature",
    "load",
    "p_load",
}
MEASURED: Final = {"p_meas", "rxyz_meas", "p_std", "rotation_std", "time"}


def tidy_columns(quantities: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return the columns of a tidy table by full name, in mm and deg, given the quantities of `Samples` by name."""
    arrays = dict(quantities)
    if (rotation := arrays.pop("rotation_cmd", None)) is not None:
        arrays["rpy_cmd"] = _angles(rotation, "ZYX")[:, ::-1]
    if (rotation := arrays.pop("rotation_meas", None)) is not None:
        arrays["rxyz_meas"] = _angles(rotation, "XYZ")
    columns = {}
    for stem, quantity in QUANTITIES.items():
        values = arrays.get(quantity.array)
        if values is None or (values.ndim == 2 and quantity.index >= values.shape[1]):
            continue
        values = values[:, quantity.index] if values.ndim == 2 else values
        columns[full_name(stem)] = np.degrees(values) if quantity.kind == "angle" else values
    return columns


def quantities(table: TextTable, *, measured: bool) -> dict[str, Any]:
    """Return the quantities of `Samples` or of `Poses` by name, in mm and rad, from a tidy table.

    Raises
    ------
    FileError
        If a column is missing, misspelt or without unit, or a field is invalid.
    """
    arrays: dict[str, Any] = gather(table, COMMANDED | MEASURED if measured else COMMANDED)
    if measured:
        require(table, arrays, "x_meas")
    if "q_shown" not in arrays:
        require(table, arrays, "q1", "x_cmd")
    arrays = commanded_rotation(arrays)
    if (rxyz := arrays.pop("rxyz_meas", None)) is not None:
        arrays["rotation_meas"] = Rotation.from_euler("XYZ", rxyz)
    return arrays


def commanded_rotation(arrays: dict[str, Any]) -> dict[str, Any]:
    """Return arrays by name with the commanded orientation as a rotation in place of its angles."""
    if (rpy := arrays.pop("rpy_cmd", None)) is not None:
        arrays["rotation_cmd"] = Rotation.from_euler("ZYX", rpy[:, ::-1])
    return arrays


def together(*parts: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the columns of tables below each other; what a row does not have is NaN, or an empty word."""
    columns = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        word = any(part[name].dtype.kind == "U" for part in parts if name in part)
        lengths = [len(next(iter(part.values()))) for part in parts]
        absent = [np.full(n, "" if word else np.nan) for n in lengths]
        columns[name] = np.concatenate([part.get(name, none) for part, none in zip(parts, absent, strict=True)])
    return columns


def text_table(frame: DataFrame, source: str) -> TextTable:
    """Return a pandas table as text, for the readers of files; its rows are the lines, from 1."""
    fields = [_texts(frame[name].to_numpy()) for name in frame.columns]
    n = len(frame)
    table = np.array(fields, dtype=np.str_).T if fields else np.empty((n, 0), np.str_)
    return TextTable(source, ",", [str(name) for name in frame.columns], 0, table, np.arange(1, n + 1))


def _texts(values: NDArray[Any]) -> list[str]:
    if values.dtype.kind in "iuf":
        return [repr(value) for value in values.tolist()]
    return [escaped(str(value)) for value in values.tolist()]


def _angles(rotation: Rotation, order: Literal["ZYX", "XYZ"]) -> FloatArray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # at gimbal lock, any of the equivalent triples
        return np.asarray(rotation.as_euler(order))
