"""RAPID's motions: their targets, tools and workobjects."""

from __future__ import annotations

from truepose.programs.core.arithmetic import Shifted
from truepose.programs.core.points import JOINTS, Frame, Point, Problem, Use, computed, not_understood, unknown_motion
from truepose.programs.rapid import syntax
from truepose.programs.rapid.data import jointtarget, robtarget
from truepose.programs.rapid.names import ModuleNames, RapidMotion
from truepose.programs.rapid.shifted import goal_of
from truepose.programs.rapid.syntax import Argument, Token, is_list
from truepose.programs.rapid.words import ABSOLUTE, SPEED, TOOL_AFTER, WITHOUT_TRIGGER, ZONE

_CORRECTED_PATH = Problem("refuse", "\\Corr: a sensor shifts the path at run time")


class RapidMotionReader:
    """Reads the motions of one module."""

    def __init__(self, names: ModuleNames) -> None:
        self._names, self._task = names, names.task
        self._source, self._options = names.source, names.task.options

    def joint(self, statement: list[Token], arguments: list[Argument], line: int) -> None:
        """Take a motion to joints."""
        token, positional = statement[0], [a.tokens for a in arguments if not a.name]
        name = f"{self._names.cased(token)}:{line}"
        use = self._use(token.text, token, line)
        if token.text != ABSOLUTE or len(positional) < 2:
            self._names.read_by(statement[1:], line)
            self._add(Point(name, self._source, line, problem=JOINTS), use)
            return
        for items in [*positional[1:], *(a.tokens for a in arguments if a.name)]:
            self._names.read_by(items, line)
        tool, problem = self._frame("tooldata", self._tool_tokens(token.text, arguments, positional))
        goal, use = positional[0], use._replace(tool=tool, problem=problem)
        if is_list(parsed := syntax.value(goal)):
            self._names.read_by(goal, line)
            point = jointtarget(self._source, self._options, name, parsed, line)
            self._task.points.append(point)
            self._move(point, use)
        elif not self._named_joints(goal, use):
            self._names.read_by(goal, line)
            self._add(Point(name, self._source, line, problem=JOINTS), use)

    def _named_joints(self, items: list[Token], use: Use) -> bool:
        """Take a motion to a jointtarget by its name; False if no literal of that name is known."""
        variable = self._names.find(items[0].text) if items and items[0].kind == "word" else None
        plain = len(items) == 1 or (items[1:2] and items[1].text == "{" and items[-1].text == "}")
        if variable is None or not plain:
            return False
        self._names.take(items[:1])
        self._names.read_by(items[1:], self._source.line(items[0].start))
        index = syntax.constant_index(items[1:])
        found = [point for key, point in variable.elements.items() if index is None or key == index]
        for point in found:
            self._move(point, use)
        return bool(found)

    def unknown(self, statement: list[Token], positional: list[list[Token]], line: int, *, known: bool) -> bool:
        """Refuse an instruction that looks like a motion; return whether it does.

        `known`: a procedure of the task, whose own motions are read.
        """
        literal = any(syntax.looks_like_robtarget(syntax.value(tokens)) for tokens in positional)
        shape = any(len(t) == 1 and ZONE.fullmatch(t[0].text) for t in positional) and any(
            len(t) == 1 and SPEED.fullmatch(t[0].text) for t in positional
        )
        like_motion = literal or (shape and len(positional) > 3 and not known)
        if like_motion:
            word = self._names.cased(statement[0])
            problem = unknown_motion(self._names.shown(statement))
            point = Point(f"{word}:{line}", self._source, line, problem=problem)
            self._add(point, self._use(word, statement[0], line))
        return like_motion

    def read(self, token: Token, circle: bool, arguments: list[Argument], line: int) -> None:
        """Take a motion."""
        word = self._names.cased(token)
        positional = [a.tokens for a in arguments if not a.name]
        if token.text.startswith("SEARCH"):
            if len(positional) > 1:
                found_at = positional[1]
                self._names.take(found_at[:1])
                self._names.read_by([*positional[0], *found_at[1:]], line)
                index = syntax.constant_index(found_at[1:])
                self._names.write(found_at[0].text, line, f"found by {word}", index)
            positional = positional[2:]
        goals = 2 if circle else 1
        if len(positional) < goals + 2 or any(argument.required for argument in arguments):
            for argument in arguments:
                self._names.read_by(argument.tokens, line)
            problem = not_understood(self._names.shown([token]))
            self._add(Point(f"{word}:{line}", self._source, line, problem=problem), self._use(word, token, line))
            return
        for items in [*positional[goals:], *(a.tokens for a in arguments if a.name)]:
            self._names.read_by(items, line)
        use = self._framed(token, arguments, positional[goals - 1 :], line)
        uses = [use, use._replace(order=use.order + 1)][:goals]
        found = [self._goal(positional[k], line, use, k, goals) for k, use in enumerate(uses)]
        if circle:
            self._task.circles += [[a, b] for a in found[0] for b in found[1]] or [found[0] + found[1]]

    def use_of(self, statement: list[Token], arguments: list[Argument], line: int) -> Use:
        """Return a plain motion, whatever its goal."""
        positional = [a.tokens for a in arguments if not a.name]
        for items in [*positional[1:], *(a.tokens for a in arguments if a.name)]:
            self._names.read_by(items, line)
        return self._framed(statement[0], arguments, positional, line)

    def _framed(self, token: Token, arguments: list[Argument], after_goal: list[list[Token]], line: int) -> Use:
        """Return a motion with its tool and workobject."""
        tool, tool_problem = self._frame("tooldata", self._tool_tokens(token.text, arguments, after_goal))
        wobj_tokens = next((a.tokens for a in arguments if a.name == "WOBJ"), None)
        wobj: Frame | None = Frame("wobj0", 0)
        wobj_problem: Problem | None = None
        if wobj_tokens is not None:
            wobj, wobj_problem = self._frame("wobjdata", wobj_tokens)
        shifted = _CORRECTED_PATH if any(a.name == "CORR" for a in arguments) else None
        return self._use(self._names.cased(token), token, line)._replace(
            tool=tool, frame=wobj, problem=tool_problem or wobj_problem or shifted
        )

    def _tool_tokens(self, name: str, arguments: list[Argument], after_goal: list[list[Token]]) -> list[Token]:
        positions = [i for i, a in enumerate(arguments) if a.name == "WOBJ"]
        if positions:
            before = [a.tokens for a in arguments[: positions[0]] if not a.name]
            return before[-1] if before else []
        family = next((f for f in TOOL_AFTER if name.startswith(f)), "")
        place = 3 if name in WITHOUT_TRIGGER else TOOL_AFTER.get(family, 0)
        if 0 < place < len(after_goal):
            return after_goal[place]
        zones = [i for i, tokens in enumerate(after_goal[:-1]) if len(tokens) == 1 and ZONE.fullmatch(tokens[0].text)]
        return after_goal[zones[-1] + 1] if zones else after_goal[-1]

    def _frame(self, kind: str, items: list[Token]) -> tuple[Frame | None, Problem | None]:
        """Return the tool or workobject that an argument names, and the reason why it cannot be used."""
        what = "tool" if kind == "tooldata" else "workobject"
        if len(items) != 1 or items[0].kind != "word" or self._names.is_hidden(items[0].text):
            shown = "of the caller" if [t.text for t in items[:1]] in ([], ["?"]) else self._names.shown(items)
            return None, Problem("refuse", f"{what} {shown} is known at run time only")
        name = items[0].text
        if name in ("TOOL0", "WOBJ0"):
            return Frame(name.lower(), 0), None
        datum = self._names.find_frame(name)
        if datum is not None and datum.kind == kind:
            return datum.frame, datum.problem
        text = self._names.cased(items[0])
        return Frame(text, text), None

    def _goal(self, items: list[Token], line: int, use: Use, k: int, goals: int) -> list[Point]:
        """Take the goal of a motion; return the points that it may be."""
        suffix = ("", "") if goals == 1 else (" auxiliary", " end")
        name = f"{use.word}:{line}{suffix[k]}"
        parsed = syntax.value(items)
        if is_list(parsed):
            self._names.read_by(items, line)
            point = robtarget(self._source, self._options, name, parsed, line)
            self._move(point, use)
            self._task.points.append(point)
            return [point]
        if items and items[0].kind == "word" and (len(items) == 1 or (items[1].text == "{" and items[-1].text == "}")):
            return self._named(items, name, line, use, circle=goals > 1)
        point = Point(name, self._source, line, problem=computed(self._names.shown(items)))
        goal = goal_of(items, self._names)
        if isinstance(goal, Shifted):
            self._names.take(items)
            self._task.derivations.move(point, goal, use, self._task.flow.node)
        else:
            self._names.read_by(items, line)
        return [self._add(point, use)]

    def _named(self, items: list[Token], name: str, line: int, use: Use, *, circle: bool) -> list[Point]:
        self._names.take(items[:1])
        self._names.read_by(items[1:], line)
        variable = self._names.find(items[0].text)
        if variable is None:
            known = self._names.is_inner(items[0].text)
            reason = "target known at run time only" if known else "declared in another module"
            point = Point(self._names.cased(items[0]), self._source, line, problem=Problem("skip", reason))
            return [self._add(point, use)]
        index = syntax.constant_index(items[1:])
        unknown = Problem("skip", "its value is known at run time only")
        follower = Point(self._names.shown(items), self._source, line, problem=unknown)
        goal = goal_of(items, self._names)
        if not variable.elements:
            if goal is not None:
                self._task.derivations.move(follower, goal, use, self._task.flow.node)
            return [self._add(follower, use)]
        found = [p for key, p in variable.elements.items() if index is None or key == index]
        if not found:
            point = Point(name, self._source, line, problem=Problem("refuse", f"{variable.name} has no such element"))
            return [self._add(point, use)]
        for point in found:
            self._move(point, use)
        if variable.kind != "CONST":
            if goal is None or circle:
                self._task.derivations.escape(variable, self._names.place(line), "moved to in a way that is not known")
            else:
                self._task.derivations.move(follower, goal, use, self._task.flow.node, tuple(found))
        return found

    def _use(self, word: str, token: Token, line: int) -> Use:
        return Use(word, self._names.place(line), section=self._task.flow.motion(), order=token.start)

    def _add(self, point: Point, use: Use) -> Point:
        point.uses.append(use)
        self._task.points.append(point)
        return point

    def _move(self, point: Point, use: Use) -> None:
        self._task.moves.append(RapidMotion(point, use, self._task.flow.node))
