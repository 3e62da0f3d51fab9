"""Make a release: ``python tools/release.py 0.3.0``, or ``make release VERSION=0.3.0``, which builds the pages first.

The commit ``Release X.Y.Z`` has the section of the changelog, the version and CITATION.cff; it gets the tag, and sdist
and wheel are built from it. The wheel is installed into empty environments of the oldest supported Python and of the
newest at hand, and ``truepose demo`` runs there. A second commit begins the next version. If anything fails, both
commits and the tag are removed. Nothing is pushed or published.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Callable, Iterable, Sequence
from datetime import date
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CHANGELOG, CITATION, VERSION = "CHANGELOG.md", "CITATION.cff", "src/truepose/_version.py"
PAGE = "truepose/web/static/index.html"
UNRELEASED = "## Unreleased"

Minor = tuple[int, int]
Build = Callable[[Path, str, Path], None]
"""Build and check a version of a checkout; write sdist and wheel into a folder."""


class ReleaseError(RuntimeError):
    """The release cannot be made."""


def release(version: str, root: Path, build: Build, today: date) -> str:
    """Make a release; return what is left to do.

    Parameters
    ----------
    version : str
        The version, ``X.Y.Z``.
    root : Path
        The checkout.
    build : callable
        A function that builds and checks; if it fails, no commit and no tag stays.
    today : date
        The date of the release.

    Raises
    ------
    ReleaseError
        If a precondition does not hold, or a step fails.
    """
    check(version, root)
    tag, following = f"v{version}", next_version(version)
    made = [_git(root, "rev-parse", "HEAD")]
    try:
        _edit(root, CHANGELOG, lambda text: released(text, version, today))
        _edit(root, CITATION, lambda text: cited(text, version, today))
        _edit(root, VERSION, lambda text: with_release(text, version))
        made.append(_commit(root, f"Release {version}"))
        _git(root, "tag", "--annotate", tag, "--message", f"truepose {version}")
        with tempfile.TemporaryDirectory() as folder:
            build(root, version, Path(folder))
            _edit(root, VERSION, lambda text: with_release(text, following))
            made.append(_commit(root, f"Begin {following}"))
            (root / "dist").mkdir(exist_ok=True)
            files = [shutil.copy(path, root / "dist") for path in sorted(Path(folder).iterdir())]
    except BaseException:
        _undo(root, tag, made)
        raise
    names = " ".join(Path(path).relative_to(root).as_posix() for path in files)
    return f"Released {version}. Publish it with: git push origin main {tag} && uv publish {names}"


def check(version: str, root: Path) -> None:
    """Check all preconditions of a release; the first that does not hold is an error."""
    if not re.fullmatch(r"(0|[1-9]\d*)(\.(0|[1-9]\d*)){2}", version):
        raise ReleaseError(f"expected a version X.Y.Z, such as 0.3.0, got {version!r}")
    if changed := _git(root, "status", "--porcelain"):
        files = [line.split(maxsplit=1)[1] for line in changed.splitlines()]
        raise ReleaseError(f"files differ from the last commit: {_some(files)}; commit or remove them first")
    branch = _git(root, "branch", "--show-current") or "no branch"
    if branch != "main":
        raise ReleaseError(f"releases are made on the branch main, this is {branch}; run: git switch main")
    tags = _git(root, "tag", "--list", "v[0-9]*").splitlines()
    if f"v{version}" in tags:
        raise ReleaseError(f"the tag v{version} exists already; choose another version")
    text = (root / CHANGELOG).read_text("utf-8")
    known = re.findall(r"^## (\d+\.\d+\.\d+)\b", text, re.MULTILINE)
    known += [tag[1:] for tag in tags if re.fullmatch(r"v\d+\.\d+\.\d+", tag)]
    last = max(known, key=_numbers, default="0.0.0")
    if _numbers(version) <= _numbers(last):
        raise ReleaseError(f"expected a version newer than {last}, the last release, got {version}")
    if not any(line.strip() and not line.startswith("#") for line in _unreleased(text).splitlines()):
        raise ReleaseError(f"the section '{UNRELEASED}' of {CHANGELOG} is empty; write what users must know or do")


def released(text: str, version: str, today: date) -> str:
    """Return the changelog with the unreleased section as that of a version, and an empty one above it."""
    return _replaced(text, f"^{UNRELEASED}$", f"{UNRELEASED}\n\n## {version}, {today}", CHANGELOG)


def cited(text: str, version: str, today: date) -> str:
    """Return CITATION.cff with a version and its date."""
    text = _replaced(text, "^version: .*$", f"version: {version}", CITATION)
    return _replaced(text, "^date-released: .*$", f"date-released: {today}", CITATION)


def with_release(text: str, version: str) -> str:
    """Return the module of the version with another release."""
    return _replaced(text, '^RELEASE = ".*"$', f'RELEASE = "{version}"', VERSION)


def next_version(version: str) -> str:
    """Return the version that is worked on after a release: the next minor one."""
    major, minor, _ = _numbers(version)
    return f"{major}.{minor + 1}.0"


def build_and_check(root: Path, version: str, out: Path, pythons: Sequence[str]) -> None:
    """Build sdist and wheel, with pages; install the wheel for each Python, and run the demonstration there."""
    uv = _uv()
    environment = {**os.environ, "TRUEPOSE_PAGES": "require"}
    _run([uv, "build", "--sdist", "--out-dir", out, root], environment=environment)
    _run([uv, "build", "--wheel", "--out-dir", out, root], environment=environment)
    (out / ".gitignore").unlink(missing_ok=True)  # of uv
    wheel = out / f"truepose-{version}-py3-none-any.whl"
    if {path.name for path in out.iterdir()} != {wheel.name, f"truepose-{version}.tar.gz"}:
        raise ReleaseError(f"expected an sdist and a wheel of {version}, got {_some(p.name for p in out.iterdir())}")
    with zipfile.ZipFile(wheel) as archive:
        if PAGE not in archive.namelist():
            raise ReleaseError(f"the wheel has no pages ({PAGE}); build them with: make frontend")
    for python in pythons:
        check_installed(wheel, version, python)


def check_installed(wheel: Path, version: str, python: str) -> None:
    """Install a wheel into an empty environment of an interpreter, and run the demonstration there."""
    uv = _uv()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        own = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
        own |= {"TRUEPOSE_STATE": str(place / "state")}  # not the list of corrected programs of this user
        _run([uv, "venv", "--quiet", "--python", python, place / "env"], environment=own)
        scripts = place / "env" / ("Scripts" if os.name == "nt" else "bin")
        _run([uv, "pip", "install", "--quiet", "--python", scripts / "python", wheel], environment=own)
        shown = _run([scripts / "truepose", "--version"], environment=own, cwd=place, captured=True).strip()
        if shown != f"truepose {version}":
            raise ReleaseError(f"expected 'truepose {version}' of the installed wheel ({python}), got {shown!r}")
        _run([scripts / "truepose", "demo", place / "demo"], environment=own, cwd=place)


def interpreters(root: Path) -> list[str]:
    """Return the paths of the oldest supported Python and of the newest supported one at hand; nothing is downloaded.

    Raises
    ------
    ReleaseError
        If the oldest is not at hand.
    """
    classifiers = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]["classifiers"]
    supported = {(int(m[1]), int(m[2])) for one in classifiers if (m := re.search(r":: (\d+)\.(\d+)$", one))}
    command = [_uv(), "python", "list", "--only-installed", "--no-python-downloads", "--output-format", "json"]
    found = at_hand(_run(command, captured=True), supported)
    oldest = min(supported)
    if oldest not in found:
        name = "{}.{}".format(*oldest)
        raise ReleaseError(f"Python {name}, the oldest supported, is not installed; run: uv python install {name}")
    return [found[minor] for minor in sorted({oldest, max(found)})]


def at_hand(listed: str, supported: set[Minor]) -> dict[Minor, str]:
    """Return the path of the newest interpreter of each supported minor version, from what uv lists as JSON."""
    usual = [
        one
        for one in json.loads(listed)
        if one["implementation"] == "cpython"
        and one["variant"] == "default"
        and re.fullmatch(r"[\d.]+", one["version"])
        and _numbers(one["version"])[:2] in supported
    ]
    found: dict[Minor, str] = {}
    for one in sorted(usual, key=lambda one: _numbers(one["version"]), reverse=True):
        found.setdefault((one["version_parts"]["major"], one["version_parts"]["minor"]), one["path"])
    return found


def _undo(root: Path, tag: str, made: Sequence[str]) -> None:
    """Remove the tag and the commits of a release that failed; what else was changed meanwhile stays."""
    before, *own = made
    head = _git(root, "rev-parse", "HEAD")
    if own and _git(root, "tag", "--list", tag):
        _git(root, "tag", "--delete", tag)
    if head == before:
        _git(root, "restore", "--staged", "--worktree", CHANGELOG, CITATION, VERSION)
    elif head in own:
        _git(root, "restore", "--staged", "--worktree", VERSION)
        _git(root, "reset", "--keep", before)
    else:
        raise ReleaseError(f"main has other commits since the release began; remove {_some(own)} by hand")


def _commit(root: Path, subject: str) -> str:
    _git(root, "commit", "--quiet", "--message", subject, "--", CHANGELOG, CITATION, VERSION)
    return _git(root, "rev-parse", "HEAD")


def _edit(root: Path, name: str, change: Callable[[str], str]) -> None:
    path = root / name
    path.write_bytes(change(path.read_bytes().decode("utf-8")).encode("utf-8"))


def _replaced(text: str, pattern: str, new: str, name: str) -> str:
    changed, count = re.subn(pattern, new, text, flags=re.MULTILINE)
    if count != 1:
        raise ReleaseError(f"expected one line '{pattern}' in {name}, got {count}")
    return changed


def _unreleased(text: str) -> str:
    found = re.search(rf"^{UNRELEASED}$(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    if found is None:
        raise ReleaseError(f"{CHANGELOG} has no section '{UNRELEASED}'")
    return found[1]


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("."))


def _some(names: Iterable[str]) -> str:
    listed = sorted(names)
    return ", ".join(listed[:3]) + (f" and {len(listed) - 3} more" if len(listed) > 3 else "")


def _uv() -> str:
    """Return the path of uv: that of this environment, else that of the machine."""
    found = shutil.which("uv", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    if found is None:
        raise ReleaseError("uv is not installed; run this in the environment of 'make setup'")
    return found


def _git(root: Path, *words: str) -> str:
    return _run(["git", *words], cwd=root, captured=True).rstrip()


def _run(
    command: Sequence[str | Path],
    *,
    cwd: Path | None = None,
    environment: dict[str, str] | None = None,
    captured: bool = False,
) -> str:
    words = [str(word) for word in command]
    if not captured:
        print("+", *words, flush=True)
    done = subprocess.run(
        words, cwd=cwd, env=environment, stdin=subprocess.DEVNULL, capture_output=captured, text=True, check=False
    )
    if done.returncode:
        said = f": {done.stderr.strip()}" if captured else ""
        raise ReleaseError(f"'{' '.join(words)}' failed with exit code {done.returncode}{said}")
    return done.stdout or ""


def main() -> int:
    """Run this script; return its exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("version", help="the version, X.Y.Z")
    parser.add_argument("--dry-run", action="store_true", help="check the preconditions, and change nothing")
    parser.add_argument(
        "--python", action="append", help="an interpreter to check the wheel with, instead of those found"
    )
    given = parser.parse_args()
    try:
        check(given.version, ROOT)
        pythons = given.python or interpreters(ROOT)
        print("The wheel is checked with:", *pythons)
        if given.dry_run:
            print(
                f"{given.version} can be released; after it begins {next_version(given.version)}. Nothing was changed."
            )
            return 0

        def build(root: Path, version: str, out: Path) -> None:
            build_and_check(root, version, out, pythons)

        print(release(given.version, ROOT, build, date.today()))
    except ReleaseError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
