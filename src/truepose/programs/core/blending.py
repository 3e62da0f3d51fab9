"""Count the motions that a program blends: the tool passes their targets at a distance and does not stop.

A correction moves such a target and with it the whole path; the distance at which the tool passes is the controller's.
Counts are by the words of each language, without comments and texts; zones with names of the user's are not counted.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import Final

from truepose.programs.core.source import Source

_ZERO: Final = rb"0*(?:\.0*)?(?![\d.])"
_BLENDED: Final = {
    "krl": rb"^[ \t]*(?:S?(?:PTP|LIN|CIRC)(?:_REL)?|SPL)\b[^;\r\n]*?\b(C_(?:DIS|PTP|VEL|ORI|SPL))\b",
    "rapid": rb"^[ \t]*(?:Move|Trigg|Arc|Disp|Paint)[LJC]\w*[^;!]*?,[ \t\r\n]*(z\d+)[ \t\r\n]*[,\\]",
    "tp": rb"^[ \t]*\d*[ \t]*:[ \t]*[JLCAS][ \t]+P[^;!\r\n]*?\b(CNT)[ \t]*(?!0+\b)\d",
    "urscript": rb"^[^#\r\n]*?\bmove[ljpc][ \t]*\([^#\r\n]*?\b(r)[ \t]*=[ \t]*(?!" + _ZERO + rb")[\d.]",
    "inform": rb"^[ \t]*(?:\+)?MOV[JLCS]\b[^'\r\n]*?\b(PL=[1-9]\d*)",
    "val3": rb"<Value\b[^>]*?\bblend=\"((?:joint|cartesian)\b)",
}
_UPPER: Final = ("krl", "tp", "inform")
_PATTERNS: Final = {language: re.compile(text, re.I | re.M) for language, text in _BLENDED.items()}


def blended(language: str, sources: tuple[Source, ...]) -> dict[str, int]:
    """Return how many motions of a program are blended, by the words that say so; the commonest first.

    VAL3 blends by data that motions share: there the data are counted.

    Parameters
    ----------
    language : str
        The name of the language's reader.
    sources : tuple of Source
        The files of the program.
    """
    pattern = _PATTERNS.get(language)
    if pattern is None:
        return {}
    found = (m[1].decode("ascii") for source in sources for m in pattern.finditer(source.data))
    words = Counter(word.upper() if language in _UPPER else word.lower() for word in found)
    return dict(words.most_common())


def in_words(counts: dict[str, int]) -> str:
    """Return the counts in one sentence; empty without any."""
    if not counts:
        return ""
    listed = ", ".join(f"{word}: {n}" for word, n in counts.items())
    return f"{sum(counts.values())} motions are blended ({listed}): the tool passes their targets at a distance"
