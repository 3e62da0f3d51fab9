"""Programs of joint targets for arms of four makers, read and computed without the library's code."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from truepose.programs import FrameTable
from truepose.robots import Robot, load_robot

TOOL = np.array([[0.0, 0.0, 1.0, 60.0], [0.0, 1.0, 0.0, -25.0], [-1.0, 0.0, 0.0, 140.0], [0.0, 0.0, 0.0, 1.0]])
FRAMES = FrameTable(tools={1: TOOL, "tgrip": TOOL})


def rotation(axis: int, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    tf, (i, j) = np.eye(4), ((1, 2), (2, 0), (0, 1))[axis]
    tf[i, i], tf[j, j], tf[i, j], tf[j, i] = c, c, -s, s
    return tf


def shift(axis: int, length: float) -> np.ndarray:
    tf = np.eye(4)
    tf[axis, 3] = length
    return tf


def forward(robot: Robot, q: Sequence[float]) -> np.ndarray:
    """Return the flange pose by multiplying the links one by one."""
    tf = np.array(robot.tf_base_first)
    for j, angle in enumerate(np.array(robot.sign) * np.asarray(q) + robot.offset):
        before = rotation(0, robot.alpha[j]) @ shift(0, robot.a[j])
        turn = rotation(2, angle) @ shift(2, robot.d[j]) @ rotation(1, robot.beta[j])
        tf = tf @ (
            before @ turn if robot.convention == "mdh" else turn @ shift(0, robot.a[j]) @ rotation(0, robot.alpha[j])
        )
    return tf @ robot.tf_last_flange


@dataclass
class Sagging:
    """A map of an arm whose error changes evenly in space; it solves for the command itself."""

    robot: Robot
    scale: float = 1.0
    std: float = 0.01

    def error(self, p: np.ndarray) -> np.ndarray:
        slope = np.array([[3e-4, -2e-4, 1e-4], [1e-4, 2e-4, -3e-4], [-2e-4, 1e-4, 4e-4]])
        return self.scale * (np.array([0.21, -0.33, 0.47]) + p @ slope.T)

    def correct(self, poses: np.ndarray, **_: Any) -> SimpleNamespace:
        target = poses[:, :3, 3]
        command = target.copy()
        for _again in range(6):
            command = target - self.error(command)
        n = len(poses)
        answer = {"p_target": target, "p_command": command, "e": self.error(command), "std": np.full((n, 3), self.std)}
        return SimpleNamespace(**answer, verdict=np.full(n, "correct", dtype="<U7"), reason=[""] * n)


@dataclass(frozen=True)
class Maker:
    """How one maker's programs write joints."""

    arm: str
    name: str
    step: float  # [deg]
    write: Callable[[Sequence[Sequence[str]]], str]
    numbers: re.Pattern[str]
    coupled: bool = False
    span: Sequence[tuple[float, float]] = ()
    """Numbers [deg] at which the arm is far from its limits and from singular poses; J5 also negative."""

    @property
    def robot(self) -> Robot:
        return load_robot(self.arm)

    def file(self, folder: Path, rows: Sequence[Sequence[str]]) -> Path:
        path = folder / self.name
        path.write_bytes(self.write(rows).encode("latin-1"))
        return path

    def read(self, data: bytes) -> np.ndarray:
        """Return the numbers of the joints, (n, 6)."""
        found = [m.groups() for m in self.numbers.finditer(data.decode("latin-1"))]
        return np.array(found, float)

    def joints(self, numbers: np.ndarray) -> np.ndarray:
        """Return the joints of the arm [rad]."""
        q = np.array(numbers)
        if self.coupled:
            q[..., 2] = numbers[..., 2] + numbers[..., 1]
        return np.radians(q)

    def shown(self, q: np.ndarray) -> np.ndarray:
        """Return the numbers [deg] of joints."""
        numbers = np.degrees(q)
        if self.coupled:
            numbers[..., 2] = numbers[..., 2] - numbers[..., 1]
        return numbers

    def some(self, count: int, seed: int) -> np.ndarray:
        """Return numbers (count, 6) [deg] of poses that the arm reaches well."""
        rng = np.random.default_rng(seed)
        low, high = np.array(self.span).T
        numbers = rng.uniform(low, high, (count, 6))
        numbers[:, 4] *= rng.choice([-1.0, 1.0], count)
        return numbers

    def tool(self, numbers: np.ndarray) -> np.ndarray:
        """Return the position of the tool at one row of numbers."""
        return (forward(self.robot, self.joints(numbers)) @ TOOL)[:3, 3]


def krl(rows: Sequence[Sequence[str]]) -> str:
    moves = ["PTP {" + ",".join(f"A{j} {text}" for j, text in enumerate(row, 1)) + ",E1 0.0}" for row in rows]
    return "\r\n".join(["DEF joints()", "$TOOL=TOOL_DATA[1]", *moves, "END", ""])


def rapid(rows: Sequence[Sequence[str]]) -> str:
    data = [f"  CONST jointtarget j{k}:=[[{','.join(row)}],[9E9,9E9,9E9,9E9,9E9,9E9]];" for k, row in enumerate(rows)]
    moves = [f"    MoveAbsJ j{k}\\NoEOffs,v500,z50,tGrip\\WObj:=wobj0;" for k in range(len(rows))]
    return "\n".join(["MODULE joints", *data, "  PROC main()", *moves, "  ENDPROC", "ENDMODULE", ""])


def fanuc(rows: Sequence[Sequence[str]]) -> str:
    moves = [f"{k:4d}:J P[{k}] 50% FINE    ;" for k in range(1, len(rows) + 1)]
    positions = []
    for k, row in enumerate(rows, 1):
        axes = [f"J{j}= {text.rjust(9)} deg" for j, text in enumerate(row, 1)]
        one = f"\t{axes[0]},\t{axes[1]},\t{axes[2]},\n\t{axes[3]},\t{axes[4]},\t{axes[5]}"
        positions.append(f"P[{k}]{{\n   GP1:\n\tUF : F, UT : 1,\t\n{one}\n}};")
    return "\n".join(["/PROG  JOINTS", "/ATTR", "/MN", *moves, "/POS", *positions, "/END", ""])


_NUMBER = r"[ ]*(-?[0-9.]+)"
MAKERS = {
    "kuka": Maker(
        "kuka-kr150-2", "joints.src", 1e-5, krl,
        re.compile(r"\{A1" + _NUMBER + "".join(rf",A{j}" + _NUMBER for j in range(2, 7))),
        span=((-120, 120), (-120, -50), (60, 120), (-300, 300), (20, 100), (-300, 300)),
    ),
    "abb": Maker(
        "abb-irb6640-185-280", "joints.mod", 1e-5, rapid, re.compile(r"\[\[" + ",".join([_NUMBER] * 6) + r"\]"),
        span=((-120, 120), (-30, 50), (-30, 40), (-250, 250), (20, 100), (-300, 300)),
    ),
    "fanuc": Maker(
        "fanuc-m20ia", "joints.ls", 1e-3, fanuc,
        re.compile(r"J1=" + _NUMBER + "".join(rf" deg,\s+J{j}=" + _NUMBER for j in range(2, 7)) + " deg"),
        coupled=True,
        span=((-120, 120), (10, 60), (-40, 30), (-180, 180), (20, 100), (-200, 200)),
    ),
}  # fmt: skip
