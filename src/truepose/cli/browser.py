"""``truepose app``: the application in the browser."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Annotated

import typer

from truepose._extras import needed
from truepose.cli.output import say
from truepose.errors import DataError


def app(
    workspace: Annotated[
        Path, typer.Argument(metavar="WORKSPACE", help="Folder of the cells; created if needed.")
    ] = Path(),
    port: Annotated[int, typer.Option("--port", help="Port of the server; 0: a free one.", min=0, max=65535)] = 8765,
    workers: Annotated[int, typer.Option("--workers", help="Number of jobs that run at once.", min=1)] = 1,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the browser.")] = True,
    cluster: Annotated[
        str, typer.Option("--cluster", envvar="TRUEPOSE_CLUSTER", help="Scheduler of a cluster for the jobs.")
    ] = "",
    demo: Annotated[bool, typer.Option("--demo", help="Add a virtual cell if the workspace holds no cell.")] = False,
    store: Annotated[str | None, typer.Option("--store", metavar="URL", help="Store whose users log in.")] = None,
    host: Annotated[str, typer.Option("--host", help="Address to listen on; another needs --store.")] = "127.0.0.1",
    url: Annotated[
        str | None, typer.Option("--url", help="Address that people open, such as https://truepose.example.")
    ] = None,
) -> None:
    """Show the cells of a folder in the browser: measure, fit, correct and report; other machines only with --store."""
    if store is None and (host != "127.0.0.1" or url is not None):
        raise DataError("--host and --url need users, who log in: name their store with --store URL")
    with needed("the application", "app"):
        import python_multipart  # noqa: F401  # FastAPI's own error about it is another

        from truepose.web.pages import not_built
        from truepose.web.server import WithUsers, serve
        from truepose.web.workspace import Workspace

    if (remedy := not_built()) is not None:
        warnings.warn(remedy, UserWarning, stacklevel=1)
    if cluster:
        os.environ["TRUEPOSE_CLUSTER"] = cluster  # an option of the commands that the jobs run

    if demo and not Workspace(workspace).cells():
        from truepose.cli.output import working
        from truepose.studies.demo import EVERY_VIEW, run_demo

        with working("Making a virtual cell", quiet=False) as progress:
            run_demo(workspace / "virtual-cell", predictor=EVERY_VIEW, progress=progress)

    def announce(url: str) -> None:
        say(f"Open {url}", "Stop with Ctrl-C.")

    users = None if store is None else WithUsers(store, host, url)
    serve(
        workspace,
        port=port,
        workers=workers,
        browser=browser and remedy is None,
        announce=announce,
        users=users,
    )
