"""Similarity of a cell's errors in Cartesian and in joint space, as table, sentence and picture (theory)."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truepose._io import files
from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.errors import DataError, FileError
from truepose.report.findings import Explained, explained_by_kinematics, findings, kinematic_columns
from truepose.report.joint_similarity import JointSimilarity, draw_joint_similarity
from truepose.report.locale import Locale, load_locale
from truepose.similarity import (
    Direction,
    Envelope,
    ExperimentalVariogram,
    Sampled,
    Trend,
    VariogramModel,
    equal_count_bins,
    experimental_variogram,
    fit_likelihood,
    fit_variogram,
    permutation_envelope,
    remove_drift,
    sampled,
    verdict,
)
from truepose.similarity.remarks import without_warning
from truepose.similarity.words import Words, english

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class StudyPart:
    """Similarity in one space.

    Attributes
    ----------
    space, unit : str
        ``cartesian`` or ``joint``; of the coordinates.
    model : VariogramModel
        Fitted to the vector's variogram.
    envelope : Envelope
        With the variogram that it is the envelope of.
    axes : tuple of str
        Names of the coordinates.
    likelihood, directional : VariogramModel
        Fitted to the samples by restricted likelihood, with one range, and with one for each coordinate.
    trend : Trend
        A linear drift over the coordinates.
    directions : dict of str to ExperimentalVariogram
        Along each coordinate axis, within 30°; of positions alone.
    explained : Explained, optional
        What errors of the kinematic parameters explain, where the samples have joints.
    extent : (d,) array
        Of the coordinates.
    """

    space: str
    unit: str
    model: VariogramModel
    envelope: Envelope
    axes: tuple[str, ...]
    likelihood: VariogramModel
    directional: VariogramModel | None
    trend: Trend
    directions: dict[str, ExperimentalVariogram]
    explained: Explained | None
    extent: FloatArray

    @property
    def title(self) -> str:
        """What the picture shows, in English."""
        return self.title_in(load_locale("en"))

    @property
    def findings(self) -> list[tuple[str, str]]:
        """Questions that a reader has, and their answers in English; `told` has them in other languages."""
        return self.describe(load_locale("en"))

    def title_in(self, say: Locale) -> str:
        """Return what the picture shows."""
        return say(f"space.{self.space}")

    def describe(self, say: Locale) -> list[tuple[str, str]]:
        """Return questions that a reader has, and their answers."""
        return findings(self, say)

    @property
    def verdict(self) -> str:
        """Whether there is similarity, how far it reaches, how much is noise; in English."""
        return self.verdict_in(english)

    def verdict_in(self, words: Words) -> str:
        """Return whether there is similarity, how far it reaches, how much is noise."""
        return verdict(self.model, self.envelope, self.unit, nugget=self._nugget, words=words)

    @property
    def sampled(self) -> Sampled:
        """Variance of the vector over the distances that were sampled, as the curve has it, and its noise."""
        return sampled(self.model, self.envelope.variogram, self._nugget)

    @property
    def components(self) -> int:
        """Number of components of the errors."""
        return int(self.envelope.variogram.semivariance.shape[1])

    @property
    def _nugget(self) -> float | None:
        """Noise of the vector [mm²] by likelihood, which tells a small one; None where the curve was set by hand."""
        return None if self.model.overridden else self.components * self.likelihood.nugget

    def rows(self) -> Iterator[tuple[float, int, list[float], float]]:
        """Yield lag, pairs, semivariance of each component and of the vector."""
        ev = self.envelope.variogram
        yield from zip(ev.lag.tolist(), ev.pairs.tolist(), ev.semivariance.tolist(), ev.vector.tolist(), strict=True)

    def figure(self, words: Words = english) -> Figure:
        """Return the picture: points, fit, envelope."""
        from truepose.report.plots.similarity import plot_variogram

        ev, unit = self.envelope.variogram, self.unit
        return plot_variogram(ev, self.model, self.envelope, unit=unit, words=words, **self.curves)

    @property
    def curves(self) -> dict[str, Any]:
        """What kinematics implies and what it leaves, for the picture."""
        if self.explained is None:
            return {}
        return {"theory": self.explained.theory, "residual": self.explained.residual}

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        ev, model = self.envelope.variogram, self.model
        return {
            "title": self.title,
            "lag_unit": self.unit,
            "lag": ev.lag,
            "pairs": ev.pairs,
            "semivariance_mm2": ev.semivariance,
            "vector_semivariance_mm2": ev.vector,
            "vector_envelope_mm2": {"lower": self.envelope.vector_lower, "upper": self.envelope.vector_upper},
            "model": {
                "family": model.family,
                "nugget_mm2": model.nugget,
                "sill_mm2": model.sill,
                "range": model.range,
                "practical_range": model.practical_range,
                "structural_ratio": model.structural_ratio,
                "standard_error": getattr(model.fit, "standard_error", {}),
                "fitted": getattr(model.fit, "fitted", {}),
                "by_hand": model.overridden,
                "remarks": () if model.fit is None or model.overridden else model.fit.remarks,
                **({"plus": [part.to_dict() for part in model.plus]} if model.plus else {}),
            },
            "likelihood": {
                **self.likelihood.to_dict(),
                "practical_range": self.likelihood.practical_range,
                "structural_ratio": self.likelihood.structural_ratio,
                "standard_error": getattr(self.likelihood.fit, "standard_error", {}),
            },
            "practical_ranges": {}
            if self.directional is None
            else dict(zip(self.axes, self.directional.practical_ranges, strict=True)),
            "sampled": self.sampled.to_dict(),
            "linear_trend_explains": self.trend.adjusted,
            "directions": {
                axis: {"lag": found.lag, "vector_semivariance_mm2": found.vector, "pairs": found.pairs}
                for axis, found in self.directions.items()
            },
            "kinematics": None
            if self.explained is None
            else {
                "explains": self.explained.share,
                "parameters": self.explained.rank,
                "theory_mm2": self.explained.theory.vector,
                "residual_mm2": self.explained.residual.vector,
            },
            "findings": dict(self.findings),
            "verdict": self.verdict,
        }


@dataclass(frozen=True)
class SimilarityStudy:
    """Similarity in each space that the samples have, see `similarity_study`; and of each joint where asked for."""

    parts: list[StudyPart]
    joints: list[JointSimilarity] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        own = {"joints": [joint.to_dict() for joint in self.joints]} if self.joints else {}
        return {"variograms": [part.to_dict() for part in self.parts], **own}

    def save_plot(self, path: Path) -> None:
        """Write the pictures beside each other; the format is that of the path's ending.

        Raises
        ------
        FileError
            If the ending names no format, or the file cannot be written.
        """
        from matplotlib.figure import Figure

        from truepose.report.plots.similarity import draw_curves, draw_variogram

        ending = plot_format(path)

        columns = len(self.parts) + bool(self.joints)
        figure = Figure(figsize=(6.4 * columns, 8.4), layout="constrained")
        grid = figure.add_gridspec(2, columns)
        for k, part in enumerate(self.parts):
            axes = figure.add_subplot(grid[0, k])
            ev = part.envelope.variogram
            draw_variogram(axes, ev, part.model, part.envelope, unit=part.unit, **part.curves)
            axes.set_title(part.title)
            below = figure.add_subplot(grid[1, k])
            if part.directions:
                draw_curves(
                    below, {f"along {axis}": (v.lag, v.vector) for axis, v in part.directions.items()}, part.unit
                )
                below.set_title("By direction of the distance: lower and flatter is more alike")
            else:
                by_component = zip("xyz", ev.semivariance.T, strict=True)
                draw_curves(below, {f"error in {axis}": (ev.lag, gamma) for axis, gamma in by_component}, part.unit)
                below.set_title("By component of the error")
        if self.joints:
            draw_joint_similarity(figure.add_subplot(grid[:, -1]), self.joints)
        buffer = io.BytesIO()
        figure.savefig(buffer, format=ending, dpi=150)
        files.write_atomic(path, buffer.getvalue())


def plot_format(path: Path) -> str:
    """Return the format of a picture by the ending of its file; svg without one.

    Raises
    ------
    FileError
        If the ending names no format.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    ending = path.suffix.removeprefix(".") or "svg"
    if ending.lower() not in FigureCanvasBase.get_supported_filetypes():
        raise FileError(path, f"its ending {path.suffix} names no format of pictures; use .svg, .png or .pdf")
    return ending


def similarity_study(
    error_map: ErrorMap,
    *,
    family: str = "best",
    bins: int | Sequence[float] = 15,
    equal_counts: bool = False,
    max_lag: float | None = None,
    estimator: str = "matheron",
    direction: Direction | None = None,
    space: str = "both",
    by_hand: Mapping[str, Any] | None = None,
    rng: int = 0,
) -> SimilarityStudy:
    """Compute variogram, fit and permutation envelope of the errors of a map's samples.

    Parameters
    ----------
    error_map : ErrorMap
    family : str
        Variogram family, or ``best``; "spherical+exponential" has two structures.
    bins : int or sequence of float
        Number of bins, or their edges.
    equal_counts : bool
        Let each bin hold equally many pairs, and not be equally wide.
    max_lag : float, optional
        Largest distance; half the largest between two samples when not given.
    estimator : str
        As for `experimental_variogram`.
    direction : Direction, optional
        Count only pairs along it.
    space : {"both", "cartesian", "joint"}
    by_hand : mapping of str to float, optional
        Values of nugget, sill and range that replace the fitted ones, which stay in ``model.fit.fitted``.
    rng : int
        Of the permutations.

    Raises
    ------
    DataError
        If the space is not known or has no samples, or what belongs to one space is asked of both.
    KrigingError
        If the samples cannot bear a variogram.
    """
    q = error_map.samples.q
    spaces = {"cartesian": ("mm", tuple("xyz"), error_map.p_cmd)}
    if q is not None:
        spaces["joint"] = ("rad", tuple(f"q{k + 1}" for k in range(q.shape[1])), q)
    if space not in ("both", *spaces):
        raise DataError(f"space is {space!r}; these samples have {', '.join(spaces)}")
    if space == "both" and len(spaces) > 1 and (by_hand or direction or max_lag or not isinstance(bins, int)):
        raise DataError("edges, largest distance, direction and values by hand belong to one space; say which (space)")
    effect = kinematic_columns(error_map)
    parts = []
    for name, (unit, axes, x) in spaces.items():
        if space not in ("both", name):
            continue
        edges = equal_count_bins(x, bins, max_lag, rng=rng) if equal_counts and isinstance(bins, int) else bins
        longest = max_lag if isinstance(edges, int) else None
        envelope = permutation_envelope(
            x, error_map.e, edges, longest, estimator=estimator, direction=direction, rng=rng
        )
        with without_warning():  # the report says it in words
            model = replace(fit_variogram(envelope.variogram, family), **(by_hand or {}))
            parts.append(_part(name, unit, axes, x, error_map.e, effect, envelope, model))
    return SimilarityStudy(parts)


def _part(
    space: str,
    unit: str,
    axes: tuple[str, ...],
    x: FloatArray,
    e: FloatArray,
    effect: FloatArray | None,
    envelope: Envelope,
    model: VariogramModel,
) -> StudyPart:
    edges = envelope.variogram.edges
    likelihood = fit_likelihood(x, e)
    moving = np.ptp(x, axis=0) > 0
    directions = {}
    if len(axes) == 3:
        wide = edges[:: max(1, (len(edges) - 1) // 8)]
        directions = {
            axis: experimental_variogram(x, e, wide, direction=Direction(np.eye(3)[k], np.pi / 6))
            for k, axis in enumerate(axes)
            if moving[k]
        }
    return StudyPart(
        space=space,
        unit=unit,
        model=model,
        envelope=envelope,
        axes=axes,
        likelihood=likelihood,
        directional=fit_likelihood(x, e, likelihood.family, ranges="each") if moving.all() else None,
        trend=remove_drift(x, e),
        directions=directions,
        explained=None if effect is None else explained_by_kinematics(x, e, effect, edges, envelope.variogram),
        extent=np.ptp(x, axis=0),
    )
