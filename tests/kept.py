"""Folders that many tests need and that take long to make: made once for all workers and runs.

They are kept below ``build/kept``, in a folder named after the sources that they depend on: all of ``src/truepose``,
the lock file, the version of Python, and the module that makes them. A change of any of these makes them anew; folders
of other sources are removed.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
import time
from functools import cache
from pathlib import Path
from types import FunctionType

ROOT = Path(__file__).parents[1]
_OLD = 86400.0  # s
_STALE = 900.0  # s; a worker that has made a folder for longer was killed


@cache
def _sources() -> str:
    digest = hashlib.sha256(sys.version.encode())
    source = ROOT / "src" / "truepose"
    files = [p for p in source.rglob("*") if p.is_file() and not {"static", "__pycache__"} & set(p.parts)]
    for path in [ROOT / "uv.lock", *sorted(files)]:
        digest.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def kept(name: str, make: FunctionType) -> Path:
    """Return a folder that `make` fills, from another run or worker where there is one; change a copy of it only."""
    name = f"{name}-{hashlib.sha256(Path(make.__code__.co_filename).read_bytes()).hexdigest()[:8]}"
    top = ROOT / "build" / "kept" / _sources()
    folder, lock, done = top / name, top / f"{name}.lock", top / f"{name}.done"
    top.mkdir(parents=True, exist_ok=True)
    for old in top.parent.iterdir():
        if old != top and time.time() - old.stat().st_mtime > _OLD:  # a run that began before may use it
            shutil.rmtree(old, ignore_errors=True)
    while not done.exists():
        try:
            lock.mkdir()
        except FileExistsError:  # another worker makes it
            if time.time() - lock.stat().st_mtime > _STALE:
                shutil.rmtree(lock, ignore_errors=True)
            time.sleep(0.1)
            continue
        try:
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)  # what a killed run left
                folder.mkdir()
                make(folder)  # in its place: maps hold paths
                done.touch()
        finally:
            lock.rmdir()
    return folder
