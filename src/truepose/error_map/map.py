"""The error map of a cell, from samples to corrections.

A map is made by `truepose.fit_cell`, used by `ErrorMap.predict` and `ErrorMap.correct`, and kept in a file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose._io import files
from truepose._io.archive import LARGEST_MAP
from truepose._io.tables import facts_table
from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell, ConditionsSection
from truepose.compensation import (
    Corrections,
    Guards,
    JointCoverage,
    Limits,
    LimitsInForce,
    Policy,
    Starts,
    supported_angle,
)
from truepose.error_map.conditions import check_work, conditions_of, work_of
from truepose.error_map.correction import Targets, correct
from truepose.error_map.encoding import from_bytes, to_bytes
from truepose.error_map.facts import Fact, refuse
from truepose.error_map.findings import facts_of
from truepose.error_map.frozen import FrozenMap, freeze
from truepose.error_map.guards import arm_branches, found_limits, stated_limits
from truepose.error_map.points import first_of_visits
from truepose.error_map.prediction import PredictingMap
from truepose.error_map.repeatability import Repeatability
from truepose.error_map.validation import Validation, validate
from truepose.errors import DataError
from truepose.predictors.abilities import Conditional, JointwisePredicting
from truepose.samples import Poses, Samples

_WEAK: Final = ("weak", "constant-std")
"""The facts that ``accept_weak_map`` accepts."""


@dataclass(frozen=True, eq=False, repr=False)
class ErrorMap(PredictingMap):
    """The positional errors of one cell as a function of the commanded pose; made by `fit_cell`.

    Its fields are those of `truepose.error_map.data.MapData`, its predictions those of
    `truepose.error_map.prediction.PredictingMap`.

    Examples
    --------
    >>> from truepose import VirtualCell, fit_cell
    >>> virtual = VirtualCell("paper")
    >>> error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "ordinary-kriging")
    >>> commands = error_map.correct(virtual.design(3, seed=1))
    >>> commands.p_command.shape
    (3, 3)
    """

    def __repr__(self) -> str:
        return "\n".join(["ErrorMap", *(f"  {name:10} {text}" for name, text in self._summary.items())])

    def _repr_html_(self) -> str:
        return facts_table("ErrorMap", self._summary)

    @property
    def _summary(self) -> dict[str, str]:
        tool = "" if self.cell.tool.fit == "none" else f", tool {self.cell.tool.fit} fitted"
        left_out = f", {len(self.excluded)} left out" if self.excluded else ""
        distances = self.samples.distances
        more = "" if distances is None else f" and {len(distances)} distances"
        std = np.linalg.norm(self.predict_errors(self.samples)[1], axis=1)
        checked = "checked" if self.arm_check.checked else "not checked"
        return {
            "cell": f"{self.robot.name}{tool}; arm and tool {checked}",
            "predictor": f"{self.predictor_name} ({'joint' if self.space == 'joint' else 'Cartesian'} space)",
            "samples": f"{len(self.samples)}{more}{left_out}",
            "std": f"{np.median(std):.3f} mm at the samples (median), {std.max():.3f} mm (max)",
            "worth": self.worth.brief,
        }

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the map's file as truepose wrote it, whichever version did; of a file packed again the same."""
        return hashlib.sha256(self._bytes).hexdigest() if self.stored is None else self.stored.sha256

    @property
    def path(self) -> Path | None:
        """The file that the map was read from; None for a new one."""
        return None if self.stored is None else self.stored.path

    @cached_property
    def _bytes(self) -> bytes:
        return to_bytes(self)

    def save(self, path: str | Path) -> None:
        """Write the map to a file (zip of JSON and .npy), whole or not at all."""
        files.write_atomic(path, self._bytes)

    def at_work(self, conditions: ConditionsSection | Cell) -> Self:
        """Return the map for another temperature or payload at work.

        Parameters
        ----------
        conditions : ConditionsSection or Cell
            The ``[conditions]`` of a cell; what they do not state stays as it is. Of a cell also the mass of its
            ``[payload]``, which is that at work where its conditions state none and the payload of the samples is
            known.

        Raises
        ------
        DataError
            If the samples do not state a condition that is stated for work.
        """
        stated = conditions.at_work if isinstance(conditions, ConditionsSection) else self._stated_by(conditions)
        if stated.items() <= self.cell.conditions.at_work.items():
            return self
        cell = self.cell.model_copy(update={"conditions": self.cell.conditions.model_copy(update=stated)})
        check_work(self.samples, cell)
        predictor = self.predictor.at_work(work_of(cell)) if isinstance(self.predictor, Conditional) else self.predictor
        return self.changed(cell=cell, predictor=predictor)

    def _stated_by(self, cell: Cell) -> dict[str, Any]:
        """Return the conditions at work that another cell states, by key of ``[conditions]``."""
        stated = cell.conditions.at_work
        known, mass = conditions_of(self.samples, self.cell), cell.payload.mass_kg
        if "payload_kg" not in stated and "payload" in known and mass and mass != work_of(self.cell).get("payload"):
            stated["payload_kg"] = mass
        return stated

    def freeze(self, tf_flange_tool: ArrayLike | None = None, *, std: bool = False) -> FrozenMap:
        """Return the map's predictions as plain arrays, which predict one pose in some microseconds.

        Parameters
        ----------
        tf_flange_tool : (4, 4) array_like [mm], optional
            The tool whose point is predicted; default: that of the map.
        std : bool
            Whether to freeze the standard deviation as well (kinematic Kriging, at the measured point): some MB, and
            an upper bound of that of the map.

        Returns
        -------
        FrozenMap
            Its mean equals the predictions of the map to 1 µm, and knows the map's hash.

        Raises
        ------
        DataError
            If the predictor does not know the arm, as Kriging and interpolators do not; if it knows backlash; if the
            frozen map would differ by more than 1 µm; or if `std` is wanted where it is not available.
        """
        return freeze(self, self.hash, tf_flange_tool, std=std)

    def validate(self, held_out: Samples, *, rivals: bool = True) -> Validation:
        """Compare errors before and after on samples that took no part in the fit.

        Parameters
        ----------
        held_out : Samples
            The commanded poses and readings, from the station of the map.
        rivals : bool
            Whether to look for a predictor that would do far better (`Validation.better`); takes about a second for a
            map that does not know the arm.

        Returns
        -------
        Validation
            The figures; their intervals include the uncertainty of the prediction and the noise of readings.

        Raises
        ------
        DataError
            If the samples lack joints or positions that the map needs, or prove another tool.
        """
        return validate(self, held_out, rivals=rivals)

    def correct(
        self,
        poses: Poses | ArrayLike,
        *,
        tf_flange_tool: ArrayLike | None = None,
        status: IntArray | None = None,
        turn: IntArray | None = None,
        near: FloatArray | None = None,
        before: FloatArray | Starts | None = None,
        load: FloatArray | None = None,
        p_load: FloatArray | None = None,
        on_guard: Policy | None = None,
        limits: LimitsInForce | None = None,
        orientation: bool = False,
        accept_weak_map: bool = False,
        accept: Collection[str] = (),
    ) -> Corrections:
        """Return the commands whose predicted outcome is the target (16), guarded.

        Parameters
        ----------
        poses : (n, 4, 4) array [mm], (n, dof) array [rad], (n, 3) array [mm], or Poses
            The targets: poses of the tool in the base frame, joints, or positions at the samples' orientation. A table
            of Poses gives joints, or commanded positions with their orientations.
        tf_flange_tool : (n, 4, 4) or (4, 4) array [mm], optional
            The tool of each target; the measured one by default.
        status, turn : (n,) arrays of int, optional
            The KUKA configuration of each target, −1 where it is not given. Joints name it themselves.
        near : (n, dof) array [rad], optional
            The joints near which the controller reaches each target, NaN where they are not known. They take precedence
            over Status and Turn, which controllers ignore at straight, circular and spline motions.
        before : (n, 4, 4) array [mm], base frame, or Starts, optional
            The poses from which the tool comes straight to each target, NaN where that is not known: they tell the side
            of its backlash on which each joint stands. `Starts` tells joint motions as well, and a table of Poses may
            state ``approach`` instead. Without any of these, targets are taken to be reached as the samples were.
        load : (n,) array [kg], optional
            The mass on the flange at each target; NaN where it is that at work. A table of Poses states its own, and
            temperatures.
        p_load : (n, 3) array [mm], flange frame, optional
            The centre of this mass; NaN where it is that of the cell's payload.
        on_guard : {"refuse", "skip", "clip"}, optional
            The policy, instead of the one that `limits` names. Under ``refuse`` the verdicts say which targets refuse
            the program; the caller stops then.
        limits : LimitsInForce, optional
            The limits of corrections, see `limits_in_force`; by default those of the map's own cell.
        orientation : bool
            Whether to solve for orientation together with position: R_c = exp(−ŵ) R_t.
        accept_weak_map : bool
            Whether to use a map that is not shown to be better than no map (see `worth`), or whose predictor has one
            standard deviation for all poses, as interpolators have.
        accept : collection of str
            The codes of `facts` that refuse corrections and are accepted; ``weak`` and ``constant-std`` are what
            `accept_weak_map` accepts.

        Returns
        -------
        Corrections

        Raises
        ------
        RefusedError
            If one of the map's `facts` refuses corrections and is not accepted.
        DataError
            If a target is no pose; if the map predicts in joint space or orientation is asked for, and only positions
            were given; if the map knows no orientation.
        RobotError
            If the number of joints is wrong.

        Notes
        -----
        A predictor in joint space is evaluated at the joints by which the controller reaches the command: on the branch
        of the given joints, or nearest to `near`, or that of Status and Turn, or that of the nearest sample.
        """
        self.refuse_to_correct(accept, accept_weak_map=accept_weak_map)
        limits = limits or self.limits_in_force()
        tool = self.tf_flange_tool if tf_flange_tool is None else tf_flange_tool
        targets = Targets.of(self.robot, poses, tool, status, turn, near, before, load, p_load)
        guards = self.guards_of(limits.limits)
        return correct(self, targets, guards, on_guard or limits.on_guard, orientation=orientation)

    @cached_property
    def facts(self) -> list[Fact]:
        """What is known about this map beside its predictions, each with its effect on corrections.

        Facts that refuse corrections come first; `truepose.error_map.facts.CODES` explains each code.
        """
        return facts_of(self)

    def refuse_to_correct(self, accept: Collection[str] = (), *, accept_weak_map: bool = False) -> list[str]:
        """Refuse where a fact forbids corrections; return the sentences of those that are accepted.

        Raises
        ------
        RefusedError
            If a fact refuses corrections and is not accepted.
        """
        return refuse(self.facts, {*accept, *(_WEAK if accept_weak_map else ())})

    def limits_in_force(self, cell: Cell | None = None, **options: Any) -> LimitsInForce:
        """Return the limits of corrections and the origin of each.

        An option wins over the cell file, the cell file over this map's own cell, and that over the defaults; each
        origin replaces only the settings that it states.

        Parameters
        ----------
        cell : Cell, optional
            A cell file that is used instead of the map's own.
        **options
            Settings of ``[correction]``, by key; None is not stated.

        Raises
        ------
        DataError
            If a stated limit can have no effect on this map.
        """
        limits = stated_limits(self.cell, cell, options, self.space)
        stated = self.cell if cell is None or cell.robot.repeatability_mm is None else cell
        known = Repeatability.of(stated, self.robot)
        limits = found_limits(limits, self.guards_of(limits.limits), self.space, known)
        if self.space == "cartesian" and self.rotation is not None:
            angle = float(np.rad2deg(self.supported_angle))
            limits = limits.at_most("max_angle_deg", angle, "as far as the samples' orientations support it")
        return limits

    @cached_property
    def rotation(self) -> Rotation | None:
        """Orientations of the tool at the samples, base frame; None where they are unknown."""
        if self.samples.q is None:
            return self.samples.rotation_cmd
        return Rotation.from_matrix(self.robot.forward(self.samples.q, tool=self.tf_flange_tool)[:, :3, :3])

    @cached_property
    def supported_angle(self) -> float:
        """Largest angle to the samples' orientations at which a map in Cartesian space is valid [rad].

        See `truepose.compensation.supported_angle`.
        """
        if self.rotation is None:
            raise DataError(f"{self.samples.source}: the samples' orientations are unknown")
        return supported_angle(self.predictor.leave_blocks_out, self.rotation)

    @cached_property
    def joint_coverage(self) -> JointCoverage | None:
        """The angles of each joint that samples cover; None for predictors that know no error of single joints."""
        stated = self.cell.correction.max_joint_gap_deg
        return self._coverage(None if stated is None else float(np.deg2rad(stated)))

    def _coverage(self, limit: float | None) -> JointCoverage | None:
        predictor, q = self.predictor, self.samples.q
        if q is None or not isinstance(predictor, JointwisePredicting) or not len(predictor.joints_):
            return None
        return JointCoverage(q[first_of_visits(self.samples)], predictor.joints_, predictor.joint_length_, limit)

    def guards_of(self, limits: Limits) -> Guards:
        """Return the guards of corrections under some limits."""
        if limits not in self._guards:
            rows, point = first_of_visits(self.samples), self.tf_flange_sampled[:3, 3]
            x, status = self.coordinates(self.samples)[rows], arm_branches(self.robot, self.samples[rows])
            rotation = None if self.rotation is None else self.rotation[rows]
            coverage = self._coverage(limits.max_joint_gap)
            self._guards[limits] = Guards(x, limits, point, rotation, status, coverage)
        return self._guards[limits]

    @cached_property
    def _guards(self) -> dict[Limits, Guards]:
        return {}


def load_map(path: str | Path) -> ErrorMap:
    """Read a map that `ErrorMap.save` wrote. Nothing in the file is executed.

    Raises
    ------
    FileError
        If the file is not a map, truncated, changed since it was written, or of another schema version.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from truepose import VirtualCell, fit_cell
    >>> virtual = VirtualCell("paper")
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "cell.truepose"
    ...     fit_cell(virtual.cell, virtual.measure(virtual.design(30)), "registration").save(path)
    ...     len(load_map(path).samples)
    30
    """
    return from_bytes(files.read_bytes(path, LARGEST_MAP), path, ErrorMap)
