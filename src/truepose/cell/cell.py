"""The cell file: robot, tool, tracker, frames, work region and the limits of corrections.

``cell.toml`` has one table for each. Lengths are in mm, and angles are those of the controller, as its pendant shows
them. Only ``[robot] model`` is required.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, Self

from pydantic import Field, PrivateAttr, ValidationError, ValidationInfo, model_validator

from truepose._io.files import LARGEST_CONFIG, read_text
from truepose._io.strict import parse_toml
from truepose._typing import FloatArray
from truepose.cell.poses import ANGLE_KEYS, CONTROLLER, CellError, CellSection, Pose
from truepose.cell.reflectors import check_names, check_reflectors
from truepose.cell.report import ReportSection
from truepose.cell.sections import (
    Base,
    Box,
    ConditionsSection,
    Correction,
    DistanceOrigin,
    FramesSection,
    Measuring,
    Payload,
    Reflector,
    RegionSection,
    RobotSection,
    Tool,
    Tracker,
    UncertaintySection,
)
from truepose.cell.text import CellProblem, problems_of, tables
from truepose.cell.world_height import check_world_height
from truepose.errors import FileError
from truepose.geometry.transforms import invert_transform
from truepose.robots import Robot, load_robot
from truepose.robots.io.library import ROBOT_FILES

_UNNAMED: Final = "cell.toml"


class Cell(CellSection):
    """A robot cell as described in its file.

    Attributes
    ----------
    robot, tool, base, tracker, payload, conditions, frames, region, measuring, report, correction : CellSection
        The tables of the file; ``region`` is None if not stated.
    obstacles : dict of str to Box
        The obstacles by name.
    reflectors : dict of str to Reflector
        The reflectors on the tool by name, for samples with a column ``reflector``.
    distances : dict of str to DistanceOrigin
        The fixed points by name from which distances are measured, for samples with a column ``distance_mm``.
    tf_flange_tool : (4, 4) array [mm]
        The pose of the measured point in the flange frame.
    tf_world_base, tf_world_tracker, tf_base_tracker : (4, 4) array [mm]
        The stated poses; starting values if ``fit`` asks for them.
    tools, bases : dict of int or str to (4, 4) array [mm]
        The frames stated in the file, by number or name, without those of ``config_dat``.

    Examples
    --------
    >>> from truepose.cell import template
    >>> Cell.from_toml(template("kuka-kr150-2")).controller
    'kuka'
    """

    robot: RobotSection
    tool: Tool = Field(default_factory=Tool)
    reflectors: dict[str, Reflector] = Field(default_factory=dict)
    distances: dict[str, DistanceOrigin] = Field(default_factory=dict)
    base: Base = Field(default_factory=Base)
    tracker: Tracker = Field(default_factory=Tracker)
    payload: Payload = Field(default_factory=Payload)
    conditions: ConditionsSection = Field(default_factory=ConditionsSection)
    frames: FramesSection = Field(default_factory=FramesSection)
    region: RegionSection | None = None
    obstacles: dict[str, Box] = Field(default_factory=dict)
    measuring: Measuring = Field(default_factory=Measuring)
    correction: Correction = Field(default_factory=Correction)
    report: ReportSection = Field(default_factory=ReportSection)
    uncertainty: UncertaintySection = Field(default_factory=UncertaintySection)

    _folder: Path = PrivateAttr(default=Path())
    _controller: str | None = PrivateAttr(default=None)
    _robot: Any = PrivateAttr(default=None)

    @classmethod
    def from_toml(cls, text: str, *, folder: str | Path = ".", source: str | Path = "cell.toml") -> Self:
        """Return the cell that the text of a cell file describes.

        Parameters
        ----------
        text : str
            The text.
        folder : str or Path
            The folder of relative paths.
        source : str or Path
            The file's name in error messages.

        Raises
        ------
        FileError
            If the text is not TOML, a key is unknown or has an invalid value, or the robot cannot be loaded.
        """
        try:
            return cls.model_validate(parse_toml(text, source), context={"folder": Path(folder)})
        except ValidationError as error:
            first = problems_of(error, cls, text)[0]
            raise FileError(source, str(first), line=first.line) from None

    @classmethod
    def problems(cls, text: str, *, folder: str | Path = ".") -> list[CellProblem]:
        """Return all errors of the text of a cell file, by key; see `from_toml`.

        Examples
        --------
        >>> from truepose.cell import template
        >>> text = template("kuka-kr150-2").replace("x_mm = 0.0", "x_mm = nan", 1)
        >>> [(problem.loc, problem.line) for problem in Cell.problems(text)]
        [(('tool', 'x_mm'), 10)]
        """
        try:
            cls.model_validate(parse_toml(text, _UNNAMED), context={"folder": Path(folder)})
        except ValidationError as error:
            return problems_of(error, cls, text)
        except FileError as error:
            words = str(error).removeprefix(f"{_UNNAMED}:{error.line}: ").removeprefix(f"{_UNNAMED}: ")
            return [CellProblem((), words, error.line)]
        return []

    @model_validator(mode="after")
    def _resolve(self, info: ValidationInfo) -> Self:
        context = info.context or {}
        self._folder, self._robot = Path(context.get("folder", "")), context.get("robot")
        try:
            robot = self.load_robot()
        except ValueError as error:
            raise CellError(("robot", "model"), str(error)) from None
        controller = CONTROLLER.get(robot.maker.lower(), robot.maker.lower())
        self._controller = controller if controller in ANGLE_KEYS else None
        poses: dict[tuple[str | int, ...], Pose] = {
            ("tool",): self.tool,
            ("base",): self.base,
            ("tracker",): self.tracker,
        }
        poses |= {("frames", "tools", number): pose for number, pose in self.frames.tools.items()}
        poses |= {("frames", "bases", number): pose for number, pose in self.frames.bases.items()}
        if self.region is not None:
            poses[("region",)] = self.region
            if len(self.region.home_deg) != robot.dof:
                raise CellError(("region", "home_deg"), f"expected {robot.dof} joints, got {len(self.region.home_deg)}")
        for loc, pose in poses.items():
            try:
                pose.matrix(self._controller)
            except CellError as error:
                raise CellError((*loc, *error.loc), str(error)) from None
        check_reflectors({name: one.p_flange for name, one in self.reflectors.items()})
        check_names("distances", self.distances)
        if self._robot is None:  # a map has the robot, and the frames, with which it was fitted
            check_world_height(robot, self.robot.world_height_mm, self.bases, self._relative_to_base())
        tolerances = (self.report.tolerance_mm, self.correction.tolerance_mm)
        if None not in tolerances and tolerances[0] != tolerances[1]:
            message = "states {:g} mm, but [correction] states {:g} mm; state one tolerance".format(*tolerances)
            raise CellError(("report", "tolerance_mm"), message)
        return self

    def __repr__(self) -> str:
        stated = {"region": self.region is not None, "obstacles": bool(self.obstacles)}
        parts = [
            f"tool at ({self.tool.x_mm:g}, {self.tool.y_mm:g}, {self.tool.z_mm:g}) mm, fit {self.tool.fit}",
            f"tracker fit {self.tracker.fit}",
            f"payload {self.payload.mass_kg:g} kg",
            f"corrections up to {self.correction.max_correction_mm:g} mm, {self.correction.on_guard} beyond",
            *(f"with {name}" for name, there in stated.items() if there),
        ]
        return f"<Cell of {self.robot.model}: {'; '.join(parts)}>"

    __str__ = __repr__

    def _relative_to_base(self) -> list[str]:
        """Return the stated tables that are relative to the robot's base."""
        found = [] if self.station_fitted else ["[base]", "[tracker]"]
        found += ["[region]"] if self.region is not None and self.region.frame is None else []
        found += [f"[obstacles.{name}]" for name in self.obstacles]
        return found + [f"[frames.bases.{number}]" for number in self.bases]

    def load_robot(self) -> Robot:
        """Return the robot that ``[robot] model`` states, or that of the validation context (a map has its own)."""
        if self._robot is not None:
            robot: Robot = self._robot
            return robot
        model = self.robot.model
        return load_robot(str(self._folder / model) if model.lower().endswith(ROBOT_FILES) else model)

    @property
    def robot_id(self) -> str | None:
        """The name of this very robot: ``[robot] id``, else ``[report] robot_serial``; None if neither is stated."""
        return self.robot.id or self.report.robot_serial

    @property
    def controller(self) -> str | None:
        """The controller whose angles the file states, a key of `ANGLE_KEYS`; None if the maker has no entry."""
        return self._controller

    @property
    def station_fitted(self) -> bool:
        """Whether the tracker's station, or the equivalent base, is fitted to the samples."""
        return self.tracker.fit == "pose" or self.base.fit != "none"

    @property
    def tolerance_mm(self) -> float | None:
        """The largest permitted length of a positional error [mm], as ``[report]`` or ``[correction]`` states it."""
        return self.report.tolerance_mm or self.correction.tolerance_mm

    @property
    def logo(self) -> Path | None:
        """The path of the company's logo, or None if the file does not state it."""
        return None if self.report.logo is None else self._folder / self.report.logo

    @property
    def config_dat(self) -> Path | None:
        """The path of the controller's ``$config.dat``, or None if the file does not state it."""
        return None if self.frames.config_dat is None else self._folder / self.frames.config_dat

    @property
    def tf_flange_tool(self) -> FloatArray:
        """The pose of the measured point in the flange frame, (4, 4) [mm]."""
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
        """The tools stated in this file, flange to tool, (4, 4) [mm]."""
        return {number: pose.matrix(self._controller) for number, pose in self.frames.tools.items()}

    @property
    def bases(self) -> dict[int | str, FloatArray]:
        """The bases stated in this file, robot base to frame, (4, 4) [mm]."""
        return {number: pose.matrix(self._controller) for number, pose in self.frames.bases.items()}

    def to_toml(self) -> str:
        """Return the text of the cell file, with all stated values; relative paths are unchanged."""
        return "\n".join(tables((), self.model_dump(exclude_unset=True, exclude_none=True))).lstrip("\n") + "\n"


def load_cell(path: str | Path) -> Cell:
    """Return the cell that a file describes.

    Parameters
    ----------
    path : str or Path
        The cell file.

    Raises
    ------
    FileError
        If the file cannot be read, is not TOML, a key is unknown or has an invalid value, or the robot cannot be
        loaded; the message names file and line.

    Examples
    --------
    >>> import tempfile
    >>> from truepose.cell import template
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "cell.toml")
    ...     _ = path.write_text(template("kuka-kr150-2"), "utf-8")
    ...     load_cell(path).tool.fit
    'position'
    """
    return Cell.from_toml(read_text(path, LARGEST_CONFIG), folder=Path(path).parent, source=path)
