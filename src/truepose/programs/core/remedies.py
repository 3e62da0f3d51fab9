"""The options that allow targets which are left as they are, and what each of them assumes."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

FRAMES: Final = "[frames] of the cell file"
GROUPS: Final = "[frames.groups] of the cell file"


class Remedy(NamedTuple):
    """What allows the targets of a reason.

    Attributes
    ----------
    option : str
        The option of the command line, or the part of the cell file.
    assumption : str
        What it assumes, or what truepose checks when it is given.
    sign : compiled pattern
        The words of reasons that it removes.
    """

    option: str
    assumption: str
    sign: re.Pattern[str]


def _remedy(option: str, assumption: str, sign: str) -> Remedy:
    return Remedy(option, assumption, re.compile(sign))


REMEDIES: Final = (
    _remedy(
        FRAMES,
        "the values that you state are those of the controller when the program runs",
        r"give it in \[frames\.|stored as zeros|contradicts the backup",
    ),
    _remedy(
        GROUPS,
        "the motion groups that you name carry neither the robot nor a user frame of its targets",
        r"\[frames\.groups\]",
    ),
    _remedy(
        "--joint-targets",
        "the arm of the map turns joints into poses and back on the same branch; the step that this reaches is stated",
        r"allow joint_targets",
    ),
    _remedy(
        "--derived",
        "the point and the positions derived from it can share a correction; the map is asked at each of them, and the "
        "corrections may differ by max_difference_mm",
        r"--derived|allow offsets",
    ),
    _remedy(
        "--frame-tolerance",
        "the frame lies within the tolerance around its stored value when the program runs; the map is asked there, "
        "and the corrections may differ by max_difference_mm",
        r"--frame-tolerance",
    ),
    _remedy(
        "--tool-tolerance",
        "the tool lies within the tolerance around its stored value when the program runs; the map is asked with tools "
        "at its borders, and the corrections may differ by max_difference_mm",
        r"--tool-tolerance",
    ),
    _remedy("--external-axes", "the external axes move neither the robot nor the base", r"allow external_axes"),
    _remedy(
        "--absolute-accuracy",
        "the controller's own compensation is switched off now; otherwise errors are corrected twice",
        r"allow absolute_accuracy",
    ),
    _remedy(
        "--whole-task",
        "no program that is not at hand moves to these points or changes them; give the whole backup, and it is read",
        r"--whole-task|give the whole (?:project|backup)|give its whole backup",
    ),
    _remedy(
        "--calls-keep-frames",
        "subprograms that are not at hand leave tool, base and displacements as they are",
        r"was called, which is not in this|a procedure is called by a name|what is in force after line",
    ),
    _remedy(
        "--tool, --base",
        "the tool or base that you name is in force when the program starts",
        r"state the one in force \(--|--(?:tool|base) NAME",
    ),
    _remedy("--angles", "the angles follow the convention that you name", r"--angles"),
    _remedy(
        "--controller-kinematics",
        "the map was measured with commands of this controller, whose own arm model they follow",
        r"--controller-kinematics",
    ),
    _remedy("--system-modules", "system modules may be changed: other programs use them, too", r"--system-modules"),
    _remedy("--mechanical-unit", "the map is that of the robot that you name", r"--mechanical-unit"),
)
"""What allows which targets. A target without one of these is left as it is whatever is stated."""


def remedy_of(reason: str) -> Remedy | None:
    """Return what allows the targets of a reason; None where nothing does.

    Examples
    --------
    >>> remedy_of("joint target; allow joint_targets to correct it").option
    '--joint-targets'
    """
    return next((one for one in REMEDIES if one.sign.search(reason)), None)
