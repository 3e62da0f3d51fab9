"""Commands of a store about its content: import, list, release, withdraw and recall."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from truepose.cli.options import Json
from truepose.cli.output import emit_json, say, table, working
from truepose.cli.store import StoreAddress
from truepose.cli.store_login import PasswordStdin, UserName, logged_in, signing
from truepose.cli.summaries import show_facts

if TYPE_CHECKING:
    from truepose.store.releases import Recall

StoredMap = Annotated[
    str, typer.Argument(metavar="MAP", help="A map of the store: its name, or 8 or more digits of its SHA-256.")
]
_HASH: Final = 12
_SHOWN: Final = 60
_RECALLED: Final = (
    "program",
    "program_sha256",
    "robot",
    "output_sha256",
    "record_sha256",
    "draft",
    "other_robot",
    "made_by",
    "created",
)


class Listed(StrEnum):
    """A kind of object of a store."""

    cells = "cells"
    maps = "maps"
    programs = "programs"
    corrections = "corrections"
    verifications = "verifications"


_COLUMNS: Final[dict[Listed, tuple[str, ...]]] = {
    Listed.cells: ("name", "version", "made_by", "created"),
    Listed.maps: ("name", "sha256", "state", "predictor", "made_by", "created"),
    Listed.programs: ("name", "sha256", "made_by", "created"),
    Listed.corrections: ("id", "output_sha256", "targets", "corrected", "draft", "made_by", "created"),
    Listed.verifications: ("id", "kind", "map_id", "correction_id", "made_by", "created"),
}


def import_folder(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A folder of cells, or one file.")],
    store: StoreAddress,
    user: UserName = None,
    password_stdin: PasswordStdin = False,
    as_json: Json = False,
) -> None:
    """Take in cells, samples, maps, corrections and verifications; what the store has already is not added again."""
    with (
        logged_in(store, user, password_stdin, below=folder) as (found, by),
        working("Reading the folder", quiet=as_json) as progress,
    ):
        from truepose.store.importing import import_folder as take

        done = take(found, by, folder, progress.count)
    if as_json:
        emit_json(done.to_dict())
        return
    new = ", ".join(f"{kind}: {n}" for kind, n in done.counts().items()) or "nothing new"
    say(f"Took in {new}; {len(done.known)} were there already, {done.others} other files.")
    for one in done.left_out:
        say(f"[yellow]Left out[/]: {one.path}: {one.reason}")


def list_objects(
    kind: Annotated[Listed, typer.Argument(metavar="KIND", help="Kind of the objects.")],
    store: StoreAddress,
    limit: Annotated[int, typer.Option("--limit", help="Largest number of rows.", min=1, max=1000)] = 50,
    after: Annotated[int | None, typer.Option("--after", help="The 'following' of the page before (--json).")] = None,
    user: UserName = None,
    password_stdin: PasswordStdin = False,
    as_json: Json = False,
) -> None:
    """List objects of the store, the newest first."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import schema
        from truepose.store.access import viewing
        from truepose.store.rows import page

        with viewing(found, by) as connection:
            part = page(connection, schema.metadata.tables[kind.value[:-1]], after=after, limit=limit)
    if as_json:
        emit_json({kind.value: part.rows, "following": part.following})
        return
    columns = _COLUMNS[kind]
    say(table(kind.value.capitalize(), columns, [[_short(name, row[name]) for name in columns] for row in part.rows]))
    if part.following is not None:
        say(f"More follow: --after {part.following}")


def release(
    named: StoredMap,
    store: StoreAddress,
    comment: Annotated[str | None, typer.Option("--comment", help="A comment to keep with the signature.")] = None,
    user: UserName = None,
    password_stdin: PasswordStdin = False,
    as_json: Json = False,
) -> None:
    """Release a map that somebody else made; sign with your password. It supersedes the released map of the cell."""
    with signing(store, "release", user, password_stdin) as (found, by, password):
        from truepose.error_map.facts import Fact
        from truepose.store.releases import release_map

        done = release_map(found, by, named, password, comment=comment)
    if as_json:
        emit_json({"map": done.map, "superseded": done.superseded})
        return
    say(f"Released {_map(done.map)}.", *(f"Superseded {_map(one)}." for one in done.superseded))
    figures = done.map["figures"]
    if "left_out" in figures:  # maps of earlier versions do not say
        say(f"It is of {figures['n']} samples, {figures['left_out']} left out.")
    show_facts(map(Fact.from_dict, figures.get("facts", [])))


def withdraw(
    named: StoredMap,
    store: StoreAddress,
    reason: Annotated[str, typer.Option("--reason", help="Why the map must not be used any more.")],
    user: UserName = None,
    password_stdin: PasswordStdin = False,
    as_json: Json = False,
) -> None:
    """Withdraw a map for good; sign with your password. Lists every program that it corrected."""
    with signing(store, "withdrawal", user, password_stdin) as (found, by, password):
        from truepose.store.releases import withdraw_map

        done = withdraw_map(found, by, named, password, reason)
    if as_json:
        emit_json(_recalled(done))
        return
    say(f"Withdrew {_map(done.map)}.")
    _show(done)


def recall(
    named: StoredMap,
    store: StoreAddress,
    as_csv: Annotated[bool, typer.Option("--csv", help="Write CSV to stdout and nothing else.")] = False,
    user: UserName = None,
    password_stdin: PasswordStdin = False,
    as_json: Json = False,
) -> None:
    """List every program that a map corrected, and those that the maps updated from it corrected."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store.releases import recall_map

        done = recall_map(found, by, named)
    if as_json:
        emit_json(_recalled(done))
    elif as_csv:
        typer.echo(_csv(done), nl=False)
    else:
        say(f"{_map(done.map)} is {done.map['state']}.")
        _show(done)


def _map(row: dict[str, Any]) -> str:
    return f"{row['name']} ({row['sha256'][:_HASH]})"


def _short(name: str, value: Any) -> str:
    if name.endswith("sha256"):
        return str(value or "–")[:_HASH]
    if name == "created":
        return str(value)[:19].replace("T", " ")
    return "–" if value is None else str(value)


def _recalled(done: Recall) -> dict[str, Any]:
    updated = [{"map": row, "corrections": some} for row, some in done.updated]
    return {"map": done.map, "corrections": done.corrections, "updated": updated}


def _every(done: Recall) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    for row, some in [(done.map, done.corrections), *done.updated]:
        yield from ((row, one) for one in some)


def _show(done: Recall) -> None:
    rows = [
        (
            one["program"],
            one["robot"]
            if one["other_robot"] is None
            else f"{one['robot']}, with a map of another: {one['other_robot']}",
            f"{row['name']}, DRAFT" if one["draft"] else row["name"],
            one["output_sha256"][:_HASH],
            one["made_by"],
            one["created"][:10],
        )
        for row, one in _every(done)
    ]
    if not rows:
        say("No program was corrected with it or with a map updated from it.")
        return
    columns = ["program", "robot", "map", "output", "by", "on"]
    say(table("Corrected programs", columns, rows[:_SHOWN]))
    if len(rows) > _SHOWN:
        say(f"and {len(rows) - _SHOWN} more; --csv of 'truepose store recall' lists all")
    for _, one in _every(done):
        if one["other_robot"] is not None:
            say(f"{one['program']}: corrected with the map of another robot, {one['robot']}: {one['other_robot']}")
    n = len(done.corrections)
    say(f"{n} with this map, {len(rows) - n} with maps updated from it.")


def _csv(done: Recall) -> str:
    from truepose._io.delimited import escaped

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["map", "map_sha256", *_RECALLED])
    for row, one in _every(done):
        writer.writerow([escaped(row["name"]), row["sha256"], *(escaped(str(one[name])) for name in _RECALLED)])
    return text.getvalue()
