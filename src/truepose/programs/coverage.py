"""How many motion targets of a program are corrected, and the share that a user requires."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from truepose.errors import RefusedError
from truepose.programs.core.outcomes import Outcomes


class Coverage(NamedTuple):
    """How many targets motions go to, and how many of them are corrected."""

    corrected: int
    targets: int

    @classmethod
    def of(cls, programs: Iterable[Outcomes]) -> Coverage:
        """Count the motion targets of programs; a point that no motion goes to is none."""
        corrected = targets = 0
        for outcomes in programs:
            done = outcomes.corrected
            for first, columns in outcomes.program.targets.chunks():
                kinds, which = columns.shared()
                moved_to = np.array([bool(target.motions) for target in kinds])[which]
                targets += int(np.count_nonzero(moved_to))
                corrected += int(np.count_nonzero(moved_to & done[first : first + len(columns)]))
        return cls(corrected, targets)

    def __str__(self) -> str:
        nominal = self.targets - self.corrected
        stay = "stays" if nominal == 1 else "stay"
        return f"{self.corrected} of {self.targets} motion targets corrected, {nominal} {stay} nominal"

    def check(self, required: float, where: object) -> None:
        """Refuse a program that has too few corrected targets.

        Parameters
        ----------
        required : float
            The share of the motion targets, 0 to 1.
        where : object
            The program, for the message.

        Raises
        ------
        RefusedError
            If fewer are corrected.
        """
        if self.corrected < required * self.targets - 1e-9:
            raise RefusedError(
                f"{where}: {self}, but {100 * required:g} % must be corrected (require); nothing is written: "
                "see why with 'truepose check', or require less"
            )
