"""What the benchmarks of the pages share: the table, a browser with a virtual cell, and the memory of processes."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.browser.opening import Browser, Opened, Server, chromium_path

from benchmarks.harness import cpu
from truepose.studies.demo import run_demo
from truepose.web.pages import STATIC


@dataclass(frozen=True)
class Row:
    """A measured figure, and what is wanted."""

    what: str
    found: str
    wanted: str = ""

    def __str__(self) -> str:
        return f"| {self.what} | {self.found} | {self.wanted} |"


def write_table(path: Path | None, title: str, how: str, topic: str, rows: Iterable[Row]) -> None:
    """Print a table row by row; write it to a page if that is wanted."""
    head = (
        f"# {title}\n\n{how} {cpu()}; {os.cpu_count()} processors. Made by `python -m benchmarks {topic} --write`.\n\n"
        "| what | measured | wanted |\n|---|---|---|\n"
    )
    lines = [head]
    print(head, end="")
    for row in rows:
        lines.append(f"{row}\n")
        print(row, flush=True)
    if path is not None:
        path.write_text("".join(lines), "utf-8")


@contextmanager
def browser_with_virtual_cell() -> Iterator[tuple[Browser, Server] | None]:
    """Start a browser, and a server of a workspace with the virtual cell; None, with a line, where there are none."""
    if (chromium := chromium_path()) is None or not (STATIC / "index.html").is_file():
        print("skipped: needs chromium, and the pages ('make frontend')")
        yield None
        return
    with tempfile.TemporaryDirectory() as folder:
        workspace = Path(folder)
        run_demo(workspace / "virtual-cell", progress=lambda _: None)
        with Server.started(workspace) as server, Browser.launched(chromium) as browser:
            yield browser, server


def memory_mb(pid: int, what: str = "VmRSS") -> float:
    """Return the resident memory of a process [MB], or its peak ("VmHWM"); 0 where it has ended. Linux only."""
    try:
        text = Path(f"/proc/{pid}/status").read_text("ascii")
    except OSError:
        return 0.0
    found = re.search(rf"{what}:\s+(\d+) kB", text)
    return int(found[1]) / 1024 if found else 0.0


def heap_mb(app: Opened) -> float:
    """Return the memory of a page's JavaScript [MB] after its garbage was collected."""
    app.page.request_gc()
    return float(app.page.evaluate("() => performance.memory.usedJSHeapSize / 1e6"))
