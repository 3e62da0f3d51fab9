"""Make predictors by name, as the command line and map files do.

A name may carry options, which are parameters of the predictor's class: ``calibration:method=ekf``,
``kinematic-kriging:geometry=no:compliance=no``, ``idw:space=joint:power=3``.
"""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.predictors.base import Predictor
from truepose.predictors.baselines import GridCell, InverseDistance, Nearest, RadialBasis, RegistrationOnly
from truepose.predictors.calibration import KinematicCalibration
from truepose.predictors.conditions import CONDITIONS
from truepose.predictors.distances import DistanceRows
from truepose.predictors.kinematic import KinematicKriging
from truepose.predictors.kriging.neighbours import LocalKriging
from truepose.predictors.kriging.ordinary import OrdinaryKriging, UniversalKriging
from truepose.predictors.kriging.vecchia import VecchiaKriging
from truepose.predictors.kriging.vector import VectorKriging
from truepose.predictors.reflectors import Reflectors
from truepose.predictors.residual_network import ResidualNetwork
from truepose.robots import Robot


@dataclass(frozen=True)
class PredictorSpec:
    """The class, coordinates and parameters that a name stands for.

    Attributes
    ----------
    family : type
        The class of the predictor.
    space : {"cartesian", "joint"}
        The predictor's input: commanded positions [mm] or joints [rad].
    defaults : mapping
        The parameters that the name sets.
    """

    family: type[Predictor]
    space: Literal["cartesian", "joint"] = "cartesian"
    defaults: Mapping[str, Any] = field(default_factory=dict)

    @property
    def options(self) -> dict[str, Any]:
        """Parameters that a name may set, with their default values; fitted values and the arm are not among them."""
        known = inspect.signature(self.family).parameters.values()
        simple = [p for p in known if p.name not in self.family.arm_parameters and _kind(p) is not None]
        return {p.name: self.defaults.get(p.name, p.default) for p in simple}

    def with_option(self, name: str, option: str) -> PredictorSpec:
        """Return the specification with one option ``key=value``; errors cite `name`."""
        key, equals, text = option.partition("=")
        if key == "space" and equals and not self.family.arm_parameters:
            if text not in ("cartesian", "joint"):
                raise DataError(f"predictor {name!r}: space is {text!r}; expected cartesian or joint")
            return replace(self, space="joint" if text == "joint" else "cartesian")
        if not equals or key not in self.options:
            known = [*([] if self.family.arm_parameters else ["space"]), *self.options]
            what = f"has no option {key!r}" if equals else f"has the option {option!r} without a value"
            hint = _nearest(key, known)
            raise DataError(f"predictor {name!r} {what}; {hint}write key=value with a key of: {', '.join(known)}")
        kind = _kind(inspect.signature(self.family).parameters[key])
        try:
            value = _READERS[kind or "str"](text)
        except (KeyError, ValueError):
            raise DataError(f"predictor {name!r}: {key} is {text!r}; expected {_EXPECTED[kind or 'str']}") from None
        return replace(self, defaults={**self.defaults, key: value})


PREDICTORS: Final[dict[str, PredictorSpec]] = {
    "registration": PredictorSpec(RegistrationOnly),
    "nearest": PredictorSpec(Nearest),
    "idw": PredictorSpec(InverseDistance),
    "radial-basis": PredictorSpec(RadialBasis),
    "grid-cell": PredictorSpec(GridCell),
    "ordinary-kriging": PredictorSpec(OrdinaryKriging),
    "ordinary-kriging-joint": PredictorSpec(OrdinaryKriging, "joint"),
    "universal-kriging": PredictorSpec(UniversalKriging),
    "vector-kriging": PredictorSpec(VectorKriging),
    "local-kriging": PredictorSpec(LocalKriging),
    "local-kriging-joint": PredictorSpec(LocalKriging, "joint"),
    "vecchia-kriging": PredictorSpec(VecchiaKriging),
    "calibration": PredictorSpec(KinematicCalibration, "joint"),
    "calibration-network": PredictorSpec(ResidualNetwork, "joint", {"terms": ("sin1", "cos1")}),
    "kinematic-kriging": PredictorSpec(KinematicKriging, "joint"),
}
"""All predictors by name."""

FORMER_NAMES: Final[dict[str, str]] = {
    "idw-joint": "idw:space=joint",
    "universal-kriging-joint": "universal-kriging:space=joint",
    "vector-kriging-joint": "vector-kriging:space=joint",
    "vecchia-kriging-joint": "vecchia-kriging:space=joint",
    "radial-basis-joint": "radial-basis:space=joint",
    "nearest-joint": "nearest:space=joint",
    "kinematic-kriging-cartesian": "kinematic-kriging:residual=cartesian",
    "kinematic-kriging-both": "kinematic-kriging:residual=both",
    "kinematic-kriging-no-rest": "kinematic-kriging:residual=none",
    "kinematic-kriging-no-joints": "kinematic-kriging:joint_errors=no",
    "kinematic-kriging-no-compliance": "kinematic-kriging:compliance=no",
    "kinematic-kriging-no-geometry": "kinematic-kriging:geometry=no:compliance=no",
    "calibration-dh": "calibration:convention=dh",
    "calibration-cpc": "calibration:convention=cpc",
    "calibration-poe": "calibration:convention=poe",
    "calibration-ls": "calibration:method=ls",
    "calibration-ekf": "calibration:method=ekf",
    "calibration-ukf": "calibration:method=ukf",
    "calibration-harmonics": "calibration:terms=sin1+cos1",
    "calibration-compliance": "calibration:terms=compliance",
}
"""Names that maps of version 0.1 may have, with the names that replace them."""

LATER_PARAMETERS: Final[dict[str, Any]] = {
    "backlash_shape": False,
    "conditions": [],
    "distances": False,
    "fleet": None,
    "gear_harmonics": False,
    "reference": None,
    "registration": None,
    "single_variance": False,
}
"""Parameters that maps of version 0.2 lack, with the values that leave a predictor as it was then."""

LARGEST_GLOBAL: Final = 5000
"""Number of samples beyond which `for_many` replaces Kriging from all samples, whose fit takes O(n³) time."""

_TRUTH: Final = {"yes": True, "true": True, "no": False, "false": False}
_READERS: Final[dict[str, Any]] = {
    "bool": lambda text: _TRUTH[text.lower()],
    "int": int,
    "float": float,
    "str": str,
    "Sequence[str]": lambda text: tuple(part for part in text.split("+") if part),
}
_EXPECTED: Final = {"bool": "yes or no", "int": "an integer", "float": "a number", "str": "a word"}


@dataclass(frozen=True, eq=False)
class ArmContext:
    """The arm whose errors a predictor predicts.

    Attributes
    ----------
    robot : Robot
        The nominal robot.
    tf_flange_tool : (4, 4) array [mm]
        The measured point.
    payload : tuple of 4 float, optional
        The mass [kg] and its centre x, y, z [mm], flange frame.
    work : mapping of str to float
        The ``temperature`` [°C] and the ``payload`` [kg] at work, where stated.
    reflectors : Reflectors, optional
        The reflectors on the tool, where the cell states them.
    fleet : mapping, optional
        What other robots of the type say, see `truepose.predictors.kinematic.fleet.Fleet`, for new fits.
    distance_rows : DistanceRows, optional
        The distances of the samples of a stored fit.
    """

    robot: Robot
    tf_flange_tool: FloatArray
    payload: tuple[float, float, float, float] | None = None
    work: Mapping[str, float] = field(default_factory=dict)
    reflectors: Reflectors | None = None
    fleet: Mapping[str, Any] | None = None
    distance_rows: DistanceRows | None = None


def predictor_spec(name: str) -> PredictorSpec:
    """Return the specification of a name with its options.

    Parameters
    ----------
    name : str
        A key of `PREDICTORS`, with options as ``name:key=value:key=value``. Values of a sequence are joined by ``+``.

    Raises
    ------
    DataError
        If there is no such predictor or option, with the nearest name and all names.

    Examples
    --------
    >>> predictor_spec("calibration:method=ekf:terms=sin1+cos1").defaults
    {'method': 'ekf', 'terms': ('sin1', 'cos1')}
    """
    if name in FORMER_NAMES:
        raise DataError(f"predictor {name!r} is now an option of its class; write {FORMER_NAMES[name]}")
    base, *options = name.split(":")
    if base not in PREDICTORS:
        known = ["auto", *PREDICTORS]
        raise DataError(f"no predictor {base!r}; {_nearest(base, known)}expected one of: {', '.join(known)}")
    spec = PREDICTORS[base]
    for option in options:
        spec = spec.with_option(name, option)
    return spec


def conditions_wanted(name: str) -> tuple[str, ...]:
    """Return the conditions that a named predictor uses where samples state them, see `truepose.predictors.conditions`.

    Examples
    --------
    >>> conditions_wanted("kinematic-kriging:conditions=approach"), conditions_wanted("idw")
    (('approach',), ())
    >>> "payload" in conditions_wanted("kinematic-kriging:compliance=no")
    False
    """
    spec = predictor_spec(name)
    if not (spec.family.takes_conditions and "conditions" in spec.options):
        return ()
    wanted = tuple(spec.defaults.get("conditions", CONDITIONS))
    stiff = spec.defaults.get("compliance") is False  # payloads act through compliance
    return tuple(one for one in wanted if not (stiff and one in ("payload", "centre")))


def for_many(name: str, n: int) -> str:
    """Return the name of the predictor to fit to n samples: beyond 5,000, Vecchia's approximation of global Kriging.

    Parameters
    ----------
    name : str
        The name, see `predictor_spec`.
    n : int
        The number of samples.

    Examples
    --------
    >>> for_many("ordinary-kriging-joint", 5000), for_many("ordinary-kriging-joint", 5001)
    ('ordinary-kriging-joint', 'vecchia-kriging:space=joint')
    >>> for_many("universal-kriging:drift=quadratic:exact=yes", 20_000)
    'vecchia-kriging:drift=quadratic:exact=yes'
    """
    spec = predictor_spec(name)
    if n <= LARGEST_GLOBAL or spec.family not in (OrdinaryKriging, UniversalKriging):
        return name
    given = {**({"drift": "linear"} if spec.family is UniversalKriging else {}), **spec.defaults}
    given.pop("single_variance", None)  # no product of that size is left
    if spec.space == "joint":
        given["space"] = "joint"
    words = {True: "yes", False: "no"}
    return ":".join(["vecchia-kriging", *(f"{key}={words.get(value, value)}" for key, value in given.items())])


def make_predictor(name: str, parameters: Mapping[str, Any] | None = None, arm: ArmContext | None = None) -> Predictor:
    """Return an unfitted predictor.

    Parameters
    ----------
    name : str
        The name, see `predictor_spec`.
    parameters : mapping, optional
        The parameters, as `Predictor.to_dict` returns them.
    arm : ArmContext, optional
        The arm, for predictors that need it.

    Raises
    ------
    DataError
        If there is no such predictor, or it needs the arm and got none.

    Examples
    --------
    >>> make_predictor("idw:power=3")
    InverseDistance(power=3.0)
    """
    spec = predictor_spec(name)
    if spec.family.arm_parameters and arm is None:
        raise DataError(f"predictor {name!r} needs the arm: its robot and tool")
    given = {key: getattr(arm, key) for key in spec.family.arm_parameters}
    if arm is not None and arm.fleet is not None and issubclass(spec.family, KinematicKriging):
        given["fleet"] = arm.fleet
    return spec.family.from_dict({**spec.defaults, **(parameters or {}), **given})


def _kind(parameter: inspect.Parameter) -> str | None:
    """Return the type of an option's value; None for parameters that a name cannot set, such as fitted values."""
    if isinstance(parameter.default, str):  # also of literal types
        return "str"
    kind = str(parameter.annotation).removesuffix(" | None")
    fitted = kind == "float" and parameter.default is None
    return kind if kind in _READERS and not fitted else None


def _nearest(name: str, known: Iterable[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]!r}? " if near else ""
