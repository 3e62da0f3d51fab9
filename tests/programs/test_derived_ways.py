"""Random programs: what is found to be derived, against an interpreter that takes every branch at random."""

from __future__ import annotations

import random
from typing import Any

import pytest

POSE = "{X 812.5,Y -40.25,Z 1033.0,A 90.0,B 10.0,C -170.0}"
POINTS = f"DECL E6POS XP1={POSE}\nDECL E6POS XP2={POSE}\n"
HEAD = "DECL E6POS XA,XB\nINT i,j\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[1]\n"
AXES = "XYZ"
LOST = "depends on data"
Block = list[tuple[Any, ...]]
START: Block = [("copy", "XA", "XP1"), ("copy", "XB", "XP2")]


def block(choose: random.Random, depth: int = 0) -> Block:
    """Return random statements; loops and branches at most two deep."""
    return [statement(choose, depth) for _ in range(choose.randint(1, 4))]


def statement(choose: random.Random, depth: int) -> tuple[Any, ...]:
    kinds = {"copy": 5, "add": 4, "count": 3 * (depth > 0), "move": 6, "if": 2 * (depth < 2), "for": 3 * (depth < 2)}
    kind = choose.choices(list(kinds), list(kinds.values()))[0]
    name = choose.choice(["XA", "XB"])
    if kind == "copy":
        return kind, name, choose.choice(["XA", "XB", "XP1", "XP2"])
    if kind == "add":
        return kind, name, choose.randrange(3), choose.choice([5, 10, -5])
    if kind == "count":
        return kind, name, choose.randrange(3), choose.choice("ij"[:depth])
    if kind == "if":
        return kind, block(choose, depth + 1), block(choose, depth + 1)
    if kind == "for":
        return kind, "ij"[depth], choose.randint(0, 2), choose.randint(0, 3), block(choose, depth + 1)
    return kind, name


def text(statements: Block) -> str:
    """Return the statements as KRL."""
    lines = []
    for kind, *parts in statements:
        if kind == "copy":
            lines.append(f"{parts[0]} = {parts[1]}\n")
        elif kind in ("add", "count"):
            part = f"{parts[0]}.{AXES[parts[1]]}"
            lines.append(f"{part} = {part} + {parts[2]}{'*3' if kind == 'count' else ''}\n")
        elif kind == "move":
            lines.append(f"LIN {parts[0]}\n")
        elif kind == "if":
            lines.append(f"IF $IN[1] THEN\n{text(parts[0])}ELSE\n{text(parts[1])}ENDIF\n")
        else:
            lines.append(f"FOR {parts[0]} = {parts[1]} TO {parts[2]}\n{text(parts[3])}ENDFOR\n")
    return "".join(lines)


def run(statements: Block, values: dict[str, Any], choose: random.Random, seen: set[Any]) -> None:
    """Run statements; add (point, shift) of each motion to `seen`."""
    for kind, *parts in statements:
        if kind == "copy":
            own = parts[1] in ("XP1", "XP2")
            values[parts[0]] = (parts[1], (0, 0, 0)) if own else values.get(parts[1])
        elif kind in ("add", "count") and values.get(parts[0]) is not None:
            source, shift = values[parts[0]]
            by = parts[2] if kind == "add" else values.get(parts[2])
            if by is None or shift == LOST:
                values[parts[0]] = source, LOST
            else:
                moved = list(shift)
                moved[parts[1]] += by * (3 if kind == "count" else 1)
                values[parts[0]] = source, tuple(moved)
        elif kind == "move" and values.get(parts[0]) is not None:
            seen.add(values[parts[0]])
        elif kind == "if":
            run(parts[choose.randrange(2)], values, choose, seen)
        elif kind == "for":
            values[parts[0]] = parts[1]
            while values[parts[0]] <= parts[2]:
                run(parts[3], values, choose, seen)
                values[parts[0]] += 1


@pytest.mark.promise("No position to which a program moves is missing among those at which a correction is checked.")
@pytest.mark.parametrize("seed", range(40))
def test_every_position_is_found(seed: int, read: Any) -> None:
    statements = START + block(random.Random(seed)) + block(random.Random(1000 + seed))
    program = read(f"{HEAD}{text(statements)}LIN XP1\nLIN XP2\n", POINTS, derived=True)
    corrected = {t.name: t for t in program.targets if t.verdict == "correct"}
    found = {(name, shift) for name, t in corrected.items() for one in t.derived for shift in one.shifts}
    seen: set[Any] = set()
    for k in range(30):
        run(statements, {}, random.Random(k), seen)
    for source, shift in seen:
        if source in corrected:
            assert shift != LOST
            assert (source, tuple(map(float, shift))) in found


def test_many_are_corrected(read: Any) -> None:
    corrected = 0
    for seed in range(12):
        statements = START + block(random.Random(seed)) + block(random.Random(1000 + seed))
        program = read(f"{HEAD}{text(statements)}LIN XP1\nLIN XP2\n", POINTS, derived=True)
        corrected += sum(t.verdict == "correct" and bool(t.derived) for t in program.targets)
    assert corrected > 10
