"""The predictors by the names that the command line and map files use."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from truepose.errors import DataError
from truepose.predictors.base import Predictor
from truepose.predictors.inverse_distance import InverseDistance
from truepose.predictors.kriging import OrdinaryKriging, UniversalKriging
from truepose.predictors.local_kriging import LocalKriging
from truepose.predictors.nearest import GridCell, Nearest
from truepose.predictors.radial_basis import RadialBasis
from truepose.predictors.registration_only import RegistrationOnly
from truepose.predictors.vecchia import VecchiaKriging
from truepose.predictors.vector_kriging import VectorKriging


@dataclass(frozen=True)
class Named:
    """A predictor with a name.

    Attributes
    ----------
    family : type
    space : {"cartesian", "joint"}
        What it takes: commanded positions [mm], or joints [rad].
    """

    family: type[Predictor]
    space: Literal["cartesian", "joint"] = "cartesian"


PREDICTORS: Final[dict[str, Named]] = {
    "registration": Named(RegistrationOnly),
    "idw": Named(InverseDistance),
    "idw-joint": Named(InverseDistance, "joint"),
    "ordinary-kriging": Named(OrdinaryKriging),
    "ordinary-kriging-joint": Named(OrdinaryKriging, "joint"),
    "universal-kriging": Named(UniversalKriging),
    "universal-kriging-joint": Named(UniversalKriging, "joint"),
    "vector-kriging": Named(VectorKriging),
    "vector-kriging-joint": Named(VectorKriging, "joint"),
    "local-kriging": Named(LocalKriging),
    "local-kriging-joint": Named(LocalKriging, "joint"),
    "vecchia-kriging": Named(VecchiaKriging),
    "vecchia-kriging-joint": Named(VecchiaKriging, "joint"),
    "radial-basis": Named(RadialBasis),
    "radial-basis-joint": Named(RadialBasis, "joint"),
    "grid-cell": Named(GridCell),
    "nearest": Named(Nearest),
    "nearest-joint": Named(Nearest, "joint"),
}
"""All predictors by name."""


def make_predictor(name: str, parameters: Mapping[str, Any] | None = None) -> Predictor:
    """Return an unfitted predictor.

    Parameters
    ----------
    name : str
        A key of `PREDICTORS`.
    parameters : mapping, optional
        As `Predictor.to_json` gives them.

    Raises
    ------
    DataError
        If there is no such predictor, with the nearest names.
    """
    if name not in PREDICTORS:
        near = difflib.get_close_matches(name, [*PREDICTORS, "auto"], n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise DataError(f"no predictor {name!r}; {hint}there are: auto, {', '.join(PREDICTORS)}")
    return PREDICTORS[name].family.from_json(parameters or {})
