"""Pictures of semivariograms: points, fitted model, permutation band, practical range."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from truepose._typing import FloatArray
from truepose.similarity.envelope import Envelope
from truepose.similarity.experimental import ExperimentalVariogram
from truepose.similarity.gstools_models import as_variogram
from truepose.similarity.model import VariogramModel
from truepose.similarity.words import Words, english

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


POINT: Final = "#1f4e79"
WEAK: Final = "#9db4c9"
MODEL: Final = "#c8442b"
BAND: Final = "#dcdcdc"
THEORY: Final = "#5a8f3d"
CURVES: Final = ("#1f4e79", "#c8442b", "#5a8f3d", "#8a5aa8", "#c28a1e", "#4aa3a3")
QUIET: Final = "#6b6b6b"


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
    gamma = ev.vector if component is None else ev.semivariance[:, component]
    if envelope is not None:
        _draw_band(axes, ev, envelope, component, words)
    _draw_points(axes, ev, gamma, words)
    if model is not None:
        _draw_model(axes, model, ev.edges[-1], unit, words)
    if theory is not None:
        axes.plot(theory.lag, theory.vector, color=THEORY, lw=1.4, ls=(0, (5, 2)), label=words("theory"))
    if residual is not None:
        style: dict[str, Any] = {"s": 22, "facecolors": "none", "edgecolors": THEORY, "lw": 1.1, "zorder": 3}
        axes.scatter(residual.lag, residual.vector, label=words("residual"), **style)
    axes.set(xlabel=words("distance", unit=unit), ylabel=words("semivariance"), xlim=(0, ev.edges[-1]))
    axes.set_ylim(bottom=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="best")


def draw_curves(axes: Axes, curves: Mapping[str, tuple[FloatArray, FloatArray]], unit: str) -> None:
    """Draw several semivariograms as lines: by name, lags and semivariances."""
    for colour, (name, (lag, gamma)) in zip(CURVES, curves.items(), strict=False):
        known = np.isfinite(gamma)
        axes.plot(lag[known], gamma[known], color=colour, lw=1.5, marker="o", ms=3.5, label=name)
    axes.set(xlabel=english("distance", unit=unit), ylabel=english("semivariance"))
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8, loc="best")


def _draw_band(axes: Axes, ev: ExperimentalVariogram, envelope: Envelope, component: int | None, words: Words) -> None:
    if component is None:
        lower, upper = envelope.vector_lower, envelope.vector_upper
    else:
        lower, upper = envelope.lower[:, component], envelope.upper[:, component]
    axes.fill_between(ev.lag, lower, upper, color=BAND, lw=0, label=words("band", percent=100 * envelope.level))


def _draw_points(axes: Axes, ev: ExperimentalVariogram, gamma: FloatArray, words: Words) -> None:
    filled = ev.pairs > 0
    area = 12 + 70 * ev.pairs / max(ev.pairs.max(), 1)
    for mask, colour, label in (
        (filled & ~ev.weak, POINT, words("points")),
        (filled & ev.weak, WEAK, words("few")),
    ):
        if mask.any():
            axes.scatter(ev.lag[mask], gamma[mask], s=area[mask], color=colour, lw=0, zorder=3, label=label)


def _draw_model(axes: Axes, given: VariogramModel, longest: float, unit: str, words: Words) -> None:
    model = as_variogram(given)
    h = np.linspace(0, longest, 400)[1:]
    if model.isotropic:
        axes.plot(h, model.semivariance(h), color=MODEL, lw=1.8, zorder=4, label=model.family)
    else:
        d = len(model.practical_ranges)
        for k, style in zip(range(d), ("-", "--", ":", "-.") * d, strict=False):
            gamma = model.semivariance(h, np.eye(d)[k])
            axes.plot(
                h,
                gamma,
                color=MODEL,
                lw=1.4,
                ls=style,
                zorder=4,
                label=words("axis", family=model.family, number=k + 1),
            )
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
