"""Group the targets that are not corrected by their reasons."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Protocol

_NUMBER: Final = re.compile(r"-?\d+(?:\.\d+)?")


class Judged(Protocol):
    """A target with its verdict, such as `truepose.programs.Target`."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def where(self) -> str: ...  # noqa: D102
    @property
    def verdict(self) -> str: ...  # noqa: D102
    @property
    def reason(self) -> str: ...  # noqa: D102


@dataclass(frozen=True)
class ReasonGroup:
    """Targets with one verdict, whose reasons differ in their numbers at most.

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


def group_reasons(targets: Iterable[Judged]) -> list[ReasonGroup]:
    """Return the groups of targets by verdict and reason, without regard to numbers; the largest group first."""
    found: dict[tuple[str, str], list[Judged]] = {}
    for target in targets:
        found.setdefault((target.verdict, _NUMBER.sub("#", target.reason)), []).append(target)
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
