"""The head of the audit trail in a file outside of the database.

It shows that the last entries were removed, by accident or with a truncated write-ahead log. It is written after each
change, so it may be some entries behind after a crash, and it does not stop anyone who may write both.
"""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

from truepose.store.audit import Head

_LINE = re.compile(r"(\d{1,18}) ([0-9a-f]{64})\n")


def write(path: Path | None, head: Head) -> None:
    """Write the head, unless a later one stands there; a file that cannot be written is left as it is."""
    if path is None or ((old := read(path)) is not None and old.sequence >= head.sequence):
        return
    draft = path.with_name(f".{path.name}-{os.getpid()}-{head.sequence}")
    with contextlib.suppress(OSError):  # the change is stored; `truepose store verify` says that the file is behind
        draft.write_text(f"{head.sequence} {head.hash}\n", "ascii")
        draft.replace(path)


def read(path: Path) -> Head | None:
    """Return the head; None if there is none, or the file is not complete."""
    try:
        found = _LINE.fullmatch(path.read_text("ascii"))
    except (OSError, UnicodeDecodeError):
        return None
    return None if found is None else Head(int(found[1]), found[2])
