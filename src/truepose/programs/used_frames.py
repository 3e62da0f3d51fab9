"""The tools and bases of programs: which are known, and how many targets are moved to in each."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray
from truepose.cell import ANGLE_KEYS
from truepose.errors import DataError
from truepose.programs.backups.backup import Backup, Controller
from truepose.programs.backups.controller import StoredFrame
from truepose.programs.backups.frames import is_zero, joined_frames
from truepose.programs.core import orientations
from truepose.programs.core.points import AS_MEASURED
from truepose.programs.core.program import Key, Program, frame_key
from truepose.programs.core.target import Target
from truepose.programs.frame_table import FrameTable
from truepose.programs.languages import LANGUAGES

Which = Literal["tool", "base"]
State = Literal["unknown", "zero", "unusable", "known"]
_KINDS: Final[dict[Which, str]] = {"tool": "tools", "base": "bases"}
_GIVE: Final = re.compile(r"\[frames\.(tool|base)s\.([^\]]+)\]")
_ORDER: Final = ("unknown", "zero", "unusable", "known")
_SHOWN: Final = 3  # files that a comment names
_CONTROLLERS: Final = {
    "KUKA": "kuka", "ABB": "abb", "FANUC": "fanuc", "Universal Robots": "ur", "Yaskawa": "yaskawa",
    "Stäubli": "staubli",
}  # fmt: skip


@dataclass(eq=False)
class UsedFrame:
    """A tool or base, and its use.

    Attributes
    ----------
    which : {"tool", "base"}
        What it is.
    key : int or str
        Its number or name in ``[frames]`` of a cell file.
    text : str
        Its name in the programs.
    state : {"unknown", "zero", "unusable", "known"}
        Whether its values are known. "zero": it is stored as zeros and without a name, which is how controllers store a
        frame that is not set. "unusable": the reason says why.
    name : str
        The name that the operator gave it.
    place : str
        Where its values stand.
    reason : str
        Why targets in it are not corrected.
    tf : (4, 4) array [mm], optional
        The transform from the flange to a tool, or from the robot's base to a base.
    targets : int
        The number of targets that motions go to under it.
    files : list of Path
        The files of these targets.
    controller : str
        The convention of its angles, as in `truepose.geometry.euler`.
    """

    which: Which
    key: Key
    text: str = ""
    state: State = "known"
    name: str = ""
    place: str = ""
    reason: str = ""
    tf: FloatArray | None = None
    targets: int = 0
    files: list[Path] = field(default_factory=list)
    controller: str = ""

    @property
    def numbers(self) -> list[float] | None:
        """The position [mm] and the orientation in the controller's numbers; None where they are not known."""
        if self.tf is None or self.controller not in ANGLE_KEYS:
            return None
        start = [1.0, 0.0, 0.0, 0.0] if self.controller == "abb" else [0.0, 0.0, 0.0]
        turn = Rotation.from_matrix(self.tf[None, :3, :3])
        angles = orientations.turned(self.controller, np.array([start]), turn)[0]
        return [float(x) for x in np.concatenate([self.tf[:3, 3], angles]).round(6) + 0.0]

    def lines(self) -> list[str]:
        """Return the lines of a cell file that state it; ``?`` stands where its values are not known.

        Of one that is stored as zeros they are two: values that a cell file omits are zero.
        """
        keys = ("x_mm", "y_mm", "z_mm", *ANGLE_KEYS.get(self.controller, ("a_deg", "b_deg", "c_deg")))
        values = ["?"] * len(keys) if (numbers := self.numbers) is None else [repr(x) for x in numbers]
        bare = re.fullmatch(r"[A-Za-z0-9_-]+", str(self.key))
        key = str(self.key) if bare else '"' + str(self.key).replace("\\", "\\\\").replace('"', '\\"') + '"'
        names = list(dict.fromkeys(file.name for file in self.files))
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        use = f"{self.targets} {'target' if self.targets == 1 else 'targets'} in {', '.join(names[:_SHOWN])}{more}"
        head = (
            f"[frames.{_KINDS[self.which]}.{key}]  # {self.text or self.which}: {use if self.targets else 'not used'}"
        )
        pairs = [f"{key} = {value}" for key, value in zip(keys, values, strict=True)]
        return [head, *(pairs[:1] if self.state == "zero" else pairs)]

    def to_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "kind": self.which,
            "key": self.key,
            "text": self.text,
            "name": self.name,
            "state": self.state,
            "targets": self.targets,
            "files": [str(file) for file in self.files],
            "place": self.place,
            "reason": self.reason,
            "values": self.numbers,
        }


def frames_of(
    programs: Sequence[Program], given: FrameTable | None = None, controller: Controller | None = None
) -> list[UsedFrame]:
    """Return the tools and bases of programs, those first that are used and not known.

    Parameters
    ----------
    programs : sequence of Program
        The programs of one controller.
    given : FrameTable, optional
        The frames of the user, which the programs were read with.
    controller : Controller, optional
        The controller, if the programs are those of a backup.
    """
    found: dict[tuple[Which, Key], UsedFrame] = {}
    table = given or FrameTable()
    stored: dict[Which, Mapping[Key, StoredFrame]] = {"tool": {}, "base": {}}
    if controller is not None:
        stored = {"tool": controller.frames.tools, "base": controller.frames.bases}
        with contextlib.suppress(DataError):  # reading has told it
            table = joined_frames(table, controller.frames, str(controller.root))
    convention = _CONTROLLERS.get(controller.maker, "") if controller is not None else _convention(programs)
    for which in _KINDS:
        for key, tf in getattr(table, _KINDS[which]).items():
            if key != 0:
                found[which, key] = UsedFrame(which, key, tf=tf, place="given", controller=convention)
        for key, frame in ((frame_key(key), frame) for key, frame in stored[which].items()):
            one = found.setdefault((which, key), UsedFrame(which, key, tf=frame.tf, controller=convention))
            one.name, one.place = frame.name.strip(), frame.place
            if why := table.problems.get((which, key)):
                zero = not frame.problem and not one.name and is_zero(frame.tf)
                one.state, one.reason = ("zero" if zero else "unusable"), why
    for program in programs:
        _count(program, found, convention)
    return sorted(found.values(), key=_place)


def missing_lines(frames: Iterable[UsedFrame]) -> list[str]:
    """Return the lines of a cell file for the frames that targets need and that are not known."""
    return [line for one in frames if one.targets and one.state in ("unknown", "zero") for line in ["", *one.lines()]][
        1:
    ]


def by_controller(
    programs: Sequence[Program], backups: Sequence[Backup], given: FrameTable
) -> list[tuple[Backup | None, Controller | None, list[UsedFrame]]]:
    """Return the frames of each controller of backups, and those of the other programs together."""
    found: list[tuple[Backup | None, Controller | None, list[UsedFrame]]] = []
    for backup in backups:
        for one in backup.controllers:
            own = [program for program in programs if program.controller == one.root]
            found.append((backup, one, frames_of(own, given, one)))
    if others := [program for program in programs if program.controller is None]:
        found.append((None, None, frames_of(others, given)))
    return found


def _convention(programs: Sequence[Program]) -> str:
    """Return the convention of the angles of the makers of programs, if it is one; empty otherwise."""
    known = {_CONTROLLERS.get(LANGUAGES[one.language].maker, "") for one in programs if one.language in LANGUAGES}
    return known.pop() if len(known) == 1 else ""


def _place(one: UsedFrame) -> tuple[bool, int, str, int, str]:
    number = one.key if isinstance(one.key, int) else -1
    return not one.targets, _ORDER.index(one.state), one.which, number, str(one.key)


def _count(program: Program, found: dict[tuple[Which, Key], UsedFrame], convention: str) -> None:
    """Add the targets of a program to the frames that motions go to them under."""
    for _, columns in program.targets.chunks():
        kinds, which = columns.shared()
        for target, n in zip(kinds, np.bincount(which, minlength=len(kinds)).tolist(), strict=True):
            if target.motions:
                for one in _frames(target, found, convention):
                    one.targets += n
                    if target.path not in one.files:
                        one.files.append(target.path)


def _frames(target: Target, found: dict[tuple[Which, Key], UsedFrame], convention: str) -> Iterable[UsedFrame]:
    """Yield the tool and base of a target."""
    asked = {(match[1], frame_key(match[2])) for match in _GIVE.finditer(target.reason)}
    sides: tuple[tuple[Which, str, int | None, FloatArray | None], ...] = (
        ("tool", target.tool, target.tool_number, target.tf_flange_tool),
        ("base", target.frame, target.frame_number, target.tf_base_frame),
    )
    for which, text, number, tf in sides:
        # a cell file states tools on the flange and bases in the world
        if not text or text == AS_MEASURED or target.stands:
            continue
        named = next((key for kind, key in asked if kind == which), frame_key(text))
        key = named if number is None else number
        one = found.setdefault((which, key), UsedFrame(which, key, text, controller=convention))
        one.text = one.text or text
        one.tf = tf if one.tf is None else one.tf
        its_own = (which, key) in asked or _concerns(target.reason, which, text)
        if (one.state == "known" and one.tf is None) or (its_own and one.state == "unusable" and not one.reason):
            one.state = "unknown" if (which, key) in asked else "unusable"
            one.reason = target.reason if its_own else ""
        elif one.state == "unusable" and tf is not None and not one.place:
            one.state, one.reason = "known", ""
        yield one


def _concerns(reason: str, which: Which, text: str) -> bool:
    """Return whether a reason, or one of several, is that of a tool or base and not of the target."""
    return re.search(rf"(?:^|; )(?:{which} )?{re.escape(text)}(?!\w)", reason) is not None
