"""Every language has every text, with the same values, in characters that the report's font has."""

from __future__ import annotations

import math
import string

import pytest

from truepose.errors import DataError
from truepose.report import fonts
from truepose.report.locale import LOCALES, load_locale

ENGLISH = load_locale("en")


def _values(text: str) -> list[str]:
    return sorted(name for _, name, _, _ in string.Formatter().parse(text) if name is not None)


@pytest.mark.parametrize("name", LOCALES)
def test_every_locale_has_every_text_with_the_same_values(name):
    texts = load_locale(name).texts
    assert texts.keys() == ENGLISH.texts.keys()
    different = [key for key, text in texts.items() if _values(text) != _values(ENGLISH.texts[key])]
    assert different == []
    assert all(text.strip() for key, text in texts.items() if key != "finding.list")


@pytest.mark.parametrize("name", LOCALES)
def test_the_font_has_every_character(name):
    lost = {c for text in load_locale(name).texts.values() for c in text} - fonts.characters()
    assert lost == set()


def test_translations_are_translations():
    for name in ("de", "zh"):
        texts = load_locale(name).texts
        same = {
            key for key, text in texts.items() if text == ENGLISH.texts[key] and any(len(w) > 4 for w in text.split())
        }
        words = {key for key in same if not _values(texts[key])}
        assert words <= {"signatures.name"}, name


def test_unknown_locale_names_the_known_ones():
    with pytest.raises(DataError, match=r"expected a locale of en, de, zh; got 'fr'"):
        load_locale("fr")


def test_numbers_have_the_decimal_mark_and_a_true_minus():
    german = load_locale("de")
    assert german.number(-1234.5678, ".2f") == "−1234,57"
    assert german("figure.arrows_scale", times=2.5) == "Pfeile 2,5-mal so lang wie die Fehler"
    assert ENGLISH.number(0.25, "+.2f") == "+0.25"
    assert ENGLISH.number(-0.0004, ".3f") == "0.000"
    assert ENGLISH.number(-0.0004, "+.3f") == "+0.000"
    assert ENGLISH.number(-0.0004, ".4f") == "−0.0004"
    assert ENGLISH.number(7968.0, ".3g") == "7970"
    assert german.number(4.7e-5, ".2g") == "0,000047"
    assert ENGLISH.number(None, ".2f") == german.number(math.nan, ".2f") == "–"


def test_words_of_a_section():
    assert load_locale("de").words("similarity")("distance", unit="mm") == "Abstand h [mm]"
    assert ENGLISH.words("similarity")("distance", unit="rad") == "distance h [rad]"
