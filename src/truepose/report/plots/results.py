"""Pictures of results: `truepose.plot` draws variograms, fits, error fields, predictions, validations and choices."""

from __future__ import annotations

import base64
import io
from functools import singledispatch
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import MaxNLocator

from truepose._typing import FloatArray
from truepose.compensation import Corrections
from truepose.error_map import ErrorMap
from truepose.error_map.prediction import Prediction
from truepose.error_map.validation import Validation
from truepose.errors import DataError
from truepose.predictors import Choice
from truepose.predictors.base import Predictor
from truepose.report.plots.palette import CURVES
from truepose.report.plots.similarity import BAND, MODEL, POINT, QUIET, draw_variogram
from truepose.report.region import Plane, planes
from truepose.similarity import Envelope, ExperimentalVariogram, VariogramModel

_STEPS: Final = 41  # of a section through an error field, along each axis
_WIDTH: Final = {1: 6.4, 2: 9.0, 3: 10.5}  # of a figure with so many axes [in]


class ResultFigure(Figure):
    """A figure that a notebook shows as a picture."""

    def _repr_html_(self) -> str:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=110)
        return f'<img alt="" src="data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}">'


def plot(result: Any, *, figure: Figure | SubFigure | None = None, **options: Any) -> Figure | SubFigure:
    """Return a figure of a result.

    ========================== =========================================================================================
    result                     picture
    ========================== =========================================================================================
    ExperimentalVariogram      semivariogram; options of `truepose.report.plots.draw_variogram`, as in ``model=``;
                               ``unit=`` of the distances, by default mm, above three coordinates rad
    VariogramModel             its curve; ``unit=`` and ``longest=``, the largest distance
    Envelope                   semivariogram and the band of shuffled errors; the same options
    ErrorMap                   sections through the predicted error (top) and its standard deviation (bottom)
    fitted predictor           the same for a predictor of positions (n, 3), through the middle of its samples
    Prediction                 predicted errors of each pose with their 95 % intervals
    Validation                 measured against predicted errors, residuals against their predicted standard deviation,
                               and the share of poses below a length of error, before and after
    Corrections                lengths of the corrections, by verdict
    Choice                     the cross-validated mean error of each candidate, with its 95 % interval
    ========================== =========================================================================================

    Parameters
    ----------
    result : object
        The result, see the table.
    figure : matplotlib.figure.Figure or SubFigure, optional
        The figure to draw on, for example ``plt.figure()``; by default a new one, which a notebook shows and which
        ``savefig`` writes.
    **options
        The options of the picture.

    Returns
    -------
    matplotlib.figure.Figure or SubFigure

    Raises
    ------
    DataError
        If there is no picture of such a result.

    Examples
    --------
    >>> from truepose.similarity import experimental_variogram
    >>> figure = plot(experimental_variogram([[0.0], [1.0], [2.0]], [0.0, 1.0, 0.5], bins=2))
    >>> figure.axes[0].get_xlabel()
    'distance h [mm]'
    """
    if _draw.dispatch(type(result)) is _draw.dispatch(object):
        known = ", ".join(sorted(kind.__name__ for kind in _draw.registry if kind is not object))
        raise DataError(f"there is no picture of {type(result).__name__}; truepose.plot draws {known}")
    if figure is None:
        figure = ResultFigure(layout="constrained")
    _draw(result, figure, **options)
    return figure


@singledispatch
def _draw(result: Any, figure: Figure | SubFigure, **options: Any) -> None: ...


@_draw.register
def _(result: ExperimentalVariogram, figure: Figure | SubFigure, **options: Any) -> None:
    joints = {"unit": "rad"} if result.dimensions > 3 else {}
    draw_variogram(_row(figure, 1)[0], result, **joints | options)


@_draw.register
def _(result: Envelope, figure: Figure | SubFigure, **options: Any) -> None:
    _draw(result.variogram, figure, envelope=result, **options)


@_draw.register
def _(result: VariogramModel, figure: Figure | SubFigure, unit: str = "mm", longest: float | None = None) -> None:
    if longest is None:
        reach = 1.5 * result.practical_range
        longest = reach if np.isfinite(reach) and reach > 0 else float(np.max(result.range))
    h = np.linspace(0.0, longest, 300)[1:]
    axes = _row(figure, 1)[0]
    several = len(np.ravel(result.range))
    for k in range(several):
        direction = np.eye(several)[k] if isinstance(result.range, tuple) else None
        label = f"along axis {k + 1}" if several > 1 else result.family
        axes.plot(h, result.semivariance(h, direction), color=CURVES[(k + (several == 1)) % len(CURVES)], label=label)
    axes.axhline(result.nugget, color=QUIET, lw=0.8, ls=":", label="nugget")
    axes.set(xlabel=f"distance h [{unit}]", ylabel="semivariance [mm²]", xlim=(0, longest))
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize=8)


@_draw.register
def _(result: ErrorMap, figure: Figure | SubFigure) -> None:
    found = planes(result)
    if not found:
        raise DataError(f"{result.robot.name} has no inverse kinematics here, so no section can be drawn")
    _draw_sections(figure, found, result.p_cmd)


@_draw.register
def _(result: Predictor, figure: Figure | SubFigure) -> None:
    if not hasattr(result, "n_features_in_") or result.n_features_in_ != 3:
        raise DataError(f"a section needs a {type(result).__name__} that was fitted to positions (n, 3)")
    x = result.points_
    low, high = x.min(axis=0), x.max(axis=0)
    found = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        u, v = (np.linspace(low[k], high[k], _STEPS) for k in (i, j))
        points = np.tile((low + high) / 2, (_STEPS, _STEPS, 1))
        points[..., i], points[..., j] = u, v[:, None]
        e, std = (values.reshape(_STEPS, _STEPS, -1) for values in result.predict(points.reshape(-1, 3), True))
        found.append(Plane(i, j, u, v, np.linalg.norm(e, axis=2), np.linalg.norm(std, axis=2)))
    _draw_sections(figure, found, x)


@_draw.register
def _(result: Prediction, figure: Figure | SubFigure) -> None:
    axes = _row(figure, 1)[0]
    pose = np.arange(len(result))
    for k, name in enumerate("xyz"):
        shift = pose + 0.2 * (k - 1)
        axes.errorbar(shift, result.e[:, k], 1.96 * result.std[:, k], fmt="o", ms=3, lw=1, color=CURVES[k], label=name)
    axes.axhline(0.0, color=QUIET, lw=0.6)
    axes.set(xlabel="pose", ylabel="predicted error and 95 % interval [mm]")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False, fontsize=8)


@_draw.register
def _(result: Validation, figure: Figure | SubFigure) -> None:
    found = result.residuals
    parity, spread, share = _row(figure, 3)
    for k, name in enumerate("xyz"):
        marks: dict[str, Any] = {"s": 10, "color": CURVES[k], "alpha": 0.7, "label": name}
        parity.scatter(found.predicted[:, k], found.before[:, k], **marks)
        spread.scatter(found.std[:, k], np.abs(found.after[:, k]), **marks)
    ends = np.array([min(found.predicted.min(), found.before.min()), max(found.predicted.max(), found.before.max())])
    parity.plot(ends, ends, color=QUIET, lw=0.8)
    parity.set(xlabel="predicted error [mm]", ylabel="measured error [mm]", title="Parity")
    top = np.array([0.0, float(found.std.max())])
    spread.fill_between(top, 0.0, 1.96 * top, color=BAND, lw=0, label="95 % interval", zorder=0)
    spread.set(xlabel="predicted std [mm]", ylabel="|residual| [mm]", title="Std against residual")
    for e, colour, name in ((found.before, MODEL, "before"), (found.after, POINT, "after")):
        length = np.sort(np.linalg.norm(e, axis=1))
        percent = 100 * np.arange(len(length) + 1) / len(length)
        share.step(np.append(0.0, length), percent, where="post", color=colour, label=name)
    share.set(xlabel="length of error [mm]", ylabel="poses [%]", title="Before and after", ylim=(0, 101))
    share.set_xlim(left=0)
    for axes in (parity, spread, share):
        axes.legend(frameon=False, fontsize=8)


@_draw.register
def _(result: Corrections, figure: Figure | SubFigure) -> None:
    axes = _row(figure, 1)[0]
    length = np.linalg.norm(result.correction, axis=1)
    for k, verdict in enumerate(np.unique(result.verdict)):
        which = np.flatnonzero(result.verdict == verdict)
        axes.scatter(which, length[which], s=16, color=CURVES[k % len(CURVES)], label=str(verdict))
    axes.set(xlabel="target", ylabel="length of correction [mm]")
    axes.set_ylim(0.0, 1.2 * float(length.max(initial=0.0)) or 1.0)  # room for the legend
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(frameon=False, fontsize=8)


@_draw.register
def _(result: Choice, figure: Figure | SubFigure) -> None:
    rows = [row for row in result.ranking if "mean_mm" in row][::-1]
    axes = _row(figure, 1)[0]
    mean = np.array([row["mean_mm"] for row in rows])
    ends = np.array([row["mean_interval_mm"] for row in rows])
    colours = [POINT if row["predictor"] == result.predictor_name else QUIET for row in rows]
    axes.barh([row["predictor"] for row in rows], mean, color=colours, alpha=0.8)
    axes.errorbar(mean, np.arange(len(rows)), xerr=np.abs(ends.T - mean), fmt="none", ecolor="black", lw=1)
    axes.set(xlabel="mean error of unseen samples, 95 % interval [mm]")


def _row(figure: Figure | SubFigure, count: int) -> list[Axes]:
    """Return axes side by side, without the upper and the right spine."""
    if isinstance(figure, ResultFigure):
        figure.set_size_inches(_WIDTH[count], 3.8)
    row: list[Axes] = figure.subplots(1, count, squeeze=False)[0].tolist()
    for axes in row:
        axes.spines[["top", "right"]].set_visible(False)
    return row


def _draw_sections(figure: Figure | SubFigure, found: list[Plane], p: FloatArray) -> None:
    """Draw the error and its standard deviation on planes, and the samples' positions; x runs right, z up."""
    if isinstance(figure, ResultFigure):
        figure.set_size_inches(3.4 * len(found) + 1.0, 6.2)
    grid = figure.subplots(2, len(found), squeeze=False)
    quantities = (("error", "error [mm]", "YlOrBr"), ("std", "standard deviation [mm]", "PuBu"))
    for row, (name, label, colours) in zip(grid, quantities, strict=True):
        highest = max(float(np.nanmax(getattr(plane, name))) for plane in found)
        for axes, plane in zip(row, found, strict=True):
            i, j, u, v, values = plane.i, plane.j, plane.u, plane.v, getattr(plane, name)
            if i > j:
                i, j, u, v, values = j, i, v, u, values.T
            drawn = axes.pcolormesh(u, v, values, vmin=0.0, vmax=highest, cmap=colours)
            axes.plot(*p[:, [i, j]].T, "+", color="#303030", ms=3, mew=0.5)
            k = 3 - i - j
            title = f"at {'xyz'[k]} = {(p[:, k].min() + p[:, k].max()) / 2:.0f} mm" if name == "error" else ""
            axes.set(xlabel=f"{'xyz'[i]} [mm]", ylabel=f"{'xyz'[j]} [mm]", aspect="equal", title=title)
        figure.colorbar(drawn, ax=row.tolist(), label=label)
