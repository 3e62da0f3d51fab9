"""PostgreSQL lost while a correction or the application uses it: a remedy is named, and nothing is half done."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from tests.store.plant import plant
from tests.store.servers import OwnServer
from tests.web.people import add_people, browsers, enter

from truepose.programs import batch
from truepose.store import records, schema
from truepose.store.store import Store
from truepose.store.verify import verify

_NUMBERS = itertools.count()
_OPTIONS = ("--on-guard", "skip", "--accept-weak-map")
Lose = Callable[[], None]


@pytest.fixture(scope="module")
def server() -> Iterator[OwnServer]:
    with OwnServer() as started:
        yield started


@pytest.fixture
def address(server: OwnServer) -> Iterator[str]:
    """The address of a new store; the server runs again afterwards."""
    made = server.make_database(f"lost_{next(_NUMBERS)}")
    Store.open(made, create=True).close()
    yield made
    server.start()


@pytest.fixture
def lose(server: OwnServer, address: str, request: pytest.FixtureRequest) -> Lose:
    """Return a function that stops the server, or ends its processes for the store."""
    if request.param == "stopped":
        return server.stop

    def kill() -> None:
        with Store.open(address) as store, store.backend.engine.begin() as connection:
            connection.exec_driver_sql(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )

    return kill


@pytest.fixture
def correct(run: Callable[..., Any], address: str, tmp_path: Path) -> Callable[..., Any]:
    """Return a function that corrects the program of the plant, whose map the store has."""
    folder = Path(shutil.copytree(plant().folder, tmp_path / "robot17"))
    assert run("store", "import", folder / "map.truepose", "--store", address).code == 0
    out = tmp_path / "corrected"
    command = ("correct", folder / "map.truepose", folder / "part.csv", "--out", out, *_OPTIONS, "--store", address)
    return lambda *more: run(*command, *more)


def before(patch: pytest.MonkeyPatch, place: Any, name: str, lose: Lose) -> None:
    """Lose the server each time before a function runs."""
    real = getattr(place, name)

    def losing(*arguments: Any, **named: Any) -> Any:
        lose()
        return real(*arguments, **named)

    patch.setattr(place, name, losing)


def reason(done: Any) -> str:
    """Return the error of a command that failed; a line before it may say that numerical kernels are compiled."""
    assert done.code == 1, done
    assert "Traceback" not in done.err
    return str(done.err.splitlines()[-1])


def rows(address: str) -> tuple[int, int]:
    """Return the numbers of programs and corrections of a store whose chain is whole."""
    with Store.open(address) as store:
        assert verify(store).faults == []
        with store.reading() as connection:
            programs, corrections = (
                connection.execute(sa.select(sa.func.count()).select_from(table)).scalar_one()
                for table in (schema.program, schema.correction)
            )
    return programs, corrections


@pytest.mark.exhaustive
@pytest.mark.parametrize("lose", ["stopped"], indirect=True)
def test_a_server_stopped_during_the_correction(correct, lose, server, address, tmp_path, state) -> None:
    """Nothing is written, neither files nor rows, and the same command succeeds when the server runs again."""
    with pytest.MonkeyPatch.context() as patch:
        before(patch, batch, "correct_read", lose)
        failed = reason(correct())
    assert address.replace("+psycopg", "").partition("?")[0].split("@")[-1] in failed
    assert "cannot be reached" in failed
    assert "check the address, and that the server runs; then try again" in failed
    assert not (tmp_path / "corrected").exists()
    assert list(state.iterdir()) == []  # nor is it remembered as corrected
    server.start()
    assert rows(address) == (0, 0)
    done = correct()
    assert done.code == 0, done
    assert rows(address) == (1, 1)


@pytest.mark.parametrize("lose", ["killed"], indirect=True)
def test_a_lost_connection_is_made_again(correct, lose, address) -> None:
    with pytest.MonkeyPatch.context() as patch:
        before(patch, batch, "correct_read", lose)
        done = correct()
    assert done.code == 0, done
    assert rows(address) == (1, 1)


@pytest.mark.exhaustive
@pytest.mark.parametrize("lose", ["stopped", "killed"], indirect=True)
@pytest.mark.parametrize("place", ["put_program", "put_correction"])
def test_a_server_lost_while_rows_are_written(correct, place, lose, server, address, tmp_path) -> None:
    """The files are complete, no row is stored, and the message says how to record them."""
    with pytest.MonkeyPatch.context() as patch:
        before(patch, records, place, lose)
        failed = reason(correct())
    assert "the connection to the store was lost" in failed
    assert "but the store has no row of it: run the same command again with --force" in failed
    assert {path.name for path in (tmp_path / "corrected").iterdir()} >= {"part.csv", "part.corrections.json"}
    server.start()
    assert rows(address) == (0, 0)
    done = correct("--force")
    assert done.code == 0, done
    assert rows(address) == (1, 1)


@pytest.mark.exhaustive
@pytest.mark.parametrize("lose", ["stopped"], indirect=True)
def test_a_program_corrected_in_place_is_taken_in_later(run, lose, server, address, tmp_path) -> None:
    folder = Path(shutil.copytree(plant().folder, tmp_path / "robot17"))
    assert run("store", "import", folder / "map.truepose", "--store", address).code == 0
    with pytest.MonkeyPatch.context() as patch:
        before(patch, records, "put_correction", lose)
        place = (folder / "map.truepose", folder / "part.csv", "--in-place")
        failed = reason(run("correct", *place, *_OPTIONS, "--store", address))
    assert f"take it in with 'truepose store import {folder}" in failed
    server.start()
    assert rows(address) == (0, 0)
    assert run("store", "import", folder, "--store", address).code == 0
    assert rows(address) == (1, 1)


@pytest.mark.exhaustive
def test_the_application_says_that_the_store_is_lost_and_works_again(server, address, tmp_path, quick_hashes) -> None:
    from truepose.web import Workspace
    from truepose.web.team.team import Team

    with Store.open(address) as store:
        add_people(store)
        browser = browsers(Workspace(tmp_path / "work"), Team(store, address))
        client, other = browser("reader"), browser()
        assert client.get("/api/v1/cells").status_code == 200
        server.stop()
        for answer in (client.get("/api/v1/cells"), enter(other, "reader", "a long enough password")):
            assert answer.status_code == 503
            assert answer.headers["content-type"] == "application/problem+json"
            said = answer.json()
            assert "check the address, and that the server runs" in f"{said['title']} {said['detail']}"
        server.start()
        assert client.get("/api/v1/cells").status_code == 200  # the session goes on
        assert enter(other, "reader", "a long enough password").status_code == 204
        assert verify(store).faults == []
