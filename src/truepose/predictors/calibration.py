"""Calibration as an error model (theory (11)): the arm with identified parameters predicts its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Final, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.errors import DataError, IdentifiabilityError
from truepose.identification import (
    Identification,
    KalmanFilter,
    ParametricArm,
    Positions,
    filtered,
    finish,
    least_squares,
    levenberg_marquardt,
    minimal_subset,
    observability,
    parameter_table,
    poses_to_add,
)
from truepose.identification.batch import LOSSES, Loss
from truepose.identification.frozen import constants_of
from truepose.numerics.frozen import Constants
from truepose.predictors.base import LeaveOneOut
from truepose.predictors.conditioned import ConditionedPredictor
from truepose.predictors.conditions import separated
from truepose.predictors.estimates import ParameterEstimates
from truepose.predictors.folds import blocks_by_size
from truepose.predictors.orientation import at_offset
from truepose.predictors.reflectors import REFLECTOR, Reflectors, whole_poses
from truepose.robots import ErrorModel, Load, Robot

Method = Literal["ls", "lm", "ekf", "ukf"]
Prior = Literal["tolerance", "subset"]
METHODS: Final = ("ls", "lm", "ekf", "ukf")
PRIORS: Final = ("tolerance", "subset")

_PROBES: Final = 60  # random configurations that show the parameters identifiable from ordinary poses


class KinematicCalibration(ConditionedPredictor):
    """Identify an arm's parameters from positional errors, and predict with the identified arm.

    X are joints (n, dof) [rad], or joints and approach signs (n, 2 dof); y are errors (n, 3) [mm] in the base frame
    after a registration with the nominal links. Small corrections of base and tool are among the parameters, so they
    compensate for the part of the errors that the registration removed or added.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    tf_flange_tool : (4, 4) array or (3,) array [mm], optional
        The measured point.
    convention : str
        The kinematic convention, see `truepose.robots.CONVENTIONS`.
    method : {"lm", "ls", "ekf", "ukf"}
        The solver: Levenberg–Marquardt, iterated least squares, extended or unscented Kalman filter.
    parameters : sequence of str, optional
        The geometric parameters, by name or group ("theta", "base" …); default: all.
    terms : sequence of str
        The joint deviations, see `truepose.robots.joint_terms`: "sin1", "cos1", "compliance", "backlash q2" ….
    prior : {"tolerance", "subset"}
        The treatment of parameters that the data do not determine: tolerances as priors
        (`truepose.identification.tolerance`), or a minimal subset with the others at their nominal values. The table
        `parameters_` names them.
    loss : {"linear", "huber", "soft_l1", "cauchy"}
        The loss function of method "lm"; all but "linear" are robust against gross readings.
    payload : (4,) sequence, optional
        The mass [kg] and its centre in the flange frame [mm], for compliance.
    link_kg : (dof,) sequence, optional
        The masses of the links [kg], for compliance; default: a rough estimate.
    gear_ratio : (dof,) sequence, optional
        The gear ratios, for "gearsin1" …; default: those of the robot.
    misfit_std : float [mm], optional
        The standard deviation of unmodelled errors and repeatability; default: estimated.
    identified : (p,) sequence, optional
        The parameter changes of a previous fit; nothing is estimated then.
    conditions : sequence of str
        ``("reflector",)`` where X names the reflector and the visit of each row after the joints.
    reflectors : Reflectors, optional
        These reflectors, at their stated positions.

    Attributes
    ----------
    parameters_ : list of dict
        One row per parameter, see `truepose.identification.parameter_table`.
    solution_ : Identification
        The solution of the identification.
    observability_ : Observability
        The rank, condition number, observability indices, and inseparable parameters.
    misfit_std_ : float [mm]
        The standard deviation of unmodelled errors and repeatability.
    hint_ : str
        The missing rank and poses that would add it; empty if the poses suffice.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.robots import load_robot
    >>> robot = load_robot("kuka-kr150-2")
    >>> q = np.random.default_rng(0).uniform(-1, 1, (40, 6))
    >>> longer = 0.3 * robot.error_jacobian(q, parameters=["a3"])[:, :, 0]
    >>> model = KinematicCalibration(robot).fit(q, longer)
    >>> [round(row["change"], 3) for row in model.parameters_ if row["parameter"] == "a3"]
    [0.3]
    """

    arm_parameters: ClassVar[tuple[str, ...]] = ("robot", "tf_flange_tool", "payload", "reflectors")
    takes_reflectors = True

    def __init__(
        self,
        robot: Robot | None = None,
        tf_flange_tool: ArrayLike | None = None,
        convention: str = "hayati",
        method: Method = "lm",
        parameters: Sequence[str] | None = None,
        terms: Sequence[str] = (),
        prior: Prior = "tolerance",
        loss: Loss = "linear",
        payload: Sequence[float] | None = None,
        link_kg: Sequence[float] | None = None,
        gear_ratio: Sequence[float] | None = None,
        misfit_std: float | None = None,
        identified: Sequence[float] | None = None,
        conditions: Sequence[str] = (),
        reflectors: Reflectors | None = None,
    ) -> None:
        self.robot = robot
        self.tf_flange_tool = tf_flange_tool
        self.convention = convention
        self.method = method
        self.parameters = parameters
        self.terms = terms
        self.prior = prior
        self.loss = loss
        self.payload = payload
        self.link_kg = link_kg
        self.gear_ratio = gear_ratio
        self.misfit_std = misfit_std
        self.identified = identified
        self.conditions = conditions
        self.reflectors = reflectors

    @property
    def calibrated_(self) -> Robot:
        """The arm with its identified geometry; base, tool and joint terms are not included."""
        arm, x = self._arm, self.solution_.x.copy()
        around = np.array([p.group in ("base", "tool") for p in arm.parameters])
        return arm.model.to_robot(arm.values(np.where(around, 0.0, x)))

    @property
    def error_model_(self) -> ErrorModel[Robot]:
        """The nominal error model; its `converted` converts identified values to other conventions."""
        return self._arm.model

    def partial_fit(self, X: ArrayLike, y: ArrayLike, noise_std: ArrayLike | None = None) -> Self:
        """Add samples one after the other during a campaign, with method "ekf" or "ukf".

        Parameters
        ----------
        X, y, noise_std
            The samples, as for `fit`. Either `noise_std` or `misfit_std` of the model is required.

        Returns
        -------
        self

        Raises
        ------
        DataError
            If the method is not a filter, or no noise is known.
        """
        if self.method not in ("ekf", "ukf"):
            raise DataError(f'partial_fit needs method="ekf" or "ukf", got "{self.method}"')
        if noise_std is None and self.misfit_std is None:
            raise DataError("partial_fit needs noise_std, or misfit_std of the model")
        first = not hasattr(self, "_filter")
        checked, e = self._validate(X, y) if first else (self._validate(X)[0], np.asarray(y, float))
        if e.shape != (len(checked), 3):
            raise DataError(f"y has shape {e.shape}, expected ({len(checked)}, 3): errors [mm] in the base frame")
        self._check_options()
        std = np.zeros(e.shape) if noise_std is None else np.broadcast_to(np.asarray(noise_std, float), e.shape)
        data = self._observations(checked, e, std)
        if first:
            self._filter = KalmanFilter(self._arm, kind=self.method)
            self._seen: tuple[FloatArray, FloatArray, FloatArray] = (checked[:0], e[:0], std[:0])
            self._flat = False
        misfit = np.array([self.misfit_std or 0.0])
        self._filter.update(data, misfit)
        X_seen, e_seen, std_seen = self._seen
        self._seen = (np.concatenate([X_seen, checked]), np.concatenate([e_seen, e]), np.concatenate([std_seen, std]))
        self._given = self._seen
        seen = self._observations(*self._seen)
        self._filter = self._filter.again(seen, misfit)
        self._keep(seen, self._filter.x, misfit)
        return self

    def _fit(self, X: FloatArray, e: FloatArray, noise_std: FloatArray | None) -> None:
        self._check_options()
        if e.shape[1] != 3:
            raise DataError(f"y has {e.shape[1]} columns, expected 3: errors [mm] in the base frame")
        if tuple(self.conditions) not in ((), (REFLECTOR,)):
            given = ", ".join(self.conditions)
            raise DataError(f"calibration models no conditions, got {given}; fit kinematic-kriging, which does")
        self.__dict__.pop("_filter", None)
        data = self._observations(X, e, np.zeros(e.shape) if noise_std is None else noise_std)
        misfit = None if self.misfit_std is None else np.array([self.misfit_std])
        if self.identified is not None:
            p = len(self._arm.parameters)
            if len(self.identified) != p or misfit is None:
                raise DataError(f"identified has {len(self.identified)} numbers, expected {p}, and misfit_std as well")
            x = np.asarray(self.identified, float)
        else:
            self._check_poses(data)
            x, misfit = self._solve(data, misfit)
        self._keep(data, x, misfit)

    def _solve(self, data: Positions, misfit: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        arm = self._arm
        if self.method in ("ekf", "ukf"):
            state, level = filtered(arm, data, kind=self.method, misfit=misfit)
            return state.x, level
        options: dict[str, Any] = {"misfit": misfit}
        if self.prior == "tolerance":
            options["tolerance"] = arm.tolerance
        else:
            options["free"] = minimal_subset(arm, data)
        found: Identification
        if self.method == "ls":
            found = least_squares(arm, data, **options)
        else:
            found = levenberg_marquardt(arm, data, loss=self.loss, **options)
        return found.x, found.misfit

    def _keep(self, data: Positions, x: FloatArray, misfit: FloatArray) -> None:
        """Set the fitted attributes from the samples and the identified changes."""
        arm = self._arm
        tolerance = arm.tolerance if self.prior == "tolerance" else None
        # parameters outside a subset are exactly 0
        free = np.ones(len(x), np.bool_) if tolerance is not None else x != 0.0
        self.solution_ = finish(arm, data, x, misfit, tolerance, free=free, loss=self.loss)
        self.misfit_std_ = float(misfit[0])
        self.observability_ = observability(self.solution_.jacobian, arm.names, arm.tolerance)
        self.parameters_ = parameter_table(arm, self.solution_, self.observability_, tolerance is not None)
        self.hint_ = self._hint(data)
        self._data = data

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        q, approach, r = self._split(X)
        x, zero = self.solution_.x, np.zeros((len(X), 3))
        data = Positions(q, zero, np.zeros((len(X), 3, 3)), approach, r)
        e = data.predicted(self._arm, x) - data.predicted(self._arm, np.zeros(len(x)))
        if not return_std:
            return e, None
        columns = data.jacobian(self._arm, x)
        variance = np.einsum("nkp,pr,nkr->nk", columns, self._covariance, columns)
        return e, np.sqrt(variance)

    def parameter_estimates(self) -> ParameterEstimates:
        """Return the identified changes with the covariance of all of them; those that were kept are left out."""
        self._check_fitted()
        found, arm = self.solution_, self._arm
        free, prior = np.flatnonzero(found.free), self.prior == "tolerance"
        own = [arm.parameters[i] for i in free]
        return ParameterEstimates(
            names=tuple(parameter.name for parameter in own),
            kinds=tuple(parameter.group for parameter in own),
            units=tuple(parameter.unit for parameter in own),
            mean=found.x[free],
            covariance=self._covariance[np.ix_(free, free)],
            prior_mean=np.zeros(len(free)),
            prior_std=arm.tolerance[free] if prior else np.full(len(free), np.inf),
        )

    @property
    def _covariance(self) -> FloatArray:
        """The covariance of the parameters; readings of one pose count as one, since they share its motion."""
        return np.asarray(self._together * self.solution_.covariance)

    def constants(self) -> Constants:
        """Return the arrays from which `truepose.numerics.frozen.predict` computes the mean.

        Raises
        ------
        DataError
            If backlash is among the terms: it depends on the approach, which a frozen map does not know.
        """
        self._check_fitted()
        return constants_of(self._arm, self.solution_.x, self.tf_flange_tool)

    def _nugget_variance(self) -> FloatArray:
        return np.full(3, self.misfit_std_**2)

    def _predict_pose(
        self, X: FloatArray, return_std: bool, offset: FloatArray | None
    ) -> tuple[FloatArray, FloatArray | None]:
        q, approach, r = self._split(X)
        x, arm = self.solution_.x, self._arm
        real, nominal = arm.pose(q, x, approach), arm.pose(q, np.zeros(len(x)), approach)
        turned = Rotation.from_matrix(real[:, :3, :3] @ np.swapaxes(nominal[:, :3, :3], 1, 2))
        error = np.concatenate([real[:, :3, 3] - nominal[:, :3, 3], turned.as_rotvec()], axis=1)
        if r is not None:
            lever = np.einsum("nij,nj->ni", nominal[:, :3, :3], r)
            offset = lever if offset is None else lever + offset
        if offset is not None:
            error[:, :3] += turned.apply(offset) - offset
        if not return_std:
            return error, None
        columns = at_offset(arm.jacobian(q, x, approach, "pose"), offset)
        variance = np.einsum("nkp,pr,nkr->nk", columns, self._covariance, columns)
        return error, np.sqrt(variance)

    def _lever(self, X: FloatArray) -> FloatArray:
        return self._arm.model.joint_jacobian(self._split(X)[0])

    def _leave_one_out(self) -> LeaveOneOut:
        data = self._data
        key = data.q if data.approach is None else np.column_stack([data.q, data.approach])
        return self._leave_blocks_out(np.unique(key, axis=0, return_inverse=True)[1].reshape(-1))

    def _leave_blocks_out(self, labels: NDArray[Any]) -> LeaveOneOut:
        """Return the closed form: with H = A C Aᵀ, A = W J, a block's whitened residual without it is (I − H)⁻¹ r.

        (I − H)⁻¹ = I + A C (I − AᵀA C)⁻¹ Aᵀ, the smaller of the two matrices being inverted.
        """
        found, n = self.solution_, len(self._data)
        white = np.einsum("nij,njp->nip", found.whitener, found.jacobian)
        scaled = np.einsum("nij,nj->ni", found.whitener, found.residual)
        left, spread = np.empty((n, 3)), np.empty((n, 3, 3))
        p = white.shape[2]
        for rows in blocks_by_size(labels):  # all blocks of one size at once: (g, m)
            g, m = rows.shape
            a = white[rows].reshape(g, 3 * m, p)
            if 3 * m <= p:
                inverse = np.linalg.inv(np.eye(3 * m) - a @ found.covariance @ np.swapaxes(a, 1, 2))
                left[rows] = (inverse @ scaled[rows].reshape(g, 3 * m, 1)).reshape(g, m, 3)
                own = inverse.reshape(g, m, 3, m, 3)[:, np.arange(m), :, np.arange(m)]
                spread[rows] = np.moveaxis(own, 0, 1)  # numpy puts the paired index first
            else:
                middle = found.covariance @ np.linalg.inv(np.eye(p) - np.swapaxes(a, 1, 2) @ a @ found.covariance)
                moved = middle @ np.swapaxes(a, 1, 2) @ scaled[rows].reshape(g, 3 * m, 1)
                left[rows] = scaled[rows] + (a @ moved).reshape(g, m, 3)
                spread[rows] = np.eye(3) + np.einsum(
                    "gmip,gpr,gmjr->gmij", white[rows], middle, white[rows], optimize=True
                )
        plain = np.linalg.inv(found.whitener)
        own = plain @ spread @ np.swapaxes(plain, 1, 2)
        return LeaveOneOut(np.einsum("nij,nj->ni", plain, left), np.sqrt(np.einsum("nii->ni", own)))

    def robust_surprise(self) -> FloatArray:
        """Return the length of each residual in standard deviations, both by a fit with a robust loss, (n,).

        Its misfit is estimated from the median, so that gross readings increase neither the scale by which they are
        judged nor the residuals of the others.
        """
        misfit = None if self.misfit_std is None else np.array([self.misfit_std])
        found = levenberg_marquardt(self._arm, self._data, self._arm.tolerance, misfit=misfit, loss="cauchy")
        variance = np.einsum("nii->ni", self._data.covariance) + found.misfit[0] ** 2
        return np.asarray(np.linalg.norm(found.residual / np.sqrt(variance), axis=1))

    def _fitted_parameters(self) -> dict[str, Any]:
        return {"misfit_std": self.misfit_std_, "identified": tuple(self.solution_.x.tolist())}

    def _check_options(self) -> None:
        if self.robot is None:
            raise DataError("calibration needs the nominal robot; pass KinematicCalibration(robot, tf_flange_tool, …)")
        for name, known in (("method", METHODS), ("prior", PRIORS), ("loss", LOSSES)):
            if getattr(self, name) not in known:
                raise DataError(f'{name} is "{getattr(self, name)}"; expected one of {", ".join(known)}')
        if self.loss != "linear" and self.method != "lm":
            raise DataError(f'loss "{self.loss}" needs method="lm", got "{self.method}"')
        if self.prior == "subset" and self.method in ("ekf", "ukf"):
            raise DataError('prior="subset" needs method "ls" or "lm"; a Kalman filter needs tolerances')
        if self.misfit_std is not None and not (np.isfinite(self.misfit_std) and self.misfit_std >= 0):
            raise DataError(f"misfit_std is {self.misfit_std}, expected a number >= 0 [mm]")
        load = None
        if self.payload is not None or self.link_kg is not None:
            kg, *centre = self.payload if self.payload is not None else (0.0, 0.0, 0.0, 0.0)
            if len(centre) != 3:
                raise DataError(f"payload is {self.payload}; expected mass [kg] and x, y, z of its centre [mm]")
            load = Load(kg, np.array(centre), None if self.link_kg is None else np.asarray(self.link_kg, float))
        self._arm = ParametricArm.of(
            self.robot,
            self.tf_flange_tool,
            convention=self.convention,
            parameters=self.parameters,
            terms=self.terms,
            load=load,
            gear_ratio=self.gear_ratio,
        )

    def models(self, condition: str) -> bool:
        """Return whether the effect of a condition is in the fitted model: none is, reflectors are no condition."""
        return False

    def at_work(self, work: Mapping[str, float]) -> Self:
        """Return the fitted model for other conditions at work, which it does not know: itself."""
        return self

    def _split(self, X: FloatArray) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
        """Return joints, directions of approach, and points on the tool (n, 3) [mm], where X states them."""
        assert self.robot is not None
        dof = self.robot.dof
        if self.conditions:
            q, given = separated(X, self.conditions, dof)
            r = None if self.reflectors is None else self.reflectors.at(given[REFLECTOR][:, 0])
            return self.robot.check_joints(q), None, r
        if X.shape[1] not in (dof, 2 * dof):
            raise DataError(
                f"X has {X.shape[1]} columns, expected the {dof} joints of {self.robot.name} [rad], "
                f"or {2 * dof} with approach signs"
            )
        return self.robot.check_joints(X[:, :dof]), X[:, dof:] if X.shape[1] == 2 * dof else None, None

    def _observations(self, X: FloatArray, e: FloatArray, std: FloatArray) -> Positions:
        q, approach, r = self._split(X)
        self._together = 1.0
        if r is not None and X.shape[1] > q.shape[1]:
            self._together = len(X) / len(np.unique(whole_poses(q, X[:, -1])))
        data = Positions(q, e, std[:, :, None] ** 2 * np.eye(3), approach, r)
        return replace(data, p=e + data.predicted(self._arm, np.zeros(len(self._arm.parameters))))

    def _check_poses(self, data: Positions) -> None:
        """Refuse too few or too similar samples."""
        arm = self._arm
        seen = observability(data.jacobian(arm, np.zeros(len(arm.parameters))), arm.names)
        possible = self._possible_rank()
        if 2 * seen.rank < possible or 3 * len(data) < possible:
            why = "too few" if 3 * len(data) < possible else "too similar"
            raise IdentifiabilityError(
                f"calibration: {len(data)} samples are {why}: rank {seen.rank} of the {possible} that positions "
                f"support; {self._add(data)}"
            )

    def _hint(self, data: Positions) -> str:
        possible = self._possible_rank()
        if self.observability_.rank >= possible:
            return ""
        return (
            f"the poses determine {self.observability_.rank} of the {possible} combinations of parameters that "
            f"positions support; {self._add(data)}"
        )

    def _possible_rank(self) -> int:
        arm = self._arm
        assert self.robot is not None
        limits = np.clip(self.robot.limits, -np.pi, np.pi)
        probes = np.random.default_rng(0).uniform(limits[:, 0], limits[:, 1], (_PROBES, self.robot.dof))
        approach = np.random.default_rng(1).choice([-1.0, 1.0], probes.shape)
        return observability(arm.jacobian(probes, np.zeros(len(arm.parameters)), approach), arm.names).rank

    def _add(self, data: Positions) -> str:
        listed = "; ".join(
            "(" + ", ".join(f"{angle:.0f}" for angle in row) + ")"
            for row in np.rad2deg(poses_to_add(self._arm, data.q))
        )
        return f"add poses that turn all joints, such as q = {listed} deg, if they are collision-free"
