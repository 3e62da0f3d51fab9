"""The picture of a verified program: the error of each target with its uncertainty, and the tolerance."""

from __future__ import annotations

from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from truepose.programs import ProgramVerification
from truepose.report.locale import Locale
from truepose.report.plots.figures import AFTER, BEFORE, INK, WIDTH, style, to_svg

_NAMED: Final = 24
"""The largest number of targets whose names are written along the axis."""


def target_errors(found: ProgramVerification, say: Locale) -> str:
    """Draw the errors of the targets before and after correction, with U and the tolerance.

    Parameters
    ----------
    found : ProgramVerification
        The verification.
    say : Locale
        The language.
    """
    targets = found.targets
    place = np.arange(len(targets))
    error, expanded = (np.array([getattr(t, key) for t in targets]) for key in ("error_mm", "uncertainty_mm"))
    before = np.array([np.nan if t.before_mm is None else t.before_mm for t in targets])
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 2.8), layout="constrained")
        axes = figure.add_subplot()
        if np.isfinite(before).any():
            axes.plot(place, before, "x", color=BEFORE, markersize=5, label=say("report.before"))
        axes.errorbar(
            place, error, yerr=expanded, fmt="o", color=AFTER, markersize=4, elinewidth=1.0, label=say("report.after")
        )
        axes.axhline(found.tolerance_mm, color=INK, linewidth=1.0, linestyle="--", label=say("verification.tolerance"))
        axes.set(ylabel=say("figure.length"), xlabel=say("verification.column_target"))
        axes.set_ylim(bottom=0.0)
        if len(targets) <= _NAMED:
            turned = max(len(t.name) for t in targets) * len(targets) > 90
            axes.set_xticks(place, [t.name for t in targets], rotation=60 if turned else 0, fontsize=7)
        else:
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        figure.legend(loc="outside upper right", ncols=3, frameon=False)
        return to_svg(figure, say)
