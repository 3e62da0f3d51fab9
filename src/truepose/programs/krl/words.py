"""KRL's vocabulary, as far as it matters for targets."""

from __future__ import annotations

import re
from typing import Final

from truepose.programs.krl.builtins import READING, WRITING


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


MOTIONS: Final = _words("PTP LIN CIRC SPTP SLIN SCIRC SPL")
CIRCLES: Final = _words("CIRC SCIRC")
RELATIVE_MOTIONS: Final = frozenset(word + "_REL" for word in MOTIONS)
JOINT_MOTIONS: Final = _words("ASYPTP")
DECLARE: Final = _words("DECL GLOBAL CONST IMPORT")
TYPES: Final = _words("INT REAL BOOL CHAR POS E6POS FRAME AXIS E6AXIS FDAT LDAT PDAT LOAD")
"""Types that may be declared without DECL."""
WITHOUT_USE: Final = _words("SIGNAL ENUM STRUC EXT EXTFCT CHANNEL")
"""Statements that declare names and use none."""
OTHER_STATEMENTS: Final = _words(
    """WAIT INTERRUPT TRIGGER PULSE HALT CONTINUE BRAKE ANIN ANOUT TIME_BLOCK CONST_VEL STOP ERR_RAISE ON_ERROR_PROCEED
    ASYSTOP ASYCONT ASYCANCEL CONFIRM SYNC NOT"""
)
"""Statements whose word is followed by an operand and that are no motion."""
READS: Final = READING | _words(
    """IF THEN ELSE WHILE UNTIL FOR TO STEP AND OR NOT EXOR B_AND B_OR B_EXOR B_NOT SWITCH CASE RETURN WAIT SEC DO WHEN
    PRIO"""
)
"""Words before a parenthesis that change nothing: the language's own, and functions that read at most."""
KEEPS_FRAMES: Final = READS | WRITING
"""Words before a parenthesis that leave tool and base unchanged."""

IDENTIFIER: Final = re.compile(
    rb"\"[^\"]*+\"|'[^'\r\n]*+'|#[ \t]*+\w+|\.[ \t]*+[A-Za-z_]\w*+"
    rb"|(?<!\w)([A-Za-z_$][\w$]*+)[ \t]*+(\(|\[[ \t]*+[\d, \t]+\]|\[)?+"
)
"""A name and the bracket behind it; texts, enumerations and components are skipped."""
STRAY_MOTION: Final = re.compile(
    rb"\"[^\"]*+\"|(?<![\w$#.'])(S?(?:PTP|LIN|CIRC)(?:_REL)?|SPL(?:_REL)?)(?=[ \t]*\{|[ \t]+[A-Za-z_$])", re.I
)
"""A motion word before an operand."""
STATE: Final = re.compile(rb"(?<![\w$])(?:\$(?:TOOL|BASE|IPO_MODE)|FDAT_ACT|(TOOL|BASE)_DATA)(?![\w$])", re.I)
"""What decides in which tool and base a motion is; the first group names a table of frames."""
STATE_CHANGE: Final = re.compile(
    STATE.pattern + rb"(?=[ \t]*+(?:\[[^\]]*+\][ \t]*+)?+(?:\.[ \t]*+\w++[ \t]*+)?+=(?!=))", re.I
)
"""The same, set inside another statement."""
WORLD_CHANGE: Final = re.compile(rb"\$(?:ROBROOT|WORLD)\b[ \t]*(?:\.[ \t]*\w+[ \t]*)?=(?!=)", re.I)
"""$ROBROOT or $WORLD set inside another statement."""
APPROACH: Final = re.compile(rb"(?:(?:[ \t]++|(?<=\}))C_(?:PTP|DIS|VEL|ORI|SPL)\b)+[ \t]*\Z", re.I)
"""The approximation at the end of a motion."""
HANDED_POSE: Final = re.compile(
    rb"\"[^\"]*+\"|(?<![\w.$])([A-Za-z]\w*+)[ \t]*+\("
    rb"[^()\"{}]*+\{[ \t]*+(?:(?:E6)?POS[ \t]*+:)?[ \t]*+X[ \t]++[-+.\w]",
    re.I,
)
"""A pose that is an argument of a subprogram."""
_PARAMETER: Final = re.compile(
    rb"[ \t]*+([A-Za-z_]\w*+)[ \t]*+(?:\[[^\]]*+\][ \t]*+)?(?::[ \t]*+(?:IN|OUT)[ \t]*+)?", re.I
)


def split_parameters(code: bytes) -> list[str]:
    """Return the names of a routine's parameters, ``(P1 :IN, N :OUT)``; none where that is not understood.

    Examples
    --------
    >>> split_parameters(b"(XP1 :IN, n[] :OUT)")
    ['XP1', 'n']
    """
    inner = code.strip().removeprefix(b"(").partition(b")")[0]
    found = [_PARAMETER.fullmatch(piece) for piece in inner.split(b",")]
    return [m[1].decode() for m in found if m]
