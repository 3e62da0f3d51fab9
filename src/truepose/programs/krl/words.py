"""KRL's vocabulary, as far as it matters for targets."""

from __future__ import annotations

import re
from typing import Final


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
KEEPS_FRAMES: Final = _words(
    """IF THEN ELSE WHILE UNTIL FOR TO STEP AND OR NOT EXOR B_AND B_OR B_EXOR B_NOT SWITCH CASE RETURN WAIT SEC DO WHEN
    PRIO ABS SIN COS TAN ACOS ASIN ATAN ATAN2 SQRT INV_POS FORWARD INVERSE COPEN CCLOSE CREAD CWRITE CIOCTL SREAD SWRITE
    CAST_TO CAST_FROM EOF PULSE STRADD STRCLEAR STRCOMP STRCOPY STRDECLLEN STRFIND STRLEN STRTOBOOL STRTOINT STRTOREAL
    STRTOFRAME STRTOPOS STRTOAXIS STRTOE6POS STRTOE6AXIS VARSTATE VARTYPE FRAND TIMER EXISTS_KRLMSG EXISTS_KRLDLG
    SET_KRLMSG SET_KRLDLG CLEAR_KRLMSG MSGNOTIFY MSGQUIT MSGSTATE MSGDIALOG MSGLOG IR_STOPM"""
)
"""Words before a parenthesis that leave tool and base unchanged: the language's own, and common messages."""

IDENTIFIER: Final = re.compile(
    rb"\"[^\"]*+\"|'[^'\r\n]*+'|#[ \t]*+\w+|\.[ \t]*+[A-Za-z_]\w*+"
    rb"|(?<!\w)([A-Za-z_$][\w$]*+)[ \t]*+(\(|\[[ \t]*+[\d, \t]+\]|\[)?+"
)
"""A name and the bracket behind it; texts, enumerations and components are skipped."""
STRAY_MOTION: Final = re.compile(
    rb"\"[^\"]*+\"|(?<![\w$#.'])(S?(?:PTP|LIN|CIRC)(?:_REL)?|SPL(?:_REL)?)(?=[ \t]*\{|[ \t]+[A-Za-z_$])", re.I
)
"""A motion word before an operand."""
FRAME_CHANGE: Final = re.compile(rb"\$(?:TOOL|BASE)\b[ \t]*(?:\.[ \t]*\w+[ \t]*)?=(?!=)", re.I)
"""$TOOL or $BASE set inside another statement."""
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
