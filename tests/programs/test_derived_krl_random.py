"""Any program of assignments, branches, loops and calls: an interpreter of its own goes only where the reader says.

The interpreter runs the program as a controller does, with conditions and inputs that a dice decides, several times in
a row, so that variables keep what the run before left in them. It knows of each value which taught points it depends
on. A motion that depends on a point whose digits are corrected must go to that point, or to one of the positions that
the reader derived from it.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any, NamedTuple

import numpy as np
import pytest

from truepose.geometry import euler
from truepose.programs import Program

TAUGHT = {"XP1": (500.0, 10.0, 300.0, 30.0, 20.0, 10.0), "XP2": (-400.0, 20.0, 700.0, 0.0, 0.0, 90.0)}
POINTS = "".join(
    f"DECL E6POS {name}={{X {x},Y {y},Z {z},A {a},B {b},C {c}}}\n" for name, (x, y, z, a, b, c) in TAUGHT.items()
)
DAT = f"{POINTS}DECL E6POS XA\nDECL E6POS XB\nDECL REAL H=15.0\nDECL INT N=0\n"
HEAD = ["BAS(#TOOL,1)", "BAS(#BASE,1)"]
AXES = "XYZ"
MOST_STEPS = 400


class Value(NamedTuple):
    """Numbers, and the taught points that they depend on."""

    numbers: np.ndarray
    taint: frozenset[str] = frozenset()


class Stop(Exception):  # noqa: N818 - ends a run, a routine or a loop
    """The end of a routine, of a loop, or of too long a run."""


Run = Callable[["Machine"], None]


class Machine:
    """The state of a controller while it runs."""

    def __init__(self, dice: Random) -> None:
        self.dice = dice
        self.points = {name: Value(np.array(pose[:3]), frozenset([name])) for name, pose in TAUGHT.items()}
        self.points |= {name: Value(np.array([dice.uniform(-900, 900) for _ in AXES])) for name in ("XA", "XB")}
        self.numbers = {"H": Value(np.array(15.0)), "N": Value(np.array(0.0))}
        self.motions: list[tuple[int, Value]] = []
        self.steps = 0

    def step(self) -> None:
        self.steps += 1
        if self.steps > MOST_STEPS:
            raise Stop("run")


class Writer:
    """Writes a random program as text, and as a function for the machine."""

    def __init__(self, dice: Random) -> None:
        self.dice, self.lines = dice, ["DEF cell( )", *HEAD]
        self.has_sub = dice.random() < 0.5

    def program(self) -> tuple[str, Run]:
        main = self.block(3, sub=False)
        self.lines += ["END", "DEF sub( )"]
        inner = self.block(1, sub=True)
        self.lines.append("END")

        def run(machine: Machine) -> None:
            machine.sub = inner  # type: ignore[attr-defined]
            self._until("routine", main, machine)

        return "\n".join(self.lines) + "\n", run

    @staticmethod
    def _until(kind: str, block: Run, machine: Machine) -> None:
        try:
            block(machine)
        except Stop as stop:
            if stop.args[0] != kind:
                raise

    def block(self, depth: int, *, sub: bool) -> Run:
        parts = [self.statement(depth, sub=sub) for _ in range(self.dice.randint(1, 5))]

        def run(machine: Machine) -> None:
            for part in parts:
                machine.step()
                part(machine)

        return run

    def statement(self, depth: int, *, sub: bool) -> Run:
        kinds = [self.copy, self.copy, self.component, self.component, self.move, self.move, self.number]
        kinds += [self.approach] * 3
        if depth:
            kinds += [lambda: self.branch(depth, sub), lambda: self.loop(depth, sub), lambda: self.switch(depth, sub)]
        if self.has_sub and not sub:
            kinds.append(self.call)
        kinds += [self.unknown, self.leave] if self.dice.random() < 0.1 else []
        return self.dice.choice(kinds)()

    def line(self, text: str) -> int:
        self.lines.append(text)
        return len(self.lines)

    def copy(self) -> Run:
        name, source = self.dice.choice(["XA", "XB"]), self.dice.choice(["XA", "XB", "XP1", "XP1", "XP2"])
        self.line(f"{name}={source}")
        return lambda machine: machine.points.__setitem__(name, machine.points[source])

    def amount(self) -> tuple[str, Callable[[Machine], Value]]:
        constant = float(self.dice.choice([5, 20, -12.5]))
        text, factor = self.dice.choice([(f"{constant}", 0.0), ("H", 1.0), (f"N*{constant}", constant)])

        def value(machine: Machine) -> Value:
            if not factor:
                return Value(np.array(constant))
            known = machine.numbers["H" if text == "H" else "N"]
            return Value(known.numbers * factor, known.taint)

        return text, value

    def component(self) -> Run:
        name, axis = self.dice.choice(["XA", "XB"]), self.dice.randrange(3)
        source = self.dice.choice([name, name, name, "XP1", "XP2"])
        text, value = self.amount()
        self.line(f"{name}.{AXES[axis]}={source}.{AXES[axis]}+{text}")

        def run(machine: Machine) -> None:
            by, old, given = value(machine), machine.points[name], machine.points[source]
            numbers = old.numbers.copy()
            numbers[axis] = given.numbers[axis] + by.numbers
            machine.points[name] = Value(numbers, old.taint | given.taint | by.taint)

        return run

    def approach(self) -> Run:
        """Derive a position from a point, and move there."""
        name, source, axis = self.dice.choice(["XA", "XB"]), self.dice.choice(sorted(TAUGHT)), self.dice.randrange(3)
        text, value = self.amount()
        self.line(f"{name}={source}")
        self.line(f"{name}.{AXES[axis]}={name}.{AXES[axis]}+{text}")
        line = self.line(f"LIN {name}")

        def run(machine: Machine) -> None:
            by, given = value(machine), machine.points[source]
            numbers = given.numbers.copy()
            numbers[axis] += by.numbers
            machine.points[name] = goal = Value(numbers, given.taint | by.taint)
            machine.motions.append((line, goal))

        return run

    def number(self) -> Run:
        text, value = self.dice.choice([("H=25.0", 25.0), ("H=H+5.0", None), ("H=$ANIN[1]", "?"), ("H=XP1.Z", "XP1")])
        self.line(text)

        def run(machine: Machine) -> None:
            old = machine.numbers["H"]
            known = {
                None: Value(old.numbers + 5.0, old.taint),
                "?": Value(np.array(machine.dice.uniform(0, 90))),
                "XP1": Value(np.array(TAUGHT["XP1"][2]), frozenset(["XP1"])),
            }
            machine.numbers["H"] = known[value] if value in known else Value(np.array(value))

        return run

    def unknown(self) -> Run:
        name = self.dice.choice(["XA", "XB"])
        self.line(f"{name}=$POS_ACT")
        return lambda machine: machine.points.__setitem__(name, Value(np.array([machine.dice.random()] * 3)))

    def leave(self) -> Run:
        self.line("RETURN")

        def run(_: Machine) -> None:
            raise Stop("routine")

        return run

    def call(self) -> Run:
        self.line("sub( )")
        return lambda machine: self._until("routine", machine.sub, machine)  # type: ignore[attr-defined]

    def move(self) -> Run:
        name = self.dice.choice(["XA", "XA", "XB", "XP1", "XP2"])
        along = name in TAUGHT and self.dice.random() < 0.5
        line = self.line(f"LIN {name}:{{X 0.0,Y 0.0,Z -30.0,A 0.0,B 0.0,C 0.0}}" if along else f"LIN {name}")

        def run(machine: Machine) -> None:
            goal = machine.points[name]
            shift = euler("kuka", TAUGHT[name][3:]).apply([0.0, 0.0, -30.0]) if along else np.zeros(3)
            machine.motions.append((line, Value(goal.numbers + shift, goal.taint)))

        return run

    def branch(self, depth: int, sub: bool) -> Run:
        self.line("IF $IN[1] THEN")
        yes, no = self.block(depth - 1, sub=sub), None
        if self.dice.random() < 0.6:
            self.line("ELSE")
            no = self.block(depth - 1, sub=sub)
        self.line("ENDIF")

        def run(machine: Machine) -> None:
            if machine.dice.random() < 0.5:
                yes(machine)
            elif no is not None:
                no(machine)

        return run

    def switch(self, depth: int, sub: bool) -> Run:
        self.line("SWITCH K")
        cases = []
        for k in (1, 2):
            self.line(f"CASE {k}")
            cases.append(self.block(depth - 1, sub=sub))
        self.line("ENDSWITCH")

        def run(machine: Machine) -> None:
            if (k := machine.dice.randrange(3)) < 2:
                cases[k](machine)

        return run

    def loop(self, depth: int, sub: bool) -> Run:
        first, last, step = self.dice.choice([(1, 3, 1), (0, 2, 1), (2, 0, -1), (3, 1, 1)])
        counts = self.dice.random() < 0.6
        self.line(f"FOR N={first} TO {last} STEP {step}" if counts else "WHILE $IN[2]")
        body = self.block(depth - 1, sub=sub)
        self.line("ENDFOR" if counts else "ENDWHILE")

        def run(machine: Machine) -> None:
            if not counts:
                while machine.dice.random() < 0.6:
                    body(machine)
                return
            n = first
            while (last - n) * step >= 0:
                machine.numbers["N"] = Value(np.array(float(n)))
                body(machine)
                n = int(machine.numbers["N"].numbers) + step
            machine.numbers["N"] = Value(np.array(float(n)))

        return run


def allowed(program: Program, name: str) -> dict[int, list[np.ndarray]]:
    """Return the places, by the line of the motion, where corrected digits of a point may lead; none if it is left."""
    (target,) = [target for target in program.targets if target.name == name]
    if target.verdict != "correct":
        return {}
    p = np.array(TAUGHT[name][:3])
    turn = euler("kuka", TAUGHT[name][3:])
    found: dict[int, list[np.ndarray]] = {}
    for one in target.derived:
        line = int(one.how.rpartition("(line ")[2].rstrip(")"))
        shifts = np.array(one.shifts)
        if one.axes == "both":
            shifts = shifts[:, :3] + turn.apply(shifts[:, 3:])
        elif one.axes == "tool":
            shifts = turn.apply(shifts)
        found.setdefault(line, []).extend(p + shifts)
    return found


def lines_of(text: str, name: str) -> set[int]:
    return {k for k, line in enumerate(text.splitlines(), 1) if line.strip() == f"LIN {name}"}


@pytest.mark.exhaustive
@pytest.mark.parametrize("part", range(2))
def test_a_controller_goes_only_where_the_reader_says(read: Any, part: int) -> None:
    followed = 0
    for seed in range(part * 40, part * 40 + 40):
        dice = Random(seed)
        text, run = Writer(dice).program()
        program = read(text, DAT, derived=True, whole_task=True)
        places = {name: allowed(program, name) for name in TAUGHT}
        correct = {target.name for target in program.targets if target.verdict == "correct"}
        direct = {name: lines_of(text, name) for name in TAUGHT}
        for _ in range(6):
            machine = Machine(dice)
            for _ in range(3):
                try:
                    run(machine)
                except Stop:
                    break
            for line, goal in machine.motions:
                for name in goal.taint & correct:
                    if line in direct[name]:
                        continue
                    assert goal.taint == {name}, (seed, line, text)
                    near = [p for p in places[name].get(line, []) if np.allclose(p, goal.numbers, atol=1e-6)]
                    assert near, (seed, line, name, goal, text)
                    followed += 1
    assert followed > 30


def test_the_interpreter_would_notice_a_wrong_shift(read: Any) -> None:
    text = "\n".join(["DEF cell( )", *HEAD, "XA=XP1", "XA.Z=XA.Z+50.0", "LIN XA", "LIN XP1", "END"]) + "\n"
    program = read(text, DAT, derived=True, whole_task=True)
    (place,) = allowed(program, "XP1")[6]
    np.testing.assert_allclose(place, [500.0, 10.0, 350.0])
