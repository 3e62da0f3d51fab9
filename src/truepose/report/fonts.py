"""The font of the report, used in figures and embedded in pages for Chinese characters."""

from __future__ import annotations

import base64
import io
import logging
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Final

from truepose._extras import needed

FAMILY: Final = "Truepose Sans"
_FIRST_CHINESE: Final = 0x2E80  # start of the Chinese characters and punctuation


def folder() -> Path:
    """Return the folder of the font."""
    return Path(str(resources.files("truepose.report").joinpath("fonts")))


@cache
def use_in_figures() -> list[str]:
    """Register the font with matplotlib and return the font families of figures."""
    with needed("a report", "report"):
        from matplotlib import font_manager

    font_manager.fontManager.addfont(_path())
    return [FAMILY, "DejaVu Sans"]


@cache
def characters() -> frozenset[str]:
    """Return the characters of the font."""
    with needed("a report", "report"):
        from fontTools.ttLib import TTFont

    with TTFont(_path(), lazy=True) as font:
        return frozenset(map(chr, font.getBestCmap()))


def embedded(text: str) -> str:
    """Return a font with the Chinese characters of a text, as WOFF in base64; empty without such characters."""
    with needed("a report", "report"):
        from fontTools import subset

    wanted = "".join(sorted(set(_chinese(text)) & characters()))
    if not wanted:
        return ""
    logging.getLogger("fontTools").setLevel(logging.WARNING)
    options = subset.Options(flavor="woff", layout_features=[], notdef_outline=True)
    font = subset.load_font(_path(), options)
    subsetter = subset.Subsetter(options)
    subsetter.populate(text=wanted)
    subsetter.subset(font)
    out = io.BytesIO()
    subset.save_font(font, out, options)
    font.close()
    return base64.b64encode(out.getvalue()).decode("ascii")


def _chinese(text: str) -> str:
    return "".join(c for c in text if ord(c) >= _FIRST_CHINESE)


def _path() -> str:
    return str(folder() / "truepose-sans.ttf")
