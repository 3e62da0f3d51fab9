"""A map as plain arrays: predictions in microseconds for control loops, and by the million."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose._io import archive, files
from truepose._typing import FloatArray
from truepose.error_map.prediction import PredictingMap
from truepose.errors import DataError, FileError, RobotError
from truepose.geometry import check_transforms
from truepose.numerics.frozen import UNROLLED, Constants, Scratch, predict, scratch
from truepose.numerics.threads import kernel_count
from truepose.predictors.abilities import Freezable

LARGEST_DIFFERENCE_MM: Final = 1e-3
"""The largest difference between a frozen map and its map [mm]; a map that differs more is not frozen."""

_LARGEST_FILE: Final = 2**28  # bytes
_PROBES: Final = 2000  # random poses at which a frozen map is compared with its map
_KEPT: Final = 50  # of these in the file, which is compared with them when it is read
_SAME_MM: Final = 1e-7  # processors differ by less
_CHUNK: Final = 4096  # poses of a thread
_KEYS: Final = ("difference_mm", "map_sha256", "predictor", "robot")


class Hashed(Protocol):
    """A map that knows the SHA-256 of its file."""

    @property
    def hash(self) -> str:
        """The SHA-256 of the map's file."""


@dataclass(frozen=True, eq=False, repr=False)
class FrozenMap:
    """The predicted errors of an error map as plain arrays; made by `ErrorMap.freeze`.

    It predicts the mean only, for one tool point, and equals `ErrorMap.predict` to `difference_mm`. It has neither the
    guards of `ErrorMap.correct` nor a standard deviation: check the poses of a process with the map first.

    Attributes
    ----------
    robot : str
        The name of the nominal robot.
    predictor : str
        The name of the map's predictor.
    map_sha256 : str
        The hash of the map's file, `ErrorMap.hash`.
    tf_flange_tool : (4, 4) array [mm]
        The tool whose point is predicted.
    difference_mm : float [mm]
        The largest difference from the map at 2,000 random poses within the limits of the joints.
    constants : Constants
        The arrays, see `truepose.numerics.frozen.Constants`.
    probes, probed : (50, dof) array [rad], (50, 3) array [mm]
        Some of the random poses, and the predictions there, with which a file is compared when it is read.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose import VirtualCell, fit_cell
    >>> virtual = VirtualCell("paper")
    >>> frozen = fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "calibration").freeze()
    >>> frozen.predict(virtual.design(5, seed=1)).shape
    (5, 3)
    >>> q, e = virtual.design(5, seed=1)[0], np.empty(3)
    >>> frozen.predict_into(q, e)
    """

    robot: str
    predictor: str
    map_sha256: str
    tf_flange_tool: FloatArray
    difference_mm: float
    constants: Constants
    probes: FloatArray
    probed: FloatArray

    def __repr__(self) -> str:
        return (
            f"<FrozenMap of {self.robot}: {self.predictor}, within {1e3 * self.difference_mm:.2g} µm of the map "
            f"{self.map_sha256[:12]}>"
        )

    @property
    def dof(self) -> int:
        """The number of joints."""
        return len(self.constants.sign)

    def predict(self, q: ArrayLike) -> FloatArray:
        """Return the predicted positional errors, measured − commanded.

        Parameters
        ----------
        q : (n, dof) or (dof,) array_like [rad]
            The commanded joints.

        Returns
        -------
        (n, 3) or (3,) array [mm], base frame

        Raises
        ------
        DataError
            If the shape is wrong, or a number is not finite.
        RobotError
            If joints are beyond the limits of the robot; the row is named.
        """
        joints = np.array(q, np.float64, order="C")  # a copy can be written, as the compiled types state
        if joints.ndim not in (1, 2) or joints.shape[-1:] != (self.dof,):
            raise DataError(f"expected joints of shape (n, {self.dof}) for {self.robot}, got {joints.shape}")
        rows = joints.reshape(-1, self.dof)
        out = np.empty((len(rows), 3))
        starts, count = range(0, len(rows), _CHUNK), kernel_count()

        def part(start: int) -> int:
            here = slice(start, start + _CHUNK)
            return predict(rows[here], out[here], self.constants, scratch(self.constants))

        if len(starts) > 1 and count > 1:
            with ThreadPoolExecutor(count) as pool:
                beyond = sum(pool.map(part, starts))
        else:
            beyond = sum(map(part, starts))
        if beyond:
            raise self._refused(rows)
        return out.reshape(*joints.shape[:-1], 3)

    def predict_into(self, q: FloatArray, out: FloatArray) -> None:
        """Write the predicted errors into an array, in some microseconds and without new memory: for control loops.

        The memory of the computation belongs to this object, so two threads must not call it at the same time.

        Parameters
        ----------
        q : (n, dof) or (dof,) array of float64 [rad]
            The commanded joints, contiguous.
        out : (n, 3) or (3,) array of float64 [mm], base frame
            The errors, measured − commanded, contiguous; NaN for joints that are refused.

        Raises
        ------
        DataError
            If an array has another shape or type, or a number is not finite.
        RobotError
            If joints are beyond the limits of the robot.
        """
        for array, width in ((q, self.dof), (out, 3)):
            if not (type(array) is np.ndarray and array.dtype == np.float64 and array.flags.c_contiguous):
                raise DataError("predict_into needs contiguous arrays of float64; use predict for others")
            if array.shape[-1:] != (width,) or array.ndim != q.ndim or q.ndim > 2 or array.shape[:-1] != q.shape[:-1]:
                raise DataError(
                    f"expected q (n, {self.dof}) and out (n, 3), or one row each; got {q.shape}, {out.shape}"
                )
        if q.ndim == 1:
            q, out = q[None], out[None]
        if not q.flags.writeable:  # numba would compile another function for it
            q = q.copy()
        if predict(q, out, self.constants, self._scratch):
            raise self._refused(q)

    @cached_property
    def _scratch(self) -> Scratch:
        return scratch(self.constants)

    def _refused(self, rows: FloatArray) -> DataError | RobotError:
        """Return the error for joints that are not finite or beyond the limits."""
        limits = self.constants.limits
        row = int(np.argmin(((rows >= limits[:, 0]) & (rows <= limits[:, 1])).all(axis=1)))
        if not np.isfinite(rows[row]).all():
            return DataError(f"joints have NaN or infinity in row {row}; remove these rows")
        j = int(np.argmin((rows[row] >= limits[:, 0]) & (rows[row] <= limits[:, 1])))
        low, high = np.rad2deg(limits[j])
        return RobotError(
            f"{self.robot}: row {row} joint {j + 1} at {np.rad2deg(rows[row, j]):.3f} deg, limits {low:.6g} to "
            f"{high:.6g}; check joint order, sign and unit"
        )

    def check_map(self, error_map: Hashed) -> None:
        """Require that this is the frozen form of a map.

        Raises
        ------
        DataError
            If the map is another one, or was fitted or updated again since it was frozen.
        """
        if error_map.hash != self.map_sha256:
            raise DataError(
                f"the frozen map belongs to the map {self.map_sha256[:12]}, not to {error_map.hash[:12]}: the map was "
                "changed since; freeze it again"
            )

    def save(self, path: str | Path) -> None:
        """Write the frozen map to a file (zip of JSON and .npy), whole or not at all."""
        content = {key: getattr(self, key) for key in _KEYS}
        files.write_atomic(path, archive.pack(content, self._arrays(), archive.FROZEN))

    def _arrays(self) -> dict[str, NDArray[Any]]:
        arrays = {f"constants.{name}": array for name, array in self.constants._asdict().items()}
        arrays["constants.links"] = self.constants.links.reshape(-1, 3, 4)
        arrays["constants.tables"] = self.constants.tables.T
        return arrays | {"tf_flange_tool": self.tf_flange_tool, "probes": self.probes, "probed": self.probed}

    @classmethod
    def load(cls, path: str | Path, error_map: Hashed | None = None) -> Self:
        """Read a frozen map that `save` wrote. Nothing in the file is executed.

        Parameters
        ----------
        path : str or Path
            The file.
        error_map : ErrorMap, optional
            The map that it must belong to, see `check_map`.

        Raises
        ------
        FileError
            If the file is not a frozen map, truncated, changed since it was written, or contradicts itself.
        DataError
            If it belongs to another map than `error_map`.
        """
        content, arrays = archive.unpack(files.read_bytes(path, _LARGEST_FILE), path, archive.FROZEN)
        try:
            frozen = cls._of(content, arrays)
        except (LookupError, TypeError, ValueError, OverflowError) as error:
            what = f"has no {error}" if isinstance(error, KeyError) else str(error)
            raise FileError(path, f"does not hold a whole frozen map ({what}); freeze the map again") from None
        if error_map is not None:
            frozen.check_map(error_map)
        return frozen

    @classmethod
    def _of(cls, content: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Self:
        """Return the frozen map of a file's parts; raise ValueError, TypeError or KeyError where they are wrong."""
        if sorted(content) != sorted(_KEYS):
            raise ValueError(f"it has the parts {', '.join(sorted(content))}, expected {', '.join(_KEYS)}")
        given = {name: arrays.pop(f"constants.{name}") for name in Constants._fields}
        fields: dict[str, Any] = {name: arrays.pop(name) for name in ("tf_flange_tool", "probes", "probed")}
        if arrays:
            raise ValueError(f"it holds {min(arrays)}, which is not part of a frozen map")
        if not all(array.dtype == np.float64 for array in (*given.values(), *fields.values())):
            raise TypeError("an array is not one of floating-point numbers")
        if given["links"].ndim != 3:
            raise ValueError(f"links has shape {given['links'].shape}, expected (2 dof + 2, 3, 4)")
        given["links"] = given["links"].reshape(2, -1, 3, 4)
        given["tables"] = np.ascontiguousarray(given["tables"].T)
        constants = Constants(**given)
        _check(constants)
        frozen = cls(**content, **fields, constants=constants)
        frozen._check_facts()
        return frozen

    def _check_facts(self) -> None:
        """Require plain facts of the right kind, and the predictions that the file states."""
        names = (self.robot, self.predictor, self.map_sha256)
        if not all(isinstance(name, str) for name in names) or type(self.difference_mm) is not float:
            raise TypeError("robot, predictor and map_sha256 must be text, difference_mm a number")
        check_transforms("tf_flange_tool", self.tf_flange_tool[None])
        if self.probes.shape != (_KEPT, self.dof) or self.probed.shape != (_KEPT, 3):
            raise ValueError(f"it has probes of shape {self.probes.shape}, expected {(_KEPT, self.dof)}")
        off = float(np.abs(self.predict(self.probes) - self.probed).max())
        if not off <= _SAME_MM:
            raise ValueError(f"its arrays predict other errors than the file states, by up to {off:.3g} mm")


def freeze(error_map: PredictingMap, sha256: str, tf_flange_tool: ArrayLike | None = None) -> FrozenMap:
    """Return the frozen form of the map whose file has this SHA-256; see `ErrorMap.freeze`."""
    predictor, name = error_map.predictor, error_map.predictor_name
    if not isinstance(predictor, Freezable):
        raise DataError(
            f"a map of {name!r} cannot be frozen: its predictor does not know the arm; fit kinematic-kriging or "
            "calibration (truepose fit --predictor kinematic-kriging), or predict with the map itself"
        )
    tool = error_map.tf_flange_tool if tf_flange_tool is None else check_transforms("tf_flange_tool", tf_flange_tool)
    sampled = error_map.tf_flange_sampled
    constants = predictor.constants()
    constants = constants._replace(away=sampled[:3, :3].T @ (tool[:3, 3] - sampled[:3, 3]))
    low, high = np.clip(error_map.robot.limits, -np.pi, np.pi).T
    probes = np.random.default_rng(0).uniform(low, high, (_PROBES, len(low)))
    empty = np.empty((0, 3))
    frozen = FrozenMap(error_map.robot.name, name, sha256, tool.copy(), 0.0, constants, probes[:0], empty)
    predicted = frozen.predict(probes)
    difference = float(np.linalg.norm(predicted - error_map.predict_mean_with_tool(probes, tool), axis=1).max())
    if not difference <= LARGEST_DIFFERENCE_MM:
        raise DataError(
            f"the frozen map would differ from the map by {difference:.3g} mm, more than {LARGEST_DIFFERENCE_MM:g} mm: "
            "joint errors change too fast with the angle; predict with the map itself"
        )
    return replace(frozen, difference_mm=difference, probes=probes[:_KEPT].copy(), probed=predicted[:_KEPT].copy())


def _check(constants: Constants) -> None:
    """Require the shapes and values with which the compiled loop stays within its arrays; ValueError otherwise."""
    dof, places = len(constants.sign), len(constants.place_scale)
    blocks, width = len(constants.anchors), constants.anchors.shape[-1]
    shapes = {
        "links": (2, dof + 1, 3, 4),
        "sign": (dof,),
        "limits": (dof, 2),
        "twist": (dof + 1, 6),
        "tables": (dof, constants.tables.shape[-1]),
        "harmonics": (len(constants.harmonics), 4),
        "moment": (dof, dof + 1),
        "mass": (dof + 1, 3),
        "anchors": (blocks, places + 1, width),
        "weights": (blocks, 3, width),
        "place_scale": (places,),
        "by_joints": (1,),
        "away": (3,),
        "linear": (1,),
    }
    for name, shape in shapes.items():
        found = getattr(constants, name).shape
        if found != shape:
            raise ValueError(f"{name} has shape {found}, expected {shape}")
    for links in constants.links:
        check_transforms("links", np.concatenate([links, np.tile([0.0, 0.0, 0.0, 1.0], (dof + 1, 1, 1))], axis=1))
    joint, by_joints = constants.harmonics[:, 0], float(constants.by_joints[0])
    fits = {
        "sign": dof > 0 and bool(np.isin(constants.sign, (-1.0, 1.0)).all()),
        "limits": bool((constants.limits[:, 0] < constants.limits[:, 1]).all()),
        "tables": constants.tables.shape[1] != 1,
        "harmonics": bool(np.isin(joint, np.arange(dof)).all()),
        "place_scale": places % UNROLLED == 0,
        "by_joints": by_joints in (0.0, 2.0 * dof) and by_joints <= max(places, 0),
        "linear": bool(constants.linear[0] in (0.0, 1.0)),
    }
    if wrong := [name for name, right in fits.items() if not right]:
        raise ValueError(f"{wrong[0]} has impossible values")
