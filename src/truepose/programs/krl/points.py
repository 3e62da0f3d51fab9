"""KRL points: their numbers, the program's uses of them, and the tool and base in force at each motion.

`truepose.programs.core.judge.Judge` gives the verdicts (docs/programs.md).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple, TypeVar

from truepose.geometry import euler, make_transform
from truepose.programs.core import shifts
from truepose.programs.core.joint_targets import KUKA, JointNumbers
from truepose.programs.core.judge import WITHIN, Judge, NotCorrected
from truepose.programs.core.pieces import WHOLE, Section
from truepose.programs.core.points import JOINTS as JOINT_TARGET
from truepose.programs.core.points import Frame, Place, Point, Problem, Use, at, how_to_state, stated_frame
from truepose.programs.core.program import KnownFrames, ReadOptions
from truepose.programs.core.source import Source
from truepose.programs.core.state import FdatFrames, InForce, State
from truepose.programs.core.target import JOINT_MOTION, Stands
from truepose.programs.krl.lexer import CARTESIAN, Aggregate

Index = tuple[int, ...] | None
"""Element of an array; () of a plain variable, None where only the run time knows it."""
POSES: Final = ("POS", "E6POS", "FRAME")
JOINTS: Final = ("AXIS", "E6AXIS")
_ABSOLUTELY_ACCURATE: Final = 16
_LARGEST_STATUS: Final = 1 << 16
_NAMES: Final = {"tool": ("$TOOL", "TOOL_DATA"), "base": ("$BASE", "BASE_DATA")}
_ARM: Final = ("A1", "A2", "A3", "A4", "A5", "A6")
_EXTERNAL: Final = ("E1", "E2", "E3", "E4", "E5", "E6")
_NEVER: Final = Problem("skip", "the program never reaches this motion")
_Item = TypeVar("_Item")
_InForceAt = tuple[Frame | None, Frame | None, Problem | None]
"""Tool, base, and the reason why they are not known."""
_Uses = defaultdict[Index, list[tuple[Place, str]]]


class KrlMotion(NamedTuple):
    """A motion: its word, its place in the text and in the flow, and the settings of its WITH."""

    word: str
    place: Place
    node: int
    tool: InForce | None = None
    base: InForce | None = None
    ipo: str | None = None
    section: Section = WHOLE

    @property
    def line(self) -> int:
        """Line of the motion."""
        return self.place if isinstance(self.place, int) else self.place.line

    def use(self) -> Use:
        """Return the motion as a use of a point, without tool and base."""
        return Use(self.word, self.place, section=self.section)


@dataclass(slots=True, eq=False)
class PointVariable:
    """A point or an array of points, with the uses of each element.

    `literals` are the numbers that are assigned to it; `fdats` are those of its file. A `parameter` of a routine may be
    a point of the caller.
    """

    name: str
    type: str
    line: int
    origin: Literal["dat", "src", "import", "nowhere"]
    is_global: bool = False
    is_public: bool = False
    array: bool = False
    parameter: bool = False
    fdats: Mapping[str, FdatFrames] | None = None
    moves: defaultdict[Index, list[KrlMotion]] = field(default_factory=lambda: defaultdict(list))
    reads: _Uses = field(default_factory=lambda: defaultdict(list))
    writes: _Uses = field(default_factory=lambda: defaultdict(list))
    literals: defaultdict[Index, list[Numbers]] = field(default_factory=lambda: defaultdict(list))
    _places: dict[Index, dict[int, int]] | None = None

    def motions_to(self, numbers: Numbers) -> list[tuple[KrlMotion, int]]:
        """Return the motions that may go to one of the literals, each with its place among the motion's goals."""
        if len(self.literals) == 1 and len(self.literals[numbers.index]) == 1:
            return [(motion, 0) for motion in concerning(self.moves, numbers.index)]
        indices = self.moves if numbers.index is None else {numbers.index: None, None: None}
        found = [(index, motion) for index in indices for motion in self.moves.get(index, ())]
        return [(motion, self._place(index, numbers)) for index, motion in found]

    def _place(self, index: Index, numbers: Numbers) -> int:
        """Return the place of a literal among those that an index may mean."""
        self._places = {} if self._places is None else self._places
        if index not in self._places:
            self._places[index] = {id(goal): k for k, goal in enumerate(concerning(self.literals, index))}
        return self._places[index][id(numbers)]


@dataclass(slots=True, eq=False)
class Numbers:
    """The literal of a point, in the .dat, in an assignment or in a motion (then with that motion)."""

    name: str
    source: Source
    line: int
    aggregate: Aggregate
    variable: PointVariable | None = None
    index: Index = ()
    motion: KrlMotion | None = None


def concerning(table: Mapping[Index, list[_Item]], index: Index) -> list[_Item]:
    """Return the items that may concern an element: its own, and those whose element only the run time knows."""
    if index is None:
        return [item for items in table.values() for item in items]
    return [*table.get(index, ()), *table.get(None, ())]


class KrlJudge(Judge):
    """Gives each literal its tools, bases and verdict.

    Parameters
    ----------
    frames : KnownFrames
        The controller's tools and bases.
    options : ReadOptions
        The options of reading.
    states : sequence of State
        The values that may be in force at each node of the program.
    ambient : State
        The values that interrupts may set anywhere.
    changed : mapping of ("tool" or "base", number or None) to place
        The places where the program changes a numbered frame; None: some number.
    whole : bool
        Whether every module that exists was read.
    moved : sequence of str
        The statements that change the place of the robot in its world.
    set_to : mapping of ("tool" or "base", number) to sequence of InForce
        The values that the program gives to numbered frames.
    """

    def __init__(
        self,
        frames: KnownFrames,
        options: ReadOptions,
        states: Sequence[State],
        ambient: State,
        changed: Mapping[tuple[str, int | None], Place],
        *,
        whole: bool = False,
        moved: Sequence[str] = (),
        set_to: Mapping[tuple[str, int | None], Sequence[InForce]] | None = None,
    ) -> None:
        super().__init__(frames, options, "kuka")
        self._set_to = set_to or {}
        self._states, self._ambient = states, ambient
        self._numbers_changed, self._whole, self._moved = changed, whole, moved
        self._known: dict[object, _InForceAt] = {}

    def point(self, numbers: Numbers) -> Point | None:
        """Return the point of a literal; None where it is data that no motion goes to."""
        variable, aggregate = numbers.variable, numbers.aggregate
        motions = [(numbers.motion, 0)] if numbers.motion else []
        if variable is not None:
            motions = variable.motions_to(numbers)
        if not motions and (aggregate.is_joint or variable is None or variable.type in ("FRAME", *JOINTS)):
            return None
        complete = all(key in aggregate.values for key in CARTESIAN)
        joints = _joints(numbers, [motion for motion, _ in motions])
        shared = None if variable is None or self._whole else _shared(variable)
        return Point(
            numbers.name,
            numbers.source,
            numbers.line,
            tuple([aggregate.values[key] for key in CARTESIAN]) if complete else (),
            tuple([aggregate.spans[key] for key in CARTESIAN]) if complete else (),
            None if joints else _problem_of(numbers),
            status=aggregate.integer("S"),
            turn=aggregate.integer("T"),
            shared=shared,
            objection=self._external(aggregate) if joints else self._objection(aggregate),
            joints=joints,
            uses=self.uses(motions, variable, based=joints is None),
            reads=[] if variable is None else concerning(variable.reads, numbers.index),
            writes=[] if variable is None else concerning(variable.writes, numbers.index),
        )

    def uses(
        self, motions: list[tuple[KrlMotion, int]], variable: PointVariable | None = None, *, based: bool = True
    ) -> list[Use]:
        """Return motions with tool and base; one that control never reaches has those of the first one reached.

        `variable` is the point that they go to, whose FDAT counts. Joint targets, which are not `based`, need no base.
        """
        fdat = _fdat(variable)
        reached = next((motion for motion, _ in motions if self._states[motion.node].tool), None)
        uses = []
        for motion, order in motions:
            goes = motion if self._states[motion.node].tool else reached
            tool, base, problem = (None, None, _NEVER) if goes is None else self._in_force_at(goes, fdat, based)
            uses.append(Use(motion.word, motion.place, tool, base, problem, motion.section, order))
        return uses

    def _objection(self, aggregate: Aggregate) -> Problem | None:
        """Return why numbers cannot be corrected although tool and base are known."""
        for key in ("S", "T"):
            word = aggregate.integer(key)
            if word is not None and not 0 <= word < _LARGEST_STATUS:
                return Problem("refuse", f"{key} {word} is no configuration; correct the file")
        if (aggregate.integer("S") or 0) & _ABSOLUTELY_ACCURATE and not self._options.absolute_accuracy:
            return Problem(
                "refuse",
                "taught on an absolutely accurate robot (Status bit 4): its controller compensates already and errors "
                "would be corrected twice; switch that option off and allow absolute_accuracy",
            )
        if problem := self._external(aggregate):
            return problem
        if self._moved:
            reason = f"the program moves the robot in its world ({self._moved[0]}): bases are known at run time only"
            return Problem("refuse", f"{reason}; set $ROBROOT in $machine.dat alone")
        return None

    def _external(self, aggregate: Aggregate) -> Problem | None:
        used = [key for key in _EXTERNAL if aggregate.values.get(key) or key in aggregate.loose]
        if not used or self._options.external_axes:
            return None
        reason = f"external axis {used[0]} is in use and has no model; allow external_axes if it moves neither"
        return Problem("refuse", reason)

    def _of(self, which: str, frame: Frame | None) -> Frame:
        if frame is None:
            raise NotCorrected("refuse", f"the {which} is not known")  # the motion's own problem says why
        return frame

    def _in_force_at(self, motion: KrlMotion, fdat: FdatFrames | None, based: bool) -> _InForceAt:
        key = (motion.node, motion.tool, motion.base, motion.ipo, fdat, based)
        if key not in self._known:
            try:
                self._known[key] = (*self._resolve(motion, fdat, based), None)
            except NotCorrected as stop:
                self._known[key] = (None, None, stop.problem)
        return self._known[key]

    def _resolve(self, motion: KrlMotion, fdat: FdatFrames | None, based: bool) -> tuple[Frame, Frame | None]:
        state = self._states[motion.node]
        if problem := shifts.problem_of(state.shifts | self._ambient.shifts):
            raise NotCorrected(*problem)
        ipos = {motion.ipo} if motion.ipo else set(state.ipo | self._ambient.ipo)
        if fdat and fdat.ipo != "BASE":
            ipos = {fdat.ipo}
        if ipos not in ({"BASE"}, {"TCP"}):
            why = "whether the TCP is external (IPO_FRAME #TCP) depends on the run time"
            raise NotCorrected("refuse", f"{why}; set $IPO_MODE to a constant before this motion")
        stands: Stands = "base" if ipos == {"TCP"} else ""
        tool = self._value(motion, state, fdat, "tool")._replace(stands=stands)
        return tool, self._value(motion, state, fdat, "base")._replace(stands=stands) if based else None

    def _value(self, motion: KrlMotion, state: State, fdat: FdatFrames | None, which: Literal["tool", "base"]) -> Frame:
        system, data = _NAMES[which]
        own = getattr(motion, which)
        possible: set[InForce] = {own} if own else set(getattr(state, which) | getattr(self._ambient, which))
        if fdat:
            possible = _as_taught(getattr(fdat, which), possible)
        if len(possible) > 1:
            names = " or ".join(sorted(value.text for value in possible)[:3])
            reason = f"{system} depends on the way through the program: {names}; set it before this motion"
            raise NotCorrected("refuse", reason)
        value = possible.pop()
        if value.kind == "unset":
            default = stated_frame(self._frames, which)
            if default is None:
                reason = f"no {system} is set before this motion; set it, or state the one in force"
                raise NotCorrected("refuse", f"{reason} ({how_to_state(which)})")
            if not isinstance(default.key, int):
                return default
            value = InForce("number", f"{data}[{default.key}]", default.key)
        if value.kind not in ("number", "literal"):
            reason = f"{system} is known at run time only: {value.text}; set it to a constant before this motion"
            if value.pose is None:
                raise NotCorrected("refuse", reason)
            if self._tolerance(which) is None:
                raise NotCorrected("refuse", f"{reason}; {WITHIN[which]}")
        if value.pose is not None:
            tf = make_transform(euler("kuka", value.pose[3:]), value.pose[:3])
            changed = "" if value.kind == "literal" else f"{value.text}, a variable that may change"
            return Frame(value.text, None, tf.tobytes(), changed)
        number, places = value.number, self._numbers_changed
        if number and (place := places.get((which, number)) or places.get((which, None))):
            how = f"{value.text} is changed by the program ({at(place)})"
            return Frame(value.text, number, changed=self._tolerated(which, number, how))
        return Frame(value.text, number)

    def _tolerated(self, which: str, number: int, how: str) -> str:
        """Return how a tool or base is changed if the tolerance of the options allows that."""
        tolerance, table = self._tolerance(which), self._frames.tools if which == "tool" else self._frames.bases
        if (stored := table.get(number)) is None:
            if tolerance is None:
                raise NotCorrected("refuse", how)
            return ""  # that it is not known is told
        if tolerance is None:
            raise NotCorrected("refuse", f"{how}; {WITHIN[which]}")
        for value in self._set_to.get((which, number), ()):
            tf = table.get(value.number) if value.number is not None else None
            if value.pose is not None:
                tf = make_transform(euler("kuka", value.pose[3:]), value.pose[:3])
                tf = tf if which == "tool" else self._frames.bases[0] @ tf
            if tf is not None and not tolerance.holds(stored, tf):
                kind = "tool" if which == "tool" else "frame"
                reason = f"{how}, to {value.text}, which is beyond the tolerance around the stored {kind}"
                larger = f"state a larger one (--{kind}-tolerance), or set ${which.upper()} to it"
                raise NotCorrected("refuse", f"{reason}; {larger}")
        return how

    def _remedy(self, which: str, frame: Frame) -> str:
        return f"{super()._remedy(which, frame)}, or a $config.dat with {frame.text}"


def _as_taught(taught: InForce, possible: set[InForce]) -> set[InForce]:
    """Return the values that may be in force at a point that was taught under an FDAT."""
    # what only a call may have changed counts less than what the point was taught with
    others = {value for value in possible if value.kind not in ("unset", "call")} - {taught}
    if not others:
        return {taught}
    if taught.kind == "number":
        other = min(others, key=str)
        raise NotCorrected("refuse", f"taught with {taught.text} (FDAT), but {other.text} may be in force")
    return possible


def _problem_of(numbers: Numbers) -> Problem | None:
    """Return the reason why the numbers of a literal are no target to correct."""
    aggregate = numbers.aggregate
    if aggregate.is_joint or (numbers.variable and numbers.variable.type in JOINTS):
        return JOINT_TARGET
    if numbers.motion and aggregate.prefix == "FRAME":
        return Problem("skip", "an aggregate of type FRAME is no taught point")
    if loose := [key for key in CARTESIAN if key in aggregate.loose]:
        return Problem("skip", f"{', '.join(loose)}: an expression, known at run time only")
    if missing := [key for key in CARTESIAN if key not in aggregate.values]:
        return Problem("skip", f"partial: {', '.join(missing)} as before, from another point")
    return None


def _joints(numbers: Numbers, motions: Sequence[KrlMotion]) -> JointNumbers | None:
    """Return the joints of a literal to which joint motions go; None where it is none, or is not complete."""
    values, spans = numbers.aggregate.values, numbers.aggregate.spans
    if _problem_of(numbers) != JOINT_TARGET or not all(axis in values for axis in _ARM):
        return None
    if not all(JOINT_MOTION.fullmatch(motion.word) for motion in motions):
        return None
    return JointNumbers(tuple([values[axis] for axis in _ARM]), tuple([spans[axis] for axis in _ARM]), KUKA)


def _shared(variable: PointVariable) -> Problem | None:
    """Return the reason why modules that are not at hand may use a point."""
    if variable.is_global:
        return Problem("refuse", "GLOBAL: other modules may use it under other frames; give the whole project")
    if variable.is_public:
        return Problem("refuse", "its data list is PUBLIC: other modules may import it; give the whole project")
    return None


def _fdat(variable: PointVariable | None) -> FdatFrames | None:
    """Return the FDAT of the same name: FP7 of XP7."""
    if variable is None or variable.fdats is None or not variable.name.upper().startswith("X"):
        return None
    return variable.fdats.get("F" + variable.name[1:].upper())
