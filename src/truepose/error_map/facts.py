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
    "joint-zero": Kind(
        "refuses",
        "the zero of a joint is far off, as after a new mastering",
        "if that joint was not mastered again, check the robot's model and the joints of the samples",
    ),
    "link-off": Kind(
        "refuses",
        "a length or an angle of a link is far beyond its tolerance",
        "check the robot's model, row by row, and that it is this robot",
    ),
    "negative-lost-motion": Kind(
        "refuses",
        "the identified lost motion of a joint is negative",
        "check the directions of approach (approach1 …) of the samples",
    ),
    "rises-under-load": Kind(
        "refuses",
        "the identified arm rises under its load",
        "check the payloads (load_kg) of the samples and the mass in [payload]",
    ),
    "reflector-off": Kind(
        "refuses",
        "the readings put the reflector far from the stated tool",
        'state the reflector\'s place on the flange in [tool], or let it be fitted with fit = "position"',
    ),
    "unexplained": Kind(
        "refuses",
        "the identified arm leaves ten times what the robot repeats",
        "check the robot's model, and that joints and readings of a row belong together",
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
    "one-sided": Kind(
        "widens",
        "joints reached all samples from one side; for targets reached from the other a lost motion is assumed",
    ),
    "sides-not-stated": Kind("told", "the samples do not state from which side the joints came"),
    "work-not-stated": Kind("widens", "a temperature or payload that differs among the samples is not stated for work"),
    "work-not-measured": Kind("widens", "the temperature or payload at work is one that no sample had"),
    "arm-checked": Kind(
        "told", "the positions that the controller shows agree with the arm's model and the controller's tool"
    ),
    "arm-not-checked": Kind("told", "no positions of the controller were at hand to check the arm's model"),
    "reflector-checked": Kind("told", "the readings put the reflector at the stated tool, or near it"),
    "reflector-not-checked": Kind("told", "whether the reflector sits at the stated tool was not checked"),
    "registration": Kind("told", "what the registration found beside station and tool"),
    "left-out": Kind("told", "readings that contradict the others, or were masked, took no part in the fit"),
    "not-holding": Kind("told", "new samples contradicted the map when they were added, which was accepted"),
    "new-conditions": Kind(
        "told",
        "new samples have a temperature, time or payload that no sample of the map had and the map does not know",
    ),
    "campaign-not-tested": Kind(
        "told", "there were too few samples to test for a moved tracker, a scale error or a drift"
    ),
    "identification": Kind("told", "what the identification of the arm found beside its parameters"),
    "approximated": Kind(
        "told", "there were too many samples for the predictor that was asked for, which is approximated"
    ),
    "load-centre": Kind("told", "the samples state payloads without their centre of mass, which is assumed"),
    "suspect-readings": Kind("told", "readings lay far from the expected positions when they were imported"),
    "missing": Kind("told", "points of the plan had no reading and were left out when the readings were imported"),
    "reordered": Kind(
        "told", "readings in another order than the plan were assigned by their positions when they were imported"
    ),
    "averaged": Kind("told", "repeated readings were averaged when they were imported"),
    "import-note": Kind("told", "what the import found about the file of readings"),
}
"""The kinds of facts by code; docs/facts.md shows this table."""
EFFECTS: Final[dict[Effect, str]] = {
    "refuses": "corrections are refused until it is accepted with {how}",
    "transforms": "corrections follow it",
    "widens": "the standard deviation allows for it",
    "told": "",
}
"""What facts of each effect do, in words."""
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

    @property
    def sentence(self) -> str:
        """What was found, and what it does to corrections; without a full stop."""
        does = EFFECTS[self.effect].format(how=how_to_accept(self.code))
        return f"{self.words} ({does})" if does else self.words

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


def of_import(found: Iterable[tuple[str, str]]) -> list[Fact]:
    """Return the facts that a table of samples states; those of a later version, whose code is not known, as notes."""
    return [Fact(code if code in CODES else "import-note", words, "import") for code, words in found]


def how_to_accept(code: str) -> str:
    """Return the option, and the argument in Python, that accepts a fact that refuses."""
    return _ACCEPTED_BY.get(code, f"--accept {code} (Python: accept={{{code!r}}})")


def in_force(facts: Iterable[Fact]) -> list[Fact]:
    """Return the facts that do something to corrections, in their order."""
    return [fact for fact in facts if fact.effect != "told"]


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
        If facts that refuse are not accepted; the message says how to accept each.
    """
    refusing = [code for code, kind in CODES.items() if kind.effect == "refuses"]
    if unknown := sorted(set(accept) - set(refusing)):
        raise DataError(f"{unknown[0]!r} cannot be accepted; expected one of {', '.join(refusing)}")
    found = [fact for fact in facts if fact.effect == "refuses"]
    if stopping := [fact for fact in found if fact.code not in accept]:
        words: dict[str, list[str]] = {}
        for fact in stopping:
            words.setdefault(fact.code, []).append(fact.words)
        each = [
            f"{'; '.join(said)}; {CODES[code].remedy}, or accept it with {how_to_accept(code)}"
            for code, said in words.items()
        ]
        raise RefusedError("; ".join(each))
    return [f"accepted: {fact.words}" for fact in found]
