"""A virtual cell: a robot with errors, a tracker somewhere, a tool not quite as stated (method.md §7)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from truepose.cell import Cell
from truepose.errors import DataError, RobotError
from truepose.geometry import apply_transform, euler, invert_transform, make_transform, register
from truepose.robots import Robot, load_robot, nearest_branch
from truepose.samples import Samples
from truepose.simulation.presets import PRESETS, Preset

FloatArray = NDArray[np.float64]
_REFERENCE_POSES: Final = 512
_NOISE_DRAWS: Final = 4096


@dataclass(frozen=True)
class Truth:
    """What a virtual cell knows and a user does not.

    Attributes
    ----------
    robot : Robot
        The arm as it is.
    tf_flange_tool : (4, 4) array [mm]
        The tool as it is.
    tf_base_tracker : (4, 4) array [mm]
        The tracker's station.
    """

    robot: Robot
    tf_flange_tool: FloatArray
    tf_base_tracker: FloatArray


class VirtualCell:
    """A robot cell that can be measured, and whose truth is known.

    Parameters
    ----------
    preset : str or Preset
        ``"paper"``: the paper's experiment, one orientation, at most about 1.3 mm before compensation.
    robot : str, optional
        Library name of another robot.
    seed : int
        Decides the truth, and the noise of all measurements in their order.

    Examples
    --------
    >>> cell = VirtualCell("paper", seed=3)
    >>> samples = cell.measure(cell.design(50))
    >>> samples.p_meas.shape
    (50, 3)
    """

    def __init__(self, preset: str | Preset = "paper", robot: str | None = None, seed: int = 0) -> None:
        if isinstance(preset, str) and preset not in PRESETS:
            raise DataError(f"no preset {preset!r}; there is: {', '.join(PRESETS)}")
        self.preset = PRESETS[preset] if isinstance(preset, str) else preset
        self.seed = seed
        self.robot = load_robot(robot or self.preset.robot)
        self.tf_flange_tool = make_transform(euler("kuka", self.preset.tool_abc_deg), self.preset.tool_mm)
        truth_seed, noise_seed = np.random.SeedSequence(seed).spawn(2)
        self._noise = np.random.default_rng(noise_seed)
        self.truth = self._draw_truth(np.random.default_rng(truth_seed))

    @property
    def cell(self) -> Cell:
        """The cell as its user would describe it."""
        x, y, z = self.preset.tool_mm
        a, b, c = self.preset.tool_abc_deg
        return Cell.model_validate(
            {
                "robot": {"model": self.robot.name},
                "tool": {
                    "x_mm": x,
                    "y_mm": y,
                    "z_mm": z,
                    **dict(zip(("a_deg", "b_deg", "c_deg"), (a, b, c), strict=True)),
                },
                "tracker": {"fit": "pose"},
            }
        )

    @property
    def noise_floor(self) -> float:
        """Mean length of repeatability and reading noise, centre of the work region [mm]: no predictor does better."""
        centre = np.array([self.preset.centre_mm])
        p_tracker = apply_transform(invert_transform(self.truth.tf_base_tracker), centre)
        covariance = self.preset.tracker.covariance(p_tracker)[0] + self.preset.repeatability_std**2 * np.eye(3)
        draws = np.random.default_rng(0).multivariate_normal(np.zeros(3), covariance, size=_NOISE_DRAWS)
        return float(np.linalg.norm(draws, axis=1).mean())

    def design(self, n: int, *, seed: int | None = None) -> FloatArray:
        """Return n configurations spread over the work region (scrambled Sobol points), (n, dof) [rad].

        Raises
        ------
        RobotError
            If a position of the work region is out of reach on the branch of the preset.
        """
        sobol = qmc.Sobol(3, rng=np.random.default_rng(self.seed if seed is None else seed))
        unit = sobol.random_base2(max(int(np.ceil(np.log2(max(n, 1)))), 0))[:n]
        return self.reach(np.asarray(self.preset.centre_mm) + (unit - 0.5) * self.preset.size_mm)

    def reach(self, p_target: FloatArray, rotation: Rotation | None = None) -> FloatArray:
        """Return the joints by which the controller goes to positions (n, 3) [mm] in the base frame, (n, dof) [rad].

        The orientation is the preset's unless given; the branch is the one nearest to the preset's home.
        """
        rotation = euler("kuka", self.preset.abc_deg) if rotation is None else rotation
        poses = make_transform(rotation, p_target)
        home = np.deg2rad(self.preset.home_deg)
        q = nearest_branch(self.robot.inverse(poses, tool=self.tf_flange_tool), home)
        lost = np.flatnonzero(np.isnan(q).any(axis=1))
        if len(lost):
            raise RobotError(
                f"{len(lost)} of {len(q)} poses are out of reach, the first at {p_target[lost[0]].round(1).tolist()} mm"
            )
        return q

    def true_position(self, q: FloatArray) -> FloatArray:
        """Return where the tool point goes without any noise, (n, 3) [mm], base frame."""
        position: FloatArray = self.truth.robot.forward(q, tool=self.truth.tf_flange_tool)[:, :3, 3]
        return position

    def measure(self, q: FloatArray) -> Samples:
        """Command configurations (n, dof) [rad] and read the tracker.

        Returns
        -------
        Samples
            With joints, commanded poses (of the tool as stated), measured positions in the tracker frame and their
            standard deviation as a tracker reports it (its own noise, without the robot's repeatability).
        """
        tf_base_tool = self.robot.forward(q, tool=self.tf_flange_tool)
        p_base = self.true_position(q) + self._noise.normal(scale=self.preset.repeatability_std, size=(len(q), 3))
        p_tracker = apply_transform(invert_transform(self.truth.tf_base_tracker), p_base)
        covariance = self.preset.tracker.covariance(p_tracker)
        white = self._noise.normal(size=(len(q), 3))
        return Samples(
            p_meas=p_tracker + np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), white),
            q=np.array(q),
            p_cmd=tf_base_tool[:, :3, 3],
            rotation_cmd=Rotation.from_matrix(tf_base_tool[:, :3, :3]),
            p_std=np.sqrt(np.einsum("nii->ni", covariance)),
            source=f"virtual cell, seed {self.seed}",
        )

    def _draw_truth(self, rng: np.random.Generator) -> Truth:
        preset, dof = self.preset, self.robot.dof
        error = {
            **{name: rng.normal(scale=preset.length_std, size=dof) for name in ("a", "d")},
            **{name: rng.normal(scale=preset.angle_std, size=dof) for name in ("alpha", "offset", "beta")},
        }
        tf_flange_tool = self.tf_flange_tool.copy()
        tf_flange_tool[:3, 3] += rng.normal(scale=preset.tool_std, size=3)
        station = np.array([preset.centre_mm[0] + 3500.0, -1500.0, 300.0]) + rng.uniform(-500.0, 500.0, size=3)
        tf_base_tracker = make_transform(Rotation.from_euler("Z", rng.uniform(-180.0, 180.0), degrees=True), station)
        truth = Truth(self._perturbed(error, 1.0), tf_flange_tool, tf_base_tracker)
        if preset.largest_error is not None:
            truth = replace(truth, robot=self._perturbed(error, preset.largest_error / self._largest_error(truth)))
        return truth

    def _perturbed(self, error: dict[str, FloatArray], factor: float) -> Robot:
        return replace(
            self.robot, **{name: getattr(self.robot, name) + factor * value for name, value in error.items()}
        )

    def _largest_error(self, truth: Truth) -> float:
        """Return the largest error over the work region after rigid registration [mm]."""
        q = self.design(_REFERENCE_POSES, seed=0)
        p_cmd = self.robot.forward(q, tool=self.tf_flange_tool)[:, :3, 3]
        p_true = truth.robot.forward(q, tool=truth.tf_flange_tool)[:, :3, 3]
        residuals = register(p_cmd, p_true, robust=False).residuals
        return float(np.linalg.norm(residuals, axis=1).max())
