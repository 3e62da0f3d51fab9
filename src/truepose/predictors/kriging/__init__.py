"""Kriging: simple, ordinary and universal, of vectors, from the nearest samples, and Vecchia's approximation."""

from truepose.predictors.kriging.local import LocalKriging
from truepose.predictors.kriging.ordinary import OrdinaryKriging, SimpleKriging, UniversalKriging
from truepose.predictors.kriging.vecchia import VecchiaKriging
from truepose.predictors.kriging.vector import VectorKriging

__all__ = ["LocalKriging", "OrdinaryKriging", "SimpleKriging", "UniversalKriging", "VecchiaKriging", "VectorKriging"]
