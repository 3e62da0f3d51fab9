"""What controllers of plants have beside points that are taught once: small programs, each with ten such targets.

How much of them is corrected is a table of the documentation, and test_typical.py holds it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable
from truepose.programs.core.program import FrameTolerance
from truepose.robots import load_robot, status_turn

N = 10
ARMS = {"KUKA": "kuka-kr16-2", "ABB": "abb-irb4600-60-205", "FANUC": "fanuc-m10ia"}
"""The arm of the map that corrects the programs of each controller."""
_TURN = euler("kuka", [0.0, 90.0, 0.0])
_STANDS = make_transform(euler("kuka", [0.0, 60.0, 0.0]), [1100.0, 200.0, 1100.0])
_PART = make_transform(euler("kuka", [60.0, 35.0, -20.0]), [-130.0, 120.0, 180.0])
FRAMES = FrameTable(
    tools={1: make_transform(_TURN, [0.0, 0.0, 150.0]), 2: _PART},
    bases={1: make_transform(euler("kuka", [0.0, 0.0, 0.0]), [800.0, 0.0, 500.0]), 2: _STANDS},
)


@dataclass(frozen=True)
class Typical:
    """Targets of one kind.

    Attributes
    ----------
    what, controller : str
        The kind, and whose program it is.
    files : mapping of str to str
        The files of a folder.
    by_default, allowed, with_map : int
        How many of the targets are corrected as reading tells by default and with the options, and with a map.
    option : str
        The options as the command line has them; empty where none helps.
    options : mapping
        The same for `ReadOptions`.
    """

    what: str
    controller: str
    files: Mapping[str, str]
    by_default: int
    allowed: int
    with_map: int
    option: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    def lay(self, folder: Path) -> Path:
        """Write the files, and return the folder."""
        for name, text in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="latin-1")
        return folder


def _grid() -> np.ndarray:
    """Return ten positions around the middle of the work space of the arm, (10, 3) [mm], in base 1."""
    return np.array([[60.0 * (k % 5) - 120.0, 80.0 * (k // 5) - 40.0, 320.0 + 5.0 * k] for k in range(N)])


def _krl(steps: str, points: str = "", name: str = "typical") -> dict[str, str]:
    dat = f"DEFDAT {name.upper()}\n{points}ENDDAT\n"
    return {f"{name}.src": f"DEF {name}( )\nBAS(#TOOL,1)\nBAS(#BASE,1)\n{steps}END\n", f"{name}.dat": dat}


def _e6pos(k: int, p: np.ndarray, more: str = "") -> str:
    numbers = ",".join(f"{key} {v:.3f}" for key, v in zip("XYZ", p, strict=True))
    return f"DECL E6POS XP{k}={{{numbers},A 0.0,B 90.0,C 0.0,S 2,T 2{more}}}\n"


def _points(more: str = "") -> str:
    return "".join(_e6pos(k, p, more) for k, p in enumerate(_grid()))


def _lin(form: str) -> str:
    return "".join(f"LIN {form.format(k)}\n" for k in range(N))


def _held_krl() -> dict[str, str]:
    """Return a part in the gripper that is brought to a fixed tool, as KUKA teaches it."""
    robot = load_robot(ARMS["KUKA"])
    q = np.deg2rad(
        [[12.0 * k - 50.0, -70.0 - 4.0 * k, 100.0, 20.0 - 9.0 * k, 60.0 - 3.0 * k, 25.0 * k + 10.0] for k in range(N)]
    )
    at_tool = np.linalg.inv(_STANDS) @ robot.forward(q) @ _PART
    abc = euler("kuka", Rotation.from_matrix(at_tool[:, :3, :3]))
    points, steps = [], []
    for k, (p, angles, s, t) in enumerate(zip(at_tool[:, :3, 3], abc, *status_turn(robot, q), strict=True)):
        numbers = ",".join(f"{key} {v:.4f}" for key, v in zip("XYZABC", [*p, *angles], strict=True))
        points.append(f"DECL E6POS XP{k}={{{numbers},S {s},T {t}}}\n")
        points.append(f"DECL FDAT FP{k}={{TOOL_NO 2,BASE_NO 2,IPO_FRAME #TCP}}\n")
        steps.append(f"FDAT_ACT=FP{k}\nBAS(#PTP_PARAMS,100)\nPTP XP{k}\n")
    return _krl("".join(steps), "".join(points))


def _rapid(steps: str, data: str = "", tool: str = "") -> dict[str, str]:
    tool = tool or "[TRUE,[[0,0,150],[0.707107,0,0.707107,0]],[4,[0,0,1],[1,0,0,0],0,0,0]]"
    return {
        "typical.mod": f"MODULE typical\nLOCAL PERS tooldata t:={tool};\n{data}PROC main()\n{steps}ENDPROC\nENDMODULE\n"
    }


def _robtarget(k: int, p: np.ndarray, scope: str = "LOCAL ") -> str:
    numbers = ",".join(f"{v:.3f}" for v in p)
    return f"{scope}CONST robtarget p{k}:=[[{numbers}],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"


def _robtargets(scope: str = "LOCAL ") -> str:
    return "".join(_robtarget(k, p + np.array([800.0, 0.0, 500.0]), scope) for k, p in enumerate(_grid()))


def _move(form: str, more: str = "") -> str:
    return "".join(f"MoveL {form.format(k)},v200,fine,t{more};\n" for k in range(N))


def _held_rapid() -> dict[str, str]:
    """Return a part in the gripper that is brought to a tool in the world."""

    def pose(tf: np.ndarray) -> str:
        x, y, z, w = Rotation.from_matrix(tf[:3, :3]).as_quat()
        return f"[[{','.join(f'{v:.4f}' for v in tf[:3, 3])}],[{w:.8f},{x:.8f},{y:.8f},{z:.8f}]]"

    on_part = make_transform(euler("kuka", [160.0, 40.0, 15.0]), np.array([[30.0 * k, 10.0, 0.0] for k in range(N)]))
    points = "".join(
        f"LOCAL CONST robtarget p{k}:=[{pose(tf)[1:-1]},[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
        for k, tf in enumerate(on_part)
    )
    part = f'LOCAL PERS wobjdata part:=[TRUE,TRUE,"",{pose(_PART)},[[0,0,0],[1,0,0,0]]];\n'
    gun = f"[FALSE,{pose(_STANDS)},[4,[0,0,1],[1,0,0,0],0,0,0]]"
    return _rapid(_move("p{}", "\\WObj:=part"), part + points, gun)


def _tp(form: str, more: str = "", axes: str = "") -> dict[str, str]:
    motions = "".join(f"{k + 2:4d}:L {form.format(k + 1)} ;\n" for k in range(N))
    points = "".join(
        f"P[{k + 1}]{{\n   GP1:\n\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',\n"
        f"\tX = {p[0]:.3f} mm,\tY = {p[1]:.3f} mm,\tZ = {p[2]:.3f} mm,\n"
        f"\tW = 180.000 deg,\tP = 0.000 deg,\tR = 0.000 deg{axes}\n}};\n"
        for k, p in enumerate(_grid())
    )
    return {"typical.ls": f"/PROG TYPICAL\n/ATTR\n/MN\n   1:{more or '  !typical'} ;\n{motions}/POS\n{points}/END\n"}


TYPICAL = (
    Typical("points that are taught once", "KUKA", _krl(_lin("XP{}"), _points()), N, N, N),
    Typical(
        "a base that is touched or seen at run time, stored near its value",
        "KUKA",
        _krl("BASE_DATA[1].X=xSeen\nBAS(#BASE,1)\n" + _lin("XP{}"), "DECL REAL xSeen=0.0\n" + _points()),
        0,
        N,
        N,
        "--frame-tolerance 5mm",
        {"frame_tolerance": FrameTolerance(5.0)},
    ),
    Typical(
        "points shifted by a measured frame (`LIN SHIFT:XP1`)", "KUKA", _krl(_lin("SHIFT:XP{}"), _points()), 0, 0, 0
    ),
    Typical(
        "a pallet: one point and offsets that are counted",
        "ABB",
        _rapid(
            "FOR i FROM 0 TO 9 DO\nMoveL Offs(p0,i*60,0,nLayer*40),v200,fine,t;\nENDFOR\n", _robtarget(0, _grid()[0])
        ),
        0,
        0,
        0,
    ),
    Typical(
        "positions that a camera or a PLC gives",
        "ABB",
        _rapid(
            "".join(f"p{k}:=fromCamera({k});\nMoveL p{k},v200,fine,t;\n" for k in range(N)),
            _robtargets("LOCAL ").replace("CONST", "VAR"),
        ),
        0,
        0,
        0,
    ),
    Typical(
        "position registers that a program computes", "FANUC", _tp("PR[{}] 200mm/sec FINE", "  PR[1]=P[1]"), 0, 0, 0
    ),
    Typical(
        "a search or a camera shifts each motion (`VOFFSET`)",
        "FANUC",
        _tp("P[{}] 200mm/sec FINE VOFFSET,VR[1]"),
        0,
        0,
        0,
    ),
    Typical("a part in the gripper, a fixed tool (`#TCP`)", "KUKA", _held_krl(), 0, 0, N),
    Typical("a part in the gripper, a stationary tool (`robhold`)", "ABB", _held_rapid(), N, N, N),
    Typical("a part in the gripper, a remote TCP", "FANUC", _tp("P[{}] 200mm/sec FINE RTCP"), 0, 0, 0),
    Typical("a robot on a rail (E1)", "KUKA", _krl(_lin("XP{}"), _points(",E1 1250.0")), 0, 0, 0),
    Typical(
        "a turntable beside the robot, whose part the base does not follow (E1)",
        "KUKA",
        _krl(_lin("XP{}"), _points(",E1 90.0")),
        0,
        N,
        N,
        "--external-axes",
        {"external_axes": True},
    ),
)
