"""Start the server in a process, open its pages in Debian's chromium, and listen to what they complain about."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

if TYPE_CHECKING:
    from playwright.sync_api import ConsoleMessage, Page

PAGES: Final = ("cell", "measure", "map", "programs", "verify", "report", "history")
LOCALES: Final = {"en": "en-GB", "de": "de-DE", "zh": "zh-CN"}
_NAMES: Final = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS: Final = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
)
_SHOWN: Final = "start => document.querySelector('nav [aria-current=page]')?.getAttribute('href')?.startsWith(start)"
_READY: Final = "() => document.querySelector('main h1') && !document.querySelector('main [aria-busy=\"true\"]')"


def chromium_path() -> str | None:
    """Return the path of chromium; None if there is none."""
    return next((found for name in _NAMES if (found := shutil.which(name))), None)


@dataclass
class Server:
    """A running ``truepose app``."""

    workspace: Path
    process: subprocess.Popen[str]
    start_url: str

    @property
    def origin(self) -> str:
        """The address without path."""
        return self.start_url.split("/?")[0].rstrip("/")

    @classmethod
    @contextmanager
    def started(cls, workspace: Path, *options: str) -> Iterator[Server]:
        """Start a server on a free port with more options, and stop it at the end."""
        with tempfile.TemporaryDirectory(prefix="truepose-state-") as state:
            command = [sys.executable, "-m", "truepose", "app", str(workspace), "--port", "0", "--no-browser"]
            command += options
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, text=True, env={**os.environ, "TRUEPOSE_STATE": state}
            )
            assert process.stdout is not None
            try:
                line = process.stdout.readline()
                found = re.search(r"http://\S+", line)
                assert found, f"the server printed {line!r}"
                yield cls(workspace, process, found[0])
            finally:
                process.terminate()
                process.wait(20)

    def memory_mb(self) -> float:
        """Return the resident memory of the server's process [MB]; Linux only."""
        text = Path(f"/proc/{self.process.pid}/status").read_text("ascii")
        found = re.search(r"VmRSS:\s+(\d+) kB", text)
        assert found
        return int(found[1]) / 1024


@dataclass
class Opened:
    """A page, and everything that it complained about or asked of other hosts."""

    page: Page
    origin: str
    complaints: list[str] = field(default_factory=list)
    requests: int = 0
    bytes: int = 0

    def __post_init__(self) -> None:
        self.page.on("console", self._said)
        self.page.on("pageerror", lambda error: self.complaints.append(f"error: {error}"))
        self.page.on("request", lambda request: self._asked(request.url))
        # from the start: a key may open a file chooser before the browser hears that somebody waits for one
        self.page.on("filechooser", lambda _: None)

    def _said(self, message: ConsoleMessage) -> None:
        where = message.location.get("url", "").removeprefix(self.origin)
        self.complaints.append(f"console {message.type}: {message.text} {where}")

    def _asked(self, url: str) -> None:
        self.requests += 1
        if not url.startswith((f"{self.origin}/", "blob:", "data:")):
            self.complaints.append(f"asked another host: {url}")

    def go(self, place: str) -> None:
        """Show a page by its route, such as ``map``, in the cell that is chosen, and wait until it is ready."""
        cell = self.page.evaluate("() => location.hash.split('?')[0].split('/')[2] ?? '-'")
        page, _, rest = place.partition("/")
        self.page.evaluate("hash => { location.hash = hash }", f"#/{page}/{cell}" + (f"/{rest}" if rest else ""))
        self.shown(page)

    def shown(self, page: str) -> None:
        """Wait until a page is shown, and the page before is gone."""
        self.page.wait_for_function(_SHOWN, arg=f"#/{page}/")
        self.ready()

    def ready(self) -> None:
        """Wait until the page shows what it loads."""
        self.page.wait_for_function(_READY)
        self.page.evaluate("() => document.fonts.ready.then(() => true)")

    def overflow(self) -> list[str]:
        """Return what is wider than the window, and the elements that cause it."""
        return self.page.evaluate(_OVERFLOW)  # type: ignore[no-any-return]

    def cut_headers(self) -> list[str]:
        """Return the headers of tables whose text does not fit."""
        return self.page.evaluate(_CUT)  # type: ignore[no-any-return]

    def axe(self, source: str) -> list[str]:
        """Return the serious and critical findings of axe-core."""
        if not self.page.evaluate("() => 'axe' in window"):
            self.page.evaluate(f"() => {{ {source}; window.axe = axe }}")
        found: dict[str, Any] = self.page.evaluate(
            "() => axe.run(document, { resultTypes: ['violations'], iframes: false })"
        )
        return [
            f"{one['id']} ({one['impact']}): {node['html'][:160]} {node['any'][0]['message'] if node['any'] else ''}"
            for one in found["violations"]
            if one["impact"] in ("serious", "critical")
            for node in one["nodes"]
        ]


_CUT: Final = """() => [...document.querySelectorAll('main [role=columnheader], main th')]
  .filter((head) => head.offsetParent)
  .filter((head) => head.scrollWidth > head.clientWidth + 1 || head.scrollHeight > head.clientHeight + 1)
  .map((head) => `${head.closest('[aria-label]')?.ariaLabel}: "${head.innerText}" is cut`)"""

_OVERFLOW: Final = """() => {
  const wide = innerWidth + 1
  const found = []
  if (document.documentElement.scrollWidth > wide) found.push(`document: ${document.documentElement.scrollWidth} px`)
  const main = document.querySelector('main')
  if (main && main.scrollWidth > main.clientWidth + 1) {
    found.push(`main: ${main.scrollWidth} of ${main.clientWidth} px`)
    const edge = main.getBoundingClientRect().right
    for (const one of main.querySelectorAll('*')) {
      if (found.length < 6 && one.getBoundingClientRect().right > edge + 1) found.push(one.outerHTML.slice(0, 120))
    }
  }
  return found
}"""


class Browser:
    """A running chromium."""

    def __init__(self, running: Any) -> None:
        self._running = running

    @classmethod
    @contextmanager
    def launched(cls, path: str) -> Iterator[Browser]:
        """Start chromium, and end it."""
        from playwright.sync_api import sync_playwright

        with sync_playwright() as play:
            running = play.chromium.launch(executable_path=path, args=list(_OPTIONS))
            try:
                yield cls(running)
            finally:
                running.close()

    @property
    def version(self) -> str:
        """The version of the browser."""
        return str(self._running.version)

    def processes(self, kind: str) -> list[int]:
        """Return the numbers of the browser's processes of a kind, such as ``renderer``."""
        told = self._running.new_browser_cdp_session().send("SystemInfo.getProcessInfo")
        return [one["id"] for one in told["processInfo"] if one["type"] == kind]

    @contextmanager
    def opened(
        self,
        server: Server,
        *,
        width: int = 1400,
        height: int = 900,
        language: str = "en",
        theme: Literal["light", "dark"] = "light",
    ) -> Iterator[Opened]:
        """Open the start URL in a new session; at the end, fail if the page complained."""
        context = self._running.new_context(
            viewport={"width": width, "height": height},
            locale=LOCALES[language],
            color_scheme=theme,
            reduced_motion="reduce",
            accept_downloads=True,
        )
        try:
            opened = Opened(context.new_page(), server.origin)
            opened.page.set_default_timeout(90_000)  # jobs on a machine that is busy
            opened.page.goto(server.start_url)
            opened.ready()
            yield opened
            assert not opened.complaints, "\n".join(dict.fromkeys(opened.complaints))
        finally:
            context.close()


def give(app: Opened, label: str, *files: Path) -> None:
    """Choose files in the drop zone with a label, as its button does."""
    zone = app.page.get_by_role("group", name=label)
    with app.page.expect_file_chooser() as chooser:
        zone.get_by_role("button").first.click()
    chooser.value.set_files([str(file) for file in files])
