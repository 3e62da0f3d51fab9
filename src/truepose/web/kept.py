"""Files that the server keeps for a while in its own folder of the workspace, and removes by age and size."""

from __future__ import annotations

import re
import shutil
import time
from pathlib import Path
from typing import Final

_DAY_S: Final = 86_400.0
_NAMED: Final = re.compile("[0-9a-f]{64}")


def remove_old(folder: Path, *, largest: int, days: float | None = None) -> None:
    """Remove the oldest files of a folder beyond a total size, and those that were not used for some days.

    A folder in it that is named after a SHA-256 counts as one file; other folders stay.

    Parameters
    ----------
    folder : Path
        The folder; it may not exist.
    largest : int
        The largest size in bytes of all files together; the newest file always stays.
    days : float, optional
        The age in days at which a file is removed.
    """
    found = []
    for path in folder.iterdir() if folder.is_dir() else ():
        try:
            whole = path.is_dir() and _NAMED.fullmatch(path.name) is not None
            if whole or path.is_file():
                size = sum(one.stat().st_size for one in path.iterdir()) if whole else path.stat().st_size
                found.append((path.stat().st_mtime_ns, size, path))
        except OSError:  # removed meanwhile
            continue
    total, now = 0, time.time()
    for place, (changed, size, path) in enumerate(sorted(found, key=lambda one: -one[0])):
        total += size
        too_old = days is not None and now - changed / 1e9 > days * _DAY_S
        if too_old or (place and total > largest):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
