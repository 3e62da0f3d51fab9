"""A backup of a FANUC controller of our own invention: a robot with a positioner that welds, handles and grinds.

Everything follows from the seed: the same bytes on every machine. Frames, registers, approach points, seams in
coordinated motion, logic behind motions, palletising, and the logs and compiled files of a real backup are in it.
"""

# ruff: noqa: E501
from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

HEADER = """/PROG  {name}{kind}
/ATTR
OWNER\t\t= MNEDITOR;
COMMENT\t\t= "{comment}";
PROG_SIZE\t= {size};
CREATE\t\t= DATE 23-05-02  TIME 07:14:30;
MODIFIED\t= DATE 25-11-18  TIME 16:40:08;
FILE_NAME\t= ;
VERSION\t\t= 0;
LINE_COUNT\t= {lines};
MEMORY_SIZE\t= {memory};
PROTECT\t\t= READ_WRITE;
TCD:  STACK_SIZE\t= 0,
      TASK_PRIORITY\t= 50,
      TIME_SLICE\t= 0,
      BUSY_LAMP_OFF\t= 0,
      ABORT_REQUEST\t= 0,
      PAUSE_REQUEST\t= 0;
DEFAULT_GROUP\t= {mask};
CONTROL_CODE\t= 00000000 00000000;
"""
TOOLS = {
    1: ("Gripper", (12.5, 0.0, 186.0, 0.0, 0.0, 0.0)),
    2: ("Torch", (0.0, -35.2, 312.75, 0.0, -22.0, 180.0)),
    3: ("Spindle", (85.0, 0.0, 240.0, 0.0, 45.0, 0.0)),
}
FRAMES = {
    1: ("Infeed", (900.0, -420.5, 310.0, 0.0, 0.0, 90.0)),
    2: ("Pallet", (750.25, 610.0, 105.5, 0.2, -0.1, -45.0)),
    3: ("Fixture", (1180.0, 30.0, 655.0, 0.0, 0.0, 180.0)),
    4: ("Grinding", (1010.0, 250.0, 420.0, 2.5, -1.25, 30.0)),
    5: ("", (1000.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
}
REGISTERS = {
    1: ("Work", None),
    10: ("Above", (0.0, 0.0, 80.0, 0.0, 0.0, 0.0)),
    11: ("Retract", (-40.0, 0.0, 60.0, 0.0, 0.0, 0.0)),
    20: ("Home", (640.0, 0.0, 720.0, 180.0, 0.0, 0.0)),
    30: ("Found", (3.1, -1.2, 0.0, 0.0, 0.0, 0.4)),
}


def number(value: float) -> str:
    """A number as the controller writes it: three decimals, no zero in front of the point."""
    text = f"{value + 0.0 if round(value, 3) else 0.0:.3f}"
    return text.replace("0.", ".", 1) if text.lstrip("-").startswith("0.") and float(text) != 0.0 else text


class Tp:
    """One program: its lines and positions."""

    def __init__(
        self,
        name: str,
        rng: np.random.Generator,
        uf: int,
        ut: int,
        *,
        table: bool = False,
        kind: str = "",
        comment: str = "",
        appl: str = "",
    ) -> None:
        self.name, self.rng, self.uf, self.ut, self.table = name, rng, uf, ut, table
        self.kind, self.comment, self.appl = kind, comment, appl
        self.lines: list[str] = []
        self.positions: list[str] = []

    def add(self, *codes: str) -> Tp:
        """Add instructions."""
        self.lines += [
            code
            if code.startswith("       ---") or code[:7].strip().rstrip(":").isdigit()
            else f"{len(self.lines) + 1:>4}:{code} ;"
            for code in codes
        ]
        return self

    def frames(self) -> Tp:
        return self.add(f"  UFRAME_NUM={self.uf}", f"  UTOOL_NUM={self.ut}")

    def point(
        self,
        xyz: tuple[float, float, float],
        wpr: tuple[float, float, float] = (180.0, 0.0, 0.0),
        *,
        label: str = "",
        uf: str = "",
        e1: bool = False,
        remote: bool = False,
    ) -> str:
        """Add a position; return the text that names it in a motion."""
        n = len(self.positions) + 1
        keys = ("RX", "RY", "RZ") if remote else ("W", "P", "R")
        first = ",\t".join(f"{k:<2}={number(v):>10}  mm" for k, v in zip("XYZ", xyz, strict=True))
        second = ",\t".join(f"{k:<2}={number(v):>10} deg" for k, v in zip(keys, wpr, strict=True))
        more = f",\n\tE1=   {number(120.0):>7}  mm" if e1 else ""
        head = f'P[{n}:"{label}"]' if label else f"P[{n}]"
        text = f"{head}{{\n   GP1:\n\tUF : {uf or self.uf}, UT : {self.ut},\t\tCONFIG : 'N U T, 0, 0, 0',\n\t{first},\n\t{second}{more}\n"
        if self.table:
            turn = float(self.rng.uniform(-90.0, 90.0))
            text += f"   GP2:\n\tUF : 0, UT : 0,\t\n\tJ1= {number(turn):>8} deg,\tJ2= {number(turn / 3):>8} deg\n"
        self.positions.append(text + "};\n")
        return f"P[{n}:{label}]" if label else f"P[{n}]"

    def joints(self, label: str = "") -> str:
        n = len(self.positions) + 1
        values = ",\t".join(f"J{k}= {number(v):>8} deg" for k, v in enumerate((0.0, -15.5, 12.25, 0.0, -77.75, 0.0), 1))
        head = f'P[{n}:"{label}"]' if label else f"P[{n}]"
        self.positions.append(f"{head}{{\n   GP1:\n\tUF : {self.uf}, UT : {self.ut},\t\n\t{values}\n}};\n")
        return f"P[{n}]"

    def near(self, spread: float = 250.0) -> tuple[float, float, float]:
        x, y, z = self.rng.uniform(-spread, spread, 3).round(3)
        return float(x), float(y), float(abs(z))

    def turned(self) -> tuple[float, float, float]:
        w, p, r = self.rng.normal([180.0, 0.0, 0.0], 12.0).round(3)
        return float(w if w <= 180.0 else w - 360.0), float(p), float(r)

    def text(self) -> str:
        mask = "1,1,*,*,*" if self.table else "1,*,*,*,*"
        head = HEADER.format(
            name=self.name,
            kind=self.kind,
            comment=self.comment,
            size=200 + 61 * len(self.positions),
            lines=len(self.lines),
            memory=700 + 64 * len(self.positions),
            mask=mask,
        )
        lines = "".join(f"{line}\n" for line in self.lines)
        return f"{head}{self.appl}/MN\n{lines}/POS\n{''.join(self.positions)}/END\n"


Maker = Callable[[str, np.random.Generator], Tp]


def handling(name: str, rng: np.random.Generator) -> Tp:
    """Pick and place with approach points from a register that the program sets itself."""
    tp = Tp(name, rng, 1, 1, comment="pick and place").frames().add("  PAYLOAD[1]")
    pick, place = tp.point(tp.near(), label="PICK"), tp.point(tp.near(), tp.turned(), label="PLACE")
    way = tp.point((0.0, 0.0, 380.0))
    tp.add("  PR[1]=P[1]", "  PR[1,3]=PR[1,3]+75", f"J {way} 100% CNT100", "L PR[1:Work] 1500mm/sec CNT50")
    tp.add(f"L {pick} 200mm/sec FINE", "  CALL GRIP_CLOSE", "L PR[1:Work] 800mm/sec CNT50")
    tp.add(
        "  PR[12]=LPOS-LPOS", "  PR[12,3]=60", f"L {place} 1500mm/sec CNT50 Offset,PR[12]", f"L {place} 150mm/sec FINE"
    )
    return tp.add("  CALL GRIP_OPEN", f"L {place} 800mm/sec CNT100 Offset,PR[10:Above]", f"J {way} 100% CNT100")


def palletising(name: str, rng: np.random.Generator) -> Tp:
    """A pallet with constant pitch in two loops."""
    tp = Tp(name, rng, 2, 1, comment="pallet 4x3").frames()
    first, way = tp.point((20.0, 35.5, 12.0), label="FIRST"), tp.point((250.0, 180.0, 400.0))
    tp.add(f"J {way} 80% CNT100", "  FOR R[11:row]=0 TO 3", "  FOR R[12:col]=0 TO 2", "  PR[13]=P[1]")
    tp.add("  R[13]=R[11]*80", "  R[14]=R[12]*60.5", "  PR[13,1]=PR[13,1]+R[13]", "  PR[13,2]=PR[13,2]+R[14]")
    tp.add("  PR[13,3]=PR[13,3]+120", "L PR[13] 1200mm/sec CNT30")
    tp.add("  PR[13,3]=PR[13,3]-120", "L PR[13] 200mm/sec FINE", "  CALL GRIP_OPEN", "  ENDFOR", "  ENDFOR")
    return tp.add(f"L {first} 500mm/sec FINE", f"J {way} 80% FINE")


def seam(tp: Tp, n: int, tail: str) -> None:
    """Add a weld seam: straight and circular motions."""
    start = np.array(tp.near(120.0))
    points = [
        tp.point(
            tuple(float(v) for v in (start + np.array([k * 8.0, 15.0 * np.sin(k / 7.0), 0.0])).round(3)), tp.turned()
        )
        for k in range(n)
    ]  # type: ignore[arg-type]
    tp.add(f"L {points[0]} 500mm/sec FINE{tail}", "  Weld Start[1,3]")
    k = 1
    while k < n:
        if k % 6 == 5 and k + 1 < n:
            tp.lines.append(f"{len(tp.lines) + 1:>4}:C {points[k]}    ")
            tp.lines.append(f"    :  {points[k + 1]} 12mm/sec CNT100{tail} ;")
            k += 2
        else:
            tp.add(f"L {points[k]} 12mm/sec {'FINE' if k == n - 1 else 'CNT100'}{tail}")
            k += 1
    tp.add("  Weld End[1,3]")


def welding(name: str, rng: np.random.Generator) -> Tp:
    tp = Tp(name, rng, 3, 2, comment="bracket", appl="/APPL\n  ARC : TRUE ;\n").frames()
    tp.add(f"J {tp.joints('HOME')} 50% FINE", f"J {tp.point(tp.near())} 100% CNT80 ACC80")
    for _ in range(int(rng.integers(2, 5))):
        seam(tp, int(rng.integers(12, 30)), "")
    return tp.add(f"L {tp.point(tp.near())} 800mm/sec CNT100", "J P[1] 50% FINE")


def coordinated(name: str, rng: np.random.Generator) -> Tp:
    """Seams that the positioner turns under the torch."""
    tp = Tp(name, rng, 3, 2, table=True, comment="ring", appl="/APPL\n  ARC : TRUE ;\n/APPL\n").frames()
    tp.add(f"J {tp.point(tp.near())} 60% FINE")
    for _ in range(3):
        seam(tp, int(rng.integers(20, 60)), " COORD")
    return tp.add(f"J {tp.point(tp.near())} 60% FINE")


def grinding(name: str, rng: np.random.Generator) -> Tp:
    """A path of a CAM system."""
    tp, n = Tp(name, rng, 4, 3, comment="CAM").frames(), int(rng.integers(150, 400))
    t = np.linspace(0.0, 4.0 * np.pi, n)
    path = np.column_stack([150.0 * np.cos(t), 90.0 * np.sin(t), 40.0 + 3.0 * t])
    for k, xyz in enumerate(path.round(3)):
        p = tp.point(
            tuple(float(v) for v in xyz),
            (180.0, round(4.0 * float(np.sin(t[k])), 3), round(float(np.rad2deg(t[k])) % 360.0 - 180.0, 3)),
        )  # type: ignore[arg-type]
        tp.add(f"L {p} 40mm/sec {'FINE' if k in (0, n - 1) else 'CNT100'}")
    return tp


def spots(name: str, rng: np.random.Generator) -> Tp:
    """Logic behind each motion."""
    tp = Tp(name, rng, 3, 1, comment="clamping").frames()
    for k in range(int(rng.integers(8, 16))):
        tp.add(f"J {tp.point(tp.near(), tp.turned())} 100% CNT0 ACC100 TB    .10sec,P-SPS   ")
        tp.add(
            "      1:  TC_ONLINE (ON) ;",
            f"      2:  DO[{20 + k}]=OFF ;",
            "      3:  WAIT (DI[23])    ;",
            "       ------ ;",
        )
    return tp


def branching(name: str, rng: np.random.Generator) -> Tp:
    """Jumps, selections and an IF that is left open."""
    tp = Tp(name, rng, 1, 1, comment="variants").frames()
    tp.add("  SELECT R[1:type]=1,JMP LBL[1]", "         =2,JMP LBL[2]", "         ELSE,JMP LBL[9]")
    for label in (1, 2):
        tp.add(
            f"  LBL[{label}:type {label}]",
            f"L {tp.point(tp.near())} 900mm/sec CNT50 ACC80 TIME BEFORE    .10sec,CALL GRIP_OPEN",
            f"L {tp.point(tp.near(), uf='F')} 300mm/sec FINE Skip,LBL[9]",
            "  JMP LBL[9]",
        )
    return tp.add(
        "  LBL[9:end]", "  IF (DI[4:ok] AND (R[2:n]>3 OR !DI[5])) THEN", f"J {tp.point((100.0, 50.0, 300.0))} 30% FINE"
    )


def sensing(name: str, rng: np.random.Generator) -> Tp:
    """Touch sensing and a camera: what they find is known at run time only."""
    tp = Tp(name, rng, 3, 2, comment="search").frames()
    tp.add(
        f"L {tp.point(tp.near())} 300mm/sec FINE",
        "  Search Start[1] PR[30:Found]",
        f"L {tp.point(tp.near())} 50mm/sec FINE Search[-Z]",
        "  Search End",
        "  Touch Offset PR[30:Found]",
    )
    tp.add(*(f"L {tp.point(tp.near())} 20mm/sec CNT100" for _ in range(4)), "  Touch Offset End")
    tp.add(
        "  VISION RUN_FIND 'PART'",
        "  VISION GET_OFFSET 'PART' VR[1] JMP LBL[9]",
        f"L {tp.point(tp.near())} 400mm/sec FINE VOFFSET,VR[1]",
        "  LBL[9]",
    )
    return tp


def from_the_plc(name: str, rng: np.random.Generator) -> Tp:
    """Layers that a superior controller counts: their places are known at run time only."""
    tp = Tp(name, rng, 2, 1, comment="layer").frames()
    tp.point((20.0, 35.5, 12.0), label="FIRST")
    tp.add(
        "  R[20:layer]=GI[1]",
        "  PR[14]=P[1]",
        "  R[21]=R[20]*140",
        "  PR[14,3]=PR[14,3]+R[21]",
        "L PR[14] 600mm/sec FINE",
        "L PR[20:Home] 500mm/sec CNT100",
    )
    return tp.add(
        f"J {tp.point((0.0, 0.0, 450.0))} 100% CNT100",
        f"L {tp.point(tp.near(), e1=True)} 200mm/sec FINE",
        f"L {tp.point(tp.near(), remote=True)} 60mm/sec FINE RTCP",
    )


def macro(name: str, rng: np.random.Generator) -> Tp:
    close = name.endswith("CLOSE")
    tp = Tp(name, rng, 0, 0, kind="\t  Macro", comment="gripper")
    return tp.add(
        f"  RO[1]={'ON' if close else 'OFF'}",
        "  WAIT    .25(sec)",
        f"  WAIT RI[{1 if close else 2}]=ON TIMEOUT,LBL[1]",
        "  LBL[1]",
    )


def main(name: str, rng: np.random.Generator) -> Tp:
    tp = Tp(name, rng, 0, 1, comment="cycle")
    tp.add(f"J {tp.joints()} 30% FINE", "  LBL[1]", "  WAIT DI[1:start]=ON", "  R[1:type]=GI[2]")
    return tp.add(
        *(f"  IF R[1:type]={k},CALL {n}" for k, n in enumerate(("PICK01", "PAL01", "WELD01", "RING01", "CAM01"))),
        "  JMP LBL[1]",
    )


PROGRAMS: dict[str, Maker] = (
    {f"PICK{k:02}": handling for k in range(1, 9)}
    | {f"PAL{k:02}": palletising for k in range(1, 5)}
    | {f"WELD{k:02}": welding for k in range(1, 8)}
    | {f"RING{k:02}": coordinated for k in range(1, 6)}
    | {f"CAM{k:02}": grinding for k in range(1, 4)}
    | {f"CLAMP{k:02}": spots for k in range(1, 4)}
    | {"VARIANTS": branching, "SEARCH": sensing, "LAYERS": from_the_plc}
    | {"GRIP_OPEN": macro, "GRIP_CLOSE": macro, "MAIN": main}
)  # fmt: skip


def block(values: tuple[float, ...]) -> str:
    first = "".join(f"  {k}: {v:>9.3f} " for k, v in zip("XYZ", values[:3], strict=True))
    second = "".join(f"  {k}: {v:>9.3f} " for k, v in zip("WPR", values[3:], strict=True))
    return f"  Group: 1   Config: N D B, 0, 0, 0\n{first}\n{second}\n"


def frame_table(array: str, frames: dict[int, tuple[str, tuple[float, ...]]], size: int) -> Iterator[str]:
    yield f"[*SYSTEM*]{array}  Storage: SHADOW  Access: RW  : ARRAY[2,{size}] OF POSITION\n"
    for group in (1, 2):
        for n in range(1, size + 1):
            values = frames[n][1] if group == 1 and n in frames else (0.0,) * 6
            yield f"    [{group},{n}] = \n{block(values)}"
    yield "\n"


def variables() -> dict[str, str]:
    """The files of variables by name."""
    system = "[*SYSTEM*]$MNUFRAMENUM  Storage: SHADOW  Access: RW  : ARRAY[2] OF BYTE\n    [1] = 1\n    [2] = 0\n\n"
    names = [("1", n, name) for n, (name, _) in TOOLS.items()] + [("3", n, name) for n, (name, _) in FRAMES.items()]
    comments = "".join(
        f"     Field: SETUP_DATA[1,{kind},{n}].$COMMENT Access: RW: STRING[21] = '{name}'\n" for kind, n, name in names
    )
    registers = ["[*POSREG*]$POSREG  Storage: CMOS  Access: RW  : ARRAY[2,100] OF Position Reg\n"]
    for n in range(1, 41):
        name, values = REGISTERS.get(n, ("", None))
        registers.append(
            f"    [1,{n}] =   '{name}' Uninitialized\n"
            if values is None
            else f"    [1,{n}] =   '{name}' \n{block(values)}"
        )
    registers.append("    [2,1] =   ''   Group: 2\n  J1 =    10.000 deg   J2 =     0.000 deg\n\n")
    numeric = "[*NUMREG*]$NUMREG  Storage: CMOS  Access: RW  : ARRAY[200] OF Numeric Reg\n" + "".join(
        f"    [{n}] = {v}  '{name}'\n" for n, v, name in ((1, 0, "type"), (2, 5, "n"), (5, 12.5, "step"))
    )
    robot = "     Field: $SCR_GRP[{}].$ROBOT_ID Access: RO: STRING[37] = '{}'\n"
    return {
        "SYSFRAME.VA": system + "".join(frame_table("$MNUFRAME", FRAMES, 9)) + "".join(frame_table("$MNUTOOL", TOOLS, 10)),
        "FRAMEVAR.VA": "[TPFRAM]SETUP_DATA  Storage: CMOS  Access: RW\n" + comments,
        "POSREG.VA": "".join(registers),
        "NUMREG.VA": numeric + "\n",
        "SYMOTN.VA": robot.format(1, "M-10iA/12") + robot.format(2, "POSITIONER"),
        "VERSION.DG": "F Number:  F00000\n$VERSION:  V8.30P/21   \nDefault Personality\n",
        "BACKDATE.DT": "Version: V8.30P\nBuild ID: 0000\n",
        "ERRALL.LS": "ERRALL.LS    Robot Name ROBOT 18-NOV-25 16:41:02\n  1\" 18-NOV-25 SRVO-003 Deadman switch released\n",
        "LOGBOOK.LS": "LOGBOOK.LS    Robot Name ROBOT\n",
    }  # fmt: skip


def write_backup(root: Path, seed: int = 20251118) -> Path:
    """Write the backup into a folder; return the folder."""
    root.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for k, (name, make) in enumerate(PROGRAMS.items()):
        text = make(name, rng).text()
        ends = "\n" if k % 5 == 4 else "\r\n"
        (root / f"{name}.LS").write_bytes(text.replace("\n", ends).encode("latin-1"))
        (root / f"{name}.TP").write_bytes(b"\x03\x00TP" + name.encode())
    for name, text in variables().items():
        (root / name).write_bytes(text.replace("\n", "\r\n").encode("latin-1"))
    for name in ("SYSVARS.SV", "SYSMACRO.SV", "POSREG.VR", "HTCOLREC.PC", "-BCKED1-.TP"):
        (root / name).write_bytes(b"\x00\x01" + name.encode())
    return root
