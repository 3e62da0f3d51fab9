"""Measuring programs in the controller's language: joint motions to each pose from a known side, dwell, signal.

Joint motions do not depend on the active tool and base. Programs have the joints that the controller shows
(`truepose.robots.shown_joints`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from truepose._io.files import write_all
from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.cell.sections import Measuring
from truepose.errors import RobotError
from truepose.planning.measurement_space import MeasurementSpace, configuration_list
from truepose.robots import shown_joints
from truepose.samples import Poses, on_arm, samples_text


@dataclass(frozen=True, eq=False)
class Stop:
    """A motion of the program, to a measured pose or to a point on the way.

    Attributes
    ----------
    q : (dof,) array [rad]
        The joints at its end, as the controller shows them.
    name : str
        The name of the pose; "" on the way.
    """

    q: FloatArray
    name: str = ""


def _numbers(values: FloatArray, digits: int) -> list[str]:
    return [f"{value + 0.0:.{digits}f}" for value in np.round(values, digits)]


def _degrees(q: FloatArray) -> list[str]:
    return _numbers(np.rad2deg(q), 4)


@dataclass(frozen=True)
class Language:
    """The syntax of joint motions, comments, waits and signals in a controller's language.

    Attributes
    ----------
    ending, newline : str
        The ending of the file's name, and that of its lines.
    comment : callable
        A function of a text.
    move : callable
        A function of the number of the motion, joints (dof,) [rad], and the settings.
    wait, signal : callable
        Functions of the settings; the signal is that of `Measuring.trigger_output`.
    program : callable
        A function of the program's name, its header comments, the lines of its motions, all stops, and the settings;
        it returns the file's lines.
    """

    ending: str
    newline: str
    comment: Callable[[str], str]
    move: Callable[[int, FloatArray, Measuring], str]
    wait: Callable[[Measuring], str]
    signal: Callable[[Measuring], list[str]]
    program: Callable[[str, list[str], list[str], list[Stop], Measuring], list[str]]

    def text(self, name: str, about: list[str], stops: list[Stop], how: Measuring) -> str:
        """Return a program that moves to the stops, and waits and signals at those with a name."""
        lines: list[str] = []
        for number, stop in enumerate(stops, start=1):
            move = self.move(number, stop.q, how)
            if stop.name:
                signal = [] if how.trigger_output is None else self.signal(how)
                lines += [self.comment(stop.name), move, self.wait(how), *signal]
            else:
                lines.append(move)
        file = self.program(name, [self.comment(line) for line in about], lines, stops, how)
        return self.newline.join([*file, ""])


def _krl_program(name: str, about: list[str], lines: list[str], stops: list[Stop], how: Measuring) -> list[str]:
    start = ["BAS(#INITMOV,0)", f"BAS(#VEL_PTP,{how.speed_percent:g})", "BAS(#ACC_PTP,30)"]
    return ["&ACCESS RVP", f"DEF {name}()", *about, *start, *lines, "END"]


def _rapid_program(name: str, about: list[str], lines: list[str], stops: list[Stop], how: Measuring) -> list[str]:
    body = [f"VelSet {how.speed_percent:g}, 5000;", *lines]
    procedure = [f"PROC {name}_run()", *(f"  {line}" for line in body), "ENDPROC"]
    return [f"MODULE {name}", *(f"  {line}" for line in (*about, *procedure)), "ENDMODULE"]


def _fanuc_program(name: str, about: list[str], lines: list[str], stops: list[Stop], how: Measuring) -> list[str]:
    numbered = [
        f"{number:4d}:  {line} ;"
        for number, line in enumerate([*about, "UFRAME_NUM=0", "UTOOL_NUM=1", *lines], start=1)
    ]
    positions = []
    for number, stop in enumerate(stops, start=1):
        axes = [f"J{j}= {value} deg" for j, value in enumerate(_numbers(np.rad2deg(stop.q), 3), start=1)]
        place = [f"P[{number}]{{", "   GP1:", "\tUF : 0, UT : 1,"]
        positions += [*place, f"\t{', '.join(axes[:3])},", f"\t{', '.join(axes[3:])}", "};"]
    head = [f"/PROG  {name.upper()}", "/ATTR", 'COMMENT = "truepose";', "/MN"]
    return [*head, *numbered, "/POS", *positions, "/END"]


def _urscript_program(name: str, about: list[str], lines: list[str], stops: list[Stop], how: Measuring) -> list[str]:
    return [*about, f"def {name}():", *(f"  {line}" for line in lines), "end", f"{name}()"]


LANGUAGES: Final[dict[str, Language]] = {
    "kuka": Language(
        ending=".src",
        newline="\r\n",
        comment=lambda text: f"; {text}",
        move=lambda _, q, how: "PTP {" + ",".join(f"A{j} {v}" for j, v in enumerate(_degrees(q), start=1)) + "}",
        wait=lambda how: f"WAIT SEC {how.dwell_s:g}",
        signal=lambda how: [f"PULSE($OUT[{how.trigger_output}],TRUE,0.5)"],
        program=_krl_program,
    ),
    "abb": Language(
        ending=".mod",
        newline="\r\n",
        comment=lambda text: f"! {text}",
        move=lambda _, q, how: f"MoveAbsJ [[{','.join(_degrees(q))}],[9E9,9E9,9E9,9E9,9E9,9E9]],v1000,fine,tool0;",
        wait=lambda how: f"WaitTime \\InPos, {how.dwell_s:g};",
        signal=lambda how: [f"PulseDO \\PLength:=0.5, do{how.trigger_output};"],
        program=_rapid_program,
    ),
    "fanuc": Language(
        ending=".ls",
        newline="\n",
        comment=lambda text: f"!{text[:32]}",
        move=lambda number, q, how: f"J P[{number}] {max(1, round(how.speed_percent))}% FINE",
        wait=lambda how: f"WAIT {how.dwell_s:6.2f}(sec)",
        signal=lambda how: [f"DO[{how.trigger_output}]=PULSE,0.5sec"],
        program=_fanuc_program,
    ),
    "universal robots": Language(
        ending=".script",
        newline="\n",
        comment=lambda text: f"# {text}",
        move=lambda _, q, how: f"movej([{', '.join(_numbers(q, 6))}], a=0.5, v={how.speed_percent / 100 * np.pi:.3f})",
        wait=lambda how: f"sleep({how.dwell_s:g})",
        signal=lambda how: [
            f"set_standard_digital_out({how.trigger_output}, True)",
            "sleep(0.5)",
            f"set_standard_digital_out({how.trigger_output}, False)",
        ],
        program=_urscript_program,
    ),
}
"""The languages by maker, in lower case."""


def measuring_program(
    cell: Cell, poses: Poses, *, space: MeasurementSpace | None = None, name: str = "measure"
) -> tuple[str, str]:
    """Return the ending and the text of a program that moves to poses in their order, with dwell and signal at each.

    It starts and ends at home, and moves by home where the straight way to the next pose would touch a box.

    Parameters
    ----------
    cell : Cell
        The cell; its ``[measuring]`` states the motions, its ``[obstacles]`` are avoided.
    poses : Poses
        The poses, with joints.
    space : MeasurementSpace, optional
        The space in which they were chosen; by default home is that of the cell's ``[region]``, or the first pose.
    name : str
        The name of the program.

    Raises
    ------
    RobotError
        If no program can be written for the robot's maker, or how its controller counts joint 3 is not known.
    DataError
        If there are no joints, or a box is in the way to a pose (its row is named).
    """
    robot = cell.load_robot()
    if robot.maker.lower() not in LANGUAGES:
        raise RobotError(
            f"{robot.name}: measuring programs can be written for {', '.join(LANGUAGES)}, not for {robot.maker}; use "
            "the joints of the table"
        )
    language = LANGUAGES[robot.maker.lower()]
    about = [
        f"truepose: {poses.source}",
        f"robot {robot.name}",
        "Run it slowly the first time.",
        "Only the boxes of the cell file are known.",
    ]
    poses = on_arm(poses, robot)
    if poses.q is None:
        raise poses.error("a measuring program needs joints (q1_deg …), and there are none")
    space = space or configuration_list(cell, poses.q)
    reason = space.in_the_way(poses.q)
    if (rows := np.flatnonzero(reason != "")).size:
        raise poses.error(f"a pose is {reason[rows[0]]}; leave it out, or move home or the box", reason != "")
    shown = shown_joints(robot)
    stops = [replace(stop, q=shown.from_model(stop.q)) for stop in _stops(poses, space)]
    return language.ending, language.text(name, about, stops, cell.measuring)


def write_measurement(table: Path, cell: Cell, poses: Poses, *, space: MeasurementSpace | None = None) -> list[Path]:
    """Write poses as a table and, where the maker's language is known, ``measure.*`` beside it; return the paths."""
    contents = {table: samples_text(poses, table)}
    if cell.load_robot().maker.lower() in LANGUAGES:
        ending, text = measuring_program(cell, poses, space=space)
        contents[table.with_name(f"measure{ending}")] = text
    write_all(contents)
    return list(contents)


def _stops(poses: Poses, space: MeasurementSpace) -> Iterator[Stop]:
    home, q = Stop(space.home), poses.q
    assert q is not None
    previous = np.concatenate([space.home[None], q[:-1]])
    names = [f"P{number}" for number in range(1, len(q) + 1)] if poses.name is None else poses.name
    before = space.approach_start(q, poses.approach)
    way = space.collision.way_touches(previous, before)
    yield home
    for joints, start, box, name in zip(q, before, way, names, strict=True):
        if box:
            yield home
        if space.approach:
            yield Stop(start)
        yield Stop(joints, str(name))
    yield home
