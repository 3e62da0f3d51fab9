"""``truepose similarity``: variograms of the errors, their models, and a test against chance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.cli.options import CellPath, Force, Json, SamplesPath, parse_numbers
from truepose.cli.output import emit_json, overwrite, say, table, working
from truepose.cli.summaries import show_campaign
from truepose.errors import DataError

if TYPE_CHECKING:
    from truepose.report.joint_similarity import JointSimilarity
    from truepose.report.study import SimilarityStudy
    from truepose.similarity import Direction


def similarity(
    cell_path: CellPath,
    samples_path: SamplesPath,
    family: Annotated[str, typer.Option(help="Variogram family, several joined by +, or best.")] = "best",
    bins: Annotated[str, typer.Option(help="Number of distance classes, or their edges: 0,50,100,200.")] = "15",
    equal_counts: Annotated[
        bool, typer.Option("--equal-counts", help="Use classes with equal numbers of pairs.")
    ] = False,
    max_lag: Annotated[float | None, typer.Option(help="Largest distance in mm or rad.")] = None,
    estimator: Annotated[str, typer.Option(help="matheron, or a robust one: cressie, dowd, genton.")] = "matheron",
    direction: Annotated[
        str | None, typer.Option(help="Direction of the pairs: x, y, z, or numbers such as 1,1,0.")
    ] = None,
    tolerance: Annotated[float, typer.Option(help="Largest angle between a pair and the direction in degrees.")] = 22.5,
    bandwidth: Annotated[
        float | None, typer.Option(help="Largest distance of a pair from the direction's axis in mm.")
    ] = None,
    space: Annotated[str, typer.Option(help="Space of the distances: cartesian, joint or both.")] = "both",
    nugget: Annotated[float | None, typer.Option(help="Nugget of the model in mm², instead of the fitted one.")] = None,
    sill: Annotated[
        float | None, typer.Option(help="Partial sill of the model in mm², instead of the fitted one.")
    ] = None,
    range_: Annotated[
        float | None,
        typer.Option("--range", help="Range parameter of the model in mm or rad, instead of the fitted one."),
    ] = None,
    weights: Annotated[
        str, typer.Option(help="Weights of the distance classes in the fit: cressie, pairs, pairs/h2 or equal.")
    ] = "cressie",
    hold: Annotated[
        bool,
        typer.Option("--hold", help="Hold --nugget, --sill and --range in the fit, and fit the other parameters."),
    ] = False,
    joint_wise: Annotated[
        bool, typer.Option("--joint-wise", help="Add the similarity of each joint's own error; takes about a minute.")
    ] = False,
    plot: Annotated[Path | None, typer.Option(help="File for the picture (.svg, .png, .pdf).")] = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Show whether nearby configurations have similar errors: semivariograms, fitted models, a test against chance."""
    from dataclasses import replace

    from truepose.cell import load_cell
    from truepose.error_map.fit import fit_cell
    from truepose.report.findings import study_to_dict
    from truepose.report.joint_similarity import joint_similarity
    from truepose.report.study import similarity_study
    from truepose.samples import read_samples

    overwrite(force, *([] if plot is None else [plot]))
    if plot is not None:
        from truepose.report.plots.study import plot_format, save_study

        plot_format(plot)
    cell, samples = load_cell(cell_path), read_samples(samples_path)
    given = {"nugget": nugget, "sill": sill, "range": range_}
    by_hand = {name: value for name, value in given.items() if value is not None}
    if hold and not by_hand:
        raise DataError("--hold has no effect without --nugget, --sill or --range; give one of them")
    with working("Registering", quiet=as_json) as progress:
        registered = fit_cell(cell, samples, "registration", accept_campaign=True)
        progress("Looking for similarity")
        study = similarity_study(
            registered,
            family=family,
            bins=_bins(bins),
            equal_counts=equal_counts,
            max_lag=max_lag,
            estimator=estimator,
            direction=None if direction is None else _direction(direction, tolerance, bandwidth),
            space=space,
            by_hand={} if hold else by_hand,
            weights=weights,
            fixed=by_hand if hold else None,
        )
        if joint_wise:
            progress("Estimating each joint's own error")
            fitted = fit_cell(cell, samples, "kinematic-kriging", accept_campaign=True)
            study = replace(study, joints=joint_similarity(fitted))
    if plot is not None:
        save_study(study, plot)
    if as_json:
        emit_json({**study_to_dict(study), "campaign": registered.campaign, "plot": plot})
        return
    show_campaign(registered.campaign)
    _show(study)
    if plot is not None:
        say(f"Wrote {plot}.")


def _show(study: SimilarityStudy) -> None:
    """Show the variogram and the findings of each space."""
    from truepose.report.findings import findings, title
    from truepose.report.locale import load_locale

    english = load_locale("en")
    for part in study.parts:
        rows = [(f"{lag:.4g}", n, *gamma, total) for lag, n, gamma, total in part.rows() if n]
        say(
            table(
                title(part, english),
                [f"lag [{part.unit}]", "pairs", "x [mm²]", "y [mm²]", "z [mm²]", "vector [mm²]"],
                rows,
            ),
            *(f"[bold]{question}[/] {answer}" for question, answer in findings(part, english)),
            "",
        )
    if study.joints:
        _show_joints(study.joints)


def _bins(text: str) -> int | list[float]:
    """Return a number of bins, or edges."""
    numbers = parse_numbers(text, "--bins")
    if len(numbers) > 1:
        return numbers
    if numbers[0] < 2 or not numbers[0].is_integer():
        raise DataError(f"--bins: expected a whole number of at least 2, or edges such as 0,50,100; got {text}")
    return int(numbers[0])


def _direction(text: str, tolerance: float, bandwidth: float | None) -> Direction:
    """Return a direction from the name of an axis, or from numbers."""
    import numpy as np

    from truepose.similarity import Direction

    axis = np.eye(3)["xyz".index(text)] if text in tuple("xyz") else np.array(parse_numbers(text, "--direction"))
    return Direction(axis, np.radians(tolerance), np.inf if bandwidth is None else bandwidth)


def _show_joints(joints: list[JointSimilarity]) -> None:
    import numpy as np

    rows = [(f"q{one.joint + 1}", one.std_mrad, f"{np.degrees(one.reach):.3g}") for one in joints]
    say(
        table("Each joint's own error over its angle", ["joint", "std [mrad]", "similar up to [deg]"], rows),
        "A gear's transmission error depends on the joint angle. Two poses with the same angle of that joint share it, "
        "however far apart they are.",
        "",
    )
