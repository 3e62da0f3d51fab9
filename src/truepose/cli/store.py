"""Commands of a team's store: make, check, back up, restore and migrate it; show the head of its audit trail."""

from __future__ import annotations

import getpass
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose._extras import needed
from truepose.cli.options import Json
from truepose.cli.output import emit_json, overwrite, say, working
from truepose.errors import RefusedError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from truepose.store.store import Store

StoreAddress = Annotated[
    str,
    typer.Option(
        "--store",
        envvar="TRUEPOSE_STORE",
        help="The store: a folder, sqlite:///FILE or postgresql://USER@HOST/DATABASE; ?blobs=FOLDER for its blobs.",
    ),
]
_SHOWN = 20  # faults that are printed without --json


@contextmanager
def opened(address: str, *, create: bool = False, unchecked: bool = False) -> Iterator[Store]:
    """Open a store for a command, of any version if `unchecked`; say what to install if its libraries are missing."""
    with needed("a store", "store"):
        from truepose.store.store import Store
    with Store.unchecked(address) if unchecked else Store.open(address, create=create) as store:
        yield store


def account() -> str:
    """Return the name of the account of this machine, for changes of a store that nobody logs in for."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # an account without a name, as in containers
        return "unknown account"


def init(store: StoreAddress, as_json: Json = False) -> None:
    """Make an empty store; without users, everything is open to whoever can open its files."""
    with opened(store, create=True) as made:
        shown, head = made.backend.shown, made.head()
    if as_json:
        emit_json({"store": shown, "sequence": head.sequence, "head": head.hash})
    else:
        users = "users with 'truepose store user add NAME --role admin'"
        say(f"Made the store {shown}.", f"Add {users}, or files with 'truepose store import FOLDER'.")


def head(store: StoreAddress, as_json: Json = False) -> None:
    """Print the last entry of the audit trail; its hash covers all entries, so note it outside of the store."""
    with opened(store) as found:
        last = found.head()
    if as_json:
        emit_json({"store": found.backend.shown, "sequence": last.sequence, "head": last.hash})
    else:
        typer.echo(f"{last.sequence} {last.hash}")


def verify(
    store: StoreAddress,
    head: Annotated[
        str | None, typer.Option("--head", metavar="HASH", help="A head noted before, as on a report; must be known.")
    ] = None,
    contents: Annotated[
        bool, typer.Option("--contents/--no-contents", help="Read all blobs and compare their hashes.")
    ] = True,
    as_json: Json = False,
) -> None:
    """Check a store: the chain of its audit trail, rows against their entries, references, and blobs."""
    with opened(store) as found, working("Opening the store", quiet=as_json) as progress:
        from truepose.store.verify import verify as check

        result = check(found, head=head, contents=contents, progress=progress)
    last, faults = result.head, result.faults
    if as_json:
        emit_json(
            {
                "store": found.backend.shown,
                "sequence": last.sequence,
                "head": last.hash,
                "rows": result.rows,
                "blobs": result.blobs,
                "faults": faults,
                "notes": result.notes,
            }
        )
    else:
        say(f"{last.sequence} entries, {result.rows} rows, {result.blobs} blobs; head {last.hash}", *result.notes)
        say(*(f"[red]Fault[/]: {fault}" for fault in faults[:_SHOWN]))
        if len(faults) > _SHOWN:
            say(f"and {len(faults) - _SHOWN} more; all are in the output of --json")
    if faults:
        raise RefusedError(f"{found.backend.shown}: {len(faults)} faults, first: {faults[0]}")


def backup(
    out: Annotated[Path, typer.Argument(metavar="BACKUP", help="The .zip to write.")],
    store: StoreAddress,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing backup.")] = False,
    as_json: Json = False,
) -> None:
    """Write the complete store to one .zip that restores on every engine; others may write to it meanwhile."""
    overwrite(force, out)
    with opened(store) as found, working("Opening the store", quiet=as_json) as progress:
        from truepose.store.backup import backup as write

        made = write(found, out, progress=progress)
    _show_moved("Wrote", out, made.rows, made.blobs, made.head.sequence, made.head.hash, as_json)


def restore(
    path: Annotated[Path, typer.Argument(metavar="BACKUP", help="A .zip that 'truepose store backup' wrote.")],
    store: StoreAddress,
    as_json: Json = False,
) -> None:
    """Make a store from a backup, after a check of the backup; a store that exists is refused."""
    with working("Reading the backup", quiet=as_json) as progress:
        with needed("a store", "store"):
            from truepose.store.backup import restore as read
        made = read(path, store, progress=progress)
    _show_moved("Restored", path, made.rows, made.blobs, made.head.sequence, made.head.hash, as_json)


def migrate(
    store: StoreAddress,
    grant: Annotated[
        str | None,
        typer.Option("--grant", metavar="ROLE", help="Role of a PostgreSQL server that the application logs in with."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Bring a store to the version of this program; make a backup first."""
    with opened(store, unchecked=True) as found, working("Migrating", quiet=as_json):
        before, after = found.migrate(account())
        if grant is not None:
            found.grant(grant)
    if as_json:
        emit_json({"store": found.backend.shown, "from": before, "to": after, "granted": grant})
        return
    say(f"The store has version {after}." if before == after else f"Migrated from version {before} to {after}.")
    if grant is not None:
        say(f"{grant} may use the store, and append to the audit trail but not change it.")


def _show_moved(verb: str, path: Path, rows: int, blobs: int, sequence: int, hashed: str, as_json: bool) -> None:
    if as_json:
        emit_json({"backup": path, "rows": rows, "blobs": blobs, "sequence": sequence, "head": hashed})
    else:
        say(f"{verb} {path}: {rows} rows, {blobs} blobs, {sequence} entries; head {hashed}")
