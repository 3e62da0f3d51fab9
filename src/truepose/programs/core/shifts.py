"""Instructions that shift motions at run time: conveyor tracking, sensors, compliance, path offsets.

The amount of such a shift is known only at run time, so a correction for the target alone would be wrong.
`truepose.programs.core.flow.Flow` follows which shifts may be active at each motion, and the targets in their reach are
refused by name. Shifts that a calling program has switched on are not seen.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final, NamedTuple

from truepose.programs.core.flow import Flow
from truepose.programs.core.points import Place, Problem, at
from truepose.programs.core.source import shown
from truepose.programs.core.state import Shift


class ShiftKind(NamedTuple):
    """One kind of shift: the instructions that begin it, and those that end it."""

    begins: re.Pattern[bytes]
    ends: re.Pattern[bytes] | None


def _kind(begins: bytes, ends: bytes | None) -> ShiftKind:
    return ShiftKind(re.compile(begins, re.I), None if ends is None else re.compile(ends, re.I))


def _call(begins: bytes, ends: bytes | None) -> ShiftKind:
    """Return a kind whose instructions are calls of functions."""
    head, tail = rb"(?<![\w.$])(?:", rb")[ \t]*\("
    return _kind(head + begins + tail, None if ends is None else head + ends + tail)


FANUC: Final = (
    _kind(rb"\bTouch\s+Offset\b(?!\s*End)[^;]*", rb"\bTouch\s+Offset\s+End\b"),
    _kind(rb"\bTrack\s+(?!End\b)\w+(?:\s*\[[^\]]*\])?", rb"\bTrack\s+End\b"),
    _kind(rb"\bMP\s+Offset\b(?!\s*End)[^;]*", rb"\bMP\s+Offset\s+End\b"),
    _kind(rb"\bSOFTFLOAT\s*\[[^\]]*\]", rb"\bSOFTFLOAT\s+END\b"),
    _kind(rb"\bFORCE\s+(?:CTRL|CONTROL|SENSOR)\b(?!\s*End)", rb"\bFORCE\s+(?:CTRL|CONTROL|SENSOR)\s+End\b"),
    _kind(rb"\bLINE\s*\[[^\]]*\]\s*ON\b|\b(?:SETTRIG|ACCUTRIG|SELBOUND|DEFENC)\s+LNSCH\b", None),
)
"""Seam tracking (TAST, AVC, sensors, DPM), touch sensing, multi-pass, soft float, force control, line tracking."""

UR: Final = (
    _call(rb"track_conveyor_(?:linear|circular)", rb"stop_conveyor_tracking"),
    _call(rb"path_offset_(?:enable|set)", rb"path_offset_disable"),
    _call(rb"force_mode", rb"end_force_mode"),
    _call(rb"freedrive_mode|teach_mode", rb"end_freedrive_mode|end_teach_mode"),
    _call(rb"screw_driving", rb"end_screw_driving"),
)

INFORM: Final = (
    _kind(rb"^[ \t]*SYSTART\b[^\r\n]*", rb"^[ \t]*SYEND\b"),
    _kind(rb"^[ \t]*COMARC(?:ON|SET)?\b(?!\s*OF)[^\r\n]*", rb"^[ \t]*COMARC(?:OF\b|\s+OFF?\b)"),
    _kind(rb"^[ \t]*TRT(?:ON)?\b(?!\s*OF)[^\r\n]*", rb"^[ \t]*TRT(?:OF\b|\s+OFF?\b)"),
    _kind(rb"^[ \t]*FLOATON\b[^\r\n]*", rb"^[ \t]*FLOATOF\b"),
    _kind(rb"^[ \t]*(?:SENSON|SNSON|EYEON|PATHCORON)\b[^\r\n]*", rb"^[ \t]*(?:SENSOF|SNSOF|EYEOF|PATHCOROF)\b"),
    _kind(rb"^[ \t]*(?:FORCEON|FRCON|IMPON)\b[^\r\n]*", rb"^[ \t]*(?:FORCEOF|FRCOF|IMPOF)\b"),
)
"""Conveyor synchronisation, seam tracking, arc length tracking, servo float, sensors, force control."""

_SENSORS: Final = rb"(?:TOUCH|TCH|TS|SEAM|ARCSENSE|CORR|SEN|LASER|FORCE|FTC|FT)_?"
_CONVEYOR: Final = rb"(?<![\w.$])CONV(?:EYOR)?(?:_|\s*\.\s*)"
_TECH: Final = rb"\$TECH(?:_C)?\s*\[[^\]]*\]\s*\.\s*MODE\s*=\s*#"
KRL: Final = (
    _call(rb"RSI_(?:ON|MOVECORR)|ST_(?:ON1?|PATHCORR|MOVESENS)", rb"RSI_OFF|ST_OFF"),
    _kind(_TECH + rb"(?!OFF)\w+", _TECH + rb"OFF"),
    _call(_SENSORS + rb"ON", _SENSORS + rb"OFF"),
    _kind(_CONVEYOR + rb"(?:ON|FOLLOW|SYNC|TRACK|SKIP)\b", _CONVEYOR + rb"(?:OFF|QUIT|INI_OFF)\b"),
    _call(rb"SET_TORQUE_LIMITS", rb"RESET_TORQUE_LIMITS"),
    _kind(rb"\$(?:OFFSET|CORR\w*|PATH_?CORR\w*|PROG_PAF|TORQUE_AXIS)\b[^=\r\n]*=(?!=)", None),
    _kind(rb"\b(?:BASE_CORR_ON|M_BAS_COR_ON|TOOL_CORR_ON|TOOL_CORR_W_ON)\s*=(?!=)\s*(?!FALSE\b)", None),
)
"""Sensor correction (RSI and its forerunner), function generators, touch and seam sensing, conveyors, soft axes, and
corrections that BAS adds to tools and bases."""

RAPID: Final = (
    _kind(rb"^WaitWObj\b", rb"^DropWObj\b"),
    _kind(rb"^ActUnit\b\W*CNV\w*", rb"^DeactUnit\b\W*CNV"),
    _kind(rb"^CorrCon\b", rb"^Corr(?:Clear|Discon)\b"),
    _kind(rb"^(?:SyncToSensor\b(?!.*\\\s*Off\b)|WaitSensor\b)", rb"^(?:SyncToSensor\b.*\\\s*Off\b|DropSensor\b)"),
    _kind(rb"^EGM(?:Act\w+|StreamStart|Run\w+|MoveL|MoveC)\b", rb"^EGM(?:Stop|Reset|StreamStop)\b"),
    _kind(rb"^(?:SoftAct|CSSAct)\b", rb"^(?:SoftDeact|CSSDeact\w*)\b"),
    _kind(rb"^FC(?:Act|Press(?:L|C|1LStart)|RefStart)\b", rb"^FC(?:Deact|PressEnd|RefStop)\b"),
)
"""Conveyors, path correction generators, sensors, externally guided motion, soft servo, force control."""


def follow(flow: Flow, kinds: Iterable[ShiftKind], code: bytes, place: Place) -> None:
    """Tell the flow which shifts an instruction begins or ends."""
    for k, kind in enumerate(kinds):
        if kind.ends is not None and kind.ends.search(code):
            flow.unshift(str(k))
        elif m := kind.begins.search(code):
            flow.shift(str(k), f"{_begun(m)} ({at(place)})")


def begun(kinds: Iterable[ShiftKind], instructions: Iterable[tuple[int, bytes]]) -> list[Shift]:
    """Return all shifts that instructions begin, wherever they may end."""
    kinds = tuple(kinds)
    return [
        Shift("anywhere", f"{_begun(m)} (line {line})")
        for line, code in instructions
        for kind in kinds
        if (m := kind.begins.search(code)) and not (kind.ends and kind.ends.search(code))
    ]


def problem_of(shifts: Iterable[Shift]) -> Problem | None:
    """Return the reason why a target in reach of shifts is refused; None without shifts."""
    texts = sorted(shift.text for shift in shifts)
    return (
        Problem("refuse", f"{texts[0]} may shift it at run time; corrections do not know by how much")
        if texts
        else None
    )


def _begun(m: re.Match[bytes]) -> str:
    return shown(m[0].rstrip(b" \t("))
