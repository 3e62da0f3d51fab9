"""The pages that Vite built, sent compressed where the browser takes it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from fastapi import FastAPI
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from truepose.web.problems import problem_response

STATIC: Final = Path(__file__).parent / "static"
_KINDS: Final = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".json": "application/json",
    ".ico": "image/x-icon",
    ".png": "image/png",
}
_PACKED: Final = {"br": ".br", "gzip": ".gz"}
CLONE: Final = Path(__file__).parents[3]
"""The folder of the sources, where the package is used from there."""


def not_built() -> str | None:
    """Return one line that says how to get the pages where this installation has none; None where it has them."""
    if (STATIC / "index.html").is_file():
        return None
    if (CLONE / "frontend" / "package.json").is_file():
        return "the pages are not built; run 'make frontend' in the clone"
    return (
        "this installation has no pages, because they were not built when it was made; run 'make frontend' in the "
        "clone and install it again (pip install '.[app]'), or install the wheel of a release, which has them"
    )


def install(app: FastAPI) -> None:
    """Serve the built files: the page itself at ``/``, the others below ``/assets``."""

    @app.get("/", include_in_schema=False)
    def index(request: Request) -> Response:
        if (remedy := not_built()) is not None:
            return problem_response(503, "Not built", remedy)
        return _send("index.html", request.headers, "no-cache")

    @app.get("/assets/{name}", include_in_schema=False)
    def asset(name: str, request: Request) -> Response:
        if name not in _built(STATIC / "assets"):
            raise HTTPException(404, "no such file")
        return _send(f"assets/{name}", request.headers, "public, max-age=31536000, immutable")


def _built(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} if folder.is_dir() else set()


def _send(name: str, headers: Headers, cache: str) -> Response:
    """Return a built file, in the first compressed form that exists and is accepted."""
    path = STATIC / name
    sent = {"Cache-Control": cache, "Vary": "Accept-Encoding"}
    accepted = {one.split(";")[0].strip() for one in headers.get("accept-encoding", "").split(",")}
    kind = _KINDS.get(path.suffix, "application/octet-stream")
    for coding, suffix in _PACKED.items():
        if coding in accepted and (packed := path.with_name(path.name + suffix)).is_file():
            return FileResponse(packed, media_type=kind, headers={**sent, "Content-Encoding": coding})
    return FileResponse(path, media_type=kind, headers=sent)
