"""Solve theory (10) in a basis: linear in the number of samples, for hundreds to a hundred thousand of them.

The columns of `Basis` make the model a drift of p columns with normal priors, e = Φ w + ε, w ~ N(0, Λ), and ΦᵀR⁻¹Φ is
summed once. The likelihood, its gradient and the prediction cost O(p³) and O(p²) for any n.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final, Self

import numpy as np
from scipy.linalg import blas, block_diag, cho_factor, lapack, solve_triangular

from truepose._typing import FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.predictors.folds import blocks_by_size
from truepose.predictors.kinematic.basis import Basis
from truepose.predictors.kinematic.design import Design, parts, take
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.kernels import joint_chord, matern32
from truepose.predictors.kinematic.noise import add_to_blocks
from truepose.predictors.kinematic.terms import GROUPS
from truepose.predictors.kinematic.visits import with_shared

_CHUNK: Final = 2048  # configurations per block of columns in memory


@dataclass(frozen=True, eq=False)
class BasisSums:
    """The sums over n samples in the likelihood: ΦᵀWΦ, ΦᵀWe, eᵀWe with W = R⁻¹ at noise scale 1, and log|R|."""

    phi_phi: FloatArray
    phi_e: FloatArray
    e_e: float
    n: int
    log_determinant: float

    @property
    def constant(self) -> float:
        """The constant that `negative_log_likelihood` omits: ½ log|R| + ½ 3n log 2π."""
        return 0.5 * self.log_determinant + 1.5 * self.n * math.log(2 * math.pi)

    @classmethod
    def of(
        cls, basis: Basis, design: Design, hyper: Hyperparameters, e: FloatArray, noise_variance: FloatArray
    ) -> Self:
        """Sum over samples with errors (n, 3) and noise (n, 3) or (n, 3, 3), in parts."""
        p = sum(count for _, count in basis.groups)
        phi_phi, phi_e, e_e, log_determinant = np.zeros((p, p), order="F"), np.zeros(p), 0.0, 0.0
        for part, together in _chunks(design.visit):
            phi, y, noise = basis.whitened(take(design, part), hyper, e[part], noise_variance[part], together)
            phi_phi = blas.dsyrk(1.0, phi.T, beta=1.0, c=phi_phi, overwrite_c=1)
            phi_e += phi.T @ y
            e_e += float(y @ y)
            log_determinant += float(np.linalg.slogdet(noise)[1].sum())
        upper = np.triu(phi_phi)
        return cls(upper + np.triu(upper, 1).T, phi_e, e_e, len(e), log_determinant)


def _chunks(visit: FloatArray) -> Iterator[tuple[slice | IntArray, int]]:
    """Return the rows in parts, with the number of rows that belong together in each; those of a visit stay so."""
    if np.isnan(visit).all():
        yield from ((slice(start, start + _CHUNK), 1) for start in range(0, len(visit), _CHUNK))
        return
    own = np.where(np.isnan(visit), np.nanmax(visit) + 1.0 + np.arange(len(visit)), visit)
    for rows in blocks_by_size(own):
        for some in np.array_split(rows, -(-rows.size // _CHUNK)):
            yield some.reshape(-1), rows.shape[1]


def negative_log_likelihood(
    basis: Basis, sums: BasisSums, hyper: Hyperparameters, scale: float
) -> tuple[float, FloatArray, float]:
    """Return the value without `BasisSums.constant`, and its derivatives by log prior variances and log noise scale.

    Parameters
    ----------
    basis : Basis
        The columns.
    sums : BasisSums
        The sums over the samples.
    hyper : Hyperparameters
        The hyperparameters.
    scale : float
        The factor of the noise variances in `sums`.
    """
    root = np.sqrt(basis.prior(hyper))
    matrix = sums.phi_phi * (root[:, None] * root / scale)
    matrix[np.diag_indices(len(root))] += 1.0
    factor, failed = lapack.dpotrf(matrix.T, lower=1, clean=1, overwrite_a=1)
    if failed:
        return np.inf, np.zeros(len(root)), 0.0
    b = root * sums.phi_e / scale
    u = lapack.dpotrs(factor, b, lower=1)[0]
    quadratic = sums.e_e / scale - float(b @ u)
    value = 0.5 * (quadratic + 3 * sums.n * np.log(scale)) + float(np.log(np.diag(factor)).sum())
    inverse = lapack.dtrtri(factor, lower=1, overwrite_c=1)[0]
    inverse_diagonal = np.einsum("ij,ij->j", inverse, inverse)
    by_variance = 0.5 * (1.0 - inverse_diagonal - u**2)
    explained = float(len(root) - inverse_diagonal.sum())
    by_scale = 0.5 * (3 * sums.n - (quadratic - float(u @ u)) - explained)
    return value, by_variance, by_scale


def gradient_by_hyper(basis: Basis, hyper: Hyperparameters, by_variance: FloatArray, by_scale: float) -> FloatArray:
    """Return the gradient by the logarithms of `Hyperparameters.to_vector`; 0 for fixed ranges."""
    edges = np.cumsum([0, *(count for _, count in basis.groups)])
    part = [slice(a, b) for a, b in pairwise(edges)]
    joints = part[len(GROUPS) : -1]
    by_std = [2.0 * by_variance[p].sum() for p in joints]
    by_tolerance = [2.0 * by_variance[part[g]].sum() for g in basis.terms.scaled_groups]
    rest = [2.0 * by_variance[part[-1]].sum(), *np.zeros(len(hyper.rest_range))] if len(hyper.rest_range) else []
    return np.array([*by_std, *np.zeros(len(joints)), *by_tolerance, 2.0 * by_scale, *rest])


@dataclass(frozen=True, eq=False)
class BasisForm:
    """The posterior of the weights, with the methods of `CovarianceForm`.

    Attributes
    ----------
    weight : (p,) array
        The posterior mean.
    root : (p, p) array
        The upper triangular Λ½ L⁻ᵀ; the posterior covariance is root rootᵀ.
    noise : (n, 3, 3) array [mm²]
        The noise covariance of each sample: its reading, and the part that the columns do not represent.
    """

    basis: Basis
    design: Design
    hyper: Hyperparameters
    noise: FloatArray
    e: FloatArray
    weight: FloatArray
    root: FloatArray

    @classmethod
    def of(
        cls, basis: Basis, design: Design, hyper: Hyperparameters, e: FloatArray, noise_variance: FloatArray
    ) -> Self:
        """Solve for errors (n, 3) [mm] whose noise has variances (n, 3), or covariances (n, 3, 3) [mm²].

        Raises
        ------
        KrigingError
            If the system is singular.
        """
        sums = BasisSums.of(basis, design, hyper, e, noise_variance)
        prior_root = np.sqrt(basis.prior(hyper))
        matrix = sums.phi_phi * (prior_root[:, None] * prior_root)
        matrix[np.diag_indices(len(matrix))] += 1.0
        try:
            factor = np.tril(cho_factor(matrix, lower=True, overwrite_a=True)[0])
        except np.linalg.LinAlgError:
            raise KrigingError("the system of kinematic Kriging is singular; pass a larger noise_std") from None
        inverse = solve_triangular(factor, np.eye(len(factor)), lower=True, overwrite_b=True)
        root = np.asfortranarray(prior_root[:, None] * inverse.T)
        noise = np.concatenate([basis.left_out_covariance(part, hyper) for part in parts(design, _CHUNK)])
        add_to_blocks(noise, noise_variance)
        return cls(basis, design, hyper, noise, e, root @ (root.T @ sums.phi_e), root)

    def mean(self, design: Design) -> FloatArray:
        """Return the predicted errors at m configurations, (m, r) [mm, rad]."""
        return np.concatenate(
            [(self.basis.columns(part) @ self.weight).reshape(-1, design.rows) for part in parts(design, _CHUNK)]
        )

    def covariance(self, design: Design) -> FloatArray:
        """Return the covariance of the noise-free error at m configurations, (m, r, r) [mm², rad²]."""
        return self.posterior(design)[1]

    def posterior(self, design: Design) -> tuple[FloatArray, FloatArray]:
        """Return `mean` and `covariance`."""
        means, covariances = [], []
        for part in parts(design, _CHUNK):
            phi, missing = self.basis.columns_with_missing(part, self.hyper)
            means.append((phi @ self.weight).reshape(-1, design.rows))
            half = self._half(phi).reshape(len(part.q), design.rows, -1)
            covariances.append(half @ np.swapaxes(half, 1, 2) + missing)
        return np.concatenate(means), np.concatenate(covariances)

    def _half(self, phi: FloatArray) -> FloatArray:
        """Return Φ root, (r m, p): its rows' products are posterior covariances. Φ is overwritten."""
        half: FloatArray = blas.dtrmm(1.0, self.root, phi.T, lower=0, trans_a=1, overwrite_b=1)
        return half.T

    def covariance_together(self, design: Design) -> FloatArray:
        """Return the covariance of the noise-free errors at m configurations with each other, (3m, 3m) [mm²]."""
        half = self.basis.columns(design) @ self.root
        return np.asarray(half @ half.T + block_diag(*self.basis.left_out_covariance(design, self.hyper)))

    def contributions(self, design: Design) -> dict[str, FloatArray]:
        """Return the predicted error of each term at m configurations, (m, r) [mm, rad] each."""
        phi = self.basis.columns(design)
        out, start = {}, 0
        for name, count in self.basis.groups:
            if count:
                out[name] = (phi[:, start : start + count] @ self.weight[start : start + count]).reshape(
                    -1, design.rows
                )
            start += count
        return out

    def drift_estimate(self) -> tuple[FloatArray, FloatArray]:
        """Return the drift coefficients (p,) in prior standard deviations, and their covariance (p, p)."""
        order = np.argsort(self.basis.terms.group, kind="stable")
        p = len(order)
        mean, covariance = np.empty(p), np.empty((p, p))
        mean[order] = self.weight[:p]
        covariance[np.ix_(order, order)] = self.root[:p] @ self.root[:p].T
        return mean, covariance

    def joint_error(self, i: int, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f_j of the i-th joint seen at angles (m,) [rad]: mean (m,) [rad] and covariance (m, m) [rad²]."""
        own, length = self.basis.joint_columns(i, angle), float(self.hyper.joint_length[i])
        part = self._part(len(GROUPS) + i)
        half = own @ self.root[part]
        left = matern32(joint_chord(angle, angle), length)[0] - own @ own.T
        return own @ self.weight[part], half @ half.T + self.hyper.joint_std[i] ** 2 * left

    def _part(self, group: int) -> slice:
        """Return the weights of one of `Basis.groups`."""
        edges = np.cumsum([0, *(count for _, count in self.basis.groups)]).tolist()
        return slice(edges[group], edges[group + 1])

    def joint_mean(self, i: int, angle: FloatArray) -> FloatArray:
        """Return the mean of f_j of the i-th joint seen at angles (m,) [rad], (m,) [rad]."""
        return self.basis.joint_columns(i, angle) @ self.weight[self._part(len(GROUPS) + i)]

    @cached_property
    def _told_root(self) -> FloatArray:
        """The root (k, p) of Λ½ (I − Λ^(−½) Σ Λ^(−½)) Λ½, prior minus posterior covariance of the weights."""
        prior = np.sqrt(self.basis.prior(self.hyper))
        posterior = self.root / prior[:, None]
        value, vector = np.linalg.eigh(np.eye(len(prior)) - posterior @ posterior.T)
        return np.asarray((vector * np.sqrt(np.maximum(value, 0.0))).T * prior)

    def told(self, design: Design) -> FloatArray:
        """Return columns (p, r m) whose squared lengths are the variance that the samples remove from the prior's."""
        return np.asarray(self._told_root @ self.basis.columns(design).T)

    def projected(self, directions: FloatArray, angle: FloatArray) -> tuple[FloatArray, list[FloatArray], FloatArray]:
        """Return `told` in k directions (p, k), see `CovarianceForm.projected`; with anchors in place of samples."""
        weight = self._told_root.T @ directions
        order = np.argsort(self.basis.terms.group, kind="stable")
        drift = np.empty((len(order), directions.shape[1]))
        drift[order] = weight[: len(order)]
        first = len(GROUPS)
        joints = [
            self.basis.joint_columns(i, angle) @ weight[self._part(first + i)] for i in range(len(self.basis.joints))
        ]
        rest = weight[self._part(len(self.basis.groups) - 1)].reshape(3, -1, directions.shape[1])
        return drift, joints, self.basis.anchor_map @ rest

    def rest_mean(self) -> tuple[FloatArray, FloatArray]:
        """Return coordinates over ranges (a, d) and weights (a, 3) [mm]: Z is the sum of correlations times weights."""
        anchor, terms = self.basis.anchor, self.basis.terms
        if anchor is None:
            return np.empty((0, len(terms.range_of))), np.empty((0, 3))
        weight = self.weight[self._part(len(self.basis.groups) - 1)].reshape(3, -1)
        return anchor.place / self.basis.rest_range[terms.range_of], self.basis.anchor_map @ weight.T

    def left_out(self, block: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals (n, 3) and covariances (n, 3, 3) with the samples of each block left out together."""
        n = len(block)
        residual, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
        for rows in blocks_by_size(block):  # all blocks of one size at once, some at a time: (g, m)
            for some in np.array_split(rows, -(-rows.size // _CHUNK)):
                g, m = some.shape
                phi = self.basis.columns(take(self.design, some.reshape(-1)))
                miss = self.e[some] - (phi @ self.weight).reshape(g, m, 3)
                if self._visited:
                    residual[some], covariance[some] = self._left_visits(some, miss, self._half(phi))
                    continue
                root = np.linalg.cholesky(self.noise[some])
                white = np.linalg.inv(root)
                half = (white @ self._half(phi).reshape(g, m, 3, -1)).reshape(g, 3 * m, -1)
                wider, own = _without_themselves(half, (white @ miss[..., None]).reshape(g, 3 * m))
                residual[some] = (root @ wider.reshape(g, m, 3, 1))[..., 0]
                covariance[some] = root @ own @ np.swapaxes(root, 2, 3)
        return residual, covariance

    @property
    def _visited(self) -> bool:
        return not bool(np.isnan(self.design.visit).all())

    def _left_visits(self, rows: IntArray, miss: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return `left_out` of blocks of rows (g, m) of whole visits, from their e − Φŵ and Φ root."""
        precision, told = self._block_precision(rows, miss, half)
        g, m = rows.shape
        full = np.linalg.inv(precision)
        own = full.reshape(g, m, 3, m, 3)[:, np.arange(m), :, np.arange(m)]
        return (full @ told).reshape(g, m, 3), np.swapaxes(own, 0, 1)

    def _block_precision(self, rows: IntArray, miss: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the blocks (g, 3m, 3m) of K⁻¹ and K⁻¹ e (g, 3m, 1) of whole visits: N⁻¹ − N⁻¹ΦΣΦᵀN⁻¹, N⁻¹(e − Φŵ)."""
        g, m = rows.shape
        noise = with_shared(self.noise[rows], self.design.visit[rows], self.basis.terms.share * self.hyper.noise**2)
        white = np.linalg.inv(noise)
        mapped = white @ half.reshape(g, 3 * m, -1)
        return white - mapped @ np.swapaxes(mapped, 1, 2), white @ miss.reshape(g, 3 * m, 1)

    @cached_property
    def alone(self) -> tuple[FloatArray, FloatArray]:
        """`left_out` with each sample left out alone."""
        n = len(self.e)
        if not self._visited:
            return self.left_out(np.arange(n))
        residual, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
        for part, m in _chunks(self.design.visit):
            rows = np.arange(n)[part].reshape(-1, m)
            phi = self.basis.columns(take(self.design, rows.reshape(-1)))
            miss = self.e[rows] - (phi @ self.weight).reshape(len(rows), m, 3)
            precision, told = self._block_precision(rows, miss, self._half(phi))
            own = precision.reshape(len(rows), m, 3, m, 3)[:, np.arange(m), :, np.arange(m)]
            covariance[rows] = np.linalg.inv(np.swapaxes(own, 0, 1))
            residual[rows] = (covariance[rows] @ told.reshape(len(rows), m, 3, 1))[..., 0]
        return residual, covariance


def _without_themselves(half: FloatArray, miss: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (I − HHᵀ)⁻¹ y for blocks of m samples, and its (3, 3) blocks on the diagonal of (I − HHᵀ)⁻¹.

    With the posterior covariance HHᵀ and y = e − Φŵ of a block, whitened by its noise, the residual without the block
    is (I − HHᵀ)⁻¹ y, and its covariance (I − HHᵀ)⁻¹. For long blocks, this is I + H (I − HᵀH)⁻¹ Hᵀ.

    Parameters
    ----------
    half : (g, 3m, p) array
        H of each block.
    miss : (g, 3m) array
        y of each block.

    Returns
    -------
    residual : (g, 3m) array
    covariance : (g, m, 3, 3) array
    """
    g, rows, p = half.shape
    m = rows // 3
    if 2 * rows < p or m == 1:
        inverse = np.linalg.inv(np.eye(rows) - half @ np.swapaxes(half, 1, 2))
        own = inverse.reshape(g, m, 3, m, 3)[:, np.arange(m), :, np.arange(m)]
        return (inverse @ miss[:, :, None])[:, :, 0], np.swapaxes(own, 0, 1)
    residual, own = np.empty_like(miss), np.empty((g, m, 3, 3))
    for i in range(g):
        inner = blas.dsyrk(-1.0, half[i], trans=1, beta=1.0, c=np.eye(p, order="F"), lower=1, overwrite_c=1)
        factor, failed = lapack.dpotrf(inner, lower=1, overwrite_a=1)
        if failed:
            raise np.linalg.LinAlgError("the samples outside a block do not determine the weights")
        out = blas.dtrsm(1.0, factor, half[i].T, lower=1)
        residual[i] = miss[i] + out.T @ (out @ miss[i])
        columns = np.ascontiguousarray(out.T).reshape(m, 3, p)
        own[i] = np.eye(3) + columns @ np.swapaxes(columns, 1, 2)
    return residual, own
