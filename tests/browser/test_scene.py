"""The 3-D view: its numbers with 100,000 arrows, and what it does without graphics, without a context, by keyboard."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import pytest
from tests.browser.opening import Browser, Opened, Server

MB: Final = 1 << 20
MANY: Final = 100_000
_FILL: Final = """(n) => {
  const [before, after] = [new Float32Array(7 * n), new Float32Array(7 * n)]
  for (let k = 0; k < n; k++) {
    const p = [1200 + (k * 7919 % 1000), (k * 104729 % 1600) - 800, 400 + (k * 1299709 % 900)]
    const e = [Math.sin(p[0] / 200), Math.cos(p[1] / 300), Math.sin(p[2] / 150)]
    before.set([...p, ...e, 0.1], 7 * k)
    after.set([...p, ...e.map((v) => 0.1 * v), 0.1], 7 * k)
  }
  window.filled = { before, after }
  document.querySelector('.scene-host').scene.setArrows(window.filled)
}"""
_COUNTERS: Final = "() => document.querySelector('.scene-host').scene.counters()"
_SETTLED: Final = """async () => {
  const scene = document.querySelector('.scene-host').scene
  for (let still = 0, last = -1; still < 6; ) {
    await new Promise((done) => setTimeout(done, 100))
    const now = scene.counters().frames
    still = now === last ? still + 1 : 0
    last = now
  }
  return scene.counters()
}"""


@pytest.fixture
def app(browser: Browser, server: Server) -> Iterator[Opened]:
    """The page of maps with its 3-D view."""
    with browser.opened(server) as opened:
        opened.go("map")
        opened.page.wait_for_selector(".scene-host canvas")
        yield opened


def settled(app: Opened) -> dict[str, Any]:
    """Return the counters once no more frames are drawn."""
    found: dict[str, Any] = app.page.evaluate(_SETTLED)
    return found


@pytest.mark.exhaustive
def test_many_arrows_stay_within_the_numbers(app: Opened) -> None:
    app.page.evaluate(_FILL, 100)
    settled(app)
    few = script_time(app)
    app.page.evaluate(_FILL, MANY)
    found = settled(app)
    assert found["arrowsTotal"] == MANY
    assert found["calls"] <= 20
    assert found["gpuBytes"] <= 64 * MB
    assert script_time(app) <= 2 * few + 2.0  # not a thousand times: the graphics card moves the arrows


def script_time(app: Opened) -> float:
    """Return the median of the milliseconds of JavaScript in a frame while the view turns."""
    times = []
    app.page.focus(".scene-host canvas")
    for key in ["ArrowLeft", "ArrowUp", "+", "Shift+ArrowRight"] * 5:
        app.page.keyboard.press(key)
        app.page.wait_for_timeout(30)
        times.append(settled_script(app))
    return sorted(times)[len(times) // 2]


def settled_script(app: Opened) -> float:
    return float(app.page.evaluate(_COUNTERS)["scriptMs"])


@pytest.mark.exhaustive
def test_slow_graphics_show_fewer_arrows_and_say_so(app: Opened) -> None:
    app.page.evaluate(_FILL, MANY)
    found = settled(app)
    assert found["reduced"]  # this browser draws with the processor
    assert found["arrowsShown"] == 5000
    assert "5,000 of 100,000 shown" in app.page.inner_text(".scene-legend")
    app.page.evaluate("() => document.querySelector('.scene-host').scene.setReduced('never')")
    assert settled(app)["arrowsShown"] == MANY
    assert "shown" not in app.page.inner_text(".scene-legend")


@pytest.mark.exhaustive
def test_nothing_is_drawn_while_nothing_changes(app: Opened) -> None:
    before = settled(app)["frames"]
    app.page.wait_for_timeout(500)
    assert app.page.evaluate(_COUNTERS)["frames"] == before
    app.page.mouse.move(600, 400)  # a tooltip needs no new picture
    app.page.wait_for_timeout(200)
    assert app.page.evaluate(_COUNTERS)["frames"] == before
    app.page.focus(".scene-host canvas")
    app.page.keyboard.press("ArrowLeft")
    app.page.wait_for_timeout(300)
    assert app.page.evaluate(_COUNTERS)["frames"] > before


@pytest.mark.exhaustive
def test_a_view_that_is_left_frees_its_memory(app: Opened) -> None:
    first = settled(app)
    for _ in range(3):
        app.page.evaluate(_FILL, 1000)
        app.page.evaluate("() => document.querySelector('.scene-host').scene.setSlice(null)")
    app.page.evaluate(
        "() => document.querySelector('.scene-host').scene.setArrows({ before: window.filled.before.slice(0, 700) })"
    )
    last = settled(app)
    assert last["geometries"] <= first["geometries"]
    assert last["textures"] <= first["textures"]
    app.go("cell")
    app.go("map")
    app.page.wait_for_selector(".scene-host canvas")
    assert app.page.locator(".scene-host canvas").count() == 1


@pytest.mark.exhaustive
def test_a_lost_context_is_told_and_comes_back(app: Opened) -> None:
    settled(app)
    app.page.evaluate(
        """() => {
          const gl = document.querySelector('.scene-host canvas').getContext('webgl2')
          window.loss = gl.getExtension('WEBGL_lose_context')
          window.loss.loseContext()
        }"""
    )
    app.page.wait_for_selector(".scene-host > .scene-note:not([hidden])")
    app.page.evaluate("() => window.loss.restoreContext()")
    app.page.wait_for_selector(".scene-host > .scene-note", state="hidden")
    assert settled(app)["calls"] > 0
    app.complaints[:] = [one for one in app.complaints if "Context Lost" not in one and "Context Restored" not in one]


def test_without_webgl_a_sentence_stands_and_the_tables_remain(browser: Browser, server: Server) -> None:
    with browser.opened(server) as app:
        app.page.add_init_script(
            "HTMLCanvasElement.prototype.getContext = new Proxy(HTMLCanvasElement.prototype.getContext, { apply:"
            " (get, canvas, [kind, ...more]) => kind.startsWith('webgl') ? null : get.call(canvas, kind, ...more) })"
        )
        app.page.reload()
        app.ready()
        app.go("map")
        assert "WebGL" in app.page.inner_text(".scene-note")
        app.page.get_by_role("tab", name="Samples").click()
        assert app.page.get_by_role("row").count() > 5


@pytest.mark.exhaustive
def test_the_theme_repaints_the_view(app: Opened) -> None:
    settled(app)
    light = app.page.locator(".scene-host canvas").screenshot()
    app.page.evaluate("() => { document.documentElement.dataset.theme = 'dark' }")
    settled(app)
    assert app.page.locator(".scene-host canvas").screenshot() != light


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "unit"), [("Nugget", "mm²"), ("Partial sill", "mm²"), ("Range", "mm")])
def test_a_handle_of_the_variogram_moves_by_keys_and_holds_its_parameter(app: Opened, name: str, unit: str) -> None:
    app.page.get_by_role("tab", name="Variogram").click()
    app.ready()
    handle = app.page.get_by_role("slider", name=name, exact=True)
    handle.wait_for()
    handle.focus()
    with app.page.expect_response(lambda answer: answer.request.method == "POST" and "variogram" in answer.url) as news:
        handle.press("Shift+ArrowUp" if name != "Range" else "Shift+ArrowLeft")
    sent = news.value.request.post_data_json
    key = {"Nugget": "nugget", "Partial sill": "sill", "Range": "range"}[name]
    model = news.value.json()["model"]
    assert sent["hold"]
    assert model["range" if key == "range" else f"{key}_mm2"] == pytest.approx(sent[key])
    command = app.page.locator("code", has_text="truepose similarity")
    app.page.wait_for_function("() => document.querySelector('main').innerText.includes('--hold')")
    assert f"--{key}" in command.inner_text()
    app.page.get_by_role("button", name="Fit all again").click()
    app.page.wait_for_function("() => !document.querySelector('main').innerText.includes('--hold')")


@pytest.mark.exhaustive
def test_a_grid_is_asked_for_once_and_named_as_predicted(app: Opened) -> None:
    asked: list[str] = []
    app.page.on("request", lambda request: asked.append(request.url) if ".bin" in request.url else None)
    app.page.locator(".controls select").first.select_option("grid")
    app.page.wait_for_function("() => document.querySelector('.scene-legend').innerText.includes('predicted error')")
    app.page.get_by_label("Cloud of the standard deviation").check()
    app.page.wait_for_function(
        "() => document.querySelector('.scene-legend').innerText.includes('standard deviation')", timeout=60_000
    )
    app.page.wait_for_timeout(500)
    assert len(asked) == 2, asked
    assert settled(app)["calls"] <= 20
