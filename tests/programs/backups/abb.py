"""A backup of an ABB controller, of our own invention: a welding and handling cell with a background task.

Written after what backups of controllers look like: data of the cell in CalibData.mod, points without LOCAL in modules
of their own, taught points as CONST and PERS, approach points by Offs and by variables, palletising in loops, paths of
a CAM system, service and calibration programs, a background task that shares PERS data. It is made anew from a seed;
no binary file is kept.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from typing import Final

UNUSED: Final = "[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]"
QUATERNIONS: Final = (
    "0,0,1,0", "0.0087265,0,0.999962,0", "0,0.707107,0.707107,0", "0,0.92388,0.382683,0", "0.5,-0.5,0.5,0.5",
)  # fmt: skip
TOOLS: Final = {
    "tGripper": "[TRUE,[[0,0,212.5],[1,0,0,0]],[8.4,[0,0,90],[1,0,0,0],0.1,0.1,0.05]]",
    "tGun": "[TRUE,[[119.5,-0.75,352],[0.890214,0,0.455543,0]],[7,[-15,0,120],[1,0,0,0],0,0,0.06]]",
    "tSpindle": "[TRUE,[[0,-85.25,178.9],[0.707107,0,0.707107,0]],[22,[0,-30,110],[1,0,0,0],0,0,0]]",
    "tPointer": "[TRUE,[[0,0,150],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]]",
}
WOBJS: Final = {
    "wTable": '[FALSE,TRUE,"",[[850.25,-120.5,310],[0.999048,0,0,0.0436194]],[[0,0,0],[1,0,0,0]]]',
    "wPallet": '[FALSE,TRUE,"",[[-240.5,1180,95.75],[0.707107,0,0,0.707107]],[[25,-12.5,0],[1,0,0,0]]]',
    "wMachine": '[FALSE,TRUE,"",[[120,-1310.25,640],[0.708978,0.001,0.002,-0.705225]],[[0,0,0],[1,0,0,0]]]',
    "wJig": '[FALSE,TRUE,"",[[910,430,505.5],[0.99999,0.0035,-0.0028,0]],[[100,0,20],[0.965926,0,0,0.258819]]]',
}
VISION: Final = '[FALSE,TRUE,"",[[700,300,200],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]'
MAIN: Final = "RAPID/TASK1/PROGMOD"


class Cell:
    """Makes the files of the backup.

    Parameters
    ----------
    seed : int
        The seed of all numbers.
    """

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._files: dict[str, bytes] = {}
        self._listed: dict[str, list[str]] = {"TASK1": [], "TASK2": []}

    def make(self) -> dict[str, bytes]:
        """Return the content of each file by its path."""
        for name, lines in _SYSTEM.items():
            self._module(f"RAPID/TASK1/SYSMOD/{name}.sys", lines, hidden=name == "base_lib")
        data = [f"  PERS tooldata {name}:={value};" for name, value in TOOLS.items()]
        data += [f"  PERS wobjdata {name}:={value};" for name, value in {**WOBJS, "wVision": VISION}.items()]
        self._module(f"{MAIN}/CalibData.mod", ["MODULE CalibData", *data, "ENDMODULE"])
        self._module(f"{MAIN}/MainModule.mod", self._main())
        self._module(f"{MAIN}/Positions.mod", self._positions())
        kinds: list[tuple[str, int, Callable[[int], list[str]]]] = [
            ("Pick", 5, self._pick), ("Pallet", 3, self._pallet), ("Machine", 4, self._machine),
            ("Weld", 5, self._weld), ("Cam", 3, self._cam), ("Path", 2, self._path), ("Glue", 2, self._glue),
        ]  # fmt: skip
        for kind, count, make in kinds:
            for k in range(1, count + 1):
                # an offline system writes the module under the name of its path
                file = f"OLP_{k:02d}" if kind == "Path" else f"{kind}{k}"
                mixed, final = (kind, k) == ("Weld", 2), (kind, k) != ("Pick", 3)
                self._module(f"{MAIN}/{file}.mod", make(k), mixed=mixed, final=final)
        self._module(f"{MAIN}/Vision.mod", self._vision())
        self._module(f"{MAIN}/Service.mod", _SERVICE)
        for name, text in _BACKGROUND.items():
            self._module(f"RAPID/TASK2/{name}", text.splitlines())
        files = self._files
        files["HOME/Pick1_old.mod"] = files[f"{MAIN}/Pick1.mod"]
        files["HOME/docs/readme.txt"] = b"cell 7\r\n"
        files[f"{MAIN}/Cell7.pgf"] = self._program_list()
        files["BACKINFO/backinfo.txt"] = self._information()
        files["SYSPAR/MOC.cfg"] = MOC.replace("\n", "\r\n", 12).encode()
        files["SYSPAR/SYS.cfg"] = SYS.replace("\n", "\r\n").encode()
        files["SYSPAR/EIO.cfg"] = (
            b'EIO:CFG_1.0:6:1::\r\n#\r\nEIO_SIGNAL:\r\n\r\n      -Name "doGrip" -SignalType "DO"\r\n'
        )
        files["system.xml"] = b'<?xml version="1.0" encoding="utf-8"?>\n<SystemProperties>\n</SystemProperties>\n'
        return files

    def _module(
        self, path: str, lines: list[str], *, hidden: bool = False, mixed: bool = False, final: bool = True
    ) -> None:
        """Add a module with CR LF; `mixed`: every third line ends with LF; `final`: also the last line has an end."""
        ends = ["\n" if mixed and k % 3 == 0 else "\r\n" for k in range(len(lines))]
        text = "".join(line + end for line, end in zip(lines, ends, strict=True))
        self._files[path] = (text if final else text.rstrip()).encode("latin-1")
        _, task, place = path.split("/", 2)
        self._listed[task].append(f"{place} @ {'HIDDEN' if hidden else ''}")

    def _program_list(self) -> bytes:
        names = [entry[8:].split(" @")[0] for entry in self._listed["TASK1"] if entry.startswith("PROGMOD/")]
        modules = "".join(f"    <Module>{name}</Module>\r\n" for name in names)
        return f'<?xml version="1.0" encoding="ISO-8859-1" ?>\r\n<Program>\r\n{modules}</Program>\r\n'.encode()

    def _information(self) -> bytes:
        text = _INFORMATION
        for task, name in (("TASK1", "T_ROB1,Cell7"), ("TASK2", "T_SUP,")):
            text += "\n".join([f">>{task}: ({name},)", *self._listed[task], "", ""])
        return f"{text}>>EOF:\n".encode()

    def _point(self, x: float, y: float, z: float, quaternion: int = 0, spread: float = 40.0) -> str:
        """Return a robtarget near a place."""
        p = [c + self._random.uniform(-spread, spread) for c in (x, y, z)]
        texts = [f"{c:.2f}".rstrip("0").rstrip(".") for c in p]
        return f"[[{','.join(texts)}],[{QUATERNIONS[quaternion]}],[0,-1,0,1],{UNUSED}]"

    def _positions(self) -> list[str]:
        """Return the points that several modules use."""
        return [
            "MODULE Positions",
            "  ! Punkte, die mehrere Module anfahren (gepr\xfcft)",
            f"  CONST robtarget pHome:={self._point(900, 0, 1100)};",
            *(f"  CONST robtarget pSafe{k}:={self._point(700, 300 * k - 700, 900)};" for k in range(1, 4)),
            f"  PERS robtarget pPark:={self._point(600, -500, 1000)};",
            f"  TASK PERS robtarget pMaint:={self._point(650, 500, 1000)};",
            "  CONST jointtarget jHome:=[[0,-20,20,0,90,0],[9E9,9E9,9E9,9E9,9E9,9E9]];",
            "ENDMODULE",
        ]

    def _main(self) -> list[str]:
        counts = {"rPick": 5, "rPallet": 3, "rMachine": 4, "rWeld": 5, "rCam": 3, "rGlue": 2}
        calls = [f"{name}{k};" for name, count in counts.items() for k in range(1, count + 1)]
        calls += ["Path_10;", "Path_20;", "rVision;", "rService;"]
        cases = [line for k, call in enumerate(calls, 1) for line in (f"      CASE {k}:", f"        {call}")]
        return [
            *("%%%", "  VERSION:1", "  LANGUAGE:ENGLISH", "%%%", "", "MODULE MainMod", "  VAR num nJob:=0;"),
            *("  PROC main()", "    rInit;", "    WHILE TRUE DO", "      MoveJ pHome,v1000,z50,tGripper;"),
            *("      nJob:=GInput(giJob);", "      TEST nJob"),
            *cases,
            *("      DEFAULT:", '        TPWrite "no job" \\Num:=nJob;', "      ENDTEST", "    ENDWHILE", "  ENDPROC"),
            *("  PROC rInit()", "    AccSet 80,80;", "    ConfL\\Off;", "    MoveAbsJ jHome\\NoEOffs,v200,fine,tool0;"),
            *("    MoveJ pPark,v200,fine,tGripper;", "    MoveJ pMaint,v200,fine,tGripper;", "  ENDPROC", "ENDMODULE"),
        ]

    def _pick(self, k: int) -> list[str]:
        """Return a station that parts are picked from: approach and retreat by Offs."""
        names = [f"pPick{i}" for i in range(1, 6)]
        moves = [
            line
            for name in names
            for line in (
                f"    MoveJ Offs({name},0,0,nAbove),v1000,z10,tGripper\\WObj:=wTable;",
                f"    MoveL {name},v200,fine,tGripper\\WObj:=wTable;",
                "    SetDO doGrip,1;",
                f"    MoveL RelTool({name},0,0,-80),v400,z10,tGripper\\WObj:=wTable;",
            )
        ]
        return [
            f"MODULE Pick{k}",
            "  LOCAL CONST num nAbove:=120;",
            *(f"  LOCAL CONST robtarget {p}:={self._point(80 * i, 60, 20, 0, 8)};" for i, p in enumerate(names, 1)),
            f"  PROC rPick{k}()",
            "    MoveJ pSafe1,v1500,z50,tGripper;",
            *moves,
            "  ENDPROC",
            "ENDMODULE",
        ]

    def _pallet(self, k: int) -> list[str]:
        """Return a palletising module; the third takes the number of its layer from the background task."""
        height = "nLayer*42.5" if k == 3 else "nHigh"
        goal = f"Offs(pCorner{k},i*80,j*60,"
        return [
            f"MODULE Pallet{k}",
            "  LOCAL CONST num nHigh:=150;",
            f"  CONST robtarget pCorner{k}:={self._point(60, 80, 15, 0, 10)};",
            f"  CONST robtarget pDrop{k}:={self._point(40, 300, 60, 0, 10)};",
            f"  PROC rPallet{k}()",
            "    FOR i FROM 0 TO 3 DO",
            "      FOR j FROM 0 TO 2 DO",
            f"        MoveJ {goal}{height}),v1500,z20,tGripper\\WObj:=wPallet;",
            f"        MoveL {goal}0),v300,fine,tGripper\\WObj:=wPallet;",
            "        Set doGrip;",
            f"        MoveL {goal}{height}),v600,z20,tGripper\\WObj:=wPallet;",
            f"        MoveL pDrop{k},v600,fine,tGripper\\WObj:=wTable;",
            "        Reset doGrip;",
            *("      ENDFOR", "    ENDFOR", "  ENDPROC", "ENDMODULE"),
        ]

    def _machine(self, k: int) -> list[str]:
        """Return a module that serves a machine: taught PERS, approach points in variables, points as arguments."""
        names = [f"{name}{k}" for name in ("pDoor", "pChuck", "pTray")]
        moves = [
            line
            for name in names
            for line in (
                f"    pApp:={name};",
                "    pApp.trans.z:=pApp.trans.z+120;",
                "    MoveJ pApp,v1000,z20,tGripper\\WObj:=wMachine;",
                f"    MoveL {name},v150,fine,tGripper\\WObj:=wMachine;",
                "    WaitTime\\InPos,0.2;",
                "    MoveL pApp,v300,z20,tGripper\\WObj:=wMachine;",
            )
        ]
        return [
            f"MODULE Machine{k}",
            *(f"  TASK PERS robtarget {p}:={self._point(50, 40 * i, 120, 2, 15)};" for i, p in enumerate(names)),
            *(f"  CONST robtarget pBlow{k}{c}:={self._point(-80, 60, 150, 2, 15)};" for c in "AB"),
            *("  LOCAL VAR robtarget pApp;", f"  PROC rMachine{k}()"),
            *moves,
            *(f"    rBlow{k} pBlow{k}A;", f"    rBlow{k} pBlow{k}B;", "  ENDPROC"),
            f"  PROC rBlow{k}(robtarget pWhere)",
            "    MoveL Offs(pWhere,0,0,60),v500,z10,tGripper\\WObj:=wMachine;",
            "    MoveL pWhere,v200,fine,tGripper\\WObj:=wMachine;",
            *("    PulseDO\\PLength:=0.5,doAir;", "  ENDPROC", "ENDMODULE"),
        ]

    def _weld(self, k: int) -> list[str]:
        """Return a module that welds seams with arcs."""
        p = [f"pW{k}_{10 * i}" for i in range(1, 9)]
        data = [
            "  TASK PERS seamdata smA:=[0.5,0.5,[0,0,0,0,0,0,0,0,0],0,0,0,0,0,[0,0,0,0,0,0,0,0,0],0,0];",
            "  TASK PERS welddata wdA:=[10,0,[5,0,0,24,0,0,0,0,0],[0,0,0,0,0,0,0,0,0]];",
        ]
        return [
            f"MODULE Weld{k}",
            f"  ! Schwei\xdfbahn, Teil {k}",
            *(data if k == 1 else []),
            *(f"  CONST robtarget {n}:={self._point(60 * i, 40 * (i % 3), 30, 1, 6)};" for i, n in enumerate(p)),
            f"  PROC rWeld{k}()",
            "    MoveJ pSafe2,v1500,z50,tGun;",
            f"    MoveJ {p[0]},vmax,z50,tGun\\WObj:=wJig;",
            f"    ArcLStart {p[1]},v200,smA,wdA,fine,tGun\\WObj:=wJig;",
            f"    ArcL {p[2]},v10,smA,wdA,z1,tGun\\WObj:=wJig;",
            f"    ArcC {p[3]},{p[4]},v10,smA,wdA,z1,tGun\\WObj:=wJig;",
            f"    ArcLEnd {p[5]},v10,smA,wdA,fine,tGun\\WObj:=wJig;",
            f"    MoveL {p[6]},v500,z10,tGun\\WObj:=wJig;",
            f"    MoveJ {p[7]},v1000,z50,tGun\\WObj:=wJig;",
            *("  ERROR", "    IF ERRNO=ERR_WIRE_STICK THEN", "      RETRY;", "    ENDIF", "  ENDPROC", "ENDMODULE"),
        ]

    def _contour(self, n: int) -> Iterator[tuple[float, float, float]]:
        x, y = 20.0, 30.0
        for _ in range(n):
            x, y = x + self._random.uniform(0.5, 3.0), y + self._random.uniform(-1.5, 1.5)
            yield x, y, 5.0 + self._random.uniform(-0.2, 0.2)

    def _cam(self, k: int) -> list[str]:
        """Return a path of a CAM system with its targets in the motions."""
        moves = [
            f"    MoveL [[{x:.3f},{y:.3f},{z:.3f}],[0,0,1,0],[0,-1,0,1],{UNUSED}],v50,z1,tSpindle\\WObj:=wTable;"
            for x, y, z in self._contour(60)
        ]
        head = [f"MODULE Cam{k}", f"  PROC rCam{k}()", "    MoveJ pSafe3,v1000,z50,tSpindle;"]
        return [*head, *moves, "  ENDPROC", "ENDMODULE"]

    def _path(self, k: int) -> list[str]:
        """Return a path of an offline system with named targets."""
        points = {f"Target_{k}{10 * i:04d}": p for i, p in enumerate(self._contour(40), 1)}
        data = [
            f"    CONST robtarget {name}:=[[{x:.6f},{y:.6f},{z:.6f}],[0,0,1,0],[0,0,0,0],{UNUSED}];"
            for name, (x, y, z) in points.items()
        ]
        moves = [f"        MoveL {name},v100,z1,tSpindle\\WObj:=wTable;" for name in points]
        return [f"MODULE Contour_{k}", *data, f"    PROC Path_{k}0()", *moves, "    ENDPROC", "ENDMODULE"]

    def _glue(self, k: int) -> list[str]:
        """Return a path over an array of points."""
        points = ",\r\n    ".join(self._point(30 * i, 25 * i, 40, 0, 5) for i in range(6))
        return [
            f"MODULE Glue{k}",
            f"  LOCAL CONST robtarget pBead{{6}}:=[{points}];",
            f"  PROC rGlue{k}()",
            "    FOR i FROM 1 TO Dim(pBead,1) DO",
            "      MoveL pBead{i},v200,z5,tGripper\\WObj:=wTable;",
            "    ENDFOR",
            "    MoveL Offs(pBead{6},0,0,100),v500,z50,tGripper\\WObj:=wTable;",
            *("  ENDPROC", "ENDMODULE"),
        ]

    def _vision(self) -> list[str]:
        """Return a module whose workobject a camera places, and whose point a sensor finds."""
        return [
            "MODULE Vision",
            f"  LOCAL CONST robtarget pSeen:={self._point(20, 20, 30)};",
            f"  LOCAL CONST robtarget pStart:={self._point(200, 20, 130)};",
            "  LOCAL VAR robtarget pFound;",
            "  PROC rVision()",
            "    wVision.oframe.trans.x:=nCamX;",
            "    wVision.oframe.trans.y:=nCamY;",
            "    MoveL pSeen,v300,fine,tGripper\\WObj:=wVision;",
            "    SearchL\\Stop,diTouch,pFound,pStart,v50,tPointer\\WObj:=wTable;",
            "    MoveL pFound,v50,fine,tPointer\\WObj:=wTable;",
            "  ENDPROC",
            "ENDMODULE",
        ]


_SERVICE: Final = [
    "MODULE Service",
    "  PROC rService()",
    "    VAR robtarget pNow;",
    "    MoveAbsJ [[0,0,0,0,90,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v200,fine,tool0;",
    "    pNow:=CRobT(\\Tool:=tGripper\\WObj:=wobj0);",
    "    pNow.trans.z:=pNow.trans.z+200;",
    "    MoveL pNow,v100,fine,tGripper;",
    "  ENDPROC",
    "ENDMODULE",
]
_SYSTEM: Final = {
    "user": [
        "MODULE user(SYSMODULE)",
        "  VAR num reg1:=0;",
        *("  PERS num nLayer:=0;", "  PERS num nCamX:=0;", "  PERS num nCamY:=0;"),
        f"  CONST robtarget pService:=[[500,0,900],[0,0,1,0],[0,0,0,0],{UNUSED}];",
        *("  PROC rToService()", "    MoveJ pService,v100,fine,tool0;", "  ENDPROC", "ENDMODULE"),
    ],
    "base_lib": [
        *("MODULE base_lib(SYSMODULE,NOSTEPIN)", "  PROC LibReset()"),
        *("    ResetRetryCount;", "  ENDPROC", "ENDMODULE"),
    ],
}
_BACKGROUND: Final = {
    "SYSMOD/user.sys": "MODULE user(SYSMODULE)\nPERS num nLayer:=0;\nPERS num nCamX:=0;\nPERS num nCamY:=0;\nENDMODULE",
    "PROGMOD/Supervisor.mod": (
        "MODULE Supervisor\n  PROC main()\n    WHILE TRUE DO\n      nLayer:=GInput(giLayer);\n      rCamera;\n"
        "      WaitTime 0.1;\n    ENDWHILE\n  ENDPROC\nENDMODULE"
    ),
    "PROGMOD/Camera.mod": (
        "MODULE Camera\n  VAR socketdev sCam;\n  PROC rCamera()\n    VAR string sText;\n"
        "    SocketReceive sCam\\Str:=sText;\n    nCamX:=StrLen(sText);\n  ENDPROC\nENDMODULE"
    ),
    "PROGMOD/Log.mod": 'MODULE Log\n  PROC rLog(string sText)\n    ErrWrite\\I,"cell",sText;\n  ENDPROC\nENDMODULE',
}
_INFORMATION: Final = """#
# Generated backup file, do not edit.
#
>>SYSTEM_ID:
CELL7

>>PRODUCTS_ID:
RobotWare Version: 6.08.01.00

  RobotWare Base
  English
  623-1 Multitasking
  IRB 4600-45/2.05

>>HOME:
All public files and directories

>>SYSPAR:
MOC.cfg
SYS.cfg
EIO.cfg

"""
MOC: Final = f"""MOC:CFG_1.0:6:0::
#
MECHANICAL_UNIT:

      -name "ROB_1" -use_robot "ROB_1" -allow_move_of_user_frame{" "}
#
ROBOT:

      -name "ROB_1" -use_robot_type "ROB1_4600_2.05_45" -use_robot_calib "r1_uncalib"\\
      -use_joint_0 "rob1_1" -use_joint_1 "rob1_2" -base_frame_pos_x 0.1025\\
      -base_frame_pos_z 0.45 -base_frame_orient_u0 0.999962\\
      -base_frame_orient_u3 0.0087265
#
SINGLE:

      -name "STN1" -base_frame_pos_x 9
"""
SYS: Final = f"""SYS:CFG_1.0:6:0::
#
CAB_TASK_MODULES:

      -File "HOME:/user.sys" -ModName "user" -AllTask{" "}
#
CAB_TASKS:

      -Name "T_ROB1" -Type "NORMAL" -UseMechanicalUnitGroup "rob1" -MotionTask{" "}

      -Name "T_SUP" -Type "SEMISTATIC"
#
MECHANICAL_UNIT_GROUP:

      -Name "rob1" -Robot "ROB_1" -UseMotionPlanner "motion_planner_1"
"""


def backup(seed: int = 14) -> dict[str, bytes]:
    """Return the files of the backup by their paths."""
    return Cell(seed).make()
