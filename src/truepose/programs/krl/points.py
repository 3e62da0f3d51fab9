"""KRL points: where their numbers stand, what the program does with them, and the verdict that follows.

The verdicts are those of the catalogue (shared/spec/programs.md): correct, skip with a warning, or refuse.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, TypeVar

from truepose._typing import FloatArray
from truepose.geometry import euler, make_transform
from truepose.programs.core import shifts
from truepose.programs.core.flow import Frames, InForce, State
from truepose.programs.core.points import Visit
from truepose.programs.core.program import KnownFrames, ReadOptions
from truepose.programs.core.source import Source
from truepose.programs.core.target import Target, Verdict
from truepose.programs.krl.lexer import CARTESIAN, Aggregate

Index = tuple[int, ...] | None
"""Element of an array; () of a plain variable, None where only the run time knows it."""
POSES: Final = ("POS", "E6POS", "FRAME")
JOINTS: Final = ("AXIS", "E6AXIS")
_ABSOLUTELY_ACCURATE: Final = 16
_LARGEST_STATUS: Final = 1 << 16
_NAMES: Final = {"tool": ("$TOOL", "TOOL_DATA", "tools"), "base": ("$BASE", "BASE_DATA", "bases")}
_EXTERNAL: Final = ("E1", "E2", "E3", "E4", "E5", "E6")
_Item = TypeVar("_Item")


class Use(NamedTuple):
    """A motion: its word, where it stands, and what it sets for itself alone (WITH)."""

    word: str
    line: int
    node: int
    tool: InForce | None = None
    base: InForce | None = None
    ipo: str | None = None
    file: str = ""
    section: int = 0

    def visit(self, item: int, order: int = 0) -> Visit:
        """Return the motion as one to a target."""
        return Visit(self.file, self.line, order, self.section, item, self.word)

    @property
    def where(self) -> str:
        """File, where there are several, and line."""
        return f"{self.file}, line {self.line}" if self.file else f"line {self.line}"


@dataclass(slots=True, eq=False)
class Variable:
    """A point or an array of points, and what the program does with each element.

    `reads` and `writes` hold lines with words; `literals` the numbers that are assigned to it;
    `fdats` are those of its file.
    """

    name: str
    type: str
    line: int
    origin: Literal["dat", "src", "import", "nowhere"]
    is_global: bool = False
    is_public: bool = False
    array: bool = False
    fdats: Mapping[str, Frames] | None = None
    moves: defaultdict[Index, list[Use]] = field(default_factory=lambda: defaultdict(list))
    reads: defaultdict[Index, list[tuple[int, str]]] = field(default_factory=lambda: defaultdict(list))
    writes: defaultdict[Index, list[tuple[int, str]]] = field(default_factory=lambda: defaultdict(list))
    literals: defaultdict[Index, list[int]] = field(default_factory=lambda: defaultdict(list))


@dataclass(slots=True, eq=False)
class Numbers:
    """The literal of a point, in the .dat, in an assignment or in a motion (then with its use)."""

    name: str
    source: Source
    line: int
    aggregate: Aggregate
    variable: Variable | None = None
    index: Index = ()
    use: Use | None = None


def at(table: Mapping[Index, list[_Item]], index: Index) -> list[_Item]:
    """Return what may concern an element: its own, and what the run time decides."""
    if index is None:
        return [item for items in table.values() for item in items]
    return [*table.get(index, ()), *table.get(None, ())]


class _Verdict(Exception):  # noqa: N818 - ends the questions about one target
    def __init__(self, verdict: Verdict, reason: str) -> None:
        self.verdict: Verdict = verdict
        self.reason = reason
        super().__init__(reason)


class Judge:
    """Gives each literal its frame, tool and verdict.

    Parameters
    ----------
    frames : KnownFrames
    options : ReadOptions
    states : sequence of State
        What may be in force at each node of the program.
    ambient : State
        What interrupts may set anywhere.
    changed : mapping of ("tool" or "base", number or None) to str
        Where the program changes a numbered frame; None: some number.
    whole : bool
        Every module that there is was read.
    moved : sequence of str
        Where the program changes the place of the robot in its world.
    """

    def __init__(
        self,
        frames: KnownFrames,
        options: ReadOptions,
        states: Sequence[State],
        ambient: State,
        changed: Mapping[tuple[str, int | None], str],
        *,
        whole: bool = False,
        moved: Sequence[str] = (),
    ) -> None:
        self._frames, self._options = frames, options
        self._states, self._ambient = states, ambient
        self._changed, self._whole, self._moved = changed, whole, moved
        self._known: dict[object, tuple[InForce, InForce] | _Verdict] = {}
        self._tf: dict[tuple[str, InForce], FloatArray] = {}

    def target(self, numbers: Numbers) -> Target | None:
        """Return the target of a literal; None where it is no target."""
        variable = numbers.variable
        uses = [numbers.use] if numbers.use else at(variable.moves, numbers.index) if variable else []
        if not uses and (numbers.aggregate.is_joint or variable is None or variable.type in ("FRAME", *JOINTS)):
            return None  # data: nothing moves to it
        tool = base = tf_flange_tool = tf_base_frame = None
        verdict: Verdict = "correct"
        reason = ""
        try:
            self._check_numbers(numbers)
            if variable:
                self._check_variable(variable, numbers.index, uses)
        except _Verdict as end:
            verdict, reason = end.verdict, end.reason
        try:  # also where the target stays as it is: a path may go through it
            if uses:
                tool, base = self._in_force(uses, self._fdat(variable))
                if not reason:
                    self._check_machine(numbers.aggregate)
                    self._check_world()
                tf_flange_tool, tf_base_frame = self._transform("tool", tool), self._transform("base", base)
        except _Verdict as end:
            verdict, reason = (verdict, reason) if reason else (end.verdict, end.reason)
        values, spans = numbers.aggregate.values, numbers.aggregate.spans
        complete = all(key in values for key in CARTESIAN)
        return Target(
            name=numbers.name,
            path=numbers.source.path,
            line=numbers.line,
            motions=tuple([use.word for use in uses]),
            verdict=verdict,
            reason=reason,
            frame=base.text if base else "",
            tool=tool.text if tool else "",
            frame_number=base.number if base else None,
            tool_number=tool.number if tool else None,
            xyz=tuple([values[key] for key in "XYZ"]) if complete else None,
            angles=tuple([values[key] for key in "ABC"]) if complete else None,
            controller="kuka",
            tf_base_frame=tf_base_frame,
            tf_flange_tool=tf_flange_tool,
            status=numbers.aggregate.integer("S"),
            turn=numbers.aggregate.integer("T"),
            spans=tuple([spans[key] for key in CARTESIAN]) if complete else (),
        )

    def _check_numbers(self, numbers: Numbers) -> None:
        aggregate = numbers.aggregate
        if aggregate.is_joint or (numbers.variable and numbers.variable.type in JOINTS):
            raise _Verdict("skip", "joint target")
        if numbers.use and aggregate.prefix == "FRAME":
            raise _Verdict("skip", "an aggregate of type FRAME is no taught point")
        loose = [key for key in CARTESIAN if key in aggregate.loose]
        if loose:
            raise _Verdict("skip", f"{', '.join(loose)}: an expression, known at run time only")
        missing = [key for key in CARTESIAN if key not in aggregate.values]
        if missing:
            raise _Verdict("skip", f"partial: {', '.join(missing)} as before, from another point")

    def _check_variable(self, variable: Variable, index: Index, uses: list[Use]) -> None:
        reads, writes = at(variable.reads, index), at(variable.writes, index)
        if reads:
            line, how = reads[0]
            if uses:
                raise _Verdict(self._options.ambiguous, f"both moved to ({uses[0].where}) and {how} (line {line})")
            raise _Verdict("skip", f"{how} (line {line})")
        if writes:
            raise _Verdict("skip", f"{writes[0][1]} at run time (line {writes[0][0]})")
        if variable.is_global and not self._whole:
            raise _Verdict("refuse", "GLOBAL: other modules may use it under other frames; give the whole project")
        if variable.is_public and not self._whole:
            reason = "its data list is PUBLIC: other modules may import it; give the whole project"
            raise _Verdict("refuse", reason)
        if not uses:
            raise _Verdict("skip", "no motion of this program goes to it")

    def _fdat(self, variable: Variable | None) -> Frames | None:
        """Return the FDAT of the same name: FP7 of XP7."""
        if variable is None or variable.fdats is None or not variable.name.upper().startswith("X"):
            return None
        return variable.fdats.get("F" + variable.name[1:].upper())

    def _check_machine(self, aggregate: Aggregate) -> None:
        for key in ("S", "T"):
            word = aggregate.integer(key)
            if word is not None and not 0 <= word < _LARGEST_STATUS:
                raise _Verdict("refuse", f"{key} {word} is no configuration; correct the file")
        if (aggregate.integer("S") or 0) & _ABSOLUTELY_ACCURATE and not self._options.absolute_accuracy:
            raise _Verdict(
                "refuse",
                "taught on an absolutely accurate robot (Status bit 4): its controller compensates already and errors "
                "would be corrected twice; switch that option off and allow absolute_accuracy",
            )
        moved = [key for key in _EXTERNAL if aggregate.values.get(key) or key in aggregate.loose]
        if moved and not self._options.external_axes:
            raise _Verdict(
                "refuse",
                f"external axis {moved[0]} is in use and has no model; allow external_axes if it moves neither",
            )

    def _check_world(self) -> None:
        if self._moved:
            raise _Verdict(
                "refuse",
                f"the program moves the robot in its world ({self._moved[0]}): bases are known at run time only; set "
                "$ROBROOT in $machine.dat alone",
            )

    def _in_force(self, uses: list[Use], fdat: Frames | None) -> tuple[InForce, InForce]:
        reached = [use for use in uses if self._states[use.node].tool]
        if not reached:
            raise _Verdict("skip", "the program never gets here")
        found = {self._of_use(use, fdat): use for use in reached}
        if len(found) > 1:
            (first, a), (second, b) = list(found.items())[:2]
            which = 0 if first[0] != second[0] else 1
            raise _Verdict(
                self._options.ambiguous,
                f"moved to under {first[which].text} ({a.where}) and {second[which].text} ({b.where}): "
                "teach two points",
            )
        return next(iter(found))

    def _of_use(self, use: Use, fdat: Frames | None) -> tuple[InForce, InForce]:
        key = (use.node, use.tool, use.base, use.ipo, fdat)
        if key not in self._known:
            try:
                self._known[key] = self._resolve(use, fdat)
            except _Verdict as verdict:
                self._known[key] = verdict
        known = self._known[key]
        if isinstance(known, _Verdict):
            raise _Verdict(known.verdict, known.reason)
        return known

    def _resolve(self, use: Use, fdat: Frames | None) -> tuple[InForce, InForce]:
        state = self._states[use.node]
        if problem := shifts.problem_of(state.shifts | self._ambient.shifts):
            raise _Verdict(*problem)
        ipos = {use.ipo} if use.ipo else set(state.ipo)
        if fdat and fdat.ipo != "BASE":
            ipos = {fdat.ipo}
        if ipos != {"BASE"}:
            why = (
                "external TCP (IPO_FRAME #TCP)"
                if ipos == {"TCP"}
                else "whether the TCP is external depends on the run time"
            )
            raise _Verdict("refuse", f"{why}: tool and base change roles, which is not supported")
        return self._value(use, state, fdat, "tool"), self._value(use, state, fdat, "base")

    def _value(self, use: Use, state: State, fdat: Frames | None, which: Literal["tool", "base"]) -> InForce:
        system, data, table = _NAMES[which]
        own = getattr(use, which)
        possible: set[InForce] = {own} if own else set(getattr(state, which) | getattr(self._ambient, which))
        if fdat:
            taught: InForce = getattr(fdat, which)
            # what only a call may have changed counts less than what the point was taught with
            others = {value for value in possible if value.kind not in ("unset", "call")} - {taught}
            if not others:
                possible = {taught}
            elif taught.kind == "number":
                other = min(others, key=str)
                raise _Verdict("refuse", f"taught with {taught.text} (FDAT), but {other.text} may be in force")
        if len(possible) > 1:
            names = " or ".join(sorted(value.text for value in possible)[:3])
            raise _Verdict(
                "refuse", f"{system} depends on the way through the program: {names}; set it before this motion"
            )
        value = possible.pop()
        if value.kind == "unset":
            default = getattr(self._frames, which)
            if default is None:
                raise _Verdict(
                    "refuse",
                    f"no {system} is set before this motion; set it, or give the {which} in force with the frames",
                )
            value = InForce("number", f"{data}[{default}]", default)
        if value.kind not in ("number", "literal"):
            raise _Verdict(
                "refuse", f"{system} is known at run time only: {value.text}; set it to a constant before this motion"
            )
        number = value.number
        if number is not None and number not in getattr(self._frames, table):
            raise _Verdict(
                "refuse",
                f"{which} {number} is not known; give it in [frames] of the cell file, or a $config.dat with "
                f"{data}[{number}]",
            )
        where = self._changed.get((which, number)) or self._changed.get((which, None)) if number else None
        if where:
            raise _Verdict("refuse", f"{value.text} is changed by the program ({where})")
        return value

    def _transform(self, which: Literal["tool", "base"], value: InForce) -> FloatArray:
        if (which, value) not in self._tf:
            if value.pose is not None:
                tf = make_transform(euler("kuka", value.pose[3:]), value.pose[:3])
                tf = self._frames.bases[0] @ tf if which == "base" else tf  # $BASE lies in the world
            else:
                tf = getattr(self._frames, _NAMES[which][2])[value.number]
            self._tf[which, value] = tf
        return self._tf[which, value]
