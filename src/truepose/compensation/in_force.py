"""Combine the limits in force for a correction, each with its origin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Self

import numpy as np

from truepose.compensation.guards import Limits, Policy
from truepose.errors import DataError

_UNITS: Final = {"_mm": 1.0, "_mrad": 1e-3, "_deg": float(np.deg2rad(1.0))}
_DISTANCE: Final = {"cartesian": "max_distance_mm", "joint": "max_distance_deg"}


@dataclass(frozen=True)
class LimitsInForce:
    """The settings of ``[correction]`` that hold for one correction, with their origin.

    Attributes
    ----------
    values : mapping of str to float, str or None
        The values by the keys of ``[correction]``, in the units of the keys; None for a limit not stated or found yet.
    origin : mapping of str to str
        The origin of each value: ``default``, ``map``, ``cell file`` or ``option``; a default that depends on the
        samples says how it was found.
    """

    values: Mapping[str, Any]
    origin: Mapping[str, str]

    @classmethod
    def of(cls, *stated: tuple[str, Mapping[str, Any]], space: str = "cartesian") -> Self:
        """Combine settings of several origins, the weakest first; a later origin replaces only its own keys.

        Parameters
        ----------
        *stated : (str, mapping)
            An origin and its keys of ``[correction]``. None counts as not stated.
        space : {"cartesian", "joint"}
            The space of the map, which determines the unit of distances to samples (mm or degrees).

        Raises
        ------
        DataError
            If only the distance of the other space is stated, which has no effect.
        """
        values: dict[str, Any] = {}
        origin: dict[str, str] = {}
        for name, settings in stated:
            for key, value in settings.items():
                if value is not None or key not in values:
                    values[key], origin[key] = value, name
        mine = _DISTANCE[space]
        for other in set(_DISTANCE.values()) & set(values) - {mine}:
            if values[other] is not None and values.get(mine) is None:
                raise DataError(
                    f"[correction] {other} ({origin[other]}) has no effect on a map in {space} space; write {mine}"
                )
            del values[other], origin[other]
        return cls(values, origin)

    @property
    def limits(self) -> Limits:
        """The limits in mm and rad."""
        known = {field.name for field in fields(Limits)}
        found = {}
        for key, value in self.values.items():
            name, factor = _in_base_units(key)
            if name in known and value is not None:
                found[name] = value * factor
        return Limits(**found)

    @property
    def on_guard(self) -> Policy:
        """The treatment of targets with a reason, see `apply_policy`."""
        policy: Policy = self.values["on_guard"]
        return policy

    def with_found(self, found: Mapping[str, tuple[float, str]]) -> Self:
        """Return these settings with limits found from the samples, (value, how), for keys without a stated value."""
        new = {key: pair for key, pair in found.items() if self.values.get(key) is None}
        values = {key: value for key, (value, _) in new.items()}
        origin = {key: f"default: {how}" for key, (_, how) in new.items()}
        return replace(self, values={**self.values, **values}, origin={**self.origin, **origin})

    def at_most(self, key: str, value: float, how: str) -> Self:
        """Return these settings with one of them limited to a value found from the samples."""
        stated = self.values.get(key)
        if stated is not None and stated <= value:
            return self
        return replace(self, values={**self.values, key: value}, origin={**self.origin, key: f"default: {how}"})

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return the value and origin of each setting by its key, for JSON."""
        return {key: {"value": value, "origin": self.origin[key]} for key, value in self.values.items()}

    def sentence(self) -> str:
        """Return all settings in one line, each with its origin."""
        stated = {key: value for key, value in self.values.items() if value is not None}
        return ", ".join(f"{key} {_shown(value)} ({self.origin[key]})" for key, value in stated.items())


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _in_base_units(key: str) -> tuple[str, float]:
    """Return a key without its unit, and the factor to mm or rad."""
    for unit, factor in _UNITS.items():
        if key.endswith(unit):
            return key.removesuffix(unit), factor
    return key, 1.0
