"""ABB RAPID: modules with robtargets and the motions to them.

Tool and workobject stand in each motion. Their values come from the frame table, or from tooldata and wobjdata of the
same file. A displacement (PDispSet, EOffsSet …) is followed through the program.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs import rapid_syntax as syntax
from truepose.programs.flow import UNSET, Flow, InForce, Structure
from truepose.programs.points import JOINTS, Frame, Judge, Point, Problem, Use
from truepose.programs.rapid_data import frame_data, robtarget
from truepose.programs.rapid_syntax import Argument, Token, Value, is_list
from truepose.programs.source import PLAIN_LEXER, Source, parse_number
from truepose.programs.targets import FrameTable, Key, Program, ReadOptions, frame_key

_MOTION = re.compile(
    r"(?:MOVE|TRIGG|ARC|SEARCH|SPOT|PAINT|DISP|CAP|CONTACT|NUT|RIVET|GLUE|LASER|CUT|FCPRESS)M?([LJC])"
    r"(?:DO|AO|GO|SYNC|IOS|\d?(?:START|END)?)"
)
"""The motion instructions of the base system and of the process options; C is a circle."""
_JOINT_MOTIONS: Final = frozenset(["MOVEABSJ", "MOVEEXTJ"])
_ZONE = re.compile(r"FINE|Z\d+")
_SPEED = re.compile(r"V\d+|VMAX")
_TOOL_AFTER: Final = {"MOVE": 3, "TRIGG": 4, "ARC": 5, "SEARCH": 2, "CONTACT": 2, "PAINT": 3, "DISP": 4, "CAP": 5}
"""Positions from the end point to the tool."""
_WITHOUT_TRIGGER: Final = frozenset(["TRIGGLIOS", "TRIGGJIOS"])
_OFFSETS: Final = frozenset(["OFFS", "RELTOOL"])
_DISPLACE: Final = {
    "PDISPON": "ipo", "PDISPSET": "ipo", "PDISPOFF": "", "EOFFSON": "tool", "EOFFSSET": "tool", "EOFFSOFF": "",
}  # fmt: skip
_LOOPS: Final = {"ENDFOR": "FOR", "ENDWHILE": "WHILE"}
_DATA: Final = frozenset(["CONST", "PERS", "VAR"])


@dataclass(slots=True, eq=False)
class _Variable:
    """A robtarget or an array of them; `elements` by index in the text's order."""

    name: str
    line: int
    kind: str
    elements: dict[tuple[int, ...], Point] = field(default_factory=dict)
    moved: bool = False
    offset: float = 0.0
    offset_line: int = 0
    offset_known: bool = True


def read(path: Path, frames: FrameTable, options: ReadOptions) -> Program:
    """Read a RAPID module.

    Raises
    ------
    FileError
        If it is no module, truncated, or broken; with its line.
    """
    return _Reader(Source.read(path), options).program(path, frames)


class _Reader:
    def __init__(self, source: Source, options: ReadOptions) -> None:
        self._source, self._options = source, options
        self._flow = Flow()
        self._module: dict[str, _Variable] = {}
        self._local: dict[str, _Variable | None] = {}
        self._locals: list[_Variable] = []
        self._points: list[Point] = []
        self._frames: dict[str, tuple[str, Frame, Problem | None]] = {}
        self._changed: dict[tuple[str, Key | None], int] = {}
        self._circles: list[list[Point]] = []
        self._moves: list[tuple[Point, Use, int]] = []
        self._open: list[tuple[str, int]] = []
        self._reads: list[tuple[_Variable, int, str]] = []

    def program(self, path: Path, frames: FrameTable) -> Program:
        statements = list(syntax.statements(self._source))
        if not any(s[0].text == "MODULE" for s in statements):
            raise FileError(self._source.path, "has no MODULE: it is no RAPID module")
        for statement in statements:  # a module's data may be declared behind their use
            self._structure(statement)
            if not self._routine():
                self._declare(statement, self._module)
        if self._open:
            word, line = self._open[-1]
            raise self._source.error(line, f"{word} has no END{word}: the file is truncated")
        line = 1
        try:
            for statement in statements:
                line = self._source.line(statement[0].start)
                self._structure(statement)
                self._statement(statement, line)
        except Structure as error:
            raise self._source.error(line, f"{error}; correct the file") from None
        self._flow.solve()
        self._attach()
        judge = Judge(frames, self._options, "abb", changed=self._changed)
        targets, circles = judge.program_targets(self._points, self._circles)
        return Program(path, (self._source,), targets, circles, PLAIN_LEXER)

    def _routine(self) -> bool:
        return any(word != "MODULE" for word, _ in self._open)

    def _structure(self, statement: list[Token]) -> None:
        """Follow modules, routines and records as they open and close."""
        words = [token.text for token in statement[:2]]
        word = words[1] if words[0] in ("LOCAL", "TASK") and len(words) > 1 else words[0]
        line = self._source.line(statement[0].start)
        if word in ("MODULE", "PROC", "FUNC", "TRAP", "RECORD"):
            if self._open and (word == "MODULE" or self._routine()):
                raise self._source.error(
                    line, f"{self._open[-1][0]} of line {self._open[-1][1]} has no end before this"
                )
            self._open.append((word, line))
        elif word in ("ENDMODULE", "ENDPROC", "ENDFUNC", "ENDTRAP", "ENDRECORD"):
            if not self._open or self._open[-1][0] != word[3:]:
                raise self._source.error(line, f"{word} without {word[3:]}; correct the file")
            self._open.pop()

    def _statement(self, statement: list[Token], line: int) -> None:
        flow, word = self._flow, statement[0].text
        if word in ("LOCAL", "TASK") and len(statement) > 1:
            statement = statement[1:]
            word = statement[0].text
        if word in ("PROC", "FUNC", "TRAP") and len(statement) > 1:
            name = statement[1 if word != "FUNC" else min(2, len(statement) - 1)].text
            flow.begin_routine(name, outside=True)
            self._local = dict.fromkeys(syntax.parameters(statement))
        elif word in ("ENDPROC", "ENDFUNC", "ENDTRAP"):
            flow.end_routine()
            self._local = {}
        elif word in _DATA:
            if self._routine():
                self._declare(statement, self._local)
        elif word == "IF" and statement[-1].text != "THEN":
            condition, instruction = syntax.split_compact_if(statement)
            self._read_by(condition, line)
            flow.begin("IF", line)
            if instruction:
                self._statement(instruction, line)
            flow.end("ENDIF", "IF")
        elif word in ("IF", "TEST", "FOR", "WHILE"):
            self._read_by(statement[1:], line)
            flow.begin("SWITCH" if word == "TEST" else word, line)
        elif word in ("ELSEIF", "ELSE"):
            self._read_by(statement[1:], line)
            flow.branch("ELSE", last=word == "ELSE")
        elif word in ("CASE", "DEFAULT") and statement[-1].text == ":":
            flow.branch(word, last=word == "DEFAULT")
        elif word in ("ENDIF", "ENDTEST"):
            flow.end(word, "IF" if word == "ENDIF" else "SWITCH")
        elif word in _LOOPS:
            flow.end(word, _LOOPS[word])
        elif word in ("RETURN", "EXIT", "RAISE", "TRYNEXT", "RETRY", "STOP") and statement[0].kind == "word":
            self._read_by(statement[1:], line)
            if word == "RETURN":
                flow.leave()
        elif word == "GOTO" and len(statement) == 2:
            flow.goto(statement[1].text)
        elif len(statement) == 2 and statement[1].text == ":":
            flow.label(word)
        elif self._open and self._open[-1][0] != "RECORD" and word not in ("MODULE", "ENDMODULE", "ENDRECORD", "ERROR"):
            self._instruction(statement, line)

    def _instruction(self, statement: list[Token], line: int) -> None:
        assigned = syntax.position_of(":=", statement)
        if assigned and not any(token.text == "\\" for token in statement[:assigned]):
            self._assign(statement, assigned, line)
            return
        name = statement[0].text
        arguments = syntax.arguments(statement[1:])
        if name in _DISPLACE:
            self._displace(name, line)
            self._read_by(statement[1:], line)
        elif name in _JOINT_MOTIONS:
            self._add(Point(f"{self._cased(statement[0])}:{line}", self._source, line, problem=JOINTS), name, line)
        elif statement[0].kind == "word" and (m := _MOTION.fullmatch(name)) and len(arguments) > 2:
            self._motion(statement[0], m, arguments, line)
        else:
            self._call(statement, arguments, line)

    def _displace(self, name: str, line: int) -> None:
        which = "ipo" if name.startswith("PDISP") else "tool"
        if not _DISPLACE[name]:
            self._flow.change(**{which: "BASE" if which == "ipo" else UNSET})
        else:
            text = f"{name} (line {line})"
            self._flow.change(**{which: text if which == "ipo" else InForce("unknown", text)})

    def _motion(self, token: Token, m: re.Match[str], arguments: list[Argument], line: int) -> None:
        word = self._cased(token)
        positional = [a.tokens for a in arguments if not a.name]
        if token.text.startswith("SEARCH"):
            positional = positional[2:]
        goals = 2 if m[1] == "C" else 1
        use = Use(word, line)
        if len(positional) < goals + 2:
            self._add(
                Point(
                    f"{word}:{line}", self._source, line, problem=Problem("refuse", "a motion that is not understood")
                ),
                word,
                line,
            )
            return
        problem = None
        tool_tokens = self._tool_tokens(token.text, arguments, positional[goals - 1 :])
        wobj_tokens = next((a.tokens for a in arguments if a.name == "WOBJ"), None)
        tool, tool_problem = self._frame("tooldata", tool_tokens)
        wobj: Frame | None = Frame("wobj0", 0)
        wobj_problem: Problem | None = None
        if wobj_tokens is not None:
            wobj, wobj_problem = self._frame("wobjdata", wobj_tokens)
        problem = tool_problem or wobj_problem
        use = Use(word, line, tool, wobj, problem)
        found = [self._goal(tokens, word, line, use, k, goals) for k, tokens in enumerate(positional[:goals])]
        if goals == 2:
            self._circles += [[a, b] for a in found[0] for b in found[1]] or [found[0] + found[1]]

    def _tool_tokens(self, name: str, arguments: list[Argument], after_goal: list[list[Token]]) -> list[Token]:
        positions = [i for i, a in enumerate(arguments) if a.name == "WOBJ"]
        if positions:
            before = [a.tokens for a in arguments[: positions[0]] if not a.name]
            return before[-1] if before else []
        family = next((f for f in _TOOL_AFTER if name.startswith(f)), "")
        place = 3 if name in _WITHOUT_TRIGGER else _TOOL_AFTER.get(family, 0)
        if 0 < place < len(after_goal):
            return after_goal[place]
        zones = [i for i, tokens in enumerate(after_goal[:-1]) if len(tokens) == 1 and _ZONE.fullmatch(tokens[0].text)]
        return after_goal[zones[-1] + 1] if zones else after_goal[-1]

    def _frame(self, kind: str, items: list[Token]) -> tuple[Frame | None, Problem | None]:
        """Return the tool or workobject that an argument names, and why it cannot be used."""
        what = "tool" if kind == "tooldata" else "workobject"
        if len(items) != 1 or items[0].kind != "word":
            shown = "".join(token.text for token in items)[:30]
            return None, Problem("refuse", f"{what} {shown} is known at run time only")
        name = items[0].text
        if name in ("TOOL0", "WOBJ0"):
            return Frame(name.lower(), 0), None
        if name in self._frames and self._frames[name][0] == kind:
            return self._frames[name][1:]
        text = self._cased(items[0])
        return Frame(text, text), None

    def _goal(self, items: list[Token], word: str, line: int, use: Use, k: int, goals: int) -> list[Point]:
        """Take where a motion goes; return the points that it may be."""
        suffix = ("", "") if goals == 1 else (" auxiliary", " end")
        name = f"{word}:{line}{suffix[k]}"
        parsed = syntax.value(items)
        if is_list(parsed):
            point = robtarget(self._source, self._options, name, parsed, line)
            self._move(point, use)
            self._points.append(point)
            return [point]
        if items and items[0].kind == "word" and (len(items) == 1 or (items[1].text == "{" and items[-1].text == "}")):
            return self._named(items, name, line, use)
        self._offset(items, use)
        function = items[0].text if items and items[0].kind == "word" else ""
        reason = "target computed at run time: " + self._shown(items)
        if function in _OFFSETS and self._options.offsets:
            reason = f"offset from a point that is corrected: {self._shown(items)}"
        point = Point(name, self._source, line, problem=Problem("skip", reason))
        return [self._add(point, word, line)]

    def _named(self, items: list[Token], name: str, line: int, use: Use) -> list[Point]:
        variable = self._find(items[0].text)
        if variable is None:
            known = items[0].text in self._local
            reason = "target known at run time only" if known else "declared in another module"
            point = Point(self._cased(items[0]), self._source, line, problem=Problem("skip", reason))
            return [self._add(point, use.word, line)]
        variable.moved = True
        index = syntax.constant_index(items[1:])
        if not variable.elements:
            point = Point(
                variable.name, self._source, line, problem=Problem("skip", "its value is known at run time only")
            )
            return [self._add(point, use.word, line)]
        found = (
            list(variable.elements.values())
            if index is None
            else [variable.elements[index]]
            if index in variable.elements
            else []
        )
        if not found:
            point = Point(name, self._source, line, problem=Problem("refuse", f"{variable.name} has no such element"))
            return [self._add(point, use.word, line)]
        for point in found:
            self._move(point, use)
        return found

    def _offset(self, items: list[Token], use: Use) -> None:
        """Note the points in an expression: moved to with an offset, or read."""
        function = items[0].text if items and items[0].kind == "word" else ""
        if function not in _OFFSETS or len(items) < 4:
            self._read_by(items, use.line)
            return
        pieces = syntax.split(items[2:-1])
        first = pieces[0]
        size, known = 0.0, True
        for piece in pieces[1:4]:
            text = "".join(t.text for t in piece)
            try:
                size += parse_number(text.encode("latin-1")) ** 2
            except ValueError:
                known = False
        for piece in pieces[1:]:
            self._read_by(piece, use.line)
        if first and first[0].text in _OFFSETS:
            self._offset(first, use)
            return
        if not first or (variable := self._find(first[0].text)) is None:
            self._read_by(first, use.line)
            return
        variable.moved = True
        variable.offset_known = variable.offset_known and known
        if size**0.5 >= variable.offset:
            variable.offset, variable.offset_line = size**0.5, use.line
        index = syntax.constant_index(first[1:])
        for key, point in variable.elements.items():
            if index is None or key == index:
                self._move(point, use._replace(problem=use.problem or self._offset_problem(variable)))

    def _offset_problem(self, variable: _Variable) -> Problem | None:
        if self._options.offsets:
            return None
        return Problem("skip", "")  # the words follow when the largest offset is known

    def _call(self, statement: list[Token], arguments: list[Argument], line: int) -> None:
        """Take any other instruction."""
        name = statement[0].text
        positional = [a.tokens for a in arguments if not a.name]
        literal = any(syntax.looks_like_robtarget(syntax.value(tokens)) for tokens in positional)
        named = any(len(t) == 1 and self._find(t[0].text) is not None for t in positional)
        shape = any(len(t) == 1 and _ZONE.fullmatch(t[0].text) for t in positional) and any(
            len(t) == 1 and _SPEED.fullmatch(t[0].text) for t in positional
        )
        if literal or (shape and len(positional) > 3):
            word = self._cased(statement[0])
            reason = f"looks like a motion that is not known: {self._shown(statement)}"
            self._add(Point(f"{word}:{line}", self._source, line, problem=Problem("refuse", reason)), word, line)
        if statement[0].kind == "word":
            self._flow.call(name, "")
        self._read_by(statement[1:], line, f"passed to {self._cased(statement[0])}" if named else "read")

    def _assign(self, statement: list[Token], position: int, line: int) -> None:
        left, right = statement[:position], statement[position + 1 :]
        self._read_by(right, line)
        variable = self._find(left[0].text)
        name = left[0].text
        if variable is not None:
            index = syntax.constant_index(_braces(left))
            how = "component set" if any(t.text == "." for t in left) else "assigned"
            for key, point in variable.elements.items():
                if index is None or not index or key == index:
                    point.writes.append((line, how))
        elif name in self._frames:
            kind = "base" if self._frames[name][0] == "wobjdata" else "tool"
            self._changed.setdefault((kind, frame_key(name)), line)
        elif any(t.text in ("UFRAME", "OFRAME", "TFRAME") for t in left):
            kind = "tool" if any(t.text == "TFRAME" for t in left) else "base"
            self._changed.setdefault((kind, frame_key(name)), line)

    def _read_by(self, items: list[Token], line: int, how: str = "read by arithmetic") -> None:
        for i, token in enumerate(items):
            if i > 1 and items[i - 2].text == "DIM":
                continue  # the size of an array, not its values
            if token.kind == "word" and (i == 0 or items[i - 1].text not in (".", "\\")):
                variable = self._find(token.text)
                if variable is not None:
                    self._reads.append((variable, line, how))

    def _find(self, name: str) -> _Variable | None:
        return self._local[name] if name in self._local else self._module.get(name)

    def _add(self, point: Point, word: str, line: int) -> Point:
        point.uses.append(Use(word, line))
        self._points.append(point)
        return point

    def _move(self, point: Point, use: Use) -> None:
        self._moves.append((point, use, self._flow.node))

    def _attach(self) -> None:
        """Give each point its motions, now that displacements and offsets are known."""
        owner = {id(p): v for v in [*self._module.values(), *self._locals] for p in v.elements.values()}
        for point, use, node in self._moves:
            state, problem = self._flow.states[node], use.problem
            shifts = [ipo for ipo in state.ipo if ipo != "BASE"] + [v.text for v in state.tool if v != UNSET]
            if shifts and (problem is None or problem.verdict == "skip"):
                problem = Problem("refuse", f"a displacement may be active: {min(shifts)}; corrections do not know it")
            if problem == Problem("skip", ""):
                variable = owner[id(point)]
                size = f"{variable.offset:g} mm" if variable.offset_known else "known at run time only"
                reason = f"moved to with an offset (largest {size}, line {variable.offset_line}); allow offsets"
                problem = Problem("skip", f"{reason} to give both one correction")
                # with an offset anywhere it is skipped everywhere
                point.problem = point.problem or problem
            point.uses.append(use._replace(problem=problem))
        for variable, line, how in self._reads:
            for point in variable.elements.values():
                point.reads.append((line, how))

    def _declare(self, statement: list[Token], table: dict[str, _Variable] | dict[str, _Variable | None]) -> None:
        """Take a declaration of a robtarget, a tool or a workobject."""
        if statement[0].text in ("LOCAL", "TASK"):
            statement = statement[1:]
        if len(statement) < 3 or statement[0].text not in _DATA or statement[2].kind != "word":
            return
        kind, type_, name = statement[0].text, statement[1].text, statement[2].text
        line = self._source.line(statement[0].start)
        position = syntax.position_of(":=", statement)
        parsed = syntax.value(statement[position + 1 :]) if position else []
        if (
            type_ in ("TOOLDATA", "WOBJDATA")
            and name not in self._frames
            and not any(t.text == "{" for t in statement[:position])
        ):
            self._frames[name] = frame_data(type_.lower(), self._cased(statement[2]), parsed)
        if type_ != "ROBTARGET":
            return
        if (old := table.get(name)) is not None:
            raise self._source.error(line, f"{statement[2].text} is declared twice, first in line {old.line}; keep one")
        variable = _Variable(self._cased(statement[2]), line, kind)
        table[name] = variable
        if table is not self._module:
            self._locals.append(variable)
        dimensions = (
            sum(t.text == "," for t in statement[3:position]) + 1 if statement[3:4] and statement[3].text == "{" else 0
        )
        for index, element in syntax.elements(parsed, dimensions):
            self._element(variable, index, element, line)

    def _element(self, variable: _Variable, index: tuple[int, ...], element: Value, line: int) -> None:
        suffix = "{" + ",".join(map(str, index)) + "}" if index else ""
        if is_list(element):
            point = robtarget(self._source, self._options, variable.name + suffix, element, line)
        elif element:
            problem = Problem("skip", "its value is known at run time only")
            point = Point(variable.name + suffix, self._source, line, problem=problem)
            self._read_by([t for t in element if isinstance(t, Token)], line)
        else:
            return
        if variable.kind != "CONST" and point.problem is None:
            point.problem = Problem("skip", f"{variable.kind}: the controller may write it; make it CONST")
        variable.elements[index] = point
        self._points.append(point)

    def _shown(self, items: list[Token]) -> str:
        text = self._source.data[items[0].start : items[-1].end].decode("latin-1") if items else ""
        return "".join(c if c.isprintable() else " " for c in text[:40]) + ("…" if len(text) > 40 else "")

    def _cased(self, token: Token) -> str:
        return self._source.data[token.start : token.end].decode("latin-1")


def _braces(items: list[Token]) -> list[Token]:
    """Return the part in braces, braces included."""
    start = next((i for i, token in enumerate(items) if token.text == "{"), len(items))
    end = next((i for i, token in enumerate(items) if token.text == "}"), start)
    return items[start : end + 1]
