"""The words of INFORM instructions, as patterns over bytes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

MOTION: Final = re.compile(
    rb"[ \t]*([+*]?)[ \t]*(S?)(MOV[JLCS])[ \t]+([A-Z]+[\d\[][^\s]*)((?:[ \t]+[BE][CPX]X?\d+)*)", re.I
)
"""A motion: whether it belongs to the second group, whether it is coordinated, its word, its operand, its axes."""
TOGETHER: Final = re.compile(rb"[ \t]+(?=\+[ \t]*S?MOV[JLCS]\b)", re.I)
"""Between two motions of one instruction, those of two groups."""
STRAY: Final = re.compile(rb"\"[^\"]*+\"|(?<![\w*:#$])([SE]?I?MOV[JLCS](?=[ \t]+[A-Z]+[\d\[])|SFTON\b|SFTOF\b)", re.I)
"""Words that must begin an instruction; texts are skipped."""
OPERAND: Final = re.compile(rb"(?<![\w#$])(?:ARGF)?(C|P)X?(\d{3,6})\b")
AXES: Final = re.compile(rb"([BE][CPX])X?(\d{1,9})", re.I)
RELATIVE: Final = re.compile(rb"[ \t]*(?:S|E)?IMOV\w*", re.I)
CONVEYOR: Final = re.compile(rb"\bCV#\([^)]*\)?", re.I)
SPEED: Final = re.compile(rb"\bV[JRE]?[ \t]*=", re.I)
LABEL: Final = re.compile(rb"[ \t]*\*([^\s]+)")
JUMP: Final = re.compile(rb"[ \t]*JUMP[ \t]+(\*([^\s]+)|[^\s]+)([ \t]+IF\b)?", re.I)
JUMP_INSIDE: Final = re.compile(rb"\bJUMP[ \t]+\*([^\s]+)", re.I)
"""A jump behind a condition, as in ``IF B000>5 JUMP *A``."""
CALLED: Final = re.compile(rb"[ \t]*(?:CALL|JUMP|PSTART)\b[^'\"]*?\bJOB:([^\s\"']+)([^\r\n]*)", re.I)
"""A job that is called, jumped to or started beside; behind it the rest of the instruction."""
JOB: Final = re.compile(rb"\"[^\"]*+\"|\bJOB:([^\s\"']+)", re.I)
"""A job that an instruction names, whatever it does with it; texts are skipped."""
COMMENTED_OUT: Final = re.compile(rb"[ \t]*COMM(?!\w)", re.I)
"""A line that the pendant has made a comment."""
STEPS: Final = re.compile(rb"\bSTEP#", re.I)
"""A position that is read by the number of its motion."""
UNKNOWN_CALL: Final = re.compile(rb"[ \t]*(?:CALL|MACRO\w*)[ \t]+(?!JOB:)", re.I)
"""A call whose job is known at run time only."""
CONDITION: Final = re.compile(rb"[ \t]IF[ \t]", re.I)
RETURNS: Final = re.compile(rb"[ \t]*RET\b", re.I)
RETURN: Final = re.compile(rb"[ \t]*RET\b(?![^\r\n]*\bIF\b)", re.I)
SHIFT: Final = re.compile(
    rb"[ \t]*SFTON(3D)?\b[ \t]*(?:P(\d{3,6})\b)?[ \t]*((?:BF|RF|TF|UF#\([ \t]*\d{1,2}[ \t]*\))?)[ \t]*(.*)", re.I
)
"""A shift: of three dimensions, by which P variable, along what, and what else the instruction names."""
UNSHIFT: Final = re.compile(rb"[ \t]*SFTOF\b", re.I)
ELEMENT: Final = re.compile(rb"[ \t]*SETE[ \t]+P(\d{3,6})[ \t]*\([ \t]*([1-6])[ \t]*\)[ \t]+(-?\d{1,9})[ \t]*$", re.I)
"""An element of a P variable that is set to a constant, in micrometres or 1e-4 degrees."""
OWN_FRAME: Final = re.compile(rb"(?<!\w)(UF|TL)#\([ \t]*(\d{1,9}(?=[ \t]*\)))?[^)]*\)?", re.I)
"""A user frame or a tool by its number."""
_READS_FRAMES: Final = re.compile(
    rb"[ \t]*(?:SFTON(?:3D)?|MSHIFT|CNVRT|CALL|JUMP|PSTART|MACRO\w*|[SE]?IMOV\w*|GETPOS\w*|GETTOOL)(?!\w)", re.I
)
"""Instructions that name user frames and tools, and leave them as they are."""
ANY_VARIABLE: Final = re.compile(rb"(?<![\w#$])PX?[ \t]*\[|^[ \t]*CLEAR[ \t]+PX?\d", re.I)
"""A P variable whose number only the run time knows, or several."""
BLOCK: Final = re.compile(
    rb"[ \t]*(IFTHEN|IFTHENEXP|ELSEIF|ELSEIFEXP|ELSE|ENDIF|WHILE|WHILEEXP|ENDWHILE|FOR|NEXT|"
    rb"SWITCH|CASE|DEFAULT|ENDSWITCH)(?![\w:])",
    re.I,
)


def changed_frames(code: bytes) -> Iterator[tuple[str, int | None]]:
    """Yield the tools and user frames that an instruction may change; None: some of them."""
    if not _READS_FRAMES.match(code) and not MOTION.match(code):
        for m in OWN_FRAME.finditer(code):
            yield "base" if m[1].upper() == b"UF" else "tool", int(m[2]) if m[2] else None


def without_comment(code: bytes) -> bytes:
    """Return an instruction without the comment behind it."""
    return code.split(b" '")[0]
