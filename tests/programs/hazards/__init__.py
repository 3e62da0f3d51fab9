"""The table hazard × language: what could make a correction wrong, with a program of each language that has it.

A cell is a small program with the verdict of each of its targets, by name (or ``line N``). A language that has not the
construct says why in its `ABSENT`. `tests/programs/test_hazards.py` refuses a table with an empty cell.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from truepose.programs import FrameTable, ReadOptions

HAZARDS = {
    "unknown-statement": "a statement that no rule knows stands before a change of a frame or point, or a call",
    "coordinate-in-position": "coordinates of a point are numbers of a position that is written inside a motion",
    "coordinate-in-number": "a coordinate of a point goes to a number that moves, decides, or goes to an output",
    "coordinate-in-frame": "a coordinate of a point goes into a frame or a shift of another point",
    "expression-in-modifier": "a point is read in the modifiers of a motion or in the condition of an interrupt",
    "called-program-shifts": "a called program leaves a shift in force",
    "called-program-sets-frame": "a called program leaves another frame or tool in force",
    "handler-changes-state": "an interrupt, trap, trigger or thread changes what is in force, also through calls",
    "certain-loop": "a loop that surely runs sets a frame or tool",
    "conditional-frame": "a branch sets a frame or tool",
    "frame-written-by-call": "a function or system routine writes a frame or tool that is handed to it",
    "routine-like-a-motion": "a routine of the program is named like a motion",
    "error-leaves-a-routine": "an error leaves a routine in which a shift or another frame is in force",
    "array-element": "motions go to elements of an array by an index that varies",
    "whole-array": "a whole array or record is copied",
    "compact-condition": "a condition and its statement stand on one line",
    "initial-value": "a declaration takes its value from another point",
    "routine-in-an-expression": "a function in a condition, an index or an argument changes what is in force",
    "routine-in-a-motion": "a motion names a routine that runs with it",
    "argument-by-name": "arguments are handed over by name",
    "optional-argument": "a routine has arguments with default values",
    "argument-not-followed": "an argument is computed from a point and cannot be followed",
    "argument-written": "a routine writes to a point that is handed to it",
    "tool-through-argument": "a tool or frame is handed to a routine that sets it",
    "continue-in-loop": "a statement goes on with the next turn of a loop and passes a change by",
    "inverse-kinematics": "a point is read by a function of inverse kinematics",
    "chain-of-copies": "a point is copied through several variables, over branches",
    "index-read": "a coordinate of a point makes an index",
    "arithmetic-on-a-point": "a coordinate of a point is changed by arithmetic",
    "run-time-shift": "a point is moved to with a shift that is known at run time only",
    "two-frames": "a point is moved to in two frames or with two tools",
    "sensor-shift": "a sensor shifts motions",
    "alias": "a point or frame has a second name",
    "recursion": "a routine calls itself and changes what is in force",
    "unreachable-code": "a motion or a change stands in code that is never reached",
    "state-across-calls": "what a routine leaves in force counts after the call, also through two calls",
}
"""Names of hazards with one line each."""

LANGUAGES = ("krl", "rapid", "tp", "urscript", "inform", "val3")


@dataclass(frozen=True)
class Cell:
    """A program of one hazard.

    Attributes
    ----------
    files : dict of str
        Files by name; the first is read.
    wanted : dict of str
        The verdict of each target: by name, or ``line N`` where it has none.
    options : ReadOptions
        What may be assumed.
    frames : FrameTable, optional
        Frames and tools by name; by default those of `tests.programs.example`.
    fault : str
        What is judged wrongly today; the test is a strict expected failure then.
    """

    files: dict[str, str]
    wanted: dict[str, str]
    options: ReadOptions = field(default_factory=ReadOptions)
    frames: FrameTable | None = None
    fault: str = ""
