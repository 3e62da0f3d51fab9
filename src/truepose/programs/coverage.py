"""How much of programs is corrected, why the rest is not, and which options would allow it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.delimited import csv_cell
from truepose._typing import BoolArray
from truepose.programs.core.outcomes import Outcomes
from truepose.programs.core.program import Program
from truepose.programs.core.reasons import kind_of
from truepose.programs.core.remedies import Remedy, remedy_of

_COLUMNS: Final = ("program", "targets", "correctable", "count", "reason", "option", "assumption")
_TOTAL: Final = "in all"


@dataclass(frozen=True)
class CoverageReason:
    """The motion targets that one reason leaves as they are.

    Attributes
    ----------
    reason : str
        The reason; its kind where the reasons differ (`truepose.programs.core.reasons.kind_of`).
    count : int
        The number of targets.
    example : str
        The reason of the first target.
    """

    reason: str
    count: int
    example: str = ""

    @property
    def remedy(self) -> Remedy | None:
        """What would allow these targets; None where nothing does."""
        return remedy_of(self.example or self.reason)

    def to_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        remedy = self.remedy
        option, assumption = ("", "") if remedy is None else (remedy.option, remedy.assumption)
        found = {"reason": self.reason, "count": self.count, "option": option, "assumption": assumption}
        return found | ({"example": self.example} if self.example not in ("", self.reason) else {})


@dataclass(frozen=True)
class CoverageLine:
    """The motion targets of a program, or of all.

    Attributes
    ----------
    name : str
        The file of the program.
    targets, correctable : int
        The number of targets that motions go to, and of those that are or can be corrected.
    reasons : tuple of CoverageReason
        Why the others are not, the most frequent reason first.
    """

    name: str
    targets: int
    correctable: int
    reasons: tuple[CoverageReason, ...]

    @property
    def share(self) -> float:
        """The share of correctable targets, 0 to 1; 1 without targets."""
        return self.correctable / self.targets if self.targets else 1.0

    def by_option(self) -> dict[str, int]:
        """Return the number of targets that each option would allow; "" for those that none allows."""
        counts: Counter[str] = Counter()
        for one in self.reasons:
            counts["" if one.remedy is None else one.remedy.option] += one.count
        return dict(counts.most_common())

    def to_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        reasons = [one.to_dict() for one in self.reasons]
        return {"program": self.name, "targets": self.targets, "correctable": self.correctable, "reasons": reasons}


@dataclass(frozen=True, repr=False)
class Coverage:
    r"""How much of programs is corrected.

    Attributes
    ----------
    programs : tuple of CoverageLine
        The programs; each module of a project or task is one.
    corrected : bool
        Whether the programs were corrected with a map; otherwise the counts are those of reading.
    unreadable : tuple of str
        The programs that cannot be read or are refused, with the reasons.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from truepose.programs import read_program
    >>> path = Path(tempfile.mkdtemp()) / "a.src"
    >>> frames = "$TOOL=$NULLFRAME\n$BASE=$NULLFRAME"
    >>> _ = path.write_text(f"DEF a()\n{frames}\nLIN_REL {{X 1}}\nLIN {{X 1,Y 2,Z 3,A 0,B 0,C 0}}\nEND\n")
    >>> coverage = Coverage.of_programs([read_program(path)])
    >>> coverage
    <Coverage: 1 of 2 motion targets can be corrected>
    >>> coverage.total.by_option()
    {'': 1}
    """

    programs: tuple[CoverageLine, ...]
    corrected: bool = False
    unreadable: tuple[str, ...] = ()

    def __repr__(self) -> str:
        what = "are corrected" if self.corrected else "can be corrected"
        return f"<Coverage: {self.total.correctable} of {self.total.targets} motion targets {what}>"

    @classmethod
    def of_programs(cls, programs: Iterable[Program], unreadable: Iterable[object] = ()) -> Coverage:
        """Return what can be corrected of programs that were read, without a map."""
        lines = [line for program in programs for line in _lines(program, program.allowed(), {})]
        return cls(tuple(lines), False, tuple(map(str, unreadable)))

    @classmethod
    def of_outcomes(cls, outcomes: Iterable[Outcomes], unreadable: Iterable[object] = ()) -> Coverage:
        """Return what is corrected of programs by a map."""
        lines = [line for one in outcomes for line in _lines(one.program, one.moved, one.why)]
        return cls(tuple(lines), True, tuple(map(str, unreadable)))

    @classmethod
    def of_counts(
        cls, programs: Iterable[tuple[str, int, Mapping[str, int]]], unreadable: Iterable[object] = ()
    ) -> Coverage:
        """Return what is corrected of programs whose targets were counted.

        Of each program: its name, the number of its motion targets, and how many of them each reason leaves as they
        are.
        """
        lines = []
        for name, targets, left in programs:
            counts = _Counts()
            for reason, n in left.items():
                counts.add(reason, n)
            lines.append(CoverageLine(name, targets, targets - sum(left.values()), counts.reasons()))
        return cls(tuple(lines), True, tuple(map(str, unreadable)))

    @classmethod
    def from_dict(cls, known: Mapping[str, Any], unreadable: Iterable[object] = ()) -> Coverage:
        """Return the coverage that `to_dict` made JSON of."""
        lines = [
            CoverageLine(
                str(line["program"]),
                int(line["targets"]),
                int(line["correctable"]),
                tuple(
                    CoverageReason(str(one["reason"]), int(one["count"]), str(one.get("example", one["reason"])))
                    for one in line["reasons"]
                ),
            )
            for line in known["programs"]
        ]
        return cls(tuple(lines), bool(known["corrected"]), tuple(map(str, unreadable)))

    @property
    def total(self) -> CoverageLine:
        """The sum over all programs."""
        counts = _Counts()
        for one in (reason for line in self.programs for reason in line.reasons):
            counts.add(one.example, one.count, one.reason)
        targets, correctable = (sum(getattr(one, key) for one in self.programs) for key in ("targets", "correctable"))
        return CoverageLine(_TOTAL, targets, correctable, counts.reasons())

    def to_dict(self) -> dict[str, Any]:
        """Return the programs and their sum, for JSON."""
        programs = [one.to_dict() for one in self.programs]
        return {"corrected": self.corrected, "total": self.total.to_dict(), "programs": programs}

    def to_csv(self) -> str:
        """Return one row for each reason of each program and of all, and one for each program without reasons."""
        rows = [",".join(_COLUMNS)]
        for line in (*self.programs, self.total):
            for one in line.reasons or (CoverageReason("", 0),):
                told = one.to_dict()
                values = (line.name, line.targets, line.correctable, told["count"])
                texts = (told["reason"], told["option"], told["assumption"])
                rows.append(",".join(csv_cell(str(value)) for value in (*values, *texts)))
        return "\n".join(rows) + "\n"


class _Counts:
    """Counts reasons by their kind and by what allows them."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, Remedy | None], CoverageReason] = {}

    def add(self, reason: str, n: int = 1, shown: str = "") -> None:
        """Add the reason of n targets; `shown` is its kind if it stands for several."""
        key = kind_of(reason), remedy_of(reason)
        known = self._found.get(key, CoverageReason(shown or reason, 0, reason))
        same = known.reason == (shown or reason)
        self._found[key] = CoverageReason(known.reason if same else key[0], known.count + n, known.example)

    def reasons(self) -> tuple[CoverageReason, ...]:
        """Return the reasons, the most frequent first."""
        return tuple(sorted(self._found.values(), key=lambda one: -one.count))


def _lines(program: Program, done: BoolArray, why: Mapping[int, str]) -> list[CoverageLine]:
    """Return the lines of a program, one for each of its modules."""
    n = len(program.targets)
    kind, moved_to = np.empty(n, np.int64), np.empty(n, bool)
    reasons: list[str] = []
    for first, columns in program.targets.chunks():
        kinds, which = columns.shared()
        here = slice(first, first + len(columns))
        kind[here] = len(reasons) + which
        moved_to[here] = np.array([bool(target.motions) for target in kinds])[which]
        reasons += [target.reason for target in kinds]
    return [
        _line(str(path), np.array(rows, np.int64), done & moved_to, moved_to, [reasons, kind, why])
        for path, rows in program.modules.items()
    ]


def _line(
    name: str, rows: NDArray[np.int64], done: BoolArray, moved_to: BoolArray, told: Sequence[Any]
) -> CoverageLine:
    reasons, kind, why = told
    counts = _Counts()
    for i in rows[moved_to[rows] & ~done[rows]].tolist():
        counts.add(why.get(i) or reasons[kind[i]])
    return CoverageLine(name, int(moved_to[rows].sum()), int(done[rows].sum()), counts.reasons())
