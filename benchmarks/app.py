"""The application in a real browser: time until a page is ready, answers, many clients, and memory over hours.

``TRUEPOSE_SOAK_MINUTES`` is the length of the soak (20).
"""

from __future__ import annotations

import os
import re
import statistics
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import httpx2
from tests.browser.opening import PAGES, Browser, Opened, Server

from benchmarks.harness import version_of
from benchmarks.pages import Row, browser_with_virtual_cell, heap_mb, write_table
from truepose.web.pages import STATIC

PAGE: Final = "app"
PACKAGES: Final = ("fastapi", "uvicorn", "starlette")
CLIENTS: Final = 20
_SHOW: Final = """async (hash) => {
  const begin = performance.now()
  location.hash = hash
  await new Promise(requestAnimationFrame)
  while (!document.querySelector('main h1') || document.querySelector('main [aria-busy="true"]')) {
    await new Promise(requestAnimationFrame)
  }
  return performance.now() - begin
}"""
_ASK: Final = """async () => {
  const begin = performance.now()
  await (await fetch('/api/v1/cells')).json()
  await new Promise(requestAnimationFrame)
  return performance.now() - begin
}"""
_LOADED: Final = """() => {
  const all = [...performance.getEntriesByType('navigation'), ...performance.getEntriesByType('resource')]
  const shown = performance.getEntriesByName('first-contentful-paint')[0]
  return { bytes: all.reduce((sum, one) => sum + one.transferSize, 0), requests: all.length, paint: shown?.startTime }
}"""


def report(path: Path | None, *, quick: bool) -> None:
    """Measure, print, and write the page if it is wanted."""
    with browser_with_virtual_cell() as opened:
        if opened is None:
            return
        browser, server = opened
        versions = ", ".join(f"{name} {version_of(name)}" for name in PACKAGES)
        how = (
            "A real browser without graphics hardware, the server in a process of its own on the same machine, a "
            f"workspace with one virtual cell. chromium {browser.version}, {versions}."
        )
        write_table(path, "The application", how, "app", _rows(browser, server, quick))


def _rows(browser: Browser, server: Server, quick: bool) -> Iterator[Row]:
    yield from _loading(browser, server, 2 if quick else 10)
    yield from _moving(browser, server, 2 if quick else 20)
    yield from _clients(server, 5 if quick else 50)
    yield from _soak(browser, server, 0.2 if quick else float(os.environ.get("TRUEPOSE_SOAK_MINUTES", "20")))


def _loading(browser: Browser, server: Server, repeats: int) -> Iterator[Row]:
    """Open the start URL in new sessions, whose cache is empty."""
    seconds, loaded = [], {}
    for _ in range(repeats):
        begin = time.perf_counter()
        with browser.opened(server) as app:
            seconds.append(time.perf_counter() - begin)
            loaded = app.page.evaluate(_LOADED)
    yield Row("first page ready, empty cache, median", f"{statistics.median(seconds):.2f} s", "1.5 s")
    yield Row("sent until then", f"{loaded['bytes'] / 1000:.0f} kB in {loaded['requests']} requests")
    for name, ending, wanted in (("brotli", "br", "300 kB"), ("gzip", "gz", "")):
        size = sum(path.stat().st_size for path in STATIC.rglob(f"*.{ending}"))
        yield Row(f"all pages, compressed with {name}", f"{size / 1000:.0f} kB", wanted)


def _moving(browser: Browser, server: Server, repeats: int) -> Iterator[Row]:
    """Move from page to page, each of which asks the server for what it shows."""
    with browser.opened(server) as app:
        times: dict[str, list[float]] = {page: [] for page in PAGES}
        for turn in range(repeats + 1):
            for page in PAGES:
                taken = app.page.evaluate(_SHOW, f"#/{page}/{_cell(app)}")
                if turn:  # the first one also loads the page's code
                    times[page].append(taken)
        every = [one for taken in times.values() for one in taken]
        answers = [app.page.evaluate(_ASK) for _ in range(10 * repeats)]
    yield Row("a question of a page until its answer is there, p50", f"{statistics.median(answers):.0f} ms")
    yield Row("the same, p95", f"{_p95(answers):.0f} ms", "100 ms")
    yield Row(
        "click on a page until all of it is there, 3-D and preview included, p50", f"{statistics.median(every):.0f} ms"
    )
    yield Row("the same, p95", f"{_p95(every):.0f} ms")
    slowest = max(times, key=lambda page: statistics.median(times[page]))
    yield Row("slowest page, p50", f"{statistics.median(times[slowest]):.0f} ms ({slowest})")


def _clients(server: Server, repeats: int) -> Iterator[Row]:
    """Let many clients ask at once, each for what the pages ask."""
    with _client(server) as client:
        cell = client.get("/api/v1/cells").json()[0]["id"]
    asked = ["/api/v1/cells", *(f"/api/v1/cells/{cell}/{what}" for what in ("files", "verifiable", "history"))]

    def ask(_: int) -> list[float]:
        taken = []
        with _client(server) as client:
            for _ in range(repeats):
                for address in asked:
                    begin = time.perf_counter()
                    client.get(address).raise_for_status()
                    taken.append(1000 * (time.perf_counter() - begin))
        return taken

    begin = time.perf_counter()
    with ThreadPoolExecutor(CLIENTS) as pool:
        times = [one for taken in pool.map(ask, range(CLIENTS)) for one in taken]
    rate = len(times) / (time.perf_counter() - begin)
    yield Row(f"{CLIENTS} clients at once, {len(times)} requests, errors", "0", "0")
    yield Row("their answers, p50 and p95", f"{statistics.median(times):.0f} ms, {_p95(times):.0f} ms")
    yield Row("requests per second", f"{rate:.0f}")


def _soak(browser: Browser, server: Server, minutes: float) -> Iterator[Row]:
    """Use all pages for a long time; memory is compared after a tenth of it and at the end."""
    first, turns = 0.0, 0
    with browser.opened(server) as app:
        begin = time.monotonic()
        while (gone := time.monotonic() - begin) < 60 * minutes:
            for page in PAGES:
                app.page.evaluate(_SHOW, f"#/{page}/{_cell(app)}")
                app.page.wait_for_timeout(100)
            turns += 1
            if not first and gone > 6 * minutes:
                first, heap = server.memory_mb(), heap_mb(app)
        grown, heap_grown = server.memory_mb() - first, heap_mb(app) - heap
    yield Row(f"memory of the server after {minutes:g} minutes ({turns} turns)", f"{server.memory_mb():.0f} MB")
    yield Row("its growth since a tenth of that time", f"{grown:+.1f} MB", "5 MB")
    yield Row("growth of the page's JavaScript memory", f"{heap_grown:+.1f} MB")


@contextmanager
def _client(server: Server) -> Iterator[httpx2.Client]:
    with httpx2.Client(base_url=server.origin, timeout=30) as client:
        client.get(server.start_url)
        yield client


def _cell(app: Opened) -> str:
    found = re.search(r"#/\w+/(\w+)", app.page.url)
    return found[1] if found else "-"


def _p95(values: list[float]) -> float:
    return statistics.quantiles(values, n=20)[-1]
