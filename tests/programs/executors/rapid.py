"""A direct executor of RAPID: it reads the text with a parser of its own and does what a controller would.

Inputs, interrupts, errors of instructions and the answers of measuring instructions come from a dice. The trace of a
run has every motion, with the tool, the object and the displacement in force, and every number that decides anything.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

import numpy as np

_TOKEN = re.compile(
    r"\s+|!.*|<[A-Z]{2,3}>|(?P<text>\"[^\"]*\")|(?P<number>0x[0-9A-Fa-f]+|0b[01]+|[0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<word>[A-Za-z_]\w*)|(?P<mark>:=|<>|<=|>=|.)"
)
_PARTS = {"trans": 0, "rot": 1, "robconf": 2, "extax": 3, "x": 0, "y": 1, "z": 2, "uframe": 3, "oframe": 4, "tframe": 1}
_ENDS = {"endif", "else", "elseif", "endfor", "endwhile", "endtest", "case", "default", "endproc", "endfunc", "endtrap",
         "error"}  # fmt: skip
_EMPTY = {"num": 0.0, "bool": False, "string": "", "pos": [0.0] * 3, "pose": [[0.0] * 3, [1.0, 0.0, 0.0, 0.0]]}
_POINT = [[0.0] * 3, [1.0, 0.0, 0.0, 0.0], [0.0] * 4, [9e9] * 6]
_MOST_STEPS = 250
_MOST_RETRIES = 2
CYCLES = 3


class Invalid(Exception):  # noqa: N818 - ends the reading or the run of a program that no controller would take
    """A program that a controller does not accept."""


class _Error(Exception):
    """An error that handlers may treat."""


class _Left(Exception):  # noqa: N818
    """An error that leaves a routine from its handler."""


class _Stop(Exception):  # noqa: N818
    """The end of a run, or of a cycle."""


class _Return(Exception):  # noqa: N818
    """The end of a routine, with the value of a function."""


class _Goto(Exception):  # noqa: N818
    """A jump to a label."""


class _Handled(Exception):  # noqa: N818
    """RETRY or TRYNEXT."""


def copied(value: Any) -> Any:
    """Return a value of its own."""
    return [copied(one) for one in value] if isinstance(value, list) else value


class Token(NamedTuple):
    kind: str
    text: str
    line: int


class Argument(NamedTuple):
    """An argument; `name` where it is named, `optional` where it stands behind a backslash."""

    name: str
    optional: bool
    value: Any


@dataclass
class Ref:
    """A place that holds a value."""

    box: Any
    key: Any

    def get(self) -> Any:
        return self.box[self.key]

    def set(self, value: Any) -> None:
        self.box[self.key] = copied(value)


@dataclass
class Statement:
    kind: str
    line: int
    parts: tuple[Any, ...] = ()


@dataclass
class Routine:
    kind: str
    parameters: list[tuple[str, str, bool, bool]]  # name, type, whether by reference, whether optional
    module: int
    body: list[Statement] = field(default_factory=list)
    handler: list[Statement] | None = None


class Motion(NamedTuple):
    """A motion of a run: the pose in the base frame, and what was in force."""

    line: int
    goal: Any
    tf: np.ndarray
    tool: str
    tf_tool: np.ndarray
    frame: str
    tf_frame: np.ndarray
    displaced: bool
    module: int = 0


class Seen(NamedTuple):
    """Numbers that decide something or leave the program."""

    line: int
    numbers: Any


class Module:
    """A module of a task, by its text and its place among the others."""

    def __init__(self, text: str, module: int = 0) -> None:
        self.tokens = list(_tokens(text))
        self.tokens += [Token("end", "", self.tokens[-1].line if self.tokens else 1)] * 3
        self.at, self.module = 0, module
        self.data: list[Statement] = []
        self.routines: dict[str, Routine] = {}
        self.local: set[str] = set()
        self._module()

    def _peek(self, ahead: int = 0) -> str:
        return self.tokens[self.at + ahead].text

    def _kind(self, ahead: int = 0) -> str:
        return self.tokens[self.at + ahead].kind

    def _next(self, wanted: str = "") -> str:
        _, found, line = self.tokens[self.at]
        if not found or (wanted and found != wanted):
            raise Invalid(f"line {line}: {wanted or 'more'} expected, got {found}")
        self.at += 1
        return found

    def _if(self, wanted: str) -> bool:
        if self._peek() == wanted and self._kind() != "text":
            self.at += 1
            return True
        return False

    def _module(self) -> None:
        self._next("module")
        self._next()
        while not self._if("endmodule"):
            local = self._if("local")
            self._if("task")
            word = self._peek()
            if word in ("proc", "func", "trap"):
                name = self._routine()
            elif word == "alias":
                while self._next() != ";":
                    pass
                continue
            else:
                self.data.append(self._declaration())
                name = self.data[-1].parts[0]
            if local:
                self.local.add(name)

    def _declaration(self) -> Statement:
        line = self.tokens[self.at].line
        kind = self._next()
        if kind not in ("const", "var", "pers"):
            raise Invalid(f"line {line}: {kind} declares nothing")
        type_, name = self._next(), self._next()
        size = None
        if self._if("{"):
            size = self._expression()
            self._next("}")
        value = self._expression() if self._if(":=") else None
        self._next(";")
        return Statement("declare", line, (name, type_, size, value, kind))

    def _routine(self) -> str:
        kind = self._next()
        if kind == "func":
            self._next()
        name = self._next()
        parameters = []
        if self._if("("):
            while not self._if(")"):
                words, optional = [], False
                while self._peek() not in (",", ")") and not (words and self._peek() == "\\"):
                    if self._if("\\"):
                        optional = True
                    else:
                        words.append(self._next())
                self._if(",")
                by_reference = words[0] in ("inout", "var", "pers")
                parameters.append((words[-1], words[-2], by_reference, optional))
        routine = self.routines[name] = Routine(kind, parameters, self.module)
        while self._peek() in ("const", "var"):
            routine.body.append(self._declaration())
        routine.body += self._block()
        if self._if("error"):
            routine.handler = self._block()
        self._next(f"end{kind}")
        return name

    def _block(self) -> list[Statement]:
        found = []
        while self._peek() not in _ENDS and self._kind() != "end":
            found.append(self._statement())
        return found

    def _statement(self) -> Statement:
        line, word = self.tokens[self.at].line, self._peek()
        if word == "if":
            self.at += 1
            condition = self._expression()
            if not self._if("then"):
                return Statement("if", line, ([(condition, [self._statement()])],))
            arms = [(condition, self._block())]
            while self._if("elseif"):
                condition = self._expression()
                self._next("then")
                arms.append((condition, self._block()))
            if self._if("else"):
                arms.append((True, self._block()))
            self._next("endif")
            return Statement("if", line, (arms,))
        if word == "test":
            self.at += 1
            value, arms = self._expression(), []
            while self._peek() in ("case", "default"):
                case = [] if self._next() == "default" else [self._expression()]
                self._next(":")
                arms.append((case, self._block()))
            self._next("endtest")
            return Statement("test", line, (value, arms))
        if word == "for":
            self.at += 1
            name = self._next()
            self._next("from")
            first = self._expression()
            self._next("to")
            last = self._expression()
            self._next("do")
            body = self._block()
            self._next("endfor")
            return Statement("for", line, (name, first, last, body))
        if word == "while":
            self.at += 1
            condition = self._expression()
            self._next("do")
            body = self._block()
            self._next("endwhile")
            return Statement("while", line, (condition, body))
        if word in ("goto", "connect") and self._kind(1) == "word":
            self.at += 1
            names = [self._next() for _ in range(1 if word == "goto" else 3)]
            self._next(";")
            return Statement(word, line, (names[-1],))
        if word in ("return", "raise", "retry", "trynext", "exitcycle", "stop"):
            self.at += 1
            value = None if self._peek() == ";" else self._expression()
            self._next(";")
            return Statement(word, line, (value,))
        if self._kind(1) == "mark" and self._peek(1) == ":":
            self.at += 2
            return Statement("label", line, (word,))
        if self._if("%"):
            name = self._expression()
            self._next("%")
            arguments = self._arguments(";")
            return Statement("late", line, (name, arguments))
        start = self.at
        target = self._primary()
        if target[0] == "ref" and self._if(":="):
            value = self._expression()
            self._next(";")
            return Statement("assign", line, (target, value))
        self.at = start + 1
        return Statement("call", line, (word, self._arguments(";")))

    def _arguments(self, end: str) -> list[Argument]:
        found = []
        while not self._if(end):
            if self._if(","):
                continue
            if self._if("\\"):
                name = self._next()
                found.append(Argument(name, True, self._expression() if self._if(":=") else ("is", True)))
            elif self._kind() == "word" and self._peek(1) == ":=":
                name = self._next()
                self.at += 1
                found.append(Argument(name, False, self._expression()))
            else:
                found.append(Argument("", False, self._expression()))
        return found

    def _expression(self) -> Any:
        found = self._comparison()
        while self._peek() in ("and", "or") and self._kind() == "word":
            found = (self._next(), found, self._comparison())
        return found

    def _comparison(self) -> Any:
        found = self._sum()
        if self._peek() in ("=", "<>", "<", ">", "<=", ">=") and self._kind() == "mark":
            found = (self._next(), found, self._sum())
        return found

    def _sum(self) -> Any:
        found = self._product()
        while self._peek() in ("+", "-") and self._kind() == "mark":
            found = (self._next(), found, self._product())
        return found

    def _product(self) -> Any:
        found = self._primary()
        while self._peek() in ("*", "/") and self._kind() == "mark":
            found = (self._next(), found, self._primary())
        return found

    def _primary(self) -> Any:
        kind, text = self._kind(), self._next()
        if kind == "number":
            return ("is", float(int(text, 0)) if text[:2] in ("0x", "0b") else float(text))
        if kind == "text":
            return ("is", text[1:-1])
        if text == "-":
            return ("-", ("is", 0.0), self._primary())
        if text == "not":
            return ("not", self._primary())
        if text == "(":
            found = self._expression()
            self._next(")")
            return found
        if text == "[":
            items = []
            while not self._if("]"):
                items.append(self._expression())
                self._if(",")
            return ("list", items)
        if kind != "word":
            raise Invalid(f"line {self.tokens[self.at - 1].line}: {text} is no value")
        if text in ("true", "false"):
            return ("is", text == "true")
        if self._if("("):
            return ("call", text, self._arguments(")"))
        steps: list[Any] = []
        while self._peek() in ("{", ".") and self._kind() == "mark":
            if self._next() == "{":
                steps.append(self._expression())
                self._next("}")
            elif (part := self._next()) not in _PARTS:
                raise Invalid(f"{part} is no component")
            else:
                steps.append(part)
        return ("ref", text, steps, self.tokens[self.at - 1].line)


def _tokens(text: str) -> Iterable[Token]:
    line = 1
    for m in _TOKEN.finditer(text):
        if kind := m.lastgroup:
            yield Token(kind, m[0].lower() if kind == "word" else m[0], line)
        line += m[0].count("\n")


def transform(pose: Any) -> np.ndarray:
    """Return the (4, 4) transform of a pose of lists."""
    w, x, y, z = q = pose[1]
    if not 0.9 < sum(one * one for one in q) < 1.1:
        raise Invalid(f"{q} is no orientation")
    n = 2 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y), pose[0][0]],
            [n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x), pose[0][1]],
            [n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y), pose[0][2]],
            [0, 0, 0, 1],
        ]
    )


class _Frame:
    """A call of a routine."""

    def __init__(self, routine: Routine | None) -> None:
        self.routine = routine
        self.names: dict[str, Ref] = {}
        self.in_handler = False
        self.retries = 0


class Machine:
    """Runs the modules of a task, MAIN in cycles; see `run`."""

    def __init__(self, modules: Sequence[Module], dice: Random) -> None:
        self.dice, self.trace, self.steps = dice, list[Motion | Seen](), 0
        self.displacement, self.offset, self.sensors = np.eye(4), False, set[str]()
        self.task = {name: Ref([0.0], 0) for name in ("v100", "z10", "fine")}
        self.own: list[dict[str, Ref]] = []
        self.routines: dict[str, Routine] = {}
        self.own_routines: list[dict[str, Routine]] = []
        self.traps: list[Routine] = []
        self.pending: list[Routine] = []
        self.beside = False
        self.frame = _Frame(None)
        for module in modules:
            self.own.append({})
            self.own_routines.append({name: r for name, r in module.routines.items() if name in module.local})
            self.routines |= {name: r for name, r in module.routines.items() if name not in module.local}
        for module in modules:
            for data in module.data:
                scope = self.own[module.module] if data.parts[0] in module.local else self.task
                scope[data.parts[0]] = self._initial(data)

    def run(self) -> None:
        """Run MAIN in cycles until that is enough."""
        for _ in range(CYCLES):
            try:
                self._run(self.routines["main"], _Frame(self.routines["main"]))
            except _Stop as stop:
                if stop.args[0] != "cycle":
                    return
            except _Error:
                return

    # names and values

    def _initial(self, data: Statement) -> Ref:
        _, type_, size, value, _ = data.parts
        if value is not None:
            return Ref([copied(self._value(value))], 0)
        one = _EMPTY.get(type_, _POINT)
        return Ref([[copied(one) for _ in range(int(self._value(size)))] if size else copied(one)], 0)

    def _ref(self, expression: Any) -> Ref:
        _, name, steps, line = expression
        module = self.frame.routine.module if self.frame.routine else 0
        own = self.own[module] if module < len(self.own) else {}
        found = self.frame.names.get(name) or own.get(name) or self.task.get(name)
        if found is None:
            raise Invalid(f"line {line}: {name} is not declared")
        for step in steps:
            value = found.get()
            if isinstance(step, str):
                found = Ref(value, _PARTS[step])
                continue
            index = self._number(step)
            self.trace.append(Seen(line, index))
            if not 1 <= index <= len(value):
                raise _Stop("index")
            found = Ref(value, int(index) - 1)
        return found

    def _number(self, expression: Any) -> float:
        value = self._value(expression)
        if not isinstance(value, float):
            raise Invalid(f"{value} is no number")
        return value

    def _value(self, expression: Any) -> Any:
        match expression:
            case ("is", value):
                return value
            case ("list", items):
                return [self._value(item) for item in items]
            case ("ref", name, [], _) if name.startswith("di"):
                return float(self.dice.random() < 0.5)
            case ("ref", *_):
                return self._ref(expression).get()
            case ("call", name, arguments):
                return self._function(name, arguments)
            case ("not", one):
                return not self._value(one)
            case (operator, left, right):
                a, b = self._value(left), self._value(right)
                operations: dict[str, Callable[[Any, Any], Any]] = {
                    "+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y, "/": lambda x, y: x / y,
                    "=": lambda x, y: x == y, "<>": lambda x, y: x != y, "<": lambda x, y: x < y,
                    ">": lambda x, y: x > y, "<=": lambda x, y: x <= y, ">=": lambda x, y: x >= y,
                    "and": lambda x, y: x and y, "or": lambda x, y: x or y,
                }  # fmt: skip
                if operator in ("=", "<>", "<", ">", "<=", ">="):
                    self.trace.append(Seen(0, [copied(a), copied(b)]))
                try:
                    return operations[operator](a, b)
                except (TypeError, ZeroDivisionError) as error:
                    raise Invalid(str(error)) from None
        raise Invalid(f"{expression} is no value")

    def _random_like(self, value: Any) -> Any:
        """Return what a measurement may give in place of a value."""
        if isinstance(value, float):
            return float(self.dice.choice([1, 2]))
        if isinstance(value, list) and len(value) == 4 and all(isinstance(one, float) for one in value):
            angle = self.dice.uniform(0.2, 1.5)
            return [float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))]
        if isinstance(value, list) and all(isinstance(one, float) for one in value):
            return [one + self.dice.uniform(-50, 50) for one in value]
        return [self._random_like(one) for one in value] if isinstance(value, list) else value

    # functions

    def _function(self, name: str, arguments: list[Argument]) -> Any:
        if (routine := self._routine(name)) is not None:
            return self._call(routine, arguments)
        if name == "strtoval":
            place = self._ref(arguments[1].value)
            place.set(self._random_like(place.get()))
            return True
        values = [copied(self._value(a.value)) for a in arguments if not a.optional]
        if name == "offs":
            values[0][0] = [a + b for a, b in zip(values[0][0], values[1:], strict=True)]
            return values[0]
        if name == "reltool":
            shift = transform(values[0])[:3, :3] @ values[1:4]
            values[0][0] = [a + float(b) for a, b in zip(values[0][0], shift, strict=True)]
            return values[0]
        if name == "crobt":
            return self._random_like(copied(_POINT))
        if name == "calcjointt":
            return values[0]
        if name == "abs":
            return abs(values[0])
        if name == "distance":
            return float(np.linalg.norm(np.subtract(values[0], values[1])))
        raise Invalid(f"{name} is no function")

    def _routine(self, name: str) -> Routine | None:
        module = self.frame.routine.module if self.frame.routine else 0
        own = self.own_routines[module] if module < len(self.own_routines) else {}
        return own.get(name) or self.routines.get(name)

    def _call(self, routine: Routine, arguments: list[Argument]) -> Any:
        inner = _Frame(routine)
        required = [p for p in routine.parameters if not p[3]]
        named = {p[0]: p for p in routine.parameters}
        place = 0
        for argument in arguments:
            if argument.name:
                parameter = named.get(argument.name)
                place += not argument.optional
            else:
                parameter = required[place] if place < len(required) else None
                place += 1
            if parameter is None:
                raise Invalid(f"{argument} has no parameter")
            name, _, by_reference, _ = parameter
            if by_reference and argument.value[0] == "ref":
                inner.names[name] = self._ref(argument.value)
            else:
                inner.names[name] = Ref([copied(self._value(argument.value))], 0)
        if place != len(required):
            raise Invalid("arguments are missing")
        return self._run(routine, inner)

    def _run(self, routine: Routine, inner: _Frame) -> Any:
        outer, self.frame = self.frame, inner
        if routine.kind != "func" and len(routine.body) == 0:
            self._step()
        try:
            body, at = routine.body, 0
            while True:
                try:
                    for statement in body[at:]:
                        self._execute(statement)
                    if routine.kind == "func":
                        raise Invalid("a function without RETURN")
                    return None
                except _Goto as jump:
                    labels = [k for k, s in enumerate(body) if s.kind == "label" and s.parts[0] == jump.args[0]]
                    if not labels:
                        raise Invalid("no such label") from None
                    at = labels[0]
        except _Return as end:
            return end.args[0]
        except _Left:
            raise _Error from None
        finally:
            self.frame = outer

    # statements

    def _step(self) -> None:
        self.steps += 1
        if self.steps > _MOST_STEPS:
            raise _Stop("enough")
        if self.beside:
            return
        due = [routine for routine in self.pending if self.dice.random() < 0.6]
        self.pending = [routine for routine in self.pending if routine not in due]
        due += [trap for trap in self.traps if self.dice.random() < 0.08]
        for routine in due:
            self._run_beside(routine)

    def _run_beside(self, routine: Routine) -> None:
        self.beside = True
        try:
            self._run(routine, _Frame(routine))
        except _Error:
            raise _Stop("an error of an interrupt program") from None
        finally:
            self.beside = False

    def _execute(self, statement: Statement) -> None:
        """Execute a statement; an error goes to the handler of its routine."""
        self._step()
        while True:
            try:
                getattr(self, f"_do_{statement.kind}")(statement.line, *statement.parts)
                return
            except _Error:
                frame = self.frame
                if frame.routine is None or frame.routine.handler is None:
                    raise
                if frame.in_handler:
                    raise _Left from None
                frame.in_handler = True
                try:
                    for one in frame.routine.handler:
                        self._execute(one)
                    raise _Stop("the end of a handler")
                except _Error:
                    raise _Left from None
                except _Handled as handled:
                    if handled.args[0] == "trynext":
                        return
                    frame.retries += 1
                    if frame.retries > _MOST_RETRIES:
                        raise _Stop("retries") from None
                finally:
                    frame.in_handler = False

    def _block(self, statements: list[Statement]) -> None:
        for statement in statements:
            self._execute(statement)

    def _do_declare(self, _: int, name: str, *parts: Any) -> None:
        self.frame.names[name] = self._initial(Statement("declare", 0, (name, *parts)))

    def _do_if(self, _: int, arms: list[Any]) -> None:
        for condition, body in arms:
            if condition is True or self._value(condition):
                self._block(body)
                return

    def _do_test(self, line: int, value: Any, arms: list[Any]) -> None:
        number = self._value(value)
        for cases, body in arms:
            if cases:
                other = self._value(cases[0])
                self.trace.append(Seen(line, [number, other]))
            if not cases or number == other:
                self._block(body)
                return

    def _do_for(self, line: int, name: str, first: Any, last: Any, body: list[Statement]) -> None:
        a, b = self._number(first), self._number(last)
        self.trace.append(Seen(line, [a, b]))
        before = self.frame.names.get(name)
        step, n = (1 if b >= a else -1), a
        while (b - n) * step >= 0:
            self.frame.names[name] = Ref([n], 0)
            self._block(body)
            n += step
        if before is None:
            self.frame.names.pop(name, None)
        else:
            self.frame.names[name] = before

    def _do_while(self, _: int, condition: Any, body: list[Statement]) -> None:
        while self._value(condition):
            self._step()
            self._block(body)

    def _do_goto(self, _: int, name: str) -> None:
        raise _Goto(name)

    def _do_label(self, _: int, name: str) -> None:
        """A label does nothing."""

    def _do_connect(self, _: int, name: str) -> None:
        routine = self._routine(name)
        if routine is None or routine.kind != "trap":
            raise Invalid(f"{name} is no trap")
        if routine not in self.traps:
            self.traps.append(routine)

    def _do_return(self, _: int, value: Any) -> None:
        raise _Return(None if value is None else copied(self._value(value)))

    def _do_raise(self, _: int, value: Any) -> None:
        if value is not None:
            self._value(value)
        raise _Error

    def _do_retry(self, _: int, __: Any) -> None:
        raise _Handled("retry")

    def _do_trynext(self, _: int, __: Any) -> None:
        raise _Handled("trynext")

    def _do_exitcycle(self, _: int, __: Any) -> None:
        raise _Stop("cycle")

    def _do_stop(self, _: int, __: Any) -> None:
        """The operator goes on."""

    def _do_assign(self, _: int, target: Any, value: Any) -> None:
        place = self._ref(target)
        new = self._value(value)
        place.set(new)

    def _do_late(self, _: int, name: Any, arguments: list[Argument]) -> None:
        routine = self._routine(str(self._value(name)).lower())
        if routine is None:
            raise Invalid("no such procedure")
        self._call(routine, arguments)

    def _do_call(self, line: int, name: str, arguments: list[Argument]) -> None:
        if (routine := self._routine(name)) is not None:
            self._call(routine, arguments)
            return
        positional = [a.value for a in arguments if not a.name]
        if name.startswith(("move", "search", "trigg")):
            self._move(line, name, positional, {a.name: a.value for a in arguments if a.optional})
        elif name in ("pdispset", "eoffsset"):
            value = self._value(positional[0])
            if name == "pdispset":
                self.displacement = transform(value)
            self.offset = self.offset or name == "eoffsset"
        elif name == "pdispoff":
            self.displacement = np.eye(4)
        elif name == "eoffsoff":
            self.offset = False
        elif name in ("corrcon", "waitwobj"):
            self.sensors.add(name)
        elif name in ("corrclear", "dropwobj"):
            self.sensors.discard("corrcon" if name == "corrclear" else "waitwobj")
        elif name in ("waitdi", "waittime"):
            if self.dice.random() < 0.3 and any(a.name == "maxtime" for a in arguments):
                raise _Error
        elif name in ("getsysdata", "readanybin", "mtoolrotcalib"):
            place = self._ref(positional[-1])
            place.set(self._random_like(place.get()))
        elif name in ("incr", "add"):
            place = self._ref(positional[0])
            place.set(place.get() + (1.0 if name == "incr" else self._number(positional[1])))
        elif name in ("tpwrite", "setao", "set", "isignaldi", "gripload", "confl"):
            shown = [a.value for a in arguments[1:] if a.value[0] != "is"] if name in ("tpwrite", "setao") else []
            self.trace.append(Seen(line, [copied(self._value(one)) for one in shown]))
        else:
            raise Invalid(f"line {line}: {name} is no instruction")

    def _move(self, line: int, name: str, positional: list[Any], options: Mapping[str, Any]) -> None:
        found = positional[1] if name.startswith("search") else None
        positional = positional[2:] if found is not None else positional
        if name == "moveabsj":
            self.trace.append(Seen(line, copied(self._value(positional[0]))))
            return
        run = self._value(positional.pop()) if name.endswith("sync") else ""
        tool, wobj = positional[-1], options.get("wobj")
        goals = positional[: 2 if re.match("(?:move|search|trigg)c", name) else 1]
        values = [copied(self._value(one)) for one in [*goals, *positional[len(goals) : -1]]]
        tf_tool = transform(self._ref(tool).get()[1])
        tf_frame, frame = np.eye(4), "wobj0"
        if wobj is not None:
            value, frame = self._ref(wobj).get(), wobj[1]
            tf_frame = transform(value[3]) @ transform(value[4])
        displaced = self.offset or bool(self.sensors) or not np.array_equal(self.displacement, np.eye(4))
        for goal in values[: len(goals)]:
            tf = tf_frame @ self.displacement @ transform(goal)
            module = self.frame.routine.module if self.frame.routine else 0
            self.trace.append(Motion(line, goal, tf, tool[1], tf_tool, frame, tf_frame, displaced, module))
        if found is not None:
            self._ref(found).set(self._random_like(copied(_POINT)))
        if run:
            routine = self._routine(run.lower())
            if routine is None:
                raise Invalid("no such procedure")
            if self.beside:
                raise _Stop("a procedure beside an interrupt program")
            if self.dice.random() < 0.5:
                self._run_beside(routine)
            else:
                self.pending.append(routine)


def trace_of(modules: Sequence[Module], seed: int) -> list[Motion | Seen]:
    """Return what a run does; the seed gives all inputs, interrupts and errors."""
    machine = Machine(modules, Random(seed))
    machine.run()
    return machine.trace
