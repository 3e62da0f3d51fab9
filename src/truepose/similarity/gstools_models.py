"""A covariance model of GSTools is accepted where a variogram model is, without GSTools being imported here."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from truepose.errors import KrigingError
from truepose.similarity.model import VariogramModel

CONVERSIONS: Final[dict[str, tuple[str, str | None, float]]] = {
    "Spherical": ("spherical", None, 1.0),
    "Exponential": ("exponential", None, 1.0),
    "Gaussian": ("gaussian", None, 1.0),
    "Matern": ("matern", "nu", math.sqrt(2)),  # GSTools: √ν h, here √(2ν) r
    "Stable": ("stable", "alpha", 1.0),
    "Rational": ("rational", "alpha", math.sqrt(0.5)),  # GSTools: h²/α, here r²/(2α)
    "Cubic": ("cubic", None, 1.0),
    "JBessel": ("hole", None, 1.0),  # of ν = 1/2
}
"""By GSTools' name: the family here, the attribute that is its shape, and a over GSTools' rescaled length."""

GSTOOLS_MATERN_LIMIT: Final = 20.0
"""Above this ν GSTools takes a gaussian for its Matérn model."""


def as_variogram(model: Any) -> VariogramModel:
    """Return a variogram model as it is, or the model that a GSTools ``CovModel`` describes.

    Parameters
    ----------
    model : VariogramModel or gstools.CovModel
        The model; sums, anisotropy and rotation are converted too.

    Raises
    ------
    KrigingError
        For something else, and for a model that has no counterpart here.

    Examples
    --------
    >>> import gstools
    >>> as_variogram(gstools.Exponential(dim=3, var=2.0, len_scale=50.0, nugget=0.1))
    VariogramModel('exponential', nugget=0.1, sill=2.0, range=50.0)
    """
    if isinstance(model, VariogramModel):
        return model
    if not is_covmodel(model):
        raise KrigingError(f"expected a VariogramModel or a GSTools CovModel, got {type(model).__name__}")
    parts = getattr(model, "models", None)
    if parts is not None:  # a sum; with no parts a pure nugget
        inner = float(sum(part.nugget for part in parts))
        own = [VariogramModel("nugget", nugget=float(model.nugget) - inner)] if model.nugget > inner else []
        converted = [_single(part) for part in parts] + own
        if not converted:
            raise KrigingError("a GSTools sum of no models has no variance; give it a nugget or a model")
        total = converted[0]
        for other in converted[1:]:
            total = total + other
        return total
    return _single(model)


def is_covmodel(model: Any) -> bool:
    """Return whether an object is a GSTools ``CovModel``, seen by its class alone."""
    return any(base.__name__ == "CovModel" and base.__module__.startswith("gstools") for base in type(model).__mro__)


def _single(model: Any) -> VariogramModel:
    name = type(model).__name__
    if model.latlon or model.temporal:
        raise KrigingError(
            f"a GSTools {name} on the sphere or in time has no counterpart here; give one of space alone"
        )
    if name not in CONVERSIONS or (name == "JBessel" and model.nu != 0.5):
        raise KrigingError(
            f"a GSTools {name} has no counterpart here; there are {', '.join(CONVERSIONS)} (JBessel with nu=0.5)"
        )
    family, shape_name, factor = CONVERSIONS[name]
    shape = None if shape_name is None else float(getattr(model, shape_name))
    if name == "Matern" and shape is not None and shape > GSTOOLS_MATERN_LIMIT:
        family, shape, factor = "gaussian", None, 2.0
    lengths, rotation = _axes(model)
    return VariogramModel(
        family,
        nugget=float(model.nugget),
        sill=float(model.var),
        range=tuple(factor * a for a in lengths) if len(lengths) > 1 else factor * lengths[0],
        shape=shape,
        rotation=rotation,
    )


def _axes(model: Any) -> tuple[list[float], tuple[float, ...] | None]:
    """Return the rescaled length along each axis, and the rotation vector of the axes."""
    from scipy.spatial.transform import Rotation

    if model.is_isotropic:
        return [float(model.len_rescaled)], None
    to_isotropic = np.asarray(model.isometrize(np.eye(model.dim)))
    size = np.linalg.norm(to_isotropic, axis=1)
    lengths = (model.len_rescaled / size).tolist()
    axes = (to_isotropic / size[:, None]).T
    if np.allclose(axes, np.eye(model.dim), atol=1e-14):
        return lengths, None
    if model.dim > 3:
        raise KrigingError(f"a GSTools model with a rotation in {model.dim} dimensions has no counterpart here")
    full = np.eye(3)
    full[: model.dim, : model.dim] = axes
    return lengths, tuple(Rotation.from_matrix(full).as_rotvec().tolist())
