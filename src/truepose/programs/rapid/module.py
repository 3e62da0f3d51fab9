"""One RAPID module: first its declarations, then its statements.

All modules of a task declare before any is read, because data may be declared behind their use or in another module.
"""

from __future__ import annotations

from typing import Final

from truepose.errors import FileError
from truepose.programs.core import shifts
from truepose.programs.core.flow import BlockError
from truepose.programs.core.forms import Lines, is_run
from truepose.programs.core.points import Point, Problem, at
from truepose.programs.core.source import NotAProgramError, Source
from truepose.programs.core.state import UNSET, InForce
from truepose.programs.rapid import syntax
from truepose.programs.rapid.columns import NamedTargets, at_line, blank_in_name, prefix_of
from truepose.programs.rapid.data import frame_data, jointtarget, robtarget
from truepose.programs.rapid.derived import NumberVariable, Reach, number_values
from truepose.programs.rapid.motions import RapidMotionReader
from truepose.programs.rapid.names import (
    Datum,
    ModuleNames,
    RapidTask,
    RobtargetVariable,
    Routine,
    Scope,
    late_bound,
    may_mean,
)
from truepose.programs.rapid.runs import NUMBERS, RapidRuns
from truepose.programs.rapid.shifted import assign, counter_of, give_points
from truepose.programs.rapid.syntax import Argument, Token, Value, is_list
from truepose.programs.rapid.unreadable import is_encoded, names_module
from truepose.programs.rapid.words import (
    DATA,
    DISPLACEMENTS,
    HANDLERS,
    INSTRUCTIONS,
    JOINT_MOTIONS,
    LOADS,
    LOOPS,
    MOTION,
    READING,
    SYNC,
)

_ROUTINES: Final = ("PROC", "FUNC", "TRAP")
_TARGET_TYPES: Final = ("ROBTARGET", "JOINTTARGET")
_FRAME_TYPES: Final = {"TOOLDATA": "tool", "WOBJDATA": "base"}
_PARTS: Final = ("UFRAME", "OFRAME", "TFRAME", "UFPROG", "UFMEC", "ROBHOLD")


class RapidModule:
    """Reads one module; `declare` of all modules first, then `read`.

    Attributes
    ----------
    source : Source
        The file.
    name : str
        The name in upper case.
    """

    def __init__(self, source: Source, task: RapidTask, *, columns: bool = True) -> None:
        self.source, self._task = source, task
        if is_encoded(source.data):
            raise FileError(source.path, "is encoded or no text and cannot be read; what it does is not known")
        if not names_module(source.data):
            raise NotAProgramError(source.path, "has no MODULE: it is no RAPID module")
        self._options, self._flow = task.options, task.flow
        self._runs = RapidRuns(source, named=columns)
        self._pieces = list(syntax.pieces(source, self._runs.find))
        heads = (s for s in self._pieces if isinstance(s, list) and "MODULE" in [t.text for t in s[:2]])
        self.name = next(map(_module_name, heads), "")
        if not self.name:
            raise FileError(source.path, "has no MODULE: it is no RAPID module")
        for piece in self._pieces:
            if isinstance(piece, list) and (alias := _without_scope(piece))[0].text == "ALIAS" and len(alias) == 3:
                task.aliases[alias[2].text] = alias[1].text
        self._names = ModuleNames(source, task)
        self._open: list[tuple[str, int]] = []
        self._conditions: list[list[Token]] = []
        self._key = ""
        self._initial: list[tuple[list[Token], int]] = []
        self._handled: set[str] = set()  # the routines with an error handler
        self._motions = RapidMotionReader(self._names)
        self._columns = {
            local: NamedTargets(source, lambda start: self._declare(self._line(start), inner=False), local=local)
            for local in (False, True)
        }

    @property
    def own(self) -> Scope:
        """The names that the module declares with LOCAL."""
        return self._names.own

    def declare(self) -> None:
        """Read the declarations of the module; values that name other data are kept for `read`."""
        key = ""
        for statement in self._pieces:
            if isinstance(statement, Lines):
                if self._runs.kind(statement) == "declared" and not self._routine():
                    self._declare_run(statement)
                continue  # motions declare nothing
            outside = not self._routine()
            self._structure(statement)
            if outside:
                self._declare(statement)
                key = self._declare_routine(statement) or key
            elif _is_handler(statement, "ERROR"):
                self._handled.add(key)
                self._flow.stepwise = True
            else:
                self._find_run_by_motion(statement)
        if self._open:
            word, line = self._open[-1]
            raise self.source.error(line, f"{word} has no END{word}: the file is truncated")
        for local, columns in self._columns.items():
            if columns.declared:
                scope = self.own if local else self._task.scope
                scope.columns.append(columns)
                self._task.columns.append((columns, scope))

    def _line(self, start: int) -> list[Token]:
        """Return the statement that starts within the line of a byte."""
        return next(syntax.statements(self.source, start, self.source.data.find(b"\n", start) + 1))

    def _declare_run(self, lines: Lines) -> None:
        """Declare a run of robtargets."""

        def point(start: int) -> Point:
            statement = _without_scope(self._line(start))
            name = self._names.cased(statement[2])
            return robtarget(self.source, self._options, name, syntax.value(statement[4:]), self.source.line(start))

        local = self._line(lines.start)[0].text == "LOCAL"
        if not self._columns[local].declare(lines, point(lines.start), point):
            for statement in syntax.statements(self.source, lines.start, lines.end):
                self._declare(statement)

    def read(self) -> None:
        """Read the statements; a FileError names the line of a broken one."""
        for tokens, line in self._initial:
            self._names.read_by(tokens, line)
        line = 1
        try:
            for piece in self._pieces:
                line = piece.line if isinstance(piece, Lines) else self.source.line(piece[0].start)
                if isinstance(piece, Lines):
                    self._run(piece)
                else:
                    self._structure(piece)
                    self._names.taken.clear()
                    self._statement(piece, line)
        except BlockError as error:
            raise self.source.error(line, f"{error}; correct the file") from None

    def _run(self, lines: Lines) -> None:
        """Read the first line of a run; and the others, too, if it is not one motion to numbers."""
        task, source, kind = self._task, self.source, self._runs.kind(lines)
        if (kind == "declared" and not self._routine()) or (kind == "named" and self._named_run(lines)):
            return
        behind = source.data.find(b"\n", lines.start) + 1
        before = task.marks()
        for statement in syntax.statements(source, lines.start, behind):
            self._names.taken.clear()
            self._statement(statement, lines.line)
        one = task.marks() == (before[0] + 1, before[1] + 1, *before[2:])
        if kind == "inline" and one and task.moves[-1].point is task.points[-1]:
            point = task.points[-1]
            if is_run(lines, "abb", point, NUMBERS):
                task.runs.append((task.points.pop(), lines))
                return
        for statement in syntax.statements(source, behind, lines.end):
            self._names.taken.clear()
            self._statement(statement, source.line(statement[0].start))

    def _named_run(self, lines: Lines) -> bool:
        """Take a run of motions to robtargets that stay columns; False if they do not."""
        statement = self._line(lines.start)
        arguments = syntax.arguments(statement[1:])
        prefix = prefix_of(arguments[0].tokens[0].text)
        scopes = [self._names.inner, self._names.own, self._task.scope]
        k = next((k for k, scope in enumerate(scopes) if scope.hides(prefix)), 0)
        if not self._routine() or not k or blank_in_name(lines, self.source):
            return False
        use = self._motions.use_of(statement, arguments, lines.line)
        key = at_line(use, 0)._replace(order=0), self._flow.node  # there is one motion in each line
        kind = self._task.kinds.setdefault(key, len(self._task.kinds))
        return any(columns.move(lines, prefix, kind, self.source) for columns in scopes[k].columns)

    def _routine(self) -> bool:
        return any(word != "MODULE" for word, _ in self._open)

    def _structure(self, statement: list[Token]) -> None:
        """Follow modules, routines and records as they open and close."""
        word = _without_scope(statement)[0].text
        line = self.source.line(statement[0].start)
        if word in ("MODULE", "RECORD", *_ROUTINES):
            if self._open and (word == "MODULE" or self._routine()):
                raise self.source.error(line, f"{self._open[-1][0]} of line {self._open[-1][1]} has no end before this")
            self._open.append((word, line))
        elif word in ("ENDMODULE", "ENDRECORD", *(f"END{kind}" for kind in _ROUTINES)):
            if not self._open or self._open[-1][0] != word[3:]:
                raise self.source.error(line, f"{word} without {word[3:]}; correct the file")
            self._open.pop()

    def _find_run_by_motion(self, statement: list[Token]) -> None:
        """Note the procedure that a motion runs: ``MoveLSync …,"pick";``."""
        k = next((k for k, token in enumerate(statement) if token.kind == "word" and SYNC.fullmatch(token.text)), -1)
        if k >= 0:
            positional = [a.tokens for a in syntax.arguments(statement[k + 1 :]) if not a.name]
            self._task.run_by_motions.add(late_bound(positional[-1] if positional else []))

    def _declare_routine(self, statement: list[Token]) -> str:
        """Take a routine's head; return its key, empty where it is none."""
        head = _without_scope(statement)
        if head[0].text not in _ROUTINES or len(head) < 2:
            return ""
        kind, name = head[0].text, _routine_name(head)
        line = self.source.line(statement[0].start)
        local = statement[0].text == "LOCAL"
        table = (self._names.own if local else self._task.scope).routines
        if (old := table.get(name)) is not None:
            remedy = "; give the files of one task at a time" if self._task.named else "; give another name"
            raise self.source.error(line, f"{name} is defined twice, first in {at(old.place)}{remedy}")
        key = f"{self.name}:{name}" if local else name
        table[name] = Routine(key, kind, syntax.parameters(head), self._names.place(line))
        self._task.routines.append(table[name])
        return key

    def _statement(self, statement: list[Token], line: int) -> None:
        flow = self._flow
        statement = _without_scope(statement)
        word = statement[0].text
        if word in _ROUTINES and len(statement) > 1:
            self._begin_routine(statement)
        elif word in ("ENDPROC", "ENDFUNC", "ENDTRAP"):
            if self._key == "MAIN":
                flow.again()
            flow.end_routine()
            self._names.inner = Scope()
        elif word in DATA:
            if self._routine() and (
                syntax.runs_on(statement[2:]) or [t.text for t in statement[3:4]] not in ([], ["{"], [":="])
            ):
                self._not_understood(statement, line)
            elif self._routine():
                self._declare(statement)
        elif not self._routine() or self._open[-1][0] == "RECORD" or word in ("ENDRECORD", "ENDMODULE"):
            pass
        else:
            if self._control(statement, line):
                self._names.take(statement[:1])
            else:
                self._instruction(statement, line)
            self._names.take_rest(statement, line)

    def _begin_routine(self, head: list[Token]) -> None:
        name = _routine_name(head)
        routine = self._names.find_routine(name)
        assert routine is not None  # it was declared
        self._key = self._names.routine = routine.key
        # in a whole task, what nothing calls is a start
        outside = routine.key == "MAIN" or (not self._task.whole and ":" not in routine.key)
        self._flow.begin_routine(routine.key, outside=outside)
        runs_beside = any(may_mean(start, routine.key, exact=exact) for start, exact in self._task.run_by_motions)
        if head[0].text == "TRAP" or (head[0].text == "PROC" and runs_beside):
            self._flow.interrupt_program()
        points = {p.name: self._task.parameter(routine.key, p.name) for p in routine.parameters if p.is_point}
        self._names.inner = Scope(points, others={p.name for p in routine.parameters} - points.keys())

    def _control(self, statement: list[Token], line: int) -> bool:
        """Follow a statement of the control flow; False if it is none."""
        flow, word, rest = self._flow, statement[0].text, statement[1:]
        is_mark = statement[-1].text == ":"
        if word == "IF" and statement[-1].text != "THEN":
            condition, instruction = syntax.split_compact_if(statement)
            self._ask(condition, line)
            flow.begin("IF", line)
            if instruction:
                self._statement(instruction, line)
            flow.end("ENDIF", "IF")
        elif word in ("IF", "TEST", "FOR", "WHILE"):
            self._ask(rest, line)
            self._begin_block(word, rest, line)
            self._conditions += [rest] * (word == "WHILE")
        elif word in ("ELSEIF", "ELSE"):
            flow.branch("ELSE", last=word == "ELSE")
            self._ask(rest, line)
            flow.decide()
        elif word in ("CASE", "DEFAULT") and is_mark:
            flow.branch(word, last=word == "DEFAULT")
            self._ask(rest, line)
            flow.decide()
        elif word in ("ENDIF", "ENDTEST"):
            flow.end(word, "IF" if word == "ENDIF" else "SWITCH")
        elif word in LOOPS:
            if word == "ENDFOR" and self._names.counters:
                self._names.counters.pop()
            if word == "ENDWHILE" and self._conditions:  # it is evaluated again
                self._ask(self._conditions.pop(), line)
            self._task.derivations.derivations.end_loop(word, LOOPS[word], self._names.place(line))
        elif _is_handler(statement, *HANDLERS):
            flow.part(errors=word == "ERROR", listed=len(statement) > 1)
        elif statement[0].kind == "word" and word in ("RETURN", "EXIT", "EXITCYCLE", "RAISE", "TRYNEXT", "RETRY"):
            self._ask(rest, line)
            self._leave(word)
        elif word == "GOTO" and len(statement) == 2:
            self._names.take(rest)
            flow.goto(statement[1].text)
        elif len(statement) == 2 and is_mark:
            flow.label(word)
        else:
            return False
        return True

    def _ask(self, items: list[Token], line: int) -> None:
        """Take an expression: the functions that it calls, and the points that it reads."""
        self._names.call_in(items, line)
        self._names.read_by(items, line)

    def _begin_block(self, word: str, items: list[Token], line: int) -> None:
        """Open IF, TEST or a loop."""
        counter = None
        if word == "FOR" and items:
            found = counter_of(items, self._names)
            number, counter = found or (NumberVariable(self._names.cased(items[0]), "VAR", {}, handed=True), None)
            self._names.counters.append(number)
        kind = "SWITCH" if word == "TEST" else word
        self._task.derivations.derivations.begin_loop(counter, kind, line, self._names.place(line))

    def _leave(self, word: str) -> None:
        if word == "RETURN":
            self._flow.leave()
        elif word in ("RETRY", "TRYNEXT"):
            self._flow.resume()
        elif word == "RAISE":
            self._flow.fail(handled=self._key in self._handled)
        else:
            if word == "EXITCYCLE" and "MAIN" in self._task.scope.routines:
                self._flow.call("MAIN", "")
            self._flow.stop()

    def _instruction(self, statement: list[Token], line: int) -> None:
        first, name = statement[0], statement[0].text
        if syntax.runs_on(statement) or (first.kind != "word" and name != "%"):
            self._not_understood(statement, line)
            return
        assigned = syntax.position_of(":=", statement)
        self._names.call_in(statement if assigned or first.kind != "word" else statement[1:], line)
        if assigned and syntax.is_variable(statement[:assigned]):
            self._assign(statement, assigned, line)
            return
        arguments = syntax.arguments(statement[1:])
        if not self._names.is_data(name):
            self._names.take([first])
        if first.kind == "word" and self._names.find_routine(name) is not None:
            self._call(statement, arguments, line)  # whatever instruction has that name, too
            return
        code = self.source.data[first.start : statement[-1].end]
        shifts.follow(self._flow, shifts.RAPID, code, self._names.place(line))
        if name in DISPLACEMENTS:
            self._displace(name, line)
            self._names.read_by(statement[1:], line)
        elif name in JOINT_MOTIONS:
            self._motions.joint(statement, arguments, line)
        elif first.kind == "word" and (m := MOTION.fullmatch(name)) and len(arguments) > 2:
            self._motions.read(first, m[1] == "C", arguments, line)
        else:
            self._call(statement, arguments, line)

    def _not_understood(self, statement: list[Token], line: int) -> None:
        """Distrust all that a statement names; what is in force behind it is not known."""
        text = f"a statement that is not understood ({at(self._names.place(line))})"
        self._flow.change(ipo=text, tool=InForce("unknown", text))
        self._names.call_in(statement, line)
        self._names.take_rest(statement, line)

    def _displace(self, name: str, line: int) -> None:
        """Take an instruction that displaces the motions behind it, or ends that."""
        text = f"{name} ({at(self._names.place(line))})"
        if DISPLACEMENTS[name] == "ipo":
            self._flow.change(ipo="BASE" if name.endswith("OFF") else text)
        else:
            self._flow.change(tool=UNSET if name.endswith("OFF") else InForce("unknown", text))

    def _call(self, statement: list[Token], arguments: list[Argument], line: int) -> None:
        """Take any other instruction."""
        name, by_name = statement[0].text, list[Token]()
        if late := name == "%":
            end = max(k for k, token in enumerate(statement) if token.text == "%")
            by_name, arguments = statement[1:end], syntax.arguments(statement[end + 1 :])
        positional = [a.tokens for a in arguments if not a.name]
        how = f"passed to {self._names.shown([statement[0]])}"
        named = any(len(t) == 1 and self._names.find(t[0].text) is not None for t in positional)
        routine = None if late or statement[0].kind != "word" else self._names.find_routine(name)
        like_motion = self._motions.unknown(statement, positional, line, known=routine is not None)
        if routine is None:
            self._names.read_by(statement[1:], line, how if named else "read")
        else:
            self._flow.step()
            for argument in give_points(routine, arguments, self._names, line):
                self._names.read_by(argument.tokens, line, how if named else "read")
            self._names.take(t for t in statement if t.kind == "word" and self._names.find(t.text) is None)
        self._names.hand_numbers(statement[1:])
        if name in LOADS:
            self._load(statement, line)
        elif name in ("SETDATAVAL", "SETALLDATAVAL", "GETDATAVAL"):
            self._by_name(name, positional, line)
        elif late or name == "CALLBYVAR":
            by_name = by_name if late else (positional or [[]])[0]
            self._late_call(by_name, by_number=not late, line=line)
            self._names.hand_over(None, arguments, line)
        elif statement[0].kind == "word":
            self._procedure(name, arguments, line, reads=like_motion or READING.fullmatch(name) is not None)
        else:
            self._names.hand_over(None, arguments, line)

    def _procedure(self, name: str, arguments: list[Argument], line: int, *, reads: bool) -> None:
        """Take a procedure of the task, or an instruction; `reads`: an instruction that only reads its arguments."""
        routine = self._names.find_routine(name)
        if routine is not None:
            self._flow.call(routine.key, "")
            self._names.hand_over(routine, arguments, line)
        elif not MOTION.fullmatch(name):
            elsewhere = name not in INSTRUCTIONS and not self._task.whole
            if elsewhere or not reads:
                self._names.hand_over(None, arguments, line)
            if elsewhere:
                self._unknown_call(f"{name}() was called, which is not in this file", line)

    def _late_call(self, expression: list[Token], *, by_number: bool, line: int) -> None:
        """Take a call whose procedure the run time names: any of those whose name may be meant."""
        start, exact = late_bound(expression)
        found = self._task.procedures(start, exact=exact and not by_number)
        if found:
            self._flow.call_one_of(found)
        if not (self._task.whole or (found and exact and not by_number)):
            self._unknown_call("a procedure is called by a name that only the run time knows", line)

    def _unknown_call(self, text: str, line: int) -> None:
        self._flow.may_move()
        if not self._options.calls_keep_frames:
            text = f"{text} ({at(self._names.place(line))})"
            self._flow.change(ipo=text, tool=InForce("call", text))

    def _load(self, statement: list[Token], line: int) -> None:
        """Note that a module is loaded at run time, unless it is among those at hand."""
        texts = [token.text[1:-1].replace("\\", "/") for token in statement if token.kind == "text"]
        name = texts[-1].rpartition("/")[2].rpartition(":")[2].lower() if texts else ""
        if name not in self._task.files and not self._task.loads:
            self._task.loads = f"{self._names.cased(statement[0])} ({at(self._names.place(line))})"

    def _by_name(self, name: str, positional: list[list[Token]], line: int) -> None:
        """Take an instruction that reads or writes data whose name is a text."""
        start, exact = late_bound(positional[0]) if positional and name != "SETALLDATAVAL" else ("", False)
        if name == "GETDATAVAL":
            for items in positional[1:]:
                self._names.change(items[0].text, line)
            self._task.read_by_name.append((start if exact else "", self._names.place(line)))
        elif exact:
            self._names.change(start, line)
            for variable in self._task.of_name(start):
                self._task.derivations.escape(variable, self._names.place(line), f"set by {name}")
                for point in variable.elements.values():
                    point.writes.append((self._names.place(line), f"set by {name}"))
        else:
            self._task.sets_by_name = self._names.place(line)
            for kind in ("tool", "base"):
                self._task.changed.setdefault((kind, None), self._names.place(line))

    def _assign(self, statement: list[Token], position: int, line: int) -> None:
        left, right = statement[:position], statement[position + 1 :]
        self._names.take(left[:1])
        self._names.read_by(left[1:], line)
        followed = assign(left, right, _braces(left), self._names, line)
        self._flow.step()
        if followed:
            self._names.take(right)
        else:
            self._names.read_by(right, line)
        name = left[0].text
        if self._names.find(name) is not None:
            how = "component set" if any(t.text == "." for t in left) else "assigned"
            self._names.write(name, line, how, syntax.constant_index(_braces(left)), followed=True)
        elif followed:
            pass
        elif len(left) == 1 or any(t.text in _PARTS for t in left):
            self._names.change(name, line)

    def _declare(self, statement: list[Token], *, inner: bool | None = None) -> None:
        """Take a declaration of a robtarget, a jointtarget, a tool or a workobject."""
        first, statement = statement[0].text, _without_scope(statement)
        local, shared = first == "LOCAL", first == "PERS"
        if len(statement) < 3 or statement[0].text not in DATA or statement[2].kind != "word":
            return
        kind, type_, name = statement[0].text, self._task.type_of(statement[1].text), statement[2].text
        inner = self._routine() if inner is None else inner
        scope = self._names.inner if inner else self._names.own if local else self._task.scope
        line = self.source.line(statement[0].start)
        position = syntax.position_of(":=", statement)
        parsed = syntax.value(statement[position + 1 :]) if position else []
        has_index = any(t.text == "{" for t in statement[: position or None])
        dimensions = sum(t.text == "," for t in statement[3:position]) + 1 if has_index else 0
        right = statement[position + 1 :] if position else []
        computed = any(token.kind == "word" for token in right)
        if computed and inner:
            self._names.call_in(right, line)
        elif computed:
            self._initial.append((right, line))
        if type_ == "NUM":
            values = number_values(parsed, dimensions) if kind != "PERS" else {}
            scope.numbers[name] = NumberVariable(self._names.cased(statement[2]), kind, values, array=has_index)
        if type_ not in _TARGET_TYPES:
            if inner or (local and type_ not in _FRAME_TYPES):
                scope.others.add(name)
            elif type_ in _FRAME_TYPES and not has_index:
                self._declare_frame(scope, type_, statement[2], parsed, line, shared=shared)
            if inner and right:
                self._set_first(statement[2], right, line, plain=type_ == "NUM" and not has_index)
            return
        joints = type_ == "JOINTTARGET"
        if (old := scope.points.get(name)) is not None and (joints or old.joints):
            for point in old.elements.values():
                point.writes.append((self._names.place(line), "declared a second time, and so set"))
            return
        if old is not None:
            text = f"{self._names.cased(statement[2])} is declared twice, first in {at(old.place)}; keep one"
            raise self.source.error(line, text + (" or give the files of one task at a time" * self._task.named))
        reach: Reach = "routine" if inner else "module" if local else "controller" if shared else "task"
        copy = inner and computed and not (joints or has_index or is_list(parsed))
        variable = RobtargetVariable(
            self._names.cased(statement[2]),
            self._names.place(line),
            "VAR" if copy else kind,  # a constant of a routine takes its value at each call
            reach,
            joints=joints,
            array=has_index,
        )
        scope.points[name] = variable
        self._task.variables.append(variable)
        if inner and computed:
            self._set_first(statement[2], right, line, plain=copy)
        if copy:
            return
        for index, element in syntax.elements(parsed, dimensions):
            self._element(variable, index, element, line)

    def _set_first(self, name: Token, right: list[Token], line: int, *, plain: bool) -> None:
        """Take the value that a routine gives its own data at each call."""
        if not plain or not assign([name], right, [], self._names, line):
            self._names.read_by(right, line)
        self._flow.step()

    def _declare_frame(self, scope: Scope, type_: str, token: Token, parsed: Value, line: int, *, shared: bool) -> None:
        kind, frame, problem = frame_data(type_.lower(), self._names.cased(token), parsed)
        if (old := scope.frames.get(token.text)) is not None:
            problem = problem or Problem("refuse", f"{frame.text} is declared twice ({at(old.place)}); keep one")
        scope.frames[token.text] = Datum(kind, frame, problem, self._names.place(line), shared)

    def _element(self, variable: RobtargetVariable, index: tuple[int, ...], element: Value, line: int) -> None:
        suffix = "{" + ",".join(map(str, index)) + "}" if index else ""
        if is_list(element):
            read = jointtarget if variable.joints else robtarget
            point = read(self.source, self._options, variable.name + suffix, element, line)
        elif element:
            problem = Problem("skip", "its value is known at run time only")
            point = Point(variable.name + suffix, self.source, line, problem=problem)
        else:
            return
        variable.elements[index] = point
        self._task.points.append(point)


def _without_scope(statement: list[Token]) -> list[Token]:
    scoped = statement[0].text in ("LOCAL", "TASK") and len(statement) > 1 and statement[1].kind == "word"
    return statement[1:] if scoped else statement


def _is_handler(statement: list[Token], *words: str) -> bool:
    return statement[0].text in words and (len(statement) == 1 or statement[1].text == "(")


def _module_name(statement: list[Token]) -> str:
    words = [token.text for token in statement if token.kind == "word"]
    k = words.index("MODULE") + 1
    return words[k] if k < len(words) else "?"


def _routine_name(head: list[Token]) -> str:
    return head[1 if head[0].text != "FUNC" else min(2, len(head) - 1)].text


def _braces(items: list[Token]) -> list[Token]:
    """Return the part in braces, braces included."""
    start = next((i for i, token in enumerate(items) if token.text == "{"), len(items))
    end = next((i for i, token in enumerate(items) if token.text == "}"), start)
    return items[start : end + 1]
