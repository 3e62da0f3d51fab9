"""The commands that check and correct programs, from the options of a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from truepose.web.programs.stored import StoredProgram
from truepose.web.uploads import safe_name
from truepose.web.workspace import CellFolder

CORRECTED: Final = "corrected"
_Word = Annotated[str, StringConstraints(max_length=200, pattern=r"^[^\x00-\x1f]*$")]


class ReadingOptions(BaseModel):
    """The options of reading programs, named as those of the command line."""

    model_config = ConfigDict(extra="forbid")

    tool: _Word = ""
    base: _Word = ""
    calls_keep_frames: bool = False
    ambiguous: Literal["refuse", "skip"] = "refuse"
    absolute_accuracy: bool = False
    external_axes: bool = False
    offsets: bool = False
    derived: bool = False
    frame_tolerance: _Word = ""
    tool_tolerance: _Word = ""
    angles: _Word = ""
    joint_targets: bool = False
    controller_kinematics: bool = False
    whole_task: bool = False
    system_modules: bool = False
    mechanical_unit: _Word = ""
    controller: Annotated[list[_Word], Field(max_length=50)] = []


class CorrectionOptions(ReadingOptions):
    """The options of a correction, named as those of the command line."""

    on_guard: Literal["", "refuse", "skip", "clip"] = ""
    orientation: bool = False
    require: _Word = ""
    other_maker: bool = False
    other_robot: _Word = ""
    this_robot: bool = False
    accept_weak_map: bool = False
    accept: Annotated[list[_Word], Field(max_length=50)] = []
    whole: bool = False
    keep_going: bool = False
    dry_run: bool = False
    xlsx: bool = False


def arguments(options: BaseModel) -> list[str]:
    """Return options as words of a command line; those at their defaults are left out.

    Examples
    --------
    >>> arguments(ReadingOptions(derived=True, frame_tolerance="5mm", controller=["KRC/R1"]))
    ['--derived', '--frame-tolerance=5mm', '--controller=KRC/R1']
    """
    words: list[str] = []
    for name, known in type(options).model_fields.items():
        value: Any = getattr(options, name)
        option = f"--{name.replace('_', '-')}"
        if value == known.default:
            continue
        if value is True:
            words.append(option)
        else:
            words += [f"{option}={one}" for one in (value if isinstance(value, list) else [value])]
    return words


def check_command(cell: CellFolder, program: StoredProgram, options: ReadingOptions) -> list[str]:
    """Return the command that lists the verdicts on an upload."""
    return ["check", *_given(cell, program), f"--cell={cell.file.name}", *arguments(options), "--no-targets"]


def correct_command(
    cell: CellFolder, program: StoredProgram, map_file: Path, name: str, options: CorrectionOptions
) -> list[str]:
    """Return the command that corrects an upload into a new folder below ``corrected/``."""
    out = cell.relative(cell.new(CORRECTED, safe_name(name or program.path.stem)))
    return [
        "correct",
        cell.word(map_file),
        *_given(cell, program),
        f"--out={out}",
        f"--cell={cell.file.name}",
        *arguments(options),
        "--no-targets",
    ]


def _given(cell: CellFolder, program: StoredProgram) -> list[str]:
    return [cell.word(path) for path in program.given()]
