"""The version: the release that is worked on, and the commit of the sources that run.

A checkout asks git each time, because an editable installation runs later commits than the one that it was made from.
An sdist, an archive of a commit and an installed wheel hold a note of the commit. Nothing of this is done before the
version is used, so that a start is fast. The build reads this module alone: it imports nothing of the package.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

RELEASE = "0.3.0"
"""The release that is worked on; `make release` sets it."""

_PATIENCE = 20  # seconds that git may take for one answer
_TAGS = "v[0-9]*"


@cache
def version() -> str:
    """Return the version.

    It is ``0.3.0`` for the commit with the tag ``v0.3.0``, and ``0.3.0.dev12+g55ba6a5`` for the twelfth commit after
    the newest tag; ``.dirty`` is added if files differ from the commit. The number is 0 where it cannot be counted, as
    in a shallow clone, and the commit is ``unknown`` where nothing names it.
    """
    file = Path(__file__).resolve()
    root = file.parents[2]
    if file.parents[1].name == "src" and (root / "pyproject.toml").is_file():
        found = _of_sdist(root) or _of_checkout(root) or _of_archive(root)
    else:
        found = _of_installation(file)
    return found or f"{RELEASE}.dev0+unknown"


def _of_sdist(root: Path) -> str | None:
    """Return the version that the build of an sdist wrote."""
    try:
        lines = (root / "PKG-INFO").read_text("utf-8").splitlines()
    except OSError:
        return None
    return next((line.removeprefix("Version: ") for line in lines if line.startswith("Version: ")), None)


def _of_checkout(root: Path) -> str | None:
    """Return the version that git knows; None without git or a repository."""
    if not (root / ".git").exists():
        return None
    try:
        described = _git(root, "describe", "--tags", "--long", "--always", "--abbrev=7", f"--match={_TAGS}")
        changes = _git(root, "status", "--porcelain", "-z", "--untracked-files=normal").split("\0")
        dirty = any(one and (one[:2] != "??" or one.startswith("?? src/")) for one in changes)
        *tag, commit = described.rsplit("-", 2)
        since = int(tag[1]) if tag else _since_last_release(root)
    except OSError:
        return None
    return _named(tag[0] if tag else "", since, commit.removeprefix("g"), dirty)


def _since_last_release(root: Path) -> int:
    """Count the commits of this release in a clone without tags: the first of them set `RELEASE`."""
    if _git(root, "rev-parse", "--is-shallow-repository") == "true":
        return 0  # the commit may not be in the clone
    place = Path(__file__).resolve().relative_to(root).as_posix()
    first = _git(root, "log", "-1", "--format=%H", "-G^RELEASE = ", "--", place)
    return int(_git(root, "rev-list", "--count", f"{first}..HEAD")) + 1 if first else 0


def _of_archive(root: Path) -> str | None:
    """Return the version from the note that ``git archive`` fills in; see ``.gitattributes``."""
    import re

    try:
        lines = (root / ".git_archival.txt").read_text("utf-8").splitlines()
    except OSError:
        return None
    note = dict(line.split(": ", 1) for line in lines if ": " in line)
    commit = re.fullmatch("([0-9a-f]{7})[0-9a-f]+", note.get("node", ""))
    described = re.fullmatch("(v.+?)(?:-([0-9]+)-g[0-9a-f]+)?", note.get("describe", ""))
    if commit is None:  # not filled in
        return None
    tag, since = described.groups() if described else ("", None)
    return _named(tag, int(since or 0), commit[1], dirty=False)


def _of_installation(file: Path) -> str | None:
    """Return the version of the installed package that this file is part of."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        found = distribution("truepose")
    except PackageNotFoundError:
        return None
    return found.version if Path(str(found.locate_file("truepose/_version.py"))).resolve() == file else None


def _named(tag: str, since: int, commit: str, dirty: bool) -> str:
    local = f"g{commit}.dirty" if dirty else f"g{commit}"
    if tag == f"v{RELEASE}" and since == 0:
        return f"{RELEASE}+{local}" if dirty else RELEASE
    return f"{RELEASE}.dev{since}+{local}"


def _git(root: Path, *words: str) -> str:
    """Return what git prints; an OSError says that there is no git, or no commit.

    The repository is named, so that one of another owner (as in a container) is read, and so that variables with
    which git runs its hooks do not lead to another repository.
    """
    import subprocess

    command = ["git", "--no-optional-locks", f"--git-dir={root / '.git'}", f"--work-tree={root}", *words]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    try:
        done = subprocess.run(
            command,
            cwd=root,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_PATIENCE,
            check=True,
        )
    except subprocess.SubprocessError as error:
        raise OSError(f"git {words[0]}: {error}") from None
    return done.stdout.strip()
