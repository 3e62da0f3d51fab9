"""Kinematic Kriging (10): registration, calibration and similarity in one model."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose._typing import FloatArray, IntArray
from truepose.errors import DataError
from truepose.predictors.base import LeaveOneOut, checked_noise
from truepose.predictors.conditions import Usual
from truepose.predictors.distances import DistanceRows
from truepose.predictors.estimates import ParameterEstimates
from truepose.predictors.kinematic.checks import FEWEST, check
from truepose.predictors.kinematic.fitting import Start
from truepose.predictors.kinematic.fleet import ANGLES, Fleet, Member
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.inflation import MOST, Part, inflation
from truepose.predictors.kinematic.placing import placed
from truepose.predictors.kinematic.searched import SearchedKriging
from truepose.predictors.kinematic.summary import drift_table, estimates
from truepose.predictors.kinematic.terms import COMPLIANCE, GEOMETRY, GROUPS, Residual, Terms
from truepose.predictors.kinematic.turned import turned_rows, unseen, with_turns
from truepose.predictors.kinematic.visits import SHARED
from truepose.predictors.kinematic.weights import GROSS, ROUNDS, SETTLED, robust_weights
from truepose.predictors.reflectors import Reflectors
from truepose.predictors.tails import Tails, tails
from truepose.robots import Robot

EXACT_UP_TO: Final = 500
"""The largest number of samples for which ``solver="auto"`` uses the covariance form."""


class KinematicKriging(SearchedKriging):
    """Kinematic Kriging (10): geometry, compliance, each joint's own error, and a rest, in one model.

    The model is e(q) = J(q) Δψ + Σ_j (∂P/∂q_j) f_j(q_j) + Z(q) + ε. Registration (base and tool) has wide normal
    priors, geometry has priors from tolerances, f_j are random functions of each joint's own angle, and Z is the
    remaining field. Hyperparameters maximise the restricted likelihood under weak priors.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    tf_flange_tool : (4, 4) array_like [mm], optional
        The measured point; default: the flange.
    convention : str
        The convention of the geometry, see `truepose.robots.error_model`.
    geometry, compliance, joint_errors : bool
        Whether the model has these terms in addition to registration.
    residual : {"joint", "cartesian", "both", "none"}
        The coordinates of Z.
    gear_harmonics : bool
        Whether harmonics of the motors' angles are modelled if the likelihood gains; needs the robot's gear ratios.
    backlash_shape : bool
        Whether backlash may vary with the angle of its joint, if the likelihood gains; needs ``approach``.
    conditions : sequence of str
        The conditions after the joints in X (`truepose.predictors.conditions`), each modelled if the likelihood gains.
    work : mapping of str to float, optional
        The ``temperature`` [°C] and the ``payload`` [kg] at work, for predictions that state none; default: those of
        the samples.
    reflectors : Reflectors, optional
        The reflectors that the condition ``reflector`` names; without it, all rows are of the tool point.
    distances : bool
        Whether `distance_rows` are used.
    distance_rows : DistanceRows, optional
        Distances from fixed points; they enter the solution, with hyperparameters of the positions.
    robust : bool
        Whether readings that the others contradict get a smaller weight; `gross_` names them.
    solver : {"auto", "covariance", "basis"}
        The form of the solution: the covariance of all readings (exact, cubic in n) or a basis (linear in n). "auto"
        uses the covariance up to `EXACT_UP_TO` samples. Above 350 samples, hyperparameters are searched with 350 random
        samples; a basis then refines them with all samples.
    hyper : dict, optional
        The hyperparameters, as from `Hyperparameters.to_dict`; default: searched.
    weight : sequence of float, optional
        The weights of the samples, and of the distances after them; default: robust weights.
    joints : sequence of int, optional
        The joints with an error of their own, counted from 0, together with `hyper`; default: the visible joints.
    inflation : float, optional
        The factor of predicted variances, together with `hyper`; default: estimated by cross-validation.
    reference : mapping, optional
        The conditions that the effects of a fit refer to, see `truepose.predictors.conditions.Usual.reference`;
        default: those of the samples.
    registration : (c,) sequence [mm, rad], optional
        The change of base and tool about which their prior is, together with `hyper`; default: found.
    fleet : dict, optional
        What other robots of the type say, see `truepose.predictors.kinematic.fleet.Fleet`; of it, the fit takes what
        raises the evidence.
    random_state : int
        The seed of random subsets.

    Attributes
    ----------
    hyper_ : Hyperparameters
        The hyperparameters.
    parameters_ : list of dict
        One row per drift column: name, group, estimate and standard deviation in its unit.
    joints_ : (k,) array of int
        The joints with an error of their own, counted from 0.
    unseen_ : list of int
        The joints without one: they do not move, or the tool point does not move with them.
    solver_ : str
        The solver that was used.
    gross_ : (g,) array of int
        The rows of readings that the others contradict.
    gross_distances_ : (g,) array of int
        The distances that the other readings contradict.
    inflation_ : float
        The factor of the predicted variances, at least 1, that makes unseen readings standard, from fits without parts
        of the samples.
    log_likelihood_ : float
        The log marginal likelihood of the errors used in the search, see
        `truepose.predictors.kinematic.fitting.Search`. NaN if hyperparameters were given.
    fleet_ : dict
        The maps of the fleet, the step ``taken``, the ``gain`` of the log evidence, and the ``scale`` of the mean
        error; empty without a fleet.
    bounds_hit_ : list of str
        The hyperparameters at a bound, such as ``length of joint 4`` and ``tolerance of backlash``.

    Examples
    --------
    >>> from truepose.robots import load_robot
    >>> robot = load_robot("kuka-kr150-2")
    >>> q = np.random.default_rng(0).uniform(-1, 1, (30, 6))
    >>> e = 0.3 * robot.error_jacobian(q, parameters=["a3"])[:, :, 0]
    >>> model = KinematicKriging(robot, joint_errors=False, residual="none", robust=False).fit(q, e)
    >>> bool(np.abs(model.predict(q) - e).max() < 0.01)
    True
    """

    arm_parameters = ("robot", "tf_flange_tool", "work", "reflectors", "distance_rows")
    takes_reflectors = True
    takes_conditions = True
    _blas_threads_from = np.inf  # one thread: its matrices have at most 3 * EXACT_UP_TO rows

    def __init__(
        self,
        robot: Robot | None = None,
        tf_flange_tool: ArrayLike | None = None,
        convention: str = "hayati",
        geometry: bool = True,
        compliance: bool = True,
        joint_errors: bool = True,
        residual: Residual = "joint",
        gear_harmonics: bool = True,
        backlash_shape: bool = True,
        conditions: Sequence[str] = (),
        work: Mapping[str, float] | None = None,
        reflectors: Reflectors | None = None,
        distances: bool = True,
        distance_rows: DistanceRows | None = None,
        robust: bool = True,
        solver: str = "auto",
        hyper: dict[str, Any] | None = None,
        weight: Sequence[float] | None = None,
        joints: Sequence[int] | None = None,
        inflation: float | None = None,
        reference: Mapping[str, Any] | None = None,
        registration: Sequence[float] | None = None,
        fleet: dict[str, Any] | None = None,
        random_state: int = 0,
    ) -> None:
        self.robot = robot
        self.tf_flange_tool = tf_flange_tool
        self.convention = convention
        self.geometry = geometry
        self.compliance = compliance
        self.joint_errors = joint_errors
        self.residual = residual
        self.gear_harmonics = gear_harmonics
        self.backlash_shape = backlash_shape
        self.conditions = conditions
        self.work = work
        self.reflectors = reflectors
        self.distances = distances
        self.distance_rows = distance_rows
        self.robust = robust
        self.solver = solver
        self.hyper = hyper
        self.weight = weight
        self.joints = joints
        self.inflation = inflation
        self.reference = reference
        self.registration = registration
        self.fleet = fleet
        self.random_state = random_state

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        check(self, e, X)
        assert self.robot is not None
        centre = None if self.registration is None else np.asarray(self.registration, float)
        self._take(X, e, noise_std, self.reference, centre)
        design = self._terms.at(self._x)
        seen = self._terms.seen(design) if self.joints is None else np.asarray(self.joints, np.int64)
        self.joints_ = seen if self.joint_errors else np.empty(0, np.int64)
        self.unseen_ = sorted(set(range(self.robot.dof)) - set(self.joints_.tolist())) if self.joint_errors else []
        self.log_likelihood_ = np.nan
        self.bounds_hit_: list[str] = []
        self._fleet = None if self.fleet is None else Fleet.from_dict(self.fleet, self.robot.dof)
        if self.hyper is not None:
            self.hyper_ = Hyperparameters.from_dict(self.hyper)
            given = np.ones(len(self._e)) if self.weight is None else np.asarray(self.weight, float)
            self._weight = given[: len(self._e)]
            self._settle(given[len(self._e) :])
        else:
            self._optimum = self._search() if self._fleet is None else self._taking(self._fleet)
            self._settle(np.empty(0), solved=True)
        self.gross_ = np.flatnonzero(self.weight_ < GROSS)
        self.inflation_ = self._inflation(self._optimum) if self.hyper is None else self.inflation or 1.0
        self.parameters_ = drift_table(self._form, self._terms, self.hyper_, self._fleet)

    def parameter_estimates(self) -> ParameterEstimates:
        """Return the drift columns with the covariance of all of them, and with their priors."""
        self._check_fitted()
        return estimates(self._form, self._terms, self.hyper_, self._fleet, self.inflation_)

    def _take(
        self,
        X: FloatArray,
        e: FloatArray,
        noise_std: FloatArray | None,
        reference: Mapping[str, Any] | None = None,
        centre: FloatArray | None = None,
    ) -> None:
        """Set the samples and the terms at the nominal arm, and choose the solver."""
        assert self.robot is not None
        usual = Usual.of(X, self.conditions, self.robot.dof)
        tool = np.eye(4) if self.tf_flange_tool is None else np.asarray(self.tf_flange_tool, float)
        self._terms = self._nominal = Terms(
            self.robot,
            tool,
            convention=self.convention,
            geometry=self.geometry,
            compliance=self.compliance,
            residual=self.residual,
            gears=self.gear_harmonics,
            backlash_shape=self.backlash_shape,
            conditions=self.conditions,
            usual=usual if reference is None else usual.referred(reference),
            work=self.work,
            reflectors=self.reflectors,
            share=SHARED[0 if noise_std is not None and (noise_std > 0.0).all() else 1],
        )
        self._x, self._e, self._reading, self._own = with_turns(self._terms, X, e, noise_std)
        if centre is not None and len(centre) != len(self._terms.placed):
            raise DataError(f"registration has {len(centre)} numbers, expected {len(self._terms.placed)}")
        if centre is not None:
            self._nominal = self._terms.centred(centre)
        elif self.hyper is None:
            self._nominal = placed(self._terms, self._x, self._e)
        self._terms = self._nominal
        self._distant = 0
        few = len(self._e) <= EXACT_UP_TO
        self.solver_ = ("covariance" if few else "basis") if self.solver == "auto" else self.solver

    @property
    def _centre(self) -> FloatArray:
        """The centre of the prior of base and tool, (c,) [mm, rad]."""
        return self._nominal.centre[self._nominal.placed]

    @property
    def fleet_(self) -> dict[str, Any]:
        """What was taken of a fleet."""
        return {} if self._fleet is None else self._fleet.summary

    @property
    def weight_(self) -> FloatArray:
        """The weights of the samples, (n,)."""
        return self._weight[: len(self._given[1])]

    def models(self, condition: str) -> bool:
        """Return whether the effect of a condition is in the fitted model, not negligible."""
        return self._terms.models(condition, self.hyper_.tolerance / self.hyper_.least_tolerance)

    def member(self, name: str, sha256: str = "") -> Member:
        """Return this fit as a member of a fleet.

        Parameters
        ----------
        name, sha256 : str
            The name of its map, and the hash of the map's file.
        """
        self._check_fitted()
        angle = np.linspace(-np.pi, np.pi, ANGLES)
        own = np.zeros((self._terms.robot.dof, ANGLES))
        curves = own if self._fleet is None else own + [self._fleet.curve(j, angle) for j in range(len(own))]
        for i, j in enumerate(self.joints_):
            curves[j] += self._form.joint_mean(i, angle)
        groups = (GROUPS[GEOMETRY], GROUPS[COMPLIANCE])
        drift = {
            row["name"]: row["estimate"]
            for row in self.parameters_
            if row["group"] in groups and "payload" not in row["name"]
        }
        return Member(name, sha256, self.hyper_, self.joints_, self._terms.range_names, drift, curves)

    def at_work(self, work: Mapping[str, float]) -> Self:
        """Return the fitted model for another ``temperature`` [°C] or ``payload`` [kg] at work."""
        self._check_fitted()
        other = copy.copy(self)
        other.work, other._terms = dict(work), self._terms.at_work(work)
        return other

    def optimum(self) -> tuple[IntArray, Start]:
        """Return the joints and the hyperparameters of this fit, for `start_from`."""
        self._check_fitted()
        return self.joints_, self._optimum

    def start_from(self, optimum: tuple[IntArray, Start]) -> None:
        """Let searches for hyperparameters start at the optimum of similar samples; fewer evaluations find the same.

        Parameters
        ----------
        optimum : tuple
            The `optimum` of a model of equal parameters.
        """
        self._from = optimum

    def with_turns(self, X: ArrayLike, conditions: Sequence[str]) -> tuple[Self, bool]:
        """Return the fit with measured orientations beside its positions, and whether these gain from them.

        Hyperparameters, and weights of positions, are those of this fit: the likelihood of orientations would spoil
        them where the model describes turns less well than positions. Gain is a smaller mean length of the residuals of
        left-out positions.

        Parameters
        ----------
        X : (n, d) array_like
            The joints and conditions of the samples of this fit, with orientations.
        conditions : sequence of str
            The conditions in X.
        """
        self._check_fitted()
        e, noise, own = self._given[1], self._given[2], self.weight_
        other = self.with_fitted_parameters().set_params(conditions=tuple(conditions))
        assert self.robot is not None
        turned = len(turned_rows(np.asarray(X), conditions, self.robot.dof))
        weight = np.ones(turned)
        for _ in range(ROUNDS):
            other.set_params(weight=[*own, *weight]).fit(X, e, noise)
            before, weight = weight, robust_weights(*other._left_out_alone())[len(own) :]
            if not self.robust or np.abs(np.sqrt(weight) - np.sqrt(before)).max(initial=0.0) < SETTLED:
                break
        other._optimum, other.log_likelihood_ = self._optimum, self.log_likelihood_
        other.bounds_hit_ = self.bounds_hit_
        left, before = (np.linalg.norm(one.leave_one_out().residual, axis=1).mean() for one in (other, self))
        return other, bool(left < before)

    def update(self, X: ArrayLike, y: ArrayLike, noise_std: ArrayLike | None = None) -> Self:
        """Add samples and compute the posterior of all samples with unchanged hyperparameters.

        New readings that the others contradict get a smaller weight, as in `fit`; the old weights stay.

        Parameters
        ----------
        X : (m, dof) array_like [rad]
            The joints of the new samples.
        y : (m, 3) array_like [mm], base frame
            The errors, after the same registration as those of `fit`.
        noise_std : float, (m,) or (m, 3) array_like [mm], optional
            The standard deviations of the readings; required if and only if they were passed to `fit`.

        Returns
        -------
        self

        Raises
        ------
        DataError
            If shapes disagree with those of `fit`, or a number is not finite.
        """
        self._check_fitted()
        old_x, old_e, old_noise = self._given
        new = self._unfitted()
        x, e = new._validate(X, y)
        if x.shape[1] != old_x.shape[1] or e.shape[1:] != (3,):
            raise DataError(f"new samples {x.shape}, {e.shape}: expected (m, {old_x.shape[1]}) joints, (m, 3) errors")
        if (noise_std is None) != (old_noise is None):
            raise DataError("pass noise_std to update if and only if it was passed to fit")
        reading = None if noise_std is None else checked_noise(noise_std, e.shape)
        noise = None if reading is None or old_noise is None else np.concatenate([old_noise, reading])
        self._given = np.concatenate([old_x, x]), np.concatenate([old_e, e]), noise
        old_weight, n = self._weight[: len(self._weight) - self._distant], len(old_e)
        self._take(*self._given, self._terms.usual.reference, self._centre)
        fresh = self._own >= n
        self._weight = np.ones(len(self._e))
        self._weight[~fresh] = old_weight
        with self._blas():
            for _ in range(ROUNDS if self.robust else 0):
                self._form = self._solved(self._terms.at(self._x))
                weight = robust_weights(*self._left_out_alone())[fresh]
                change = np.abs(np.sqrt(weight) - np.sqrt(self._weight[fresh])).max()
                self._weight[fresh] = weight
                if change < SETTLED:
                    break
            self._settle(np.empty(0))
        self.gross_ = np.flatnonzero(self.weight_ < GROSS)
        self.parameters_ = drift_table(self._form, self._terms, self.hyper_, self._fleet)
        return self

    def _leave_blocks_out(self, labels: NDArray[Any]) -> LeaveOneOut:
        apart = labels.max() + 1 + np.arange(self._distant)
        return self._left(*self._form.left_out(np.concatenate([labels, apart])[self._own]))

    def _validate(self, X: ArrayLike, y: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
        """Return joints and conditions (n, d), and y; conditions may be NaN, or left out for a prediction."""
        found, checked = super()._validate(X, y)
        hidden = y is None and self.robot is not None and len(self.conditions) > 0
        return (unseen(found, self.conditions, self.robot.dof) if hidden and self.robot else found), checked

    def _left(self, residual: FloatArray, covariance: FloatArray) -> LeaveOneOut:
        std = np.sqrt(self.inflation_ * np.einsum("naa->na", covariance))
        return LeaveOneOut(residual[: len(self.weight_)], std[: len(self.weight_)])

    def _inflation(self, start: Start) -> float:
        """Return the factor of predicted variances that makes unseen readings standard; gross ones do not count."""
        design = self._terms.at(self._x)
        kept = np.flatnonzero(self._weight >= GROSS)
        reading = self._reading * np.sqrt(self.tails().factor)
        samples = Part(self._terms, design, self.joints_, self._target(design), reading, self._weight)
        residual, covariance = self._left_out_alone(poses=True)
        return inflation(samples.take(kept), residual[kept], covariance[kept], start, self.random_state)

    def tails(self) -> Tails:
        """Return the tails of the noise of readings, normal ones where it was not stated."""
        rows = np.flatnonzero((self._terms.at(self._x).turn == 0.0) & (self._reading > 0.0).all(axis=1))
        rows = np.random.default_rng(self.random_state).permutation(rows[self._weight[rows] >= GROSS])[:MOST]
        if len(rows) < FEWEST:
            return Tails()
        residual, covariance = self._left_out_alone(poses=True)
        nugget, reading = self.hyper_.noise**2, self._reading[rows] ** 2
        field = covariance[rows] - (nugget + reading)[:, :, None] * np.eye(3)
        return tails(residual[rows], field, nugget, np.sqrt(reading.mean(axis=1)))

    def _leave_one_out(self) -> LeaveOneOut:
        return self._left(*self._poses_out())

    def _fitted_parameters(self) -> dict[str, Any]:
        own = Usual.of(self._given[0], self.conditions, self._terms.robot.dof).reference
        kept = self._terms.usual.reference
        return {
            "hyper": self.hyper_.to_dict(),
            "weight": self._weight.tolist(),
            "joints": self.joints_.tolist(),
            "inflation": self.inflation_,
            "reference": None if kept == own else kept,
            "registration": self._centre.tolist() if self._centre.any() else None,
            "fleet": None if self._fleet is None else self._fleet.to_dict(),
        }
