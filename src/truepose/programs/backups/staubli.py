"""Backups of Stäubli: applications of VAL3 with their libraries, ``usr/usrapp/APP/APP.pjx`` with .dtx and .pgx.

A copy of the applications alone is a backup, too. Frames and tools are in the data of the applications.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from truepose._io import files as io
from truepose.programs.backups.controller import Contents, StoredFrames
from truepose.programs.val3.project import Project

_OTHERS: Final = {".pjx": "project", ".pgx": "program code", ".cfx": "machine data", ".log": "log"}
_ARM: Final = re.compile(rb"\b(?:name|type|arm|model)\s*=\s*\"((?:TX|RX|RS|TS)[^\"]{0,40})\"", re.I)


def roots(files: Sequence[Path]) -> list[Path]:
    """Return the folders of the controllers among the files of a backup: those above ``usr/usrapp``.

    Without such a folder, it is the one that holds the folders of the applications.
    """
    projects = [file for file in files if file.suffix.lower() == ".pjx"]
    found: set[Path] = set()
    for project in projects:
        parents = list(project.parents)
        k = next((k for k, folder in enumerate(parents) if folder.name.lower() == "usrapp"), None)
        if k is not None:
            found.add(parents[k + 2] if parents[k + 1].name.lower() == "usr" else parents[k + 1])
    apart = [project for project in projects if not any(root in project.parents for root in found)]
    if apart:
        found.add(_common(apart))
    return sorted(found)


def _common(projects: Sequence[Path]) -> Path:
    """Return the innermost folder that holds all projects."""
    return next(folder for folder in projects[0].parents if all(folder in one.parents for one in projects))


def contents(root: Path, files: Sequence[Path]) -> Contents:
    """Return the files of one controller, sorted."""
    own = [file for file in files if root in file.parents]
    project = Project(own, whole=True)
    data = [file for file in own if file.suffix.lower() == ".dtx"]
    others = {file: kind for file in own if (kind := _OTHERS.get(file.suffix.lower()))}
    versions = sorted({one.version for one in project.applications if one.version})
    warnings = [
        f"{one.path.name}: the library {alias} ({path}) is not in the backup; frames and points in it are not known"
        for one in project.applications
        for alias, path in one.libraries.items()
        if project.library(one, alias) is None
    ]
    arms = [m[1] for file in own if file.name.lower() == "arm.cfx" and (m := _ARM.search(io.read_bytes(file)))]
    robot = arms[0].decode("latin-1") if arms else ""
    return Contents([(file,) for file in data], others, warnings, robot, ", ".join(versions))


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    """Return the tools and bases of one controller: none, because they are in the data of the applications."""
    return StoredFrames()


def for_reader(root: Path, files: Sequence[Path]) -> dict[str, Any]:
    """Return the applications, which use each other's points and frames: `truepose.programs.val3.project.Project`."""
    return {"project": Project([file for file in files if root in file.parents], whole=True)}
