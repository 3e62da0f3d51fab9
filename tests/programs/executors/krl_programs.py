"""Random KRL programs, with the constructs by which corrections go wrong, and smaller versions of a program."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from random import Random
from typing import Any

from tests.programs.executors.krl import Literal, Program, Routine, Statement

INPUT = ("input", 1)
H, N = ("variable", "H"), ("variable", "N")
POINTS = ("XP1", "XP2", "XP3", "XP4", "XP5")
THEMES = (
    *("arithmetic", "array", "branch", "call", "copy", "entry", "fdat", "frame", "function", "interrupt", "jump"),
    *("literal", "local", "loop", "mode", "number", "output", "parameter", "relative", "sensor", "spline", "trigger"),
    "with",
    "bases",
)

TOGETHER = {
    "parameter": ("copy", "bases"),
    "function": ("parameter", "bases"),
    "interrupt": ("call",),
    "number": ("relative",),
    "frame": ("number",),
    "call": ("bases",),
    "local": ("call", "copy", "parameter"),
}
"""Themes that show what another one does."""


class Generator:
    """Makes random programs: a main routine, and routines, a function and a handler that it may use.

    Each program has some of the themes only, and reads few of its points: else nothing would be corrected.
    """

    def __init__(self, dice: Random) -> None:
        self._dice = dice
        self._themes = set(dice.sample(THEMES, dice.choice((1, 2, 2, 3, 3, 4, 6))))
        for theme in list(self._themes):
            self._themes |= set(TOGETHER.get(theme, ()))
        self._read = dice.sample(POINTS, dice.choice((1, 1, 1, 2)))
        self._local: list[str] = []
        self._fdats: list[str] = []

    def _has(self, theme: str) -> bool:
        return theme in self._themes

    def program(self) -> Program:
        """Return a program."""
        dice = self._dice
        points: dict[str, list[Literal | None]] = {name: [self.numbers()] for name in POINTS}
        points |= {"XA": [dice.choice([None, self.numbers()])], "XB": [self.numbers()]}
        points["XQ"] = [self.numbers() for _ in range(3)]
        points["FUP"] = [Literal([0.0, 0.0, 50.0, 0.0, 0.0, 0.0])]
        points["FV"] = [Literal([800.0, 20.0, 30.0, 5.0, 0.0, 0.0])]
        fdats = {
            f"FP{k}": (dice.choice((1, 1, 2)), dice.choice((1, 1, 2)), dice.choice(("BASE", "BASE", "BASE", "TCP")))
            for k in (1, 2)
            if self._has("fdat") and dice.random() < 0.8
        }
        self._fdats = sorted(fdats)
        main = [self.frame("tool"), self.frame("base"), *self.block(8, 2, "main")]
        for _ in range(dice.choice((0, 1, 1, 2))):
            at = dice.randint(2, len(main))
            main[at:at] = self.sequence()
        if self._has("jump"):
            main.insert(dice.randint(2, len(main)), Statement("label", ("again",)))
        name = dice.choice(("Q", "XA", "XP1")) if self._has("local") else "Q"
        self._local = [name]
        point = Routine("S1", [(name, dice.choice(("IN", "OUT")), "E6POS")], self.block(3, 1, "S1"))
        self._local = []
        plain = Routine("S2", [], self.block(3, 1, "S2"))
        if self._has("local"):
            plain.variables = dice.sample([("XA", "E6POS"), ("XB", "E6POS"), ("H", "REAL")], dice.choice((1, 2)))
        frame = Routine("S5", [("W", dice.choice(("IN", "OUT")), "FRAME")], self.frames_in())
        number = Routine("S3", [("R", dice.choice(("IN", "OUT")), "REAL")], self.block(2, 1, "S3"))
        inner = Routine("S4", [], self.block(2, 0, "S4"))
        result = [Statement("return", (dice.choice([("number", 1.0), N, H, self.coordinate()]),))]
        first = [self.frame("base")] if dice.random() < 0.4 else self.block(2, 1, "F1")
        function = Routine("F1", [], [*first, *result], "REAL")
        handler = Routine("HND", [], self.block(2, 1, "HND") + [Statement("resume")] * (dice.random() < 0.4))
        return _used(
            Program(points, fdats, [Routine("CELL", [], main), point, plain, number, inner, frame, function, handler])
        )

    def sequence(self) -> list[Statement]:
        """Return statements of which the first ones change something, and the last ones show it."""
        dice = self._dice
        point, other = (("point", name) for name in dice.sample(POINTS, 2))
        copy = ("point", dice.choice(("XA", "XB")))
        coordinate = ("coordinate", point, self.axis())
        show = [Statement("relative", (H,)), Statement("output", (H,)), Statement("entry", (1, self.axis(), H))]
        back = Statement("base", (1, dice.random() < 0.5))
        away = Statement("base", (2, dice.random() < 0.5))
        moved = [away, Statement("move", ("LIN", (copy,), ())), back]
        frame = ("point", dice.choice(("FUP", "FV")))
        found: list[list[Statement]] = [
            [Statement("set", (H, coordinate)), dice.choice(show)],
            [Statement("call", ("S3", (H,))), dice.choice(show)],
            [
                Statement("set", (("coordinate", frame, self.axis()), coordinate)),
                Statement("move", ("LIN", (("shifted", other, frame),), ())),
            ],
            [
                Statement("set", (frame, dice.choice([point, self.partly()]))),
                Statement("base is", (frame,)),
                self.move(),
                back,
            ],
            [Statement("set", (copy, point)), *moved],
            [Statement("call", ("S1", (copy,))), *moved],
            [Statement("set", (("element", "XQ", self.index()), point)), self._element_move(), back],
            [away, Statement("call", ("S3", (("call", "F1", ()),))), back],
            [Statement("interrupt", (INPUT, "HND", dice.random() < 0.3)), Statement("call", ("S2", ())), self.move()],
            [Statement("trigger", (H, "HND")), self.move(), self.move()],
            [Statement("spline", (self.settings(),), [[Statement("move", ("SPL", (point,), ()))]]), self.move()],
            [Statement("for", (("number", 1), ("element", "K", coordinate)), [[self.move()]])],
        ]
        return dice.choice(found)

    def _element_move(self) -> Statement:
        return Statement("move", ("LIN", (("element", "XQ", self.index()),), ()))

    def frames_in(self) -> list[Statement]:
        """Return statements with a frame that a routine gets."""
        change = Statement("set", (("coordinate", ("point", "W"), self.axis()), self.number()))
        use = Statement("base is", (("point", "W"),))
        return [*self._dice.sample([change, use], 1), *self.block(1, 0, "S5")]

    def numbers(self) -> Literal:
        """Return a literal of numbers."""
        dice = self._dice
        return Literal(
            [round(dice.uniform(-500, 500), 1) for _ in range(3)] + [float(dice.randint(-3, 3) * 20) for _ in range(3)]
        )

    def point(self) -> Any:
        """Return a variable whose value is used: a point that may be read, a copy, or an element of the array."""
        dice = self._dice
        if self._has("array") and dice.random() < 0.3:
            return "element", "XQ", self.index()
        copies = ["XA", "XB"] if self._has("copy") else []
        return "point", dice.choice([*self._read, *self._read, *copies, *self._local])

    def index(self) -> Any:
        return self._dice.choice([("number", 1), ("number", 2), ("number", 3), N, ("element", "K", N), self.sum(N)])

    def coordinate(self) -> Any:
        frame = ("point", "FUP")
        return "coordinate", frame if self._has("frame") and self._dice.random() < 0.2 else self.point(), self.axis()

    def axis(self) -> int:
        return self._dice.randrange(3)

    def sum(self, first: Any) -> Any:
        return "operation", self._dice.choice("+-"), first, ("number", self._dice.choice((1.0, 5.0)))

    def number(self) -> Any:
        """Return a number: a constant, a variable, a coordinate, a function."""
        dice = self._dice
        kinds = "nvv" + "cco" * self._has("arithmetic") + "c" * self._has("number") + "ff" * self._has("function")
        kind = dice.choice(kinds)
        if kind == "n":
            return "number", dice.choice((0.0, 10.0, 25.0))
        if kind == "v":
            return dice.choice((H, H, N))
        if kind == "c":
            return self.coordinate()
        if kind == "o":
            return self.sum(dice.choice((H, N, self.coordinate())))
        return "call", "F1", ()

    def condition(self) -> Any:
        return INPUT if self._dice.random() < 0.7 else ("compare", self.number(), ("number", 100.0))

    def partly(self) -> Literal:
        """Return a literal with an expression in it."""
        found = self.numbers()
        found.parts[self.axis()] = self.number()
        return found

    def shift(self) -> Any:
        """Return what shifts a point: a literal of a plain shift, perhaps with an expression, or a frame."""
        if self._has("frame") and self._dice.random() < 0.6:
            return "point", self._dice.choice(("FUP", "FUP", "FV"))
        parts: list[Any] = [0.0, 0.0, self._dice.choice((-30.0, 40.0)), 0.0, 0.0, 0.0]
        if self._dice.random() < 0.4:
            parts[self.axis()] = self.number()
        return Literal(parts)

    def goal(self) -> Any:
        dice = self._dice
        kinds = (
            "t" * 8
            + "v"
            + "vv" * self._has("copy")
            + "lp" * self._has("literal")
            + "s" * self._has("frame")
            + "s" * self._has("arithmetic")
        )
        kind = dice.choice(kinds)
        if kind == "t":
            return "point", dice.choice(POINTS)
        if kind == "v":
            return self.point()
        if kind == "l":
            return self.numbers()
        if kind == "p":
            return self.partly()
        point = self.point() if dice.random() < 0.4 else ("point", dice.choice(POINTS))
        if self._has("frame") and dice.random() < 0.3:
            return "shifted", ("point", "FUP"), point
        return "shifted", point, self.shift()

    def frame(self, kind: str) -> Statement:
        return Statement(kind, (self._dice.choice((1, 1, 1, 2)), self._dice.random() < 0.5))

    def block(self, n: int, depth: int, routine: str) -> list[Statement]:
        """Return statements."""
        return [self.statement(depth, routine) for _ in range(self._dice.randint(max(1, n // 2), n))]

    def statement(self, depth: int, routine: str) -> Statement:
        """Return a random statement that may stand in a routine."""
        dice = self._dice
        back = (("number", 1.0),) if routine == "F1" else ()
        moves = 3.0 if routine in ("main", "S2", "S3", "S1") else 1.0
        makers: list[tuple[str, float, Callable[[], Statement]]] = [
            ("", moves, self.move),
            ("", 0.05, lambda: self.frame("base")),
            ("bases", 0.8, lambda: self.frame("base")),
            ("bases", 0.2, lambda: self.frame("tool")),
            ("copy", 2, self.copy),
            ("arithmetic", 1, self.arithmetic),
            ("number", 1.5, lambda: Statement("set", (H, self.number()))),
            ("array", 1, self.into_array),
            ("array", 0.8, lambda: Statement("set", (N, dice.choice([("number", 1), ("number", 2), self.sum(N)])))),
            ("frame", 1.5, self.into_frame),
            ("output", 1, lambda: Statement("output", (self.number(),))),
            ("mode", 0.6, lambda: Statement("mode", (dice.choice(("TCP", "BASE", "BASE")),))),
            ("sensor", 0.8, lambda: Statement("sensor", (dice.choice(("ON", "OFF", "OFF")),))),
            ("entry", 0.5, lambda: Statement("entry", (dice.choice((1, 2)), self.axis(), self.number()))),
            ("entry", 0.5, lambda: Statement("base is", (dice.choice([self.partly(), ("point", "FV")]),))),
            ("relative", 1, lambda: Statement("relative", (self.number(),))),
            ("branch", 0.3, lambda: Statement("return", back)),
            ("fdat", 0.8, lambda: Statement("fdat", (dice.choice(self._fdats),)) if self._fdats else self.move()),
            ("fdat", 0.8, lambda: Statement("frames")),
            ("fdat", 0.3, self.fdat_number),
            ("spline", 1, self.spline),
        ]
        if routine in ("main", "S2", "S3", "HND") or dice.random() < 0.2:
            makers.append(("call", 2, lambda: self.call(routine)))
            makers.append(("parameter", 2, lambda: self.call(routine)))
            makers.append(("function", 1, lambda: Statement("set", (H, ("call", "F1", ())))))
        if routine in ("main", "S2"):
            when = INPUT if dice.random() < 0.7 else ("compare", self.coordinate(), ("number", 100.0))
            everywhere = dice.random() < 0.3
            makers.append(("interrupt", 1.2, lambda: Statement("interrupt", (when, "HND", everywhere))))
            makers.append(("trigger", 1.2, lambda: Statement("trigger", (self.number(), "HND"))))
        if routine == "main":
            makers.append(("jump", 0.7, lambda: Statement("goto", ("again",))))
        if routine == "HND":
            makers.append(("interrupt", 0.6, lambda: Statement("resume")))
        if depth:
            makers.append(("branch", 2, lambda: self.branch(depth, routine)))
            makers.append(("loop", 1.5, lambda: self.loop(depth, routine)))
        some = [(weight, maker) for theme, weight, maker in makers if not theme or self._has(theme)]
        return dice.choices([maker for _, maker in some], [weight for weight, _ in some])[0]()

    def move(self) -> Statement:
        dice = self._dice
        if self._has("with") and dice.random() < 0.4:
            if dice.random() < 0.4:
                more: Any = ("angle", self.coordinate()) if dice.random() < 0.4 else ()
                return Statement("move", ("CIRC", (self.goal(), self.goal()), more))
            return Statement("move", ("SLIN", (self.goal(),), self.settings()))
        return Statement("move", (dice.choice(("LIN", "LIN", "PTP")), (self.goal(),), ()))

    def settings(self) -> Any:
        """Return a setting of WITH."""
        dice = self._dice
        found = [("velocity", self.number()), ("base", self.partly()), ("base", self.numbers())]
        found += [(dice.choice(("tool", "entry")), dice.choice((1, 2)))] * 3
        return dice.choice([*found, ("mode", dice.choice(("TCP", "BASE")))])

    def spline(self) -> Statement:
        goals = [self.goal() for _ in range(self._dice.randint(1, 3))]
        more = self.settings() if self._dice.random() < 0.7 else ()
        return Statement("spline", (more,), [[Statement("move", ("SPL", (goal,), ())) for goal in goals]])

    def fdat_number(self) -> Statement:
        dice = self._dice
        name = dice.choice([*self._fdats, "FDAT_ACT"])
        return Statement("fdat number", (name, dice.choice(("TOOL", "BASE")), dice.choice((1, 2))))

    def _copy(self) -> Any:
        return "point", self._dice.choice(["XA", "XB", *self._local])

    def copy(self) -> Statement:
        values = [self.point(), self.point(), self.numbers(), ("shifted", self.point(), self.shift())]
        return Statement("set", (self._copy(), self._dice.choice(values)))

    def arithmetic(self) -> Statement:
        copy, axis, dice = self._copy(), self.axis(), self._dice
        source = copy if dice.random() < 0.6 else self.point()
        value = ("operation", "+", ("coordinate", source, axis), dice.choice((("number", 20.0), H, N)))
        return Statement("set", (("coordinate", copy, axis), value))

    def into_array(self) -> Statement:
        value = self._dice.choice([self.point(), self.numbers()])
        return Statement("set", (("element", "XQ", self.index()), value))

    def into_frame(self) -> Statement:
        frame = ("point", self._dice.choice(("FUP", "FV")))
        if self._dice.random() < 0.5:
            return Statement("set", (("coordinate", frame, self.axis()), self.number()))
        values = [self.partly(), self.numbers(), self.point(), self.shift()]
        return Statement("set", (frame, self._dice.choice(values)))

    def call(self, routine: str) -> Statement:
        dice = self._dice
        names = [*(["S4"] if routine != "S4" else []), *(["S2"] * 2 if routine != "S2" else [])]
        kind = dice.choice([*names, *(["S1", "S1", "S1", "S3", "S3", "S5"] if self._has("parameter") else [])])
        if kind == "S5":
            given = [("entry", dice.choice((1, 2))), ("entry", 1), ("point", "FV"), self.point()]
            return Statement("call", ("S5", (dice.choice(given),)))
        if kind == "S1":
            given = [self._copy(), self._copy(), self.point(), ("shifted", self.point(), self.shift()), self.numbers()]
            return Statement("call", ("S1", (dice.choice(given),)))
        if kind == "S3":
            given = [H, self.number(), *[("call", "F1", ())] * (2 * self._has("function"))]
            return Statement("call", ("S3", (dice.choice(given),)))
        return Statement("call", (kind, ()))

    def branch(self, depth: int, routine: str) -> Statement:
        if self._dice.random() < 0.25:
            blocks = [self.block(2, depth - 1, routine) for _ in range(2)]
            return Statement("switch", (N,), blocks)
        blocks = [self.block(2, depth - 1, routine) for _ in range(self._dice.randint(1, 2))]
        return Statement("if", (self.condition(),), blocks)

    def loop(self, depth: int, routine: str) -> Statement:
        dice = self._dice
        body = self.block(3, depth - 1, routine)
        kind = dice.choice(("for", "for", "while", "repeat", "loop"))
        if dice.random() < (0.9 if kind == "loop" else 0.15):
            leave = Statement("if", (self.condition(),), [[Statement("exit")]])
            body.insert(dice.randint(0, len(body)), leave)
        if kind == "for":
            last = dice.choice([("number", 2), ("number", 3), ("number", 1), H, self.number()])
            return Statement("for", (("number", dice.choice((1, 1, 2))), last), [body])
        return Statement(kind, () if kind == "loop" else (self.condition(),), [body])


def _used(program: Program) -> Program:
    """Return a program without the routines that nothing names, and the points that nothing uses."""

    def names(found: Any) -> Iterator[str]:
        if isinstance(found, str):
            yield found
        elif isinstance(found, (list, tuple)):
            for one in found:
                yield from names(one)
        elif isinstance(found, Statement):
            yield from names(found.data)
            yield from names(found.blocks)
        elif isinstance(found, Literal):
            yield from names(found.parts)

    routines = {routine.name: routine for routine in program.routines}
    used, waiting = {program.routines[0].name}, [program.routines[0].name]
    while waiting:
        new = (set(names(routines[waiting.pop()].body)) & routines.keys()) - used
        used |= new
        waiting += new
    kept = [routine for routine in program.routines if routine.name in used]
    named = {name for routine in kept for name in names(routine.body)}
    points = {name: values for name, values in program.points.items() if name in named}
    return Program(points, {name: one for name, one in program.fdats.items() if name in named}, kept)


def smaller(program: Program) -> Iterator[Program]:
    """Yield versions of a program with one thing less: a statement, or the head of a block."""
    for path in list(_blocks(program)):
        for k in range(len(_at(program, path))):
            less = deepcopy(program)
            del _at(less, path)[k]
            yield _used(less)
            for inner in range(len(_at(program, path)[k].blocks)):
                less = deepcopy(program)
                block = _at(less, path)
                block[k : k + 1] = block[k].blocks[inner]
                yield _used(less)


Path = tuple[int, tuple[tuple[int, int], ...]]


def _blocks(program: Program) -> Iterator[Path]:
    """Yield the places of all blocks: the routine, and pairs of statement and block in it."""

    def within(block: list[Statement], routine: int, path: tuple[tuple[int, int], ...]) -> Iterator[Path]:
        yield routine, path
        for k, one in enumerate(block):
            for b, inner in enumerate(one.blocks):
                yield from within(inner, routine, (*path, (k, b)))

    for r, routine in enumerate(program.routines):
        yield from within(routine.body, r, ())


def _at(program: Program, path: Path) -> list[Statement]:
    block = program.routines[path[0]].body
    for k, b in path[1]:
        block = block[k].blocks[b]
    return block
