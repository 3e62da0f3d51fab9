"""Names that differ in case or Unicode form, passwords, and secrets of tokens."""

from __future__ import annotations

import unicodedata

import pytest

from truepose.errors import DataError
from truepose.store.passwords import (
    check_password,
    hashed,
    is_outdated,
    matches,
    new_token,
    token_hash,
    token_identity,
    user_key,
)

GOOD = "seven laser trackers"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Anna", "ANNA"),
        ("müller", unicodedata.normalize("NFD", "MÜLLER")),
        ("straße", "STRASSE"),
        ("ｅｖａ", "eva"),
        ("ﬁona", "FIONA"),
        (" eva ", "eva"),
        ("\u1e9e", "ss"),
    ],
)
def test_names_that_differ_in_case_or_unicode_form_are_one(one, other):
    assert user_key(one) == user_key(other)
    assert user_key(user_key(one)) == user_key(one)


@pytest.mark.parametrize("name", ["", "  ", "a b", "a\u200bb", "a\x00b", "a\nb", "a\u202eb", "x" * 65])
def test_names_that_mislead_are_refused(name):
    with pytest.raises(DataError, match="user name"):
        user_key(name)


def test_a_password_matches_its_hash_in_any_unicode_form():
    kept = hashed("schlüsselwörter für alle")
    assert kept.startswith("$argon2id$")
    assert matches(unicodedata.normalize("NFD", "schlüsselwörter für alle"), kept)
    assert not matches("schlusselworter fur alle", kept)
    assert not matches(GOOD, None)
    assert not matches(GOOD, "no hash")
    assert not is_outdated(kept)
    assert hashed(GOOD) != hashed(GOOD)


@pytest.mark.parametrize("password", ["short", "aaaaaaaaaaaaaaaa", "anna-from-plant-1", "x" * 1025])
def test_weak_passwords_are_refused(password):
    with pytest.raises(DataError, match="password"):
        check_password(password, "ANNA-from-plant-1")
    check_password(GOOD, "anna")


def test_a_token_names_its_row_and_is_kept_as_a_hash():
    token, other = new_token(), new_token()
    assert (token_identity(token) or "") in token
    assert token_identity(token) != token_identity(other)
    assert token_hash(f" {token}\n") == token_hash(token) != token_hash(other)
    assert token not in token_hash(token)
    assert token_identity("something") is None
