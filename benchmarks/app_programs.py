"""The page of programs with a program of a million targets: index, table, difference, path, and the server's memory."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import httpx2
import numpy as np
from tests.browser.opening import Browser, Server, chromium_path

from benchmarks.pages import Row, heap_mb, memory_mb, write_table
from truepose.programs import FrameTable, correct_program
from truepose.simulation import VirtualCell
from truepose.web.pages import STATIC

PAGE: Final = "app-programs"
_PLACES: Final = 50
_SCROLL: Final = """async (places) => {
  const table = document.querySelector('[role=columnheader]').closest('.scroll')
  for (let k = 0; k < places; k++) {
    table.scrollTop = table.scrollHeight * ((k * 0.6180339887) % 1)
    await new Promise((done) => setTimeout(done, 100))
  }
}"""
_VIEWS: Final[dict[str, dict[str, Any]]] = {
    "in the order of the program": {},
    "sorted by the change": {"sort": "change", "descending": True},
    "sorted by name": {"sort": "name"},
    "of one verdict": {"verdict": "skip"},
    "with a text in the name": {"search": "LIN:1234"},
    "with a text that nearly all have": {"search": "lin"},
    "sorted, of one verdict, with a text": {"sort": "std", "verdict": "correct", "search": "99"},
}


class _Map:
    """A map whose answers cost nothing; it skips every hundredth target."""

    hash = "0" * 64

    def correct(self, poses: np.ndarray, **_: Any) -> SimpleNamespace:
        p, n = poses[:, :3, 3], len(poses)
        left = np.arange(n) % 100 == 99
        e = np.where(left, 0.0, 1.0)[:, None] * (0.1 + p / 1e4)
        reason = np.where(left, "standard deviation of 0.41 mm is above the limit of 0.3 mm", "").tolist()
        verdict = np.where(left, "skip", "correct")
        return SimpleNamespace(
            p_target=p, p_command=p - e, e=e, std=np.abs(p) / 1e4 + 1.0, verdict=verdict, reason=reason
        )


def report(path: Path | None, *, quick: bool) -> None:
    """Measure, print, and write the page if it is wanted."""
    n = 20_000 if quick else 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TRUEPOSE_STATE"] = folder  # what is corrected here is not remembered
        workspace = Path(folder) / "work"
        _correct(workspace / "cell", n)
        how = "The server in a process of its own on the same machine; answers as a client gets them."
        with Server.started(workspace) as server:
            rows = chain(_rows(server, 5 if quick else 20), _in_browser(server))
            write_table(path, f"The page of programs with {n:,} targets", how, "app_programs", rows)


def _correct(cell: Path, n: int) -> None:
    """Write a cell with a program of inline targets and its correction."""
    rng, virtual = np.random.default_rng(0), VirtualCell("paper", seed=1)
    (cell / "programs").mkdir(parents=True)
    (cell / "cell.toml").write_text(virtual.cell.to_toml(), "utf-8")
    with (cell / "programs" / "long.src").open("w") as file:
        file.write("DEF LONG( )\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n")
        for x, y, z in np.asarray(virtual.preset.centre_mm) + rng.uniform(-400, 400, (n, 3)):
            file.write(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A 0.000,B 90.000,C 0.000}} C_DIS\n")
        file.write("END\n")
    before = Path.cwd()
    os.chdir(cell)
    try:
        frames = FrameTable(tools={1: np.eye(4)})
        done = correct_program(Path("programs/long.src"), _Map(), frames=frames, on_guard="skip")
        done.write("corrected/long")
    finally:
        os.chdir(before)


def _rows(server: Server, repeats: int) -> Iterator[Row]:
    with httpx2.Client(base_url=server.origin, timeout=600) as client:
        client.get(server.start_url)
        cell = client.get("/api/v1/cells").json()[0]["id"]
        begin = time.perf_counter()
        (one,) = client.get(f"/api/v1/cells/{cell}/corrections").json()
        yield Row("list of corrections", f"{1000 * (time.perf_counter() - begin):.0f} ms", "100 ms")
        yield Row("size of the record", f"{one['size'] / 1e6:,.0f} MB")
        address = f"/api/v1/corrections/{one['id']}"
        begin, peak = time.perf_counter(), 0.0
        while not client.get(address).json()["index"]["ready"]:
            peak = max(peak, _children_mb(server.process.pid))
            time.sleep(0.2)
        yield Row("index, once, in a process of its own", f"{time.perf_counter() - begin:.1f} s")
        yield Row("its memory", f"{peak:.0f} MB")
        for what, view in _VIEWS.items():
            first, times = _page(client, address, view, repeats)
            yield Row(f"200 rows, {what}: first, then p95", f"{first:.0f} ms, {times:.0f} ms", "100 ms")
        total = client.get(f"{address}/diff").json()["total"]
        rng = np.random.default_rng(1)
        taken = [
            _ms(client, f"{address}/diff", {"offset": int(at), "limit": 200}) for at in rng.integers(0, total, repeats)
        ]
        yield Row(
            f"200 of {total:,} rows of the difference, p95",
            f"{statistics.quantiles(taken, n=20)[-1]:.0f} ms",
            "100 ms",
        )
        taken = [_ms(client, f"{address}/path.bin", {}) for _ in range(3)]
        yield Row("path with 20,000 points", f"{statistics.median(taken):.0f} ms")
        begin, size = time.perf_counter(), 0
        with client.stream("GET", f"{address}/files.zip") as answer:
            for piece in answer.iter_raw():
                size += len(piece)
        yield Row("files and record as a .zip", f"{time.perf_counter() - begin:.1f} s, {size / 1e6:.0f} MB")
        yield Row("memory of the server at the end", f"{server.memory_mb():.0f} MB", "600 MB")
        yield Row("its peak", f"{memory_mb(server.process.pid, 'VmHWM'):.0f} MB", "600 MB")


def _in_browser(server: Server) -> Iterator[Row]:
    """Use the page of the correction: scroll, sort, filter, look at differences; then its memory."""
    if (chromium := chromium_path()) is None or not (STATIC / "index.html").is_file():
        print("the browser's memory is not measured: needs chromium, and the pages ('make frontend')")
        return
    with Browser.launched(chromium) as browser, browser.opened(server) as app:
        app.go("programs")
        app.page.locator("a[href*='/correction/']").first.click()
        app.ready()
        app.page.locator("[role=row][aria-rowindex='2']").wait_for()
        before = heap_mb(app)
        for header in range(3):  # each in both directions
            for _ in range(2):
                app.page.locator("[role=columnheader] button").nth(header).click()
                app.page.evaluate(_SCROLL, _PLACES)
        yield Row("JavaScript memory of the page with the table and the path", f"{before:.0f} MB", "300 MB")
        yield Row(f"the same, after {6 * _PLACES} places in six orders", f"{heap_mb(app):.0f} MB", "300 MB")
        whole = max(memory_mb(pid) for pid in browser.processes("renderer"))
        yield Row("memory of the page's process, with the code of chromium itself", f"{whole:.0f} MB")


def _page(client: httpx2.Client, address: str, view: dict[str, Any], repeats: int) -> tuple[float, float]:
    """Return the times of the first page of a view and of others [ms]: the latter as 95th percentile."""
    first = _ms(client, f"{address}/targets", {**view, "limit": 200})
    total = client.get(f"{address}/targets", params={**view, "limit": 1}).json()["total"]
    places = np.random.default_rng(0).integers(0, max(1, total), repeats)
    taken = [_ms(client, f"{address}/targets", {**view, "offset": int(at), "limit": 200}) for at in places]
    return first, statistics.quantiles(taken, n=20)[-1]


def _ms(client: httpx2.Client, address: str, query: dict[str, Any]) -> float:
    begin = time.perf_counter()
    client.get(address, params=query).raise_for_status()
    return 1000 * (time.perf_counter() - begin)


def _children_mb(pid: int) -> float:
    """Return the largest resident memory of a process's children [MB]; Linux only."""
    found = [0.0]
    for task in Path(f"/proc/{pid}/task").iterdir():
        children = task / "children"
        found += [memory_mb(int(child)) for child in children.read_text("ascii").split()]
    return max(found)
