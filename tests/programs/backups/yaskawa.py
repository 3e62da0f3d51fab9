"""A backup of a Yaskawa controller, made by rule: a GP25 with a turntable that welds, picks, stacks and trims.

The layout is that of real backups; names, numbers and jobs are invented. Jobs are CRLF, positions mostly pulses for
the ways and rectangular for the work, in the base or in user frames.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LIMITS_DEG = ((180.0, 155.0, 160.0, 200.0, 150.0, 455.0), (-180.0, -105.0, -86.0, -200.0, -155.0, -455.0))
PER_DEGREE = (1491.308, 1484.801, 1434.564, 1036.145, 980.0, 454.222)
LENGTHS_UM = ((0, 150000, 0, 760000, 0, 200000, 0, 0, 795000, 0), (0, 0, 100000, 0, 0, 0, 0, 0, 0, 0))
TOOLS = {
    0: ("", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    1: ("TORCH", (12.5, -0.75, 352.25, 0.0, -35.0, 0.0)),
    2: ("GRIPPER", (-10.0, 0.0, 250.0, 0.0, 0.0, 90.0)),
    3: ("SPINDLE", (85.0, 4.5, 190.0, 10.0, 45.0, -5.0)),
    4: ("PROBE", (0.0, 0.0, 301.125, 0.0, 0.0, 0.0)),
}
FRAMES = {
    1: ("JIG LEFT", (900.0, -420.5, -120.25, 0.5, -0.25, 30.0)),
    2: ("JIG RIGHT", (850.0, 515.0, -118.0, 0.0, 0.75, -28.5)),
    3: ("PALLET", (250.5, 1100.25, -400.0, 0.0, 0.0, 91.0)),
    5: ("TABLE", (1250.0, 10.0, 150.0, -1.0, 2.0, 180.0)),
}
VARIABLES: dict[int, tuple[str, tuple[float, ...]]] = {
    0: ("PULSE", (0, -84120, -51240, 0, -92000, 0)),
    7: ("RECTAN", (870.25, 120.0, 310.5, 180.0, 0.0, -90.0)),
    10: ("RECTAN", (0.0, 0.0, 80.0, 0.0, 0.0, 0.0)),
    11: ("RECTAN", (0.0, 0.0, -120.0, 0.0, 0.0, 0.0)),
    12: ("RECTAN", (220.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    13: ("RECTAN", (440.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    30: ("RECTAN", (1.5, -0.25, 0.75, 0.0, 0.0, 0.0)),
    40: ("PULSE", (12000, -64120, -31240, 500, -72000, 900)),
}
RCONF = ",".join("0" * 24)


def crlf(lines: Sequence[str]) -> bytes:
    return "".join(line + "\r\n" for line in lines).encode("latin-1")


def pose(values: Sequence[float]) -> str:
    return ",".join([f"{v:.3f}" for v in values[:3]] + [f"{v:.4f}" for v in values[3:6]])


class Job:
    """A job in the making."""

    def __init__(self, name: str, *, groups: Sequence[str] = ("RB1",), relative: int = 0, comment: str = "") -> None:
        self.name, self.groups, self.relative, self.comment = name, groups, relative, comment
        self.modal: list[tuple[str, str]] = []
        self.positions: list[tuple[str, str, str, str]] = []
        self.code: list[str] = []
        self.stations = 0

    def at(self, values: Sequence[float], tool: int = 1, frame: int = 0, kind: str = "") -> str:
        """Add a position; return its name."""
        name = f"C{len(self.positions):05d}"
        postype = kind or (f"USER {frame}" if frame else "BASE")
        text = ",".join(str(int(v)) for v in values) if kind == "PULSE" else pose(values)
        self.positions.append((name, postype, str(tool), text))
        return name

    def pulses(self, values: Sequence[float], tool: int = 1) -> str:
        return self.at(values, tool, kind="PULSE")

    def add(self, *lines: str) -> None:
        self.code += lines

    def data(self) -> bytes:
        lines = ["/JOB", f"//NAME {self.name}", "//POS"]
        lines.append(f"///NPOS {len(self.positions)},0,{self.stations},0,0,0")
        before: tuple[str, str] = ("", "")
        for name, postype, tool, text in self.positions:
            kind, _, user = postype.partition(" ")
            if (postype, tool) != before:
                lines += [f"///USER {user}"] if user else []
                lines += [f"///TOOL {tool}", f"///POSTYPE {kind}", "///PULSE" if kind == "PULSE" else "///RECTAN"]
                lines += [] if kind == "PULSE" else [f"///RCONF {RCONF}"]
                before = (postype, tool)
            lines.append(f"{name}={text}")
        if self.stations:
            lines += ["///TOOL 0", "///POSTYPE PULSE", "///PULSE"]
            lines += [f"EC{k:05d}={4000 * k + 500}" for k in range(self.stations)]
        lines += ["//INST", "///DATE 2023/05/17 06:42"]
        lines += [f"///COMM {self.comment}"] if self.comment else []
        lines += ["///ATTR SC,RW" + (",RJ" if self.relative else "")]
        lines += [f"////FRAME USER {self.relative}"] if self.relative else []
        lines += [f"///GROUP{k} {group}" for k, group in enumerate(self.groups, 1)]
        return crlf([*lines, "NOP", *self.code, "END"])


def _way(rng: np.random.Generator) -> list[int]:
    """Return pulses of a pose between home and work."""
    degrees = np.array([0.0, -10.0, -20.0, 0.0, -70.0, 0.0]) + rng.uniform(-25.0, 25.0, 6)
    return [round(d * c) for d, c in zip(degrees, PER_DEGREE, strict=True)]


def _work(rng: np.random.Generator) -> list[float]:
    p = np.array([60.0, 40.0, 30.0]) + rng.uniform(-50.0, 250.0, 3)
    return [*p.round(3).tolist(), 180.0 - float(rng.uniform(0, 8).__round__(4)), 2.5, -90.0]


def _base(rng: np.random.Generator) -> list[float]:
    p = np.array([900.0, 0.0, 150.0]) + rng.uniform(-180.0, 180.0, 3)
    return [*p.round(3).tolist(), 180.0, 1.25, float(rng.uniform(-90, 90).__round__(4))]


def handling(k: int, rng: np.random.Generator) -> Job:
    """Pick a part and place it: ways in pulses, the rest in the base or a jig, with taught approach points."""
    frame = (0, 1, 2)[k % 3]
    make = _work if frame else _base
    job = Job(f"PICK-{k:02d}", comment="PICK AND PLACE")
    home = job.pulses(_way(rng), 2)
    job.add(f"MOVJ {home} VJ=50.00", "DOUT OT#(17) OFF")
    for _ in range(3):
        goal = make(rng)
        above = [goal[0], goal[1], goal[2] + 80.0, *goal[3:]]
        a, b = job.at(above, 2, frame), job.at(goal, 2, frame)
        job.add(f"MOVJ {a} VJ=80.00 PL=3", f"MOVL {b} V=150.0 PL=0", "DOUT OT#(17) ON", "TIMER T=0.20")
        job.add(f"IFTHENEXP IN#({k + 3})=ON", f"MOVL {a} V=300.0", "ELSE", "CALL JOB:FAULT", "ENDIF")
    job.add(f"MOVJ {home} VJ=50.00")
    return job


def weld(k: int, rng: np.random.Generator) -> Job:
    """Weld a seam in a jig: straight and round pieces, with a reference point for the weaving."""
    frame = 1 + k % 2
    job = Job(f"WELD-{k:02d}", relative=frame, comment=f"SEAM {k}")
    near = job.pulses(_way(rng))
    seam = [_work(rng) for _ in range(6)]
    names = [job.at(one, 1, frame) for one in seam]
    refer = job.at(_work(rng), 1, frame)
    job.add(f"MOVJ {near} VJ=60.00", f"MOVL {names[0]} V=200.0 PL=0", f"ARCON ASF#({k % 4 + 1})", "WVON WEV#(1)")
    job.add(f"REFP 1 {refer}", f"MOVL {names[1]} V=9.0", *(f"MOVC {n} V=8.0" for n in names[2:5]))
    job.add(f"MOVL {names[5]} V=9.0", "WVOF", f"ARCOF AEF#({k % 4 + 1})", f"MOVJ {near} VJ=60.00")
    return job


def trim(k: int, rng: np.random.Generator) -> Job:
    """Trim along a path of a CAM system, in the table's frame."""
    job = Job(f"TRIM-{k:02d}", comment="CAM")
    t = np.linspace(0.0, 2.0, 70 + 25 * k)
    for a in t:
        x, y, z = 120.0 * np.cos(a) + 4 * k, 90.0 * np.sin(a) + 200.0, 35.0 + 6.0 * np.sin(3 * a)
        name = job.at([x, y, z, 178.5, -4.0 + 2.0 * a, 15.0 * a], 3, 5)
        job.add(f"MOVL {name} V=25.0 PL=1")
    del rng
    return job


def layer(k: int, rng: np.random.Generator) -> Job:
    """Stack one layer; MAIN-STACK shifts it as a whole."""
    job = Job(f"LAYER-{k}")
    for _ in range(4):
        name = job.at([*_work(rng)[:2], 20.0, 180.0, 0.0, 90.0], 2, 3)
        above = job.at([*_work(rng)[:2], 160.0, 180.0, 0.0, 90.0], 2, 3)
        job.add(f"MOVL {above} V=800.0 PL=2", f"MOVL {name} V=120.0 PL=0", "DOUT OT#(17) OFF", f"MOVL {above} V=800.0")
    return job


def stack() -> Job:
    """Call the layers, each three times, shifted by constants of VAR.DAT in the pallet's frame."""
    job = Job("MAIN-STACK")
    for k in (1, 2):
        for number in (10, 12, 13):
            job.add(f"SFTON P{number:03d} UF#(3)", f"CALL JOB:LAYER-{k}", "SFTOF")
        job.add(f"CALL JOB:LAYER-{k}")
    return job


def dip(rng: np.random.Generator) -> Job:
    """Go to points and, shifted along the tool, above them."""
    job = Job("DIP")
    for k in range(5):
        name = job.at(_base(rng), 2)
        job.add("SFTON P011 TF", f"MOVJ {name} VJ=70.00", "SFTOF", f"MOVL {name} V=90.0", f"TIMER T=0.{k}0")
    return job


def clean(rng: np.random.Generator) -> Job:
    """Shift by a variable that constants of the job set."""
    job = Job("CLEAN")
    names = [job.at(_base(rng), 1) for _ in range(4)]
    job.add(*(f"SETE P020 ({e}) {v}" for e, v in enumerate((0, 0, 45000, 0, 0, 0), 1)), "SFTON P020 BF")
    job.add(*(f"MOVL {n} V=200.0" for n in names), "SFTOF", *(f"MOVL {n} V=50.0" for n in names[:2]))
    return job


def search(rng: np.random.Generator) -> Job:
    """Shift by what a touch sensor measures."""
    job = Job("SEARCH", relative=1)
    names = [job.at(_work(rng), 1, 1) for _ in range(3)]
    job.add("CALL JOB:TOUCH ARGF1", "SUB P031 P030", "SFTON P031 UF#(1)", *(f"MOVL {n} V=12.0" for n in names), "SFTOF")
    return job


def turntable(k: int, rng: np.random.Generator) -> Job:
    """Move beside the turntable; the second job follows it."""
    job = Job(f"TURN-{k}", groups=("RB1", "ST1"))
    job.stations = 4
    for i in range(4):
        name = job.at(_base(rng), 1)
        word = "SMOVL" if k == 2 else "MOVL"
        job.add(f"{word} {name} V=30.0  +MOVJ EC{i:05d} VJ=25.00")
    return job


def belt(rng: np.random.Generator) -> Job:
    job = Job("BELT")
    names = [job.at(_base(rng), 2) for _ in range(3)]
    job.add(f"MOVJ {names[0]} VJ=50.00", "SYSTART CV#(1) STP=25.000", f"MOVL {names[1]} V=500.0", "SYEND CV#(1)")
    job.add(f"MOVL {names[2]} V=500.0")
    return job


def variable(rng: np.random.Generator) -> Job:
    """Move to variables of VAR.DAT, among them one whose copy is in the job."""
    job = Job("SERVICE")
    home = job.pulses(_way(rng), 0)
    job.positions.append(("P00007", "BASE", "2", pose(VARIABLES[7][1])))
    job.add("MOVJ P000 VJ=10.00", "MOVL P007 V=100.0", f"MOVJ {home} VJ=30.00")
    return job


def jobs() -> dict[str, bytes]:
    """Return the jobs by file name."""
    rng = np.random.default_rng(25)
    made = [handling(k, rng) for k in range(1, 10)] + [weld(k, rng) for k in range(1, 11)]
    made += [trim(k, rng) for k in range(1, 7)] + [layer(k, rng) for k in (1, 2)] + [stack(), dip(rng), clean(rng)]
    made += [search(rng), turntable(1, rng), turntable(2, rng), belt(rng), variable(rng)]
    fault = Job("FAULT", comment="STÖRUNG")
    fault.add('SETUALM 8001 "TEIL FEHLT" 1', "PAUSE")
    touch = Job("TOUCH")
    touch.add("GETS PX031 $PX001", "RET")
    main = Job("MAIN")
    main.add("*START", "WAIT IN#(1)=ON", "SWITCH I000 CASE 1", "CALL JOB:PICK-01", "CASE 2", "CALL JOB:WELD-01")
    main.add("DEFAULT", "CALL JOB:MAIN-STACK", "ENDSWITCH", "JUMP *START IF IN#(2)=OFF")
    made += [fault, touch, main]
    return {f"{job.name}.JBI": job.data() for job in made}


def tool_cnd() -> bytes:
    lines = []
    for number in range(64):
        name, values = TOOLS.get(number, ("", (0.0,) * 6))
        lines += [f"//TOOL {number}", "///CRC 1815330467", f"///NAME {name}", pose(values)]
        lines += ["0.000,0.000,0.000", "0.000", "0.000,0.000,0.000", "0.000,0,0"]
    return crlf(lines)


def uframe_cnd() -> bytes:
    lines = []
    for number, (name, values) in FRAMES.items():
        lines += [f"//UFRAME {number}", "///CRC 97531864", f"///NAME {name}", "///TOOL 4"]
        lines += ["///GROUP 1,0,0,0,0,0,0,0", "///PULSE", "////RORG C000=0,-84120,-51240,0,-92000,0"]
        lines += ["////RXX C001=100,-84120,-51240,0,-92000,0", "////RXY C002=0,-84120,-51240,0,-92000,10"]
        lines += [f"////BUSER {pose(values)}"]
    return crlf(lines)


def var_dat() -> bytes:
    lines = [
        "//VAR",
        "///CRC 20231207",
        "///SHARE 100,100,100,100,50,128,32,32",
        "///B",
        "0,0,0,1,0,0",
        "///I",
        "0,0,7",
    ]
    lines += ["///D", "0,0,-45000", "///R", "0.000000", "///S", '"",""', "///P"]
    for number in range(128):
        kind, values = VARIABLES.get(number, ("UNUSED", ()))
        if kind == "UNUSED":
            lines.append('"UNUSED"')
        elif kind == "PULSE":
            lines.append(f'"PULSE"0,0,2,{"0" * 24},0,0,' + ",".join(map(str, [*values, 0, 0])))
        else:
            lines.append(f'"RECTAN"0,0,2,{"0" * 24},0,16,{pose(values)},0.0000,0.0000')
    return crlf([*lines, "///BP", *['"UNUSED"'] * 8, "///EX", *['"UNUSED"'] * 8])


def all_prm() -> bytes:
    upper, lower = ([round(d * c) for d, c in zip(row, PER_DEGREE, strict=True)] + [0] * 4 for row in LIMITS_DEG)
    lines = ["//ALL", "///RC1G", "///CRC 11223344", *(",".join(map(str, row)) for row in LENGTHS_UM)]
    lines += [",".join(["0"] * 10)] * 101 + [",".join(map(str, upper)), ",".join(map(str, lower))]
    return crlf([*lines, "///S1C1G", "///CRC 55667788", *["10,20,30,40,50,60,0,0,0,0"] * 20])


def system_sys() -> bytes:
    lines = ["//SYSTEM NO : YAS4.81.00A(DE/EN)-00", "//PARAM NO : 2.10", "//APPLI : ARC", "//ROBOT NAME"]
    return crlf([*lines, "R1 : 1-06VXH25-A0*(GP25)", "S1 : TURN-1", "//LANGUAGE", "DE"])


def backup() -> dict[str, bytes]:
    """Return the files by name."""
    files = {**jobs(), "TOOL.CND": tool_cnd(), "UFRAME.CND": uframe_cnd(), "VAR.DAT": var_dat()}
    files |= {"ALL.PRM": all_prm(), "SYSTEM.SYS": system_sys(), "CMOS.BIN": bytes(range(256))}
    return dict(sorted(files.items()))
