"""What is changed, where the tests are, and the changes that were found to have no effect."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Equivalent:
    """A reviewed change without effect: the lines before and after, joined with single blanks, and the reason."""

    file: str
    line: str
    becomes: str
    reason: str


@dataclass(frozen=True)
class Settings:
    """The settings of one project.

    Attributes
    ----------
    root : Path
        The folder in which pytest runs.
    source, package : str
        The folder with the package below `root`, and the name of the package.
    places : tuple of str
        The files below the package that are changed, each as ``file`` or as ``file:function``.
    warm : tuple of str
        Modules that are imported once, before a process is forked for each mutant.
    prepare : tuple of str
        Arguments of Python that prepare a copy of the sources, such as those that compile what is kept beside them.
    second_tier : dict
        Environment variables with which pytest runs the second tier of tests, too.
    equivalent : tuple of Equivalent
        The reviewed changes without effect.
    """

    root: Path
    source: str
    package: str
    places: tuple[str, ...]
    warm: tuple[str, ...]
    prepare: tuple[str, ...]
    second_tier: dict[str, str]
    equivalent: tuple[Equivalent, ...]

    @classmethod
    def read(cls, path: Path) -> Settings:
        """Read a settings file; its ``root`` is relative to the file."""
        found = tomllib.loads(path.read_text("utf-8"))
        return cls(
            root=(path.parent / found["root"]).resolve(),
            source=found["source"],
            package=found["package"],
            places=tuple(found["places"]),
            warm=tuple(found.get("warm", ())),
            prepare=tuple(found.get("prepare", ())),
            second_tier=dict(found.get("second_tier", {})),
            equivalent=tuple(Equivalent(**one) for one in found.get("equivalent", ())),
        )

    @property
    def folder(self) -> Path:
        """The folder for results."""
        return self.root / "build" / "mutants"

    def files(self) -> list[str]:
        """Return the files with a place, in their order."""
        return list(dict.fromkeys(place.partition(":")[0] for place in self.places))

    def path(self, file: str) -> Path:
        """Return the path of a file of the package."""
        return self.root / self.source / self.package / file

    def wants(self, file: str, functions: tuple[str, ...]) -> bool:
        """Return whether a change in some functions of a file is wanted."""
        wanted = [place.partition(":")[2] for place in self.places if place.partition(":")[0] == file]
        inside = [one == name or one.startswith(f"{name}.") for one in functions for name in wanted]
        return "" in wanted or any(inside)

    def prepared(self, folder: Path) -> Path:
        """Return a folder with a prepared copy of the sources, which is made unless it is there."""
        if not folder.exists():
            shutil.copytree(self.root / self.source, folder)
            if self.prepare:
                environment = {**os.environ, "PYTHONPATH": str(folder)}
                environment.pop("PYTHONDONTWRITEBYTECODE", None)
                subprocess.run([sys.executable, *self.prepare], cwd=self.root, env=environment, check=True)
        return folder
