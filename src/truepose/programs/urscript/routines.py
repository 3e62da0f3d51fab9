"""The functions and threads of a program, and which variables are their own."""

from __future__ import annotations

from itertools import chain

from truepose.programs.core.forms import RunFinder
from truepose.programs.core.source import Source
from truepose.programs.urscript.syntax import (
    ASSIGN,
    BLOCK,
    NAME,
    ROUTINE,
    RUN,
    WORD,
    Statement,
    arguments,
    split,
    statements,
)


class Routines:
    """The routines of a file; a FileError names the line if their blocks are broken.

    Parameters
    ----------
    source : Source
        The file.

    Attributes
    ----------
    bodies : dict of str to list of Statement
        The statements of each routine, those of the file itself under an empty name.
    parameters : dict of str to list of str
        The parameters of each function.
    threads : list of str
        The names of the threads.
    defaults : dict of str to list of Statement
        The expressions that parameters of each routine have by default.
    outer : dict of str to str
        The routine around each.
    replaced : list of str
        The functions that are defined again below, so that these definitions never count.
    own : set of str
        The keys of all variables that the program assigns or has as parameters.
    current : str
        The routine that is being read.
    """

    def __init__(self, source: Source) -> None:
        self.bodies: dict[str, list[Statement]] = {"": []}
        self.parameters: dict[str, list[str]] = {}
        self.threads: list[str] = []
        self.own: set[str] = set()
        self.current = ""
        self.defaults: dict[str, list[Statement]] = {"": []}
        self.outer: dict[str, str] = {}
        self._locals: dict[str, set[str]] = {"": set()}
        self.replaced: list[str] = []
        self._optional: set[str] = set()
        self._owners: dict[str, str] = {}
        self._first: dict[str, list[str]] = {}
        self._source = source
        self._read()

    def _read(self) -> None:
        error, stack = self._source.error, list[tuple[str, str, int]]()
        found = statements(self._source, RunFinder(self._source, RUN).find)
        whole = list(chain.from_iterable(map(split, found)))
        last = {m[2].decode(): s.start for s in whole if (m := ROUTINE.match(s.code))}
        for statement in whole:
            code, line = statement.code, statement.line
            owner = next((name for kind, name, _ in reversed(stack) if kind == "def"), "")
            word = m[1] if (m := WORD.match(code)) else b""
            if (m := ROUTINE.match(code)) and code.rstrip().endswith(b":"):
                name = m[2].decode()
                if self._owners.setdefault(name, owner) != owner or name in self.bodies:
                    raise error(line, f"{name} is defined twice; give one another name")
                if last[name] != statement.start:  # the controller takes the last one
                    name = f"{name} (line {line})"
                    self.replaced.append(name)
                self._begin(m[1], name, owner, statement, m.end())
                stack.append(("def", name, line))
            elif word == b"end" and code.strip() == b"end":
                if not stack:
                    raise error(line, "end closes nothing; correct the file")
                kind, name, _ = stack.pop()
                if kind != "def":
                    self.bodies[owner].append(statement)
            else:
                if word in (b"if", b"while") and BLOCK.match(code):
                    stack.append((word.decode(), "", line))
                self.bodies[owner].append(statement)
        if stack:
            kind, name, line = stack[-1]
            raise error(line, f"{kind} {name}".strip() + " has no end: the file is truncated")
        self._different = any(any(self._locals[owner]) for owner in self.outer.values())

    def _begin(self, word: bytes, name: str, owner: str, statement: Statement, start: int) -> None:
        code = statement.code
        parameters = []
        self.bodies[name], self.defaults[name] = [], []
        for a, b in arguments(code, start):
            key, sign, _ = code[a:b].partition(b"=")
            parameters.append(key.decode("latin-1").strip())
            if sign:
                self._optional.add(f"{name}.{parameters[-1]}")
                a += len(key) + 1
                self.defaults[name].append(statement._replace(start=statement.start + a, code=code[a:b]))
        self.outer[name] = owner
        self._locals[name] = set(parameters)
        self.own |= {f"{name}.{parameter}" for parameter in parameters}
        if word == b"thread":
            self.threads.append(name)
        elif word == b"def":
            self.parameters[name] = parameters

    def passed(self) -> list[str]:
        """Return the keys of the parameters that every call must pass."""
        found = [f"{routine}.{name}" for routine, names in self.parameters.items() for name in names]
        return [key for key in found if key not in self._optional]

    def key(self, name: str) -> str:
        """Return the variable that a name means here: that of the routine if it is its own, else of the program."""
        routine = self.current
        while routine and name not in self._locals[routine]:
            routine = self.outer[routine]
        return f"{routine}.{name}" if routine else name

    def others(self, name: str) -> list[str]:
        """Return other variables that a name may mean here.

        The manual says that a function inside another sees the variables of the program, not those of the other one,
        and that local variables of the program itself are seen by all functions.
        """
        if not self._different:
            return []
        key = self.key(name)
        if key == name:
            return [f"{routine}.{name}" for routine in self._first.get(name, [])]
        return [] if key == f"{self.current}.{name}" else [name]

    def declare_locals(self) -> list[tuple[str, int, str]]:
        """Note the local variables; return the outer variables that they hide, as (key, line, how)."""
        hidden = []
        for routine, body in self.bodies.items():
            for statement in body:
                if routine and (m := ASSIGN.match(statement.code)) and m[1] == b"local":
                    self.current = self.outer[routine]
                    hidden.append((self.key(m[2].decode()), statement.line, "hidden by a local variable"))
                    self._locals[routine].add(m[2].decode())
                    self._different = True
                    if not self.current:
                        self._first.setdefault(m[2].decode(), []).append(routine)
        return hidden

    def called(self) -> set[str]:
        """Return the threads, and the routines that another routine calls."""
        found = set(self.threads)
        for routine, body in self.bodies.items():
            for statement in [*self.defaults[routine], *body]:
                names = {m[1].decode() for m in NAME.finditer(statement.code) if m[2]}
                found |= (names & self.bodies.keys()) - {routine}
        return found
