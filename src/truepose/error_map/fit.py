"""From samples to an error map: registration, predictor, samples left out."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from truepose.cell import Cell
from truepose.error_map.arm_check import check_arm, in_controllers_base
from truepose.error_map.campaign import CampaignCheck, check_campaign
from truepose.error_map.conditions import modelled_conditions
from truepose.error_map.distances import check_distance_rows, distance_rows, unused_distances, with_origins
from truepose.error_map.exclusions import contradicted, gross_readings, without_gross
from truepose.error_map.facts import Fact, of_import
from truepose.error_map.fleet import fleet_of
from truepose.error_map.map import ErrorMap
from truepose.error_map.registration import tool_estimate, with_tool_hint, wrong_tool_named
from truepose.error_map.selection import CellSamples, points_named
from truepose.errors import DataError
from truepose.geometry import Registration
from truepose.numerics.executor import Executor
from truepose.predictors import Choice, KinematicKriging, rank_predictors
from truepose.predictors.abilities import Conditional, OutlierWeighing
from truepose.predictors.conditions import CONDITIONS
from truepose.predictors.registry import conditions_wanted, for_many, predictor_spec
from truepose.robots import Robot
from truepose.samples import Samples, approach_from_order, on_arm


def fit_cell(
    cell: Cell,
    samples: Samples,
    predictor: str = "auto",
    *,
    candidates: str | Sequence[str] = "quick",
    splits: Sequence[str] = ("points", "blocks"),
    folds: int = 5,
    rng: int = 0,
    workers: int = 1,
    executor: Executor | None = None,
    progress: Callable[[str], Any] = str,
    accept_campaign: bool = False,
    like: Sequence[ErrorMap] = (),
) -> ErrorMap:
    """Register, fit the tool if the cell asks for it, and fit an error model.

    Parameters
    ----------
    cell : Cell
        The cell that was measured.
    samples : Samples
        The commanded poses and readings.
    predictor : str
        The name of a predictor, with options as in `truepose.predictors.predictor_spec`; ``auto`` chooses by nested
        cross-validation. Beyond 5,000 samples global Kriging is replaced by Vecchia's approximation, with a warning.
    candidates, splits, folds, rng, workers, executor
        The options of ``auto``, see `truepose.choose`.
    progress : callable
        A function of a line about the current step.
    accept_campaign : bool
        Whether to fit samples of a campaign that `truepose.error_map.campaign.check_campaign` refuses; the map keeps
        the faults.
    like : sequence of ErrorMap
        Maps of other robots of the same type, fitted with kinematic Kriging: their hyperparameters and their mean error
        become a prior of kinematic Kriging, as far as the samples support it.

    Returns
    -------
    ErrorMap

    Raises
    ------
    DataError, IdentifiabilityError, RobotError, KrigingError
        If the samples do not suffice; `DataError` also where the tracker moved during the campaign, lengths have a
        scale, or errors drift, by more than `CampaignCheck.limit`.

    Examples
    --------
    >>> from truepose import VirtualCell
    >>> virtual = VirtualCell("paper")
    >>> error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "ordinary-kriging")
    >>> error_map.predictor_name, len(error_map.samples), error_map.worth.weak
    ('ordinary-kriging', 40, False)
    """
    chosen = (candidates, tuple(splits), folds) != ("quick", ("points", "blocks"), 5)
    if predictor != "auto" and chosen:
        raise DataError(
            f"candidates, splits and folds have no effect with the predictor {predictor!r}; leave them out, or fit "
            '"auto", which chooses among predictors'
        )
    samples = on_arm(samples, cell.load_robot())
    robot, facts = in_controllers_base(cell.load_robot(), samples, cell.tf_flange_tool, fit=cell.tool.fit)
    samples = with_origins(cell, samples)
    if cell.conditions.approach == "from-order":
        progress("Finding the directions of approach from the order of rows")
        samples = replace(samples, approach=approach_from_order(samples))
    progress("Registering")
    fleet = _fleet(like, robot, samples, predictor) if like else None
    measured = CellSamples(cell, robot, samples, fleet=fleet)
    registration, tf_flange_tool = measured.register()
    rows = distance_rows(cell, samples, registration)
    check_distance_rows(robot, samples, rows, tf_flange_tool)
    progress("Testing for a moved tracker, a scale error and a drift")

    stated = () if samples.q is None else modelled_conditions(samples, cell, drifting=True)
    wanted = CONDITIONS if predictor == "auto" else conditions_wanted(predictor)
    known = {name for name in stated if name in wanted}
    campaign = check_campaign(
        cell, measured.robot, samples, registration, tf_flange_tool, expansion="temperature" in known
    )
    measured = replace(measured, drifting="time" in known and campaign.drifts)
    _refuse(campaign, measured, known, accept_campaign)
    gross = gross_readings(cell, measured.robot, samples, registration, tf_flange_tool)
    # readings before or after a motion that was accepted contradict the others, but are not wrong
    if gross.any() and not any(change.kind == "moved" for change in campaign.changes):
        samples = without_gross(samples, registration, gross)
        measured = replace(measured, samples=samples)
        registration, tf_flange_tool = measured.register()
        campaign = check_campaign(
            cell, measured.robot, samples, registration, tf_flange_tool, expansion="temperature" in known
        )
        measured = replace(measured, drifting="time" in known and campaign.drifts)
        _refuse(campaign, measured, known, accept_campaign)
    with points_named(samples):
        if predictor == "auto":
            progress("Cross-validation of the candidates")
            choice = rank_predictors(
                candidates,
                measured,
                splits=splits,
                folds=folds,
                rng=rng,
                workers=workers,
                executor=executor,
                progress=progress,
            )
        else:
            asked, predictor = predictor, _for_many(predictor, len(samples))
            if predictor != asked:
                words = f"{len(samples)} samples are too many for {asked}; {predictor} was fitted"
                facts = [*facts, Fact("approximated", words)]
            progress(f"Fitting {predictor}")
            errors = measured.errors(registration, tf_flange_tool)
            choice = Choice([], {}, predictor, *errors.fit(predictor), errors)
    if predictor == "auto":
        known = set(choice.predictor.conditions if isinstance(choice.predictor, Conditional) else ())
        campaign = check_campaign(
            cell, measured.robot, samples, registration, tf_flange_tool, expansion="temperature" in known
        )
        _refuse(campaign, measured, known, accept_campaign)
    if isinstance(choice.predictor, KinematicKriging) and cell.tool.fit != "none":
        registration = with_tool_hint(registration, choice.predictor.parameters_)
    error_map = ErrorMap(
        cell=cell,
        robot=measured.robot,
        samples=samples[choice.gross == 0],
        registration=registration,
        tf_flange_tool=tf_flange_tool,
        predictor_name=choice.predictor_name,
        predictor=choice.predictor,
        ranking=choice.ranking,
        expected=choice.expected,
        excluded=[
            *samples.excluded,
            *_excluded(samples, registration, choice),
            *unused_distances(samples, choice.predictor),
        ],
        campaign=campaign.to_dict(),
        arm_check=check_arm(measured.robot, samples, tf_flange_tool, fit=cell.tool.fit),
        stated=(*of_import(samples.facts), *facts, *_of_tool(cell, measured.robot, samples)),
    )
    progress("Comparing the map with registration alone")
    return error_map.changed(known_worth=error_map.worth)


def _fleet(like: Sequence[ErrorMap], robot: Robot, samples: Samples, predictor: str) -> dict[str, Any]:
    """Return what other robots of the type say, as a parameter of kinematic Kriging."""
    spec = None if predictor == "auto" else predictor_spec(predictor)
    if spec is not None and spec.family is not KinematicKriging:
        raise DataError(
            f"the predictor {predictor!r} cannot learn from maps of other robots; fit kinematic-kriging or auto, or "
            "leave out --like"
        )
    options = {} if spec is None else spec.options
    return fleet_of(like, robot, samples, options.get("convention", "hayati")).to_dict()


def _refuse(campaign: CampaignCheck, measured: CellSamples, known: set[str], accepted: bool) -> None:
    """Raise an error for faults of a campaign that neither the predictor knows nor the user accepts."""
    if not accepted:
        with wrong_tool_named(measured.cell, measured.robot, measured.samples):
            campaign.refuse(measured.samples.source, ("drift",) if "time" in known else ())


def _for_many(predictor: str, n: int) -> str:
    """Return the predictor to fit to n samples, with a warning where it is another one than asked for."""
    if (fitted := for_many(predictor, n)) != predictor:
        told = f"{n} samples are too many for {predictor}; {fitted} is fitted, which approximates it in linear time"
        warnings.warn(told, stacklevel=3)
    return fitted


def _of_tool(cell: Cell, robot: Robot, samples: Samples) -> list[Fact]:
    """Return what the readings say against the stated tool."""
    found = tool_estimate(cell, robot, samples)
    if found is None or not found.suspect:
        return []
    words = f"the stated tool is suspect: {found.words}"
    return [Fact("tool-suspect", words, "fit", found.distance_mm, max(found.std_mm), "mm")]


def _excluded(samples: Samples, registration: Registration, choice: Choice) -> list[dict[str, Any]]:
    """Name the samples left out, and those to which a robust predictor gives almost no weight."""
    kept, model = np.flatnonzero(choice.gross == 0), choice.predictor
    size = np.linalg.norm(registration.residuals, axis=1)
    reasons = {i: contradicted(size[i], choice.gross[i]) for i in np.flatnonzero(choice.gross)}
    if isinstance(model, OutlierWeighing):
        reasons |= {i: f"error of {size[i]:.3f} mm, contradicted by the others" for i in kept[model.gross_]}
    return [{**samples.identify(int(i)), "reason": why} for i, why in reasons.items()]
