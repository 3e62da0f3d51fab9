"""``truepose store user`` and ``truepose store token``: who may use a store."""

from __future__ import annotations

from typing import Annotated

import typer

from truepose.cli.options import Command, Json
from truepose.cli.output import emit_json, say, table
from truepose.cli.store import StoreAddress
from truepose.cli.store_login import PasswordStdin, UserName, logged_in, read_password

user_commands = typer.Typer(no_args_is_help=True, help="Users of a store, and their roles.")
token_commands = typer.Typer(no_args_is_help=True, help="Tokens, by which scripts and commands log in.")
Name = Annotated[str, typer.Argument(metavar="NAME", help="The user; case and Unicode form do not count.")]
Roles = Annotated[
    list[str], typer.Option("--role", help="A role: read, measure, program, release or admin; may be repeated.")
]


@user_commands.command("add", cls=Command)
def add(
    name: Name,
    role: Roles,
    store: StoreAddress,
    subject: Annotated[
        str | None, typer.Option("--subject", help="OpenID Connect: the subject by which the user logs in.")
    ] = None,
    without_password: Annotated[
        bool, typer.Option("--without-password", help="Log in by OpenID Connect only; such a user cannot sign.")
    ] = False,
    user: UserName = None,
    password_stdin: PasswordStdin = False,
    as_json: Json = False,
) -> None:
    """Add a user; the first one must have the role admin and needs no log-in."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import users

        secret = None if without_password else read_password(f"New password of {name}", password_stdin, twice=True)
        made = users.add_user(found, by, name, role, password=secret, subject=subject)
    if as_json:
        emit_json(made.to_dict())
    else:
        say(f"Added {made.name} ({', '.join(made.roles)}).")


@user_commands.command("list", cls=Command)
def list_all(
    store: StoreAddress, user: UserName = None, password_stdin: PasswordStdin = False, as_json: Json = False
) -> None:
    """List the users with their roles."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import users

        known = users.list_users(found, by)
    if as_json:
        emit_json({"users": [one.to_dict() for one in known]})
        return
    rows = [(one.name, ", ".join(one.roles), "disabled" if one.disabled else "") for one in known]
    say(table("Users", ["name", "roles", ""], rows))


@user_commands.command("disable", cls=Command)
def disable(name: Name, store: StoreAddress, user: UserName = None, password_stdin: PasswordStdin = False) -> None:
    """Take all rights from a user, in sessions that are open and of tokens as well; signatures stay."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import users

        users.set_disabled(found, by, name, True)
    say(f"{name} is disabled.")


@user_commands.command("enable", cls=Command)
def enable(name: Name, store: StoreAddress, user: UserName = None, password_stdin: PasswordStdin = False) -> None:
    """Let a disabled user log in again."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import users

        users.set_disabled(found, by, name, False)
    say(f"{name} is enabled.")


@user_commands.command("roles", cls=Command)
def roles(
    name: Name, role: Roles, store: StoreAddress, user: UserName = None, password_stdin: PasswordStdin = False
) -> None:
    """Give a user these roles and no others."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import users

        held = users.set_roles(found, by, name, role)
    say(f"{name} has the roles {', '.join(held)}.")


@user_commands.command("password", cls=Command)
def password(name: Name, store: StoreAddress, user: UserName = None, password_stdin: PasswordStdin = False) -> None:
    """Set a new password: your own, or as an administrator that of another user."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import users

        secret = read_password(f"New password of {name}", password_stdin, twice=True)
        users.set_password(found, by, name, secret)
    say(f"The password of {name} is changed.")


@token_commands.command("create", cls=Command)
def create(
    store: StoreAddress,
    name: Annotated[str, typer.Option("--name", help="What the token is for.")] = "command line",
    scope: Annotated[
        list[str] | None, typer.Option("--scope", help="A role that the token may use, by default all; repeatable.")
    ] = None,
    days: Annotated[int, typer.Option("--days", help="Days until the token expires.")] = 90,
    user: UserName = None,
    password_stdin: PasswordStdin = False,
) -> None:
    """Create a token and print it, once: the store keeps only a hash of it."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import access, tokens

        with found.reading() as connection:
            held = access.roles_of(connection, by)
        text, made = tokens.create_token(found, by, name, scope or held, days)
    typer.echo(text)
    typer.echo(f"Token of {made.user} for {', '.join(made.scope)}; expires on {made.expires[:10]}.", err=True)


@token_commands.command("list", cls=Command)
def list_tokens(
    store: StoreAddress, user: UserName = None, password_stdin: PasswordStdin = False, as_json: Json = False
) -> None:
    """List your tokens, as an administrator those of all users."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import tokens

        known = tokens.list_tokens(found, by)
    if as_json:
        emit_json({"tokens": [one.to_dict() for one in known]})
        return
    rows = [
        (one.identity, one.user, one.name, ", ".join(one.scope), one.expires[:10], "revoked" if one.revoked else "")
        for one in known
    ]
    say(table("Tokens", ["token", "user", "name", "scope", "expires", ""], rows))


@token_commands.command("revoke", cls=Command)
def revoke(
    token: Annotated[str, typer.Argument(metavar="TOKEN", help="The first column of 'token list'.")],
    store: StoreAddress,
    user: UserName = None,
    password_stdin: PasswordStdin = False,
) -> None:
    """Take all rights from a token, at its next use."""
    with logged_in(store, user, password_stdin) as (found, by):
        from truepose.store import tokens

        tokens.revoke_token(found, by, token)
    say("The token is revoked.")
