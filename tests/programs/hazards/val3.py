"""Stäubli VAL3: programs for each hazard; see `tests.programs.hazards`."""

from __future__ import annotations

from tests.programs.hazards import Cell

from truepose.programs import FrameTable, ReadOptions

DERIVED = ReadOptions(derived=True)
FRAMES = FrameTable()
XML = '<?xml version="1.0" encoding="utf-8" ?>\n'
_SHAPE = 'shoulder="lefty" elbow="epositive" wrist="wpositive"'


def _array(name: str, kind: str, *values: str, access: str = "private") -> str:
    rows = "".join(f'      <Value key="{k}" {value} />\n' for k, value in enumerate(values))
    head = f'<Data name="{name}" access="{access}" xsi:type="array" type="{kind}" size="{len(values)}">'
    return f"    {head}\n{rows}    </Data>\n"


def _pose(x: float, father: str = "fA", more: str = _SHAPE) -> str:
    return f'x="{x:.3f}" y="-20.250" z="300.000" rx="0.000" ry="0.000" rz="0.000" {more} fatherId="{father}[0]"'


def _structure(name: str, *x: float) -> str:
    values = "".join(
        f'<Value key="{k}"><Field name="pPick" xsi:type="array" type="pointRx" size="1">\n'
        f'<Value key="0" {_pose(one)} />\n</Field></Value>\n'
        for k, one in enumerate(x)
    )
    return f'<Data name="{name}" access="private" xsi:type="array" type="Station" size="{len(x)}">\n{values}</Data>\n'


DATA = (
    _array("fA", "frame", _pose(500, "world", ""), _pose(600, "world", ""), access="public")
    + _array("fB", "frame", _pose(50, "fA", ""))
    + "".join(
        _array(name, "tool", f'z="{z}" fatherId="flange[0]" ioLink="valve1"') for name, z in (("tA", 100), ("tB", 150))
    )
    + "".join(_array(name, "pointRx", _pose(100 + 50 * k)) for k, name in enumerate(("p1", "p2", "p3")))
    + _array("pB", "pointRx", _pose(40, "fB"))
    + _array("pT", "pointRx", *(_pose(700 + 30 * k) for k in range(4)))
    + "".join(_array(name, "pointRx", 'z="0"') for name in ("pUp", "pV", "pW"))
    + _structure("stA", 10)
    + _structure("stC", 20, 30, 40)
    + _array("nI", "num", 'value="0"')
    + _array("nMap", "num", 'value="0"', 'value="1"')
    + _array("bX", "bool", 'value="false"')
    + _array("mN", "mdesc", 'vel="100"')
)
REFERENCE, VALUE = 'use="reference"', 'use="value"'


def program(name: str, *code: str, local: str = "", **parameters: str) -> str:
    """Return a program; `parameters` are types by name, followed by the way they are handed over."""
    rows = "".join(
        f'<Parameter name="{p}" type="{kind.split()[0]}" xsi:type="element" {kind.partition(" ")[2]} />\n'
        for p, kind in parameters.items()
    )
    rows = f"<Parameters>\n{rows}</Parameters>\n" if rows else ""
    if local:
        kinds = {"l_s": "Station", "l_t": "tool", "l_n": "num"}
        some = "".join(f'<Local name="{n}" type="{kinds.get(n, "pointRx")}" size="1" />\n' for n in local.split())
        rows += f"<Locals>\n{some}</Locals>\n"
    body = "\n  ".join(["begin", *code])
    head = f'{XML}<Programs>\n<Program name="{name}">\n{rows}'
    return f"{head}<Code><![CDATA[\n  {body}\nend\n]]></Code></Program></Programs>\n"


def cell(
    *code: str,
    local: str = "",
    others: dict[str, str] | None = None,
    libraries: str = "",
    options: ReadOptions | None = None,
    fault: str = "",
    **wanted: str,
) -> Cell:
    """Return a cell of an application whose program ``start`` is given; `others` are its other programs."""
    programs = {"start": program("start", *code, local=local), **(others or {})}
    listed = "".join(f'<Program file="{name}.pgx" />\n' for name in programs)
    project = f'<Programs>{listed}</Programs>\n<Database><Data file="a.dtx" /></Database>\n<Libraries>{libraries}'
    files = {"a.dtx": f"{XML}<Database>\n  <Datas>\n{DATA}  </Datas>\n</Database>\n"}
    files["a.pjx"] = f'{XML}<Project>\n<Parameters millimeterUnit="true" />\n{project}</Libraries>\n</Project>\n'
    files |= {f"{name}.pgx": text for name, text in programs.items()}
    verdicts = {name.replace("_", "."): verdict for name, verdict in wanted.items()}
    return Cell(files, verdicts, options or ReadOptions(), FRAMES, fault)


def go(point: str, tool: str = "tA") -> str:
    return f"movel({point},{tool},mN)"


CELLS: dict[str, list[Cell]] = {
    "unknown-statement": [
        cell(go("p1"), "strange(tA)", go("p2"), p1="refuse", p2="refuse"),
        cell(go("p1"), "strange(p1,5)", go("p2"), p1="refuse", p2="correct"),
        cell(go("p1"), "strange fA", go("p2"), p1="refuse"),
        cell(go("p1"), "insert(fA,0)", p1="refuse"),
        cell(go("p1"), "waitEndMove()", "open(tA)", "delay(0.5)", go("p2"), p1="correct", p2="correct"),
    ],
    "coordinate-in-position": [
        cell(go("appro(p1,{p2.trsf.x,0,0,0,0,0})"), go("p2"), p2="refuse"),
        cell(go("compose(p1,fA,{0,0,p2.trsf.z,0,0,0})"), go("p2"), go("p3"), p2="refuse", p3="correct"),
    ],
    "coordinate-in-number": [
        cell("nI=p1.trsf.z", go("p1"), "if nI>500", "endIf", p1="refuse"),
        cell("nI=p1.trsf.z+5", "sioSet(aOut,nI)", go("p1"), go("p2"), p1="refuse", p2="correct"),
        cell("putln(p1.trsf.z)", go("p1"), p1="refuse"),
        cell("if p1.trsf.z>500", go("p2"), "endIf", go("p1"), p1="refuse", p2="correct"),
    ],
    "coordinate-in-frame": [
        cell("fB.trsf.z=p1.trsf.z", go("p1"), go("pB"), p1="refuse", pB="refuse"),
        cell("setFrame(p1,p2,p3,fB)", go("p1"), go("pB"), p1="refuse", pB="refuse"),
        cell("fB.trsf=p1.trsf", go("p1"), go("p2"), p1="refuse", p2="correct"),
    ],
    "expression-in-modifier": [
        cell("mN.vel=p1.trsf.z", go("p1"), go("p2"), p1="refuse", p2="correct"),
        cell("wait(p1.trsf.z>500)", go("p1"), go("p2"), p1="refuse", p2="correct"),
        cell("watch(p1.trsf.z>500,2)", go("p1"), p1="refuse"),
    ],
    "called-program-shifts": [
        cell(
            go("p1"),
            "call up()",
            go("p2"),
            others={"up": program("up", "fA.trsf.z=fA.trsf.z+50")},
            p1="refuse",
            p2="refuse",
        ),
        cell(
            "call up(p1)",
            go("p1"),
            go("p2"),
            others={"up": program("up", "x_p.trsf.z=50", x_p=f"pointRx {REFERENCE}")},
            p1="refuse",
            p2="correct",
        ),
    ],
    "called-program-sets-frame": [
        cell(
            go("p1"), "call set()", go("pB"), others={"set": program("set", "tA.trsf.z=nI")}, p1="refuse", pB="refuse"
        ),
        cell(
            go("p1"), "call set()", go("pB"), others={"set": program("set", "fB.trsf.z=nI")}, p1="correct", pB="refuse"
        ),
        cell(go("p1"), "call set()", others={"set": program("set", "tB.trsf.z=nI")}, p1="correct"),
    ],
    "handler-changes-state": [
        cell('taskCreate "t",10,set()', go("p1"), others={"set": program("set", "tA.trsf.z=5")}, p1="refuse"),
        cell(
            'taskCreate "t",10,copy()',
            "pUp=p1",
            go("pUp"),
            go("p1"),
            others={"copy": program("copy", "pUp=p2")},
            p1="refuse",
        ),
        cell('taskCreate "t",10,blink()', go("p1"), others={"blink": program("blink", "nI=5")}, p1="correct"),
    ],
    "certain-loop": [
        cell("for nI=0 to 3", "tA.trsf.z=5", "endFor", go("p1"), p1="refuse"),
        cell(
            "for nI=0 to 3",
            go("pT[nI]"),
            "endFor",
            "pUp=pT[1]",
            "tB.trsf.z=5",
            **{"pT[1]": "correct", "pT[2]": "correct"},
        ),
    ],
    "conditional-frame": [
        cell("if bX", "fA.trsf.z=5", "endIf", go("p1"), p1="refuse"),
        cell("if bX", "link(fB,world)", "endIf", go("p1"), go("pB"), p1="correct", pB="refuse"),
    ],
    "frame-written-by-call": [
        cell("fA[nMap[nI]].trsf.z=5", go("p1"), p1="refuse"),
        cell("fA[abs(nI)].trsf.z=5", go("p1"), p1="refuse"),
        cell("fA[1].trsf.z=5", go("p1"), p1="correct"),
        cell(
            *("call calib(fA)", go("p1")),
            others={"calib": program("calib", "x_f[1].trsf.z=5", x_f=f"frame {REFERENCE}")},
            p1="refuse",
        ),
        cell("setFrame(pT[0],pT[1],pT[2],fA)", go("p1"), p1="refuse"),
        cell(
            "call calib(tA)",
            go("p1"),
            others={"calib": program("calib", "nI=1", x_t=f"tool {REFERENCE}")},
            p1="correct",
        ),
        cell(
            'nI=geo:libLoad("x")', go("p1"), libraries='<Library alias="geo" path="Disk://geo/geo.pjx" />', p1="refuse"
        ),
    ],
    "routine-like-a-motion": [
        cell(
            go("p1"),
            "call movelUp(p2)",
            go("p2"),
            others={"movelUp": program("movelUp", "movel(x_p,tB,mN)", x_p=f"pointRx {VALUE}")},
            p1="correct",
            p2="refuse",
        ),
        cell("movelUp(p1,tB,mN)", go("p1"), p1="refuse"),
    ],
    "array-element": [
        cell(go("pT[nI]"), go("pT[1]", "tB"), **{"pT[1]": "refuse", "pT[2]": "correct"}),
        cell("pT[nI]=p1", go("pT[2]"), go("p1"), **{"pT[2]": "skip", "p1": "refuse"}),
        cell("pT[nMap[nI]]=p1", go("pT[2]"), go("p1"), **{"pT[2]": "refuse", "p1": "refuse"}),
    ],
    "whole-array": [
        cell(
            go("stA.pPick"),
            "call pick(stA)",
            others={"pick": program("pick", "movel(x_s.pPick,tB,mN)", x_s=f"Station {REFERENCE}")},
            stA_pPick="refuse",
        ),
        cell(go("stA.pPick"), "l_s=stA", go("l_s.pPick", "tB"), local="l_s", stA_pPick="refuse"),
        cell(
            "stC[1]=stC[2]",
            go("stC[1].pPick"),
            go("stC[2].pPick"),
            **{"stC[1].pPick": "skip", "stC[2].pPick": "refuse"},
        ),
        cell(go("stC[2].pPick"), go("stC.pPick"), "stC[1]=stA", **{"stC[2].pPick": "correct", "stC.pPick": "correct"}),
        cell(
            go("pT[1]"),
            "call all(pT)",
            others={"all": program("all", "x_p[1].trsf.z=5", x_p=f"pointRx {REFERENCE}")},
            **{"pT[1]": "refuse"},
        ),
    ],
    "compact-condition": [
        cell("if bX tA.trsf.z=5 endIf", go("p1"), p1="refuse"),
    ],
    "initial-value": [
        cell("pUp=p1", "if bX", "endIf", go("pUp", "tB"), go("p1"), p1="refuse"),
    ],
    "routine-in-a-motion": [
        cell("movel(appro(p1,calc(p2)),tA,mN)", go("p2"), p2="refuse"),
    ],
    "argument-not-followed": [
        cell(
            "call use(appro(p1,{0,0,nI,0,0,0}))",
            go("p1"),
            others={"use": program("use", "movel(x_p,tA,mN)", x_p=f"pointRx {VALUE}")},
            p1="refuse",
        ),
        cell(
            "call use(p1.trsf.z)", go("p1"), others={"use": program("use", "nI=x_n", x_n=f"num {VALUE}")}, p1="refuse"
        ),
    ],
    "argument-written": [
        cell(
            "call set(p1)",
            go("p1"),
            go("p2"),
            others={"set": program("set", "x_p=p3", x_p=f"pointRx {REFERENCE}")},
            p1="refuse",
            p2="correct",
        ),
        cell(
            "pUp=p1",
            "call set(pUp)",
            go("pUp"),
            go("p1"),
            others={"set": program("set", "x_p.trsf.z=5", x_p=f"pointRx {REFERENCE}")},
            p1="refuse",
        ),
    ],
    "tool-through-argument": [
        cell(
            "call go(tA)",
            "call go(tB)",
            go("p2"),
            others={"go": program("go", "movel(p1,x_t,mN)", x_t=f"tool {VALUE}")},
            p1="refuse",
            p2="correct",
        ),
        cell(
            "call set(tA)",
            go("p1"),
            others={"set": program("set", "x_t.trsf.z=5", x_t=f"tool {REFERENCE}")},
            p1="refuse",
        ),
        cell("l_t=tA", "l_t.trsf.z=50", go("p1", "l_t"), local="l_t", p1="refuse"),
    ],
    "continue-in-loop": [
        cell("while bX", "pUp=p1", "if bX", "return", "endIf", go("pUp", "tB"), "endWhile", go("p1"), p1="refuse"),
    ],
    "inverse-kinematics": [
        cell("bX=pointToJoint(tA,jHere,p1,jOut)", "movej(jOut,tA,mN)", go("p1"), go("p2"), p1="refuse", p2="correct"),
    ],
    "chain-of-copies": [
        cell("pUp=p1", "if bX", "endIf", "pV=pUp", go("pV", "tB"), go("p1"), p1="refuse"),
        cell("pUp=p1", "if bX", "endIf", "pV=pUp", "putln(pV.trsf.z)", go("p1"), p1="refuse"),
        cell(
            "pUp=p1",
            "call next()",
            go("p1"),
            others={"next": program("next", "pV=pUp", "putln(pV.trsf.z)")},
            p1="refuse",
        ),
        cell("pUp=p1", "pV=pUp", "if bX", "endIf", "pW=pV", go("pW", "tB"), go("p1"), p1="refuse"),
        cell("pUp=p1", "if bX", "endIf", "pV=appro(pUp,{0,0,-50,0,0,0})", go("pV", "tB"), go("p1"), p1="refuse"),
        cell("l_p=p1", "if bX", "endIf", "l_q=l_p", go("l_q", "tB"), go("p1"), local="l_p l_q", p1="refuse"),
        cell("pUp=p1", go("pUp"), go("p1"), p1="correct"),
    ],
    "index-read": [
        cell("nI=nMap[round(p1.trsf.x)]", go("p1"), p1="refuse"),
        cell(go("pT[round(p1.trsf.x)]"), go("p1"), p1="refuse"),
        cell("nMap[round(p1.trsf.x)]=7", go("p1"), go("p2"), p1="refuse", p2="correct"),
        cell(go("pT[nI]"), go("p1"), p1="correct"),
    ],
    "arithmetic-on-a-point": [
        cell("p1.trsf.z=p1.trsf.z*2", go("p1"), go("p2"), p1="skip", p2="correct"),
        cell("pUp=p1", "pUp.trsf.z=p2.trsf.z", go("pUp"), go("p1"), go("p2"), p1="refuse", p2="refuse"),
        cell("pUp=p1", "pUp.trsf.z=pUp.trsf.z*2", go("pUp"), go("p1"), options=DERIVED, p1="refuse"),
    ],
    "run-time-shift": [
        cell(go("appro(p1,{0,0,nI,0,0,0})"), go("p1"), go("p2"), p1="refuse", p2="correct"),
        cell("pUp=p1", "pUp.trsf.z=pUp.trsf.z+nI", go("pUp"), go("p1"), options=DERIVED, p1="refuse"),
        cell("tA.trsf.z=5", go("appro(p1,{0,0,-50,0,0,0})"), options=DERIVED, p1="refuse"),
        cell("tB.trsf.z=5", go("appro(p1,{0,0,-50,0,0,0})"), options=DERIVED, p1="correct"),
    ],
    "two-frames": [
        cell(go("p1"), go("p1", "tB"), go("p2", "tB"), p1="refuse", p2="correct"),
        cell("pUp=p1", go("pUp", "tB"), go("p1"), p1="refuse"),
        cell("link(p1,fB)", go("p1"), go("p2"), p1="refuse", p2="correct"),
    ],
    "sensor-shift": [
        cell("alterBegin(fA,mN)", "alterMovel(p1,tA,mN)", go("p2"), "alterEnd()", p1="refuse", p2="refuse"),
        cell("movelf(p1,tA,mN)", go("p2"), p1="refuse", p2="correct"),
    ],
    "alias": [
        cell(go("pT"), go("pT[0]", "tB"), pT="refuse"),
        cell(go("pT"), go("PT[0]"), pT="correct"),
    ],
    "recursion": [
        cell(
            go("p1"),
            "call down(1)",
            others={"down": program("down", "tA.trsf.z=x_n", "call down(x_n+1)", x_n=f"num {VALUE}")},
            p1="refuse",
        ),
        cell(
            go("p1"),
            "call down(p2)",
            go("p2"),
            others={"down": program("down", "call down(x_p)", "movel(x_p,tB,mN)", x_p=f"pointRx {VALUE}")},
            p1="correct",
            p2="refuse",
        ),
    ],
    "unreachable-code": [
        cell(go("p1"), "return", "tA.trsf.z=5", p1="refuse"),
        cell(go("p1"), "//tA.trsf.z=5", 'putln("tA.trsf.z=5 p1")', p1="correct"),
    ],
    "state-across-calls": [
        cell(
            go("p1"),
            "call a()",
            others={
                "a": program("a", "call b(tA)"),
                "b": program("b", "call c(x_t)", x_t=f"tool {REFERENCE}"),
                "c": program("c", "x_t.trsf.z=5", x_t=f"tool {REFERENCE}"),
            },
            p1="refuse",
        ),
        cell(
            "pUp=p1",
            "call a()",
            go("p1"),
            others={"a": program("a", "call b()"), "b": program("b", go("pUp", "tB"))},
            p1="refuse",
        ),
    ],
}
ABSENT: dict[str, str] = {
    "routine-in-an-expression": "programs are called by a statement of their own",
    "error-leaves-a-routine": "an error stops the task; no statement handles it",
    "argument-by-name": "arguments have no names",
    "optional-argument": "arguments have no default values",
}
