"""A backup of a KUKA controller, of our own invention: a welding and handling cell with a mill and a positioner.

`backup()` returns the files by their names; the same on every call. Real backups have this layout: programs beside
system modules and technology packages, two files named $config.dat, frames with names, global points in a list of the
system, lower and upper case mixed, CR LF and LF, missing final newlines.
"""
# ruff: noqa: E501

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random

ROBROOT = (250.0, -120.0, 480.0, 30.0, 0.0, 0.0)
TOOLS = {
    1: ("Torch", "BASE", (12.5, -3.25, 310.004, 0.0, 35.0, 0.0)),
    2: ("Gripper", "BASE", (0.0, 0.0, 185.5, 45.0, 0.0, 0.0)),
    3: ("Spindle", "BASE", (232.044312, 3.01155138, 166.257782, 0.0, -90.0, 0.0)),
    4: ("Probe", "NONE", (1.5, -0.75, 262.125, 0.0, 0.0, 0.0)),
    5: ("Part in gripper", "TCP", (40.0, 0.0, 205.0, 0.0, 0.0, 0.0)),
    6: ("Flange", "BASE", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
}
BASES = {
    1: ("Fixture A", "BASE", (1150.25, -310.5, 402.0, 0.5, -0.25, 0.1)),
    2: ("Fixture B", "BASE", (1140.0, 420.75, 398.5, 90.2, 0.0, 0.3)),
    3: ("Mill table", "BASE", (924.139893, 1099.00952, 527.83374, -89.7931595, 0.238999218, -0.0562113412)),
    4: ("Pallet", "BASE", (620.5, -1180.0, 140.25, 15.0, 0.0, 0.0)),
    5: ("F\xf6rderband", "NONE", (1405.0, -220.0, 655.5, 180.0, 0.0, 0.0)),
    17: ("DKP 400", "BASE", (0.0, 0.0, 85.0, 0.0, 0.0, 0.0)),
}
HEAD = "&ACCESS RVP\n&REL {rel}\n&PARAM EDITMASK = *\n&PARAM TEMPLATE = C:\\KRC\\Roboter\\Template\\vorgabe\n"
EXTERNAL = """;FOLD EXTERNAL DECLARATIONS;%{PE}%MKUKATPBASIS,%CEXT,%VCOMMON,%P
;FOLD BASISTECH EXT;%{PE}%MKUKATPBASIS,%CEXT,%VEXT,%P
EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )
DECL INT SUCCESS
;ENDFOLD (BASISTECH EXT)
;ENDFOLD (EXTERNAL DECLARATIONS)"""
INI = """;FOLD INI;%{PE}
  ;FOLD BASISTECH INI
    GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
    INTERRUPT ON 3
    BAS (#INITMOV,0 )
  ;ENDFOLD (BASISTECH INI)
;ENDFOLD (INI)"""
HOME = """;FOLD PTP HOME  Vel= 100 % DEFAULT;%{PE}%R 8.3.40,%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:HOME, 3:, 5:100, 7:DEFAULT
$BWDSTART = FALSE
PDAT_ACT=PDEFAULT
FDAT_ACT=FHOME
BAS (#PTP_PARAMS,100 )
$H_POS=XHOME
PTP  XHOME
;ENDFOLD"""
NO_AXES = ",E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0"


@dataclass
class Module:
    """A module as its lines; `points` gives each point its place in its base."""

    name: str
    random: Random
    src: list[str] = field(default_factory=list)
    dat: list[str] = field(default_factory=list)
    tool: int = 1
    base: int = 1
    status: int = 2
    n: int = 0

    def pose(self, xyz: tuple[float, float, float], abc: tuple[float, float, float] | None = None) -> str:
        """Return X … C with the mixed numbers of decimals that controllers write."""
        abc = abc or tuple(round(self.random.uniform(-170, 170), 5) for _ in range(3))
        numbers = [f"{v:.{self.random.choice((3, 4, 6))}f}" for v in (*xyz, *abc)]
        return ",".join(f"{key} {number}" for key, number in zip("XYZABC", numbers, strict=True))

    def near(self, spread: float = 220.0) -> tuple[float, float, float]:
        return tuple(self.random.uniform(-spread, spread) for _ in range(3))  # type: ignore[return-value]

    def point(self, name: str = "", xyz: tuple[float, float, float] | None = None, axes: str = NO_AXES) -> str:
        """Teach a point: its E6POS and its FDAT; return its name without the X."""
        self.n += 1
        name = name or f"P{self.n}"
        turn = self.random.choice((2, 10, 35))
        self.dat.append(f"DECL E6POS X{name}={{{self.pose(xyz or self.near())},S {self.status},T {turn}{axes}}}")
        self.dat.append(
            f'DECL FDAT F{name}={{TOOL_NO {self.tool},BASE_NO {self.base},IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}'
        )
        return name

    def taught(self, word: str, *names: str) -> None:
        """Move by an inline form of the pendant."""
        name, k = names[-1], len(self.src)
        if word == "PTP":
            dat, act, bas = f"DECL PDAT PPDAT{k}={{VEL 100.000,ACC 100.000,APO_DIST 100.000,APO_MODE #CDIS}}", f"PDAT_ACT=PPDAT{k}", "BAS(#PTP_PARAMS,100)"  # fmt: skip
        else:
            dat, act, bas = f"DECL LDAT LCPDAT{k}={{VEL 0.80000,ACC 100.000,APO_DIST 5.00000,ORI_TYP #VAR,CIRC_TYP #BASE}}", f"LDAT_ACT=LCPDAT{k}", "BAS(#CP_PARAMS,0.8)"  # fmt: skip
        self.dat.append(dat)
        blend = " C_DIS" if word == "LIN" and self.random.random() < 0.4 else ""
        goal = ", ".join(f"X{n}" if self.random.random() < 0.8 else f"x{n.lower()}" for n in names)
        self.src += [
            f";FOLD {word} {' '.join(names)}{' CONT' if blend else ''} Vel=0.8 m/s CPDAT{k} Tool[{self.tool}]:{TOOLS[self.tool][0]} Base[{self.base}]:{BASES[self.base][0]};%{{PE}}%R 8.3.40,%MKUKATPBASIS,%CMOVE,%V{word},%P 1:{word}, 2:{name}, 7:CPDAT{k}",
            "$BWDSTART=FALSE",
            act,
            f"FDAT_ACT=F{name}",
            bas,
            f"{word} {goal}{blend}",
            ";ENDFOLD",
        ]

    def spline(self, word: str, *names: str) -> None:
        """Move by an inline form of the newer kind, with folded parameters."""
        name = names[-1]
        self.src += [
            f";FOLD {word} {' '.join(names)} Vel=2 m/s CPDAT1 Tool[{self.tool}] Base[{self.base}] ;%{{PE}}",
            ";FOLD Parameters ;%{h}",
            f";Params IlfProvider=kukaroboter.basistech.inlineforms.movement.spline; Kuka.PointName={name}; IlfCommand={word}",
            ";ENDFOLD",
            f"{word} {', '.join('X' + n for n in names)} WITH $VEL=SVEL_CP(2.0, , LCPDAT1), $TOOL=STOOL2(F{name}), $BASE=SBASE(F{name}.BASE_NO), $IPO_MODE=SIPO_MODE(F{name}.IPO_FRAME), $LOAD=SLOAD(F{name}.TOOL_NO), $ACC=SACC_CP(LCPDAT1), $APO=SAPO(LCPDAT1){' C_Spl' if word == 'SLIN' else ''}",
            ";ENDFOLD",
        ]

    def files(self, folder: str, crlf: bool, final: bool) -> dict[str, bytes]:
        head = HEAD.format(rel=self.random.randint(1, 90)).splitlines()
        src = [*head, f"DEF  {self.name}( )", *self.src, "END"]
        lists = [] if not self.dat else [*head, f"DEFDAT  {self.name.upper()}", EXTERNAL, *self.dat, "ENDDAT"]
        upper = self.random.random() < 0.3
        names = (f"{self.name}.src", f"{self.name.upper() if upper else self.name}.dat")
        return {f"{folder}/{name}": encode(lines, crlf, final) for name, lines in zip(names, (src, lists), strict=True) if lines}  # fmt: skip


def encode(lines: list[str] | str, crlf: bool = True, final: bool = True) -> bytes:
    text = "\n".join([lines] if isinstance(lines, str) else lines).rstrip("\n") + ("\n" if final else "")
    return text.replace("\n", "\r\n" if crlf else "\n").encode("cp1252")


def frame(values: tuple[float, ...], lower: bool = False) -> str:
    keys = "xyzabc" if lower else "XYZABC"
    return "{" + ",".join(f"{key} {value:.9g}" for key, value in zip(keys, values, strict=True)) + "}"


def weld(module: Module) -> None:
    """A seam as it is taught on the pendant: PTP to the start, LIN and CIRC along it, PTP away."""
    module.src += [INI, HOME]
    module.taught("PTP", module.point())
    module.taught("LIN", module.point())
    module.src.append("$OUT[12]=TRUE")
    for k in range(6):
        if k % 3 == 2:
            module.taught("CIRC", module.point(), module.point())
        else:
            module.taught("LIN", module.point())
    module.src += ["$OUT[12]=FALSE", "WAIT SEC 0.3"]
    module.taught("LIN", module.point())
    module.taught("PTP", module.point())
    module.src.append(HOME)


def pick(module: Module, k: int) -> None:
    """Pick and place with approach points that the program makes from the taught ones."""
    pick_, place = module.point("PICK"), module.point("PLACE")
    way = module.point("WAY")
    module.dat += ["DECL E6POS XAP", "DECL FRAME FABOVE={X 0.0,Y 0.0,Z 90.0,A 0.0,B 0.0,C 0.0}"]
    module.src += [
        INI,
        HOME,
        f"BAS(#TOOL,{module.tool})",
        f"BAS(#BASE,{module.base})",
        "BAS(#VEL_PTP,80)",
        "$VEL.CP=1.2",
    ]
    module.src += ["grip_open( )"]
    for name in (pick_, place):
        if k % 4 == 3:
            module.src += [f"LIN X{name}:FABOVE C_DIS", f"LIN X{name}"]
        elif k % 3 == 0:
            module.src += [f"XAP=X{name}", f"XAP.Z=XAP.Z+{60 + 5 * k}", "PTP XAP C_PTP", f"LIN X{name}"]
        elif k % 3 == 1:
            module.src += [f"LIN X{name}:{{X 0.0,Y 0.0,Z -{50 + 5 * k}.0,A 0.0,B 0.0,C 0.0}} C_DIS", f"LIN X{name}"]
        else:
            module.src += [f"XAP=X{name}", "XAP.X=XAP.X-15.5", "XAP.Z=XAP.Z+70", "LIN XAP", f"LIN X{name}"]
        module.src += [f"{'grip_close' if name == pick_ else 'grip_open'}( )", "WAIT SEC 0.2"]
        along_tool = f"LIN X{name}:{{X 0.0,Y 0.0,Z -40.0,A 0.0,B 0.0,C 0.0}} C_DIS"
        module.src += [f"LIN FABOVE:X{name} C_DIS" if k % 4 == 3 else along_tool if k % 3 == 1 else "LIN XAP C_DIS"]
        module.src += ["WAIT FOR $IN[17]", f"PTP X{way}"]
    module.src += [HOME]


def pallet(module: Module, k: int) -> None:
    """A pallet with constant pitch, counted by loops."""
    corner = module.point("CORNER", (40.0, 60.0, 110.0))
    module.dat += ["DECL E6POS XPOS", "DECL E6POS XOVER"]
    module.src += ["DECL INT I", "DECL INT J", INI, HOME, f"BAS(#TOOL,{module.tool})", f"BAS(#BASE,{module.base})"]
    module.src += [
        f"FOR J=0 TO {2 + k}", "  FOR I=0 TO 3", f"    XPOS=X{corner}", "    XPOS.X=XPOS.X+I*85.0", "    XPOS.Y=XPOS.Y+J*62.5",
        "    XOVER=XPOS", "    XOVER.Z=XOVER.Z+45", "    LIN XOVER C_DIS", "    LIN XPOS", "    grip_open( )", "    LIN XOVER C_DIS",
        "  ENDFOR", "ENDFOR",
    ]  # fmt: skip
    module.src += [HOME]


def milled(module: Module, k: int) -> None:
    """The output of a CAM system: frames once, then one long list of lines."""
    module.src += [
        "$BWDSTART=FALSE", "BAS (#INITMOV,0 )", f"$TOOL=TOOL_DATA[{module.tool}]", f"$BASE=BASE_DATA[{module.base}]",
        "$VEL.CP=0.05", "$APO.CDIS=0.5", "PTP {A1 5.0,A2 -92.0,A3 101.5,A4 0.0,A5 78.25,A6 -14.0} C_PTP",
    ]  # fmt: skip
    for i in range(240):
        angle = i / 24.0
        x, y, z = 120.0 * math.cos(angle) + 2.0 * k, 90.0 * math.sin(angle), 15.0 - i / 20.0
        tail = ",E1 0.000,E2 0.000" if k % 2 else ""
        module.src.append(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {90.0 + angle:.3f},B 0.000,C 180.000{tail}}} C_DIS")
        if i % 80 == 79:
            module.src.append(f"$VEL.CP=0.0{4 + i // 80}")
    module.src += ["LIN_REL {Z 120.0}"]


def splined(module: Module) -> None:
    """Inline forms of the newer kind, and a block of splines."""
    module.dat += [
        "DECL LDAT LCPDAT1={VEL 2.00000,ACC 100.000,APO_DIST 20.0000,APO_FAC 50.0000,ORI_TYP #VAR,CIRC_TYP #BASE,CB {AUX_PT {ORI #CONSIDER,E1 #CONSIDER},TARGET_PT {ORI #INTERPOLATE,E1 #INTERPOLATE}}}"
    ]
    module.src += [INI]
    module.spline("SPTP", module.point())
    for _ in range(3):
        module.spline("SLIN", module.point())
    module.spline("SCIRC", module.point(), module.point())
    a, b, c, d, e = (module.point() for _ in range(5))
    module.src += [
        f"SPLINE WITH $VEL=SVEL_CP(2.0, , LCPDAT1), $TOOL=STOOL2(F{a}), $BASE=SBASE(F{a}.BASE_NO), $IPO_MODE=SIPO_MODE(F{a}.IPO_FRAME)",
        f"  SPL X{a}", "  TIME_BLOCK START", f"  SPL X{b}", "  TIME_BLOCK PART=40.0", f"  SLIN X{c}", "  TIME_BLOCK END=6.5",
        f"  SCIRC X{d}, X{e} WITH $ORI_TYPE=#CONSTANT", "ENDSPLINE C_SPL",
    ]  # fmt: skip


def expert(module: Module, k: int) -> None:
    """Written by hand: arrays of points, SWITCH, interrupts, triggers, structures, functions."""
    poses = [module.pose(module.near()) for _ in range(4)]
    module.dat += ["STRUC PART_T INT NO,REAL LENGTH,BOOL GOOD", "ENUM MODE_T AUTO,MANUAL", "DECL PART_T PART={NO 0,LENGTH 12.5,GOOD TRUE}", "DECL MODE_T MODE=#AUTO", "DECL E6POS XSTATION[4]"]  # fmt: skip
    module.dat += [f"XSTATION[{i}]={{{pose},S 6,T 50}}" for i, pose in enumerate(poses, 1)]
    module.src += [
        "DECL INT I", "DECL REAL SPEED", "DECL POS P_LOCAL", "INTERRUPT DECL 21 WHEN $IN[33]==TRUE DO stop_pump( )", "INTERRUPT ON 21",
        "BAS(#INITMOV,0)", f"$TOOL=TOOL_DATA[{module.tool}]", f"$BASE=BASE_DATA[{module.base}]", "SPEED=0.35", "$VEL.CP=SPEED",
        f"P_LOCAL={{POS: {module.pose(module.near())},S 'B010',T 'B001010'}}", "PTP P_LOCAL C_PTP",
        "SWITCH MODE", "CASE #AUTO", "  TRIGGER WHEN DISTANCE=0 DELAY=20 DO $OUT[5]=TRUE", f"  LIN {{{module.pose(module.near())}}}",
        "CASE #MANUAL", f"  PTP {{E6POS: {module.pose(module.near())},S 2,T 35{NO_AXES}}}", "DEFAULT", "  HALT", "ENDSWITCH",
        f"CIRC {{{module.pose(module.near())}}},{{{module.pose(module.near())}}}, CA 210.0 C_DIS",
        "FOR I=1 TO 4", "  LIN XSTATION[I] C_VEL", "  PART.NO=PART.NO+1", "ENDFOR",
        f"SLIN {{{module.pose(module.near())}}} WITH $VEL={{CP 0.2,ORI1 100.0,ORI2 100.0}} C_SPL",
        "IF NOT PART.GOOD THEN", f"  LIN {{{module.pose(module.near())}}}", "ENDIF", "REPEAT", "  WAIT SEC 0.1", "UNTIL $IN[40]",
        "INTERRUPT OFF 21", "END", "", "DEF stop_pump( )", "  $OUT[6]=FALSE",
    ]  # fmt: skip
    if k:
        module.src += [
            "END",
            "",
            f"DEFFCT REAL half{k}(V :IN)",
            "DECL REAL V",
            "  RETURN V/2",
            "ENDFCT",
            "",
            "DEF nothing( )",
        ]


def positioner(module: Module) -> None:
    """A seam on the turning table: nothing can be corrected without a model of it."""
    module.base = 17
    module.src += [INI, HOME]
    for k in range(5):
        module.taught("LIN", module.point(axes=f",E1 {15.0 * k},E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0"))


def measured(module: Module) -> None:
    """What a camera finds, a submit writes, or a robot with a compensating controller taught."""
    module.src += [
        INI,
        HOME,
        f"BAS(#TOOL,{module.tool})",
        f"BAS(#BASE,{module.base})",
        "LIN XSEEN",
        "XFOUND=$POS_ACT",
        "LIN XFOUND",
    ]
    module.dat += ["DECL E6POS XFOUND"]
    module.status = 18
    module.taught("LIN", module.point())
    module.taught("LIN", module.point())


def service(module: Module) -> None:
    """Joint targets only."""
    module.dat += ["DECL E6AXIS XSERVICE={A1 90.0,A2 -120.0,A3 125.0,A4 0.0,A5 30.0,A6 0.0,E1 0.0}"]
    module.src += [
        INI,
        HOME,
        "PTP XSERVICE",
        "PTP {A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0}",
        "PTP {A6 45.0}",
        HOME,
    ]


def shared(module: Module) -> None:
    """Motions to the points of the list of global points."""
    module.src += [INI, HOME]
    for name in ("GPARK", "GCLEAN", "GCHANGE"):
        module.taught("PTP", name)


def user_programs() -> dict[str, bytes]:
    """Return the programs of the user and the module names in the order of the table of programs."""
    random = Random(14)
    found: dict[str, bytes] = {}
    kinds = [
        *((f"weld_{k:02}", "Weld", 1, 1 + k % 2, weld, ()) for k in range(1, 11)),
        *((f"Pick{k}", "Handling", 2, 4 + k % 2, pick, (k,)) for k in range(1, 9)),
        *((f"pallet_{k}", "Handling/Pallets", 2, 4, pallet, (k,)) for k in range(3)),
        *((f"MILL{k}", "Mill", 3, 3, milled, (k,)) for k in range(4)),
        *((f"glue_{k}", "Glue", 4, 1 + k % 2, splined, ()) for k in range(5)),
        *((f"station{k}", "Expert", 2, 2, expert, (k,)) for k in range(3)),
        ("turn_table", "Weld", 1, 17, positioner, ()),
        ("Camera", "Expert", 4, 5, measured, ()),
        ("Service", "Service", 1, 1, service, ()),
        ("GoPark", "Service", 2, 1, shared, ()),
        ("CleanTorch", "Service", 1, 1, shared, ()),
    ]
    for i, (name, folder, tool, base, fill, more) in enumerate(kinds):
        module = Module(name, random, tool=tool, base=base)
        if fill is shared:
            module.tool, module.base = 2, 1
        fill(module, *more)
        found |= module.files(f"Program/{folder}", crlf=i % 4 != 3, final=i % 3 != 1)
    calls = "\n".join(f"  CASE {i}\n    {name} ( )" for i, (name, *_) in enumerate(kinds, 1))
    cell = f"DEF  CELL ( )\n{INI}\n{HOME}\nP00 (#INIT_EXT,#PGNO_GET,DMY[],0 )\nLOOP\n  P00 (#EXT_PGNO,#PGNO_GET,DMY[],0 )\n  SWITCH PGNO\n{calls}\n    DEFAULT\n      P00 (#EXT_PGNO,#PGNO_FAULT,DMY[],0 )\n  ENDSWITCH\nENDLOOP\nEND"
    points = Module("", random, tool=2, base=1)
    for name in ("GPARK", "GCLEAN", "GCHANGE"):
        points.point(name)
    lines = [line.replace("DECL ", "DECL GLOBAL ") for line in points.dat]
    found["cell.src"] = encode("&ACCESS RVO\n&REL 5\n" + cell, final=False)
    found["System/Global_Points.dat"] = encode(["&ACCESS RVO1", "DEFDAT  GLOBAL_POINTS PUBLIC", *lines, "ENDDAT"])
    return found


def config_dat(lower: bool = False) -> bytes:
    """Return $config.dat: types and defaults of the controller, tools and bases, kinematic systems, data of the user."""
    lines = ["&ACCESS RV$1", "&REL 11", "DEFDAT  $CONFIG PUBLIC", ";FOLD BASISTECH GLOBALS", "INT DEF_VEL_PTP=100"]
    lines += ["ENUM BAS_COMMAND INITMOV,ACC_CP,TOOL,BASE,EX_BASE,PTP_PARAMS,CP_PARAMS", "STRUC FDAT INT TOOL_NO,BASE_NO,IPO_MODE IPO_FRAME,CHAR POINT2[24],BOOL TQ_STATE"]  # fmt: skip
    lines += ["EXT  BAS (BAS_COMMAND  :IN,REAL  :IN )", "SIGNAL CHANNEL_1 $ANOUT[1]"]
    lines += ['DECL FDAT FHOME={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE,POINT2[] " "}', "DECL PDAT PDEFAULT={VEL 100.000,ACC 100.000,APO_DIST 100.000}", "DECL FDAT FDAT_ACT"]  # fmt: skip
    lines += [
        "E6AXIS XHOME={A1 0.0,A2 -90.0,A3 90.0,A4 0.0,A5 0.0,A6 0.0,E1 0.0}",
        "DECL FRAME REF_PT[2]",
        f"REF_PT[1]={frame((0.0,) * 6)}",
    ]
    for which, table, size in (("TOOL", TOOLS, 16), ("BASE", BASES, 32)):
        lines += [f"INT MAX_{which}={size}", f"DECL FRAME {which}_DATA[{size}]"]
        empty = (" ", "NONE", (0.0,) * 6)
        every = {n: table.get(n, empty) for n in range(1, size + 1)}
        lines += [f"{which}_DATA[{n}]={frame(values, lower)}" for n, (_, _, values) in every.items()]
        lines += [
            f"DECL CHAR {which}_NAME[{size},24]",
            *(f'{which}_NAME[{n},]="{name}"' for n, (name, *_) in every.items()),
        ]
        lines += [
            f"DECL IPO_M_T {which}_TYPE[{size}]",
            *(f"{which}_TYPE[{n}]=#{kind}" for n, (_, kind, _) in every.items()),
        ]
    lines += ["LOAD_DATA[1]={M 12.5,CM {X 0.0,Y 0.0,Z 80.0,A 0.0,B 0.0,C 0.0},J {X 0.1,Y 0.1,Z 0.1}}"]
    if lower:
        table = f"EX_AX_DATA[1]={{ROOT {frame((900.0, -800.0, 350.0, 0.0, 0.0, 0.0))},EX_KIN #EASYS,OFFSET {frame((0.0,) * 6)}}}"
        lines += ["DECL EX_AX_T EX_AX_DATA[6]", table]
    else:
        lines += [
            "DECL MACHINE_DEF_T MACHINE_DEF[16]",
            f'MACHINE_DEF[1]={{NAME[] "KR 16 R1610",COOP_KRC_INDEX 1,PARENT[] "WORLD",ROOT {frame(ROBROOT)},MECH_TYPE #ROBOT,GEOMETRY[] " "}}',
            f'MACHINE_DEF[2]={{NAME[] "DKP 400",COOP_KRC_INDEX 1,PARENT[] "WORLD",ROOT {frame((900.0, -800.0, 350.0, 0.0, 0.0, 0.0))},MECH_TYPE #EASYS,GEOMETRY[] " "}}',
            'MACHINE_TOOL_DAT[1]={MACH_DEF_INDEX 1,PARENT[] "KR 16 R1610",GEOMETRY[] " "}',
            'MACHINE_FRAME_DAT[1]={MACH_DEF_INDEX 0,PARENT[] "WORLD",GEOMETRY[] " "}',
            'MACHINE_FRAME_DAT[17]={MACH_DEF_INDEX 2,PARENT[] "DKP 400",GEOMETRY[] " "}',
        ]
    lines += [";ENDFOLD (BASISTECH GLOBALS)", ";FOLD USER GLOBALS", "DECL E6POS XSEEN", "INT N_PARTS=1204", "DECL CHAR DMY[3]", ";ENDFOLD (USER GLOBALS)", "ENDDAT"]  # fmt: skip
    return encode(lines, final=not lower)


def machine_dat(root: tuple[float, ...] = ROBROOT, carried: bool = False) -> bytes:
    kinematics = "ET1 #ERSYS,ET2 #EASYS" if carried else "ET1 #EASYS,ET2 #NONE"
    return encode(f"""&ACCESS RV$
&PARAM VERSION = 1.0.0
DEFDAT  $MACHINE PUBLIC
CHAR $V_R1MADA[32]
$V_R1MADA[]="V42.000.00.00/KUKA8.6" ;VERSION
INT $AXIS_TYPE[12]
$AXIS_TYPE[1]=3
REAL $MAMES[12]
$MAMES[2]=-120.000
FRAME $ROBROOT={frame(root)} ;ROBOT IN WORLD [MM,DEG]
FRAME $ERSYSROOT={frame((0.0,) * 6)}
CHAR $TRAFONAME[32]
$TRAFONAME[]="#KR16R1610 C4 FLR"
INT $EX_AX_NUM=2
DECL EX_KIN $EX_KIN={{{kinematics},ET3 #NONE,ET4 #NONE,ET5 #NONE,ET6 #NONE}}
DECL ET_AX $ET1_AX={{TR_A1 #E1,TR_A2 #NONE,TR_A3 #NONE}}
DECL ET_AX $ET2_AX={{TR_A1 #E2,TR_A2 #E3,TR_A3 #NONE}}
FRAME $ET1_TA1KR={frame((0.0,) * 6)}
ENDDAT""")


def system_files() -> dict[str, bytes]:
    """Return what stands beside the programs: system modules, submits, technology packages."""
    return {
        "System/bas.src": encode("&ACCESS R\nGLOBAL DEF  BAS (CMD :IN,VALUE :IN )\nDECL BAS_COMMAND CMD\nREAL VALUE\nSWITCH CMD\nCASE #TOOL\n  $TOOL=TOOL_DATA[VALUE]\nCASE #BASE\n  $BASE=BASE_DATA[VALUE]\nENDSWITCH\nEND"),
        "System/ir_stopm.src": encode("&ACCESS R\nDEF  IR_STOPM ( )\nBRAKE\nWAIT SEC 0\nEND"),
        "System/masref_main.src": encode("DEF  MASREF_MAIN ( )\nTOOL_DATA[16]=$NULLFRAME\nPTP {A1 0.0}\nEND"),
        "System/sps.sub": encode("&ACCESS RVP\nDEF  SPS ( )\nDECL INT N\nLOOP\n  IF $IN[50] THEN\n    N_PARTS=N_PARTS+1\n    XSEEN.X=N\n  ENDIF\n  count_parts( )\nENDLOOP\nEND"),
        "System/Counter.src": encode("DEF  count_parts_dummy( )\nEND\nGLOBAL DEF count_parts( )\nN_PARTS=N_PARTS\nEND"),
        "TP/p00.src": encode("&ACCESS R\nDEF  P00 (COMMAND :IN,PGNO_FUNCT :IN,PRO_NAME[] :OUT,SCREEN_NO :IN )\nDECL P00_COMMAND COMMAND\nWAIT FOR $IN[1]\nEND"),
        "TP/p00.dat": encode("DEFDAT P00 PUBLIC\nINT PGNO_WAIT=0\nENDDAT"),
        "TP/GripTech/grip.src": encode("&ACCESS RV\nDEF  grip( )\nEND\nGLOBAL DEF grip_open( )\n$OUT[21]=TRUE\nWAIT FOR $IN[21]\nEND\nGLOBAL DEF grip_close( )\n$OUT[21]=FALSE\nWAIT FOR $IN[22]\nEND"),
        "TP/Measure/touch.src": encode("DEF touch( )\nBASE_DATA[1].X=BASE_DATA[1].X+$POS_ACT.X\nEND"),
    }  # fmt: skip


def robot_folder() -> dict[str, bytes]:
    """Return the files of one robot's folder."""
    return {
        "Mada/$machine.dat": machine_dat(),
        "Mada/$robcor.dat": encode('DEFDAT $ROBCOR PUBLIC\n$MODEL_NAME[]="#KR16R1610 C4 FLR"\nENDDAT'),
        "System/$config.dat": config_dat(),
        **system_files(),
        **user_programs(),
    }


def backup() -> dict[str, bytes]:
    """Return the files of the archive."""
    return {
        "am.ini": encode(
            "[Archive]\nName=Cell4\n[Roboter]\nRobName=Cell4 left\nIRSerialNr=500123\n[Version]\nVersion=V8.6.2"
        ),
        "C/KRC/Roboter/Config/User/Common/KRC_IO.xml": b"<KrcIo/>\n",
        "C/KRC/Roboter/Rdc/500123.cal": b"\0\1\2",
        **{f"KRC/R1/{name}": data for name, data in robot_folder().items()},
        "KRC/STEU/$config.dat": encode("&ACCESS RV$5\nDEFDAT $CONFIG\n\nENDDAT", final=False),
        "KRC/STEU/Mada/$machine.dat": encode("DEFDAT  $MACHINE PUBLIC\nINT $NUM_AX=6\nENDDAT"),
        "KRC/STEU/Mada/$custom.dat": encode("DEFDAT  $CUSTOM PUBLIC\nINT $PSYS_PRINT=1\nENDDAT"),
    }


def two_robots() -> dict[str, bytes]:
    """Return an archive with two robots, whose modules have the same names and whose places differ."""
    other = {**robot_folder(), "Mada/$machine.dat": machine_dat((-900.0, 0.0, 480.0, 0.0, 0.0, 0.0))}
    other["System/$config.dat"] = other["System/$config.dat"].replace(b"ROOT " + frame(ROBROOT).encode(), b"ROOT " + frame((-900.0, 0.0, 480.0, 0.0, 0.0, 0.0)).encode())  # fmt: skip
    return {**backup(), **{f"KRC/R2/{name}": data for name, data in other.items()}}


def older() -> dict[str, bytes]:
    """Return the archive of an older controller: lower case, no kinematic systems by name."""
    files = {name: data for name, data in backup().items() if "$config" not in name}
    files["KRC/R1/System/$config.dat"] = config_dat(lower=True)
    files["KRC/STEU/Mada/$option.dat"] = encode("DEFDAT $OPTION PUBLIC\nBOOL $ABS_ACCUR=FALSE\nENDDAT")
    return {name.lower(): data for name, data in files.items()}


def few() -> dict[str, bytes]:
    """Return the backup with one program of each kind alone."""
    kept = ("weld_01.", "pick1.", "pick3.", "pallet_0.", "glue_0.", "station0.", "camera.")
    return {
        name: data
        for name, data in backup().items()
        if "/Program/" not in name or name.rpartition("/")[2].lower().startswith(kept)
    }
