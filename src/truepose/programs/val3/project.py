"""The applications of a VAL3 project: programs, data, and libraries by alias (.pjx)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final

from truepose.errors import FileError
from truepose.programs.core.points import FileLine
from truepose.programs.core.source import Source
from truepose.programs.val3.code import ProgramCode, Reference
from truepose.programs.val3.frames import Place, Table
from truepose.programs.val3.values import Value, read_data

_TAG: Final = re.compile(r"<(\w+)\b([^<>]*)>")
_ATTRIBUTE: Final = re.compile(r"([\w:.-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_COMMENT: Final = re.compile(r"<!--.*?-->", re.S)


@dataclass(frozen=True)
class Application:
    """One application.

    Attributes
    ----------
    path : Path
        Its .pjx, or its folder where it has none.
    programs : tuple of Path
        Its programs (.pgx).
    data : tuple of Path
        Its data (.dtx).
    libraries : dict of str to str
        The paths of its libraries by alias in lower case, as the .pjx writes them.
    version : str
        The version of VAL3.
    millimetres : bool
        Whether lengths are in mm; otherwise they are in inches.
    """

    path: Path
    programs: tuple[Path, ...]
    data: tuple[Path, ...]
    libraries: dict[str, str] = field(default_factory=dict)
    version: str = ""
    millimetres: bool = True

    @property
    def name(self) -> str:
        """Its name."""
        return self.path.stem


class Project:
    """The applications among some files.

    Parameters
    ----------
    files : iterable of Path
        The files.
    whole : bool
        Whether all applications that may use each other are among them.
    """

    def __init__(self, files: Iterable[Path], *, whole: bool) -> None:
        self.whole = whole
        folders: dict[Path, list[Path]] = {}
        for file in files:
            if file.suffix.lower() in (".pjx", ".dtx", ".pgx"):
                folders.setdefault(file.parent, []).append(file)
        self.applications = [one for folder, found in folders.items() for one in _applications(folder, sorted(found))]
        self._named: dict[str, list[Application]] = {}
        for one in self.applications:
            self._named.setdefault(one.name.lower(), []).append(one)
        self._values, self._code = cache(_read), cache(ProgramCode)
        self._tables: dict[tuple[Path, tuple[Path, ...], str], Table] = {}
        self._written: dict[Place, FileLine] | None = None

    @classmethod
    def beside(cls, path: Path) -> Project:
        """Return the project of a .dtx that is read alone: the files in its folder."""
        return cls((file for file in path.parent.iterdir() if file.is_file()), whole=False)

    def of(self, data: Path) -> Application:
        """Return the application whose data a .dtx holds."""
        found = next((one for one in self.applications if data in one.data), None)
        return found or Application(data.parent, (), (data,))

    def library(self, application: Application, alias: str) -> Application | None:
        """Return a library of an application; None where it is not among the files, or two have its name."""
        path = application.libraries.get(alias.lower())
        if path is None:
            return None
        stem = re.split(r"[/\\]", path)[-1].lower().removesuffix(".pjx")
        found = self._named.get(stem, [])
        near = [one for one in found if one.path.parent == application.path.parent]
        return near[0] if len(near) == 1 else found[0] if len(found) == 1 else None

    def users(self, application: Application) -> Iterator[Application]:
        """Yield the other applications that have this one as a library."""
        for other in self.applications:
            if other is not application and any(self.library(other, a) is application for a in other.libraries):
                yield other

    def table(self, application: Application, kind: str) -> Table:
        """Return the frames or tools of an application; `kind` is "frame" or "tool"."""

        def library(alias: str) -> Table | None:
            found = self.library(application, alias)
            return None if found is None else self.table(found, kind)

        key = (application.path, application.data, kind)
        if key not in self._tables:
            found = {v.name.lower(): (source, v) for source, v in self.values(application) if v.kind == kind}
            self._tables[key] = Table(kind, application.path, found, library)
        return self._tables[key]

    def codes(self, application: Application) -> list[ProgramCode]:
        """Return the code of an application's programs."""
        return [self._code(path) for path in application.programs]

    def written(self) -> dict[Place, FileLine]:
        """Return the frames and tools that programs write, each with where, in any application."""
        if self._written is None:
            self._written = {}
            for application in self.applications:
                for code in self.codes(application):
                    for alias, line in code.loaded():
                        owner = self.library(application, alias)
                        place = FileLine(self.shown(code.path), line)
                        for one in self.applications if owner is None else (owner,):
                            for _, value in self.values(one):
                                self._written.setdefault((one.path, value.name.lower()), place)
                    for reference, line in (*code.written(), *self._changed_by_calls(application, code)):
                        owner = self.library(application, reference.alias) if reference.alias else application
                        place = FileLine(self.shown(code.path), line)
                        for one in self.applications if owner is None else (owner,):
                            for name in self._names(one, *reference.parts[0]):
                                self._written.setdefault((one.path, name), place)
        return self._written

    def _names(self, application: Application, name: str, index: str | None) -> Iterator[str]:
        """Yield the data that a name with an index may mean."""
        yield name + _index(index)
        if index is None:
            yield from (v.name.lower() for _, v in self.values(application) if v.name.lower().startswith(f"{name}["))

    def _changed_by_calls(self, application: Application, code: ProgramCode) -> Iterator[tuple[Reference, int]]:
        """Yield the data that a program hands to others which may change them, each with its line."""
        for handed in code.handed():
            owner = self.library(application, handed.alias) if handed.alias else application
            programs = [] if owner is None else [one for one in self.codes(owner) if one.name == handed.program]
            if not programs or any(one.may_change(handed.place) for one in programs):
                name, index = handed.reference.parts[0]
                whole = handed.reference._replace(parts=((name, index or None), *handed.reference.parts[1:]))
                yield whole, handed.line  # a name without an index hands over the whole array

    @staticmethod
    def shown(path: Path) -> str:
        """Return a file for messages: its name with its folder."""
        return f"{path.parent.name}/{path.name}"

    def values(self, application: Application) -> Sequence[tuple[Source, Value]]:
        """Return the values of an application's data; none where they are broken."""
        return [(source, value) for path in application.data for source, value in self._values(path)]


def _index(text: str | None) -> str:
    """Return the index of a frame as its name has it."""
    return "" if text in ("", "0", None) else f"[{text}]"


def _read(path: Path) -> list[tuple[Source, Value]]:
    try:
        source = Source.read(path)
        return [(source, value) for value in read_data(source).values]
    except FileError:
        return []  # reading that file will give the reason


def _applications(folder: Path, files: Sequence[Path]) -> Iterator[Application]:
    """Yield the applications of a folder: one for each .pjx; without any, one for each .dtx."""
    by_name = {file.name.lower(): file for file in files}
    programs = tuple([file for file in files if file.suffix.lower() == ".pgx"])
    data = [file for file in files if file.suffix.lower() == ".dtx"]
    projects = [file for file in files if file.suffix.lower() == ".pjx"]
    taken: set[Path] = set()
    for path in projects:
        listed = _Listed(path)
        own = [by_name[name] for name in listed.files["Data"] if name in by_name]
        if not own and len(projects) == 1:
            own = data
        taken.update(own)
        mine = [file for file in programs if len(projects) == 1 or file.name.lower() in listed.files["Program"]]
        yield Application(path, tuple(mine), tuple(own), listed.libraries, listed.version, listed.millimetres)
    for path in data:
        if path not in taken:
            yield Application(folder, programs, (path,))
    if programs and not projects and not data:
        yield Application(folder, programs, ())


class _Listed:
    """What a .pjx names."""

    def __init__(self, path: Path) -> None:
        text = _COMMENT.sub("", Source.read(path).data.decode("latin-1"))
        self.files: dict[str, list[str]] = {"Program": [], "Data": []}
        self.libraries: dict[str, str] = {}
        self.version, self.millimetres = "", True
        for m in _TAG.finditer(text):
            said = {a[1].lower(): a[2] if a[2] is not None else a[3] for a in _ATTRIBUTE.finditer(m[2])}
            if m[1] == "Parameters":
                self.version = said.get("version", "")
                self.millimetres = said.get("millimeterunit", "true").lower() != "false"
            elif m[1] in self.files and said.get("file"):
                self.files[m[1]].append(re.split(r"[/\\]", said["file"])[-1].lower())
            elif m[1] == "Library" and said.get("alias") and said.get("path"):
                self.libraries[said["alias"].lower()] = said["path"]
