"""Who uses a store from the command line: a token in the environment, or a user with a password.

Passwords come from the terminal or stdin, tokens from the environment, never from an argument that others can see.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from truepose.cli.store import account, opened
from truepose.errors import DataError, RefusedError

if TYPE_CHECKING:
    from truepose.store.access import Identity
    from truepose.store.store import Store

TOKEN: Final = "TRUEPOSE_STORE_TOKEN"
"""The environment variable of the token."""
UserName = Annotated[
    str | None,
    typer.Option("--user", envvar="TRUEPOSE_STORE_USER", help=f"Your user name; by default the token in {TOKEN}."),
]
PasswordStdin = Annotated[
    bool, typer.Option("--password-stdin", help="Read passwords from stdin, one a line, instead of asking for them.")
]


def read_password(question: str, from_stdin: bool, *, twice: bool = False) -> str:
    """Return a password from the terminal, which does not show it, or from the next line of stdin.

    Raises
    ------
    DataError
        If stdin is no terminal and was not named, holds no further line, or the two entries differ.
    """
    if from_stdin:
        if not (line := sys.stdin.readline().rstrip("\r\n")):
            raise DataError(f"stdin holds no line for: {question}")
        return line
    if not sys.stdin.isatty():
        raise DataError("no terminal to ask for the password; give --password-stdin and write it to stdin")
    from getpass import getpass

    password = getpass(f"{question}: ")
    if twice and getpass("Again: ") != password:
        raise DataError("the two passwords differ; nothing was changed")
    return password


@contextmanager
def logged_in(
    address: str, user: str | None = None, from_stdin: bool = False, *, below: Path | None = None
) -> Iterator[tuple[Store, Identity]]:
    """Open a store as a user with a password, as the user of the token, or as anybody if the store has no users.

    Rows of runs that were interrupted are written: of the user's, and of those with files in or below a folder.

    Raises
    ------
    RefusedError
        If the store has users and nobody is named, or the log-in is refused.
    """
    with opened(address) as store:
        from truepose.programs.corrected import NOTES
        from truepose.store.unrecorded import settle

        by = identify(store, user, from_stdin)
        settle(store, by, {path.parent for path in below.rglob(NOTES)} if below is not None else ())
        yield store, by


@contextmanager
def signing(address: str, what: str, user: str | None, from_stdin: bool) -> Iterator[tuple[Store, Identity, str]]:
    """Open a store for the signature of a ``release`` or a ``withdrawal``: show its meaning, ask for the password."""
    with opened(address) as store:
        from truepose.store import access
        from truepose.store.releases import MEANINGS
        from truepose.store.unrecorded import settle

        question = f'Password, as your signature: "{MEANINGS[what]}"'
        by = None if user is not None else identify(store)
        password = read_password(question, from_stdin)
        by = by or access.log_in(store, user or "", password)
        settle(store, by)
        yield store, by, password


def identify(store: Store, user: str | None = None, from_stdin: bool = False) -> Identity:
    """Return who uses an open store; see `logged_in`."""
    from truepose.store import access

    if user is not None:
        return access.log_in(store, user, read_password(f"Password of {user}", from_stdin))
    if token := os.environ.get(TOKEN, "").strip():
        return access.by_token(store, token)
    with store.reading() as connection:
        if access.any_user(connection):
            raise RefusedError(f"{store.backend.shown}: the store has users; set {TOKEN} to your token, or give --user")
    return access.open_identity(account())
