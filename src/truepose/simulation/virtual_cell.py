"""A virtual cell: a robot with errors, a tracker at an unknown station, an inexact tool (docs/virtual-cell.md)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from string import ascii_uppercase
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from truepose._typing import BoolArray, FloatArray
from truepose.cell import ANGLE_KEYS, Cell
from truepose.errors import DataError, RobotError
from truepose.geometry import apply_transform, euler, invert_transform, make_transform, register
from truepose.robots import Robot, load_robot, nearest_branch
from truepose.robots.io.library import ROBOT_FILES
from truepose.samples import Samples
from truepose.simulation.adapting import adapt
from truepose.simulation.presets import EFFECTS, PRESETS, TROUBLES, Preset
from truepose.simulation.tracker import pose_covariance, reflector_ring
from truepose.simulation.troubles import draw_troubles
from truepose.simulation.truth import Conditions, Truth, draw_joints
from truepose.trackers.reflectors import fit_rigid
from truepose.verification import RP_PER_STD, mean_noise

_REFERENCE_POSES: Final = 512
_STATED_MM: Final = 0.005  # of the positions of reflectors in the cell file


class VirtualCell:
    """A simulated robot cell with known true errors.

    Parameters
    ----------
    preset : str or Preset
        The preset. ``"paper"`` is the paper's experiment: one orientation, errors up to about 1.3 mm before
        compensation. ``"hard"`` has every effect of docs/virtual-cell.md and orientations within ±15°. ``"ideal"`` has
        only noise and the unknown station. The others of `PRESETS` are ``"hard"`` with one further fault.
    robot : str or Path, optional
        The library name or the file of another robot; work region, tool and payload are scaled with it.
    seed : int
        The seed of the truth, and of the noise of all measurements in their order.
    effects : collection of str, optional
        The names from `EFFECTS` and `TROUBLES` that are switched on, instead of the preset's. The random values of one
        do not depend on the others.

    Attributes
    ----------
    truth : Truth
        The true properties of the cell.
    effects : frozenset of str
        The effects that are switched on.

    Raises
    ------
    DataError
        If a preset or an effect is unknown.
    RobotError
        If the robot is unknown, or cannot reach the work region.

    Examples
    --------
    >>> cell = VirtualCell("paper", seed=3)
    >>> samples = cell.measure(cell.design(50))
    >>> samples.p_meas.shape
    (50, 3)
    """

    def __init__(
        self,
        preset: str | Preset = "paper",
        robot: str | Path | None = None,
        seed: int = 0,
        effects: Collection[str] | None = None,
    ) -> None:
        if not isinstance(preset, Preset) and preset not in PRESETS:
            raise DataError(f"unknown preset {preset!r}; expected one of {', '.join(PRESETS)}")
        self.preset = PRESETS[preset] if isinstance(preset, str) else preset
        self.robot = load_robot(robot or self.preset.robot)
        is_file = str(robot).lower().endswith(ROBOT_FILES)
        self._model = str(Path(str(robot)).resolve()) if is_file else self.robot.name
        if robot is not None and self.robot.name != self.preset.robot:
            self.preset = adapt(self.preset, self.robot)
        self.effects = frozenset(self.preset.effects if effects is None else effects)
        if unknown := self.effects - {*EFFECTS, *TROUBLES}:
            raise DataError(f"unknown effect {min(unknown)!r}; expected one of {', '.join((*EFFECTS, *TROUBLES))}")
        self.seed = seed
        self.tf_flange_tool = make_transform(euler("kuka", self.preset.tool_abc_deg), self.preset.tool_mm)
        truth_seed, noise_seed, joint_seed, trouble_seed = np.random.SeedSequence(seed).spawn(4)
        self._noise = np.random.default_rng(noise_seed)
        self.truth = self._draw_truth(*map(np.random.default_rng, (truth_seed, joint_seed, trouble_seed)))

    def __repr__(self) -> str:
        effects = ", ".join(name for name in (*EFFECTS, *TROUBLES) if name in self.effects) or "no effects"
        return f"<VirtualCell of {self.robot.name}, seed {self.seed}: {effects}; noise floor {self.noise_floor:.4f} mm>"

    @property
    def cell(self) -> Cell:
        """The cell as its user describes it."""
        preset, lengths = self.preset, ("x_mm", "y_mm", "z_mm")
        controller = Cell.model_validate({"robot": {"model": self._model}}).controller

        def pose(p: tuple[float, float, float], abc: tuple[float, float, float]) -> dict[str, float]:
            angles = abc if controller is None else np.round(euler(controller, euler("kuka", abc)), 9).tolist()
            return dict(zip((*lengths, *ANGLE_KEYS[controller or "kuka"]), (*p, *angles), strict=True))

        # RP to the micrometre, as a maker states it
        stated = {"repeatability_mm": round(RP_PER_STD * self._repeatability, 3)} if self._repeatability else {}
        if self.robot.world_height_mm is not None:
            stated["world_height_mm"] = self.robot.world_height_mm
        return Cell.model_validate(
            {
                "robot": {"model": self._model, **stated},
                "tool": pose(preset.tool_mm, preset.tool_abc_deg),
                "tracker": {"fit": "pose"},
                "payload": {"mass_kg": preset.payload_kg, **dict(zip(lengths, preset.payload_mm, strict=True))},
                "region": {
                    **pose(preset.centre_mm, preset.abc_deg),
                    "size_mm": preset.size_mm,
                    "tilt_deg": preset.orientation_deg,
                    "home_deg": list(preset.home_deg),
                },
            }
        )

    @property
    def noise_floor(self) -> float:
        """The mean length of repeatability and reading noise at the centre of the region [mm], a bound for predictors.

        Heavy tails and rounding are not included.
        """
        p_tracker = apply_transform(invert_transform(self.truth.tf_base_tracker), np.array([self.preset.centre_mm]))
        covariance = float("tracker" in self.effects) * self.preset.tracker.covariance(p_tracker)
        return float(mean_noise(covariance + self._repeatability**2 * np.eye(3))[0])

    def design(self, n: int, *, seed: int | None = None, orientation_deg: float | None = None) -> FloatArray:
        """Return n configurations spread over the work region (scrambled Sobol points), (n, dof) [rad].

        Parameters
        ----------
        n : int
            The number of configurations.
        seed : int, optional
            The seed of the scrambling; that of the cell when not given.
        orientation_deg : float, optional
            The largest rotation about each axis of the tool, instead of the preset's; 0 is one orientation.

        Raises
        ------
        RobotError
            If a position of the work region is out of reach on the branch of the preset.
        """
        turn = np.deg2rad(self.preset.orientation_deg if orientation_deg is None else orientation_deg)
        sobol = qmc.Sobol(6 if turn else 3, rng=np.random.default_rng(self.seed if seed is None else seed))
        unit = sobol.random_base2(max(int(np.ceil(np.log2(max(n, 1)))), 0))[:n] - 0.5
        rotation = euler("kuka", self.preset.abc_deg)
        if turn:
            rotation = rotation * Rotation.from_rotvec(2.0 * turn * unit[:, 3:])
        return self.reach(np.asarray(self.preset.centre_mm) + unit[:, :3] * self.preset.size_mm, rotation)

    def reach(self, p_target: FloatArray, rotation: Rotation | None = None) -> FloatArray:
        """Return the joints of the controller at positions (n, 3) [mm] in the base frame, (n, dof) [rad].

        The orientation is that of the preset unless given; the branch is the one nearest to the preset's home.
        """
        rotation = euler("kuka", self.preset.abc_deg) if rotation is None else rotation
        poses = make_transform(rotation, p_target)
        q = nearest_branch(self.robot.inverse(poses, tool=self.tf_flange_tool), self._home)
        lost = np.flatnonzero(np.isnan(q).any(axis=1))
        if len(lost):
            raise RobotError(
                f"{len(lost)} of {len(q)} poses are out of reach, the first at {p_target[lost[0]].round(1).tolist()} mm"
            )
        return q

    def true_position(
        self,
        q: FloatArray,
        *,
        approach: ArrayLike | str | None = None,
        payload_kg: ArrayLike | None = None,
        time: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the true positions of the tool without noise, (n, 3) [mm], base frame; arguments as of `measure`."""
        return self.true_poses(q, approach=approach, payload_kg=payload_kg, time=time)[:, :3, 3]

    def true_poses(
        self,
        q: FloatArray,
        *,
        approach: ArrayLike | str | None = None,
        payload_kg: ArrayLike | None = None,
        time: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the true poses of the tool without noise, (n, 4, 4) [mm], base frame; arguments as of `measure`."""
        return self.truth.forward(q, self._conditions(q, approach, payload_kg, time))

    def at_work(self, q: FloatArray) -> FloatArray:
        """Return the true positions of the tool at work without noise, (n, 3) [mm], base frame.

        They are those of `true_position` with the preset's payload and time of work.
        """
        return self.true_position(q, payload_kg=self.preset.work_payload_kg, time=self.preset.work_s)

    def visible(self, q: FloatArray) -> BoolArray:
        """Return whether the reflector is visible to the tracker at configurations (n, dof) [rad]: (n,)."""
        tf = self.robot.forward(q, tool=self.tf_flange_tool)
        beam = self.truth.tf_base_tracker[:3, 3] - tf[:, :3, 3]
        beam /= np.linalg.norm(beam, axis=1, keepdims=True)
        centre = self.truth.tf_base_tracker[:3, 3] - self.preset.centre_mm
        axis = euler("kuka", self.preset.abc_deg).inv().apply(centre / np.linalg.norm(centre))
        facing = np.einsum("nij,j,ni->n", tf[:, :3, :3], axis, beam)
        return np.asarray(facing > np.cos(np.deg2rad(self.preset.acceptance_deg)))

    def measure(
        self,
        q: FloatArray,
        *,
        seed: int | None = None,
        approach: ArrayLike | str | None = None,
        payload_kg: ArrayLike | None = None,
        time: ArrayLike | None = None,
        reflectors: int = 1,
        line_of_sight: bool = False,
    ) -> Samples:
        """Move to configurations and read the tracker.

        Parameters
        ----------
        q : (n, dof) array [rad]
            The commanded configurations.
        seed : int, optional
            The seed of this measurement's noise; equal seeds give equal readings. Without it each call has new noise.
        approach : array of -1, 0, +1 that broadcasts to (n, dof), or "order", optional
            The sign of each joint's last motion; that of the preset when not given, usually +1 for every pose as in
            good measuring programs. ``"order"`` moves from each pose straight to the next, and from home to the first.
        payload_kg : float or (n,) array, optional
            The mass on the flange, instead of the preset's.
        time : (n,) array [s], optional
            The time of each reading after a cold start; that of the preset when not given, usually one hour on.
        reflectors : int
            The number of reflectors: 1 gives positions; 3 or more, on a circle about the tool point, give poses.
        line_of_sight : bool
            Whether poses that turn the reflector away from the tracker are left out (`visible`).

        Returns
        -------
        Samples
            The samples with joints, commanded poses of the stated tool, measured positions in the tracker frame and
            their standard deviations as a tracker reports them (without the robot's repeatability). Approach, load,
            time and temperature are included if they are given, or if an effect of the cell depends on them.

        Raises
        ------
        DataError
            If the number of reflectors is 2 or less than 1, or a condition has the wrong shape.
        """
        conditions = self._conditions(q, approach, payload_kg, time)
        p, covariance = self._read(q, conditions, reflectors, seed)
        tf_base_tool = self.robot.forward(q, tool=self.tf_flange_tool)
        known: dict[str, Any] = {}
        if approach is not None or "backlash" in self.effects:
            known["approach"] = conditions.approach
        if payload_kg is not None or "compliance" in self.effects:
            known["load"] = conditions.payload_kg
        if time is not None or "thermal" in self.effects:
            known |= {"time": conditions.time, "temperature": conditions.temperature}
        measured = self._pose(p, covariance)
        measured["p_meas"] = self._as_in_file(measured["p_meas"])
        samples = Samples(
            **measured,
            q=np.deg2rad(self._as_in_file(np.rad2deg(q), angles=True)) if "rounding" in self.effects else np.array(q),
            p_cmd=self._as_in_file(tf_base_tool[:, :3, 3]),
            rotation_cmd=Rotation.from_matrix(tf_base_tool[:, :3, :3]),
            source=f"virtual cell, seed {self.seed}",
            **known,
        )
        return samples[self.visible(q)] if line_of_sight else samples

    def read_reflectors(self, q: FloatArray, reflectors: int = 3, *, seed: int | None = None) -> FloatArray:
        """Return the readings of each reflector in turn, (n, reflectors, 3) [mm], tracker frame.

        `reflector_positions` returns their positions on the tool.
        """
        return self._read(q, self._conditions(q), reflectors, seed)[0]

    def measure_each(self, q: FloatArray, reflectors: int = 3, *, seed: int | None = None) -> Samples:
        """Return the readings of each reflector as samples with a column ``reflector``, one row for each reading.

        Parameters
        ----------
        q : (n, dof) array [rad]
            The commanded configurations.
        reflectors : int
            The number of reflectors; `cell_with` states their positions.
        seed : int, optional
            The seed of this measurement's noise, as of `measure`.

        Examples
        --------
        >>> virtual = VirtualCell("paper")
        >>> samples = virtual.measure_each(virtual.design(2), seed=1)
        >>> samples.reflector.tolist()
        ['A', 'B', 'C', 'A', 'B', 'C']
        """
        conditions = self._conditions(q)
        p, covariance = self._read(q, conditions, reflectors, seed)
        tf_base_tool = self.robot.forward(q, tool=self.tf_flange_tool)
        std = np.sqrt(np.einsum("nmii->nmi", covariance)).reshape(-1, 3)
        each = np.repeat(np.arange(len(q)), reflectors)
        known: dict[str, Any] = {"load": conditions.payload_kg[each]} if "compliance" in self.effects else {}
        joints = np.deg2rad(self._as_in_file(np.rad2deg(q), angles=True)) if "rounding" in self.effects else q
        return Samples(
            p_meas=self._as_in_file(p.reshape(-1, 3)),
            p_std=std if "tracker" in self.effects else None,
            q=joints[each],
            p_cmd=self._as_in_file(tf_base_tool[each, :3, 3]),
            rotation_cmd=Rotation.from_matrix(tf_base_tool[each, :3, :3]),
            name=np.array([f"P{i + 1}" for i in each]),
            reflector=np.tile(list(ascii_uppercase[:reflectors]), len(q)),
            source=f"virtual cell, seed {self.seed}",
            **known,
        )

    def cell_with(self, reflectors: int = 3) -> Cell:
        """Return `cell` with the positions of reflectors, as its user states them, in ``[reflectors]``.

        Examples
        --------
        >>> list(VirtualCell("paper").cell_with(4).reflectors)
        ['A', 'B', 'C', 'D']
        """
        p = apply_transform(self.tf_flange_tool, self.reflector_positions(reflectors)).round(6)
        stated = [dict(zip(("x_mm", "y_mm", "z_mm", "std_mm"), (*one, _STATED_MM), strict=True)) for one in p.tolist()]
        return Cell.model_validate(
            {
                **self.cell.model_dump(exclude_unset=True),
                "reflectors": dict(zip(ascii_uppercase[:reflectors], stated, strict=True)),
            }
        )

    def reflector_positions(self, reflectors: int) -> FloatArray:
        """Return the positions of reflectors, (reflectors, 3) [mm], tool frame: one at the tool point, or a ring."""
        if reflectors < 1 or reflectors == 2:
            raise DataError(f"expected 1 reflector for positions, or 3 or more for poses; got {reflectors}")
        radius = self.preset.reflector_radius_mm if reflectors > 1 else 0.0
        return reflector_ring(reflectors, radius)

    def _conditions(
        self,
        q: FloatArray,
        approach: ArrayLike | str | None = None,
        payload_kg: ArrayLike | None = None,
        time: ArrayLike | None = None,
    ) -> Conditions:
        preset, n = self.preset, len(q)
        if approach is None and preset.approach == "order":
            approach = "order"
        if isinstance(approach, str):
            if approach != "order":
                raise DataError(f'expected approach -1, 0 or +1 for each joint, or "order"; got {approach!r}')
            approach = np.sign(np.diff(q, axis=0, prepend=[self._home]))
        return Conditions(
            approach=_broadcast("approach", 1.0 if approach is None else approach, q.shape),
            payload_kg=_broadcast("payload_kg", preset.payload_kg if payload_kg is None else payload_kg, (n,)),
            time=_broadcast(
                "time",
                preset.first_reading_s + preset.seconds_per_reading * np.arange(n) if time is None else time,
                (n,),
            ),
            warm_up_kelvin=preset.warm_up_kelvin,
            warm_up_s=preset.warm_up_s,
        )

    def _read(
        self, q: FloatArray, conditions: Conditions, reflectors: int, seed: int | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return readings (n, m, 3) [mm], tracker frame, and their covariances (n, m, 3, 3) [mm²]."""
        rng = self._noise if seed is None else np.random.default_rng([self.seed, seed])
        on_tool = self.reflector_positions(reflectors)
        tf = self.truth.forward(q, conditions)
        tf[:, :3, 3] += rng.normal(scale=self._repeatability, size=(len(q), 3))
        p_base = tf[:, None, :3, 3] + np.einsum("nij,mj->nmi", tf[:, :3, :3], on_tool)
        p_tracker = apply_transform(invert_transform(self.truth.tf_base_tracker), p_base.reshape(-1, 3))
        covariance = self.preset.tracker.covariance(p_tracker)
        noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=p_tracker.shape))
        if "heavy-tails" in self.effects:  # Student's t is a normal number over the root of chi squared / ν
            nu = self.preset.degrees_of_freedom
            noise /= np.sqrt(rng.chisquare(nu, size=(len(noise), 1)) / nu)
        on = float("tracker" in self.effects)
        p_tracker = p_tracker + on * noise + np.repeat(self.truth.troubles.drift(conditions.time), reflectors, axis=0)
        return p_tracker.reshape(p_base.shape), on * covariance.reshape(*p_base.shape, 3)

    def _as_in_file(self, values: FloatArray, *, angles: bool = False) -> FloatArray:
        """Return values [mm or deg] rounded to the decimals of the file of samples."""
        if "rounding" not in self.effects:
            return values
        return np.asarray(np.round(values, self.preset.decimals_deg if angles else self.preset.decimals_mm))

    def _pose(self, p: FloatArray, covariance: FloatArray) -> dict[str, Any]:
        """Return the fields of `Samples` for readings: positions, or with several reflectors poses."""
        noisy = "tracker" in self.effects
        if p.shape[1] == 1:
            std = np.sqrt(np.einsum("nii->ni", covariance[:, 0]))
            return {"p_meas": p[:, 0], "p_std": std if noisy else None}
        on_tool = self.reflector_positions(p.shape[1])
        origin, rotation = fit_rigid(on_tool, p)
        std = np.sqrt(np.einsum("nii->ni", pose_covariance(on_tool, rotation, covariance)))
        found = {"p_meas": origin, "rotation_meas": rotation}
        return {**found, "p_std": std[:, :3], "rotation_std": std[:, 3:]} if noisy else found

    @property
    def _repeatability(self) -> float:
        return self.preset.repeatability_std if "repeatability" in self.effects else 0.0

    @property
    def _home(self) -> FloatArray:
        return np.deg2rad(self.preset.home_deg)

    def _draw_truth(
        self, rng: np.random.Generator, joint_rng: np.random.Generator, trouble_rng: np.random.Generator
    ) -> Truth:
        preset, dof = self.preset, self.robot.dof
        error = {
            **{name: rng.normal(scale=preset.length_std, size=dof) for name in ("a", "d")},
            **{name: rng.normal(scale=preset.angle_std, size=dof) for name in ("alpha", "offset", "beta")},
        }
        if self.robot.convention == "dh":  # without beta
            error["beta"] = np.zeros(dof)
        tool_error = rng.normal(scale=preset.tool_std, size=3)
        station = np.array([preset.centre_mm[0] + 3500.0, -1500.0, 300.0]) + rng.uniform(-500.0, 500.0, size=3)
        joints = draw_joints(preset, self.robot, self.effects, joint_rng)
        turn = Rotation.from_rotvec(joint_rng.normal(scale=preset.tool_angle_std, size=3))
        tf_flange_tool = self.tf_flange_tool.copy()
        if "tool" in self.effects:
            tf_flange_tool[:3, 3] += tool_error
            tf_flange_tool[:3, :3] = tf_flange_tool[:3, :3] @ turn.as_matrix()
        truth = Truth(
            robot=self._perturbed(error, 1.0),
            tf_flange_tool=tf_flange_tool,
            tf_base_tracker=make_transform(Rotation.from_euler("Z", rng.uniform(-180.0, 180.0), degrees=True), station),
            troubles=draw_troubles(preset, dof, self.effects, trouble_rng),
            seed=self.seed,
            **joints,
        )
        if "geometry" not in self.effects:
            return replace(truth, robot=self.robot)
        if preset.largest_error is not None:
            return replace(truth, robot=self._perturbed(error, preset.largest_error / self._largest_error(truth)))
        return truth

    def _perturbed(self, error: dict[str, FloatArray], factor: float) -> Robot:
        return replace(
            self.robot, **{name: getattr(self.robot, name) + factor * value for name, value in error.items()}
        )

    def _largest_error(self, truth: Truth) -> float:
        """Return the largest error of the geometry over the work region after rigid registration [mm]."""
        q = self.design(_REFERENCE_POSES, seed=0)
        p_cmd = self.robot.forward(q, tool=self.tf_flange_tool)[:, :3, 3]
        p_true = truth.robot.forward(q, tool=truth.tf_flange_tool)[:, :3, 3]
        residuals = register(p_cmd, p_true, robust=False).residuals
        return float(np.linalg.norm(residuals, axis=1).max())


def _broadcast(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    try:
        return np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
    except ValueError:
        raise DataError(f"expected {name} of shape {shape}, got {np.shape(value)}") from None
