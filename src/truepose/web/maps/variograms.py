"""Variograms of the errors of a map's samples: experimental points, model, and the model with held parameters."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, Field

from truepose._io.plain import plain
from truepose._io.strict import LARGEST
from truepose.error_map import ErrorMap
from truepose.report.findings import part_to_dict
from truepose.report.locale import load_locale
from truepose.report.study import StudyPart, refit, similarity_study
from truepose.web.cache import ResultCache

Space = Literal["cartesian", "joint"]
Language = Literal["en", "de", "zh"]
Positive = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
_CURVE = 121  # points of a model's curve


class VariogramPoint(BaseModel):
    """A distance class."""

    lag: float
    pairs: int
    semivariance_mm2: float = Field(description="semivariance of the error vector")
    low_mm2: float | None = Field(description="lower bound of the band of chance (permutations)")
    high_mm2: float | None


class VariogramCurve(BaseModel):
    """A variogram model of the error vector."""

    family: str
    nugget_mm2: float
    sill_mm2: float = Field(description="partial sill")
    range: float = Field(description="range parameter, in the unit of the lags")
    practical_range: float | None
    by_hand: bool = Field(description="whether parameters were set or held")
    lag: list[float]
    semivariance_mm2: list[float]


class Variogram(BaseModel):
    """The variogram of one space, with its findings."""

    of: Literal["samples after registration"] = "samples after registration"
    space: Space
    unit: Literal["mm", "rad"]
    points: list[VariogramPoint]
    model: VariogramCurve
    verdict: str
    findings: dict[str, str]
    figures: dict[str, Any] = Field(description="the figures that 'truepose similarity --json' prints")
    command: str = Field(description="the command line that computes the same from the samples of the map")


class Refit(BaseModel):
    """Parameters of the model that are held, while the others are fitted; or set, with `hold` false."""

    space: Space = "cartesian"
    family: str = Field("best", max_length=100)
    weights: Literal["cressie", "pairs", "pairs/h2", "equal"] = "cressie"
    nugget: NotNegative | None = Field(None, description="mm²")
    sill: NotNegative | None = Field(None, description="partial sill, mm²")
    range: Positive | None = Field(None, description="mm or rad")
    hold: bool = True

    @property
    def given(self) -> dict[str, float]:
        """The parameters that are given."""
        stated = {"nugget": self.nugget, "sill": self.sill, "range": self.range}
        return {name: value for name, value in stated.items() if value is not None}


def variogram(cache: ResultCache, error_map: ErrorMap, wanted: Refit, language: Language) -> Variogram:
    """Return the variogram of a map's samples, with the model that is wanted."""
    part = _study(cache, error_map, wanted.space)
    if wanted.given or wanted.family != "best" or wanted.weights != "cressie":
        held: dict[str, Any] = {"fixed": wanted.given or None} if wanted.hold else {"by_hand": wanted.given}
        part = refit(part, family=wanted.family, weights=wanted.weights, **held)
    figures = plain(part_to_dict(part, load_locale(language)))
    return Variogram.model_validate(
        {
            "space": part.space,
            "unit": part.unit,
            "points": _points(part),
            "model": _curve(part, held=bool(wanted.given)),
            "verdict": figures.pop("verdict"),
            "findings": figures.pop("findings"),
            "figures": figures,
            "command": _command(wanted),
        }
    )


def _study(cache: ResultCache, error_map: ErrorMap, space: Space) -> StudyPart:
    """Return the study of one space; its envelope and likelihood take seconds, so that it is kept."""
    part: StudyPart = cache.object(
        ("study", error_map.hash, space), lambda: similarity_study(error_map, space=space).parts[0]
    )
    return part


def _points(part: StudyPart) -> list[dict[str, Any]]:
    found, envelope = part.envelope.variogram, part.envelope
    columns = (found.lag, found.pairs, found.vector, envelope.vector_lower, envelope.vector_upper)
    names = ("lag", "pairs", "semivariance_mm2", "low_mm2", "high_mm2")
    rows = zip(*(plain(column) for column in columns), strict=True)
    return [dict(zip(names, row, strict=True)) for row in rows if row[1]]


def _curve(part: StudyPart, *, held: bool) -> dict[str, Any]:
    model = part.model
    lag = np.linspace(0.0, float(part.envelope.variogram.edges[-1]), _CURVE)
    semivariance = model.semivariance(lag)
    semivariance[0] = model.nugget  # the limit towards zero distance
    return {
        "family": "+".join(one.family for one in model.structures),
        "nugget_mm2": model.nugget,
        "sill_mm2": model.sill,
        "range": float(np.max(model.range)),
        "practical_range": plain(float(model.practical_range)),
        "by_hand": held,
        "lag": lag.tolist(),
        "semivariance_mm2": semivariance.tolist(),
    }


def _command(wanted: Refit) -> str:
    words = ["truepose similarity cell.toml SAMPLES.csv", f"--space {wanted.space}"]
    words += [f"--family {wanted.family}"] * (wanted.family != "best")
    words += [f"--weights {wanted.weights}"] * (wanted.weights != "cressie")
    words += [f"--{name} {value:.6g}" for name, value in wanted.given.items()]
    return " ".join([*words, *["--hold"] * (wanted.hold and bool(wanted.given))])
