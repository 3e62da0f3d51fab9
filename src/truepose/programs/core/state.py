"""The values that may be in force at a place of a program: tool, base, mode of interpolation, FDAT, shifts."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple


class InForce(NamedTuple):
    """A tool or base that may be in force.

    Attributes
    ----------
    kind : {"number", "literal", "unset", "call", "unknown"}
        The kind of value.
    text : str
        The text of the program, or the reason why the value is not known.
    number : int, optional
        The number in TOOL_DATA or BASE_DATA.
    pose : tuple of 6 float, optional
        X, Y, Z [mm], A, B, C [deg] of a literal.
    """

    kind: Literal["number", "literal", "unset", "call", "unknown"]
    text: str
    number: int | None = None
    pose: tuple[float, ...] | None = None


class FdatFrames(NamedTuple):
    """The tool and base that an FDAT names, and its IPO_FRAME ("BASE", "TCP", or the reason why it is not known)."""

    tool: InForce
    base: InForce
    ipo: str


class Shift(NamedTuple):
    """A source of shifts at run time: a conveyor, a sensor, a compliant axis.

    Attributes
    ----------
    kind : str
        The kind; an instruction ends all shifts of one kind.
    text : str
        The text of the program, with its line.
    """

    kind: str
    text: str


class State(NamedTuple):
    """The values that may be in force at a node."""

    tool: frozenset[InForce]
    base: frozenset[InForce]
    ipo: frozenset[str]
    fdat: frozenset[FdatFrames]
    shifts: frozenset[Shift] = frozenset()

    def join(self, other: State) -> State:
        """Return the values that may be in force where two ways meet."""
        return State(
            self.tool | other.tool,
            self.base | other.base,
            self.ipo | other.ipo,
            self.fdat | other.fdat,
            self.shifts | other.shifts,
        )


UNSET: Final = InForce("unset", "the program sets none")
NO_FDAT: Final = FdatFrames(
    InForce("unknown", "FDAT_ACT is not set"), InForce("unknown", "FDAT_ACT is not set"), "BASE"
)
NOWHERE: Final = State(frozenset(), frozenset(), frozenset(), frozenset())
START: Final = State(frozenset([UNSET]), frozenset([UNSET]), frozenset(["BASE"]), frozenset([NO_FDAT]))
