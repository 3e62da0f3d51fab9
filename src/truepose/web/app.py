"""The application: routes, security and the pages that Vite built."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import cache
from typing import Any

from fastapi import APIRouter, Depends, FastAPI, Request
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute

from truepose._version import version
from truepose.jobs import JobQueue
from truepose.web import history, jobs, login, pages, problems, releases, reports, session, users, verifications
from truepose.web.arms import routes as arms
from truepose.web.cells import routes as cells
from truepose.web.corrections import routes as corrections
from truepose.web.maps import routes as maps
from truepose.web.measure import routes as measure
from truepose.web.meshes import routes as meshes
from truepose.web.programs import previews
from truepose.web.programs import routes as programs
from truepose.web.security import Gate
from truepose.web.team.team import Team
from truepose.web.workspace import Workspace

API = "/api/v1"


async def _permitted(request: Request) -> None:
    request.app.state.guard.permit(request)


def create_app(
    workspace: Workspace, guard: Gate, *, workers: int = 1, ready: bool = False, team: Team | None = None
) -> FastAPI:
    """Return the application of a workspace.

    Parameters
    ----------
    workspace : Workspace
        The folder of cells that the pages show and write.
    guard : Gate
        The guard: `Guard` with a start-up token, or `TeamGuard`.
    workers : int
        The largest number of jobs that run at once.
    ready : bool
        Whether a process waits for the next job with its modules imported.
    team : Team, optional
        The users, with a store.
    """
    environment = None if team is None else team.job_environment
    queue = JobQueue(workspace.root, workers=workers, ready=ready, environment=environment)
    workspace.promises.jobs = queue.list

    @asynccontextmanager
    async def running(_app: FastAPI) -> AsyncIterator[dict[str, Any]]:
        with queue:
            yield {}

    app = FastAPI(
        title="truepose",
        version=version(),
        lifespan=running,
        docs_url=None,  # these pages load scripts from elsewhere
        redoc_url=None,
        openapi_url=f"{API}/openapi.json",
        generate_unique_id_function=_name,
    )
    app.state.workspace, app.state.guard, app.state.jobs, app.state.team = workspace, guard, queue, team
    problems.install(app)
    app.router.routes.extend(_routes())
    pages.install(app)
    app.add_middleware(guard.middleware)
    return app


def _name(route: APIRoute) -> str:
    return route.name


@cache
def _routes() -> list[BaseRoute]:
    """Return the routes of all applications; to make their contracts takes half a second."""
    api = APIRouter(prefix=API, dependencies=[Depends(_permitted)])
    for routes in (
        session,
        login,
        users,
        releases,
        cells,
        arms,
        meshes,
        measure,
        maps,
        programs,
        previews,
        corrections,
        verifications,
        reports,
        history,
        jobs,
    ):
        api.include_router(routes.router)
    made = FastAPI(openapi_url=None, generate_unique_id_function=_name)
    made.include_router(api)
    made.include_router(session.health)
    return made.routes
