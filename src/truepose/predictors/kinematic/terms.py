"""Compute the columns of theory (10) at given configurations: the effect of each kind of error on the tool point.

Drift: registration (base and tool), geometry (in any convention), joint compliance under gravity. Levers: ∂P/∂q_j, the
effect of an error of joint j's own angle. Place: coordinates of the rest Z.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.predictors.conditions import Usual, checked_work, separated
from truepose.predictors.kinematic.design import Design
from truepose.predictors.kinematic.effects import effect_size
from truepose.predictors.kinematic.gears import RIPPLE_STD, Gears
from truepose.predictors.kinematic.growing import growing
from truepose.predictors.kinematic.masses import COMPLIANCE_STD, Masses
from truepose.predictors.orientation import at_offset, rotation_per_mm
from truepose.predictors.reflectors import REFLECTOR, Reflectors
from truepose.robots import Robot, error_model
from truepose.robots.chain import end_poses
from truepose.robots.jacobian import Outputs, columns, count_rows, joint_columns, joint_twists

Residual = Literal["joint", "cartesian", "both", "none"]

REGISTRATION, GEOMETRY, COMPLIANCE, STATION, BACKLASH, EXPANSION, WARMING, GEAR, SHAPE, OFFSET = range(10)
GROUPS: Final = (
    "registration", "geometry", "compliance", "station", "backlash", "expansion", "warming", "gear", "backlash shape",
    "offset",
)  # fmt: skip
"""The kinds of drift columns; all but registration, which has wide priors, have a tolerance scale each."""

_EFFECTS: Final = {
    STATION: "time",
    BACKLASH: "approach",
    SHAPE: "approach",
    EXPANSION: "temperature",
    WARMING: "time",
    OFFSET: "time",
}
_COUNTS: Final = 1.5  # times the least scale

_GEOMETRY_STD: Final = {"mm": 0.5, "rad": 1e-3, "1": 1e-3}
_REGISTRATION: Final = {"base": {"mm": 30.0, "rad": 0.03}, "tool": {"mm": 30.0}}  # one point shows no turn of the tool
_TURN_STD: Final = (0.03, 0.003)  # rad, of the tool with several reflectors: in any place, or on one line
_BACKLASH_STD: Final = 1e-4  # rad, half of the lost motion
_SHAPE_STD: Final = 3e-5  # rad, of a harmonic of the lost motion
_WALK_STD: Final = {"mm": 0.05, "rad": 2e-5}  # of the station, from one of its times to the next
_OFFSET_STD: Final = 1e-5  # rad, of the offset of a joint, from one time of the walk to the next
_EXPANSION_STD: Final = (1e-5, 3e-6)  # 1/K: of all lengths together, and of each length in addition
_WARMING_STD: Final = 1e-5  # of all lengths, from one time of the walk to the next
_APART: Final = 1e6  # coordinates of Z: nothing is that near
_USUAL: Final = Usual()
_UNSEEN: Final = 0.02  # of the largest lever; the axis of a joint with a shorter one passes through the tool point


class _Column(NamedTuple):
    """A drift column."""

    group: int
    name: str
    unit: str
    prior_std: float


class Terms:
    """The terms of (10) in a model, with their names and prior standard deviations.

    Parameters
    ----------
    robot : Robot
        The nominal robot.
    tf_flange_tool : (4, 4) array [mm]
        The measured point.
    convention : str
        The convention of the geometry, see `truepose.robots.error_model`.
    geometry, compliance : bool
        Whether these drift columns are included; registration always is.
    residual : {"joint", "cartesian", "both", "none"}
        The coordinates of Z.
    gears : bool
        Whether harmonics of the motors' angles are included, if the robot states its gear ratios.
    backlash_shape : bool
        Whether backlash may vary with the angle of its joint, by the first two harmonics of the angle.
    conditions : sequence of str
        The conditions whose effects are included, see `truepose.predictors.conditions`.
    usual : Usual
        The conditions of the samples.
    work : mapping of str to float
        The temperature [°C] and the payload [kg] at work, where a configuration states none.
    reflectors : Reflectors, optional
        The reflectors that rows may name; by default all rows are of the tool point.
    share : float
        The share of the noise that rows of one visit have in common, see `truepose.predictors.kinematic.visits`.
    shift : (p,) array [mm, rad], optional
        The change of registration and geometry at which the columns are computed; default: none.
    centre : (c,) array [mm, rad], optional
        The change of base and tool about which their prior is; default: none. Coefficients are relative to it.

    Attributes
    ----------
    names, units : list of str
        The names and units of the drift columns.
    group : (p,) array of int
        The group of each column, an index into `GROUPS`.
    prior_std : (p,) array
        The prior standard deviations in the units of the columns.
    range_of : (d,) array of int
        The range of each coordinate of Z: one per joint, one for the position.
    """

    def __init__(
        self,
        robot: Robot,
        tf_flange_tool: FloatArray,
        *,
        convention: str = "hayati",
        geometry: bool = True,
        compliance: bool = True,
        residual: Residual = "joint",
        gears: bool = True,
        backlash_shape: bool = False,
        conditions: Sequence[str] = (),
        usual: Usual = _USUAL,
        work: Mapping[str, float] | None = None,
        reflectors: Reflectors | None = None,
        share: float = 1.0,
        shift: FloatArray | None = None,
        centre: FloatArray | None = None,
    ) -> None:
        self.robot = robot
        self.tf_flange_tool = np.asarray(tf_flange_tool, float)
        self.convention, self.geometry, self.compliance, self.residual = convention, geometry, compliance, residual
        self._gears = Gears(robot.gear_ratio if gears else np.empty(0))
        self.conditions, self.usual, self.work = tuple(conditions), usual, checked_work(work or {})
        self._shape = Gears(np.ones(robot.dof if backlash_shape and "approach" in conditions else 0))
        self.share = share
        self.reflectors = reflectors if REFLECTOR in self.conditions else None
        dof = robot.dof
        self._model = error_model(robot, convention, self.tf_flange_tool)
        registration = self._registration()
        self._chosen = [
            i
            for i, parameter in enumerate(self._model.parameters)
            if (parameter.unit in registration[parameter.group] if parameter.group in registration else geometry)
        ]
        given = set(self.conditions)
        self._load = Masses(robot, arm=compliance, payload="payload" in given, centre="centre" in given)
        thermal = {"temperature", "time"} & given
        growth = growing(robot) if thermal else np.empty((dof + 1, 6, 0))
        self._steps = len(usual.times) - 1 if "time" in self.conditions else 0
        lengths = _lengths(growth.shape[2] if "temperature" in self.conditions else 0)
        warming = [_Column(WARMING, f"warming {step + 1}", "1", _WARMING_STD) for step in range(self._steps)]
        moving = [*self._walk(), *self._places(), *self._waves()]
        parts = [self._arm(), self._masses(), moving, self._reversals(), self._offsets(), lengths, warming]
        self._counts = [len(part) for part in parts]
        every = [column for part in parts for column in part]
        self.names, self.units = [column.name for column in every], [column.unit for column in every]
        self.group = np.array([column.group for column in every])
        self.prior_std = np.array([column.prior_std for column in every])
        self.centre = np.zeros(len(self.names))
        if centre is not None:
            self.centre[self.placed] = centre
        self.shift = self.centre if shift is None else shift
        self._values = self._model.nominal.copy()
        self._values[self._chosen] += self.shift[: len(self._chosen)]
        self._nominal_links = robot.links(self.tf_flange_tool)
        self._links = self._model.fixed(self._values)
        parameters = self._model.twists(self._values)[..., self._chosen]
        self._twists = np.concatenate([joint_twists(robot.sign), parameters, growth], axis=2)
        joints = np.repeat(np.arange(dof), 2) if residual in ("joint", "both") else np.empty(0, np.int64)
        position = np.full(3, len(np.unique(joints))) if residual in ("cartesian", "both") else np.empty(0, np.int64)
        self.range_of = np.concatenate([joints, position]).astype(np.int64)
        self.range_names = [f"joint {j + 1}" for j in np.unique(joints)] + (["position"] if len(position) else [])

    def _arm(self) -> list[_Column]:
        """Return the columns of registration and geometry."""
        out, registration = [], self._registration()
        for parameter in (self._model.parameters[i] for i in self._chosen):
            of = REGISTRATION if parameter.group in registration else GEOMETRY
            std = registration.get(parameter.group, _GEOMETRY_STD)[parameter.unit]
            out.append(_Column(of, parameter.name, parameter.unit, std))
        return out

    def _registration(self) -> dict[str, dict[str, float]]:
        """Return the prior standard deviations of base and tool by unit; several reflectors show the tool's turn."""
        if self.reflectors is None or not self._several:
            return _REGISTRATION
        turn = _TURN_STD[int(self.reflectors.on_a_line)]
        return {**_REGISTRATION, "tool": {**_REGISTRATION["tool"], "rad": turn}}

    @property
    def placed(self) -> IntArray:
        """The drift columns of base and tool, (c,)."""
        return np.flatnonzero(self.group[: self._counts[0]] == REGISTRATION)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kind of each drift column: that of the parameter of the arm (``theta``, ``base`` …), or its group."""
        arm = [self._model.parameters[i].group for i in self._chosen]
        return (*arm, *(GROUPS[group] for group in self.group[len(arm) :]))

    def rise(self, design: Design) -> FloatArray:
        """Return the mean rise of the point at configurations by each joint under the largest payload, (dof, p) [mm].

        Per unit of each drift coefficient; 0 for columns other than those of a payload.
        """
        own = slice(self._counts[0], self._counts[0] + self._counts[1])
        joint, loaded = self._load.of_payload
        out = np.zeros((self.robot.dof, len(self.names)))
        here = design.turn == 0.0
        out[joint, np.arange(own.start, own.stop)] = design.drift[here, 2, own].mean(axis=0) / self.prior_std[own]
        out[:, own] *= loaded / max(self.usual.payload / self.usual.largest_payload, _UNSEEN)
        return out

    def _places(self) -> list[_Column]:
        """Return the columns of what each reflector is away from its stated place, and of a target's mounting."""
        out = []
        if self._several:
            assert self.reflectors is not None
            every = zip(self.reflectors.names, self.reflectors.std, strict=True)
            out = [
                _Column(REGISTRATION, f"reflector {name} {axis}", "mm", std) for name, std in every for axis in "xyz"
            ]
        if "orientation" in self.conditions:
            out += [_Column(REGISTRATION, f"target r{axis}", "rad", _TURN_STD[0]) for axis in "xyz"]
        return out

    @property
    def _several(self) -> bool:
        return self.reflectors is not None and len(self.reflectors.names) > 1

    def _masses(self) -> list[_Column]:
        return [_Column(COMPLIANCE, name, "rad/m", COMPLIANCE_STD) for name in self._load.names]

    def _walk(self) -> list[_Column]:
        """Return the columns of a station that moves, those of the base for each step of its walk."""
        chosen = [self._model.parameters[i] for i in self._chosen]
        self._base = [place for place, parameter in enumerate(chosen) if parameter.group == "base"]
        return [
            _Column(STATION, f"station {chosen[i].name} {step + 1}", chosen[i].unit, _WALK_STD[chosen[i].unit])
            for step in range(self._steps)
            for i in self._base
        ]

    def _reversals(self) -> list[_Column]:
        joints = range(self.robot.dof) if "approach" in self.conditions else ()
        constant = [_Column(BACKLASH, f"backlash q{j + 1}", "rad", _BACKLASH_STD) for j in joints]
        shape = [name.replace("gear", "backlash") for name in self._shape.names]
        return constant + [_Column(SHAPE, name, "rad", _SHAPE_STD) for name in shape]

    def _offsets(self) -> list[_Column]:
        """Return the columns of joints whose offsets move slowly, those of each joint in turn."""
        every = [(j, step) for j in range(self.robot.dof) for step in range(self._steps)]
        return [_Column(OFFSET, f"offset q{j + 1} {step + 1}", "rad", _OFFSET_STD) for j, step in every]

    @property
    def turning(self) -> IntArray:
        """The joints that the first columns of `conditional` turn: those of backlash, its shape, and offsets."""
        joints = np.arange(self.robot.dof)
        constant = joints if "approach" in self.conditions else joints[:0]
        every = (constant, self._shape.rows[:, 0].astype(int).repeat(2), joints.repeat(self._steps))
        return np.concatenate(every).astype(np.int64)

    def _waves(self) -> list[_Column]:
        return [_Column(GEAR, name, "rad", RIPPLE_STD) for name in self._gears.names]

    @property
    def waves(self) -> slice:
        """The drift columns of the gears' harmonics, in the order of `truepose.predictors.kinematic.gears.Gears`."""
        end = sum(self._counts[:3])
        return slice(end - len(self._gears.names), end)

    @property
    def wave_rows(self) -> FloatArray:
        """The joint and the factor of its angle of each pair of columns of `waves`, (h, 2)."""
        return self._gears.rows

    @property
    def linearised(self) -> tuple[FloatArray, FloatArray, int]:
        """The links (dof + 1, 4, 4) [mm] and the twists (dof + 1, 6, p) of the p columns of the arm itself; p."""
        p = self._counts[0]
        return self._links, self._twists[:, :, self.robot.dof : self.robot.dof + p], p

    def growth(self) -> tuple[FloatArray, FloatArray]:
        """Return the twists of expansion and warming at work: known, and unknown per coefficient, (dof + 1, 6, g)."""
        known, unknown = self._kelvin(np.full(1, np.nan))
        every = self._twists[:, :, self.robot.dof + self._counts[0] :]
        twists, warming = every[:, :, : self._counts[5]], np.repeat(every[:, :, :1], self._steps, axis=2)
        return (
            np.concatenate([known * twists, 0.0 * warming], axis=2),
            np.concatenate([unknown * twists, warming], axis=2),
        )

    def effect_size(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return `truepose.predictors.kinematic.effects.effect_size` of all drift coefficients (p,), (p, p)."""
        own, (backlash, offsets, lengths, warming) = self.conditional, self._counts[3:]
        passed = np.array(self.usual.passed if self._steps else ())
        return effect_size(mean[own], covariance[own, own], (backlash, offsets, lengths, warming), passed)

    def moments(self, estimate: FloatArray, power: int = 1) -> FloatArray:
        """Return the deviation of each joint by each mass per horizontal lever at work, (dof, dof + 1, …) [rad/mm].

        Parameters
        ----------
        estimate : (p, …) array [rad/m]
            The coefficients of all drift columns; their squares for the variance, with `power` 2.
        """
        first, count = self._counts[:2]
        load = float(self._loads(np.full(1, np.nan))[0])
        return self._load.moments(estimate[first : first + count], load, power)

    def _loads(self, payload: FloatArray) -> FloatArray:
        """Return payloads (n, …) [kg] over the largest one; that at work, or the usual one, where not known."""
        known = np.where(np.isnan(payload), self.work.get("payload", self.usual.payload), payload)
        return np.asarray(known / self.usual.largest_payload)

    def _unknown_masses(
        self, q: FloatArray, p: FloatArray, lever: FloatArray, given: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return the columns of `Design.mass`, (n, r, b, c)."""
        count = len(self._load.names) - self._load.plain
        steps = []
        if count and "payload" not in self.work and self.usual.payload_std and np.isnan(given["payload"]).any():
            mass = np.where(np.isnan(given["payload"]), self.usual.payload_std / self.usual.largest_payload, 0.0)
            steps.append(self._load.columns(q, p, lever, mass, self._centres(given)))
        if self._load.centred and (unknown := np.isnan(given["centre"])).any():
            here, load = self._centres(given), self._loads(given["payload"])
            plain = self._load.columns(q, p, lever, load, here)
            for axis in np.eye(3) * self.usual.centre_std:
                steps.append(self._load.columns(q, p, lever, load, here + np.where(unknown, axis, 0.0)) - plain)
        if not steps:
            return np.zeros((*lever.shape[:2], 0, count))
        std = self.prior_std[self._payload]
        return np.asarray(np.stack([step[:, :, self._load.plain :] for step in steps], axis=2) * std)

    @property
    def _payload(self) -> slice:
        """The drift columns of payloads."""
        end = sum(self._counts[:2])
        return slice(end - len(self._load.names) + self._load.plain, end)

    def unknown_effects(self, design: Design, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Return the effects of conditions that are not known, of unit variance each: (n, r, u) [mm, rad].

        Parameters
        ----------
        design : Design
            The columns at n configurations.
        mean, covariance : (p,), (p, p) arrays
            The drift coefficients, per prior standard deviation.

        Returns
        -------
        (n, r, u) array
            The first `sided` columns are those of directions of approach, which differ from pose to pose.
        """
        effects = design.unknown * self.effect_size(mean, covariance)
        if not design.mass.shape[2]:
            return np.asarray(effects)
        own = self._payload
        value, vector = np.linalg.eigh(covariance[own, own])
        coefficients = np.column_stack([mean[own], vector * np.sqrt(np.maximum(value, 0.0))])
        masses = (design.mass @ coefficients).reshape(*design.mass.shape[:2], -1)
        return np.concatenate([effects, masses], axis=2)

    @property
    def sided(self) -> int:
        """The number of columns of backlash and its shape."""
        return self._counts[3]

    def _centres(self, given: Mapping[str, FloatArray]) -> FloatArray | None:
        """Return the centres of mass of payloads (n, 3) [mm], flange frame; the usual one where not known."""
        if "centre" not in given:
            return None
        return np.where(np.isnan(given["centre"]), self.usual.centre, given["centre"])

    def _kelvin(self, temperature: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the differences of temperatures (n, …) [°C] from the usual one, and their standard deviations [K]."""
        known = np.where(np.isnan(temperature), self.work.get("temperature", np.nan), temperature)
        unknown = np.isnan(known)
        difference = np.where(unknown, 0.0, known - self.usual.temperature)
        return difference, np.where(unknown, self.usual.temperature_std, 0.0)

    def shifted(self, shift: FloatArray) -> Terms:
        """Return the same terms with registration and geometry changed by `shift` (p,)."""
        return self._moved(np.where(np.arange(len(shift)) < self._counts[0], shift, 0.0), self.centre[self.placed])

    def centred(self, centre: FloatArray) -> Terms:
        """Return the same terms with the prior of base and tool about `centre` (c,), their columns computed there."""
        return self._moved(None, centre)

    def _moved(self, shift: FloatArray | None, centre: FloatArray) -> Terms:
        return Terms(
            self.robot,
            self.tf_flange_tool,
            convention=self.convention,
            geometry=self.geometry,
            compliance=self.compliance,
            residual=self.residual,
            gears=self._gears.known,
            backlash_shape=self._shape.known,
            conditions=self.conditions,
            usual=self.usual,
            work=self.work,
            reflectors=self.reflectors,
            share=self.share,
            shift=shift,
            centre=centre,
        )

    def at_work(self, work: Mapping[str, float]) -> Terms:
        """Return the same terms for other conditions at work."""
        other = copy.copy(self)
        other.work = checked_work(work)
        return other

    def curvature(self, design: Design) -> FloatArray:
        """Return F(ψ + shift) − F(ψ) − J (shift − centre), the part of the shift's effect that no coefficient has.

        Of shape (n, r) [mm, rad]; without a centre, it is the nonlinear part.
        """
        if not self.shift.any():
            return np.zeros((len(design.q), design.rows))
        nominal = end_poses(self.robot.sign * design.q, self._nominal_links)
        moved: FloatArray = design.p - _points(nominal, design.away)
        if design.rows == 6 or design.turn.any():
            turned = end_poses(self.robot.sign * design.q, self._links)[:, :3, :3] @ np.swapaxes(
                nominal[:, :3, :3], 1, 2
            )
            vectors = Rotation.from_matrix(turned).as_rotvec()
            if design.rows == 6:
                moved = np.concatenate([moved, vectors], axis=1)
            else:
                moved = np.where(design.turn[:, None] > 0.0, design.turn[:, None] * vectors, moved)
        return np.asarray(moved - np.einsum("nap,p->na", design.drift, (self.shift - self.centre) / self.prior_std))

    @property
    def scaled_groups(self) -> list[int]:
        """The groups with a tolerance scale, indices into `GROUPS`."""
        effects = [group for group in _EFFECTS if self._has(group)]
        return [GEOMETRY, COMPLIANCE, *effects, *([GEAR] if self._gears.known else [])]

    def _has(self, group: int) -> bool:
        return _EFFECTS[group] in self.conditions and (group != SHAPE or self._shape.known)

    def models(self, condition: str, above_least: FloatArray) -> bool:
        """Return whether the effect of a condition counts, from the scales of `scaled_groups` over their least (g,)."""
        if condition == "payload":  # in proportion to compliance, which has no term of its own to leave out
            return condition in self.conditions and self.compliance
        scales = zip(self.scaled_groups, above_least, strict=True)
        return any(_EFFECTS.get(group) == condition and scale > _COUNTS for group, scale in scales)

    @property
    def conditional(self) -> slice:
        """The drift columns of backlash, expansion and warming."""
        return slice(len(self.names) - sum(self._counts[3:]), None)

    def at(self, X: FloatArray, outputs: Outputs = "position") -> Design:
        """Return all columns at configurations with conditions (n, d) [rad, …], for positions or for poses.

        A configuration with a measured orientation gives three rows of orientation instead of position, times the
        length that `rotation_per_mm` converts with: what the model does not explain turns the tool by as much.

        Raises
        ------
        DataError, RobotError
            If X has another number of columns than joints and conditions, or joints are beyond the robot's limits.
        """
        q, given = separated(X, self.conditions, self.robot.dof)
        q = self.robot.check_joints(q)
        theta, dof = self.robot.sign * q, self.robot.dof
        ends, own, turn = end_poses(theta, self._links), given.get(REFLECTOR), self._turn_lengths(theta, given)
        p, away = ends[:, :3, 3], np.zeros((len(q), 3))
        visit = np.full(len(q), np.nan) if own is None else own[:, 1]
        if (own is None or self.reflectors is None) and not turn.any():
            found = columns(theta, self._links, self._twists, outputs)
        else:
            found = columns(theta, self._links, self._twists, "pose")
            if own is not None and self.reflectors is not None:
                away = self.reflectors.at(own[:, 0])
                found = at_offset(found, _points(ends, away) - p)
            found[:, :3] = np.where(turn[:, None, None] > 0.0, turn[:, None, None] * found[:, 3:], found[:, :3])
            found = found[:, : count_rows(outputs)]
        lever, drift, growth = np.split(found, [dof, dof + self._counts[0]], axis=2)
        lever = np.ascontiguousarray(lever)
        parts, unknown = [drift], [np.zeros((*lever.shape[:2], 0))]
        if self.compliance:
            load = self._loads(given["payload"]) if "payload" in given else None
            parts.append(self._load.columns(q, p, lever, load, self._centres(given)))
        if "time" in given:
            moved = drift[:, :, self._base]
            ramps = self.usual.walked(given["time"][:, 0])
            parts.append((moved[:, :, None, :] * ramps[:, None, :, None]).reshape(*moved.shape[:2], -1))
        if own is not None and self._several:
            parts.append(self._own_places(ends[:, :3, :3], own[:, 0], lever.shape[1]))
        if "orientation" in given:
            mounting = np.zeros((*lever.shape[:2], 3))
            mounting[:, :3] = turn[:, None, None] * ends[:, :3, :3]
            parts.append(mounting)
        if self._gears.known:
            parts.append(self._gears.columns(q, lever))
        if "approach" in given:
            signs = given["approach"][:, None, :]
            for part, by in ((parts, signs), (unknown, 1.0 * (signs == 0.0))):
                part.extend((lever * by, self._shape.columns(q, lever * by)))
        if "time" in given:
            parts.append((lever[:, :, :, None] * ramps[:, None, None]).reshape(*lever.shape[:2], -1))
            later = np.isnan(given["time"])[:, :, None]
            unknown.append(np.repeat(np.where(later, lever, 0.0), self._steps, axis=2))
        if "temperature" in given:
            kelvin, kelvin_std = self._kelvin(given["temperature"][:, :, None])
            parts.append(growth * kelvin)
            unknown.append(growth * kelvin_std)
        if "time" in given:  # the arm of the samples grew; when it works, it may have gone on
            parts.append(growth[:, :, :1] * ramps[:, None, :])
            unknown.append(np.repeat(np.where(later, growth[:, :, :1], 0.0), self._steps, axis=2))
        every = np.concatenate(parts, axis=2) * self.prior_std
        missing = np.concatenate(unknown, axis=2) * self.prior_std[self.conditional]
        p = _points(ends, away)
        place = self._place(q, p)
        place[turn > 0.0] += _APART  # Z is a field of positions: its part in orientations is another one
        mass = self._unknown_masses(q, p, lever, given)
        return Design(q, p, every, lever, place, missing, mass, away, visit, turn)

    def _turn_lengths(self, theta: FloatArray, given: Mapping[str, FloatArray]) -> FloatArray:
        """Return the lengths of `Design.turn` at the nominal arm, (n,) [mm]; 0 without a measured orientation."""
        turn = np.zeros(len(theta))
        if "orientation" in given and (turned := np.isfinite(given["orientation"][:, 0])).any():
            turn[turned] = 1.0 / rotation_per_mm(joint_columns(theta[turned], self._nominal_links, self.robot.sign))
        return turn

    def _own_places(self, turn: FloatArray, index: FloatArray, rows: int) -> FloatArray:
        """Return the columns of `_places` for reflectors by number (n,) on a tool turned by (n, 3, 3)."""
        assert self.reflectors is not None
        m = len(self.reflectors.names)
        out = np.zeros((len(turn), rows, m, 3))
        for k in range(m):
            out[index == k, :3, k] = turn[index == k]
        return out.reshape(len(turn), rows, 3 * m)

    def seen(self, design: Design) -> IntArray:
        """Return the joints whose own error is visible: they move, and the tool point moves with them."""
        size = np.sqrt(np.mean(np.sum(design.lever[:, :3] ** 2, axis=1), axis=0))
        moves = np.ptp(design.q, axis=0) > 1e-3
        return np.flatnonzero(moves & (size > _UNSEEN * size.max()))

    def _place(self, q: FloatArray, p: FloatArray) -> FloatArray:
        parts = []
        if self.residual in ("joint", "both"):
            parts.append(np.stack([np.cos(q), np.sin(q)], axis=2).reshape(len(q), -1))
        if self.residual in ("cartesian", "both"):
            parts.append(p / 1000.0)
        return np.concatenate(parts, axis=1) if parts else np.empty((len(q), 0))


def _points(poses: FloatArray, away: FloatArray) -> FloatArray:
    """Return the points `away` (n, 3) [mm] in the frames of poses (n, 4, 4), (n, 3) [mm]."""
    return np.asarray(poses[:, :3, 3] + np.einsum("nij,nj->ni", poses[:, :3, :3], away))


def _lengths(count: int) -> list[_Column]:
    """Return the columns of expansion."""
    every = [("expansion of all lengths", _EXPANSION_STD[0])]
    every += [(f"expansion {i}", _EXPANSION_STD[1]) for i in range(1, count)]
    return [_Column(EXPANSION, name, "1/K", std) for name, std in every[:count]]
