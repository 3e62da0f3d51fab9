"""Measuring programs in the controller's language: by joints to each pose, always from the same side, dwell, signal.

Motions are of joints, so neither the tool nor the base that happens to be active matters. FANUC counts its third joint
from the horizon: J3 on the pendant is joint 3 less joint 2 (conventions of the maker, not confirmed on a controller).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose.cell import Cell
from truepose.cell.sections import Measuring
from truepose.errors import RobotError
from truepose.files import write_atomic
from truepose.planning.grounds import listed
from truepose.planning.region import Ground
from truepose.samples import Poses, write_samples

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stop:
    """A motion of the program: to a pose that is measured, or on the way.

    Attributes
    ----------
    q : (dof,) array [rad]
    name : str
        Of the pose; "" on the way.
    """

    q: FloatArray
    name: str = ""


def _numbers(values: FloatArray, digits: int = 4) -> list[str]:
    return [f"{value + 0.0:.{digits}f}" for value in np.round(values, digits)]


def _krl(program: str, stops: list[Stop], how: Measuring, about: list[str]) -> str:
    lines = [
        "&ACCESS RVP",
        f"DEF {program}()",
        *(f"; {line}" for line in about),
        "BAS(#INITMOV,0)",
        f"BAS(#VEL_PTP,{how.speed_percent:g})",
        "BAS(#ACC_PTP,30)",
    ]
    for stop in stops:
        axes = ",".join(f"A{j} {value}" for j, value in enumerate(_numbers(np.rad2deg(stop.q)), start=1))
        if stop.name:
            lines.append(f"; {stop.name}")
        lines.append(f"PTP {{{axes}}}")
        if stop.name:
            lines.append(f"WAIT SEC {how.dwell_s:g}")
            if how.trigger_output is not None:
                lines.append(f"PULSE($OUT[{how.trigger_output}],TRUE,0.5)")
    return "\r\n".join([*lines, "END", ""])


def _rapid(program: str, stops: list[Stop], how: Measuring, about: list[str]) -> str:
    lines = [
        f"MODULE {program}",
        *(f"  ! {line}" for line in about),
        f"  PROC {program}_run()",
        f"    VelSet {how.speed_percent:g}, 5000;",
    ]
    for stop in stops:
        axes = ",".join(_numbers(np.rad2deg(stop.q)))
        if stop.name:
            lines.append(f"    ! {stop.name}")
        lines.append(f"    MoveAbsJ [[{axes}],[9E9,9E9,9E9,9E9,9E9,9E9]],v1000,fine,tool0;")
        if stop.name:
            lines.append(f"    WaitTime \\InPos, {how.dwell_s:g};")
            if how.trigger_output is not None:
                lines.append(f"    PulseDO \\PLength:=0.5, do{how.trigger_output};")
    return "\r\n".join([*lines, "  ENDPROC", "ENDMODULE", ""])


def _fanuc(program: str, stops: list[Stop], how: Measuring, about: list[str]) -> str:
    commands = [f"!{line[:32]} ;" for line in about] + ["UFRAME_NUM=0 ;", "UTOOL_NUM=1 ;"]
    positions = []
    for number, stop in enumerate(stops, start=1):
        if stop.name:
            commands.append(f"!{stop.name} ;")
        commands.append(f"J P[{number}] {how.speed_percent:g}% FINE ;")
        if stop.name:
            commands.append(f"WAIT {how.dwell_s:6.2f}(sec) ;")
            if how.trigger_output is not None:
                commands.append(f"DO[{how.trigger_output}]=PULSE,0.5sec ;")
        pendant = stop.q.copy()
        pendant[2] -= pendant[1]
        axes = [f"J{j}= {value} deg" for j, value in enumerate(_numbers(np.rad2deg(pendant), 3), start=1)]
        positions.append(
            f"P[{number}]{{\n   GP1:\n\tUF : 0, UT : 1,\n\t{', '.join(axes[:3])},\n\t{', '.join(axes[3:])}\n}};"
        )
    head = [f"/PROG  {program.upper()}", "/ATTR", 'COMMENT = "truepose";', "/MN"]
    numbered = [f"{number:4d}:  {command}" for number, command in enumerate(commands, start=1)]
    return "\n".join([*head, *numbered, "/POS", *positions, "/END", ""])


def _urscript(program: str, stops: list[Stop], how: Measuring, about: list[str]) -> str:
    speed = how.speed_percent / 100.0 * np.pi
    lines = [*(f"# {line}" for line in about), f"def {program}():"]
    for stop in stops:
        if stop.name:
            lines.append(f"  # {stop.name}")
        lines.append(f"  movej([{', '.join(_numbers(stop.q, 6))}], a=0.5, v={speed:.3f})")
        if stop.name:
            lines.append(f"  sleep({how.dwell_s:g})")
            if how.trigger_output is not None:
                lines.append(f"  set_standard_digital_out({how.trigger_output}, True)")
                lines.append("  sleep(0.5)")
                lines.append(f"  set_standard_digital_out({how.trigger_output}, False)")
    return "\n".join([*lines, "end", f"{program}()", ""])


WRITERS: Final[dict[str, tuple[str, Callable[[str, list[Stop], Measuring, list[str]], str]]]] = {
    "kuka": (".src", _krl),
    "abb": (".mod", _rapid),
    "fanuc": (".ls", _fanuc),
    "universal robots": (".script", _urscript),
}
"""By maker, lower case: the ending of the file, and what writes it."""


def measuring_program(
    cell: Cell, poses: Poses, *, ground: Ground | None = None, name: str = "measure"
) -> tuple[str, str]:
    """Return the ending and the text of a program that goes to poses in their order, with dwell and signal at each.

    It starts and ends at home, and goes by home where the straight way to the next pose would touch a box.

    Parameters
    ----------
    cell : Cell
        Its ``[measuring]`` says how to go; its ``[obstacles]`` are kept clear of.
    poses : Poses
        With joints.
    ground : Ground, optional
        Where they were chosen; otherwise home is that of the cell's ``[region]``, or the first pose.
    name : str
        Of the program.

    Raises
    ------
    RobotError
        If no program can be written for the robot's maker.
    DataError
        If there are no joints.
    """
    robot = cell.load_robot()
    if robot.maker.lower() not in WRITERS:
        raise RobotError(
            f"{robot.name}: no measuring program is written for {robot.maker}, but for {', '.join(WRITERS)}: "
            "take the joints of the table"
        )
    ending, write = WRITERS[robot.maker.lower()]
    about = [
        f"truepose: {poses.source}",
        f"robot {robot.name}",
        "Run it slowly the first time.",
        "Only the boxes of the cell file are known.",
    ]
    if poses.q is None:
        raise poses.error("a measuring program goes by joints (q1_deg …), and there are none")
    return ending, write(name, list(_stops(poses, ground or listed(cell, poses.q))), cell.measuring, about)


def write_measurement(table: Path, cell: Cell, poses: Poses, *, ground: Ground | None = None) -> list[Path]:
    """Write poses as a table and, where the maker's language is known, ``measure.*`` beside it; return the paths."""
    write_samples(table, poses)
    if cell.load_robot().maker.lower() not in WRITERS:
        return [table]
    ending, text = measuring_program(cell, poses, ground=ground)
    program = table.with_name(f"measure{ending}")
    write_atomic(program, text)
    return [table, program]


def _stops(poses: Poses, ground: Ground) -> Iterator[Stop]:
    home, q = Stop(ground.home), poses.q
    assert q is not None
    came_from = np.concatenate([ground.home[None], q[:-1]])
    names = [f"P{number}" for number in range(1, len(q) + 1)] if poses.name is None else poses.name
    before = ground.before(q)
    way = ground.surroundings.way_touches(came_from, before)
    yield home
    for joints, start, box, name in zip(q, before, way, names, strict=True):
        if box:
            yield home
        if ground.approach:
            yield Stop(start)
        yield Stop(joints, str(name))
    yield home
