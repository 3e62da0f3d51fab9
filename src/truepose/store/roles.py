"""What each role may do: the one table of permissions.

A user has one or more roles. A role permits only what stands in its line; an administrator manages users and the store,
and needs the other roles like anybody else. What a token permits is the part of its user's roles that its scope names.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal, get_args

from truepose.errors import DataError, RefusedError

Role = Literal["read", "measure", "program", "release", "admin"]
"""A role of a user, and a part of a token's scope."""
Action = Literal["view", "measure", "fit", "correct", "verify", "import", "release", "manage"]
"""Something that a role may permit."""

ROLES: Final[tuple[Role, ...]] = get_args(Role)
PERMISSIONS: Final[dict[Role, frozenset[Action]]] = {
    "read": frozenset({"view"}),
    "measure": frozenset({"view", "measure", "fit", "verify", "import"}),
    "program": frozenset({"view", "correct", "verify", "import"}),
    "release": frozenset({"view", "release"}),
    "admin": frozenset({"view", "manage"}),
}
"""The actions that each role permits."""
WORDS: Final[dict[Action, str]] = {
    "view": "list and read objects, make reports",
    "measure": "add cells, readings and samples",
    "fit": "fit and update maps",
    "correct": "correct programs",
    "verify": "add verifications",
    "import": "import a folder of files",
    "release": "release and withdraw maps made by others",
    "manage": "manage users, backups and migrations",
}
"""Each action in words."""


def checked_roles(names: Iterable[str]) -> tuple[Role, ...]:
    """Return roles by name, each once and in the usual order.

    Raises
    ------
    DataError
        If there is none, or a name is no role.

    Examples
    --------
    >>> checked_roles(["program", "read", "read"])
    ('read', 'program')
    """
    given = list(names)
    if unknown := [name for name in given if name not in ROLES]:
        raise DataError(f"unknown role {unknown[0]!r}; expected {', '.join(ROLES)}")
    if not given:
        raise DataError(f"at least one role is needed: {', '.join(ROLES)}")
    return tuple(role for role in ROLES if role in given)


def permitted(roles: Iterable[Role]) -> frozenset[Action]:
    """Return the actions that some roles permit together."""
    return frozenset[Action]().union(*(PERMISSIONS[role] for role in roles))


def check_permitted(who: str, roles: Iterable[Role], action: Action, *, limit: str = "") -> None:
    """Refuse an action that no role of a user permits.

    Parameters
    ----------
    who : str
        The name of the user.
    roles : iterable of str
        The roles in force.
    action : str
        The action.
    limit : str
        What narrows the roles, such as the scope of a token; part of the message.

    Raises
    ------
    RefusedError
        If no role permits it; the message names the roles that would.
    """
    if action in permitted(held := tuple(roles)):
        return
    would = " or ".join(role for role in ROLES if action in PERMISSIONS[role])
    raise RefusedError(
        f"{who} may not do this ({WORDS[action]}): it needs the role {would}, "
        f"but {limit or 'the user'} has {', '.join(held) or 'none'}"
    )
