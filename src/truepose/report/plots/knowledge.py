"""Pictures of `truepose explain`: the joints' error curves, and the predicted standard deviation over the region."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from truepose._io import files
from truepose.error_map import ErrorMap
from truepose.report.knowledge import Knowledge
from truepose.report.plots.palette import adaptive, inked
from truepose.report.plots.similarity import POINT, QUIET
from truepose.report.region import planes

PICTURES: Final = ("joints.svg", "sure.svg")


def save_plots(found: Knowledge, folder: Path) -> list[Path]:
    """Write the pictures that can be drawn, of `PICTURES`, to a folder and return their paths."""
    with mpl.rc_context(inked()):
        figures = (plot_joints(found) if found.curves else None, plot_std(found.error_map))
    contents = {
        folder / name: _svg(figure) for name, figure in zip(PICTURES, figures, strict=True) if figure is not None
    }
    files.write_all(contents)
    return list(contents)


def plot_joints(found: Knowledge) -> Figure:
    """Return a figure of the joints' error curves [mrad] over their angles [deg], on one scale.

    Bands are 95 % intervals; ticks below are the angles of the samples.
    """
    figure, axes = _grid(len(found.curves))
    q = found.error_map.samples.q
    assert q is not None
    limit = 1.05e3 * max(float(np.max(np.abs(c.error) + 1.96 * c.std)) for c in found.curves)
    for axis, curve in zip(axes, found.curves, strict=False):
        angle, error, half = np.rad2deg(curve.angle), 1e3 * curve.error, 1.96e3 * curve.std
        axis.fill_between(angle, error - half, error + half, color=POINT, alpha=0.2, linewidth=0)
        axis.plot(angle, error, color=POINT)
        axis.axhline(0.0, color=QUIET, linewidth=0.6)
        axis.set_title(f"joint {curve.joint + 1}", fontsize=10)
        axis.set(xlabel="angle [deg]", ylabel="error [mrad]", ylim=(-limit, limit))
        sampled = np.rad2deg(q[:, curve.joint])
        axis.plot(sampled, np.full(len(sampled), -limit), "|", color=QUIET, markersize=6, clip_on=False)
    return figure


def plot_std(error_map: ErrorMap) -> Figure | None:
    """Return a figure of the predicted std [mm] on planes through the middle of the region; None without planes."""
    found = planes(error_map)
    if not found:
        return None
    figure, axes = _grid(len(found))
    highest = max(float(np.nanmax(plane.std)) for plane in found)
    for axis, plane in zip(axes, found, strict=False):
        drawn = axis.pcolormesh(plane.u, plane.v, plane.std, vmin=0.0, vmax=highest, cmap="viridis", rasterized=True)
        axis.plot(*error_map.p_cmd[:, [plane.i, plane.j]].T, ".", color="#fefefe", markersize=2.5)
        axis.set(xlabel=f"{'xyz'[plane.i]} [mm]", ylabel=f"{'xyz'[plane.j]} [mm]", aspect="equal")
    figure.colorbar(drawn, ax=axes, label="predicted std (length) [mm]")
    return figure


def _grid(count: int) -> tuple[Figure, Any]:
    columns = min(3, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(3.6 * columns + 1.0, 2.9 * rows), layout="constrained")
    axes = np.asarray(figure.subplots(rows, columns, squeeze=False)).reshape(-1)
    for unused in axes[count:]:
        unused.remove()
    return figure, axes[:count]


def _svg(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "truepose", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return adaptive(buffer.getvalue().decode("utf-8")).encode("utf-8")
