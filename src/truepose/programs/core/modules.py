"""Modules of a project that are refused while the others are corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from truepose.programs.core.outcomes import DONE, Outcomes
from truepose.programs.core.source import printable


@dataclass(frozen=True)
class RefusedModules:
    """The refused modules of a program; all their targets stay nominal.

    Attributes
    ----------
    outcomes : Outcomes
        The outcomes of the program's targets.
    reasons : dict of Path to str
        The first reason of each module, by its file without the ending: a .src and its .dat are one module.
    """

    outcomes: Outcomes
    reasons: dict[Path, str] = field(default_factory=dict)

    def leave(self, refused: Mapping[int, str]) -> None:
        """Refuse the modules of some targets, each with the reason of the target."""
        targets = self.outcomes.program.targets
        for i, reason in refused.items():
            target = targets[i]
            self.outcomes.code[i] = DONE.index("refuse")
            module = target.path.with_suffix("")
            if module not in self.reasons:
                self.reasons[module] = printable(f"{target.where}: {target.name}: {reason}")
        for first, columns in targets.chunks():
            if why := self.reasons.get(columns.path.with_suffix("")):
                self.outcomes.leave(np.arange(first, first + len(columns)), f"its module is refused: {why}")
        self.outcomes.leave_circles()

    @property
    def files(self) -> dict[Path, str]:
        """The files of the refused modules, each with the reason."""
        paths = [source.path for source in self.outcomes.program.sources]
        return {path: self.reasons[path.with_suffix("")] for path in paths if path.with_suffix("") in self.reasons}

    @property
    def all(self) -> bool:
        """Whether every module is refused."""
        return len(self.files) == len(self.outcomes.program.sources)
