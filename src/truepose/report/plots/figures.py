"""Pictures of the report as SVG, with text as shapes so that no font can be missing.

A page replaces the colours of `palette.COLOURS` by its own, for its light and dark schemes.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from truepose._typing import FloatArray
from truepose.report import fonts
from truepose.report.locale import Locale
from truepose.report.plots import similarity as plot
from truepose.report.plots.palette import LIGHT, inked
from truepose.report.plots.study import kinematic_curves
from truepose.report.region import Plane
from truepose.report.study import StudyPart

WIDTH: Final = 9.0
"""The width of a picture that fills the page [in]."""

INK: Final = LIGHT["ink"]
BEFORE: Final = LIGHT["before"]
AFTER: Final = LIGHT["after"]

_SINGLE: Final = (5.2, 2.6)
"""The size of a picture of one plot [in], which also is read on a telephone."""
_CROSS: Final = "#303030"  # on a filled map, light or dark
_NO_METADATA: Final = dict.fromkeys(("Date", "Creator", "Format", "Type"))  # the same bytes each time


def error_arrows(p: FloatArray, before: FloatArray, after: FloatArray, arm: FloatArray | None, say: Locale) -> str:
    """Draw the arm with the poses, and the error vectors before and after; after also on a scale of its own.

    Parameters
    ----------
    p : (n, 3) array [mm], base frame
        The commanded positions.
    before, after : (n, 3) arrays [mm], base frame
        The errors before and after correction.
    arm : (m, 3) array [mm] or None
        The arm as rods, see `truepose.report.arm`.
    say : Locale
        The language.
    """
    common, own = magnification(p, before), magnification(p, after)
    panels = (("before", before, BEFORE, common), ("after", after, AFTER, common), ("after", after, AFTER, own))
    with mpl.rc_context(style()):
        figure = Figure(figsize=(WIDTH, 8.0))
        _draw_cell(figure.add_subplot(2, 2, 1, projection="3d"), p, arm, say)
        for k, (state, e, colour, times) in enumerate(panels, 2):
            axes = figure.add_subplot(2, 2, k, projection="3d")
            axes.quiver(*p.T, *(times * e).T, color=colour, linewidth=0.9, arrow_length_ratio=0.3)
            axes.scatter(*p.T, s=2, color=colour, alpha=0.5)
            mean = say(f"figure.{state}_mean", mean=float(np.linalg.norm(e, axis=1).mean()))
            axes.set_title(f"{mean}\n{say('figure.arrows_scale', times=times)}", fontsize=9)
            _in_space(axes, np.ptp(p, axis=0))
        figure.subplots_adjust(left=0.02, right=0.95, wspace=0.08, hspace=0.3, bottom=0.04, top=0.94)
        return to_svg(figure, say)


def magnification(p: FloatArray, e: FloatArray) -> float:
    """Return a round magnification for which the longest of the arrows e (n, 3) is about 15 % of the extent of p."""
    largest, extent = float(np.linalg.norm(e, axis=1).max()), float(np.ptp(p, axis=0).max())
    return _round_down(0.15 * extent / largest) if largest > 0 and extent > 0 else 1.0


def _draw_cell(axes: Any, p: FloatArray, arm: FloatArray | None, say: Locale) -> None:
    axes.scatter(*p.T, s=3, color=AFTER, alpha=0.6)
    corners = p
    if arm is not None:
        axes.plot(*arm.T, color=LIGHT["arm"], linewidth=4.0, solid_capstyle="round")
        axes.scatter(*arm.T, s=14, color=INK, depthshade=False)
        corners = np.vstack([p, arm])
    axes.set_title(say("figure.cell" if arm is not None else "figure.cell_poses"), fontsize=9)
    _in_space(axes, np.ptp(corners, axis=0))


def _in_space(axes: Any, extent: FloatArray) -> None:
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.set_box_aspect(np.maximum(extent, 0.2 * max(float(extent.max()), 1.0)))
    axes.tick_params(labelsize=7, pad=0)
    axes.locator_params(nbins=4)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.5, 0.5, 0.5, 0.06))


def histogram(before: FloatArray, after: FloatArray, say: Locale) -> str:
    """Draw a histogram of the lengths of errors (n, 3) [mm] before and after."""
    lengths = [np.linalg.norm(e, axis=1) for e in (before, after)]
    edges = np.linspace(0.0, max(float(length.max()) for length in lengths) or 1.0, 31)
    with mpl.rc_context(style()):
        figure = Figure(figsize=_SINGLE, layout="constrained")
        axes = figure.add_subplot()
        for length, colour, state in zip(lengths, (BEFORE, AFTER), ("before", "after"), strict=True):
            axes.hist(length, bins=edges.tolist(), color=colour, alpha=0.65, label=say(f"report.{state}"))
            axes.axvline(float(length.max()), color=colour, linewidth=1.0, linestyle=":")
        axes.set(xlabel=say("figure.length"), ylabel=say("figure.poses"))
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
        figure.legend(loc="outside upper right", ncols=2, frameon=False)
        return to_svg(figure, say)


def variogram(part: StudyPart, say: Locale) -> str:
    """Draw the semivariogram of one space with its fit and envelope."""
    with mpl.rc_context(style()):
        figure = plot.plot_variogram(
            part.envelope.variogram,
            part.model,
            part.envelope,
            unit=part.unit,
            words=say.words("similarity"),
            **kinematic_curves(part),
        )
        figure.set_size_inches(_SINGLE[0], 3.4)
        return to_svg(figure, say)


def maps(planes: Sequence[Plane], p: FloatArray, say: Locale) -> str:
    """Draw the predicted error (top), its standard deviation (bottom), and the measured poses.

    Parameters
    ----------
    planes : sequence of Plane
        The predictions.
    p : (n, 3) array [mm], base frame
        The positions of the measured poses.
    say : Locale
        The language.
    """
    with mpl.rc_context(style()):
        widths = [float(np.ptp(plane.u)) for plane in planes]
        height = 7.0 * max(float(np.ptp(plane.v)) for plane in planes) / sum(widths)
        figure = Figure(figsize=(WIDTH, 2 * height + 1.2), layout="constrained")
        grid = figure.subplots(2, len(planes), squeeze=False, width_ratios=widths)
        rows = (
            ("error", _pale("YlOrBr"), [plane.error for plane in planes]),
            ("std", _pale("PuBu"), [plane.std for plane in planes]),
        )
        for row, (quantity, colours, values) in zip(grid, rows, strict=True):
            top = max((float(np.nanmax(v)) for v in values if np.isfinite(v).any()), default=1.0)
            levels = MaxNLocator(9).tick_values(0.0, top or 1.0)
            for axes, plane, value in zip(row, planes, values, strict=True):
                drawn = axes.contourf(plane.u, plane.v, np.ma.masked_invalid(value), levels=levels, cmap=colours)
                axes.plot(*p[:, [plane.i, plane.j]].T, "+", color=_CROSS, markersize=3, markeredgewidth=0.4)
                axes.set(xlabel=f"{'xyz'[plane.i]} [mm]", ylabel=f"{'xyz'[plane.j]} [mm]", aspect="equal")
                axes.locator_params(nbins=4)
                axes.tick_params(labelsize=7)
            bar = figure.colorbar(drawn, ax=row.tolist(), shrink=0.9, pad=0.02, format=_ticks(say))
            bar.set_label(say(f"figure.{quantity}"))
            bar.ax.tick_params(labelsize=7)
        return to_svg(figure, say)


def style() -> dict[Any, Any]:
    """Return the settings of all pictures."""
    return {
        "font.family": fonts.use_in_figures(),
        "font.size": 9.0,
        "svg.fonttype": "path",
        "svg.hashsalt": "truepose",
        "grid.color": (0.5, 0.5, 0.5, 0.3),
        "axes.spines.top": False,
        "axes.spines.right": False,
        **inked(),
    }


def _pale(name: str) -> ListedColormap:
    """Return a sequential colour map without its darkest part, on which the crosses would not be seen."""
    return ListedColormap(mpl.colormaps[name](np.linspace(0.0, 0.72, 256)))


def _ticks(say: Locale) -> ScalarFormatter:
    """Return a formatter with the decimal mark of the language."""

    class Formatter(ScalarFormatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return str(super().__call__(x, pos)).replace(".", say.decimal)

    return Formatter()


def to_svg(figure: Figure, say: Locale) -> str:
    """Return a figure as an SVG element."""
    for axes in figure.axes:
        for name in ("xaxis", "yaxis", "zaxis"):
            axis = getattr(axes, name, None)
            if axis is not None and type(axis.get_major_formatter()) is ScalarFormatter:
                axis.set_major_formatter(_ticks(say))
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata=_NO_METADATA, bbox_inches="tight")
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _round_down(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1, 2, 5) if step * power <= value))
