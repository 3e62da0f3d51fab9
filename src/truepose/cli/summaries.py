"""Summaries that several commands show: campaign faults, the ranking of predictors, a calibration, a weak map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from truepose.cli.output import say, table

if TYPE_CHECKING:
    from truepose.error_map.facts import Fact
    from truepose.error_map.rivals import Better
    from truepose.error_map.worth import Worth
    from truepose.predictors import KinematicCalibration

_WIDTH: Final = 80
_SHOWN_UNITS: Final = {"rad": ("deg", 57.29577951308232, 4), "rad/Nm": ("µrad/Nm", 1e6, 3), "mm": ("mm", 1.0, 3)}
_JOINT_UNIT: Final = ("mrad", 1e3, 4)
OFF: Final = "off [prior σ]"
"""The column of how many prior standard deviations a parameter is from its nominal value."""
_SOURCES: Final = {"tolerance": "manufacturing tolerances only", "subset": "nominal values"}


def show_facts(facts: Iterable[Fact], *, told: bool = False) -> None:
    """Show what facts of a map do to corrections; `told`: also those that do nothing, in lines of a terminal."""
    import textwrap

    from rich.markup import escape

    from truepose.error_map.facts import in_force

    for fact in facts if told else in_force(facts):
        head, text = f"Fact {fact.code}", f"{fact.sentence}."
        if told:
            first = " " * len(f"{head}: ")
            lines = textwrap.wrap(text, _WIDTH, initial_indent=first, subsequent_indent="  ", break_on_hyphens=False)
            text = "\n".join(lines).lstrip()
        say(f"[{'bold' if fact.effect == 'told' else 'yellow'}]{head}[/]: {escape(text)}")


def show_campaign(campaign: Mapping[str, Any]) -> None:
    """Show the faults of a measuring campaign, or that there were too few samples to test for them."""
    for fault in campaign.get("faults", []):
        rms = f"{fault['size']:.3f} ± {fault['size_std']:.3f} mm"
        say(f"[yellow]Warning[/]: {fault['words']}; effect on the samples {rms} (RMS).")
    if campaign and not campaign["tested"]:
        say("[yellow]Note[/]: too few samples to test for a moved tracker, a scale error or a drift.")


def show_worth(worth: Worth) -> None:
    """Show whether a map is better than registration alone, and how to use a weak one."""
    sentence = f"{worth.words[0].upper()}{worth.words[1:]}"
    if worth.weak:
        say(f"[yellow]Weak map[/]: {sentence}. 'truepose correct' refuses it without --accept-weak-map.")
    else:
        say(f"{sentence}.")


def show_better(better: Better | None) -> None:
    """Show that another predictor would do far better, if one does."""
    if better is not None:
        say(f"[yellow]Note[/]: {better.words}.")


def show_choice(ranking: Sequence[Mapping[str, Any]], expected: Mapping[str, Any]) -> None:
    """Show the ranking of `truepose.predictors.Choice`, and the error on samples outside the fit and the choice."""
    splits = list(expected["splits"])
    rows = [
        (
            row["predictor"],
            row["mean_mm"],
            *(row["splits"][name]["mean_mm"] for name in splits),
            row["p95_mm"],
            _worse(row) if k else "chosen",
        )
        if "mean_mm" in row
        else (row["predictor"], *["–"] * (len(splits) + 2), row["note"])
        for k, row in enumerate(ranking)
    ]
    columns = ["predictor", "mean", *splits, "P95", "worse by (95 %)"]
    say(table(f"Cross-validation of the candidates over {' and '.join(splits)} [mm]", columns, rows))
    low, high = expected["mean_interval_mm"]
    chosen = ", ".join(f"{name} {count}×" for name, count in expected["chosen"].items())
    say(
        f"Mean error of samples outside both the fit and the choice: {expected['mean_mm']:.3f} mm "
        f"(95 % interval {low:.3f} … {high:.3f} mm). Chosen without them: {chosen}."
    )


def _worse(row: Mapping[str, Any]) -> str:
    low, high = row["worse_by_interval_mm"]
    return "not significant" if row["level"] else f"{low:.3f} … {high:.3f}"


def show_calibration(calibration: KinematicCalibration, *, parameters: bool = True) -> None:
    """Show how well the poses determine the parameters of the arm, and on request the identified parameters."""
    seen, p = calibration.observability_, len(calibration.parameters_)
    if parameters:
        columns = ("parameter", "nominal", "identified", "± std", "unit", OFF, "")
        title = f"Identified parameters ({calibration.convention}, method {calibration.method})"
        say(table(title, columns, [_cells(row) for row in calibration.parameters_]))
    unknown = f"; {p - seen.rank} combinations are set by {_SOURCES[calibration.prior]}" if seen.rank < p else ""
    say(
        f"Identified {seen.rank} of {p} parameters of the arm (condition number {seen.condition:.0f}){unknown}. "
        f"Residual standard deviation: {calibration.misfit_std_:.3f} mm per axis."
        + ("" if parameters else " All parameters: --parameters.")
    )
    if calibration.hint_:
        say(f"[yellow]Note[/]: {calibration.hint_}.")


def show_fleet(fleet: Mapping[str, Any]) -> None:
    """Show what a fit took of the maps of other robots, if it got any."""
    if not fleet:
        return
    taken = {
        "nothing": "nothing was taken of them: the samples speak against it",
        "hyperparameters": "tolerances and sizes of joint errors were taken of them, no mean error",
        "mean": f"tolerances, sizes of joint errors and {fleet['scale']:.0%} of the mean error were taken of them",
    }
    names = ", ".join(one["name"] for one in fleet["maps"])
    say(f"Other robots of the type ({names}): {taken[fleet['taken']]} (gain of the log evidence {fleet['gain']:.1f}).")


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    unit, factor, digits = _SHOWN_UNITS.get(row["unit"], (row["unit"], 1.0, 6))
    if row["unit"] == "rad" and " q" in row["parameter"]:
        unit, factor, digits = _JOINT_UNIT
    nominal, identified = (f"{factor * row[key]:.{digits}f}" for key in ("nominal", "identified"))
    std = "–" if row["std"] is None else f"{factor * row['std']:.{digits}f}"
    return row["parameter"], nominal, identified, std, unit, f"{row['off']:+.1f}", row["note"]
