"""Files that an earlier run wrote into an output folder and the present run does not.

Every run adds a line of JSON to ``written.jsonl`` in the user's state folder (`truepose.programs.history`): the output
folder, and the SHA-256 of each file. So only files that truepose wrote, and that nobody changed since, are removed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from truepose.programs import history

_SHOWN: Final = 5  # files that a message names


@dataclass(frozen=True)
class Leftovers:
    """The files of earlier runs that are no longer part of the results.

    Attributes
    ----------
    unchanged : tuple of Path
        The files that are as truepose wrote them.
    changed : tuple of Path
        The files that were changed since.
    """

    unchanged: tuple[Path, ...]
    changed: tuple[Path, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the paths, for JSON."""
        return {"unchanged": [str(path) for path in self.unchanged], "changed": [str(path) for path in self.changed]}


def remember_written(out_dir: Path, paths: Iterable[Path]) -> None:
    """Add the files of a run to the list; a list that cannot be written only means that they are never removed."""
    with contextlib.suppress(OSError):
        files = {str(path.relative_to(out_dir)): _digest(path) for path in paths}
        if files and (store := _store()) is not None:
            line = json.dumps({"folder": str(out_dir.resolve()), "files": files})
            history.append(store, f"\n{line}\n")


def find_leftovers(out_dir: Path, written: Iterable[Path]) -> Leftovers:
    """Return the files of earlier runs in a folder, without those that the present run has written."""
    here = {str(path.relative_to(out_dir)) for path in written}
    known: dict[str, set[str]] = {}
    for files in _runs(out_dir):
        for name, digest in files.items():
            if name not in here:
                known.setdefault(name, set()).add(digest)
    unchanged: list[Path] = []
    changed: list[Path] = []
    for name, digests in sorted(known.items()):
        path = out_dir / name
        if path.is_file() and not path.is_symlink():
            (unchanged if _digest(path) in digests else changed).append(path)
    return Leftovers(tuple(unchanged), tuple(changed))


def clear_leftovers(out_dir: Path, written: Iterable[Path], *, force: bool) -> Leftovers:
    """Name the files of earlier runs in one warning; remove the unchanged ones if `force`; return them."""
    found = find_leftovers(out_dir, written)
    told: list[str] = []
    if found.unchanged and force:
        removed = [path for path in found.unchanged if _removed(path)]
        if removed:
            told.append(f"removed {_listed(removed)}, which an earlier run wrote and this one does not")
        if kept := [path for path in found.unchanged if path not in removed]:
            told.append(f"{_listed(kept)}: of an earlier run, and cannot be removed; remove it by hand")
    elif found.unchanged:
        what = "are files of an earlier run" if len(found.unchanged) > 1 else "is a file of an earlier run"
        told.append(f"{_listed(found.unchanged)}: {what} and no part of this one; remove with --force (force=True)")
    if found.changed:
        told.append(f"{_listed(found.changed)}: written by an earlier run and changed since, and therefore kept")
    if told:
        warnings.warn("; ".join(told), UserWarning, stacklevel=3)
    return found


def _removed(path: Path) -> bool:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return False
    return True


def _listed(paths: Sequence[Path]) -> str:
    more = f" and {len(paths) - _SHOWN} more" if len(paths) > _SHOWN else ""
    return ", ".join(map(str, paths[:_SHOWN])) + more


def _store() -> Path | None:
    own = history.stores(None)
    return own[0].with_name("written.jsonl") if own else None


def _runs(out_dir: Path) -> Iterable[dict[str, str]]:
    """Yield the files and hashes of each run into a folder; lines that cannot be read are left out."""
    store = _store()
    try:
        lines = store.read_bytes().splitlines() if store is not None and store.is_file() else []
    except OSError:
        return
    folder = str(out_dir.resolve())
    for line in filter(bytes.strip, lines):
        with contextlib.suppress(ValueError, KeyError, TypeError, AttributeError):
            entry = json.loads(line)
            if entry["folder"] == folder:
                yield {
                    str(name): str(digest)
                    for name, digest in entry["files"].items()
                    if not Path(name).is_absolute() and ".." not in Path(name).parts
                }


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
