"""Similarity of a cell's errors in Cartesian and in joint space, as table, sentence and picture (method.md §2)."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from truepose import files
from truepose.error_map import ErrorMap
from truepose.errors import FileError
from truepose.report.findings import Explained, explained_by_kinematics, findings, kinematic_columns
from truepose.report.locale import Locale, load_locale
from truepose.similarity import (
    Direction,
    Envelope,
    ExperimentalVariogram,
    Trend,
    VariogramModel,
    experimental_variogram,
    fit_likelihood,
    fit_variogram,
    permutation_envelope,
    remove_drift,
    verdict,
)
from truepose.similarity.words import Words, english

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]


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
        return self.told_title(load_locale("en"))

    @property
    def findings(self) -> list[tuple[str, str]]:
        """Questions that a reader has, and their answers in English; `told` has them in other languages."""
        return self.told(load_locale("en"))

    def told_title(self, say: Locale) -> str:
        """Return what the picture shows."""
        return say(f"space.{self.space}")

    def told(self, say: Locale) -> list[tuple[str, str]]:
        """Return questions that a reader has, and their answers."""
        return findings(self, say)

    @property
    def verdict(self) -> str:
        """Whether there is similarity, how far it reaches, how much is noise; in English."""
        return verdict(self.model, self.envelope, self.unit)

    def rows(self) -> Iterator[tuple[float, int, list[float], float]]:
        """Yield lag, pairs, semivariance of each component and of the vector."""
        ev = self.envelope.variogram
        yield from zip(ev.lag.tolist(), ev.pairs.tolist(), ev.semivariance.tolist(), ev.vector.tolist(), strict=True)

    def figure(self, words: Words = english) -> Figure:
        """Return the picture: points, fit, envelope."""
        from truepose.similarity.plot import plot_variogram

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
    """Similarity in each space that the samples have; see `similarity_study`."""

    parts: list[StudyPart]

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        return {"variograms": [part.to_dict() for part in self.parts]}

    def save_plot(self, path: Path) -> None:
        """Write the pictures beside each other; the format is that of the path's ending.

        Raises
        ------
        FileError
            If the ending names no format, or the file cannot be written.
        """
        from matplotlib.figure import Figure

        from truepose.similarity.plot import draw_curves, draw_variogram

        columns = len(self.parts)
        figure = Figure(figsize=(6.4 * columns, 8.4), layout="constrained")
        for k, part in enumerate(self.parts, 1):
            axes = figure.add_subplot(2, columns, k)
            ev = part.envelope.variogram
            draw_variogram(axes, ev, part.model, part.envelope, unit=part.unit, **part.curves)
            axes.set_title(part.title)
            below = figure.add_subplot(2, columns, columns + k)
            if part.directions:
                draw_curves(
                    below, {f"along {axis}": (v.lag, v.vector) for axis, v in part.directions.items()}, part.unit
                )
                below.set_title("By direction of the distance: lower and flatter is more alike")
            else:
                by_component = zip("xyz", ev.semivariance.T, strict=True)
                draw_curves(below, {f"error in {axis}": (ev.lag, gamma) for axis, gamma in by_component}, part.unit)
                below.set_title("By component of the error")
        buffer = io.BytesIO()
        try:
            figure.savefig(buffer, format=path.suffix.removeprefix(".") or "svg", dpi=150)
        except ValueError as error:
            raise FileError(path, f"{error}; use .svg, .png or .pdf") from None
        files.write_atomic(path, buffer.getvalue())


def similarity_study(error_map: ErrorMap, *, family: str = "best", bins: int = 15, rng: int = 0) -> SimilarityStudy:
    """Compute variogram, fit and permutation envelope of the errors of a map's samples.

    Parameters
    ----------
    error_map : ErrorMap
    family : str
        Variogram family, or ``best``.
    bins : int
    rng : int
        Of the permutations.

    Raises
    ------
    KrigingError
        If the samples cannot bear a variogram.
    """
    positions, q = error_map.p_cmd, error_map.samples.q
    effect = kinematic_columns(error_map)
    parts = [_part("cartesian", "mm", tuple("xyz"), positions, error_map.e, effect, family, bins, rng)]
    if q is not None:
        joints = tuple(f"q{k + 1}" for k in range(q.shape[1]))
        parts.append(_part("joint", "rad", joints, q, error_map.e, effect, family, bins, rng))
    return SimilarityStudy(parts)


def _part(
    space: str,
    unit: str,
    axes: tuple[str, ...],
    x: FloatArray,
    e: FloatArray,
    effect: FloatArray | None,
    family: str,
    bins: int,
    rng: int,
) -> StudyPart:
    envelope = permutation_envelope(x, e, bins, rng=rng)
    model = fit_variogram(envelope.variogram, family)
    edges = envelope.variogram.edges
    moving = np.ptp(x, axis=0) > 0
    directions = {}
    if len(axes) == 3:
        wide = edges[:: max(1, bins // 8)]
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
        likelihood=fit_likelihood(x, e),
        directional=fit_likelihood(x, e, "matern32", ranges="each") if moving.all() else None,
        trend=remove_drift(x, e),
        directions=directions,
        explained=None if effect is None else explained_by_kinematics(x, e, effect, edges, envelope.variogram),
        extent=np.ptp(x, axis=0),
    )
