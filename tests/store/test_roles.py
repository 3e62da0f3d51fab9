"""The table of permissions: what each role may do, and what a refusal says."""

from __future__ import annotations

import pytest

from truepose.errors import DataError, RefusedError
from truepose.store.roles import PERMISSIONS, ROLES, WORDS, check_permitted, checked_roles, permitted


def test_every_role_has_a_line_and_every_action_a_role():
    assert set(PERMISSIONS) == set(ROLES)
    assert permitted(ROLES) == set(WORDS)


def test_every_role_may_read():
    assert all("view" in PERMISSIONS[role] for role in ROLES)


def test_duties_are_separate():
    """Nobody who only makes maps or manages users may release one."""
    assert [role for role in ROLES if "release" in PERMISSIONS[role]] == ["release"]
    assert not PERMISSIONS["release"] & {"measure", "fit", "correct", "manage"}
    assert [role for role in ROLES if "manage" in PERMISSIONS[role]] == ["admin"]


def test_a_refusal_names_the_action_and_the_role_that_is_missing():
    with pytest.raises(RefusedError, match=r"eva may not do this \(correct programs\): it needs the role program"):
        check_permitted("eva", ["read", "measure"], "correct")
    check_permitted("eva", ["read", "program"], "correct")


@pytest.mark.parametrize(("names", "message"), [(["boss"], "unknown role 'boss'"), ([], "at least one role")])
def test_unknown_roles_are_refused(names, message):
    with pytest.raises(DataError, match=message):
        checked_roles(names)
