"""The prior of an arm's errors before a measurement or after a first series: equation (10) as columns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from truepose._typing import FloatArray, IntArray
from truepose.predictors.kinematic.basis import Basis
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.kriging import KinematicKriging
from truepose.predictors.kinematic.terms import Terms
from truepose.robots import Robot

_STRAIN_WAVE: Final = frozenset({"universal-robots", "universal robots"})
_JOINT_STD: Final = {True: 3e-4, False: 5e-5}  # rad: strain-wave gears (measured UR10), gears of heavy arms (§7)
_REST_STD: Final = {True: 0.1, False: 0.03}  # mm
_NOISE: Final = 0.02  # mm: repeatability in each direction, of RP 0.07 mm by ISO 9283
_DRAWS: Final = 256


@dataclass(frozen=True, eq=False)
class Prior:
    """Errors as columns of standard normal weights, and the covariance that they leave out.

    Attributes
    ----------
    basis : Basis
        The columns of the error model.
    hyper : Hyperparameters
        The hyperparameters of the error model.
    root : (p, s) array
        The root of the weights' covariance: Λ½ before any sample.
    """

    basis: Basis
    hyper: Hyperparameters
    root: FloatArray

    @classmethod
    def of(cls, robot: Robot, tf_flange_tool: FloatArray, anchors: FloatArray, noise: float = _NOISE) -> Self:
        """Return the prior of an arm that has not been measured.

        Parameters
        ----------
        robot : Robot
            The nominal robot.
        tf_flange_tool : (4, 4) array [mm]
            The transform from flange to measured point.
        anchors : (a, dof) array [rad]
            Some hundred configurations over the work region, which carry the rest Z.
        noise : float [mm]
            The standard deviation of repeatability and reading noise together, in each direction.
        """
        terms = Terms(robot, tf_flange_tool, gears=False)
        joints = terms.seen(terms.at(anchors))
        elastic = is_elastic(robot)
        start = Hyperparameters.start(len(joints), len(terms.range_names))
        hyper = Hyperparameters(
            np.full(len(joints), _JOINT_STD[elastic]),
            start.joint_length,
            start.tolerance,
            noise,
            _REST_STD[elastic],
            start.rest_range,
        )
        return cls._before(terms, joints, hyper, anchors)

    @classmethod
    def after(cls, model: KinematicKriging, q: ArrayLike, anchors: FloatArray) -> Self:
        """Return the prior after a series: fitted hyperparameters, and the weights given samples at q (n, dof).

        Variances are those that the fit predicts: times its inflation, and with the noise of readings that it knows.
        """
        assert model.robot is not None
        terms = Terms(
            model.robot,
            np.eye(4) if model.tf_flange_tool is None else np.asarray(model.tf_flange_tool, float),
            convention=model.convention,
            geometry=model.geometry,
            compliance=model.compliance,
            residual=model.residual,
            gears=model.gear_harmonics,
        )
        tolerance = model.hyper_.tolerance[[0, 1, -1][: len(terms.scaled_groups)]]  # effects of conditions are left out
        fitted, root, reading = model.hyper_, np.sqrt(model.inflation_), model.noise_std_
        hyper = replace(
            fitted,
            joint_std=root * fitted.joint_std,
            tolerance=root * tolerance,
            noise=float(np.hypot(root * fitted.noise, 0.0 if reading is None else np.sqrt(np.mean(reading**2)))),
            rest_std=root * fitted.rest_std,
        )
        before = cls._before(terms, model.joints_, hyper, anchors)
        return before.given(np.asarray(q, float))

    @classmethod
    def _before(cls, terms: Terms, joints: IntArray, hyper: Hyperparameters, anchors: FloatArray) -> Self:
        basis = Basis.of(terms, joints, hyper, terms.at(anchors) if terms.range_names else None)
        return cls(basis, hyper, np.diag(np.sqrt(basis.prior(hyper))))

    def at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return columns (n, 3, s) [mm] of standard normal weights, and the covariance left out, (n, 3, 3) [mm²]."""
        design = self.basis.terms.at(q)
        columns = (self.basis.columns(design) @ self.root).reshape(len(q), 3, -1)
        return columns, self.basis.left_out_covariance(design, self.hyper)

    def noise(self, left_out: FloatArray) -> FloatArray:
        """Return the covariance of a reading beyond its columns, (n, 3, 3) [mm²]."""
        return np.asarray(left_out + self.hyper.noise**2 * np.eye(3))

    def given(self, q: FloatArray) -> Self:
        """Return the prior given samples at joints (n, dof) [rad]."""
        columns, left_out = self.at(q)
        return type(self)(self.basis, self.hyper, self.root @ posterior_root(columns, self.noise(left_out)))

    def covariance(self, q: FloatArray) -> FloatArray:
        """Return the covariance of the error at joints (n, dof) [rad], without noise: (n, 3, 3) [mm²]."""
        columns, left_out = self.at(q)
        return np.asarray(columns @ np.swapaxes(columns, 1, 2) + left_out)

    def expected(self, columns: FloatArray, left_out: FloatArray) -> float:
        """Return the mean length [mm] of the differences of readings from their prediction, where `at` gives these.

        The expected length of normal vectors with the predicted covariance, repeatability and reading noise included.
        """
        return float(self.lengths(columns, left_out).mean())

    def lengths(self, columns: FloatArray, left_out: FloatArray) -> FloatArray:
        """Return the expected length [mm] of each difference, see `expected`: (n,)."""
        return mean_lengths(self.noise(columns @ np.swapaxes(columns, 1, 2) + left_out))

    def redrawn(self, hyper: Hyperparameters) -> Self:
        """Return the prior with other hyperparameters, before any sample; its rest has the same anchors."""
        basis = Basis.of(self.basis.terms, self.basis.joints, hyper, self.basis.anchor)
        return type(self)(basis, hyper, np.diag(np.sqrt(basis.prior(hyper))))


def is_elastic(robot: Robot) -> bool:
    """Return whether the robot's joints have strain-wave gears, by its maker."""
    return robot.maker.lower() in _STRAIN_WAVE


def mean_lengths(covariance: FloatArray) -> FloatArray:
    """Return the expected lengths of normal vectors with covariances (n, 3, 3): (n,)."""
    from scipy.stats import qmc  # takes longer to import than the rest of the package

    uniform = qmc.Sobol(3, scramble=False).random_base2(8)[:_DRAWS]
    white = ndtri(uniform + 0.5 / _DRAWS)
    factor = np.linalg.cholesky(covariance)
    return np.asarray(np.linalg.norm(factor @ white.T, axis=1).mean(axis=1))


def posterior_root(columns: FloatArray, noise: FloatArray) -> FloatArray:
    """Return a root (p, p) of the covariance of standard normal weights after readings.

    Parameters
    ----------
    columns : (n, 3, p) array [mm]
        The errors of one standard deviation of each weight.
    noise : (n, 3, 3) array [mm²]
        The covariances of the readings beyond their columns.
    """
    root = np.linalg.cholesky(np.linalg.inv(noise))
    white = (np.swapaxes(root, 1, 2) @ columns).reshape(3 * len(columns), -1)
    matrix = white.T @ white
    matrix[np.diag_indices(len(matrix))] += 1.0
    return np.asarray(np.linalg.inv(np.linalg.cholesky(matrix)).T)
