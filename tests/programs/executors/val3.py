"""VAL3 executed directly: random applications, and an interpreter of their text.

Data keep their values from one start to the next. A task runs between any two statements of the others.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import numpy as np
from tests.programs.executors.running import Event, Files, Language, Motion, Syntax

from truepose._typing import FloatArray
from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, ReadOptions

MOST_STEPS = 120
OPTIONS = [ReadOptions(), ReadOptions(derived=True)]
_VALUE = re.compile(r'<Value key="(\d+)"([^<>]*)/>')
_DATA = re.compile(r'<Data name="(\w+)" [^<>]*?type="(\w+)" size')
_ATTRIBUTE = re.compile(r'(\w+)="([^"]*)"')
_REFERENCE = re.compile(r"([a-zA-Z_]\w*)(?:\[((?:[^\[\]]|\[[^\[\]]*\])*)\])?(\.pPick)?")
_PARAMETER = re.compile(r'<(Parameter|Local) name="(\w+)" type="(\w+)"[^<>]*?(use="reference")?\s*/>')
_AXES = {"x": 0, "y": 1, "z": 2}
_OPENS = {"endIf": "if ", "else": "if ", "endWhile": "while ", "endFor": "for "}

Key = tuple[str, int]


class Placed(NamedTuple):
    """A point, frame or tool: the name of its father, and its transform in that."""

    father: str
    tf: FloatArray


@dataclass
class _Program:
    name: str
    parameters: list[tuple[str, bool]] = field(default_factory=list)
    locals: dict[str, str] = field(default_factory=dict)
    code: list[str] = field(default_factory=list)
    partner: dict[int, list[int]] = field(default_factory=dict)


class _Stop(Exception):  # noqa: N818 - ends a run
    """The program stops by an error, or for long enough."""


def _pose(attributes: str) -> Placed:
    said = dict(_ATTRIBUTE.findall(attributes))
    x, y, z, *angles = (float(said.get(key, "0")) for key in ("x", "y", "z", "rx", "ry", "rz"))
    return Placed(said.get("fatherId", "world[0]")[:-3], make_transform(euler("staubli", np.array(angles)), [x, y, z]))


def _data(text: str) -> dict[Key, Any]:
    """Return the data by name and index; a point of a structure has the name ``stA.pPick``."""
    if not text.endswith("</Database>\n"):
        raise Syntax
    found: dict[Key, Any] = {}
    name, kind, key = "", "", -1
    for line in text.splitlines():
        if m := _DATA.search(line):
            name, kind, key = m[1], m[2], -1
        if m := re.search(r'<Value key="(\d+)"><Field', line):
            key = int(m[1])
        elif m := _VALUE.search(line):
            if kind in ("num", "bool"):
                found[name, int(m[1])] = 0.0
            elif key >= 0:
                found[f"{name}.pPick", key] = _pose(m[2])
            else:
                found[name, int(m[1])] = _pose(m[2])
    return found


def _parsed(text: str) -> _Program:
    head, begin, rest = text.partition("begin\n")
    body, end, _ = rest.partition("end\n]]>")
    named = re.search(r'<Program name="(\w+)">', head)
    if not (begin and end and named):
        raise Syntax
    found, opened = _Program(named[1]), list[int]()
    for tag, name, kind, by_reference in _PARAMETER.findall(head):
        if tag == "Parameter":
            found.parameters.append((name, bool(by_reference)))
        else:
            found.locals[name] = kind
    for k, line in enumerate(body.splitlines()):
        code = line.split("//")[0].strip()
        found.code.append(code)
        if code.startswith(("if ", "while ", "for ")):
            opened.append(k)
            found.partner[k] = [k]
        elif opener := _OPENS.get(code):
            if not opened or not found.code[opened[-1]].startswith(opener):
                raise Syntax
            found.partner[k] = found.partner[opened[-1]]
            found.partner[k].append(k)
            if code != "else":
                opened.pop()
    if opened:
        raise Syntax
    return found


class _Machine:
    def __init__(self, files: Files, seed: int) -> None:
        self._programs = {one.name: one for one in (_parsed(t) for n, t in files.items() if n.endswith(".pgx"))}
        if "start" not in self._programs or "a.dtx" not in files:
            raise Syntax
        self._all = _data(files["a.dtx"])
        self._random = Random(seed)
        self.events: list[Event] = []
        self.stopped = False

    def start(self) -> None:
        """Start the application."""
        self._tasks: list[str] = []
        self._steps, self._depth, self._in_task = 0, 0, False
        try:
            self._run("start", [])
        except _Stop:
            self.events.append(("stop",))
            self.stopped = True

    def _run(self, name: str, arguments: list[tuple[str, Any]]) -> None:
        """Run a program; each argument is the name of the data that it is, and its values by index."""
        if name not in self._programs or self._depth > 5:
            raise _Stop
        program, before = self._programs[name], getattr(self, "_scope", None)
        scope: dict[str, str] = {}
        for k, (parameter, by_reference) in enumerate(program.parameters):
            given, values = arguments[k]
            scope[parameter] = given if by_reference and given else self._own(parameter, values)
        for local, kind in program.locals.items():
            blank = 0.0 if kind == "num" else Placed("world", np.eye(4))
            scope[local] = self._own(local, {("", 0): blank} if kind != "Station" else {(".pPick", 0): blank})
        self._scope, k = scope, 0
        self._depth += 1
        while 0 <= k < len(program.code):
            self._steps += 1
            if self._steps > MOST_STEPS:
                raise _Stop
            if self._tasks and not self._in_task and self._random.random() < 0.3:
                self._in_task = True
                self._run(self._random.choice(self._tasks), [])
                self._in_task = False
            k = self._step(program, k)
        self._depth -= 1
        self._scope = before or {}

    def _own(self, name: str, values: dict[tuple[str, int], Any]) -> str:
        """Make data of a call and return their name."""
        own = f"{name}#{self._depth}"
        for (part, index), value in values.items():
            self._all[own + part, index] = value
        return own

    def _step(self, program: _Program, k: int) -> int:
        """Do one statement; return the next one, a negative number behind the last."""
        code = program.code[k]
        if code == "return":
            return -1
        if k in program.partner:
            return self._block(program, k, code)
        if m := re.fullmatch(r"(?:call|taskCreate \"t\",10,) ?(\w+)\((.*)\)", code):
            if code.startswith("task"):
                self._tasks.append(m[1])
            else:
                self._run(m[1], [self._argument(one) for one in _split(m[2])])
        elif code:
            self._act(code)
        return k + 1

    def _block(self, program: _Program, k: int, code: str) -> int:
        first, *more = program.partner[k]
        if code.startswith("if "):
            return k + 1 if self._holds(code[3:]) else more[0] + 1
        if code == "else":
            return more[-1]
        if code == "endIf":
            return k + 1
        if code.startswith("while ") or code == "endWhile":
            return first + 1 if self._holds(program.code[first][6:]) else more[0] + 1
        m = re.fullmatch(r"for (\w+)=(\d+) to (\d+)", program.code[first])
        assert m is not None
        key = (self._scope.get(m[1], m[1]), 0)
        self._all[key] = float(m[2]) if k == first else self._all[key] + 1.0
        return first + 1 if self._all[key] <= float(m[3]) else more[0] + 1

    def _holds(self, condition: str) -> bool:
        left, sign, right = condition.partition(">")
        return self._number(left) > float(right) if sign else self._random.random() < 0.5

    def _argument(self, text: str) -> tuple[str, Any]:
        m = _REFERENCE.fullmatch(text)
        if m is None or m[2] or m[3]:
            value = self._goal(text) if m or text.startswith("appro(") else self._number(text)
            return "", {("", 0): value}
        name = self._scope.get(m[1], m[1])
        own = {key: value for key, value in self._all.items() if key[0].split(".")[0] == name}
        return name, {(key[0][len(name) :], key[1]): value for key, value in own.items()}

    def _key(self, text: str) -> Key:
        """Return the name and index of a reference."""
        m = _REFERENCE.fullmatch(text.strip())
        if m is None:
            raise Syntax
        index = 0 if m[2] is None else int(self._number(m[2]))
        key = self._scope.get(m[1], m[1]) + (m[3] or ""), index
        if key not in self._all:
            raise _Stop
        return key

    def _number(self, text: str) -> float:
        """Return the value of sums, differences and products."""
        total = 0.0
        for term in re.findall(r"([-+]?(?:[^-+\[\]()]|\[[^\[\]]*(?:\[[^\]]*\])?[^\[\]]*\]|\([^()]*\))+)", text.strip()):
            value = 1.0
            for factor in re.split(r"\*", term.lstrip("+-")):
                value *= self._factor(factor)
            total += -value if term.startswith("-") else value
        return total

    def _factor(self, text: str) -> float:
        if m := re.fullmatch(r"round\((.*)\)", text):
            return float(round(self._number(m[1]) / 400))
        if m := re.fullmatch(r"(.*)\.trsf\.([xyz])", text):
            value = self._all[self._key(m[1])]
            return float(value.tf[_AXES[m[2]], 3])
        if re.fullmatch(r"\d+(?:\.\d+)?", text):
            return float(text)
        value = self._all[self._key(text)]
        if not isinstance(value, float):
            raise Syntax
        return value

    def _goal(self, text: str) -> Placed:
        if m := re.fullmatch(r"appro\((.*),\{(.*)\}\)", text.strip()):
            inner = self._goal(m[1])
            shift = [self._number(one) for one in m[2].split(",")[:3]]
            return inner._replace(tf=inner.tf @ make_transform(euler("staubli", np.zeros(3)), shift))
        value = self._all[self._key(text)]
        if not isinstance(value, Placed):
            raise Syntax
        return value

    def _base(self, value: Placed) -> FloatArray:
        tf = value.tf
        for _ in range(5):
            if value.father in ("world", "flange"):
                return tf
            value = self._all[value.father, 0]
            tf = value.tf @ tf
        raise _Stop

    def _act(self, code: str) -> None:
        """Do a statement that stays in its line."""
        if m := re.fullmatch(r"move([jlc])\((.*)\)", code):
            *goals, tool, _ = _split(m[2])
            for goal in goals:
                point, used = self._base(self._goal(goal)), self._base(self._goal(tool))
                self.events.append(Motion(code, tuple(point[:3, 3].tolist()), tuple(used.round(9).ravel().tolist())))
        elif m := re.fullmatch(r"putln\((.*)\)", code):
            self.events.append(("out", self._number(m[1])))
        elif m := re.fullmatch(r"setFrame\((.*)\)", code):
            a, _, _, frame = _split(m[1])
            key, origin = self._key(frame), self._base(self._goal(a))[:3, 3]
            self._all[key] = Placed("world", make_transform(euler("staubli", np.zeros(3)), origin))
        elif m := re.fullmatch(r"link\((.*),(\w+)\)", code):
            key = self._key(m[1])
            self._all[key] = self._all[key]._replace(father=m[2])
        elif m := re.fullmatch(r"(?:strange|insert)\((.*?)(?:,\d+)?\)", code):
            key = self._key(m[1])
            value = self._all[key]
            self._all[key] = value._replace(tf=_moved(value.tf, 0, 2.0 * value.tf[0, 3] + 1.0))
        elif m := re.fullmatch(r"(.*)\.trsf\.([xyz])=(.*)", code):
            key, number = self._key(m[1]), self._number(m[3])
            self._all[key] = self._all[key]._replace(tf=_moved(self._all[key].tf, _AXES[m[2]], number))
        elif m := re.fullmatch(r"(.*)\.trsf=(.*)\.trsf", code):
            key, other = self._key(m[1]), self._goal(m[2])
            self._all[key] = self._all[key]._replace(tf=other.tf)
        elif m := re.fullmatch(r"([^=()]*(?:\[[^=]*\])?[^=()]*)=(.*)", code):
            self._assign(m[1], m[2])
        else:
            raise Syntax

    def _assign(self, left: str, right: str) -> None:
        name = _REFERENCE.fullmatch(left)
        if name is None:
            raise Syntax
        if name[1].startswith(("st", "l_s", "x_s")) and not name[3]:  # a whole structure
            self._all[self._key(f"{left}.pPick")] = self._goal(f"{right}.pPick")
        elif name[1].startswith("n") or name[1] == "l_n":
            self._all[self._key(left)] = self._number(right)
        else:
            self._all[self._key(left)] = self._goal(right)


def _moved(tf: FloatArray, axis: int, value: float) -> FloatArray:
    new = tf.copy()
    new[axis, 3] = value
    return new


def _split(text: str) -> list[str]:
    """Return arguments."""
    found, depth = [""], 0
    for c in text:
        depth += {"(": 1, "{": 1, "[": 1, ")": -1, "}": -1, "]": -1}.get(c, 0)
        if c == "," and depth == 0:
            found.append("")
        else:
            found[-1] += c
    return [one for one in found if one]


def execute(files: Files, seed: int) -> list[Event]:
    """Return what an application does that is started twice."""
    machine = _Machine(files, seed)
    for _ in range(2):
        if not machine.stopped:
            machine.start()
    return machine.events


_XML = '<?xml version="1.0" encoding="utf-8" ?>\n'
_POINTS = ("p1", "p2", "p3", "pB", "pT[0]", "pT[1]", "pT[2]", "stA.pPick", "stC[1].pPick")
_VARIABLES = ("pUp", "pV", "pW", "pT[3]")
_PROGRAMS = ("start", "side", "deep")


class _Writer:
    """Writes random applications that prefer a few of the constructs."""

    def __init__(self, random: Random) -> None:
        self._random = random
        every = ("copy", "copy", "derive", "derive", "structure", "frame", "tool", "index", "number", "call", "hand")
        self._themes = random.sample((*every, "task", "strange"), random.randrange(1, 5))
        self._few = random.sample(_POINTS, random.randrange(2, 5))
        self._names = _PROGRAMS[: random.choice((1, 2, 2, 3))]

    def write(self) -> Files:
        files = {"a.dtx": self._data()}
        listed = "".join(f'<Program file="{name}.pgx" />\n' for name in (*self._names, "use", "set"))
        project = f'<Programs>\n{listed}</Programs>\n<Database>\n<Data file="a.dtx" />\n</Database>\n<Libraries>'
        files["a.pjx"] = f"{_XML}<Project>\n{project}</Libraries>\n</Project>\n"
        for name in self._names:
            self._locals = "l_p l_q l_s l_n" if self._random.random() < 0.4 else ""
            self._given: tuple[str, ...] = ()
            code = self._some(self._random.randrange(3, 12), 0)
            files[f"{name}.pgx"] = self._program(name, code)
        tool = self._random.choice(("tA", "tB"))
        self._locals = ""
        use = [f"movel(x_p,{tool},mN)"] if self._random.random() < 0.7 else ["pUp=x_p", "if bX", "endIf", "pV=pUp"]
        files["use.pgx"] = self._program("use", use, x_p="value")
        how = self._random.choice(("x_p.trsf.z=5", "x_p[1].trsf.x=nI", "nI=3", "nI=x_p.trsf.z", "strange(x_p)"))
        files["set.pgx"] = self._program("set", [how], x_p="reference")
        return files

    def _program(self, name: str, code: list[str], **parameters: str) -> str:
        rows = "".join(f'<Parameter name="{p}" type="pointRx" use="{how}" />\n' for p, how in parameters.items())
        kinds = {"l_s": "Station", "l_n": "num"}
        rows += "".join(f'<Local name="{n}" type="{kinds.get(n, "pointRx")}" />\n' for n in self._locals.split())
        body = "\n".join(["begin", *code])
        head = f'{_XML}<Programs>\n<Program name="{name}">\n{rows}'
        return f"{head}<Code><![CDATA[\n{body}\nend\n]]></Code>\n</Program></Programs>\n"

    def _data(self) -> str:
        random = self._random

        def pose(father: str) -> str:
            x, y, z = (random.randrange(-200000, 800000) / 1000 for _ in range(3))
            turn = random.choice((0, 0, 30))
            return f'x="{x:.3f}" y="{y:.3f}" z="{z:.3f}" rx="0" ry="{turn}" rz="10" fatherId="{father}[0]"'

        def array(name: str, kind: str, *values: str) -> str:
            rows = "".join(f'<Value key="{k}" {value} />\n' for k, value in enumerate(values))
            return f'<Data name="{name}" access="private" type="{kind}" size="{len(values)}">\n{rows}</Data>\n'

        def structure(name: str, count: int) -> str:
            rows = "".join(
                f'<Value key="{k}"><Field name="pPick" type="pointRx" size="1">\n'
                f'<Value key="0" {pose("fA")} />\n</Field></Value>\n'
                for k in range(count)
            )
            return f'<Data name="{name}" access="private" type="Station" size="{count}">\n{rows}</Data>\n'

        rows = array("fA", "frame", pose("world"), pose("world")) + array("fB", "frame", pose("fA"))
        rows += array("tA", "tool", pose("flange"), pose("flange")) + array("tB", "tool", pose("flange"))
        for name in ("p1", "p2", "p3", "pUp", "pV", "pW"):
            rows += array(name, "pointRx", pose(random.choice(("fA", "fA", "world"))))
        rows += array("pB", "pointRx", pose("fB")) + array("pT", "pointRx", *(pose("fA") for _ in range(4)))
        rows += structure("stA", 1) + structure("stC", 3)
        rows += array("nI", "num", 'value="0"') + array("nMap", "num", *('value="0"',) * 3)
        return f"{_XML}<Database>\n<Datas>\n{rows}</Datas>\n</Database>\n"

    def _some(self, count: int, depth: int) -> list[str]:
        return [line for _ in range(count) for line in self._statement(depth)]

    def _statement(self, depth: int) -> list[str]:
        random = self._random
        if random.random() < 0.4:
            return [self._motion()]
        if random.random() < 0.2 and depth < 2:
            return self._block(depth)
        return getattr(self, f"_{random.choice(self._themes)}")()  # type: ignore[no-any-return]

    def _block(self, depth: int) -> list[str]:
        random = self._random
        body = self._some(random.randrange(0, 3), depth + 1)
        match random.randrange(4):
            case 0:
                return [f"if {self._condition()}", *body, "endIf"]
            case 1:
                return [f"if {self._condition()}", *body, "else", *self._some(1, depth + 1), "endIf"]
            case 2:
                return ["while bX", *body, "endWhile"]
        return [f"for nI=0 to {random.randrange(3)}", *body, "endFor"]

    def _condition(self) -> str:
        if "number" in self._themes and self._random.random() < 0.3:
            return self._random.choice((f"{self._point()}.trsf.z>200", "nI>1"))
        return "bX"

    def _point(self) -> str:
        return self._random.choice(self._few)

    def _variable(self) -> str:
        names = _VARIABLES if not self._locals else (*_VARIABLES, "l_p", "l_q", "l_p", "l_q")
        return self._random.choice(names)

    def _motion(self) -> str:
        random, tool = self._random, self._random.choice(("tA", "tA", "tA", "tA", "tB"))
        if random.random() < 0.1:
            return f"movec({self._point()},{self._point()},{tool},mN)"
        goal = self._point()
        if self._themes and random.random() < 0.25:
            goal = random.choice((self._variable(), self._variable(), "pT[nI]", "pT[nMap[nI]]", "pT[round(p1.trsf.x)]"))
        if "derive" in self._themes and random.random() < 0.3:
            goal = f"appro({goal},{{0,0,{random.choice(('50', '20', 'nI'))},0,0,0}})".replace("50", "-50")
        return f"{random.choice(('movel', 'movel', 'movej'))}({goal},{tool},mN)"

    def _copy(self) -> list[str]:
        random, a = self._random, self._variable()
        right = random.choice((self._point(), self._point(), self._variable(), self._variable()))
        some = [f"{a}={right}"] * 5
        some += [f"pT[nI]={self._point()}", f"pT[nMap[nI]]={self._point()}", f"{self._point()}={right}"]
        copy = random.choice(some)
        return [copy, *(["if bX", "endIf"] if random.random() < 0.3 else [])]

    def _derive(self) -> list[str]:
        random, a = self._random, self._variable()
        b = random.choice((self._point(), self._variable()))
        some = [
            [f"{a}=appro({b},{{0,0,-80,0,0,0}})"],
            [f"{a}={b}", f"{a}.trsf.z={a}.trsf.z+50"],
            [f"{a}.trsf.x={a}.trsf.x-20"],
            [f"{a}.trsf.z={b}.trsf.z"],
            [f"{a}.trsf={b}.trsf"],
            [f"{a}.trsf.z={a}.trsf.z*2"],
        ]
        return random.choice(some)

    def _structure(self) -> list[str]:
        some = ["stC[1]=stA", "stC[2]=stC[1]", "stA=stC[2]", "stC[nI]=stA", f"stA.pPick={self._point()}"]
        some += ["stC[1].pPick=stC[2].pPick", "movel(stC[2].pPick,tA,mN)", "movel(stA.pPick,tB,mN)"]
        if self._locals:
            some += ["l_s=stA", "l_s=stC[1]", "movel(l_s.pPick,tB,mN)", "l_s.pPick=p1"]
        return [self._random.choice(some)]

    def _frame(self) -> list[str]:
        some = ["fB.trsf.z=nI", "fA[1].trsf.x=5", "fA[nI].trsf.z=7", "fA[nMap[nI]].trsf.z=7", "link(fB,world)"]
        some += [f"fB.trsf.x={self._point()}.trsf.x", "setFrame(p1,p2,p3,fB)", "insert(fA,0)", "link(p1,fB)"]
        some += ["fA[round(nI)].trsf.z=9"]
        return [self._random.choice(some)]

    def _tool(self) -> list[str]:
        return [self._random.choice(("tA.trsf.z=150", "tB.trsf.x=nI", "tA[1].trsf.z=3", "tA[nI].trsf.z=9", "tB=tA"))]

    def _index(self) -> list[str]:
        some = [f"nI=nMap[round({self._point()}.trsf.x)]", "nMap[1]=2", "nI=1", "movel(pT[nI],tA,mN)"]
        some += [f"nMap[round({self._point()}.trsf.y)]=1", f"movel(pT[round({self._point()}.trsf.z)],tA,mN)"]
        return [self._random.choice(some)]

    def _number(self) -> list[str]:
        some = [f"nI={self._point()}.trsf.z", f"putln({self._variable()}.trsf.z)", f"putln({self._point()}.trsf.x+nI)"]
        some += ["putln(nI)", "nI=nI+1", f"{self._variable()}.trsf.z=nI", f"nI={self._variable()}.trsf.z*2"]
        some += ["l_n=p1.trsf.z"] if self._locals else []
        return [self._random.choice(some)]

    def _call(self) -> list[str]:
        return [f"call {self._random.choice(self._names)}()"]

    def _hand(self) -> list[str]:
        random = self._random
        some = [f"call use({self._point()})", f"call use({self._variable()})"]
        some += [f"call use(appro({self._point()},{{0,0,-30,0,0,0}}))"]
        some += [f"call set({random.choice(('p1', 'pT', 'pUp', 'fA', 'fB', 'tA', 'tB', 'p2'))})"]
        return [random.choice(some)]

    def _task(self) -> list[str]:
        return [f'taskCreate "t",10,{self._random.choice(self._names)}()']

    def _strange(self) -> list[str]:
        return [f"strange({self._random.choice((self._point(), 'fA', 'fB', 'tA', 'tB', 'pUp'))})"]


def write(random: Random) -> Files:
    """Return a random application."""
    return _Writer(random).write()


def _tool_of(tool: object) -> FloatArray | None:
    return np.array(tool).reshape(4, 4)


VAL3 = Language(write, execute, FrameTable(), OPTIONS, _tool_of)
