"""The page itself: figures and tables of one map, put into a template; no request leaves it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from truepose import files
from truepose._version import __version__
from truepose.error_map import ErrorMap
from truepose.errors import FileError
from truepose.report import figures
from truepose.report.study import SimilarityStudy, similarity_study
from truepose.samples import Samples
from truepose.verification import accuracy


def write_report(
    path: str | Path,
    error_map: ErrorMap,
    held_out: Samples | None = None,
    *,
    sidecars: Sequence[str | Path] = (),
    study: SimilarityStudy | None = None,
) -> None:
    """Write one self-contained HTML page about a map.

    Parameters
    ----------
    path : str or Path
    error_map : ErrorMap
    held_out : Samples, optional
        For accuracy before and after. Without them each sample is predicted from the others, and the page says so.
    sidecars : sequence of path
        Records of corrected programs.
    study : SimilarityStudy, optional
        Made here when not given.
    """
    context = _context(error_map, held_out, [_sidecar(p) for p in sidecars], study or similarity_study(error_map))
    files.write_atomic(path, _environment().get_template("report.html").render(context))


def _context(
    error_map: ErrorMap, held_out: Samples | None, sidecars: list[dict[str, Any]], study: SimilarityStudy
) -> dict[str, Any]:
    if held_out is None:
        p, before = error_map.p_cmd, error_map.e
        after, std = error_map.leave_one_out()
        coverage, seen = None, 0
        figures_of_merit = accuracy(before, after).to_dict()
    else:
        p, before = error_map.commanded_positions(held_out), error_map.errors(held_out)
        predicted, std = error_map.predict_errors(held_out)
        after = before - predicted
        figures_of_merit = error_map.validate(held_out)
        coverage, seen = figures_of_merit["coverage"], figures_of_merit["seen"]
    tool = error_map.tf_flange_tool[:3, 3]
    return {
        "version": __version__,
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "robot": error_map.robot,
        "map": error_map,
        "tool_mm": tool.tolist(),
        "tool_fitted": error_map.registration.p_flange_tool is not None,
        "held_out": held_out is not None,
        "seen": seen,
        "accuracy": figures_of_merit,
        "coverage": coverage,
        "study": study,
        "sidecars": sidecars,
        "arrows": figures.error_arrows(p, before, after),
        "histogram": figures.histogram(before, after),
        "sureness": figures.standard_deviation(p, np.linalg.norm(std, axis=1)),
        "variograms": [figures.variogram(part) for part in study.parts],
    }


def _sidecar(path: str | Path) -> dict[str, Any]:
    try:
        record = json.loads(files.read_text(path))
        if not isinstance(record["targets"], list):
            raise TypeError("targets is no list")
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(
            path, f"is not the record of a corrected program ({error}); name the .json that 'truepose correct' wrote"
        ) from None
    return dict(record)


def _environment() -> Any:
    import jinja2

    template = resources.files("truepose.report").joinpath("report.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(
        loader=jinja2.DictLoader({"report.html": template}),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["mm"] = lambda value: f"{value:.3f}"
    return environment
