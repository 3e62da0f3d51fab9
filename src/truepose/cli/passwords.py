"""Read passwords and tokens from the terminal, stdin or the environment, never from an argument that others can see."""

from __future__ import annotations

import os
import sys
from typing import Annotated, Final

import typer

from truepose.errors import DataError

PasswordStdin = Annotated[
    bool, typer.Option("--password-stdin", help="Read the password from the first line of stdin instead of asking.")
]
TOKEN: Final = "TRUEPOSE_STORE_TOKEN"
"""The environment variable of the token."""


def read_password(question: str, from_stdin: bool, *, twice: bool = False) -> str:
    """Return a password from the terminal, which does not show it, or from stdin.

    Raises
    ------
    DataError
        If stdin is no terminal and was not named, holds nothing, or the two entries differ.
    """
    if from_stdin:
        line = sys.stdin.readline().rstrip("\r\n")
        if not line:
            raise DataError("stdin holds no password in its first line")
        return line
    if not sys.stdin.isatty():
        raise DataError("no terminal to ask for the password; give --password-stdin and write it to stdin")
    from getpass import getpass

    password = getpass(f"{question}: ")
    if twice and getpass("Again: ") != password:
        raise DataError("the two passwords differ; nothing was changed")
    return password


def token() -> str | None:
    """Return the token in the environment; None if there is none."""
    return os.environ.get(TOKEN, "").strip() or None
