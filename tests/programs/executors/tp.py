"""FANUC TP executed directly: random programs that call each other, and an interpreter of their text.

Registers keep their values from one start to the next. A program that is not there, and a macro, may write any register
and choose any frame, and may use what it finds in a register.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from random import Random
from typing import NamedTuple

import numpy as np
from tests.programs.executors.running import Event, Files, Language, Motion, Syntax

from truepose._typing import FloatArray
from truepose.geometry import euler, make_transform
from truepose.programs import FrameTable, ReadOptions

MOST_STEPS = 150
TOOLS = {n: make_transform(euler("fanuc", np.array([0.0, 0.0, 20.0 * n])), [5.0 * n, 0.0, 100.0]) for n in (1, 2)}
BASES = {
    0: np.eye(4),
    1: make_transform(euler("fanuc", np.array([0.0, 0.0, 90.0])), [800.0, -200.0, 300.0]),
    2: make_transform(euler("fanuc", np.array([10.0, -20.0, 30.0])), [700.0, 300.0, 200.0]),
}
OPTIONS = [ReadOptions(), ReadOptions(whole_task=True), ReadOptions(whole_task=True, derived=True)]
_PROGRAMS = ("MAIN", "SIDE", "DEEP")
_REGISTER = re.compile(r"(P?R)\[(\d+)(?:,(\d))?\]")
_ANGLES = (180.0, 0.0, 0.0)
_INSTRUCTION = re.compile(r" *\d+:(.*) ;")
_POSITION = re.compile(r"P\[(\d+)\]\{\n   GP1:\n\tUF : (\w), UT : (\w),.*\n\tX =(.*) mm,\tY =(.*) mm,\tZ =(.*) mm,")


class _Taught(NamedTuple):
    frame: str
    tool: str
    xyz: tuple[float, ...]


@dataclass
class _Program:
    name: str
    code: list[str] = field(default_factory=list)
    positions: dict[int, _Taught] = field(default_factory=dict)
    partner: dict[int, list[int]] = field(default_factory=dict)
    labels: dict[str, int] = field(default_factory=dict)


class _Stop(Exception):  # noqa: N818 - ends a run
    """The robot stops."""


def _parsed(text: str) -> _Program:
    head, _, rest = text.partition("/MN\n")
    body, _, positions = rest.partition("/POS\n")
    if not head.startswith("/PROG  ") or "/END\n" not in positions:
        raise Syntax
    found, opened = _Program(head.split()[1]), list[int]()
    for k, line in enumerate(body.splitlines()):
        if (m := _INSTRUCTION.fullmatch(line)) is None:
            raise Syntax
        code = m[1].strip()
        found.code.append(code)
        if label := re.fullmatch(r"LBL\[(\d+)\]", code):
            found.labels[label[1]] = k
        elif code.endswith(" THEN") or code.startswith("FOR "):
            opened.append(k)
            found.partner[k] = [k]
        elif code in ("ELSE", "ENDIF", "ENDFOR"):
            if not opened or found.code[opened[-1]].startswith("FOR ") != (code == "ENDFOR"):
                raise Syntax
            found.partner[k] = found.partner[opened[-1]]
            found.partner[k].append(k)
            if code != "ELSE":
                opened.pop()
    if opened:
        raise Syntax
    for m in _POSITION.finditer(positions):
        found.positions[int(m[1])] = _Taught(m[2], m[3], tuple(map(float, m.groups()[3:])))
    return found


def _decides(code: str) -> bool:
    """Return whether the values of registers, or a loop that never turns, decide on the way; else chance does."""
    if m := re.fullmatch(r"FOR R\[\d\]=(\d+) (DOWN)?TO (.*)", code):
        return not m[3].isdigit() or (int(m[1]) < int(m[3]) if m[2] else int(m[1]) > int(m[3]))
    return code.startswith("IF ") and "R[" in code.partition(",")[0]


class _Machine:
    def __init__(self, files: Files, seed: int) -> None:
        self._programs = {one.name: one for one in map(_parsed, files.values())}
        self._by_chance = not any(map(_decides, (code for one in self._programs.values() for code in one.code)))
        self._random = Random(seed)
        self.events: list[Event] = []
        self._r: dict[int, float] = {}
        self._pr: dict[int, list[float]] = {n: [10.0 * n, 5.0, 50.0, 0.0, 0.0, 0.0] for n in range(1, 6)}
        self._own = {name: dict(one.positions) for name, one in self._programs.items()}
        self._bases = dict(BASES)
        self._frame = self._tool = 1
        self.stopped = False

    def start(self) -> None:
        """Start a program, as an operator may do with any."""
        self._frame, self._tool = self._random.choice((1, 2)), self._random.choice((1, 2))
        self._lost: set[str] = set()
        self._steps, self._watched = 0, ""
        try:
            self._run(self._random.choice(sorted(self._programs)), 0)
        except _Stop:
            self.events.append(("stop",))
            self.stopped = True

    def _unknown(self, by: str) -> None:
        """Do what a program may do that is not there; with registers, if it runs for the one that uses registers."""
        random = self._random
        if random.random() < 0.5:
            self._frame, self._tool = random.choice((1, 2)), random.choice((1, 2))
        if by != next(iter(self._programs)):
            return
        self.events.append(("registers", str(sorted(self._r.items())), str(self._pr)))
        if random.random() < 0.5:
            self._pr[random.randrange(1, 6)][random.randrange(3)] = random.randrange(100)
            self._r[random.randrange(1, 5)] = random.randrange(1, 4)

    def _run(self, name: str, depth: int, by: str = "") -> None:
        if name not in self._programs:
            self._unknown(by)
            return
        if depth > 6:
            raise _Stop
        program, k = self._programs[name], 0
        while k < len(program.code):
            self._steps += 1
            if self._steps > MOST_STEPS:
                raise _Stop
            if self._watched and self._random.random() < 0.3:
                self._unknown(self._watched)
            found = self._step(program, k, depth)
            if found is None:
                return
            k = found

    def _step(self, program: _Program, k: int, depth: int) -> int | None:
        """Do one instruction; return the next one, None behind the last."""
        code = program.code[k]
        if code == "END":
            return None
        if k in program.partner:
            return self._block(program, k, code)
        if m := re.fullmatch(r"(?:IF|SELECT) (.*?),((?:JMP|CALL|U).*)", code):
            if not self._holds(m[1]):
                return k + 1
            code = m[2]
        if code.startswith("JMP LBL["):
            if code[8:-1] not in program.labels:
                raise Syntax
            return program.labels[code[8:-1]]
        self._act(program, code, depth)
        return k + 1

    def _block(self, program: _Program, k: int, code: str) -> int:
        first, *more = program.partner[k]
        if code.endswith(" THEN"):
            return k + 1 if self._holds(code[3:-5]) else more[0] + 1
        if code == "ELSE":
            return more[-1]
        if code == "ENDIF":
            return k + 1
        m = re.fullmatch(r"FOR R\[(\d+)\]=(.*) (DOWN)?TO (.*)", program.code[first])
        assert m is not None
        n, step = int(m[1]), -1 if m[3] else 1
        self._r[n] = self._number(m[2]) if k == first else self._r.get(n, 0.0) + step
        inside = (self._number(m[4]) - self._r[n]) * step >= 0
        return first + 1 if inside else more[0] + 1

    def _holds(self, condition: str) -> bool:
        if m := re.fullmatch(r"\(?(P?R\[.*\])(>|=)(\d+)\)?", condition):
            value = self._number(m[1])
            return value > float(m[3]) if m[2] == ">" else value == float(m[3])
        return self._random.random() < 0.5

    def _number(self, text: str) -> float:
        def value(m: re.Match[str]) -> str:
            if m[1] == "R":
                return repr(self._r.get(int(m[2]), 0.0))
            return repr(self._pr[int(m[2])][int(m[3]) - 1])

        found = eval(_REGISTER.sub(value, text))
        return float(found)

    def _act(self, program: _Program, code: str, depth: int) -> None:
        """Do an instruction that stays in its line."""
        if m := re.match(r"(?:L|J) (P|PR)\[(.*?\]?)\] ", code):
            self._motion(program, m, code)
            for called in re.findall(r",CALL (\w+)", code):
                self._run(called, depth + 1, program.name)
        elif m := re.fullmatch(r"(?:CALL|RUN) (\w+)(?:\((.*)\))?", code):
            if m[2]:
                self.events.append(("argument", self._number(m[2])))
            self._run(m[1], depth + 1, program.name)
        elif m := re.fullmatch(r"U(FRAME|TOOL)_NUM=(.*)", code):
            number = int(self._number(m[2])) if m[2] != "AR[1]" else self._random.choice((1, 2))
            self._frame, self._tool = (number, self._tool) if m[1] == "FRAME" else (self._frame, number)
        elif m := re.fullmatch(r"UFRAME\[(\d)\]=PR\[(\d)\]", code):
            values = self._pr[int(m[2])]
            self._bases[int(m[1])] = make_transform(euler("fanuc", np.array(values[3:])), values[:3])
        elif m := re.fullmatch(r"R\[(\d)\]=(.*)", code):
            self._r[int(m[1])] = self._number(m[2])
        elif m := re.fullmatch(r"PR\[(\d),(\d)\]=(.*)", code):
            self._pr[int(m[1])][int(m[2]) - 1] = self._number(m[3])
        elif m := re.fullmatch(r"PR\[(.*?\]?)\]=(.*)", code):
            self._pr[self._index(m[1])] = self._sum(program, m[2])
        elif m := re.fullmatch(r"P\[(\d)\]=PR\[(\d)\]", code):
            own = self._own[program.name]
            own[int(m[1])] = own.get(int(m[1]), _Taught("1", "1", ()))._replace(xyz=tuple(self._pr[int(m[2])][:3]))
        elif m := re.fullmatch(r"AO\[1\]=(.*)", code):
            self.events.append(("out", self._number(m[1])))
        elif code.startswith(("Track ", "SOFTFLOAT")):
            (self._lost.discard if "End" in code or "END" in code else self._lost.add)(code.split()[0][:5])
        elif code.startswith("MONITOR"):
            self._watched = "" if "END" in code else program.name
        elif code and not code.startswith(("!", "LBL", "DO[")):  # a macro
            self._unknown(program.name)

    def _index(self, text: str) -> int:
        number = int(self._number(text))
        if not 0 < number < 6:
            raise _Stop
        return number

    def _sum(self, program: _Program, text: str) -> list[float]:
        total = np.zeros(6)
        if text == "LPOS-LPOS":
            return total.tolist()
        for m in re.finditer(r"([-+]?)(PR?)\[(.*?\]?)\](?=[-+]|$)", text):
            n = self._index(m[3])
            own = self._own[program.name]
            if m[2] == "P" and n not in own:
                raise _Stop
            value = [*own[n].xyz, *_ANGLES] if m[2] == "P" else self._pr[n]
            total += np.array(value) * (-1.0 if m[1] == "-" else 1.0)
        return total.tolist()

    def _motion(self, program: _Program, m: re.Match[str], code: str) -> None:
        n, frame, tool = self._index(m[2]), self._frame, self._tool
        name = f"{program.name}.LS P[{n}]"
        if m[1] == "P":
            if n not in self._own[program.name]:
                raise _Stop
            taught = self._own[program.name][n]
            if taught.frame not in ("F", str(frame)) or taught.tool not in ("F", str(tool)):
                self.events.append(("mismatch", name if self._by_chance else ""))
                if self._random.random() < 0.5:
                    raise _Stop
                return  # the operator goes on behind it
            values = [*taught.xyz, *_ANGLES]
        else:
            values = self._pr[n]
        turn = euler("fanuc", np.array(values[3:])).as_matrix()
        point = np.array(values[:3])
        if by := re.search(r" (Tool_)?Offset,PR\[(\d)\]", code):
            shift = np.array(self._pr[int(by[2])][:3])
            point = point + (turn @ shift if by[1] else shift)
        if speed := re.search(r"(R\[\d\])mm/sec", code):
            self.events.append(("speed", self._number(speed[1])))
        goal = self._bases[frame][:3, :3] @ point + self._bases[frame][:3, 3]
        label = f"{name}: {code}" if m[1] == "P" else code
        self.events.append(Motion(label, tuple(goal.tolist()), tool, frozenset(self._lost)))


def execute(files: Files, seed: int) -> list[Event]:
    """Return what programs do that are started one after the other."""
    machine = _Machine(files, seed)
    for _ in range(3):
        if not machine.stopped:  # a program that is cut off leaves registers as no end of one does
            machine.start()
    return machine.events


class _Writer:
    """Writes random programs that prefer a few of the constructs; registers are used by the first alone."""

    def __init__(self, random: Random) -> None:
        self._random = random
        every = ("copy", "copy", "number", "number", "call", "jump", "frame", "frame", "reset", "sensor", "strange")
        self._themes = random.sample(every, random.randrange(1, 5))
        self._programs = _PROGRAMS[: random.choice((1, 1, 2, 3))]
        self._label = 0

    def write(self) -> Files:
        return {f"{name}.LS": self._program(name) for name in self._programs}

    def _program(self, name: str) -> str:
        random = self._random
        self._registers = name == self._programs[0]
        self._count = random.randrange(2, 5)
        self._ends: list[str] = []
        code = self._some(random.randrange(4, 13), 0)
        for label in self._ends:
            code.insert(random.randrange(len(code) + 1), label)
        code = [*(["UFRAME_NUM=1", "UTOOL_NUM=1"] if random.random() < 0.8 else []), *code]
        lines = "".join(f"{k:>4}:  {line} ;\n" for k, line in enumerate(code, 1))
        taught = random.choice((("1", "1"), ("1", "1"), ("1", "1"), ("F", "F"), ("1", "F"), ("F", "1")))
        positions = "".join(
            f"P[{k}]{{\n   GP1:\n\tUF : {taught[0]}, UT : {taught[1]},\t\tCONFIG : 'N U T, 0, 0, 0',\n"
            + "\tX = {:.3f} mm,\tY = {:.3f} mm,\tZ = {:.3f} mm,\n".format(
                *(random.randrange(-200000, 800000) / 1000 for _ in range(3))
            )
            + "\tW = 180.000 deg,\tP = .000 deg,\tR = .000 deg\n};\n"
            for k in range(1, self._count + 1)
        )
        return f"/PROG  {name}\n/ATTR\nDEFAULT_GROUP\t= 1,*,*,*,*;\n/MN\n{lines}/POS\n{positions}/END\n"

    def _some(self, count: int, depth: int) -> list[str]:
        return [line for _ in range(count) for line in self._statement(depth)]

    def _statement(self, depth: int) -> list[str]:
        random = self._random
        if random.random() < 0.45:
            return [self._motion()]
        if random.random() < 0.25 and depth < 2:
            return self._block(depth)
        theme = random.choice(self._themes)
        if theme in ("copy", "number", "reset") and not self._registers:
            return [self._motion()]
        return getattr(self, f"_{theme}")()  # type: ignore[no-any-return]

    def _motion(self) -> str:
        random = self._random
        speed, goal, tail = "100mm/sec", f"P[{random.randrange(1, self._count + 1)}]", ""
        if self._registers and random.random() < 0.25:
            goal = random.choice(("P[R[1]]", "PR[1]", "PR[2]", "PR[1]", "PR[3]"))
        if self._registers and random.random() < 0.1:
            tail = random.choice((" Offset,PR[4]", " Tool_Offset,PR[4]", " Offset,PR[2]"))
        if random.random() < 0.05:
            tail += f" TB .5sec,CALL {random.choice((*self._programs, 'ELSEWHERE'))}"
        if self._registers and random.random() < 0.05:
            speed = "R[1]mm/sec"
        return f"{random.choice('LLJ')} {goal} {speed} FINE{tail}"

    def _condition(self) -> str:
        random = self._random
        if self._registers and "number" in self._themes and random.random() < 0.4:
            return random.choice(("R[1]>400", "R[2]>2", "PR[1,3]>300", "R[1]=1"))
        return random.choice(("DI[1]=ON", "DI[2]=ON"))

    def _block(self, depth: int) -> list[str]:
        random = self._random
        body = self._some(random.randrange(1, 4), depth + 1)
        n = 3 + depth
        match random.randrange(4):
            case 0:
                return [f"IF ({self._condition()}) THEN", *body, "ENDIF"]
            case 1:
                return [f"IF ({self._condition()}) THEN", *body, "ELSE", *self._some(1, depth + 1), "ENDIF"]
            case 2:
                return [f"FOR R[{n}]={random.randrange(3)} TO {random.randrange(3)}", *body, "ENDFOR"]
        return [f"FOR R[{n}]=2 DOWNTO {random.choice(('1', '2', 'R[2]'))}", *body, "ENDFOR"]

    def _copy(self) -> list[str]:
        random, a, b = self._random, self._random.randrange(1, 4), self._random.randrange(1, 4)
        p = f"P[{random.randrange(1, self._count + 1)}]"
        some = [
            *(f"PR[{a}]={p}",) * 4,
            *(f"PR[{a}]=PR[{b}]", f"PR[{a}]=PR[{a}]+PR[4]", f"PR[{a}]={p}-PR[4]", "PR[R[1]]=P[1]"),
            *(f"PR[{a}]=P[R[1]]", f"P[1]=PR[{a}]", f"PR[{a},3]=PR[{a},3]+50", f"PR[{a},1]=PR[{b},1]-20"),
            "PR[4]=LPOS-LPOS",
        ]
        return [random.choice(some)]

    def _number(self) -> list[str]:
        random, a = self._random, self._random.randrange(1, 4)
        some = [
            *(f"R[1]=PR[{a},3]", f"R[2]=PR[{a},1]*2", f"R[1]={random.randrange(1, 4)}", "R[2]=R[1]+1", "AO[1]=R[1]"),
            *(f"PR[{a},3]=R[1]", f"PR[{a},2]=PR[{a},2]*2", "PR[4,3]=R[1]", f"PR[4,1]=PR[{a},1]", "PR[4,3]=PR[4,3]+5"),
            *("CALL ELSEWHERE(R[1])", f"AO[1]=PR[{a},2]"),
        ]
        return [random.choice(some)]

    def _call(self) -> list[str]:
        name = self._random.choice((*self._programs, *self._programs, "ELSEWHERE"))
        return [self._random.choice((f"CALL {name}", f"CALL {name}", f"IF {self._condition()},CALL {name}"))]

    def _jump(self) -> list[str]:
        self._label += 1
        self._ends.append(f"LBL[{self._label}]")
        end = self._random.choice((f"IF {self._condition()},",) * 3 + ("",))
        return [f"{end}JMP LBL[{self._label}]"] if self._random.random() < 0.95 else ["END"]

    def _frame(self) -> list[str]:
        n = self._random.choice((1, 1, 2, 2, "AR[1]"))
        end = self._random.choice(("", "", "", "IF (DI[1]),"))
        return [end + self._random.choice((f"UFRAME_NUM={n}", f"UTOOL_NUM={n}"))]

    def _reset(self) -> list[str]:
        return [f"UFRAME[{self._random.choice((1, 2, 2))}]=PR[{self._random.randrange(1, 5)}]"]

    def _sensor(self) -> list[str]:
        return [self._random.choice(("Track TAST[1]", "Track End", "SOFTFLOAT[1]", "SOFTFLOAT END"))]

    def _strange(self) -> list[str]:
        return [self._random.choice(("GRIP OPEN", "HOME_ALL", "MONITOR WATCH", "MONITOR END WATCH"))]


def write(random: Random) -> Files:
    """Return random programs."""
    return _Writer(random).write()


def _tool_of(tool: object) -> FloatArray | None:
    return TOOLS[tool] if isinstance(tool, int) else None


TP = Language(write, execute, FrameTable(tools=TOOLS, bases=BASES), OPTIONS, _tool_of)
