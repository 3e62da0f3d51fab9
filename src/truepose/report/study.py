"""Similarity of the errors of a map's samples, in Cartesian and in joint space (theory)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map import ErrorMap
from truepose.errors import DataError
from truepose.report.explained import Explained, explained_by_kinematics, kinematic_columns
from truepose.report.joint_similarity import JointSimilarity
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
)
from truepose.similarity.model import without_warning


@dataclass(frozen=True)
class StudyPart:
    """Similarity of the errors in one space, with d coordinates.

    Attributes
    ----------
    space : {"cartesian", "joint"}
        The space of the distances.
    unit : {"mm", "rad"}
        The unit of the coordinates.
    model : VariogramModel
        The model fitted to the variogram of the error vector.
    envelope : Envelope
        The permutation envelope, with the experimental variogram.
    axes : tuple of str
        The names of the coordinates.
    likelihood : VariogramModel
        The model fitted to the samples by restricted likelihood, with one range.
    directional : VariogramModel, optional
        The same with one range per coordinate; None if a coordinate is constant.
    trend : Trend
        The linear drift over the coordinates.
    directions : dict of str to ExperimentalVariogram
        The variogram along each coordinate axis, within 30°; empty in joint space.
    explained : Explained, optional
        The part of the errors that kinematic parameters explain; None for samples without joints.
    extent : (d,) array
        The extent of the samples along each coordinate, in `unit`.
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
    def sampled(self) -> Sampled:
        """The variance and the noise of the error vector by the fitted model, over the sampled distances."""
        return sampled(self.model, self.envelope.variogram, self.nugget)

    @property
    def components(self) -> int:
        """The number of components of the errors."""
        return int(self.envelope.variogram.semivariance.shape[1])

    @property
    def nugget(self) -> float | None:
        """The noise of the error vector [mm²] by likelihood; None for a model set by hand."""
        return None if self.model.overridden else self.components * self.likelihood.nugget

    def rows(self) -> Iterator[tuple[float, int, list[float], float]]:
        """Yield lag, pairs, semivariance of each component and of the vector."""
        ev = self.envelope.variogram
        yield from zip(ev.lag.tolist(), ev.pairs.tolist(), ev.semivariance.tolist(), ev.vector.tolist(), strict=True)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        ev, model = self.envelope.variogram, self.model
        return {
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
        }


@dataclass(frozen=True)
class SimilarityStudy:
    """Similarity of the errors in every space of the samples; made by `similarity_study`.

    Attributes
    ----------
    parts : list of StudyPart
        One study per space.
    joints : list of JointSimilarity
        The similarity of each joint's own error; empty unless requested.
    """

    parts: list[StudyPart]
    joints: list[JointSimilarity] = field(default_factory=list)


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
    weights: str = "cressie",
    fixed: Mapping[str, float] | None = None,
    rng: int = 0,
) -> SimilarityStudy:
    """Compute the variogram, its fitted model and the permutation envelope of the errors of a map's samples.

    Parameters
    ----------
    error_map : ErrorMap
        The map whose samples and errors are studied.
    family : str
        The variogram family, or ``best``; "spherical+exponential" gives a nested model.
    bins : int or sequence of float
        The number of bins, or their edges.
    equal_counts : bool
        Whether each bin holds the same number of pairs instead of having the same width.
    max_lag : float, optional
        The largest distance; by default half of the largest distance between two samples.
    estimator : str
        The estimator, as for `experimental_variogram`.
    direction : Direction, optional
        The direction of the pairs that are counted; by default all pairs.
    space : {"both", "cartesian", "joint"}
        The space to study.
    by_hand : mapping of str to float, optional
        The values of nugget, sill and range that replace the fitted ones, which stay in ``model.fit.fitted``.
    weights, fixed
        The weights and the held parameters of the fit, as for `truepose.fit_variogram`.
    rng : int
        The seed of the permutations.

    Returns
    -------
    SimilarityStudy

    Raises
    ------
    DataError
        If the space is unknown or missing in the samples, or a setting that belongs to one space is used with "both".
    KrigingError
        If the samples do not support a variogram.
    """
    q = error_map.samples.q
    spaces = {"cartesian": ("mm", tuple("xyz"), error_map.p_cmd)}
    if q is not None:
        spaces["joint"] = ("rad", tuple(f"q{k + 1}" for k in range(q.shape[1])), q)
    if space not in ("both", *spaces):
        raise DataError(f"expected a space of these samples ({', '.join(spaces)}) or both, got {space!r}")
    if space == "both" and len(spaces) > 1 and (by_hand or fixed or direction or max_lag or not isinstance(bins, int)):
        settings = "bin edges, largest distance, direction and values set by hand"
        raise DataError(f"{settings} apply to one space only; choose it with space")
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
        with without_warning():  # the findings say so in words
            model = _fitted(envelope, family, weights, fixed, by_hand)
            parts.append(_part(name, unit, axes, x, error_map.e, effect, envelope, model))
    return SimilarityStudy(parts)


def refit(
    part: StudyPart,
    *,
    family: str = "best",
    weights: str = "cressie",
    fixed: Mapping[str, float] | None = None,
    by_hand: Mapping[str, Any] | None = None,
) -> StudyPart:
    """Return a part with another model of the same variogram; the settings are those of `similarity_study`."""
    with without_warning():
        return replace(part, model=_fitted(part.envelope, family, weights, fixed, by_hand))


def _fitted(
    envelope: Envelope,
    family: str,
    weights: str,
    fixed: Mapping[str, float] | None,
    by_hand: Mapping[str, Any] | None,
) -> VariogramModel:
    return replace(fit_variogram(envelope.variogram, family, weights=weights, fixed=fixed), **(by_hand or {}))


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
