"""Group the targets that are not corrected by their reasons."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Protocol

_NUMBER: Final = re.compile(r"(?<![\w.])(?<!_DATA\[)(?<!FRAME\[)(?<!TOOL\[)[-+−]?\d+(?:\.\d+)?(?!\w)")
"""A number, but for digits of a name and the number of a frame, which is its name."""


_PLACE: Final = re.compile(r"\((?:[^()]*, )?line \d+(?: of [^()]*)?\)")
_LINE: Final = re.compile(r"(?<=in )(?:\S+, )?line \d+|(?<=: )\S+, line \d+(?=, uses it)")
_CODE: Final = re.compile(
    r"(?<=run time: )\S.*|(?<=not known: )\S.*|(?<=not understood: )\S.*|(?<=arithmetic \(…\): )[^;]*"
    r"|(?<=handed to )\w+\(\)|(?<=passed to )\w+|(?<=depends on the way through the program: )\S.*"
    r"|(?<=derived from it, ).*?(?=: |, the correction differs)"
)
_POINTS: Final = re.compile(
    r"(?<=derived from )(?!it\b)[^;:()]+?(?= \(…\)|:| by constant)|(?<=other point )\S+|\bP\d+(?= is a variable)"
    r"|(?<=moved to under ).*(?= \(…\)(?:: |$))|(?<=between ).*(?= \(…\))|(?<= mm at ).*(?= \(…\))"
    r"|(?<=which )\S+(?= may (?:write|read|use))|(?<=\w\[)\d+:[^\]]*(?=\])"
)
"""Names of points, of registers and of routines that use them, where reasons quote them."""


class Judged(Protocol):
    """A target with its verdict, such as `truepose.programs.Target`."""

    @property
    def name(self) -> str:
        """The name of the target."""

    @property
    def where(self) -> str:
        """Its file and line."""

    @property
    def verdict(self) -> str:
        """What becomes of it."""

    @property
    def reason(self) -> str:
        """Why."""


@dataclass(frozen=True)
class ReasonGroup:
    """Targets with one verdict, whose reasons are of one kind.

    Attributes
    ----------
    verdict : str
        The verdict.
    reason : str
        The reason of the first target.
    alike : bool
        Whether all reasons are equal, numbers included.
    targets : tuple of str
        The file, line and name of each target.
    """

    verdict: str
    reason: str
    alike: bool
    targets: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the group for JSON."""
        return {"verdict": self.verdict, "reason": self.reason, "targets": list(self.targets)}


def without_numbers(reason: str) -> str:
    """Return a reason with … in place of its numbers.

    Examples
    --------
    >>> without_numbers("P12: correction of 0.5 mm is above the limit of 0.3 mm")
    'P12: correction of … mm is above the limit of … mm'
    """
    return _NUMBER.sub("…", reason)


def kind_of(reason: str) -> str:
    """Return a reason with … in place of its numbers, files, lines and points, and of the code that it quotes.

    Frames and tools keep their names and numbers: each of them needs a remedy of its own.

    Examples
    --------
    >>> kind_of("target computed at run time: Offs(p1,0,0,50)"), kind_of("read by arithmetic (a.mod, line 9)")
    ('target computed at run time: …', 'read by arithmetic (…)')
    >>> kind_of("its circle's other point XP5 (line 12) is left out: relative")
    "its circle's other point … (…) is left out: relative"
    """
    told = _LINE.sub("line …", _PLACE.sub("(…)", reason))
    return without_numbers(_POINTS.sub("…", _CODE.sub("…", told)))


def group_reasons(targets: Iterable[Judged]) -> list[ReasonGroup]:
    """Return the groups of targets by verdict and kind of reason, see `kind_of`; the largest group first."""
    found: dict[tuple[str, str], list[Judged]] = {}
    for target in targets:
        found.setdefault((target.verdict, kind_of(target.reason)), []).append(target)
    groups = [
        ReasonGroup(
            verdict,
            some[0].reason,
            len({target.reason for target in some}) == 1,
            tuple(f"{target.where} {target.name}" for target in some),
        )
        for (verdict, _), some in found.items()
    ]
    return sorted(groups, key=lambda group: -len(group.targets))
