"""Conditions of a configuration other than its joints, as further columns of a predictor's input.

A predictor's input is X = [q, conditions]: the joints, then the columns of each condition in order. A value that is not
known is NaN: the prediction is then the mean over what it may be, and its standard deviation includes the difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.predictors.reflectors import REFLECTOR

CONDITIONS: Final = ("approach", "temperature", "payload", "centre", "time", "orientation")
"""The names of the conditions.

``approach``, the sign of each joint's last motion (n, dof); ``temperature`` [°C], ``payload`` [kg] and ``time`` [s],
(n,); ``centre`` (n, 3) [mm], the payload's centre of mass in the flange frame. The time is that of the samples alone,
for a station that moves slowly while they are measured: predictions are for its mean station. ``orientation`` (n, 6)
[rad] is no condition but a further reading at a sample: the rotation vector of R_meas R_cmdᵀ in the base frame and its
standard deviation; predictions do not look at it.
"""

_LEAST_RANGE: Final = 2.0  # K
_SAMPLES_PER_STEP: Final = 8  # of the station's walk
_MOST_STEPS: Final = 12


def width(condition: str, dof: int) -> int:
    """Return the number of columns of a condition; the reflector has its number and the visit to the pose."""
    return {"approach": dof, "centre": 3, REFLECTOR: 2, "orientation": 6}.get(condition, 1)


def joined(q: FloatArray, names: Sequence[str], given: Mapping[str, FloatArray | None]) -> FloatArray:
    """Return a predictor's input, (n, d): the joints (n, dof) [rad], then the named conditions; NaN where not given.

    Examples
    --------
    >>> joined(np.zeros((1, 2)), ["approach"], {"approach": np.array([[1.0, -1.0]])})
    array([[ 0.,  0.,  1., -1.]])
    """
    n, dof = q.shape
    columns = [q]
    for name in names:
        values = given.get(name)
        columns.append(np.full((n, width(name, dof)), np.nan) if values is None else values.reshape(n, -1))
    return np.concatenate(columns, axis=1)


def separated(X: FloatArray, names: Sequence[str], dof: int) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the joints (n, dof) [rad] and the columns of each condition; without them, all conditions are unknown.

    Raises
    ------
    DataError
        If X has another number of columns, an approach is none of −1, 0 and 1, or a temperature or payload cannot be.
    """
    if X.shape[1] == dof:
        X = joined(X, names, {})
    edges = np.cumsum([dof, *(width(name, dof) for name in names)])
    if X.shape[1] != edges[-1]:
        more = "".join(f" and {width(name, dof)} of {name}" for name in names)
        raise DataError(f"X has {X.shape[1]} columns; expected {dof} joints [rad]{more}")
    found = dict(zip(names, np.split(X, edges[:-1], axis=1)[1:], strict=True))
    if "approach" in found:
        signs = found["approach"]
        wrong = np.flatnonzero(~(np.isnan(signs) | np.isin(signs, (-1.0, 0.0, 1.0))).all(axis=1))
        if len(wrong):
            raise DataError(f"approach is {signs[wrong[0]].tolist()} in row {wrong[0]}; expected -1, 0 or 1")
        found["approach"] = np.where(np.isnan(signs), 0.0, signs)
    for name in ("temperature", "payload"):
        if name in found:
            check_condition(name, found[name])
    return X[:, :dof], found


def check_condition(name: str, values: ArrayLike) -> None:
    """Refuse temperatures [°C] and payloads [kg] that cannot be; NaN is one that is not known.

    Raises
    ------
    DataError
        If one is infinite, or a payload is negative.

    Examples
    --------
    >>> check_condition("payload", [0.0, np.nan])
    """
    given = np.asarray(values, float)
    wrong = given[np.isinf(given) | ((given < 0.0) if name == "payload" else False)]
    if wrong.size:
        expected = "0 kg or more" if name == "payload" else "a temperature in °C"
        raise DataError(f"{name} is {wrong.flat[0]:g}; expected {expected}")


def checked_work(work: Mapping[str, float]) -> dict[str, float]:
    """Return the conditions at work, each a finite number that can be; see `check_condition`."""
    for name, value in work.items():
        check_condition(name, np.inf if np.isnan(value) else value)
    return dict(work)


@dataclass(frozen=True)
class Usual:
    """What conditions are where they are not known: as in the samples.

    Attributes
    ----------
    temperature, temperature_std : float [°C], [K]
        The mean of the samples' temperatures, and the standard deviation of one that is not known: their range, at
        least 2 K, because an arm that warmed up during the measurement goes on to do so.
    payload, largest_payload, payload_std : float [kg]
        The mean and the largest of the samples' payloads, and the standard deviation of one that is not known: that of
        a uniform distribution over their range.
    centre, centre_std : tuple of float [mm], flange frame
        The mean of the centres of mass, and the standard deviation of one that is not known, in the same way.
    times, passed : tuple of float [s], [1]
        The times between which the station moves evenly, quantiles of the samples' times; and the mean share of each
        step of its walk that samples have passed.
    """

    temperature: float = 20.0
    temperature_std: float = 0.0
    payload: float = 0.0
    largest_payload: float = 1.0
    payload_std: float = 0.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    centre_std: tuple[float, float, float] = (0.0, 0.0, 0.0)
    times: tuple[float, ...] = (0.0, 1.0)
    passed: tuple[float, ...] = (0.0,)

    @classmethod
    def of(cls, X: FloatArray, names: Sequence[str], dof: int) -> Self:
        """Return the usual conditions of samples (n, d)."""
        found: dict[str, Any] = {}
        given = separated(X, names, dof)[1]
        if "temperature" in given and np.isfinite(given["temperature"]).any():
            found["temperature"] = float(np.nanmean(given["temperature"]))
            low, high = float(np.nanmin(given["temperature"])), float(np.nanmax(given["temperature"]))
            found["temperature_std"] = max(high - low, _LEAST_RANGE)
        if "payload" in given and np.isfinite(given["payload"]).any():
            found["payload"] = float(np.nanmean(given["payload"]))
            found["largest_payload"] = max(float(np.nanmax(given["payload"])), 1.0)
            found["payload_std"] = float(_uniform_std(given["payload"])[0])
        if "centre" in given and np.isfinite(given["centre"]).any():
            found["centre"] = tuple(np.nanmean(given["centre"], axis=0).tolist())
            found["centre_std"] = tuple(_uniform_std(given["centre"]).tolist())
        if "time" in given and np.ptp(known := given["time"][np.isfinite(given["time"])]) > 0.0:
            steps = int(np.clip(len(known) // _SAMPLES_PER_STEP, 1, _MOST_STEPS))
            found["times"] = tuple(np.unique(np.quantile(known, np.linspace(0.0, 1.0, steps + 1))).tolist())
            found["passed"] = tuple(_shares(known, found["times"]).mean(axis=0).tolist())
        return cls(**found)

    @property
    def reference(self) -> dict[str, Any]:
        """What the coefficients of effects refer to, as plain values: it stays when samples are added to a fit."""
        kept = {"temperature": self.temperature, "payload": self.payload, "largest_payload": self.largest_payload}
        return {**kept, "centre": list(self.centre)}

    def referred(self, reference: Mapping[str, Any]) -> Self:
        """Return the usual conditions with the `reference` of others."""
        return replace(self, **{**reference, "centre": tuple(reference["centre"])})

    def walked(self, time: FloatArray) -> FloatArray:
        """Return the share of each step of the station's walk at times (n,) [s], less the mean; 0 where not known."""
        return np.where(np.isnan(time)[:, None], 0.0, _shares(time, self.times) - self.passed)


def _uniform_std(values: FloatArray) -> FloatArray:
    """Return the standard deviation of a uniform distribution over the range of each column (n, k), (k,)."""
    return np.asarray((np.nanmax(values, axis=0) - np.nanmin(values, axis=0)) / np.sqrt(12.0))


def _shares(time: FloatArray, times: Sequence[float]) -> FloatArray:
    return np.asarray(np.clip((time[:, None] - np.array(times[:-1])) / np.diff(times), 0.0, 1.0))
