"""Change single places of a source: comparisons, conditions, operators, numbers, results, calls.

Positions are those of the syntax tree, so a mutant differs from the source in one place only. Texts of messages,
documentation, annotations, decorators, assertions and the construction of errors are left alone.
"""

from __future__ import annotations

import ast
import hashlib
import random
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

COMPARED: Final[dict[type[ast.cmpop], tuple[str, tuple[str, ...]]]] = {
    ast.Lt: ("<", ("<=", ">")),
    ast.LtE: ("<=", ("<", ">=")),
    ast.Gt: (">", (">=", "<")),
    ast.GtE: (">=", (">", "<=")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: (r"is\s+not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: (r"not\s+in", ("in",)),
}
JOINED: Final[dict[type[ast.boolop], tuple[str, str]]] = {ast.And: ("and", "or"), ast.Or: ("or", "and")}
CALCULATED: Final[dict[type[ast.operator], tuple[str, str]]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"),
    ast.Pow: ("**", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
}
_LEFT_ALONE: Final = (ast.JoinedStr, ast.Raise, ast.Assert)
_NO_FIELDS: Final = ("annotation", "returns", "decorator_list", "type_params")
_FUNCTIONS: Final = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class Mutant:
    """A change of one place of a file.

    Attributes
    ----------
    file : str
        The file below the package.
    functions : tuple of str
        The qualified names of the functions in which the change has an effect; empty if it may be any of the file.
    start, end, new : int, int, str
        The changed bytes of the file, and what they become.
    line, before, after : int, str, str
        The number of the first changed line, and the lines before and after, joined with single blanks.
    nth : int
        The number of equal changes before it in the file.
    """

    file: str
    functions: tuple[str, ...]
    start: int
    end: int
    new: str
    line: int
    before: str
    after: str
    nth: int

    @property
    def key(self) -> str:
        """A short name of the change, which lines elsewhere in the file do not change."""
        text = "\n".join((self.file, str(self.nth), self.before, self.after))
        return hashlib.sha256(text.encode()).hexdigest()[:12]

    def apply(self, source: bytes) -> bytes:
        """Return the changed source."""
        return source[: self.start] + self.new.encode() + source[self.end :]


class _Finder:
    """Finds the changes of one file."""

    def __init__(self, file: str, source: bytes) -> None:
        self._file, self._source = file, source
        self._tree = ast.parse(source)
        self._starts = [0, *(i + 1 for i, byte in enumerate(source) if byte == ord("\n"))]
        self._function: tuple[str, ...] = ()
        self._names: list[str] = []
        self._readers = _readers(self._tree)
        self._found: list[Mutant] = []
        self._equal: dict[tuple[str, str], int] = {}

    def find(self) -> list[Mutant]:
        """Return the changes."""
        for statement in self._tree.body:
            targets = _assigned(statement)
            private = len(targets) == 1 and targets[0].startswith("_")
            self._function = self._readers.get(targets[0], ()) if private else ()
            self._visit(statement)
        return self._found

    def _span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = self._starts[node.lineno - 1] + node.col_offset
        return start, self._starts[node.end_lineno - 1] + node.end_col_offset

    def _text(self, node: ast.expr) -> str:
        start, end = self._span(node)
        return self._source[start:end].decode()

    def _add(self, start: int, end: int, new: str) -> None:
        line = self._source.count(b"\n", 0, start)
        first, last = self._starts[line], self._source.find(b"\n", end)
        last = len(self._source) if last < 0 else last
        before = self._source[first:last]
        after = self._source[first:start] + new.encode() + self._source[end:last]
        if before != after:
            texts = " ".join(before.decode().split()), " ".join(after.decode().split())
            nth = self._equal[texts] = self._equal.get(texts, -1) + 1
            self._found.append(Mutant(self._file, self._function, start, end, new, line + 1, *texts, nth))

    def _replace(self, node: ast.expr | ast.stmt, *texts: str) -> None:
        for text in texts:
            self._add(*self._span(node), text)

    def _between(self, left: ast.expr, right: ast.expr, pattern: str, *texts: str) -> None:
        """Replace an operator between two operands."""
        start, end = self._span(left)[1], self._span(right)[0]
        gap = re.sub(rb"#[^\n]*", lambda comment: b" " * len(comment.group()), self._source[start:end])
        found = re.search(pattern.encode(), gap)
        assert found is not None
        for text in texts:
            self._add(start + found.start(), start + found.end(), text)

    def _visit(self, node: ast.AST) -> None:
        if isinstance(node, _LEFT_ALONE) or (isinstance(node, ast.If) and _is_type_checking(node.test)):
            return
        if isinstance(node, (*_FUNCTIONS, ast.ClassDef)):
            self._enter(node)
            return
        if isinstance(node, ast.keyword) and node.arg == "strict":  # a check of lengths, as an assertion
            return
        if isinstance(node, ast.IfExp) and any(_is_message(one) for one in (node.body, node.orelse)):
            return
        change = getattr(self, f"_change_{type(node).__name__}", None)
        if change is not None:
            change(node)
        self._visit_fields(node)

    def _visit_fields(self, node: ast.AST) -> None:
        for name, value in ast.iter_fields(node):
            if name not in _NO_FIELDS:
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        self._visit(child)

    def _enter(self, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> None:
        before = self._function
        self._names.append(node.name)
        if isinstance(node, _FUNCTIONS):
            self._function = (".".join(self._names),)
        self._visit_fields(node)
        self._names.pop()
        self._function = before

    def _change_Compare(self, node: ast.Compare) -> None:  # noqa: N802 (as the nodes of ast)
        operands = [node.left, *node.comparators]
        for (left, right), operator in zip(pairwise(operands), node.ops, strict=True):
            pattern, texts = COMPARED[type(operator)]
            self._between(left, right, pattern, *texts)

    def _change_BoolOp(self, node: ast.BoolOp) -> None:  # noqa: N802
        pattern, text = JOINED[type(node.op)]
        for left, right in pairwise(node.values):
            self._between(left, right, pattern, text)

    def _change_UnaryOp(self, node: ast.UnaryOp) -> None:  # noqa: N802
        start, _ = self._span(node)
        if operator := re.compile(rb"not\s*|[~-]").match(self._source, start):
            self._add(start, operator.end(), "")

    def _change_BinOp(self, node: ast.BinOp) -> None:  # noqa: N802
        alias = not self._names and isinstance(node.op, ast.BitOr)
        if not alias and not _is_text(node.left) and not _is_text(node.right) and type(node.op) in CALCULATED:
            operator, text = CALCULATED[type(node.op)]
            self._between(node.left, node.right, re.escape(operator), text)

    def _change_AugAssign(self, node: ast.AugAssign) -> None:  # noqa: N802
        if not _is_text(node.value) and type(node.op) in CALCULATED:
            operator, text = CALCULATED[type(node.op)]
            self._between(node.target, node.value, re.escape(f"{operator}="), f"{text}=")

    def _change_Constant(self, node: ast.Constant) -> None:  # noqa: N802
        value = node.value
        if isinstance(value, bool):
            self._replace(node, str(not value))
        elif isinstance(value, int):
            self._replace(node, str(value + 1), *([str(value - 1)] if value > 0 else []))
        elif isinstance(value, float):
            factor = 100.0 if "e" in self._text(node).lower() else 2.0  # a tolerance is an order of magnitude
            self._replace(node, *([f"{value * factor:.12}", f"{value / factor:.12}"] if value else ["1.0"]))

    def _change_Return(self, node: ast.Return) -> None:  # noqa: N802
        if node.value is not None and not (isinstance(node.value, ast.Constant) and node.value.value is None):
            self._replace(node.value, "None")

    def _condition(self, test: ast.expr, *texts: str) -> None:
        if not isinstance(test, ast.Constant):
            self._replace(test, *texts)

    def _change_If(self, node: ast.If) -> None:  # noqa: N802
        self._condition(node.test, "True", "False")

    def _change_IfExp(self, node: ast.IfExp) -> None:  # noqa: N802
        self._condition(node.test, "True", "False")

    def _change_While(self, node: ast.While) -> None:  # noqa: N802
        self._condition(node.test, "False")

    def _change_comprehension(self, node: ast.comprehension) -> None:
        for test in node.ifs:
            self._condition(test, "True", "False")

    def _change_Continue(self, node: ast.Continue) -> None:  # noqa: N802
        self._replace(node, "break")

    def _change_Break(self, node: ast.Break) -> None:  # noqa: N802
        self._replace(node, "continue", "pass")

    def _change_Expr(self, node: ast.Expr) -> None:  # noqa: N802
        if isinstance(node.value, ast.Call):
            self._replace(node, "pass")


def mutants(file: str, source: bytes) -> list[Mutant]:
    """Return all changes of a file."""
    return _Finder(file, source).find()


def sample(changes: Iterable[Mutant], sources: dict[str, bytes], seed: int, number: int) -> list[Mutant]:
    """Return so many changes, equally many of each file and of as many lines as there are; a part of any larger sample.

    Changes that are not valid Python are left out.
    """
    files: dict[str, dict[int, list[Mutant]]] = defaultdict(lambda: defaultdict(list))
    for one in changes:
        files[one.file][one.line].append(one)
    ordered = [_in_turn(_shuffled(lines.values(), f"{seed} {file}")) for file, lines in files.items()]
    found: list[Mutant] = []
    while ordered and len(found) < number:
        for stream in list(ordered):
            chosen = next((one for one in stream if _is_valid(one, sources[one.file])), None)
            if chosen is None:
                ordered.remove(stream)
            elif len(found) < number:
                found.append(chosen)
    return found


def _shuffled(lines: Iterable[list[Mutant]], seed: str) -> list[list[Mutant]]:
    chance = random.Random(seed)
    groups = [chance.sample(line, len(line)) for line in lines]
    chance.shuffle(groups)
    return groups


def _in_turn(groups: list[list[Mutant]]) -> Iterator[Mutant]:
    """Yield the first of each group, then the second of each, and so on."""
    for k in range(max(map(len, groups), default=0)):
        yield from (group[k] for group in groups if k < len(group))


def _is_valid(mutant: Mutant, source: bytes) -> bool:
    try:
        compile(mutant.apply(source), mutant.file, "exec", dont_inherit=True)
    except SyntaxError:
        return False
    return True


def _is_type_checking(test: ast.expr) -> bool:
    return isinstance(test, ast.Name) and test.id == "TYPE_CHECKING"


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes)))


def _is_message(node: ast.expr) -> bool:
    """Return whether a text is part of a message, not a name of something."""
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and node.value == "")


def _assigned(statement: ast.stmt) -> list[str]:
    """Return the names that a statement assigns."""
    targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
    return [target.id for target in targets if isinstance(target, ast.Name)]


def _readers(tree: ast.Module) -> dict[str, tuple[str, ...]]:
    """Return the functions that read each name, directly or through other names of the file.

    A name that is read outside of functions and assignments (by a class) has none: any function may depend on it.
    """
    functions: dict[str, set[str]] = defaultdict(set)
    passed: dict[str, set[str]] = defaultdict(set)

    def read(node: ast.AST, path: tuple[str, ...], inside: bool, targets: list[str]) -> None:
        if isinstance(node, (*_FUNCTIONS, ast.ClassDef)):
            path = (*path, node.name)
            inside = inside or isinstance(node, _FUNCTIONS)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
            if inside or not targets:
                functions[node.id].add(".".join(path) if inside else "")
            else:
                passed[node.id].update(targets)
        for child in ast.iter_child_nodes(node):
            read(child, path, inside, targets)

    for statement in tree.body:
        read(statement, (), False, _assigned(statement))
    found = {}
    for name in {*functions, *passed}:
        names, waiting = {name}, [name]
        while waiting:
            more = passed[waiting.pop()] - names
            names |= more
            waiting += more
        some = set().union(*(functions[one] for one in names))
        found[name] = () if "" in some else tuple(sorted(some))
    return found
