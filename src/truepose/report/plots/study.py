"""The picture of a similarity study: variograms, their directions, and the joints' own errors."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truepose._io import files
from truepose.errors import FileError
from truepose.report.findings import title
from truepose.report.joint_similarity import JointSimilarity
from truepose.report.locale import load_locale
from truepose.report.plots.palette import CURVES, MARKERS, adaptive, inked
from truepose.report.plots.similarity import draw_curves, draw_variogram
from truepose.report.study import SimilarityStudy, StudyPart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def save_study(study: SimilarityStudy, path: Path) -> None:
    """Write the pictures of all spaces side by side; the file's ending determines the format.

    Raises
    ------
    FileError
        If the ending is not a known picture format, or the file cannot be written.
    """
    import matplotlib as mpl

    ending = plot_format(path)
    with mpl.rc_context(inked()):
        figure = _figure(study)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=ending, dpi=150)
    content = buffer.getvalue()
    files.write_atomic(path, adaptive(content.decode("utf-8")).encode("utf-8") if ending == "svg" else content)


def _figure(study: SimilarityStudy) -> Figure:
    from matplotlib.figure import Figure

    columns = len(study.parts) + bool(study.joints)
    figure = Figure(figsize=(6.4 * columns, 8.4), layout="constrained")
    grid = figure.add_gridspec(2, columns)
    for k, part in enumerate(study.parts):
        axes = figure.add_subplot(grid[0, k])
        ev = part.envelope.variogram
        draw_variogram(axes, ev, part.model, part.envelope, unit=part.unit, **kinematic_curves(part))
        axes.set_title(title(part, load_locale("en")))
        below = figure.add_subplot(grid[1, k])
        if part.directions:
            curves = {f"along {axis}": (v.lag, v.vector) for axis, v in part.directions.items()}
            below.set_title("By direction: a lower, flatter curve means more similar errors")
        else:
            by_component = zip("xyz", ev.semivariance.T, strict=True)
            curves = {f"error in {axis}": (ev.lag, gamma) for axis, gamma in by_component}
            below.set_title("By component of the error")
        draw_curves(below, curves, part.unit)
    if study.joints:
        _draw_joints(figure.add_subplot(grid[:, -1]), study.joints)
    return figure


def plot_format(path: Path) -> str:
    """Return the picture format of a file by its ending; svg without an ending.

    Raises
    ------
    FileError
        If the ending is not a known picture format.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    ending = path.suffix.removeprefix(".") or "svg"
    if ending.lower() not in FigureCanvasBase.get_supported_filetypes():
        raise FileError(path, f"the ending {path.suffix} is not a picture format; use .svg, .png or .pdf")
    return ending


def kinematic_curves(part: StudyPart) -> dict[str, Any]:
    """Return the curves of the kinematic explanation as arguments of `draw_variogram`; empty without one."""
    if part.explained is None:
        return {}
    return {"theory": part.explained.theory, "residual": part.explained.residual}


def _draw_joints(axes: Axes, joints: list[JointSimilarity]) -> None:
    """Draw the semivariogram of each joint's own error: the model as a line, the estimated curve as dots."""
    for k, one in enumerate(joints):
        colour, marker = CURVES[k % len(CURVES)], MARKERS[k % len(MARKERS)]
        degrees = np.degrees(one.lag)
        axes.plot(degrees, one.semivariance, color=colour, lw=1.5, label=f"q{one.joint + 1}")
        axes.plot(degrees, one.found, color=colour, lw=0, marker=marker, ms=3, alpha=0.6)
    axes.set(xlabel="angle between two positions of the joint [°]", ylabel="semivariance γ(Δ) [mrad²]")
    axes.set_title("Each joint's own error (line: model, dots: estimated curve)")
    axes.set_xlim(left=0)
    axes.set_ylim(0, 1.4 * max(max(one.model.sill, float(np.nanmax(one.found))) for one in joints))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, ncols=2, loc="upper right")
