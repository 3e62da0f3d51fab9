"""The contract of a corrector, such as an error map, and its optional abilities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell, ConditionsSection
from truepose.compensation import LimitsInForce, Policy
from truepose.error_map.facts import Fact
from truepose.programs.core.program import IDENTITY
from truepose.robots import Robot


class CommandedTargets(Protocol):
    """Commands for targets, each with its verdict; see `truepose.compensation.Corrections`."""

    @property
    def p_target(self) -> FloatArray:
        """Wanted positions, (n, 3) [mm], base frame."""

    @property
    def p_command(self) -> FloatArray:
        """Positions to command, (n, 3) [mm], base frame."""

    @property
    def e(self) -> FloatArray:
        """Predicted errors at the commands, (n, 3) [mm], base frame."""

    @property
    def std(self) -> FloatArray:
        """Standard deviations of `e`, (n, 3) [mm]."""

    @property
    def verdict(self) -> NDArray[np.str_]:
        """The verdict on each target, (n,): correct, clip, skip, refuse or below uncertainty."""

    @property
    def reason(self) -> Sequence[str]:
        """The reasons of the verdicts, (n,); "" where there is none."""


@runtime_checkable
class TurnedTargets(Protocol):
    """Commands that turn orientations, too."""

    @property
    def rotation(self) -> FloatArray | None:
        """Rotation vectors of the corrections, (n, 3) [rad], base frame; None where none were asked for."""


class Corrector(Protocol):
    """A model of the errors that gives commands for poses (n, 4, 4), base to tool.

    It may know more: the robot, the cell, its file and hash, the measured tool, limits and the value of its own data.
    """

    def correct(  # noqa: D102
        self,
        poses: FloatArray,
        *,
        tf_flange_tool: FloatArray,
        status: IntArray,
        turn: IntArray,
        on_guard: Policy,
        orientation: bool = False,
    ) -> CommandedTargets: ...


@runtime_checkable
class KnowsCell(Protocol):
    """A corrector that was fitted to a cell."""

    cell: Cell


@runtime_checkable
class KnowsRobot(Protocol):
    """A corrector that was fitted to a robot."""

    robot: Robot


@runtime_checkable
class KnowsTool(Protocol):
    """A corrector that knows the tool of the measurements, flange to tool, (4, 4) [mm]."""

    tf_flange_tool: FloatArray


@runtime_checkable
class HasHash(Protocol):
    """A corrector that is identified by a hash."""

    hash: str


@runtime_checkable
class FromFile(Protocol):
    """A corrector that was read from a file; None where it was not."""

    path: Path | None


@runtime_checkable
class LimitsCorrections(Protocol):
    """A corrector with limits, which `correct` then takes as an argument."""

    def limits_in_force(self, cell: Cell | None = None, **options: Any) -> LimitsInForce:
        """Return the limits, those of a cell file and of options included."""


@runtime_checkable
class KnowsApproach(Protocol):
    """A corrector that may depend on lost motion of joints; `correct` then takes `before`, see `ErrorMap.correct`."""

    @property
    def depends_on_approach(self) -> bool:
        """Whether corrections or their standard deviations depend on the direction of approach."""


@runtime_checkable
class KnowsWork(Protocol):
    """A corrector that can be asked for another temperature or payload at work, see `ErrorMap.at_work`.

    Its `correct` takes `load` and `p_load`, the payload of each target.
    """

    def at_work(self, conditions: ConditionsSection | Cell) -> Corrector:
        """Return the corrector for the ``[conditions]`` of a cell, or for a cell with its ``[payload]``."""


@runtime_checkable
class KnowsPayload(Protocol):
    """A corrector that knows the payload that it corrects for."""

    @property
    def payload_at_work(self) -> tuple[float, float] | None:
        """The payload at work twice, or the range of the samples' payloads [kg]; None where nothing is known."""


class _ArmCheck(Protocol):
    @property
    def checked(self) -> bool: ...
    @property
    def words(self) -> str: ...


@runtime_checkable
class ChecksArm(Protocol):
    """A corrector that compared the model of the arm with commanded positions."""

    @property
    def arm_check(self) -> _ArmCheck:
        """The result of the comparison."""


@runtime_checkable
class KnowsFacts(Protocol):
    """A corrector that says what is known about it, see `truepose.ErrorMap.facts`."""

    @property
    def facts(self) -> Sequence[Fact]:
        """The facts."""


class _Worth(Protocol):
    @property
    def weak(self) -> bool: ...
    @property
    def words(self) -> str: ...


@runtime_checkable
class KnowsWorth(Protocol):
    """A corrector that was compared with no correction at all."""

    @property
    def worth(self) -> _Worth:
        """The result of the comparison."""


@dataclass(frozen=True)
class CorrectionContext:
    """The cell, robot, file and tool that a corrector was made for; None where it does not state them."""

    cell: Cell | None
    robot: Robot | None
    path: Path | None
    tf_flange_tool: FloatArray

    @classmethod
    def of(cls, corrector: Corrector) -> Self:
        """Return the context of a corrector."""
        return cls(
            corrector.cell if isinstance(corrector, KnowsCell) else None,
            corrector.robot if isinstance(corrector, KnowsRobot) else None,
            corrector.path if isinstance(corrector, FromFile) else None,
            corrector.tf_flange_tool if isinstance(corrector, KnowsTool) else IDENTITY,
        )
