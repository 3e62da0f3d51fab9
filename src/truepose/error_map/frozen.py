"""A map as plain arrays: predictions in microseconds for control loops, and by the million."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal, Protocol, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose._io import archive, files
from truepose._typing import FloatArray
from truepose.error_map.frozen_parts import from_arrays, to_arrays
from truepose.error_map.prediction import PredictingMap
from truepose.errors import DataError, FileError, RobotError
from truepose.geometry import check_transforms
from truepose.numerics.frozen import Constants, Scratch, predict, scratch
from truepose.numerics.frozen_deviation import Deviation, deviations
from truepose.numerics.threads import blas_threads, kernel_count
from truepose.predictors.abilities import DeviationFreezable, Freezable

LARGEST_DIFFERENCE_MM: Final = 1e-3
"""The largest difference between a frozen map and its map [mm]; a map that differs more is not frozen."""

_LARGEST_FILE: Final = 2**28  # bytes
_PROBES: Final = 2000  # random poses at which a frozen map is compared with its map
_KEPT: Final = 50  # of these in the file, which is compared with them when it is read
_SAME_MM: Final = 1e-7  # processors differ by less
_CHUNK: Final = 4096  # poses at a time of a thread
_CHUNK_STD: Final = 512
_ARRAYS: Final = ("tf_flange_tool", "probes", "probed", "probed_std")
_KEYS: Final = ("difference_mm", "map_sha256", "predictor", "robot")


class Hashed(Protocol):
    """A map that knows the SHA-256 of its file."""

    @property
    def hash(self) -> str:
        """The SHA-256 of the map's file."""


@dataclass(frozen=True, eq=False, repr=False)
class FrozenMap:
    """The predicted errors of an error map as plain arrays; made by `ErrorMap.freeze`.

    It predicts for one tool point, and its mean equals that of `ErrorMap.predict` to `difference_mm`. It has no guards
    as `ErrorMap.correct` has: check the poses of a process with the map first. Its standard deviation, where it was
    frozen too, is an upper bound: below that of the map by less than 1 nm, and rarely more than 1 % above it among the
    samples.

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
    deviation : Deviation, optional
        The arrays of the standard deviation, see `truepose.numerics.frozen_deviation.Deviation`.
    probed_std : (50, 3) array [mm]
        The standard deviations at the probes; (0, 3) without `deviation`.

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
    deviation: Deviation | None = None
    probed_std: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def __repr__(self) -> str:
        std = "" if self.deviation is None else ", with standard deviation"
        return (
            f"<FrozenMap of {self.robot}: {self.predictor}, within {1e3 * self.difference_mm:.2g} µm of the map "
            f"{self.map_sha256[:12]}{std}>"
        )

    @property
    def n_joints(self) -> int:
        """The number of joints."""
        return len(self.constants.sign)

    @overload
    def predict(self, q: ArrayLike, return_std: Literal[False] = ...) -> FloatArray: ...
    @overload
    def predict(self, q: ArrayLike, return_std: Literal[True]) -> tuple[FloatArray, FloatArray]: ...
    def predict(self, q: ArrayLike, return_std: bool = False) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Return the predicted positional errors, measured − commanded.

        Parameters
        ----------
        q : (n, dof) or (dof,) array_like [rad]
            The commanded joints.
        return_std : bool
            Whether to return the standard deviation as well.

        Returns
        -------
        e : (n, 3) or (3,) array [mm], base frame
            The errors.
        std : (n, 3) or (3,) array [mm], base frame
            Upper bounds of the standard deviation of `ErrorMap.predict_errors`; only with `return_std`.

        Raises
        ------
        DataError
            If the shape is wrong, a number is not finite, or the map was frozen without standard deviation.
        RobotError
            If joints are beyond the limits of the robot; the row is named.
        """
        joints = np.array(q, np.float64, order="C")  # a copy can be written, as the compiled types state
        if joints.ndim not in (1, 2) or joints.shape[-1:] != (self.n_joints,):
            raise DataError(f"expected joints of shape (n, {self.n_joints}) for {self.robot}, got {joints.shape}")
        rows = joints.reshape(-1, self.n_joints)
        out = np.empty((len(rows), 3))
        std = np.empty_like(out) if return_std else None
        if std is not None and self.deviation is None:
            raise DataError("the map was frozen without its standard deviation; use error_map.freeze(std=True)")

        def part(here: slice) -> int:
            beyond = predict(rows[here], out[here], self.constants, scratch(self.constants))
            if std is not None and self.deviation is not None and not beyond:
                std[here] = deviations(rows[here], self.constants, self.deviation)
            return beyond

        with blas_threads(1):
            if any(_in_parts(part, len(rows), _CHUNK if std is None else _CHUNK_STD)):
                raise self._refused(rows)
        shape = (*joints.shape[:-1], 3)
        return out.reshape(shape) if std is None else (out.reshape(shape), std.reshape(shape))

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
        for array, width in ((q, self.n_joints), (out, 3)):
            if not (type(array) is np.ndarray and array.dtype == np.float64 and array.flags.c_contiguous):
                raise DataError("predict_into needs contiguous arrays of float64; use predict for others")
            if array.shape[-1:] != (width,) or array.ndim != q.ndim or q.ndim > 2 or array.shape[:-1] != q.shape[:-1]:
                raise DataError(
                    f"expected q (n, {self.n_joints}) and out (n, 3), or one row each; got {q.shape}, {out.shape}"
                )
        if q.ndim == 1:
            q, out = q[None], out[None]
        if not out.flags.writeable:
            raise DataError("out cannot be written; predict_into needs an array of its own")
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
        return to_arrays(self.constants, self.deviation) | {name: getattr(self, name) for name in _ARRAYS}

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
        constants, deviation = from_arrays(arrays)
        fields: dict[str, Any] = {name: arrays.pop(name) for name in _ARRAYS}
        if arrays:
            raise ValueError(f"it holds {min(arrays)}, which is not part of a frozen map")
        if not all(array.dtype == np.float64 for array in fields.values()):
            raise TypeError("an array is not one of floating-point numbers")
        frozen = cls(**content, **fields, constants=constants, deviation=deviation)
        frozen._check_facts()
        return frozen

    def _check_facts(self) -> None:
        """Require plain facts of the right kind, and the predictions that the file states."""
        names = (self.robot, self.predictor, self.map_sha256)
        if not all(isinstance(name, str) for name in names) or type(self.difference_mm) is not float:
            raise TypeError("robot, predictor and map_sha256 must be text, difference_mm a number")
        check_transforms("tf_flange_tool", self.tf_flange_tool[None])
        if self.probes.shape != (_KEPT, self.n_joints) or self.probed.shape != (_KEPT, 3):
            raise ValueError(f"it has probes of shape {self.probes.shape}, expected {(_KEPT, self.n_joints)}")
        found, stated = [self.predict(self.probes)], [self.probed]
        if self.deviation is not None:
            found, stated = list(self.predict(self.probes, return_std=True)), [self.probed, self.probed_std]
        elif self.probed_std.shape != (0, 3):
            raise ValueError("it has standard deviations of probes, and no arrays that predict them")
        for one, other in zip(found, stated, strict=True):
            if one.shape != other.shape or not np.abs(one - other).max() <= _SAME_MM:
                raise ValueError("its arrays predict other errors or standard deviations than the file states")


def _in_parts(work: Callable[[slice], int], n: int, size: int) -> list[int]:
    """Do the work on parts of at most `size` rows, and return the results; several parts run in threads."""
    parts, count = [slice(start, start + size) for start in range(0, n, size)], kernel_count()
    if len(parts) == 1 or count == 1:
        return [work(part) for part in parts]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(work, parts))


def freeze(
    error_map: PredictingMap, sha256: str, tf_flange_tool: ArrayLike | None = None, *, std: bool = False
) -> FrozenMap:
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
    kept = probes[:_KEPT].copy()
    frozen = replace(frozen, difference_mm=difference, probes=kept, probed=predicted[:_KEPT].copy())
    if not std:
        return frozen
    frozen = replace(frozen, deviation=_deviation(error_map, frozen, probes))
    return replace(frozen, probed_std=frozen.predict(kept, return_std=True)[1])


def _deviation(error_map: PredictingMap, frozen: FrozenMap, probes: FloatArray) -> Deviation:
    """Return the arrays of the standard deviation, with a margin for the error of their tables.

    The error is measured at the random probes and among the samples; four times the largest found is the margin.

    Raises
    ------
    DataError
        If the predictor has none, or the tool point is not the measured one.
    """
    predictor, samples = error_map.predictor, error_map.samples
    if not isinstance(predictor, DeviationFreezable):
        raise DataError(
            f"a map of {error_map.predictor_name!r} has no frozen standard deviation, only kinematic-kriging has: "
            "freeze without std, or use ErrorMap.predict_errors"
        )
    if frozen.constants.away.any():
        raise DataError("the standard deviation is frozen at the measured point only: omit std, or the tool")
    assert samples.q is not None
    rng = np.random.default_rng(1)
    one, other = rng.integers(len(samples), size=(2, 2 * _PROBES))
    among = samples.q[one] + rng.uniform(size=(2 * _PROBES, 1)) * (samples.q[other] - samples.q[one])
    deviation = predictor.deviation(frozen.constants, among[:_PROBES], error_map.unexplained)
    tried = np.concatenate([probes, among[_PROBES:]])
    bound = replace(frozen, deviation=deviation).predict(tried, return_std=True)[1]
    below = float((error_map.predict_at(tried)[1] - bound).max())
    margin = np.array([4.0 * max(below, 0.0)])
    return Deviation(**deviation._asdict() | {"margin": margin})
