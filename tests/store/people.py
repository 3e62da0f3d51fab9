"""People of a store for tests."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.store import users
from truepose.store.access import Identity, log_in, open_identity
from truepose.store.store import Store

PASSWORD = "seven laser trackers"


def join(store: Store, **roles: Sequence[str]) -> dict[str, Identity]:
    """Add an administrator, chief, and users with roles; return them logged in."""
    users.add_user(store, open_identity("test"), "chief", ["admin"], password=PASSWORD)
    team = {"chief": log_in(store, "chief", PASSWORD)}
    for name, some in roles.items():
        users.add_user(store, team["chief"], name, some, password=PASSWORD)
        team[name] = log_in(store, name, PASSWORD)
    return team
