"""Files that the server keeps for a while in its own folder of the workspace, and removes by age and size."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Final

_DAY_S: Final = 86_400.0


def remove_old(folder: Path, *, largest: int, days: float | None = None) -> None:
    """Remove the oldest files of a folder beyond a total size, and those that were not used for some days.

    Parameters
    ----------
    folder : Path
        The folder; it may not exist.
    largest : int
        The largest size in bytes of all files together; the newest file always stays.
    days : float, optional
        The age in days at which a file is removed.
    """
    files = []
    for path in folder.iterdir() if folder.is_dir() else ():
        try:
            if path.is_file():
                files.append((path.stat(), path))
        except OSError:  # removed meanwhile
            continue
    total, now = 0, time.time()
    for place, (status, path) in enumerate(sorted(files, key=lambda one: -one[0].st_mtime_ns)):
        total += status.st_size
        too_old = days is not None and now - status.st_mtime > days * _DAY_S
        if too_old or (place and total > largest):
            path.unlink(missing_ok=True)
