"""The predictors by the names that the command line and map files use."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from truepose.errors import DataError
from truepose.predictors.base import Predictor
from truepose.predictors.baselines.inverse_distance import InverseDistance
from truepose.predictors.baselines.nearest import GridCell, Nearest
from truepose.predictors.baselines.radial_basis import RadialBasis
from truepose.predictors.baselines.registration_only import RegistrationOnly
from truepose.predictors.calibration import KinematicCalibration
from truepose.predictors.kinematic import KinematicKriging
from truepose.predictors.kriging.local import LocalKriging
from truepose.predictors.kriging.ordinary import OrdinaryKriging, UniversalKriging
from truepose.predictors.kriging.vecchia import VecchiaKriging
from truepose.predictors.kriging.vector import VectorKriging
from truepose.predictors.residual_network import ResidualNetwork
from truepose.robots import Robot


@dataclass(frozen=True)
class PredictorSpec:
    """A predictor with a name.

    Attributes
    ----------
    family : type
    space : {"cartesian", "joint"}
        What it takes: commanded positions [mm], or joints [rad].
    defaults : mapping
        Parameters that the name stands for.
    """

    family: type[Predictor]
    space: Literal["cartesian", "joint"] = "cartesian"
    defaults: Mapping[str, Any] = field(default_factory=dict)


PREDICTORS: Final[dict[str, PredictorSpec]] = {
    "registration": PredictorSpec(RegistrationOnly),
    "idw": PredictorSpec(InverseDistance),
    "idw-joint": PredictorSpec(InverseDistance, "joint"),
    "ordinary-kriging": PredictorSpec(OrdinaryKriging),
    "ordinary-kriging-joint": PredictorSpec(OrdinaryKriging, "joint"),
    "universal-kriging": PredictorSpec(UniversalKriging),
    "universal-kriging-joint": PredictorSpec(UniversalKriging, "joint"),
    "vector-kriging": PredictorSpec(VectorKriging),
    "vector-kriging-joint": PredictorSpec(VectorKriging, "joint"),
    "local-kriging": PredictorSpec(LocalKriging),
    "local-kriging-joint": PredictorSpec(LocalKriging, "joint"),
    "vecchia-kriging": PredictorSpec(VecchiaKriging),
    "vecchia-kriging-joint": PredictorSpec(VecchiaKriging, "joint"),
    "radial-basis": PredictorSpec(RadialBasis),
    "radial-basis-joint": PredictorSpec(RadialBasis, "joint"),
    "grid-cell": PredictorSpec(GridCell),
    "nearest": PredictorSpec(Nearest),
    "nearest-joint": PredictorSpec(Nearest, "joint"),
    "kinematic-kriging": PredictorSpec(KinematicKriging, "joint"),
    "kinematic-kriging-cartesian": PredictorSpec(KinematicKriging, "joint", {"residual": "cartesian"}),
    "kinematic-kriging-both": PredictorSpec(KinematicKriging, "joint", {"residual": "both"}),
    "kinematic-kriging-no-rest": PredictorSpec(KinematicKriging, "joint", {"residual": "none"}),
    "kinematic-kriging-no-joints": PredictorSpec(KinematicKriging, "joint", {"joint_errors": False}),
    "kinematic-kriging-no-compliance": PredictorSpec(KinematicKriging, "joint", {"compliance": False}),
    "kinematic-kriging-no-geometry": PredictorSpec(KinematicKriging, "joint", {"geometry": False, "compliance": False}),
    "calibration": PredictorSpec(KinematicCalibration, "joint"),
    "calibration-dh": PredictorSpec(KinematicCalibration, "joint", {"convention": "dh"}),
    "calibration-cpc": PredictorSpec(KinematicCalibration, "joint", {"convention": "cpc"}),
    "calibration-poe": PredictorSpec(KinematicCalibration, "joint", {"convention": "poe"}),
    "calibration-ls": PredictorSpec(KinematicCalibration, "joint", {"method": "ls"}),
    "calibration-ekf": PredictorSpec(KinematicCalibration, "joint", {"method": "ekf"}),
    "calibration-ukf": PredictorSpec(KinematicCalibration, "joint", {"method": "ukf"}),
    "calibration-harmonics": PredictorSpec(KinematicCalibration, "joint", {"terms": ("sin1", "cos1")}),
    "calibration-compliance": PredictorSpec(KinematicCalibration, "joint", {"terms": ("compliance",)}),
    "calibration-network": PredictorSpec(ResidualNetwork, "joint", {"terms": ("sin1", "cos1")}),
}
"""All predictors by name."""


@dataclass(frozen=True, eq=False)
class ArmContext:
    """What a predictor may need to know of the arm whose errors it predicts.

    Attributes
    ----------
    robot : Robot
        Nominal.
    tf_flange_tool : (4, 4) array [mm]
        The measured point.
    payload : tuple of 4 float, optional
        Mass [kg] and centre x, y, z [mm], flange frame.
    """

    robot: Robot
    tf_flange_tool: NDArray[np.float64]
    payload: tuple[float, float, float, float] | None = None


def check_name(name: str) -> None:
    """Refuse a name that is not a key of `PREDICTORS`.

    Raises
    ------
    DataError
        With the nearest name, and all that there are.
    """
    if name not in PREDICTORS:
        near = difflib.get_close_matches(name, [*PREDICTORS, "auto"], n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise DataError(f"no predictor {name!r}; {hint}there are: auto, {', '.join(PREDICTORS)}")


def make_predictor(name: str, parameters: Mapping[str, Any] | None = None, arm: ArmContext | None = None) -> Predictor:
    """Return an unfitted predictor.

    Parameters
    ----------
    name : str
        A key of `PREDICTORS`.
    parameters : mapping, optional
        As `Predictor.to_dict` gives them.
    arm : ArmContext, optional
        For those that know the arm.

    Raises
    ------
    DataError
        If there is no such predictor, with the nearest names.
    """
    check_name(name)
    named = PREDICTORS[name]
    if named.family.arm_parameters and arm is None:
        raise DataError(f"predictor {name!r} needs to know the arm: its robot and tool")
    arm_parameters = {key: getattr(arm, key) for key in named.family.arm_parameters}
    return named.family.from_dict({**named.defaults, **(parameters or {}), **arm_parameters})
