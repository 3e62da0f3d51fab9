"""How much of the project's own backups is corrected, by default and with options, and why the rest is not."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

from tests.programs.backups import small
from tests.programs.backups.test_makers import CORPORA
from tests.programs.joint_arms import Sagging
from tests.programs.typical import ARMS, TYPICAL, Typical
from tests.programs.typical import FRAMES as TYPICAL_FRAMES

from benchmarks.held_out import Page
from truepose.errors import RefusedError
from truepose.programs import Coverage, FrameTable, Program, ReadOptions, Target, correct_program, read_programs
from truepose.programs.core.program import FrameTolerance, MotionGroups
from truepose.robots import load_robot

PAGE: Final = "coverage"
GOAL: Final = 0.85
"""The share of Cartesian targets with `--derived` that every maker's backup is to reach."""


class Maker(NamedTuple):
    """The language of a maker's programs, and the arm of the map that corrects its backup."""

    language: str
    arm: str


MAKERS: Final = {
    "KUKA": Maker("KRL", "kuka-kr16-2"),
    "ABB": Maker("RAPID", "abb-irb4600-60-205"),
    "FANUC": Maker("TP", "fanuc-m10ia"),
    "Yaskawa": Maker("INFORM", "yaskawa-gp25"),
    "Stäubli": Maker("VAL3", "staubli-tx2-90l"),
    "Universal Robots": Maker("URScript, .urp", "universal-robots-ur10e"),
}
FRAMES: Final = FrameTable(groups=MotionGroups(1, frozenset([2])))
_DERIVED: Final[dict[str, Any]] = {"derived": True}
_JOINTS: Final[dict[str, Any]] = {"joint_targets": True, "controller_kinematics": True}
_TOLERANCE: Final[dict[str, Any]] = {"frame_tolerance": FrameTolerance(5.0, 0.5)}
_OF_JOINTS: Final = "`--joint-targets`"
OPTIONS: Final[dict[str, dict[str, Any]]] = {
    "by default": {},
    "`--derived`": _DERIVED,
    _OF_JOINTS: _JOINTS,
    "`--frame-tolerance`": _TOLERANCE,
    "all three": _DERIVED | _JOINTS | _TOLERANCE,
}
_SIGNS: Final = re.compile(r"[\\`*_\[\]|$<>#]")
"""Signs with a meaning in Markdown."""
_MAP: Final = "all three, with a map"


class Share(NamedTuple):
    """Targets that motions go to, and those of them that are or can be corrected."""

    done: int
    targets: int

    def __str__(self) -> str:
        return f"{self.done:,} of {self.targets:,} ({100 * self.done / max(self.targets, 1):.1f} %)"


class Shares(NamedTuple):
    """The shares of the targets with a pose, and of the joint targets."""

    cartesian: Share
    joint: Share


def backup(maker: str, folder: Path) -> Path:
    """Write the backup of a maker as a .zip in a folder, and return its path."""
    path = folder / "backup.zip"
    path.write_bytes(small.packed(CORPORA[maker](folder / "made")))
    return path


def programs(path: Path, options: Mapping[str, Any]) -> list[Program]:
    """Return the programs of a backup."""
    found = read_programs([path], FRAMES, ReadOptions(**options))
    assert not found.unreadable
    return found.programs


def readable(found: Sequence[Program]) -> Shares:
    """Return what can be corrected of programs, as reading tells without a map."""
    return _shares(found, [program.allowed().tolist() for program in found])


def corrected(found: Sequence[Program], error_map: Any) -> Shares:
    """Return what a map corrects of programs."""
    done: list[Sequence[bool]] = []
    for program in found:
        try:
            done.append(correct_program(program, error_map, on_guard="skip").targets.moved.tolist())
        except RefusedError:  # nothing of it can be corrected
            done.append([False] * len(program.targets))
    return _shares(found, done)


def _shares(found: Sequence[Program], done: Sequence[Sequence[bool]]) -> Shares:
    counts: Counter[tuple[bool, bool]] = Counter()
    for program, moved in zip(found, done, strict=True):
        counts.update((_is_joint(t), ok) for t, ok in zip(program.targets, moved, strict=True) if t.motions)
    cartesian, joint = (Share(counts[is_joint, True], counts[is_joint, True] + counts[is_joint, False])
                        for is_joint in (False, True))  # fmt: skip
    return Shares(cartesian, joint)


def _is_joint(target: Target) -> bool:
    return target.joint_form is not None or target.reason.startswith("joint target")


def report(path: Path | None, *, quick: bool = False) -> None:
    """Run the study; with `quick` two makers."""
    page = Page("How much of programs is corrected", path)
    page.say(
        "The backups that the tests of this project generate, read without a map. They are made like real ones, with "
        "shared data, groups, approach points and CAM paths, but no backup of yours has the same mix. Counted are the "
        "targets that motions go to, and motions to positions that are derived from a point: these follow it with "
        "`--derived`, and some of them are targets of their own only then. FANUC's positioner, group 2, is stated as "
        "independent (`[frames.groups]`). `--frame-tolerance` is 5 mm and 0.5°. Universal Robots' joint targets are "
        "read with `--controller-kinematics`. The map is a smooth one of the arm in the second column, with "
        '`on_guard = "skip"`.'
    )
    found: dict[str, dict[str, Shares]] = {}
    left: dict[str, Coverage] = {}
    for maker in list(MAKERS)[: 2 if quick else None]:
        found[maker], left[maker] = _measured(maker)
    page.say("## Targets with a pose")
    columns = [column for column in (*OPTIONS, _MAP) if column != _OF_JOINTS]
    page.head(["backup", "map of", *columns])
    for maker, shares in found.items():
        page.row(_name(maker), MAKERS[maker].arm, *(shares[column].cartesian for column in columns))
    low = [maker for maker, shares in found.items() if _part(shares["`--derived`"].cartesian) < GOAL]
    page.say(f"Below {100 * GOAL:.0f} % with `--derived`: {', '.join(low) or 'none'}.")
    page.say("## Joint targets")
    columns = ["by default", _OF_JOINTS, _MAP]
    page.head(["backup", *columns])
    for maker, shares in found.items():
        page.row(_name(maker), *(shares[column].joint for column in columns))
    page.say("## What is typical of controllers in plants")
    page.say(
        "The backups above have mostly points that are taught once. Controllers of plants have much more of what only "
        "the run time knows, and of what moves beside the robot. How much of yours is corrected is the share of each "
        "kind that it has: `check` counts it. Small programs of our own, each with targets of one kind; Yaskawa's "
        "pulses are joint targets, which the table above has (their lengths and pulses of a degree come from the "
        "controller's files: `--controller-kinematics`)."
    )
    page.head(["targets", "controller", "by default", "allowed by", "allowed", "with a map"])
    for kind in TYPICAL[: 2 if quick else None]:
        page.row(kind.what, kind.controller, *_of_kind(kind))
    page.say("## What is left")
    page.say("With all three options; see [](../programs.md) for each language.")
    page.head(["backup", "targets", "reason", "allowed by"])
    for maker, coverage in left.items():
        for k, one in enumerate(coverage.total.reasons):
            name, allowed = "" if k else _name(maker), f"`{one.remedy.option}`" if one.remedy else "–"
            page.row(name, one.count, _SIGNS.sub(r"\\\g<0>", one.reason), allowed)


def _measured(maker: str) -> tuple[dict[str, Shares], Coverage]:
    """Return the shares of a maker's backup by options, and what is left with all of them."""
    shares = {}
    with TemporaryDirectory() as folder:
        path = backup(maker, Path(folder))
        for name, options in OPTIONS.items():
            shares[name] = readable(read := programs(path, options))
        shares[_MAP] = corrected(read, Sagging(load_robot(MAKERS[maker].arm)))
        return shares, Coverage.of_programs(read)


def _of_kind(one: Typical) -> tuple[Share, str, Share, Share]:
    """Return the shares of the targets of one kind: by default, with the options that allow it, and with a map."""
    with TemporaryDirectory() as folder:
        path = one.lay(Path(folder))
        plain, allowed = (
            read_programs([path], TYPICAL_FRAMES, ReadOptions(**options)).programs for options in ({}, one.options)
        )
        error_map = Sagging(load_robot(ARMS[one.controller]))
        shares = [readable(plain), readable(allowed), corrected(allowed, error_map)]
    by_default, with_option, with_map = (share.cartesian for share in shares)
    return by_default, f"`{one.option}`" if one.option else "–", with_option, with_map


def _name(maker: str) -> str:
    return f"{maker} ({MAKERS[maker].language})"


def _part(share: Share) -> float:
    return share.done / max(share.targets, 1)
