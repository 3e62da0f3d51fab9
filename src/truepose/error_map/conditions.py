"""The conditions of commanded configurations, as predictors take them: see `truepose.predictors.conditions`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import BoolArray, FloatArray
from truepose.cell import Cell
from truepose.error_map.lost_motion import REVERSALS
from truepose.error_map.points import reflector_columns
from truepose.errors import DataError
from truepose.predictors import Predictor
from truepose.predictors.abilities import Conditional
from truepose.predictors.conditions import checked_work, joined
from truepose.predictors.reflectors import REFLECTOR
from truepose.robots.nongeometric import GRAVITY, STEEL
from truepose.samples import Poses, Samples, approach_from_order

_COLUMNS: Final = {"temperature": "temp_C", "payload": "load_kg"}
_KELVIN: Final = 2.0  # smaller differences of temperature are not modelled: 0.05 mm at 2 m
_LOAD: Final = 0.01  # the same of payloads, in parts of the larger one
_COMPLIANCE: Final = 1e-6  # rad/Nm, of the weakest main joint of large arms


def conditions_of(poses: Poses, cell: Cell) -> dict[str, FloatArray]:
    """Return the conditions that poses state: ``approach`` (n, dof), ``temperature`` [°C], ``payload`` [kg] (n,).

    With centres of mass also ``centre`` (n, 3) [mm]; poses to predict have that of the cell's payload if it states one.
    With readings of several reflectors also ``reflector`` (n, 2), see `truepose.predictors.reflectors`. Samples without
    a payload were measured with that of the cell, where it states one. Their directions of approach are found from the
    order of rows, or left out, where the cell asks for it.
    """
    approach = poses.approach
    if isinstance(poses, Samples):
        how = cell.conditions.approach
        approach = approach_from_order(poses) if how == "from-order" and approach is None else approach
        approach = None if how == "none" else approach
    given = {"approach": approach, "temperature": poses.temperature, "payload": poses.load, "centre": poses.p_load}
    if not isinstance(poses, Samples):
        given["centre"] = centres_at_work(len(poses), poses.p_load, cell)
    given[REFLECTOR] = reflector_columns(poses, cell)
    if poses.load is None and isinstance(poses, Samples) and cell.payload.mass_kg:
        given["payload"] = np.full(len(poses), cell.payload.mass_kg)
    return {name: values for name, values in given.items() if values is not None}


def centres_at_work(n: int, p_load: FloatArray | None, cell: Cell) -> FloatArray | None:
    """Return the centres of mass at n poses that are commanded, (n, 3) [mm], flange frame.

    They are those of `p_load`; where it is None or NaN, that of the cell's payload, if it states one.
    """
    if (own := cell.payload.centre) is None:
        return p_load
    return np.tile(own, (n, 1)) if p_load is None else np.where(np.isnan(p_load), own, p_load)


def modelled_conditions(samples: Samples, cell: Cell, *, drifting: bool = False) -> dict[str, FloatArray]:
    """Return the conditions that a model of the samples has to know.

    Approaches of at least one joint from both sides; temperatures and payloads that differ among the samples, or from
    those at work and with tools; times, where the readings drift.

    Raises
    ------
    DataError
        If the cell states a condition at work that the samples do not state.
    """
    known = conditions_of(samples, cell)
    check_work(samples, cell)
    if "approach" in known:
        both = np.minimum((known["approach"] > 0).sum(axis=0), (known["approach"] < 0).sum(axis=0))
        if both.max() < REVERSALS:
            del known["approach"]
    work = {name: [value] for name, value in work_of(cell).items()}
    work["payload"] = [*work.get("payload", []), *(one.mass_kg for one in cell.conditions.payloads.values())]
    for name in _COLUMNS:
        if name in known:
            every = np.append(known[name], work.get(name, []))
            if np.ptp(every) <= _least(name, every):
                del known[name]
    if "payload" not in known:
        known.pop("centre", None)
    if drifting and samples.time is not None:
        known["time"] = samples.time
    return known


def check_work(samples: Samples, cell: Cell) -> None:
    """Raise DataError if a cell states a condition at work that cannot be, or that the samples do not state."""
    known = conditions_of(samples, cell)
    checked_work(work_of(cell))
    for name in (*work_of(cell), *(["payload"] if cell.conditions.payloads else [])):
        if name not in known:
            raise DataError(
                f"{samples.source}: the cell states the {name} at work, but the samples have no column "
                f"{_COLUMNS[name]}; add it, or take {name} out of [conditions]"
            )


def work_of(cell: Cell) -> dict[str, float]:
    """Return the temperature [°C] and the payload [kg] at work, where the cell states them.

    The payload is that of ``[conditions]``; by default that of ``[payload]``, where this has a mass.
    """
    payload = cell.conditions.payload_kg
    stated = {
        "temperature": cell.conditions.temperature_C,
        "payload": (cell.payload.mass_kg or None) if payload is None else payload,
    }
    return {name: value for name, value in stated.items() if value is not None}


def with_conditions(
    x: FloatArray,
    predictor: Predictor,
    poses: Poses,
    cell: Cell,
    *,
    time: FloatArray | None = None,
    orientation: FloatArray | None = None,
) -> FloatArray:
    """Return coordinates of poses (n, d) with the conditions that a predictor uses; NaN where poses state none.

    `time` (n,) [s] is that of the samples of the fit: no other poses are on their clock. `orientation`
    (n, 6) [rad] is that of `truepose.error_map.orientations`, of these samples alone, too.
    """
    used = predictor.conditions if isinstance(predictor, Conditional) else ()
    further = {"time": time, "orientation": orientation}
    return joined(x, used, {**conditions_of(poses, cell), **further}) if used else x


def knows(predictor: Predictor, condition: str) -> bool:
    """Return whether a predictor has a condition in its input."""
    return isinstance(predictor, Conditional) and condition in predictor.conditions


def models(predictor: Predictor, condition: str) -> bool:
    """Return whether the effect of a condition is in a fitted model: it raised the likelihood."""
    return isinstance(predictor, Conditional) and predictor.models(condition)


def not_modelled(predictor: Predictor, samples: Samples, cell: Cell, p_cmd: FloatArray) -> float:
    """Return the variance in each direction due to conditions at work that a predictor does not know [mm²].

    Conditions that differ among the samples are in their noise; only what is farther from the mean adds to it.

    Parameters
    ----------
    predictor : Predictor
        The predictor.
    samples : Samples
        The samples of its fit.
    cell : Cell
        The cell, with the conditions at work.
    p_cmd : (n, 3) array [mm], base frame
        The commanded positions of the samples, for the reach of the arm.
    """
    known, reach = _unknown_to(predictor, samples, cell), float(np.linalg.norm(p_cmd, axis=1).max())
    effects = [
        _effect(name, np.sqrt(max((value - known[name].mean()) ** 2 - known[name].var(), 0.0)), reach)
        for name, value in work_of(cell).items()
        if name in known
    ]
    return float(np.sum(np.square(effects))) / 3.0


def not_measured(
    predictor: Predictor, samples: Samples, cell: Cell, p_cmd: FloatArray, given: Mapping[str, FloatArray | None]
) -> FloatArray:
    """Return the variance in each direction due to conditions of m poses that no sample had, (m,) or (1,) [mm²].

    Parameters
    ----------
    predictor, samples, cell, p_cmd
        As of `not_modelled`.
    given : mapping of str to (m,) array or None
        The ``temperature`` [°C] and the ``payload`` [kg] of the poses; NaN or None where they state none. What the
        predictor knows, and what is within the values of the samples, adds nothing.
    """
    known, reach = _unknown_to(predictor, samples, cell), float(np.linalg.norm(p_cmd, axis=1).max())
    variance = np.zeros(1)
    for name, beyond in _beyond(known, given).items():
        effect = np.where(beyond, _effect(name, given[name] - known[name].mean(), reach), 0.0)
        variance = variance + effect**2 / 3.0
    return variance


def strange_conditions(predictor: Predictor, samples: Samples, cell: Cell, others: Samples) -> list[str]:
    """Name the temperatures and payloads of other samples that no sample of a fit had and its predictor does not know.

    Each is a sentence with the values and the remedy.
    """
    known, given = _unknown_to(predictor, samples, cell), conditions_of(others, cell)
    said = []
    for name, beyond in _beyond(known, given).items():
        if beyond.any():
            at, own = _range(name, given[name][beyond]), _range(name, known[name])
            said.append(
                f"{beyond.sum()} of {len(others)} samples have a {name} of {at}, those of the map {own}, and the map "
                "does not know its effect: fit a new map with all samples."
            )
    return said


class AtWork(NamedTuple):
    """A condition of the samples, and its value at work.

    Attributes
    ----------
    name : str
        ``temperature`` or ``payload``.
    samples, work : str
        The range of the samples, and the value at work, with their units; "" where this is not stated.
    size : float [K] or [kg]
        The range of the samples, or the distance of the value at work to it.
    """

    name: str
    samples: str
    work: str
    size: float


def not_covered(predictor: Predictor, samples: Samples, cell: Cell) -> list[AtWork]:
    """Return the conditions at work that widen standard deviations.

    Those that a model has and that are not stated for work, and those that are stated and that no sample had.
    """
    known, work, found = conditions_of(samples, cell), work_of(cell), []
    for name in _COLUMNS:
        if name not in known:
            continue
        own = known[name][np.isfinite(known[name])]
        if name not in work:
            if models(predictor, name):
                found.append(AtWork(name, _range(name, own), "", float(np.ptp(own))))
            continue
        value = np.array([work[name]])
        if _beyond({name: own}, {name: value})[name][0]:
            beyond = float(np.maximum(own.min() - value, value - own.max())[0])
            found.append(AtWork(name, _range(name, own), _range(name, value), beyond))
    return found


def _beyond(known: Mapping[str, FloatArray], given: Mapping[str, FloatArray | None]) -> dict[str, BoolArray]:
    """Return where given conditions are beyond the known ones, by name."""
    found = {}
    for name, own in known.items():
        if (values := given.get(name)) is not None:
            least = _least(name, np.append(own, values[np.isfinite(values)]))
            found[name] = (values < own.min() - least) | (values > own.max() + least)
    return found


def _range(condition: str, values: FloatArray) -> str:
    ends = dict.fromkeys(f"{value:g}" for value in (values.min(), values.max()))
    return f"{' to '.join(ends)} {'°C' if condition == 'temperature' else 'kg'}"


def _unknown_to(predictor: Predictor, samples: Samples, cell: Cell) -> dict[str, FloatArray]:
    """Return the temperatures and payloads of samples that are not in a predictor's model, by name."""
    return {
        name: values
        for name, values in conditions_of(samples, cell).items()
        if name in _COLUMNS and not _considers(predictor, name)
    }


def _considers(predictor: Predictor, name: str) -> bool:
    """Return whether a predictor has a temperature or payload in its model; one without effect was found to have none.

    A payload acts through compliance: a model without compliance has it in its input, but not in its model.
    """
    return models(predictor, name) if name == "payload" else knows(predictor, name)


def _least(condition: str, values: FloatArray) -> float:
    """Return the difference of a condition up to which its effect is not modelled [°C, kg]."""
    return _KELVIN if condition == "temperature" else _LOAD * float(values.max())


def _effect(condition: str, difference: FloatArray, reach: float) -> FloatArray:
    """Return the most that a difference of temperature [K] or payload [kg] moves an arm of a reach [mm], [mm]."""
    return reach * difference * (STEEL if condition == "temperature" else _COMPLIANCE * GRAVITY * reach * 1e-3)
