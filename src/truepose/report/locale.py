"""The language of a report: its texts by key, and its decimal mark; one file per language in ``templates/locales``."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from functools import cache
from importlib import resources
from typing import Final

from truepose.errors import DataError
from truepose.similarity.words import ENGLISH, Words

LOCALES: Final = ("en", "de", "zh")
MISSING: Final = "–"
"""The text of a missing number."""


@dataclass(frozen=True)
class Locale:
    """Texts and numbers of one language; made by `load_locale`.

    Attributes
    ----------
    name : str
        The language tag, one of `LOCALES`.
    decimal : str
        The decimal mark.
    fonts : tuple of str
        The font families of the PDF's text, in order of preference.
    texts : mapping of str to str
        The texts by ``section.key``, with fields of `str.format`.

    Examples
    --------
    >>> say = load_locale("de")
    >>> say("figure.before_mean", mean=0.4861)
    'vorher: im Mittel 0,486 mm'
    >>> say.number(-0.25, ".2f")
    '−0,25'
    """

    name: str
    decimal: str
    fonts: tuple[str, ...]
    texts: Mapping[str, str]

    def __call__(self, key: str, /, **values: float | str) -> str:
        """Return the text of a key with its values."""
        put_in = {name: _Number(v, self.decimal) if isinstance(v, float) else v for name, v in values.items()}
        return self.texts[key].format(**put_in)

    def number(self, value: float | None, form: str) -> str:
        """Return a number in a format of `format`; a dash for None."""
        return MISSING if value is None else format(_Number(value, self.decimal), form)

    def words(self, section: str) -> Words:
        """Return a function that gives the texts of one section by key."""

        def words(key: str, /, **values: float | str) -> str:
            return self(f"{section}.{key}", **values)

        return words


@cache
def load_locale(name: str) -> Locale:
    """Return a language by its tag.

    Raises
    ------
    DataError
        If there is no such language.
    """
    if name not in LOCALES:
        raise DataError(f"expected a locale of {', '.join(LOCALES)}; got {name!r}")
    file = resources.files("truepose.report").joinpath("templates", "locales", f"{name}.toml")
    text = file.read_text(encoding="utf-8")
    sections = {"similarity": ENGLISH} | tomllib.loads(text) if name == "en" else tomllib.loads(text)
    own = sections.pop("locale")
    texts = {f"{section}.{key}": value for section, keys in sections.items() for key, value in keys.items()}
    return Locale(name, own["decimal"], tuple(own["fonts"]), texts)


class _Number(float):
    """A number whose text has the decimal mark of a language and a true minus sign."""

    _decimal: str

    def __new__(cls, value: float, decimal: str) -> _Number:
        number = super().__new__(cls, value)
        number._decimal = decimal
        return number

    def __format__(self, form: str) -> str:
        if self != self:
            return MISSING
        text = super().__format__(form)
        if "e" in text:  # as 7.97e+03, for 7970
            text = f"{Decimal(text):f}"
        if not text.strip("+-0.%"):  # no minus before a zero
            text = text.replace("-", "+" if form.startswith("+") else "")
        return text.replace(".", self._decimal).replace("-", "−")
