"""The tables of a cell file."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, field_validator, model_validator

from truepose._io.strict import is_whole
from truepose._typing import FloatArray
from truepose.cell.poses import CellError, CellSection, NotNegative, Number, Pose, Positive, Share, Temperature
from truepose.errors import DataError

Fit = Literal["none", "position", "pose"]


class RobotSection(CellSection):
    """``[robot]``: a library name, or the path of a .toml, .csv or .urdf file relative to the cell file.

    ``id`` names this very robot: its serial number, or a name of its own; a map corrects programs of no other one.
    ``repeatability_mm`` is RP of ISO 9283, as stated by the maker. ``world_height_mm`` confirms that the poses of the
    file are relative to the controller's world, see `truepose.cell.world_height`.
    """

    model: str
    id: Annotated[str, Field(strict=True, min_length=1, max_length=200)] | None = None
    repeatability_mm: Positive | None = None
    world_height_mm: Positive | None = None


class Tool(Pose):
    """``[tool]``: flange to the measured point. With ``fit`` the values are starting values."""

    fit: Fit = "none"


class Reflector(CellSection):
    """``[reflectors.NAME]``: the position of a reflector in the flange frame, and its standard deviation per axis.

    With ``[tool] fit`` all reflectors are moved together with the tool, as one rigid body. ``std_mm`` is what each of
    them may deviate from its stated place on that body.
    """

    x_mm: Number
    y_mm: Number
    z_mm: Number
    std_mm: Positive = 0.02

    @property
    def p_flange(self) -> FloatArray:
        """The position in the flange frame, (3,) [mm]."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])


class DistanceOrigin(CellSection):
    """``[distances.NAME]``: a fixed point from which distances to the tool point are measured, tracker frame.

    ``std_mm`` is the standard deviation of a distance.
    """

    x_mm: Number
    y_mm: Number
    z_mm: Number
    std_mm: Positive = 0.02

    @property
    def p_tracker(self) -> FloatArray:
        """The position in the tracker frame, (3,) [mm]."""
        return np.array([self.x_mm, self.y_mm, self.z_mm])


class Base(Pose):
    """``[base]``: the robot's base in the measuring (world) frame. With ``fit`` the values are starting values."""

    fit: Fit = "none"


class Tracker(Pose):
    """``[tracker]``: the station of the tracker in the world frame, and its noise.

    By default the station is found by registration. Data cannot separate the base from the station, so fitting either
    or both is the same fit of six parameters.
    """

    fit: Literal["none", "pose"] = "pose"
    robust: bool = True
    std_mm: Positive | None = None
    range_um: NotNegative | None = None
    range_um_per_m: NotNegative | None = None
    angle_um: NotNegative | None = None
    angle_um_per_m: NotNegative | None = None

    @field_validator("fit", mode="before")
    @classmethod
    def _from_bool(cls, value: object) -> object:
        return {True: "pose", False: "none"}[value] if isinstance(value, bool) else value

    @model_validator(mode="after")
    def _one_noise(self) -> Self:
        if self.std_mm is not None and self._terms():
            raise CellError(("std_mm",), f"cannot be combined with {', '.join(self._terms())}; state only one form")
        return self

    def _terms(self) -> list[str]:
        names = ("range_um", "range_um_per_m", "angle_um", "angle_um_per_m")
        return [name for name in names if getattr(self, name) is not None]

    def reading_std(self, p_tracker: FloatArray) -> FloatArray | None:
        """Return the standard deviations of readings at (n, 3) [mm], tracker frame: (n, 3) [mm], or None if not stated.

        With u the direction of the beam, σ² = σ_across² + (σ_along² − σ_across²) u², where each σ grows with distance.
        """
        if self.std_mm is not None:
            return np.full(p_tracker.shape, self.std_mm)
        if not self._terms():
            return None
        distance = np.linalg.norm(p_tracker, axis=1, keepdims=True)
        beam = p_tracker / np.maximum(distance, np.finfo(float).tiny)
        along = 1e-3 * ((self.range_um or 0.0) + (self.range_um_per_m or 0.0) * 1e-3 * distance)
        across = 1e-3 * ((self.angle_um or 0.0) + (self.angle_um_per_m or 0.0) * 1e-3 * distance)
        std: FloatArray = np.sqrt(across**2 + (along**2 - across**2) * beam**2)
        return std


class UncertaintySection(CellSection):
    """``[uncertainty]``: contributions to the uncertainty of a verified target that no file of readings has.

    ``reflector_mm`` is how far the centre of the reflector may lie from that of its nest, ``temperature_K`` how far
    the arm may be from the temperature of the samples (both limits), ``tool_mm`` the standard uncertainty of the
    reflector's place relative to the tool of programs. ``expansion_um_per_m_K`` is the arm's expansion, by default that
    of steel.
    """

    reflector_mm: NotNegative | None = None
    tool_mm: NotNegative | None = None
    temperature_K: NotNegative | None = None  # noqa: N815 - kelvin, as in the cell file
    expansion_um_per_m_K: NotNegative = 12.0  # noqa: N815 - the same


class Payload(CellSection):
    """``[payload]``: mass, and centre of mass in the flange frame, of samples that state none and at work."""

    mass_kg: NotNegative = 0.0
    x_mm: Number = 0.0
    y_mm: Number = 0.0
    z_mm: Number = 0.0

    @property
    def centre(self) -> FloatArray | None:
        """The centre of mass, (3,) [mm], flange frame; None if no coordinate of it is stated."""
        stated = {"x_mm", "y_mm", "z_mm"} & self.model_fields_set
        return np.array([self.x_mm, self.y_mm, self.z_mm]) if stated else None


def _number_keys(value: object) -> object:
    """Convert keys of digits to numbers: controllers number their frames (KUKA, FANUC) or name them (ABB)."""
    if not isinstance(value, dict):
        return value
    return {int(key) if isinstance(key, str) and is_whole(key) else key: entry for key, entry in value.items()}


class ConditionsSection(CellSection):
    """``[conditions]``: the direction of approach of samples, and temperature and payload at work.

    ``approach`` is "stated" (by the columns approach1 …), "from-order" (each sample was reached straight from the row
    before) or "none". Temperature and payload are those of predictions and corrections that state none; by default
    they are those of the samples, and the payload is that of ``[payload]``. ``payloads`` are those with the tools of
    the controller, by number or name; they are on the flange at the targets that a program moves to with this tool.
    """

    approach: Literal["stated", "from-order", "none"] = "stated"

    temperature_C: Temperature | None = None  # noqa: N815 - °C, as in the cell file
    payload_kg: NotNegative | None = None
    payloads: Annotated[dict[int | str, Payload], BeforeValidator(_number_keys)] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _with_masses(self) -> Self:
        for key, payload in self.payloads.items():
            if "mass_kg" not in payload.model_fields_set:
                raise CellError(("payloads", key, "mass_kg"), "is missing; state the mass on the flange with this tool")
        return self

    @property
    def at_work(self) -> dict[str, Any]:
        """Temperature and payloads by key, where they are stated."""
        names = ("temperature_C", "payload_kg", "payloads")
        return {name: value for name in names if (value := getattr(self, name)) not in (None, {})}

    @property
    def words(self) -> str:
        """Temperature and payloads in words."""
        said = [f"{name} {value:g}" for name, value in self.at_work.items() if name != "payloads"]
        said += [f"payload with tool {key} {payload.mass_kg:g} kg" for key, payload in self.payloads.items()]
        return ", ".join(said)


def conditions_at_work(temperature: float | None, payload: float | None) -> ConditionsSection:
    """Return the conditions at work of a command's options, in °C and kg.

    Raises
    ------
    DataError
        If one of them cannot be.

    Examples
    --------
    >>> conditions_at_work(25.0, None).at_work
    {'temperature_C': 25.0}
    """
    try:
        return ConditionsSection(temperature_C=temperature, payload_kg=payload)
    except ValidationError:
        raise DataError(
            f"temperature {temperature} °C, payload {payload} kg: expected -50 to 80 °C, and 0 kg or more"
        ) from None


GroupNumber = Annotated[int, Field(ge=1, le=8)]
"""A motion group of a FANUC controller."""


class GroupsSection(CellSection):
    """``[frames.groups]``: the motion group of this robot, and those that carry neither it nor a user frame."""

    robot: GroupNumber = 1
    independent: list[GroupNumber] = Field(default_factory=list)

    @model_validator(mode="after")
    def _other_groups(self) -> Self:
        if self.robot in self.independent:
            raise CellError(("independent",), f"group {self.robot} is this robot; state the other groups")
        return self


class FramesSection(CellSection):
    """``[frames]``: the controller's tool and base tables, stated here or in its ``$config.dat``."""

    config_dat: str | None = None
    tools: Annotated[dict[int | str, Pose], BeforeValidator(_number_keys)] = Field(default_factory=dict)
    bases: Annotated[dict[int | str, Pose], BeforeValidator(_number_keys)] = Field(default_factory=dict)
    groups: GroupsSection = Field(default_factory=GroupsSection)


class Correction(CellSection):
    """``[correction]``: the limits of corrections, and the policy beyond them; defaults are in docs/cell.md.

    ``tolerance_mm`` is the tolerated distance of the tool from its target; by default ``max_std_mm`` is half of it.
    ``max_bend_mm`` is the largest bend that corrections may add to a path, see `truepose.programs.core.paths`.
    ``max_difference_mm`` and ``max_difference_mrad`` are the largest differences between the correction of a target and
    those that the map gives at positions which share it, see `truepose.programs.core.alternatives`.
    ``require`` is the share of a program's motion targets that must be corrected, such as "95%".
    ``max_distance_mm`` applies to maps in Cartesian space, ``max_distance_deg`` to maps in joint space.
    ``max_joint_gap_deg`` is the largest distance of each joint's angle to that of a sample, see
    `truepose.compensation.JointCoverage`.
    """

    tolerance_mm: Positive | None = None
    max_std_mm: Positive | None = None
    min_correction_stds: NotNegative = 2.0
    max_correction_mm: Positive = 5.0
    max_distance_mm: Positive | None = None
    max_distance_deg: Positive | None = None
    max_joint_gap_deg: Positive | None = None
    max_angle_deg: Positive | None = None
    max_tool_mm: Positive = 50.0
    max_rotation_mrad: Positive = 10.0
    max_rotation_std_mrad: Positive = 3.0
    max_bend_mm: Positive | None = None
    max_difference_mm: Positive = 0.2
    max_difference_mrad: Positive = 1.0
    require: Share = 0.0
    on_guard: Literal["refuse", "skip", "clip"] = "refuse"


class RegionSection(Pose):
    """``[region]``: the work region, a box centred at x_mm, y_mm, z_mm along the axes of a base of the controller.

    The angles are the orientation of the tool in this base; work deviates from it by up to ``tilt_deg`` about each
    axis.
    """

    size_mm: tuple[Positive, Positive, Positive]
    home_deg: list[Number]
    tilt_deg: NotNegative = 0.0
    frame: int | str | None = None


class Box(CellSection):
    """``[obstacles.NAME]``: a box in the base frame that the arm must avoid."""

    x_mm: tuple[Number, Number]
    y_mm: tuple[Number, Number]
    z_mm: tuple[Number, Number]

    @model_validator(mode="after")
    def _low_high(self) -> Self:
        for key in ("x_mm", "y_mm", "z_mm"):
            low, high = getattr(self, key)
            if low >= high:
                raise CellError((key,), f"expected the smaller number first, got {low:g} and {high:g}")
        return self


class Measuring(CellSection):
    """``[measuring]``: motion and dwell of the measuring program, and the visibility of the reflector.

    With ``approach = "both"`` joints come to their poses from either side, so that their lost motion is measured.
    """

    dwell_s: Positive = 2.0
    speed_percent: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=100)] = 20.0
    trigger_output: Annotated[int, Field(strict=True, ge=1)] | None = None
    approach_deg: NotNegative = 3.0
    approach: Literal["below", "both"] = "both"
    limit_margin_deg: NotNegative = 5.0
    reflector_axis: tuple[Number, Number, Number] | None = None
    acceptance_deg: Positive = 30.0
    link_radius_mm: NotNegative = 150.0
    repeatability_mm: Positive = 0.02

    @field_validator("reflector_axis")
    @classmethod
    def _has_direction(cls, value: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if value is not None and not any(value):
            raise ValueError("reflector_axis is zero; write [0.0, 0.0, 1.0] for the z axis of the tool")
        return value
