"""Names of users, passwords and secrets of tokens: how they are compared and kept.

Passwords are kept as argon2id hashes. Secrets of tokens are random and long, so SHA-256 is enough for them, and a check
takes no time.
"""

from __future__ import annotations

import hashlib
import secrets
import unicodedata
from functools import cache
from typing import TYPE_CHECKING, Final

from truepose._extras import needed
from truepose.errors import DataError
from truepose.store.names import name_key

if TYPE_CHECKING:
    from argon2 import PasswordHasher

SHORTEST: Final = 12
"""The smallest number of characters of a password."""
_LONGEST_PASSWORD: Final = 1024
_LONGEST_NAME: Final = 64
_PREFIX: Final = "tp"


def user_key(name: str) -> str:
    """Return the form in which names of users are compared: NFKC and case folding, so that look-alikes are one.

    Raises
    ------
    DataError
        If the name is empty, too long, or holds a blank, a control character or an invisible one.

    Examples
    --------
    >>> user_key("Ｍüller") == user_key("mu\u0308ller")
    True
    """
    key = name_key(name.strip())
    if not key or len(key) > _LONGEST_NAME:
        raise DataError(f"a user name must have 1 to {_LONGEST_NAME} characters, got {len(key)}")
    for character in key:
        if unicodedata.category(character)[0] in "CZ":
            raise DataError(f"the user name {name!r} holds a blank or an invisible character; use letters and digits")
    return key


def check_password(password: str, name: str) -> None:
    """Refuse a password that is too short, too long, or the name of its user.

    Raises
    ------
    DataError
        If the password is one of these.
    """
    form = _password_form(password)
    if not SHORTEST <= len(form) <= _LONGEST_PASSWORD:
        raise DataError(f"a password must have {SHORTEST} to {_LONGEST_PASSWORD} characters, got {len(form)}")
    if form.casefold() == user_key(name) or len(set(form)) < SHORTEST // 3:
        raise DataError("the password is too easy to guess; use several words, or a password manager")


def hashed(password: str) -> str:
    """Return the argon2id hash of a password, with its parameters and salt."""
    return _hasher().hash(_password_form(password))


def matches(password: str, stored: str | None) -> bool:
    """Return whether a password belongs to a hash; None takes as long, so that time does not tell who exists."""
    with needed("a store", "store"):
        from argon2.exceptions import InvalidHashError, VerificationError

    try:
        return _hasher().verify(stored or _nobody(), _password_form(password)) and stored is not None
    except (VerificationError, InvalidHashError):
        return False


def is_outdated(stored: str) -> bool:
    """Return whether a hash was made with weaker parameters than those of today."""
    return _hasher().check_needs_rehash(stored)


def new_token() -> str:
    """Return a new token: a prefix, the identity by which it is found, and its secret."""
    return f"{_PREFIX}_{secrets.token_hex(4)}_{secrets.token_urlsafe(32)}"


def token_identity(token: str) -> str | None:
    """Return the identity in a token; None if the text is no token."""
    parts = token.strip().split("_", 2)
    return parts[1] if len(parts) == 3 and parts[0] == _PREFIX else None


def token_hash(token: str) -> str:
    """Return the SHA-256 of a token."""
    return hashlib.sha256(token.strip().encode()).hexdigest()


def _password_form(password: str) -> str:
    return unicodedata.normalize("NFKC", password)


@cache
def _hasher() -> PasswordHasher:
    with needed("a store", "store"):
        from argon2 import PasswordHasher

    return PasswordHasher()


@cache
def _nobody() -> str:
    """Return a hash that no known password has."""
    return hashed(secrets.token_urlsafe(32))
