"""INFORM executed directly: random jobs that call each other, and an interpreter of their text.

P variables and user frames keep their values from one start of a job to the next; shifts do not.
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

MOST_STEPS = 200
TOOLS = {n: make_transform(euler("yaskawa", np.array([0.0, 0.0, 20.0 * n])), [5.0 * n, 0.0, 100.0]) for n in (1, 2)}
BASES = {
    0: np.eye(4),
    1: make_transform(euler("yaskawa", np.array([0.0, 0.0, 90.0])), [800.0, -200.0, 300.0]),
    2: make_transform(euler("yaskawa", np.array([10.0, -20.0, 30.0])), [700.0, 300.0, 200.0]),
}
OPTIONS = [ReadOptions(), ReadOptions(whole_task=True), ReadOptions(whole_task=True, derived=True)]
_JOBS = ("MAIN", "SIDE", "DEEP")
_P = (1, 2, 3, 10)
_ALONG_TOOL = np.diag([1.0, -1.0, -1.0])  # of positions with the angles 180, 0, 0


class Place(NamedTuple):
    """A position: the number of its frame, its tool and its coordinates [mm]."""

    frame: int
    tool: int
    xyz: tuple[float, ...]


@dataclass
class _Job:
    positions: dict[str, Place] = field(default_factory=dict)
    code: list[str] = field(default_factory=list)
    blocks: dict[int, list[int]] = field(default_factory=dict)
    labels: dict[str, int] = field(default_factory=dict)

    @property
    def steps(self) -> list[str]:
        """The positions of the motions in the order of the text."""
        return [m[1] for line in self.code if (m := re.match(r"MOV[JL] (C\d+|P\d+)", line))]


class _Stop(Exception):  # noqa: N818 - ends a run
    """The robot stops."""


def _parsed(text: str) -> tuple[str, _Job]:
    job, name, inside, frame, tool = _Job(), "", "", 0, 1
    open_blocks: list[int] = []
    for line in text.splitlines():
        if line.startswith("//") and not line.startswith("///"):
            inside = line[2:].split()[0]
            name = line.split()[1] if inside == "NAME" else name
        elif inside == "POS":
            if m := re.fullmatch(r"///(\w+) ?(.*)", line):
                frame = {"BASE": 0}.get(m[2], frame) if m[1] == "POSTYPE" else int(m[2]) if m[1] == "USER" else frame
                tool = int(m[2]) if m[1] == "TOOL" else tool
            elif m := re.fullmatch(r"([CP])0*(\d+)=(.*)", line):
                job.positions[f"{m[1]}{int(m[2])}"] = Place(frame, tool, tuple(map(float, m[3].split(",")[:3])))
        elif inside == "INST" and not line.startswith("///") and line not in ("NOP", "END"):
            code = "" if line.startswith(("'", "COMM ")) else re.sub(r"\b(C|P)X?0*(\d)", r"\1\2", line)
            k, word = len(job.code), (code.split() or [""])[0]
            job.code.append(code)
            if word.startswith("*"):
                job.labels[word] = k
            elif word in ("IFTHENEXP", "WHILEEXP", "FOR"):
                open_blocks.append(k)
                job.blocks[k] = [k]
            elif word in ("ELSE", "ENDIF", "ENDWHILE", "NEXT"):
                opener = {"ELSE": "IF", "ENDIF": "IF", "ENDWHILE": "WHILE", "NEXT": "FOR"}[word]
                if not open_blocks or not job.code[open_blocks[-1]].startswith(opener):
                    raise Syntax
                parts = job.blocks[open_blocks[-1]]
                parts.append(k)
                job.blocks[k] = parts
                if word != "ELSE":
                    open_blocks.pop()
    if open_blocks or not text.endswith("END\n") or not name:
        raise Syntax
    return name, job


class _Machine:
    def __init__(self, files: Files, seed: int) -> None:
        self._jobs = dict(map(_parsed, files.values()))
        self._random = Random(seed)
        self.events: list[Event] = []
        self._p: dict[int, Place] = {n: Place(0, 1, (10.0 * n, 5.0, 40.0)) for n in _P}
        for job in self._jobs.values():
            self._p |= {int(key[1:]): place for key, place in job.positions.items() if key[0] == "P"}
        self._numbers: dict[str, int] = {}
        self._bases = dict(BASES)
        self._shift: FloatArray = np.zeros(3)
        self._along_tool = np.zeros(3)
        self._lost: frozenset[str] = frozenset()
        self._steps = 0

    def start(self) -> None:
        """Start a job, as an operator may do with any."""
        self._shift, self._along_tool, self._lost, self._steps = np.zeros(3), np.zeros(3), frozenset(), 0
        try:
            self._run(self._random.choice(sorted(self._jobs)), 0)
        except _Stop:
            self.events.append(("stop",))

    def _run(self, name: str, depth: int) -> None:
        if name not in self._jobs or depth > 6:
            raise _Stop
        job, k = self._jobs[name], 0
        while k < len(job.code):
            self._steps += 1
            if self._steps > MOST_STEPS:
                raise _Stop
            found = self._step(job, k, depth)
            if found is None:
                return
            k = found

    def _step(self, job: _Job, k: int, depth: int) -> int | None:
        """Do one instruction; return the next one, None behind the last."""
        code = job.code[k]
        code, _, condition = code.partition(" IF ")
        word, *rest = code.split() or [""]
        go = not condition or self._holds(condition)
        if word == "JUMP" and go and rest[0].startswith("*"):
            if rest[0] not in job.labels:
                raise Syntax
            return job.labels[rest[0]]
        if word in ("JUMP", "CALL") and go:
            self._run(rest[0].removeprefix("JOB:"), depth + 1)
            return None if word == "JUMP" else k + 1
        if word == "RET":
            return None if go else k + 1
        if word in ("IFTHENEXP", "ELSE", "WHILEEXP", "ENDWHILE", "FOR", "NEXT"):
            return self._block(job, k, word, rest)
        self._act(job, word, rest)
        return k + 1

    def _block(self, job: _Job, k: int, word: str, rest: list[str]) -> int:
        first, *more = job.blocks[k]
        if word == "IFTHENEXP":
            return k + 1 if self._holds(rest[0]) else more[0] + 1
        if word == "ELSE":
            return more[-1]
        if word == "ENDWHILE":
            return first
        if word == "WHILEEXP":
            return k + 1 if self._holds(rest[0]) else more[0] + 1
        if word == "NEXT":
            variable = job.code[first].split()[1].split("=")[0]
            self._numbers[variable] = self._numbers.get(variable, 0) + 1
            return first + 1 if self._numbers[variable] <= int(job.code[first].split()[-1]) else k + 1
        variable, start = rest[0].split("=")
        self._numbers[variable] = int(start)
        return k + 1 if int(start) <= int(rest[-1]) else more[0] + 1

    def _holds(self, condition: str) -> bool:
        if m := re.fullmatch(r"([DI]\d+)>(\d+)", condition):
            return self._numbers.get(m[1], 0) > int(m[2])
        return self._random.random() < 0.5

    def _value(self, text: str) -> int:
        return self._numbers.get(text, 0) if text[0] in "DI" else int(text)

    def _p_number(self, text: str) -> int:
        if m := re.fullmatch(r"P\[(I\d+)\]", text):
            return self._numbers.get(m[1], 0)
        return int(text[1:])

    def _act(self, job: _Job, word: str, rest: list[str]) -> None:
        """Do an instruction that stays in its line."""
        match word:
            case "MOVL" | "MOVJ":
                name = rest[0]
                place = self._p.get(self._p_number(name)) if name[0] == "P" else job.positions.get(name)
                if place is None:
                    raise _Stop
                self._move(" ".join([word, *rest]), place)
            case "SFTON":
                self._shift_by(self._p.get(int(rest[0][1:]), Place(0, 1, (0.0, 0.0, 0.0))), (rest[1:] or [""])[0])
            case "SFTOF":
                self._shift, self._along_tool = np.zeros(3), np.zeros(3)
            case "SYSTART" | "SYEND":
                self._lost = frozenset(["conveyor"]) if word == "SYSTART" else frozenset()
            case "MFRAME":
                places = [self._place(job, one) for one in rest[1:2]]
                self._bases[int(rest[0][4])] = make_transform(euler("yaskawa", np.zeros(3)), self._in_base(places[0]))
            case "GETPOS":
                steps, k = job.steps, int(rest[1][6:-1])
                if 0 < k <= len(steps):
                    self._p[int(rest[0][1:])] = self._place(job, steps[k - 1])
            case "GETE":
                place = self._p.get(int(rest[1][1:]), Place(0, 1, (0.0, 0.0, 0.0)))
                self._numbers[rest[0]] = round(place.xyz[int(rest[2][1]) - 1] * 1000)
            case "SETE":
                n, axis = int(rest[0][1:]), int(rest[1][1]) - 1
                if n in self._p:
                    xyz = list(self._p[n].xyz)
                    xyz[axis] = self._value(rest[2]) / 1000
                    self._p[n] = self._p[n]._replace(xyz=tuple(xyz))
            case "CNVRT":
                place = self._p.get(int(rest[1][1:]), Place(0, 1, (0.0, 0.0, 0.0)))
                self._p[int(rest[0][1:])] = Place(0, place.tool, tuple(self._in_base(place)))
            case "SET" | "ADD" | "SUB" if rest[0][0] == "P":
                self._p_changed(word, *rest)
            case "SET" | "ADD" | "SUB":
                old, more = self._numbers.get(rest[0], 0), self._value(rest[1])
                self._numbers[rest[0]] = more if word == "SET" else old + more if word == "ADD" else old - more
            case "STRANGE":  # an instruction that nobody knows
                n = int(rest[0][1:])
                if n in self._p:
                    x, y, z = self._p[n].xyz
                    self._p[n] = self._p[n]._replace(xyz=(2.0 * x, y, z))
            case "DOUT":
                self.events.append(("out", self._value(rest[1])))

    def _place(self, job: _Job, name: str) -> Place:
        place = self._p.get(int(name[1:])) if name[0] == "P" else job.positions.get(name)
        if place is None:
            raise _Stop
        return place

    def _p_changed(self, word: str, left: str, right: str) -> None:
        n, by = self._p_number(left), self._p.get(int(right[1:]))
        if by is None or (word != "SET" and n not in self._p):
            return
        if word == "SET":
            self._p[n] = by
        else:
            sign = 1.0 if word == "ADD" else -1.0
            xyz = tuple([a + sign * b for a, b in zip(self._p[n].xyz, by.xyz, strict=True)])
            self._p[n] = self._p[n]._replace(xyz=xyz)

    def _in_base(self, place: Place) -> FloatArray:
        frame = self._bases[place.frame]
        found: FloatArray = frame[:3, :3] @ np.array(place.xyz) + frame[:3, 3]
        return found

    def _shift_by(self, place: Place, along: str) -> None:
        self._shift, self._along_tool = np.zeros(3), np.zeros(3)
        if along == "TF":
            self._along_tool = np.array(place.xyz)
        else:
            frame = 0 if along == "BF" else int(along[4]) if along else place.frame
            self._shift = self._bases[frame][:3, :3] @ np.array(place.xyz)

    def _move(self, line: str, place: Place) -> None:
        turned = self._bases[place.frame][:3, :3] @ _ALONG_TOOL @ self._along_tool
        goal = self._in_base(place) + self._shift + turned
        self.events.append(Motion(line, tuple(goal.tolist()), place.tool, self._lost))


def execute(files: Files, seed: int) -> list[Event]:
    """Return what jobs do that are started one after the other."""
    machine = _Machine(files, seed)
    for _ in range(3):
        machine.start()
    return machine.events


class _Writer:
    """Writes random jobs that prefer a few of the constructs."""

    def __init__(self, random: Random) -> None:
        self._random = random
        every = ("shift", "call", "jump", "copy", "number", "frame", "sensor", "step", "comment", "strange", "any")
        self._themes = random.sample(every, random.randrange(1, 5))
        self._jobs = _JOBS[: random.choice((1, 2, 2, 3))]
        self._label = 0

    def write(self) -> Files:
        return {f"{name}.JBI": self._job(name) for name in self._jobs}

    def _job(self, name: str) -> str:
        random = self._random
        self._c = list(range(random.randrange(2, 5)))
        self._ends: list[str] = []
        positions = ["///TOOL 1"]
        kinds = ["///POSTYPE BASE", "///POSTYPE USER\n///USER 1", "///POSTYPE USER\n///USER 2"]
        positions.append(random.choice(kinds) + "\n///RECTAN")
        for n in self._c:
            if random.random() < 0.2:
                positions.append(random.choice([*kinds, "///TOOL 2"]))
            positions.append(f"C{n:05}={self._numbers()}")
        for n in random.sample(_P, random.randrange(0, 3)):
            numbers = f"{10 * n}.000,0.000,50.000,0.0000,0.0000,0.0000" if n == _P[-1] else self._numbers()
            positions.append(f"P{n:05}={numbers}")
        code = self._some(random.randrange(5, 14), 0)
        for label in self._ends:
            code.insert(random.randrange(len(code) + 1), label)
        head = ["/JOB", f"//NAME {name}", "//POS", "///NPOS 3,0,0,0,0,0", *positions, "//INST", "///GROUP1 RB1", "NOP"]
        return "\n".join([*head, *code, "END", ""])

    def _numbers(self) -> str:
        x, y, z = (self._random.randrange(-200000, 800000) / 1000 for _ in range(3))
        return f"{x:.3f},{y:.3f},{z:.3f},180.0000,0.0000,0.0000"

    def _some(self, count: int, depth: int) -> list[str]:
        return [line for _ in range(count) for line in self._statement(depth)]

    def _statement(self, depth: int) -> list[str]:
        random = self._random
        if random.random() < 0.45:
            return [self._motion()]
        if random.random() < 0.2 and depth < 2:
            return self._block(depth)
        return getattr(self, f"_{random.choice(self._themes)}")()  # type: ignore[no-any-return]

    def _motion(self) -> str:
        random = self._random
        if random.random() < 0.12:
            return random.choice([f"MOVL P{random.choice(_P):03} V=100.0", "MOVL P[I000] V=100.0"])
        return f"{random.choice(('MOVL', 'MOVL', 'MOVJ'))} C{random.choice(self._c):05} V=100.0"

    def _block(self, depth: int) -> list[str]:
        random = self._random
        body = self._some(random.randrange(1, 4), depth + 1)
        match random.randrange(4):
            case 0:
                return [f"IFTHENEXP {self._condition()}", *body, "ENDIF"]
            case 1:
                return [f"IFTHENEXP {self._condition()}", *body, "ELSE", *self._some(1, depth + 1), "ENDIF"]
            case 2:
                return ["WHILEEXP IN#(1)=ON", *body, "ENDWHILE"]
        return [f"FOR I00{depth} = 1 TO {random.randrange(1, 3)}".replace(" = ", "="), *body, f"NEXT I00{depth}"]

    def _condition(self) -> str:
        return self._random.choice(["IN#(1)=ON", "IN#(2)=ON", f"D000>{self._random.randrange(800) * 1000}"])

    def _shift(self) -> list[str]:
        random = self._random
        along = random.choice(("", "", " BF", " UF#(1)", " UF#(2)", " TF"))
        on = f"SFTON P{random.choice((*_P, 10, 10)):03}{along}"
        return random.choice([[on], ["SFTOF"], [on, self._motion(), "SFTOF"]])

    def _call(self) -> list[str]:
        end = self._random.choice(("", "", f" IF {self._condition()}"))
        word = self._random.choice(("CALL", "CALL", "CALL", "JUMP"))
        return [f"{word} JOB:{self._random.choice(self._jobs)}{end}"]

    def _jump(self) -> list[str]:
        if self._random.random() < 0.2:
            return [f"RET IF {self._condition()}"]
        self._label += 1
        self._ends.append(f"*L{self._label}")
        return [f"JUMP *L{self._label}" + self._random.choice((f" IF {self._condition()}",) * 3 + ("",))]

    def _copy(self) -> list[str]:
        a, b = self._random.choice(_P), self._random.choice(_P)
        return [self._random.choice([f"SET P{a:03} P{b:03}", f"ADD P{a:03} P{b:03}", f"CNVRT PX{a:03} PX{b:03} BF"])]

    def _number(self) -> list[str]:
        random, n = self._random, self._random.choice(_P)
        some = [
            *(f"GETE D000 P{n:03} (3)", f"SETE P{n:03} (3) D000", f"SETE P{n:03} (1) {random.randrange(9) * 1000}"),
            *("SET D000 5000", "ADD D000 400000", "DOUT OG#(1) D000", "SET I000 2"),
        ]
        return [random.choice(some)]

    def _frame(self) -> list[str]:
        a = f"{self._random.choice('CP')}{self._random.choice((1, 1, 2)):05}".replace("P00", "P")
        return [f"MFRAME UF#({self._random.choice((1, 2))}) {a} P002 P003"]

    def _sensor(self) -> list[str]:
        return [self._random.choice(("SYSTART CV#(1) STP=0.0", "SYEND CV#(1)"))]

    def _step(self) -> list[str]:
        return [f"GETPOS PX{self._random.choice(_P):03} STEP#({self._random.randrange(1, 4)})"]

    def _comment(self) -> list[str]:
        line = self._random.choice([self._motion(), "SFTOF", "SFTON P010 BF", "CALL JOB:SIDE", "SET P001 P002"])
        return [self._random.choice(("COMM ", "'")) + line]

    def _strange(self) -> list[str]:
        return [f"STRANGE P{self._random.choice(_P):03} 5"]

    def _any(self) -> list[str]:
        some: list[Any] = [self._shift, self._call, self._jump, self._copy, self._number]
        return self._random.choice(some)()  # type: ignore[no-any-return]


def write(random: Random) -> Files:
    """Return random jobs."""
    return _Writer(random).write()


def _tool_of(tool: object) -> FloatArray | None:
    return TOOLS[tool] if isinstance(tool, int) else None


INFORM = Language(write, execute, FrameTable(tools=TOOLS, bases=BASES), OPTIONS, _tool_of)
