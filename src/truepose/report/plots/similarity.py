"""Pictures of semivariograms: points, fitted model, permutation band, practical range."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from truepose._typing import BoolArray, FloatArray
from truepose.report.plots.palette import CURVES, LIGHT, MARKERS
from truepose.similarity.envelope import Envelope
from truepose.similarity.experimental import ExperimentalVariogram
from truepose.similarity.gstools_models import as_variogram
from truepose.similarity.model import VariogramModel
from truepose.similarity.words import Words, english

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


POINT: Final = LIGHT["point"]
WEAK: Final = LIGHT["weak"]
MODEL: Final = LIGHT["model"]
BAND: Final = LIGHT["band"]
THEORY: Final = LIGHT["theory"]
QUIET: Final = LIGHT["soft"]
_LEGEND: Final = 1.35
"""The height of the axes over that of the curves, which leaves room for a legend above them."""


def plot_variogram(
    ev: ExperimentalVariogram,
    model: VariogramModel | None = None,
    envelope: Envelope | None = None,
    *,
    component: int | None = None,
    unit: str = "mm",
    title: str = "",
    theory: ExperimentalVariogram | None = None,
    residual: ExperimentalVariogram | None = None,
    words: Words = english,
) -> Figure:
    """Return a figure of an experimental variogram, optionally with its model and permutation band.

    Parameters
    ----------
    ev : ExperimentalVariogram
        The experimental variogram.
    model : VariogramModel or gstools.CovModel, optional
        The fitted model.
    envelope : Envelope, optional
        The permutation envelope, with the bins of `ev`.
    component : int, optional
        The component of the errors; by default the error vector.
    unit : str
        The unit of the distances.
    title : str
        The title of the figure.
    theory : ExperimentalVariogram, optional
        The variogram of the error vector that kinematics implies, theory (6).
    residual : ExperimentalVariogram, optional
        The variogram of the residuals after a fit of the kinematic parameters.
    words : callable
        The texts in another language; see `truepose.similarity.words`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from truepose.similarity import experimental_variogram
    >>> figure = plot_variogram(experimental_variogram([[0.0], [1.0], [2.0]], [0.0, 1.0, 0.5], bins=2))
    >>> figure.axes[0].get_xlabel()
    'distance h [mm]'
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.0), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    draw_variogram(
        axes, ev, model, envelope, component=component, unit=unit, theory=theory, residual=residual, words=words
    )
    axes.set_title(title)
    return figure


def draw_variogram(
    axes: Axes,
    ev: ExperimentalVariogram,
    model: VariogramModel | None = None,
    envelope: Envelope | None = None,
    *,
    component: int | None = None,
    unit: str = "mm",
    theory: ExperimentalVariogram | None = None,
    residual: ExperimentalVariogram | None = None,
    words: Words = english,
) -> None:
    """Draw the content of `plot_variogram` on given axes."""
    from matplotlib.patches import Rectangle

    gamma = ev.vector if component is None else ev.semivariance[:, component]
    band = None if envelope is None else _draw_band(axes, ev, envelope, component, words)
    if model is not None:
        _draw_model(axes, model, ev.edges[-1], unit, words)
    if theory is not None:
        axes.plot(theory.lag, theory.vector, color=THEORY, lw=1.4, ls=(0, (5, 2)), label=words("theory"))
    if residual is not None:
        style: dict[str, Any] = {"s": 22, "facecolors": "none", "edgecolors": THEORY, "lw": 1.1, "zorder": 3}
        axes.scatter(residual.lag, residual.vector, label=words("residual"), **style)
    end, top = _extent(ev, gamma, [v.vector for v in (theory, residual) if v is not None], band, model)
    for drawn in (*axes.collections, *axes.lines):  # nothing behind the legend, which stands above the curves
        drawn.set_clip_path(Rectangle((0, 0), end, top, transform=axes.transData))
    _draw_points(axes, ev, gamma, end, top, words)
    axes.set(xlabel=words("distance", unit=unit), ylabel=words("semivariance"), xlim=(0, end), ylim=(0, _LEGEND * top))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper left", ncols=2, borderaxespad=0.0)


def _extent(
    ev: ExperimentalVariogram,
    gamma: FloatArray,
    others: list[FloatArray],
    band: FloatArray | None,
    model: VariogramModel | None,
) -> tuple[float, float]:
    """Return the ends of the axes: bins of few pairs at the end do not stretch them, unless there are no others."""
    strong = (ev.pairs > 0) & ~ev.weak
    counted = strong if strong.any() else ev.pairs > 0
    if not counted.any():
        return float(ev.edges[-1]), 1.0
    end = float(ev.edges[1:][counted][-1])
    drawn = [gamma[counted], *(other[counted] for other in others), *([] if band is None else [band[counted]])]
    values = np.concatenate([*drawn, *([] if model is None else _curve(as_variogram(model), np.array([end])))])
    return end, 1.05 * float(np.nanmax(values)) or 1.0


def _curve(model: VariogramModel, h: FloatArray) -> list[FloatArray]:
    """Return the semivariances of a model at distances h, along each of its axes."""
    if model.isotropic:
        return [np.asarray(model.semivariance(h))]
    d = len(model.practical_ranges)
    return [np.asarray(model.semivariance(h, np.eye(d)[k])) for k in range(d)]


def draw_curves(axes: Axes, curves: Mapping[str, tuple[FloatArray, FloatArray]], unit: str) -> None:
    """Draw several semivariograms as lines: by name, lags and semivariances."""
    for colour, marker, (name, (lag, gamma)) in zip(CURVES, MARKERS, curves.items(), strict=False):
        known = np.isfinite(gamma)
        axes.plot(lag[known], gamma[known], color=colour, lw=1.5, marker=marker, ms=3.5, label=name)
    axes.set(xlabel=english("distance", unit=unit), ylabel=english("semivariance"))
    axes.set_xlim(left=0)
    axes.set_ylim(0, _LEGEND * axes.get_ylim()[1])
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="upper left", ncols=3, borderaxespad=0.0)


def _draw_band(
    axes: Axes, ev: ExperimentalVariogram, envelope: Envelope, component: int | None, words: Words
) -> FloatArray:
    """Draw the permutation band and return its upper limit."""
    if component is None:
        lower, upper = envelope.vector_lower, envelope.vector_upper
    else:
        lower, upper = envelope.lower[:, component], envelope.upper[:, component]
    axes.fill_between(ev.lag, lower, upper, color=BAND, lw=0, label=words("band", percent=100 * envelope.level))
    return np.asarray(upper)


def _draw_points(
    axes: Axes, ev: ExperimentalVariogram, gamma: FloatArray, end: float, top: float, words: Words
) -> None:
    """Draw the bins; those of few pairs outside the axes stand as diamonds at their edge."""
    filled = ev.pairs > 0
    outside = filled & ((ev.lag > end) | (gamma > top))
    area = 12 + 70 * ev.pairs / max(ev.pairs.max(), 1)

    def draw(mask: BoolArray, label: str, **look: Any) -> None:
        if mask.any():
            x, y = np.minimum(ev.lag[mask], end), np.minimum(gamma[mask], top)
            axes.scatter(x, y, s=area[mask], zorder=3, label=words(label), **look)

    draw(filled & ~outside & ~ev.weak, "points", color=POINT, lw=0)
    draw(filled & ~outside & ev.weak, "few", color=WEAK, lw=0)
    draw(outside, "outside", facecolors="none", edgecolors=WEAK, lw=1.2, marker="D", clip_on=False)


def _draw_model(axes: Axes, given: VariogramModel, longest: float, unit: str, words: Words) -> None:
    model = as_variogram(given)
    h = np.linspace(0, longest, 400)[1:]
    curves = _curve(model, h)
    for k, (gamma, style) in enumerate(zip(curves, ("-", "--", ":", "-.") * len(curves), strict=False), 1):
        name = model.family if model.isotropic else words("axis", family=model.family, number=k)
        axes.plot(h, gamma, color=MODEL, lw=1.6, ls=style, zorder=4, label=name)
    if model.practical_range <= longest and model.partial_sill > 0:
        axes.axvline(model.practical_range, color=QUIET, lw=0.9, ls=(0, (4, 3)), zorder=1)
        look: dict[str, Any] = {"color": QUIET, "fontsize": 8, "rotation": 90, "va": "bottom"}
        text = words("practical_range", range=model.practical_range, unit=unit)
        anchor: dict[str, Any] = {
            "xycoords": ("data", "axes fraction"),
            "xytext": (4, 0),
            "textcoords": "offset points",
        }
        axes.annotate(text, (model.practical_range, 0.03), **anchor, **look)
