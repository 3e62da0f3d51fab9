"""The 3-D view in a real browser: 100,000 arrows, JavaScript in a frame, draw calls, and memory of the graphics."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tests.browser.opening import Opened

from benchmarks.pages import Row, browser_with_virtual_cell, write_table

PAGE: Final = "app-scene"
_FILL: Final = """async (n) => {
  const scene = document.querySelector('.scene-host').scene
  const rows = new Float32Array(7 * n)
  for (let k = 0; k < n; k++) {
    const p = [1200 + (k * 7919 % 1000), (k * 104729 % 1600) - 800, 400 + (k * 1299709 % 900)]
    rows.set([...p, Math.sin(p[0] / 200), Math.cos(p[1] / 300), Math.sin(p[2] / 150), 0.1], 7 * k)
  }
  const after = rows.map((value, k) => k % 7 > 2 ? 0.1 * value : value)
  scene.setArrows(null)
  await new Promise((done) => setTimeout(done, 600))
  const begin = performance.now()
  scene.setArrows({ before: rows, after })
  const script = performance.now() - begin
  while (!(scene.counters().arrowsMs >= 0)) await new Promise((done) => setTimeout(done, 1))
  return { script, shown: scene.counters().arrowsMs }
}"""
_TURN: Final = """async (turns) => {
  const canvas = document.querySelector('.scene-host canvas')
  const scene = document.querySelector('.scene-host').scene
  const taken = []
  for (let k = 0; k < turns; k++) {
    const before = scene.counters().frames
    canvas.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft' }))
    while (scene.counters().frames === before) await new Promise((done) => setTimeout(done, 1))
    taken.push(scene.counters().scriptMs)
  }
  return taken
}"""
_COUNTERS: Final = "() => document.querySelector('.scene-host').scene.counters()"
_SET: Final = "how => document.querySelector('.scene-host').scene.setReduced(how)"


def report(path: Path | None, *, quick: bool) -> None:
    """Measure, print, and write the page if it is wanted."""
    with browser_with_virtual_cell() as opened:
        if opened is None:
            return
        browser, server = opened
        how = (
            f"The page of maps in chromium {browser.version} without graphics hardware: the processor draws "
            "(SwiftShader), so that times of whole frames are not those of a graphics card."
        )
        with browser.opened(server) as app:
            app.go("map")
            app.page.wait_for_selector(".scene-host canvas")
            app.page.wait_for_timeout(2000)
            rows = _rows(app, 1_000 if quick else 100_000, 3 if quick else 9)
            write_table(path, "The 3-D view", how, "scene", rows)


def _rows(app: Opened, n: int, repeats: int) -> Iterator[Row]:
    filled = [app.page.evaluate(_FILL, n) for _ in range(repeats)]
    shown, script = (statistics.median(one[key] for one in filled) for key in ("shown", "script"))
    found: dict[str, Any] = app.page.evaluate(_COUNTERS)
    what = f"{n:,} arrows with errors before and after"
    yield Row(f"{what}: until the first frame with them is on the screen, median", f"{shown / 1000:.2f} s", "0.3 s")
    yield Row("of it in JavaScript", f"{script:.0f} ms")
    app.page.wait_for_timeout(3000)
    found = app.page.evaluate(_COUNTERS)
    yield Row("arrows shown where frames take over 50 ms", f"{found['arrowsShown']:,} of {n:,}", "5,000")
    yield from _frames(app, "that many arrows", 10 * repeats)
    app.page.evaluate(_SET, "never")
    app.page.wait_for_timeout(8000)
    yield from _frames(app, f"all {n:,} arrows", repeats)
    found = app.page.evaluate(_COUNTERS)
    yield Row("draw calls of a frame", f"{found['calls']}", "20")
    yield Row("vertex buffers and textures", f"{found['gpuBytes'] / (1 << 20):.1f} MB", "64 MB")


def _frames(app: Opened, what: str, turns: int) -> Iterator[Row]:
    taken = app.page.evaluate(_TURN, turns)
    yield Row(
        f"JavaScript in a frame, {what}, median and maximum of {turns}",
        f"{statistics.median(taken):.1f} ms, {max(taken):.1f} ms",
        "4 ms",
    )
