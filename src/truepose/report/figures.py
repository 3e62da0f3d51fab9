"""Pictures of the report, as SVG text that follows the page's colours."""

from __future__ import annotations

import io
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from truepose.report.study import StudyPart

FloatArray = NDArray[np.float64]

BEFORE: Final = "#c2562d"
AFTER: Final = "#1f77a4"
_INK: Final = "#010203"  # replaced by the page's own text colour
_NO_METADATA: Final = dict.fromkeys(
    ("Date", "Creator", "Format", "Type")
)  # no name of a web site, same bytes each time
_STYLE: Final[dict[Any, Any]] = {
    "font.size": 9.0,
    "svg.fonttype": "none",
    "svg.hashsalt": "truepose",
    "axes.spines.top": False,
    "axes.spines.right": False,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), _INK),
}


def to_svg(figure: Figure) -> str:
    """Return a figure as an SVG element whose text and axes take the page's text colour."""
    buffer = io.StringIO()
    with mpl.rc_context(_STYLE):
        figure.savefig(buffer, format="svg", transparent=True, metadata=_NO_METADATA, bbox_inches="tight")
    text = buffer.getvalue()
    return text[text.index("<svg") :].replace(_INK, "currentColor")


def error_arrows(p: FloatArray, before: FloatArray, after: FloatArray) -> str:
    """Draw errors as arrows where they arise, before and after, magnified alike.

    Parameters
    ----------
    p : (n, 3) array [mm], base frame
        Commanded positions.
    before, after : (n, 3) arrays [mm], base frame
    """
    largest = float(np.linalg.norm(before, axis=1).max())
    extent = float(np.ptp(p, axis=0).max())
    magnify = _round_down(0.15 * extent / largest) if largest > 0 and extent > 0 else 1.0
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(9.0, 4.2))
        for k, (e, colour, title) in enumerate(((before, BEFORE, "before"), (after, AFTER, "after")), 1):
            axes = figure.add_subplot(1, 2, k, projection="3d")
            axes.quiver(*p.T, *(magnify * e).T, color=colour, linewidth=0.9, arrow_length_ratio=0.3)
            axes.scatter(*p.T, s=2, color=colour, alpha=0.5)
            axes.set_title(f"{title}: {np.linalg.norm(e, axis=1).mean():.3f} mm in the mean", fontsize=9)
            axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
            axes.set_box_aspect(np.maximum(np.ptp(p, axis=0), 0.2 * max(extent, 1.0)))
            axes.tick_params(labelsize=7, pad=0)
            axes.locator_params(nbins=4)
            for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
                axis.set_pane_color((0.5, 0.5, 0.5, 0.06))
        figure.text(0.5, 0.02, f"arrows {magnify:g} times as long as the errors", ha="center", fontsize=8)
        figure.subplots_adjust(left=0.02, right=0.95, wspace=0.08, bottom=0.1, top=0.95)
        return to_svg(figure)


def histogram(before: FloatArray, after: FloatArray) -> str:
    """Draw the lengths of errors (n, 3) [mm] before and after."""
    lengths = [np.linalg.norm(e, axis=1) for e in (before, after)]
    edges = np.linspace(0.0, max(float(length.max()) for length in lengths) or 1.0, 31)
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 2.9))
        axes = figure.add_subplot()
        for length, colour, label in zip(lengths, (BEFORE, AFTER), ("before", "after"), strict=True):
            axes.hist(length, bins=edges.tolist(), color=colour, alpha=0.65, label=label)
            axes.axvline(float(length.max()), color=colour, linewidth=1.0, linestyle=":")
        axes.set(xlabel="length of the error [mm]; dotted: largest", ylabel="poses")
        axes.legend(frameon=False)
        return to_svg(figure)


def variogram(part: StudyPart) -> str:
    """Draw the semivariogram of one space with its fit and envelope."""
    with mpl.rc_context(_STYLE):
        return to_svg(part.figure())


def standard_deviation(p: FloatArray, std: FloatArray) -> str:
    """Draw where the map is sure: std (n,) [mm] at positions (n, 3) [mm], seen along each axis."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(9.0, 2.9))
        for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)), 1):
            axes: Axes = figure.add_subplot(1, 3, k)
            drawn = axes.scatter(p[:, i], p[:, j], c=std, s=14, cmap="viridis", vmin=0.0)
            axes.set(xlabel=f"{'xyz'[i]} [mm]", ylabel=f"{'xyz'[j]} [mm]", aspect="equal")
            axes.locator_params(nbins=3)
        figure.subplots_adjust(wspace=0.45, right=0.9)
        bar = figure.colorbar(drawn, ax=figure.axes, shrink=0.85, pad=0.02)
        bar.set_label("predicted std [mm]")
        return to_svg(figure)


def _round_down(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value))
