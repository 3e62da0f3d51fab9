"""Statements of RAPID that shift robtargets: assignments, Offs and RelTool, and loops that count."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from truepose.programs.core.arithmetic import UNKNOWN as UNKNOWN_VALUE
from truepose.programs.core.arithmetic import (
    ArithmeticReader,
    Coordinate,
    Expression,
    NotArithmetic,
    Number,
    Opaque,
    Shifted,
    Variable,
    evaluate,
    names_in,
)
from truepose.programs.core.graph import Counter
from truepose.programs.rapid import syntax
from truepose.programs.rapid.derived import NumberVariable
from truepose.programs.rapid.names import ModuleNames, Routine
from truepose.programs.rapid.syntax import Argument, Token
from truepose.programs.rapid.words import OFFSETS

UNKNOWN: Final = Opaque(())
_AXES: Final = {"TRANS.X": 0, "TRANS.Y": 1, "TRANS.Z": 2}


def goal_of(items: Sequence[Token], names: ModuleNames) -> Expression | None:
    """Return the expression of a robtarget: a variable, an element, Offs or RelTool; None for another."""
    own = bool(items) and names.find_routine(items[0].text) is not None
    if len(items) > 3 and items[0].text in OFFSETS and not own and items[1].text == "(" and items[-1].text == ")":
        pieces = syntax.split(list(items[2:-1]))
        inner = goal_of(pieces[0], names) if len(pieces) == 4 else None
        shift = [arithmetic(piece, names) for piece in pieces[1:]]
        if inner is None or any(one is None for one in shift):
            return None
        x, y, z = (one for one in shift if one is not None)
        return Shifted(inner, (x, y, z), "frame" if items[0].text == "OFFS" else "tool")
    found = arithmetic(items, names)
    return found if isinstance(found, Variable) and names.find(items[0].text) is not None else None


def arithmetic(items: Sequence[Token], names: ModuleNames) -> Expression | None:
    """Return an expression of sums and products; None where it is another."""
    known = names.task.derivations

    def named(word: str, indices: Sequence[Expression], path: str) -> Expression:
        places = tuple([int(one.value) for one in indices if isinstance(one, Number) and one.value % 1 == 0])
        constant = len(places) == len(indices)
        if (point := names.find(word)) is not None:
            if point.array and not indices:
                raise NotArithmetic
            whole: Expression = Variable(known.name(point, places))
            if not constant:
                whole = Variable(known.name(point), tuple(indices))
            if not path:
                return whole
            return Coordinate(whole, _AXES[path]) if path in _AXES else Opaque((whole,))
        number = None if path else names.find_number(word)
        if number is None:
            return Opaque(tuple(indices))
        if number.array and not indices:
            raise NotArithmetic
        if number.kind == "CONST" and constant and places in number.values:
            return Number(number.values[places])
        return Variable(known.name(number, places)) if constant else Variable(known.name(number), tuple(indices))

    try:
        return ArithmeticReader(" ".join(token.text for token in items), named, "{}").read()
    except NotArithmetic:
        return None


def counter_of(items: Sequence[Token], names: ModuleNames) -> tuple[NumberVariable, Counter] | None:
    """Return the counter of ``i FROM 1 TO 5 STEP 1 DO``; None where its bounds are not understood.

    A loop without STEP counts down if its bounds say so, which must be known here.
    """
    marks = {token.text: k for k, token in enumerate(items) if token.kind == "word"}
    start, end, done = marks.get("FROM", 0), marks.get("TO", 0), marks.get("DO", len(items))
    step_at = marks.get("STEP", done)
    if start != 1 or not start < end < step_at <= done:
        return None
    first, last = arithmetic(items[start + 1 : end], names), arithmetic(items[end + 1 : step_at], names)
    step = arithmetic(items[step_at + 1 : done], names) if step_at < done else Number(1.0)
    if first is None or last is None or step is None:
        return None
    if step_at == done:
        bounds = [evaluate(one, lambda _: UNKNOWN_VALUE) for one in (first, last)]
        known = [bound for bound in bounds if isinstance(bound, float)]
        if len(known) < 2:
            return None
        step = Number(1.0 if known[1] >= known[0] else -1.0)
    variable = NumberVariable(items[0].text, "VAR", {})
    return variable, Counter(names.task.derivations.name(variable), first, last, step)


def give_points(routine: Routine, arguments: Sequence[Argument], names: ModuleNames, line: int) -> list[Argument]:
    """Note the robtargets of which a routine gets copies; return the other arguments."""
    if any(argument.required for argument in arguments):
        return list(arguments)
    required = [parameter for parameter in routine.parameters if not parameter.optional]
    others = [argument for argument in arguments if argument.name]
    known = names.task.derivations
    for k, argument in enumerate(argument for argument in arguments if not argument.name):
        goal = None
        if k < len(required) and required[k].is_point:
            goal = goal_of(argument.tokens, names)
            copy = known.name(names.task.parameter(routine.key, required[k].name))
            known.derivations.assign(copy, goal or UNKNOWN, names.place(line), point=True)
        if goal is None:
            others.append(argument)
        else:
            names.take(argument.tokens)
            known.assigned.append((goal, names.place(line)))
    return others


def assign(left: list[Token], right: list[Token], braces: list[Token], names: ModuleNames, line: int) -> bool:
    """Note an assignment; return whether its right side is followed, so that it reads nothing else.

    `braces` are those of the left side.
    """
    known, name, place = names.task.derivations, left[0].text, names.place(line)
    index = syntax.constant_index(braces)
    path = "".join(token.text for token in left[1 + len(braces) :]).lstrip(".")
    variable = names.find(name)
    if variable is None:
        number = names.find_number(name)
        if number is None or number.kind == "CONST":
            return False
        plain = len(left) == 1 and not number.array
        found = arithmetic(right, names) if plain else None
        number.handed = number.handed or not plain
        known.derivations.assign(known.name(number), found or UNKNOWN, place)
        return found is not None and not known.reads_point(found)
    if index is None or variable.joints or (variable.array and not braces):
        known.escape(variable, place, "assigned")
        return False
    private = variable.reach in ("routine", "module") or (variable.reach == "task" and names.task.whole)
    found = (arithmetic(right, names) if path else goal_of(right, names)) if private else None
    target = known.name(variable, index)
    if not path:
        known.derivations.assign(target, found or UNKNOWN, place, point=True)
    elif found is not None and path in _AXES:
        known.derivations.assign(target, found, place, _AXES[path])
    else:
        reads = (Variable(target),) if found is None else (Variable(target), found)
        known.derivations.assign(target, Opaque(reads), place, point=True)
    if found is not None:
        known.assigned.append((found, place))
    if found is not None and target in names_in(found):
        known.read_itself.append((variable, place))
    return found is not None
