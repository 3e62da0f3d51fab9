"""Errors as problem documents (RFC 9457): what is wrong, in which file and line, and the remedy."""

from __future__ import annotations

import json
import logging
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.responses import Response

from truepose.errors import TrueposeError
from truepose.problem import document, problem

_LOG = logging.getLogger(__name__)


class WebError(TrueposeError):
    """An error of a request itself, with its status.

    Parameters
    ----------
    status : int
        The status of the answer.
    title : str
        The kind of problem in some words.
    detail : str
        The problem and its remedy.
    headers : mapping of str to str, optional
        The headers of the answer.
    """

    def __init__(self, status: int, title: str, detail: str, headers: Mapping[str, str] | None = None) -> None:
        self.status, self.title, self.headers = status, title, dict(headers or {})
        super().__init__(detail)

    def response(self) -> Response:
        """Return the answer."""
        return problem_of(self)


def missing(what: str) -> WebError:
    """Return the error of something that is not in the workspace."""
    return WebError(404, "Not found", f"{what} is not in this workspace; reload the page")


def problem_response(
    status: int, title: str, detail: str, *, headers: Mapping[str, str] | None = None, **members: Any
) -> Response:
    """Return a problem document as an answer."""
    body = {"type": "about:blank", "title": title, "status": status, "detail": detail, **members}
    text = json.dumps(body, ensure_ascii=False).encode("utf-8", "backslashreplace")
    return Response(text, status, media_type="application/problem+json", headers=dict(headers or {}))


def problem_of(error: Exception) -> Response:
    """Return the answer to a request that ended with an error."""
    made = problem(error)
    if made["type"] == "DiskFullError":
        made["detail"] = "the disk is full; nothing was written; free some space and repeat"
    elif not isinstance(error, TrueposeError):
        _LOG.error("internal error", exc_info=error)
        made = document("InternalError", f"internal error ({type(error).__name__})")
        made["detail"] += "; the server's terminal shows more; please report it"
    headers = error.headers if isinstance(error, WebError) else None
    return problem_response(**made, headers=headers)


def install(app: FastAPI) -> None:
    """Answer every error of the application with a problem document."""

    def answer(make: Callable[[Any], Response]) -> Callable[[Request, Exception], Awaitable[Response]]:
        async def handle(_request: Request, error: Exception) -> Response:
            return make(error)

        return handle

    app.add_exception_handler(TrueposeError, answer(problem_of))
    app.add_exception_handler(OSError, answer(problem_of))
    app.add_exception_handler(RequestValidationError, answer(_invalid))
    app.add_exception_handler(HTTPException, answer(_http))
    app.add_exception_handler(Exception, answer(problem_of))


def _invalid(error: RequestValidationError) -> Response:
    found = [{"field": ".".join(map(str, one["loc"][1:])), "message": one["msg"]} for one in error.errors()]
    words = "; ".join(f"{one['field'] or 'body'}: {one['message']}" for one in found)
    return problem_response(422, "Request not accepted", words, errors=found)


def _http(error: HTTPException) -> Response:
    return problem_response(error.status_code, str(error.detail), str(error.detail), headers=error.headers)
