"""Commanded configurations, and the readings of a tracker at them (theory).

Positions are mm, angles rad. Commanded quantities are in the robot base frame, measured ones in the tracker frame; a
registration (`truepose.geometry`) makes them comparable.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._io.strict import LARGEST
from truepose._io.tables import data_frame, facts_table
from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.samples.columns import OF_JOINTS, WORDS
from truepose.samples.frames import quantities, text_table, tidy_columns, together
from truepose.samples.masked import counted_quantities
from truepose.samples.naming import name_points

if TYPE_CHECKING:
    from pandas import DataFrame

_VECTORS: Final = {"p_cmd", "p_meas", "p_std", "rotation_std", "p_origin", "p_load"}
_REPR_UNITS: Final = {"temperature": "°C", "load": "kg", "distance": "mm", "distance_std": "mm"}
_WHOLE: Final = ("row", "line")
_ABOUT: Final = ("source", "excluded", "distances", "facts")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Poses:
    """Commanded configurations: a plan to measure, or poses to predict at.

    Parameters
    ----------
    q : (n, dof) array [rad], optional
        The joint vectors, in the robot's own order and sign.
    q_shown : (n, dof) array [rad], optional
        The joint vectors as the controller shows them, where these may differ; `truepose.samples.on_arm` makes `q` of
        them.
    p_cmd : (n, 3) array [mm], base frame, optional
        The commanded positions of the tool centre point.
    rotation_cmd : Rotation of length n, optional
        The commanded orientations of the tool, base frame.
    approach : (n, dof) array of -1, 0, +1, optional
        The sign of the last motion of each joint.
    temperature : (n,) array [°C], optional
        The air temperature.
    load : (n,) array [kg], optional
        The mass of the payload.
    p_load : (n, 3) array [mm], flange frame, optional
        The centre of mass of the payload.
    name : (n,) array of str, optional
        The names of the points, for messages and to match readings with.
    reflector : (n,) array of str, optional
        The reflector of each row, a name in the cell's ``[reflectors]``; a pose has one row for each of its reflectors.
    row : (n,) array of int, optional
        The number of each row in JSON; from 0 if not given.
    line : (n,) array of int, optional
        The line of each pose in its file, from 1, for messages.
    source : str
        The origin of the table, for messages.

    Raises
    ------
    DataError
        If shapes disagree, a value is not finite, or there are neither joints nor commanded positions.

    Examples
    --------
    >>> Poses(q=np.zeros((2, 6)), p_cmd=np.array([[1200.0, 0.0, 900.0], [1350.0, 200.0, 900.0]]))
    Poses: 2 rows from samples
      q:     6 joints, 0 … 0 deg
      p_cmd: x 1200 … 1350, y 0 … 200, z 900 … 900 mm (base frame)
    """

    q: FloatArray | None = None
    q_shown: FloatArray | None = None
    p_cmd: FloatArray | None = None
    rotation_cmd: Rotation | None = None
    approach: FloatArray | None = None
    temperature: FloatArray | None = None
    load: FloatArray | None = None
    p_load: FloatArray | None = None
    name: NDArray[np.str_] | None = None
    reflector: NDArray[np.str_] | None = None
    row: IntArray | None = None
    line: IntArray | None = None
    source: str = "samples"

    def __post_init__(self) -> None:
        if self.q is None and self.q_shown is None and self.p_cmd is None:
            raise DataError(f"{self.source}: neither joints (q1_deg …) nor commanded positions (x_cmd_mm …) are given")
        for name in self.columns():
            value = getattr(self, name)
            if not isinstance(value, Rotation):
                value = np.asarray(
                    value, dtype=np.str_ if name in WORDS else np.int64 if name in _WHOLE else np.float64
                )
                object.__setattr__(self, name, value)
            self._validate(name, value)
        if self.row is None:
            object.__setattr__(self, "row", np.arange(len(self)))

    def _validate(self, name: str, value: Any) -> None:
        first = self.columns()[0]
        n = len(getattr(self, first))
        if len(value) != n:
            raise DataError(f"{self.source}: {name} has {len(value)} rows, {first} has {n}")
        if isinstance(value, Rotation) or name in (*WORDS, *_WHOLE):
            return
        expected = (n, 3) if name in _VECTORS else (n, value.shape[-1]) if name in OF_JOINTS else (n,)
        if value.shape != expected:
            raise DataError(f"{self.source}: {name} has shape {value.shape}; expected {expected}")
        bad = ~np.isfinite(value).all(axis=tuple(range(1, value.ndim)))
        if bad.any():
            raise DataError(
                f"{self.source}: {self.rows(bad)}: {name} is not finite; measure again or leave these rows out"
            )
        if value.size and np.abs(value).max() > LARGEST:
            bad = (np.abs(value) > LARGEST).any(axis=tuple(range(1, value.ndim)))
            raise DataError(
                f"{self.source}: {self.rows(bad)}: {name} is beyond {LARGEST:g}; correct or remove these rows"
            )
        if name in ("p_std", "rotation_std") and (bad := (value < 0.0).any(axis=1)).any():
            raise DataError(
                f"{self.source}: {self.rows(bad)}: negative standard deviation in {name}; expected 0 or more"
            )

        if name == "load" and (bad := value < 0.0).any():
            what = "load_kg is negative; state the mass on the flange, 0 without any"
            raise DataError(f"{self.source}: {self.rows(bad)}: {what}")

    def __len__(self) -> int:
        return len(getattr(self, self.columns()[0]))

    def __repr__(self) -> str:
        widths = max(len(name) for name in self.columns()) + 1
        facts = [f"  {name + ':':{widths}} {fact}" for name in self.columns() if (fact := self._fact(name))]
        distances = getattr(self, "distances", None)
        more = "" if distances is None else f", {len(distances)} distances"
        return "\n".join([f"{type(self).__name__}: {len(self)} rows{more} from {self.source}", *facts])

    def _repr_html_(self) -> str:
        facts = {name: fact for name in self.columns() if (fact := self._fact(name))}
        return facts_table(f"{type(self).__name__}: {len(self)} rows from {self.source}", facts)

    def _fact(self, name: str) -> str:
        """Return the extent of a quantity in a few words; nothing for names, rows and lines."""
        value = getattr(self, name)
        if name == "reflector" and len(self):
            return ", ".join(dict.fromkeys(value.tolist()))
        if name in (*WORDS, *_WHOLE) or not len(self):
            return ""
        if isinstance(value, Rotation):
            turn = np.rad2deg((value[0].inv() * value).magnitude().max())
            return f"orientations up to {turn:.3g} deg from the first"
        if name in ("q", "q_shown"):
            low, high = np.rad2deg([value.min(), value.max()])
            return f"{value.shape[1]} joints, {low:.4g} … {high:.4g} deg"
        if name in ("p_cmd", "p_meas", "p_origin", "p_load"):
            ends = zip("xyz", value.min(axis=0), value.max(axis=0), strict=True)
            frame = {"p_cmd": "base", "p_load": "flange"}.get(name, "tracker")
            return f"{', '.join(f'{axis} {low:.0f} … {high:.0f}' for axis, low, high in ends)} mm ({frame} frame)"
        if name in ("p_std", "rotation_std"):
            rms = float(np.sqrt((value**2).mean()))
            return f"{rms:.3g} mm per axis (RMS)" if name == "p_std" else f"{np.rad2deg(rms):.3g} deg per axis (RMS)"
        if name == "time":
            return f"{np.ptp(value):.4g} s from first to last"
        return "" if name == "approach" else f"{value.min():.4g} … {value.max():.4g} {_REPR_UNITS[name]}"

    def __getitem__(self, index: NDArray[Any] | slice) -> Self:
        """Return the rows selected by a mask, an index array or a slice."""
        return replace(self, **{name: getattr(self, name)[index] for name in self.columns()})

    def to_frame(self) -> DataFrame:
        """Return a pandas table with the columns of the tidy table, in mm and deg; needs pandas.

        Examples
        --------
        >>> frame = Poses(q=np.radians([[10.0, 20.0], [30.0, 40.0]])).to_frame()
        >>> list(frame.columns), len(Poses.from_frame(frame))
        (['row', 'q1_deg', 'q2_deg'], 2)
        """
        return data_frame(self.table_columns())

    def table_columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the tidy table by full name, in mm and deg."""
        return tidy_columns({name: getattr(self, name) for name in self.columns()})

    @classmethod
    def from_frame(cls, frame: DataFrame, source: str = "frame") -> Self:
        """Return the table that a pandas table holds.

        Parameters
        ----------
        frame : pandas.DataFrame
            A table with the columns of the tidy table, such as ``q1_deg``, ``x_cmd_mm`` or ``x_meas_m``; columns with
            other names are ignored.
        source : str
            The origin of the table, for messages.

        Raises
        ------
        FileError
            If a column is missing, misspelt or without unit, or a value is not a number; with the row, from 1.
        """
        table = text_table(frame, source)
        return cls(**quantities(table, measured=False), source=source)

    @property
    def given_joints(self) -> FloatArray | None:
        """The joints of the table, (n, dof) [rad]: of the model or as shown; to compare rows with each other."""
        return self.q_shown if self.q is None else self.q

    def columns(self) -> list[str]:
        """Return the names of the quantities that this table holds."""
        return [f.name for f in fields(self) if f.name not in _ABOUT and getattr(self, f.name) is not None]

    def error(self, message: str, which: NDArray[Any] | None = None) -> DataError:
        """Return an error that names this table, and rows of it (a mask, or indices)."""
        return DataError(
            f"{self.source}: {message}" if which is None else f"{self.source}: {self.rows(which)}: {message}"
        )

    def rows(self, which: NDArray[Any]) -> str:
        """Return the names of rows (a mask, or indices) for a message: "points P3 (line 4), P7 (line 8) and 12 more".

        Without names it is "line 4"; for a table that is no file and has no names, "row 3", counted from 0.
        """
        which = np.asarray(which)
        index = np.flatnonzero(which) if which.dtype == np.bool_ else which
        return name_points([self.identify(int(i)) for i in index])

    def identify(self, i: int) -> dict[str, Any]:
        """Return the ``row``, ``point`` and ``line`` of a sample by its index, for JSON; None where not known.

        The point of a row of several reflectors is named with its reflector: "P3/A".
        """
        words = [str(one[i]) for one in (self.name, self.reflector) if one is not None]
        return {
            "row": i if self.row is None else int(self.row[i]),
            "point": "/".join(filter(None, words)) or None,
            "line": None if self.line is None else int(self.line[i]),
        }


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Distances(Poses):
    """Commanded configurations and the distance of the tool point from a fixed point at each.

    Parameters
    ----------
    distance : (m,) array [mm]
        The measured distances.
    distance_std : (m,) array [mm], optional
        The standard deviations of the readings; by default those of the cell file.
    origin : (m,) array of str, optional
        The fixed points, names in the cell's ``[distances]``.
    p_origin : (m, 3) array [mm], tracker frame, optional
        The fixed points; by default those of the cell file.
    time : (m,) array [s], optional
        The times of the readings.
    **commanded
        The commanded quantities, see `Poses`; joints are required.
    """

    distance: FloatArray
    distance_std: FloatArray | None = None
    origin: NDArray[np.str_] | None = None
    p_origin: FloatArray | None = None
    time: FloatArray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Samples(Poses):
    """Commanded configurations and the reading of the tracker at each.

    Parameters
    ----------
    p_meas : (n, 3) array [mm], tracker frame
        The measured positions of the reflector.
    rotation_meas : Rotation of length n, optional
        The measured orientations, tracker frame.
    p_std : (n, 3) array [mm], tracker frame, optional
        The standard deviation of each reading.
    rotation_std : (n, 3) array [rad], optional
        The standard deviation of the measured orientation.
    time : (n,) array [s], optional
        The time of each reading.
    excluded : tuple of dict
        The masked rows that are not among these samples, by ``row``, ``point`` and ``line``, with the ``reason``; see
        `truepose.samples.masks`.
    distances : Distances, optional
        Distances from fixed points, at the same or other poses; see `truepose.samples.distances`. Part of the samples
        have all of them.
    facts : tuple of (str, str)
        What the import found about the readings: the code of each fact (see docs/facts.md) and its words.
    **commanded
        The commanded quantities, see `Poses`; all but `p_meas` by keyword.

    Examples
    --------
    >>> samples = Samples(np.array([[0.0, 0.0, 1.0], [5.0, 0.0, 1.0]]), q=np.zeros((2, 6)))
    >>> samples
    Samples: 2 rows from samples
      q:      6 joints, 0 … 0 deg
      p_meas: x 0 … 5, y 0 … 0, z 1 … 1 mm (tracker frame)
    """

    p_meas: FloatArray
    rotation_meas: Rotation | None = None
    p_std: FloatArray | None = None
    rotation_std: FloatArray | None = None
    time: FloatArray | None = None
    excluded: tuple[dict[str, Any], ...] = ()
    distances: Distances | None = None
    facts: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, found: Mapping[str, Any], source: str) -> Self:
        """Return the samples of `truepose.samples.masked.counted_quantities`, with their distances."""
        own = found.get("distances")
        distances = None if own is None else Distances(**own, source=source)
        return cls(**{**found, "distances": distances}, source=source)

    @classmethod
    def from_frame(cls, frame: DataFrame, source: str = "frame") -> Self:
        """Return the samples that a pandas table holds; see `Poses.from_frame`."""
        found = counted_quantities(text_table(frame, source))
        del found["line"]
        return cls.of(found, source)

    def table_columns(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the tidy table by full name, in mm and deg; distances are rows after positions.

        What a row does not have is NaN, or an empty word.
        """
        own = super().table_columns()
        return own if self.distances is None else together(own, self.distances.table_columns())
