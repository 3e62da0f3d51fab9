"""Facts: what a step found or a user stated about a map, and what it does to corrections.

A fact is data with an effect, not a line of text: every step, command and page reads the same list, see
`truepose.ErrorMap.facts`. A fact that refuses stops `ErrorMap.correct` unless its code is accepted by name.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, NamedTuple, Self

import numpy as np

from truepose.errors import DataError, RefusedError

Effect = Literal["refuses", "transforms", "widens", "told"]


class Kind(NamedTuple):
    """A kind of fact: its effect, its meaning, and for one that refuses the remedy beside accepting it."""

    effect: Effect
    meaning: str
    remedy: str = ""


CODES: Final = {
    "base-elsewhere": Kind(
        "refuses",
        "the commanded positions are in a frame that is not the base of the arm's model",
        "show positions in the robot's own base while measuring, or leave them out",
    ),
    "weak": Kind(
        "refuses",
        "the map is not shown to be better than no map",
        "measure more samples, try another predictor",
    ),
    "constant-std": Kind(
        "refuses",
        "the predictor has one standard deviation for all poses, so that no guard can act",
        "fit a Kriging or kinematic predictor",
    ),
    "base-turned": Kind("transforms", "the model's base is turned by quarter turns against the controller's base"),
    "moved": Kind("widens", "the tracker, the robot base or the tool moved during the campaign, which was accepted"),
    "drift": Kind("widens", "the readings drift during the campaign, which was accepted or is small"),
    "scale": Kind("widens", "measured lengths have a scale against commanded ones, which was accepted or is small"),
    "reference": Kind("widens", "reference points moved during the campaign, which was accepted or is small"),
    "alternating": Kind(
        "widens",
        "the readings are of two populations, as of two reflectors used in turn, which was accepted or is small",
    ),
    "suspected-drift": Kind("widens", "a drift of the readings is suspected, but too uncertain to be named"),
    "repeatability": Kind(
        "widens", "the stated repeatability is more than three times the usual one of the robot, which is used instead"
    ),
    "one-sided": Kind("told", "all samples came from one side, so that lost motion of the joints is not known"),
    "arm-checked": Kind("told", "the arm's model agrees with the positions that the controller shows"),
    "arm-not-checked": Kind("told", "no positions of the controller were at hand to check the arm's model"),
    "registration": Kind("told", "what the registration found beside station and tool"),
    "left-out": Kind("told", "readings that contradict the others, or were masked, took no part in the fit"),
}
"""The kinds of facts by code; docs/facts.md shows this table."""
_ACCEPTED_BY: Final = dict.fromkeys(("weak", "constant-std"), "--accept-weak-map (Python: accept_weak_map=True)")


@dataclass(frozen=True)
class Fact:
    """A finding about a map.

    Attributes
    ----------
    code : str
        The kind of finding, a key of `CODES`.
    words : str
        What was found, a sentence without a full stop.
    step : str
        The step that found it: ``import``, ``fit``, ``update`` or ``validate``.
    size, std : float, optional
        The size of the finding and its standard deviation, in `unit`.
    unit : str
        The unit of both, such as ``mm``.
    """

    code: str
    words: str
    step: str = "fit"
    size: float | None = None
    std: float | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise DataError(f"{self.code!r} is not the code of a fact; expected one of {', '.join(CODES)}")
        if not np.isfinite([number for number in (self.size, self.std) if number is not None]).all():
            raise DataError(f"the fact {self.code!r} has a size that is not a finite number")

    def __str__(self) -> str:
        return self.words

    @property
    def effect(self) -> Effect:
        """What the fact does to corrections: refuses them, transforms targets, widens the std, or is told only."""
        return CODES[self.code].effect

    def to_dict(self) -> dict[str, Any]:
        """Return the fact as plain values, its effect included."""
        return {**asdict(self), "effect": self.effect}

    @classmethod
    def from_dict(cls, found: Mapping[str, Any]) -> Self:
        """Return the fact that `to_dict` described.

        Raises
        ------
        TypeError, DataError
            If a value is missing or of a wrong kind.
        """
        return cls(**{name: value for name, value in found.items() if name != "effect"})


def refuse(facts: Iterable[Fact], accept: Collection[str]) -> list[str]:
    """Refuse corrections for facts that are not accepted; return the sentences of those that are.

    Parameters
    ----------
    facts : iterable of Fact
        The facts of a map.
    accept : collection of str
        The codes of facts that the user accepts.

    Raises
    ------
    DataError
        If a code to accept is not that of a fact that refuses.
    RefusedError
        If a fact that refuses is not accepted; the message says how to accept it.
    """
    refusing = [code for code, kind in CODES.items() if kind.effect == "refuses"]
    if unknown := sorted(set(accept) - set(refusing)):
        raise DataError(f"{unknown[0]!r} cannot be accepted; expected one of {', '.join(refusing)}")
    found = [fact for fact in facts if fact.effect == "refuses"]
    if stopping := [fact for fact in found if fact.code not in accept]:
        first = stopping[0].code
        how = _ACCEPTED_BY.get(first, f"--accept {first} (Python: accept={{{first!r}}})")
        words = "; ".join(fact.words for fact in stopping)
        raise RefusedError(f"{words}; {CODES[first].remedy}, or accept it with {how}")
    return [f"accepted: {fact.words}" for fact in found]
