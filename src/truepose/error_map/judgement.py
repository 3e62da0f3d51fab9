"""Judge the parameters of an arm that a fit identified, before anything is corrected with them.

A sample table with a swapped column, a joint that was mastered again or a wrong row of the robot's model leave their
trace in the parameters: a value far beyond its tolerance, or a sign that physics forbids. One such fault hides in
several parameters that the samples cannot tell apart (the zero of a joint and the twist of the link before it). So the
judgement asks which single parameter explains most if it may be anything, and what it then is: the evidence of the
samples with one wide prior more, and the tolerance of all others chosen anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray
from truepose.error_map.data import MapData
from truepose.error_map.facts import Fact
from truepose.error_map.registration import tool_estimate
from truepose.error_map.repeatability import USUAL_RP_MM, Repeatability
from truepose.predictors.abilities import JointwisePredicting, ParameterEstimating
from truepose.predictors.estimates import ParameterEstimates

_TOLERANCE: Final = {"rad": 1e-3, "mm": 0.5}  # of links, as in kinematic Kriging
_ANYTHING: Final = 100.0  # tolerances: the wide prior of a parameter that may be anything
_SCALES: Final = np.exp(np.linspace(np.log(0.02), np.log(20.0), 15))  # of the tolerance of all others
_SCALE_STD: Final = 1.0  # of its logarithm
_UNLIKELY: Final = {
    "theta": 0.0,
    "a": 2.0,
    "d": 2.0,
    "alpha": 4.0,
    "beta": 4.0,
}  # less than a joint's zero, in log odds
_GAIN: Final = 8.0  # of the log evidence, that names a parameter
_MOST: Final = 6
_ANGLE: Final = float(np.deg2rad(2.0))  # links of good arms turn by 0.7°
LIMITS: Final = {"theta": float(np.deg2rad(0.3)), "a": 2.5, "d": 2.5, "alpha": _ANGLE, "beta": _ANGLE}
"""The largest change [rad, mm] of a joint's zero, a length and an angle of a link that needs no explanation."""
_SURE: Final = 2.0  # standard deviations beyond a limit
_SHARED: Final = 2.0  # limits, for a parameter that others explain as well: models that leave out an effect shift them
_SIGMAS: Final = 5.0  # of a wrong sign
_LEAST_RISE_MM: Final = 0.05
_LEAST_LOST: Final = 2e-5  # rad
_KNOWN_MM: Final = 1.0  # standard deviation of a direction in which the reflector is compared
_TOOL_MM: Final = 8.0  # four standard deviations of a tool that was found by touching a tip from four sides
_TIMES_RP: Final = (10.0, 30.0)  # that an arm may leave with errors of single joints in its model, and without
_ENOUGH: Final = 30  # samples; fewer leave large residuals for want of readings
_REMASTERED: Final = (
    "the likeliest cause is a joint that was mastered again, or whose zero in the robot's model is another one"
)
_WRONG_ROW: Final = "the likeliest cause is a wrong row in the D-H table of the robot's model, or another robot"


class Off(NamedTuple):
    """A parameter that is far off: its place among all, its change, and the standard deviation of that, in its unit."""

    place: int
    change: float
    std: float


def judged(error_map: MapData) -> Iterator[Fact]:
    """Return what is wrong with the parameters that the predictor of a map identified."""
    found = _estimated(error_map)
    if found is None:
        yield _reflector_of_readings(error_map)
        return
    off, solved = explained(found)
    yield _reflector(error_map, found, *solved)
    yield from _of_links(found, off)
    yield from _of_reversals(found, *solved)
    yield from _of_load(found, *solved)
    yield from _of_residual(error_map)


def reflector(error_map: MapData) -> Fact:
    """Return whether the readings put the reflector at the stated tool."""
    found = _estimated(error_map)
    return _reflector_of_readings(error_map) if found is None else _reflector(error_map, found, *explained(found)[1])


def _estimated(error_map: MapData) -> ParameterEstimates | None:
    predictor = getattr(error_map.predictor, "calibration_", error_map.predictor)
    return predictor.parameter_estimates() if isinstance(predictor, ParameterEstimating) else None


def explained(found: ParameterEstimates) -> tuple[list[Off], tuple[FloatArray, FloatArray]]:
    """Return the links' parameters that are beyond their limits, and mean (p,) and covariance (p, p) of all parameters.

    Parameters are freed one by one, each the one that raises the evidence most, while it rises enough.
    """
    links = np.isin(found.kinds, [*_UNLIKELY])
    scale = np.where(np.isfinite(found.prior_std), found.prior_std, 1.0)
    scale[links] = [_TOLERANCE[unit] for unit, own in zip(found.units, links, strict=True) if own]
    precision, told = found.information(scale)
    about = np.where(links, 0.0, found.prior_mean / scale)
    told = told - precision @ about
    usual = np.where(np.isfinite(found.prior_std), 1.0, _ANYTHING**2)
    odds = np.array([-_UNLIKELY.get(kind, np.inf) for kind in found.kinds])
    free = np.zeros(len(scale), np.bool_)

    def solved(tolerance: float) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Return log evidence, mean and covariance, and the log evidence if one more parameter is free, (p,)."""
        prior = np.where(free, _ANYTHING**2, np.where(links, tolerance**2, usual))
        root = np.sqrt(prior)
        matrix = np.eye(len(root)) + root[:, None] * precision * root
        covariance = root[:, None] * np.linalg.inv(matrix) * root
        mean = covariance @ told
        pull = 0.5 * (np.log(tolerance) / _SCALE_STD) ** 2
        value = 0.5 * (float(told @ mean) - float(np.linalg.slogdet(matrix)[1])) - pull
        own = np.diag(covariance)
        alone, said = np.maximum(1.0 / own - 1.0 / prior, 0.0), mean / own
        gain = _log_evidence(alone, said, _ANYTHING**2) - _log_evidence(alone, said, prior)
        return value, mean, covariance, value + np.where(free, -np.inf, gain + odds)

    for _ in range(_MOST + 1):
        every = [solved(tolerance) for tolerance in _SCALES.tolist()]
        best = max(every, key=lambda one: one[0])
        freed = np.max([one[3] for one in every], axis=0)
        if free.sum() == _MOST or freed.max(initial=-np.inf) < best[0] + _GAIN:
            break
        free[np.argmax(freed)] = True
    mean, covariance = (about + best[1]) * scale, best[2] * scale[:, None] * scale
    std = np.sqrt(np.diag(covariance))
    limit = np.array([LIMITS.get(kind, np.inf) for kind in found.kinds])
    sure = np.abs(mean) - _SURE * std > limit * np.where(free, 1.0, _SHARED)
    return [Off(int(k), float(mean[k]), float(std[k])) for k in np.flatnonzero(sure & links)], (mean, covariance)


def _log_evidence(precision: FloatArray, told: FloatArray, prior: FloatArray | float) -> FloatArray:
    """Return the log evidence of single parameters for prior variances, from precision and precision times value."""
    return np.asarray(0.5 * (told**2 / (precision + 1.0 / prior) - np.log1p(precision * prior)))


def _of_links(found: ParameterEstimates, off: list[Off]) -> Iterator[Fact]:
    for place, change, std in off:
        name, kind, unit = found.names[place], found.kinds[place], found.units[place]
        number = name[len(kind) :]
        if kind == "theta":
            words = f"joint {number}: {_degrees(change, std)} away from its zero ({name}); {_REMASTERED}"
            yield Fact("joint-zero", words, "fit", float(np.rad2deg(change)), float(np.rad2deg(std)), "deg")
        elif unit == "rad":
            words = f"link {number}: {kind} is off by {_degrees(change, std)}; {_WRONG_ROW}"
            yield Fact("link-off", words, "fit", float(np.rad2deg(change)), float(np.rad2deg(std)), "deg")
        else:
            words = f"link {number}: the length {name} is off by {_signed(change)} mm ± {std:.3f} mm; {_WRONG_ROW}"
            yield Fact("link-off", words, "fit", change, std, "mm")


def _of_reversals(found: ParameterEstimates, mean: FloatArray, covariance: FloatArray) -> Iterator[Fact]:
    """Find lost motion of the wrong sign: a joint that lags stops before its target, on the side it comes from."""
    own = [k for k, kind in enumerate(found.kinds) if kind == "backlash"]
    std = np.sqrt(np.diag(covariance))
    wrong = [k for k in own if mean[k] > max(_SIGMAS * std[k], _LEAST_LOST)]
    if not wrong:
        return
    listed = ", ".join(
        f"joint {found.names[k].rpartition('q')[2]} {_degrees(-2.0 * mean[k], 2.0 * std[k], 4)}" for k in wrong
    )
    worst = max(wrong, key=lambda k: mean[k] / std[k])
    words = (
        f"lost motion is negative, which no gear can have: {listed}; the likeliest cause are directions of approach of "
        "the wrong sign"
    )
    size, of_size = (float(np.rad2deg(2.0 * value)) for value in (-mean[worst], std[worst]))
    yield Fact("negative-lost-motion", words, "fit", size, of_size, "deg")


def _of_load(found: ParameterEstimates, mean: FloatArray, covariance: FloatArray) -> Iterator[Fact]:
    """Find compliance of the wrong sign: payloads under which the arm rises, joints that turn against gravity."""
    if found.rise is not None and found.rise.any():
        each = found.rise @ mean
        whole = found.rise.sum(axis=0)
        size, std = float(whole @ mean), float(np.sqrt(whole @ covariance @ whole))
        if size > max(_SIGMAS * std, _LEAST_RISE_MM):
            joint = int(np.argmax(each)) + 1
            words = (
                f"the arm rises under its payload, by {size:.3f} mm ± {std:.3f} mm in the mean, most by joint {joint}: "
                "no arm does; the likeliest cause are payloads of other rows (load_kg)"
            )
            yield Fact("rises-under-load", words, "fit", size, std, "mm")
    own = [k for k, kind in enumerate(found.kinds) if kind == "compliance" and found.units[k] == "rad/Nm"]
    std_of = np.sqrt(np.diag(covariance))
    wrong = [k for k in own if mean[k] < -_SIGMAS * std_of[k]]
    if wrong:
        k = min(wrong, key=lambda one: mean[one] / std_of[one])
        words = (
            f"joint {found.names[k].rpartition('q')[2]} turns against gravity, by {_signed(1e6 * mean[k])} µrad/Nm ± "
            f"{1e6 * std_of[k]:.3f} µrad/Nm: no joint does; the likeliest cause is a wrong payload, or a base that "
            "does not stand upright"
        )
        yield Fact("rises-under-load", words, "fit", 1e6 * float(mean[k]), 1e6 * float(std_of[k]), "µrad/Nm")


def _reflector(error_map: MapData, found: ParameterEstimates, mean: FloatArray, covariance: FloatArray) -> Fact:
    """Compare the reflector with the stated tool, in the directions that the samples determine."""
    own = [k for k, kind in enumerate(found.kinds) if kind == "tool" and found.units[k] == "mm"]
    variance, axes = np.linalg.eigh(covariance[np.ix_(own, own)])
    told = variance < _KNOWN_MM**2
    if error_map.tool_fitted or not told.any():
        return _unchecked(error_map)
    away = axes.T[told] @ mean[own]
    return _of_distance(float(np.linalg.norm(away)), float(np.sqrt(np.maximum(variance[told], 0.0).sum())))


def _reflector_of_readings(error_map: MapData) -> Fact:
    """Compare the tool that fits the readings of the nominal arm best with the stated one."""
    found = tool_estimate(error_map.cell, error_map.robot, error_map.samples)
    if found is None or (std := float(np.linalg.norm(found.std_mm))) >= _KNOWN_MM:
        return _unchecked(error_map)
    return _of_distance(found.distance_mm, std)


def _of_distance(away: float, std: float) -> Fact:
    where = f"the readings put the reflector {away:.2f} mm ± {std:.2f} mm from the stated tool"
    if away < max(_SIGMAS * std, _TOOL_MM):
        return Fact("reflector-checked", where, "fit", away, std, "mm")
    words = (
        f"{where}, {away / max(std, 1e-3):.0f} times its error, more than the {_TOOL_MM:g} mm by which a stated tool "
        "may be off: corrections would bring the reflector to the targets, not the tool"
    )
    return Fact("reflector-off", words, "fit", away, std, "mm")


def _unchecked(error_map: MapData) -> Fact:
    why = "it was fitted" if error_map.tool_fitted else "the samples do not tell the tool from the station"
    return Fact("reflector-not-checked", f"whether the reflector sits at the stated tool was not checked: {why}", "fit")


def _of_residual(error_map: MapData) -> Iterator[Fact]:
    known = Repeatability.of(error_map.cell, error_map.robot)
    repeats = max(known.usual or USUAL_RP_MM, known.known or 0.0)
    times = _TIMES_RP[0 if isinstance(error_map.predictor, JointwisePredicting) else 1]
    left = np.linalg.norm(error_map.predictor.leave_one_out().residual, axis=1)
    if len(left) < _ENOUGH or (typical := float(np.median(left))) <= times * repeats:
        return
    words = (
        f"the identified arm leaves {typical:.3f} mm (median) at its own samples, more than {times:g} times what "
        f"such a robot repeats ({repeats:g} mm); the likeliest cause is another robot than the model's, or a "
        "column of another row"
    )
    yield Fact("unexplained", words, "fit", typical, None, "mm")


def _signed(value: float, digits: int = 3) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def _degrees(change: float, std: float, digits: int = 3) -> str:
    return f"{_signed(float(np.rad2deg(change)), digits).removeprefix('+')}° ± {np.rad2deg(std):.{digits}f}°"
