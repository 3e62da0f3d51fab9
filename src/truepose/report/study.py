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
from truepose.similarity import Envelope, VariogramModel, fit_variogram, permutation_envelope, verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class StudyPart:
    """Similarity in one space.

    Attributes
    ----------
    title, unit, verdict : str
    model : VariogramModel
        Fitted to the vector's variogram.
    envelope : Envelope
        With the variogram that it is the envelope of.
    """

    title: str
    unit: str
    model: VariogramModel
    envelope: Envelope
    verdict: str

    def rows(self) -> Iterator[tuple[float, int, list[float], float]]:
        """Yield lag, pairs, semivariance of each component and of the vector."""
        ev = self.envelope.variogram
        yield from zip(ev.lag.tolist(), ev.pairs.tolist(), ev.semivariance.tolist(), ev.vector.tolist(), strict=True)

    def figure(self) -> Figure:
        """Return the picture: points, fit, envelope."""
        from truepose.similarity.plot import plot_variogram

        return plot_variogram(self.envelope.variogram, self.model, self.envelope, unit=self.unit)

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

        from truepose.similarity.plot import draw_variogram

        figure = Figure(figsize=(6.4 * len(self.parts), 4.2), layout="constrained")
        for k, part in enumerate(self.parts, 1):
            axes = figure.add_subplot(1, len(self.parts), k)
            draw_variogram(axes, part.envelope.variogram, part.model, part.envelope, unit=part.unit)
            axes.set_title(part.title)
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
    spaces = [("Errors against the distance of positions", "mm", error_map.p_cmd)]
    if error_map.samples.q is not None:
        spaces.append(("Errors against the distance of joint vectors", "rad", error_map.samples.q))
    return SimilarityStudy([_part(title, unit, x, error_map.e, family, bins, rng) for title, unit, x in spaces])


def _part(title: str, unit: str, x: FloatArray, e: FloatArray, family: str, bins: int, rng: int) -> StudyPart:
    envelope = permutation_envelope(x, e, bins, rng=rng)
    model = fit_variogram(envelope.variogram, family)
    return StudyPart(title, unit, model, envelope, verdict(model, envelope, unit))
