"""Names of objects: kept as they were given, compared without regard to case and Unicode form."""

from __future__ import annotations

import unicodedata
from typing import Final

from truepose.errors import DataError

LONGEST: Final = 200
"""The largest number of characters of a name."""


def clean_name(text: str, what: str) -> str:
    """Return a name in composed form (NFC) without blanks around it.

    Raises
    ------
    DataError
        If nothing is left, it is too long, or it has characters that are not printable.

    Examples
    --------
    >>> clean_name(" Robot 17 ", "robot")
    'Robot 17'
    """
    name = unicodedata.normalize("NFC", text).strip()
    if not name:
        raise DataError(f"the {what} has no name; give one")
    if not name.isprintable():
        raise DataError(f"the name of the {what} has characters that cannot be printed: {name!r}; give another")
    if max(len(name), len(name_key(name))) > LONGEST:
        raise DataError(f"the name of the {what} has {len(name)} characters, expected at most {LONGEST}")
    return name


def name_key(name: str) -> str:
    """Return the form in which names are compared (NFKC, case folded).

    Examples
    --------
    >>> name_key("Straße") == name_key("STRASSE")
    True
    """
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())
