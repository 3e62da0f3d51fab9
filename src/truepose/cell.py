"""The cell file: which robot, which tool, where the tracker stands, and how far a correction may go.

``cell.toml`` has one table for each of these; lengths are mm and angles are the controller's own, as its pendant shows
them. Everything but ``[robot] model`` may be left out. `template` writes a file that explains every key.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from truepose.errors import DataError, FileError
from truepose.files import read_text
from truepose.geometry.angles import euler
from truepose.geometry.transforms import invert_transform, make_transform
from truepose.robots import load_robot

if TYPE_CHECKING:
    from truepose.robots import Robot

FloatArray = NDArray[np.float64]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Fit = Literal["none", "position", "pose"]

ANGLE_KEYS: Final[dict[str, tuple[str, ...]]] = {
    "kuka": ("a_deg", "b_deg", "c_deg"),
    "abb": ("q1", "q2", "q3", "q4"),
    "fanuc": ("w_deg", "p_deg", "r_deg"),
    "ur": ("rx_rad", "ry_rad", "rz_rad"),
    "yaskawa": ("rx_deg", "ry_deg", "rz_deg"),
    "staubli": ("rx_deg", "ry_deg", "rz_deg"),
}
"""The keys of an orientation, by controller; `truepose.geometry.euler` says what they mean."""
_CONTROLLER: Final = {"universal-robots": "ur", "universal robots": "ur", "stäubli": "staubli"}


class _CellError(ValueError):
    """An error that several keys cause together; `loc` says at which it is shown."""

    def __init__(self, loc: tuple[str | int, ...], message: str) -> None:
        self.loc = loc
        super().__init__(message)


class Section(BaseModel):
    """A table of the cell file: frozen, and a key that it does not know is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Pose(Section):
    """A pose by its values: x_mm, y_mm, z_mm and the controller's own angles; what is left out is zero.

    Lengths are mm: a key such as x_m is refused, but a value in metres under x_mm cannot be told from a short tool.
    """

    x_mm: Number = 0.0
    y_mm: Number = 0.0
    z_mm: Number = 0.0
    a_deg: Number | None = None
    b_deg: Number | None = None
    c_deg: Number | None = None
    q1: Number | None = None
    q2: Number | None = None
    q3: Number | None = None
    q4: Number | None = None
    w_deg: Number | None = None
    p_deg: Number | None = None
    r_deg: Number | None = None
    rx_rad: Number | None = None
    ry_rad: Number | None = None
    rz_rad: Number | None = None
    rx_deg: Number | None = None
    ry_deg: Number | None = None
    rz_deg: Number | None = None

    def matrix(self, controller: str | None) -> FloatArray:
        """Return the (4, 4) transform [mm]; ``controller=None`` (maker unknown) takes the angles that are there.

        Raises
        ------
        ValueError
            If the angles are another controller's, mixed, ambiguous, or no unit quaternion.
        """
        p = np.array([self.x_mm, self.y_mm, self.z_mm])
        given = {key for keys in ANGLE_KEYS.values() for key in keys if getattr(self, key) is not None}
        if not given:
            return make_transform(translation=p)
        controller = self._controller(given) if controller is None else controller
        keys = ANGLE_KEYS[controller]
        wrong = sorted(given - set(keys))
        if wrong:
            raise _CellError((wrong[0],), f"is not an angle of a {controller} controller; write {', '.join(keys)}")
        values = [getattr(self, key) for key in keys]
        if controller == "abb" and None in values:
            raise _CellError((keys[0],), "a quaternion needs all of q1, q2, q3, q4")
        try:
            return make_transform(euler(controller, np.array([value or 0.0 for value in values])), p)
        except DataError as error:
            raise _CellError((keys[0],), str(error)) from None

    def _controller(self, given: set[str]) -> str:
        fitting = [name for name, keys in ANGLE_KEYS.items() if given <= set(keys)]
        if len(fitting) != 1:
            why = f"may be {' or '.join(fitting)}" if fitting else "mix controllers"
            remedy = "the robot's maker is unknown, so write a_deg, b_deg, c_deg (Rz Ry Rx) or q1 … q4"
            raise _CellError((min(given),), f"the angles {why}; {remedy}")
        return fitting[0]


class RobotSection(Section):
    """``[robot]``: a library name, or the path of a .toml or .urdf file relative to the cell file."""

    model: str


class Tool(Pose):
    """``[tool]``: flange to the measured point. With ``fit`` the values are where the fit starts."""

    fit: Fit = "none"


class Base(Pose):
    """``[base]``: the robot's base in the measuring (world) frame. With ``fit`` the values are where the fit starts."""

    fit: Fit = "none"


class Tracker(Pose):
    """``[tracker]``: its station in the world frame, and its noise.

    By default the station is found by registration. A fitted base and a fitted station are the same six numbers: data
    cannot tell them apart, so both together mean one fit.
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
            raise _CellError(("std_mm",), f"stands beside {', '.join(self._terms())}; give one or the other")
        return self

    def _terms(self) -> list[str]:
        names = ("range_um", "range_um_per_m", "angle_um", "angle_um_per_m")
        return [name for name in names if getattr(self, name) is not None]

    def reading_std(self, p_tracker: FloatArray) -> FloatArray | None:
        """Return the standard deviation of readings at (n, 3) [mm], tracker frame: (n, 3) [mm], or None if not stated.

        With u the beam's direction: σ² = σ_across² + (σ_along² − σ_across²) u², each σ growing with the distance.
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


class Payload(Section):
    """``[payload]``: mass and centre of mass in the flange frame."""

    mass_kg: NotNegative = 0.0
    x_mm: Number = 0.0
    y_mm: Number = 0.0
    z_mm: Number = 0.0


class Frames(Section):
    """``[frames]``: the controller's tool and base tables, given here or in its ``$config.dat``."""

    config_dat: str | None = None
    tools: dict[int | str, Pose] = Field(default_factory=dict)
    bases: dict[int | str, Pose] = Field(default_factory=dict)

    @field_validator("tools", "bases", mode="before")
    @classmethod
    def _number_keys(cls, value: object) -> object:
        """Make numbers of keys that are digits: controllers number their frames (KUKA, FANUC) or name them (ABB)."""
        if not isinstance(value, dict):
            return value
        return {int(key) if isinstance(key, str) and key.isdecimal() else key: pose for key, pose in value.items()}


class Correction(Section):
    """``[correction]``: what a correction may be, and what happens where it may not. None: found from the samples."""

    max_std_mm: Positive | None = None
    max_correction_mm: Positive = 5.0
    max_distance_mm: Positive | None = None
    max_angle_deg: Positive = 20.0
    max_tool_mm: Positive = 50.0
    on_guard: Literal["refuse", "skip", "clip"] = "refuse"


class Cell(Section):
    """A robot cell as its user describes it.

    Attributes
    ----------
    robot, tool, base, tracker, payload, frames, correction : Section
        The tables of the file.
    tf_flange_tool : (4, 4) array [mm]
        The measured point, seen from the flange.
    tf_world_base, tf_world_tracker, tf_base_tracker : (4, 4) array [mm]
        Poses as stated; where ``fit`` asks for them, only starting values.
    tools, bases : dict of int or str to (4, 4) array [mm]
        The frames given in this file, by number or name; those of ``config_dat`` are not among them.
    """

    robot: RobotSection
    tool: Tool = Field(default_factory=Tool)
    base: Base = Field(default_factory=Base)
    tracker: Tracker = Field(default_factory=Tracker)
    payload: Payload = Field(default_factory=Payload)
    frames: Frames = Field(default_factory=Frames)
    correction: Correction = Field(default_factory=Correction)

    _folder: Path = PrivateAttr(default=Path())
    _controller: str | None = PrivateAttr(default=None)
    _robot: Any = PrivateAttr(default=None)

    @classmethod
    def from_toml(cls, text: str, *, folder: str | Path = ".", source: str | Path = "cell.toml") -> Self:
        """Return the cell that a text describes; its relative paths start at `folder`, messages name `source`.

        Raises
        ------
        FileError
            If it is not TOML, a key is unknown or has a wrong value, or the robot cannot be loaded.
        """
        try:
            return cls.model_validate(tomllib.loads(text), context={"folder": Path(folder)})
        except tomllib.TOMLDecodeError as error:
            what, line = _toml_position(str(error))
            raise FileError(source, f"is not TOML: {what}", line=line) from None
        except ValidationError as error:
            loc, message = _explain(error)
            raise FileError(source, message, line=_line_of(text, loc)) from None

    @model_validator(mode="after")
    def _resolve(self, info: ValidationInfo) -> Self:
        context = info.context or {}
        self._folder, self._robot = Path(context.get("folder", "")), context.get("robot")
        try:
            maker = self.load_robot().maker.lower()
        except ValueError as error:
            raise _CellError(("robot", "model"), str(error)) from None
        controller = _CONTROLLER.get(maker, maker)
        self._controller = controller if controller in ANGLE_KEYS else None
        poses: dict[tuple[str | int, ...], Pose] = {
            ("tool",): self.tool,
            ("base",): self.base,
            ("tracker",): self.tracker,
        }
        poses |= {("frames", "tools", number): pose for number, pose in self.frames.tools.items()}
        poses |= {("frames", "bases", number): pose for number, pose in self.frames.bases.items()}
        for loc, pose in poses.items():
            try:
                pose.matrix(self._controller)
            except _CellError as error:
                raise _CellError((*loc, *error.loc), str(error)) from None
        return self

    def load_robot(self) -> Robot:
        """Return the robot that ``[robot] model`` names, or the one of the validation context (a map holds its own)."""
        if self._robot is not None:
            robot: Robot = self._robot
            return robot
        model = self.robot.model
        return load_robot(str(self._folder / model) if model.lower().endswith((".toml", ".urdf")) else model)

    @property
    def station_fitted(self) -> bool:
        """Whether the tracker's station (or the base, which is the same six numbers) is found from the samples."""
        return self.tracker.fit == "pose" or self.base.fit != "none"

    @property
    def config_dat(self) -> Path | None:
        """Path of the controller's ``$config.dat``, if the file names one."""
        return None if self.frames.config_dat is None else self._folder / self.frames.config_dat

    @property
    def tf_flange_tool(self) -> FloatArray:
        """The measured point, seen from the flange, (4, 4) [mm]."""
        return self.tool.matrix(self._controller)

    @property
    def tf_world_base(self) -> FloatArray:
        """The robot's base in the world frame, (4, 4) [mm]."""
        return self.base.matrix(self._controller)

    @property
    def tf_world_tracker(self) -> FloatArray:
        """The tracker's station in the world frame, (4, 4) [mm]."""
        return self.tracker.matrix(self._controller)

    @property
    def tf_base_tracker(self) -> FloatArray:
        """The tracker's station in the robot's base frame, (4, 4) [mm]."""
        tf: FloatArray = invert_transform(self.tf_world_base) @ self.tf_world_tracker
        return tf

    @property
    def tools(self) -> dict[int | str, FloatArray]:
        """Tools given in this file, flange to tool, (4, 4) [mm]."""
        return {number: pose.matrix(self._controller) for number, pose in self.frames.tools.items()}

    @property
    def bases(self) -> dict[int | str, FloatArray]:
        """Bases given in this file, robot base to frame, (4, 4) [mm]."""
        return {number: pose.matrix(self._controller) for number, pose in self.frames.bases.items()}

    def to_toml(self) -> str:
        """Return the file's text, without what is the default; relative paths stay relative to the cell file."""
        return "\n".join(_tables((), self.model_dump(exclude_defaults=True))).lstrip("\n") + "\n"


def load_cell(path: str | Path) -> Cell:
    """Return the cell that a file describes.

    Raises
    ------
    FileError
        See `Cell.from_toml`; the message names file and line.

    Examples
    --------
    >>> load_cell("cell.toml").tf_flange_tool  # doctest: +SKIP
    """
    return Cell.from_toml(read_text(path), folder=Path(path).parent, source=path)


def _tables(header: tuple[str, ...], table: dict[Any, Any]) -> list[str]:
    values = {key: value for key, value in table.items() if not isinstance(value, dict)}
    names = [name if re.fullmatch(r"[\w-]+", name, re.A) else json.dumps(name, ensure_ascii=False) for name in header]
    lines = [f"\n[{'.'.join(names)}]"] if values else []
    # a JSON string is a TOML string, as long as non-ASCII letters stay themselves
    lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in values.items()]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += _tables((*header, str(key)), value)
    return lines


def _toml_position(message: str) -> tuple[str, int | None]:
    match = re.search(r"^(.*) \(at line (\d+), column \d+\)$", message)
    return (match[1], int(match[2])) if match else (message, None)


def _explain(error: ValidationError) -> tuple[tuple[str | int, ...], str]:
    """Return where the first error stands and one line that says what it is and what to do."""
    first = error.errors()[0]
    cause = first.get("ctx", {}).get("error")
    loc = (*first["loc"], *cause.loc) if isinstance(cause, _CellError) else first["loc"]
    loc = loc[:-1] if loc[-1:] == ("[key]",) else loc
    if isinstance(cause, Exception):
        message = str(cause)
    elif first["type"] == "extra_forbidden":
        message = "unknown key; " + _nearest(loc)
    elif first["type"] == "missing":
        message = "is missing; `truepose init` writes a complete file"
    else:
        message = f"{first['msg'].removeprefix('Input ')}, not {first['input']!r}"
    return loc, f"{_name(loc)}: {message}"


def _name(loc: tuple[str | int, ...]) -> str:
    *tables, key = loc
    return f"[{'.'.join(map(str, tables))}] {key}" if tables else f"[{key}]"


def _nearest(loc: tuple[str | int, ...]) -> str:
    known = list(Cell.model_fields)
    if len(loc) > 1:
        section = Cell.model_fields[str(loc[0])].annotation
        model = Pose if len(loc) > 2 else section
        known = list(model.model_fields) if isinstance(model, type) and issubclass(model, BaseModel) else []
    near = difflib.get_close_matches(str(loc[-1]), known, n=1, cutoff=0.5)
    in_metres = " Lengths are mm." if str(loc[-1]).endswith("_m") else ""
    return f"did you mean {near[0]}?{in_metres}" if near else f"known are {', '.join(known)}"


def _line_of(text: str, loc: tuple[str | int, ...]) -> int | None:
    """Return the line of a key, or of the nearest table above it that the text writes."""
    *tables, key = map(str, loc)
    found, header = None, ""
    for number, line in enumerate(text.splitlines(), start=1):
        if match := re.match(r"\s*\[\s*([^\]]+?)\s*\]", line):
            header = match[1].replace('"', "").replace(" ", "")
            if found is None and header in (".".join(tables), ".".join((*tables, key))):
                found = number
        elif (match := re.match(r"""\s*["']?([\w.-]+?)["']?\s*=""", line)) and f"{header}.{match[1]}".strip(
            "."
        ) == ".".join((*tables, key)):
            return number
    return found


_TEMPLATE: Final = """\
# A cell for truepose. Lengths are mm; angles are the controller's own ({angles}).
# Everything but the robot's model may be left out.

[robot]
model = "{model}"        # `truepose robots` lists the library; or a path to a .toml or .urdf file

[tool]                   # from the flange to the measured point (the reflector)
x_mm = 0.0
y_mm = 0.0
z_mm = 0.0
{zero_angles}
fit = "position"         # "none": the values are exact; "position", "pose": found from the samples, starting there

[tracker]
fit = "pose"             # "pose": the station is found by registration; "none": x_mm … and the angles say where it is
robust = true            # gross readings are found and left out of the registration
# std_mm = 0.02          # noise of a reading, or, along and across the beam:
# range_um = 5.0
# range_um_per_m = 0.5
# angle_um = 7.5
# angle_um_per_m = 3.0

# [base]                 # the robot's base in the measuring frame; to fit it is to fit the tracker's station
# x_mm = 0.0
# fit = "none"

# [payload]
# mass_kg = 0.0
# x_mm = 0.0             # centre of mass in the flange frame
# y_mm = 0.0
# z_mm = 0.0

# [frames]               # the controller's frames, which programs refer to by number or name
# config_dat = "$config.dat"
# [frames.tools.1]
# x_mm = 0.0
# [frames.bases.1]
# x_mm = 0.0

[correction]
max_correction_mm = 5.0
on_guard = "refuse"      # "refuse" the program, "skip" the target, or "clip" the correction
# max_std_mm = 0.2       # largest predicted standard deviation; left out: three quarters of the samples' RMS error
# max_distance_mm = 200  # to the nearest sample; left out: 1.5 times the widest gap between samples
max_angle_deg = 20.0     # between a target's orientation and that of the sample most alike
max_tool_mm = 50.0       # between the tool point of a target and the measured one
"""


def template(robot_name: str) -> str:
    """Return a commented ``cell.toml`` for a robot, which loads as it is.

    Raises
    ------
    RobotError
        If the robot is not known.
    """
    maker = load_robot(robot_name).maker.lower()
    keys = ANGLE_KEYS.get(_CONTROLLER.get(maker, maker), ANGLE_KEYS["kuka"])
    zero = [f"{key} = {1.0 if key == 'q1' else 0.0}" for key in keys]
    return _TEMPLATE.format(model=robot_name, angles=", ".join(keys), zero_angles="\n".join(zero))
