"""The paper's experiment on virtual cells: its own method, and ours on the same readings (docs/validation).

A cell is measured on a grid or at random positions, at one orientation or at many; a map is fitted; new targets are
corrected; the virtual robot moves to the corrected commands and is measured there. Every figure is computed from
readings of the tracker, noise included, before and after.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from truepose._extras import needed
from truepose._io.delimited import escaped
from truepose._io.files import write_all
from truepose._typing import FloatArray
from truepose.cell import Cell
from truepose.error_map import ErrorMap
from truepose.error_map.fit import fit_cell
from truepose.geometry import apply_transform, euler, invert_transform, make_transform
from truepose.numerics.executor import Executor, Inputs, Serial, Task
from truepose.predictors import OrdinaryKriging
from truepose.samples import Samples
from truepose.simulation import VirtualCell
from truepose.verification import summary

if TYPE_CHECKING:
    from matplotlib.figure import Figure


STUDY_FILES: Final = ("results.csv", "table.md", "reductions.svg")
PUBLISHED_REDUCTION: Final = 75.36
"""Reduction of the maximum in the paper [%], from 1.2912 mm to 0.3182 mm."""

ORIENTATIONS: Final = {"fixed": 0.0, "free": 15.0}
"""Largest rotation of the tool about each of its axes [°]."""

SAMPLINGS: Final = ("grid", "random")
N_TARGETS: Final = 100
_SHARE: Final = 0.9  # of the work region's edges; its corners are out of reach at some orientations
_BEFORE_NOISE, _AFTER_NOISE = 1, 2  # seeds: the noise is the same for every method


@dataclass(frozen=True)
class Method:
    """A predictor and the step from prediction to command.

    Attributes
    ----------
    title : str
        The name in tables and figures.
    predictor : str
        The predictor of `fit_cell`; empty for the paper's own.
    one_step : bool
        Whether theory (15) is used; otherwise (16).
    """

    title: str
    predictor: str = ""
    one_step: bool = False


METHODS: Final = (
    Method("the paper's (15)", one_step=True),
    Method("the paper's, solved (16)"),
    Method("ordinary Kriging, REML (16)", "ordinary-kriging"),
    Method("calibration (16)", "calibration"),
    Method("kinematic Kriging (16)", "kinematic-kriging"),
    Method("auto (16)", "auto"),
)


@dataclass(frozen=True)
class Result:
    """The result of one method on one cell.

    Attributes
    ----------
    seed : int
        The seed of the cell.
    orientation, sampling, method : str
        The keys of the experiment, see `ORIENTATIONS`, `SAMPLINGS` and `METHODS`.
    predictor : str
        The predictor used; for ``auto`` the chosen one.
    mean_before, max_before, mean_after, max_after : float [mm]
        The lengths of the errors over the targets.
    left_alone : int
        The number of targets that a guard left nominal; they count among those after.
    """

    seed: int
    orientation: str
    sampling: str
    method: str
    predictor: str
    mean_before: float
    max_before: float
    mean_after: float
    max_after: float
    left_alone: int

    @property
    def reduction_mean(self) -> float:
        """Reduction of the mean [%]."""
        return 100.0 * (1.0 - self.mean_after / self.mean_before)

    @property
    def reduction_max(self) -> float:
        """Reduction of the maximum [%]."""
        return 100.0 * (1.0 - self.max_after / self.max_before)


def run_study(
    preset: str = "paper",
    seeds: Iterable[int] = range(10),
    *,
    per_axis: int = 5,
    methods: Sequence[Method] = METHODS,
    executor: Executor | None = None,
    progress: Callable[[str], Any] = str,
) -> list[Result]:
    """Run every method on the same readings of virtual cells, at fixed and at free orientation.

    Parameters
    ----------
    preset : str
        The name of a preset in `truepose.simulation.PRESETS`.
    seeds : iterable of int
        The seeds of the cells.
    per_axis : int
        The number of grid nodes along each axis of the work region; its cube is also the number of random samples.
    methods : sequence of Method
        The methods to compare.
    executor : Executor, optional
        Where the experiments run; by default in this process. Results do not depend on it.
    progress : callable
        A function of a line about the current step.
    """

    def tasks() -> Iterator[Task]:
        for seed, orientation, sampling in product(seeds, ORIENTATIONS, SAMPLINGS):
            progress(f"Robot {seed}, {orientation} orientation, {sampling}")
            values = preset, seed, orientation, sampling, per_axis, tuple(methods)
            yield Task((), values, repr(values))

    found = dict((executor or Serial()).run(experiment_task, tasks()))
    return [result for place in sorted(found) for result in found[place]]


def experiment_task(_: Inputs, task: Task) -> list[Result]:
    """Measure one cell in one way, and apply all methods to it: a task."""
    preset, seed, *how = task.values
    return _experiment(VirtualCell(preset, seed=seed), *how)


def _experiment(
    virtual: VirtualCell, orientation: str, sampling: str, per_axis: int, methods: Sequence[Method]
) -> list[Result]:
    """Measure one cell in one way, and apply all methods to it."""
    rng = np.random.default_rng([virtual.seed, 2016])
    unit = _lattice(per_axis) if sampling == "grid" else rng.uniform(-0.5, 0.5, (per_axis**3, 3))
    samples = virtual.measure(virtual.reach(*_poses(virtual, unit, ORIENTATIONS[orientation], rng)))
    p_target, rotation = _poses(virtual, rng.uniform(-0.5, 0.5, (N_TARGETS, 3)), ORIENTATIONS[orientation], rng)
    results = []
    for method in methods:
        error_map = _fit(_cell(virtual, orientation), samples, method)
        targets = make_transform(rotation, p_target)
        corrections = error_map.correct(targets, on_guard="skip", accept_weak_map=True)  # a study includes weak maps
        p_command = corrections.p_mirror if method.one_step else corrections.p_command
        before = summary(_miss(virtual, error_map, p_target, p_target, rotation, _BEFORE_NOISE))
        after = summary(_miss(virtual, error_map, p_command, p_target, rotation, _AFTER_NOISE))
        lengths = before["mean_mm"], before["max_mm"], after["mean_mm"], after["max_mm"]
        left = 0 if method.one_step else int(np.sum(corrections.verdict != "correct"))
        results.append(
            Result(virtual.seed, orientation, sampling, method.title, error_map.predictor_name, *lengths, left)
        )
    return results


def _lattice(per_axis: int) -> FloatArray:
    """Return the nodes of a grid in the unit cube about the origin, (per_axis³, 3)."""
    axis = np.linspace(-0.5, 0.5, per_axis)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)


def _poses(
    virtual: VirtualCell, unit: FloatArray, orientation_deg: float, rng: np.random.Generator
) -> tuple[FloatArray, Rotation]:
    """Return positions (n, 3) [mm] in the work region, base frame, and orientations of the tool there."""
    turn = Rotation.from_rotvec(np.deg2rad(orientation_deg) * rng.uniform(-1.0, 1.0, unit.shape))
    p = np.asarray(virtual.preset.centre_mm) + _SHARE * unit * virtual.preset.size_mm
    return p, euler("kuka", virtual.preset.abc_deg) * turn


def _cell(virtual: VirtualCell, orientation: str) -> Cell:
    """Return the content of the cell file; where orientations differ, the tool point is fitted with the station."""
    cell = virtual.cell
    fit = "none" if orientation == "fixed" else "position"
    return cell.model_copy(update={"tool": cell.tool.model_copy(update={"fit": fit})})


def _fit(cell: Cell, samples: Samples, method: Method) -> ErrorMap:
    """Fit a map; the paper's is ordinary Kriging with a spherical semivariogram fitted to (4).

    The paper's range is the lag at which the semivariogram attains its sill, which exists for the spherical model;
    with (7) in terms of semivariograms, γ(0) = 0, the prediction passes through the samples.
    """
    if method.predictor:
        options: dict[str, Any] = {"splits": ["blocks"], "folds": 3} if method.predictor == "auto" else {}
        return fit_cell(cell, samples, method.predictor, **options)
    registered = fit_cell(cell, samples, "registration")
    kriging = OrdinaryKriging("spherical", exact=True).fit(registered.p_cmd, registered.e)
    return registered.changed(predictor_name="ordinary-kriging", predictor=kriging, known_worth=None)


def _miss(
    virtual: VirtualCell,
    error_map: ErrorMap,
    p_command: FloatArray,
    p_target: FloatArray,
    rotation: Rotation,
    noise_seed: int,
) -> FloatArray:
    """Move to commands of the map's tool point, measure, and return the differences from the targets, (n, 3) [mm]."""
    p_stated_fitted = apply_transform(invert_transform(virtual.tf_flange_tool), error_map.tf_flange_tool[:3, 3])
    q = virtual.reach(p_command - rotation.apply(p_stated_fitted), rotation)
    seen = virtual.measure(q, seed=noise_seed).p_meas
    return apply_transform(error_map.registration.tf_base_tracker, seen) - p_target


Spread = tuple[float, float, float]


def spread(results: Iterable[Result], quantity: str) -> Spread:
    """Return median, smallest and largest of an attribute of results."""
    values = [getattr(result, quantity) for result in results]
    return float(np.median(values)), min(values), max(values)


def groups(results: Sequence[Result]) -> dict[tuple[str, str, str], list[Result]]:
    """Return the results of all cells by orientation, sampling and method, in their order."""
    grouped: dict[tuple[str, str, str], list[Result]] = {}
    for result in results:
        grouped.setdefault((result.orientation, result.sampling, result.method), []).append(result)
    return grouped


def markdown(results: Sequence[Result]) -> str:
    """Return one table for each orientation: medians over the cells, and the range of the reductions."""
    heads = ("method", "samples", "mean [mm]", "max [mm]", "mean reduced by", "max reduced by", "left alone")
    lines = []
    for wanted in dict.fromkeys(result.orientation for result in results):
        lines += [f"**{wanted.capitalize()} orientation**", "", _row(heads), _row(["---"] * len(heads))]
        for (orientation, sampling, method), of in groups(results).items():
            if orientation == wanted:
                lengths = (
                    f"{spread(of, f'{what}_before')[0]:.3f} → {spread(of, f'{what}_after')[0]:.3f}"
                    for what in ("mean", "max")
                )
                reductions = (
                    "{} % ({} … {})".format(*map(round, spread(of, f"reduction_{what}"))) for what in ("mean", "max")
                )
                left = f"{np.mean([result.left_alone for result in of]):.1f} %"
                lines.append(_row((method, sampling, *lengths, *reductions, left)))
        lines.append("")
    return "\n".join(lines)


def plot(results: Sequence[Result]) -> Figure:
    """Draw the reduction of the maximum of every cell, and the paper's."""
    with needed("the picture of the study", "report"):
        from matplotlib.figure import Figure

    orientations = list(dict.fromkeys(result.orientation for result in results))
    methods = list(dict.fromkeys(result.method for result in results))
    figure = Figure(figsize=(9.0, 0.55 * len(methods) + 1.3), layout="constrained")
    panels = figure.subplots(1, len(orientations), sharex=True, sharey=True, squeeze=False)[0]
    for axes, wanted in zip(panels, orientations, strict=True):
        for (orientation, sampling, method), of in groups(results).items():
            if orientation == wanted:
                k = SAMPLINGS.index(sampling)
                y = methods.index(method) + (-0.15, 0.15)[k]
                x = [result.reduction_max for result in of]
                colour = ("#1f4e79", "#c8442b")[k]
                label = sampling if method == methods[0] else None
                axes.plot(x, [y] * len(x), "o", ms=4, alpha=0.45, color=colour, mew=0, label=label)
                axes.plot([np.median(x)] * 2, [y - 0.14, y + 0.14], color=colour, lw=2)
        axes.axvline(PUBLISHED_REDUCTION, color="#6b6b6b", ls="--", lw=1, label="published")
        axes.set(title=f"{wanted} orientation", xlabel="reduction of the maximum [%]")
        axes.grid(axis="x", color="#e5e5e5")
        axes.set_axisbelow(True)
    panels[0].set_yticks(range(len(methods)), methods)
    panels[0].invert_yaxis()
    panels[0].legend(loc="lower left", fontsize=8)
    return figure


def write_study(directory: Path, results: Sequence[Result]) -> None:
    """Write results.csv, table.md and reductions.svg to a folder, all or none."""
    with needed("the picture of the study", "report"):
        import matplotlib as mpl

    rows = io.StringIO()
    writer = csv.DictWriter(rows, [field.name for field in fields(Result)], lineterminator="\n")
    writer.writeheader()
    for result in results:
        row = asdict(result)
        writer.writerow(
            {
                name: f"{value:.4f}" if isinstance(value, float) else _unlike_formula(value)
                for name, value in row.items()
            }
        )
    picture = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "truepose"}):
        plot(results).savefig(picture, format="svg", metadata={"Date": None, "Creator": None})
    texts = (rows.getvalue(), markdown(results), picture.getvalue())
    write_all({directory / name: text for name, text in zip(STUDY_FILES, texts, strict=True)})


def _unlike_formula(value: object) -> object:
    return escaped(value) if isinstance(value, str) else value


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
