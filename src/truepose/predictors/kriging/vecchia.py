"""Vecchia's approximation: Kriging with one drift from any number of samples, each given its nearest earlier ones.

A. V. Vecchia, "Estimation and model identification for continuous spatial processes", Journal of the Royal Statistical
Society B 50 (1988); order at random and predictions from samples alone as in J. Guinness, "Permutation and grouping
methods for sharpening Gaussian process approximations", Technometrics 60 (2018).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize
from scipy.spatial import KDTree

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.numerics.threads import threads
from truepose.predictors.kriging.base import VariogramLike
from truepose.predictors.kriging.neighbours import CHUNK, Group, NeighbourKriging
from truepose.predictors.kriging.system import System, dependent
from truepose.similarity.model import VariogramModel
from truepose.similarity.trend import DriftLike

FARTHEST: Final = 6.0
"""Logarithm of the largest change of a parameter in a refinement."""

LEAST: Final = 1e-9
"""Nugget from which a refinement starts where none was found, in units of the sill."""

GROWTH: Final = 1.5
"""Trees over the first samples are made for each so many times more of them."""


@dataclass(frozen=True, eq=False)
class _Drift:
    """The estimate of the drift of one group from all samples.

    Attributes
    ----------
    beta : (p, c) array
        The coefficients of the drift.
    root : (p, p) array
        R of the whitened drift, upper: Cov(beta) = (RᵀR)⁻¹ in units of the variance.
    squares : (c,) array
        The sum of squares of the whitened residuals.
    log_determinant : float
        The logarithm of the determinant of the unit covariance matrix of all samples.
    """

    beta: FloatArray
    root: FloatArray
    squares: FloatArray
    log_determinant: float


class VecchiaKriging(NeighbourKriging):
    """Kriging of each target from its nearest samples, with the drift of all samples by Vecchia's approximation (13).

    The samples' joint density is taken as the product of each one's given its nearest earlier ones, in random order;
    from it follow the drift's coefficients by generalised least squares, their uncertainty, and the likelihood, in
    O(n neighbours³) time. With as many neighbours as samples it is `UniversalKriging`. Unlike `LocalKriging` it has one
    drift everywhere, so it extrapolates as global Kriging does.

    Parameters
    ----------
    neighbours, variogram, exact
        The parameters of `LocalKriging`.
    drift : {"constant", "linear", "quadratic", "cubic"}, int, sequence of int, or callable
        The drift, as for `UniversalKriging`.
    refine : bool
        Whether a fitted variogram, which `fit_likelihood` estimates from a part of the samples, is refined by the
        approximate likelihood of all: nugget, sill, and a factor on its ranges. This takes about 50 times as long.

    Attributes
    ----------
    beta_ : (p, k) array [mm]
        The GLS coefficients of the drift's columns, as of `UniversalKriging`.
    log_likelihood_ : (k,) array
        The log-likelihood of each component's errors, with the mean of all repeats of a point as one sample.
    variogram_, variograms_
        The attributes of `LocalKriging`.

    Examples
    --------
    >>> from truepose.similarity import VariogramModel
    >>> x = np.arange(1000.0)[:, None]
    >>> model = VecchiaKriging(8, VariogramModel("exponential", sill=1.0, range=20.0)).fit(x, np.sin(x / 10))
    >>> model.predict([[25.5]]).round(2)
    array([[0.56]])
    """

    def __init__(
        self,
        neighbours: int = 32,
        variogram: VariogramLike = None,
        exact: bool = False,
        drift: DriftLike = "constant",
        refine: bool = False,
    ) -> None:
        super().__init__(neighbours, variogram, exact, drift)
        self.refine = refine

    def _refined(self, model: VariogramModel, noise: FloatArray) -> VariogramModel:
        """Return the model with the largest approximate likelihood near a fitted one."""
        if not (self.refine and model.partial_sill):
            return model
        k = noise.shape[1]
        free = np.array([True, True, bool(noise.any())])  # without given noise each scale is in closed form

        def moved(step: FloatArray) -> VariogramModel:
            longer, noisier, larger = np.exp(np.clip(_spread(step, free), -FARTHEST, FARTHEST))
            nugget = (model.nugget + LEAST * model.partial_sill) * float(noisier * larger)
            return replace(model.stretched(float(longer)).scaled(float(larger)), nugget=nugget, fit=None)

        def loss(step: FloatArray) -> float:
            self._assemble((moved(step),) * k, noise)
            if free[2]:
                return -float(self.log_likelihood_.sum())
            u = len(self._points.x)
            return sum(0.5 * float((u * np.log(found.squares) + found.log_determinant).sum()) for found in self._drifts)

        found = minimize(loss, np.zeros(free.sum()), method="L-BFGS-B", options={"eps": 1e-4, "ftol": 1e-10})
        return moved(found.x)

    def _prepare(self) -> None:
        u = len(self._points.x)
        order = np.random.default_rng(0).permutation(u)
        self._drifts = [self._gather(group, order) for group in self._groups]
        self.beta_ = np.empty((self._columns.shape[1], len(self._total)))
        self.log_likelihood_ = np.empty(len(self._total))
        for group, found in zip(self._groups, self._drifts, strict=True):
            c = group.components
            self.beta_[:, c] = found.beta
            total = self._total[c]
            self.log_likelihood_[c] = -0.5 * (
                u * np.log(2 * np.pi * total) + found.log_determinant + found.squares / total
            )

    def _gather(self, group: Group, order: IntArray) -> _Drift:
        """Whiten drift and errors, sample by sample given earlier ones, and solve the least squares that is left."""
        k, p = min(self.neighbours, len(order)), self._columns.shape[1]
        first = order[:k]
        matrix = self._correlation.matrix(self._coordinates(self._points.x[first])) * group.signal
        matrix[np.diag_indices(k)] = group.prior + group.noise[first]
        try:
            system = System.factorise(matrix, np.empty((k, 0)), self._points.x[first])
        except KrigingError as error:
            raise error.of_rows(first.tolist()) from None
        log_determinant = system.log_determinant
        triangle = _triangle(system.whiten(group.right[first]))
        for rows, near in predecessors(self._scaled[0][order], k, max(64, CHUNK // (k * (k + 1) // 2))):
            here, near = order[rows], order[near]
            rho = self._rho([u[here] for u in self._scaled[: len(self._correlation.structures)]], near)
            gram = self._gram(group, rho, near, np.zeros(len(here)))
            variance = group.prior + group.noise[here] - gram[:, 0, 0]
            if not (variance > 0).all():
                raise KrigingError(
                    "the neighbours of a sample determine it to 64 bits; give the variogram a nugget, or use a rougher "
                    "family"
                )
            white = (group.right[here] - gram[:, 0, 1:]) / np.sqrt(variance)[:, None]
            log_determinant += float(np.log(variance).sum())
            triangle = _triangle(np.vstack([triangle, white]))
        root = triangle[:p, :p]
        if dependent(root):
            raise KrigingError(f"the {p} columns of the drift are not independent; use a simpler drift")
        beta = solve_triangular(root, triangle[:p, p:])
        return _Drift(beta, root, (triangle[p:, p:] ** 2).sum(axis=0), log_determinant)

    def _found(self, group: Group) -> _Drift:
        return self._drifts[next(i for i, other in enumerate(self._groups) if other is group)]

    def _group_scale(self, group: Group) -> FloatArray:
        freedom = max(len(self._points.x) - self._columns.shape[1], 1)
        scale: FloatArray = self._found(group).squares / freedom / self._total[group.components]
        return scale

    def _combine(self, group: Group, gram: FloatArray, f0: FloatArray) -> tuple[FloatArray, FloatArray]:
        p, drift = f0.shape[1], self._found(group)
        unexplained = f0 - gram[:, 0, 1 : 1 + p]
        mean = gram[:, 0, 1 + p :] + unexplained @ drift.beta
        spread = solve_triangular(drift.root, unexplained.T, trans="T")
        return mean, group.prior - gram[:, 0, 0] + (spread**2).sum(axis=0)

    def _coefficients(self, group: Group, inverse: FloatArray, near: IntArray) -> FloatArray:
        return np.broadcast_to(self._found(group).beta, (len(near), *self._found(group).beta.shape))


def _spread(step: FloatArray, free: BoolArray) -> FloatArray:
    full = np.zeros(len(free))
    full[free] = step
    return full


def _triangle(rows: FloatArray) -> FloatArray:
    """Return R of rows = Q R."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def predecessors(u: FloatArray, k: int, rows: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield parts of the rows k … n−1 of u, and the k nearest of the rows before each.

    Parameters
    ----------
    u : (n, d) array
        The points in their order.
    k : int
        The number of neighbours.
    rows : int
        The rows of one part.

    Yields
    ------
    rows : (m,) array of int
        The rows of one part.
    near : (m, k) array of int
        The neighbours, nearest first.
    """
    start = k
    while start < len(u):
        stop = min(len(u), max(int(GROWTH * start), start + 64))
        tree = KDTree(u[:stop])
        for first in range(start, stop, rows):
            part = np.arange(first, min(first + rows, stop))
            yield part, _before(tree, u[part], part, k)
        start = stop


def _before(tree: KDTree, u: FloatArray, rows: IntArray, k: int) -> IntArray:
    """Return the k nearest points of a tree whose number is below that of the row; all are searched where few are."""
    asked = min(2 * k + 16, tree.n)
    near = np.asarray(tree.query(u, np.arange(1, asked + 1), workers=threads())[1], dtype=np.int64)
    earlier = near < rows[:, None]
    out = np.take_along_axis(near, np.argsort(~earlier, axis=1, kind="stable")[:, :k], axis=1)
    for i in np.flatnonzero(earlier.sum(axis=1) < k):
        distance = np.linalg.norm(tree.data[: rows[i]] - u[i], axis=1)
        out[i] = np.argsort(distance, kind="stable")[:k]
    return out
