"""Equation (10) in a basis: linear in the number of samples, for some hundred to a hundred thousand of them.

Each f_j is a Fourier series on the circle with its kernel's spectrum, Z a series over a subset of samples (Nyström).
Everything is then a drift of p columns with normal priors, e = Φ w + ε, w ~ N(0, Λ), and ΦᵀR⁻¹Φ is summed once; the
likelihood, its gradient and the prediction cost O(p³) and O(p) whatever n is.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, cho_factor, lapack, solve_triangular

from truepose.errors import KrigingError
from truepose.predictors.kinematic.covariance_form import tolerances
from truepose.predictors.kinematic.hyper import Hyper
from truepose.predictors.kinematic.kernels import circle_spectrum, matern52, squared_distances
from truepose.predictors.kinematic.terms import GROUPS, Design, Terms

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MODES: Final = 6.0  # harmonics 0 … 6/l hold all but 1 % of the variance of a joint error of length l
_MOST_MODES: Final = 120
_NEGLIGIBLE: Final = 1e-4
_CHUNK: Final = 2048  # configurations whose columns are in memory at once


@dataclass(frozen=True, eq=False)
class Basis:
    """Which columns stand for (10).

    Attributes
    ----------
    joints : (k,) array of int
    harmonics : (k,) array of int
        Modes of each f_j.
    anchor : Design, optional
        Configurations that carry Z.
    anchor_map : (a, r) array
        From correlations with the anchors to the columns of Z.
    """

    terms: Terms
    joints: IntArray
    harmonics: IntArray
    rest_range: FloatArray
    anchor: Design | None
    anchor_map: FloatArray

    @classmethod
    def of(
        cls,
        terms: Terms,
        joints: IntArray,
        hyper: Hyper,
        anchor: Design | None,
        *,
        modes: float = _MODES,
        most: int = _MOST_MODES,
        negligible: float = _NEGLIGIBLE,
    ) -> Self:
        """Return a basis for the lengths of `hyper`, with Z on the anchors at its ranges.

        Parameters
        ----------
        terms, joints, hyper
            Of the model.
        anchor : Design, optional
            Configurations that carry Z.
        modes, most : float, int
            A joint error of length l gets modes/l harmonics, at most `most`.
        negligible : float
            Eigenvalues of the anchors' correlation below this share of the largest are left to the noise.
        """
        harmonics = np.minimum(np.ceil(modes / hyper.joint_length), most).astype(np.int64)
        anchor_map = np.empty((0, 0))
        if anchor is not None and len(hyper.rest_range):
            rho = _rest_correlation(terms, hyper.rest_range, anchor, anchor)
            value, vector = np.linalg.eigh(rho)
            kept = value > negligible * value.max()
            anchor_map = vector[:, kept] / np.sqrt(value[kept])
        return cls(terms, joints, harmonics, hyper.rest_range, anchor if anchor_map.size else None, anchor_map)

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Names and numbers of columns of the terms, in order."""
        drift = [(name, int((self.terms.group == g).sum())) for g, name in enumerate(GROUPS)]
        joint = [(f"joint {j + 1}", 2 * int(m) + 1) for j, m in zip(self.joints, self.harmonics, strict=True)]
        return [*drift, *joint, ("rest", 3 * self.anchor_map.shape[1])]

    def columns(self, design: Design) -> FloatArray:
        """Return Φ at m configurations, (r m, p); Z knows no orientation."""
        m, rows = len(design.q), design.rows
        order = np.argsort(self.terms.group, kind="stable")
        blocks = [design.drift[:, :, order]]
        for j, harmonics in zip(self.joints, self.harmonics, strict=True):
            angle = design.q[:, j, None] * np.arange(1, harmonics + 1)
            modes = np.concatenate([np.ones((m, 1)), np.cos(angle), np.sin(angle)], axis=1)
            blocks.append(design.lever[:, :, j, None] * modes[:, None, :])
        if self.anchor is not None:
            rest = _rest_correlation(self.terms, self.rest_range, design, self.anchor) @ self.anchor_map
            width = rest.shape[1]
            block = np.zeros((m, rows, 3 * width))
            for a in range(3):
                block[:, a, a * width : (a + 1) * width] = rest
            blocks.append(block)
        return np.concatenate(blocks, axis=2).reshape(rows * m, -1)

    def left_out_covariance(self, design: Design, hyper: Hyper) -> FloatArray:
        """Return the prior covariance that the columns do not hold at m configurations, (m, r, r) [mm², rad²].

        Z away from the anchors, and harmonics beyond the last: without it the basis would be too sure there.
        """
        held = np.array(
            [
                circle_spectrum(float(a), int(m))[0].sum()
                for a, m in zip(hyper.joint_length, self.harmonics, strict=True)
            ]
        )
        lever = design.lever[:, :, self.joints] * (hyper.joint_std * np.sqrt(np.maximum(1.0 - held, 0.0)))
        covariance: FloatArray = np.einsum("maj,mbj->mab", lever, lever)
        if self.anchor is not None:
            rest = _rest_correlation(self.terms, self.rest_range, design, self.anchor) @ self.anchor_map
            missing = hyper.rest_std**2 * np.maximum(1.0 - np.einsum("mr,mr->m", rest, rest), 0.0)
            covariance += missing[:, None, None] * np.diag(np.arange(design.rows) < 3)
        return covariance

    def prior(self, hyper: Hyper) -> tuple[FloatArray, FloatArray]:
        """Return the prior variances Λ of the weights (p,), and their relative derivative by log l_j (p,)."""
        order = np.argsort(self.terms.group, kind="stable")
        variance = [tolerances(self.terms, hyper)[order] ** 2]
        slope = [np.zeros(len(order))]
        for std, length, harmonics in zip(hyper.joint_std, hyper.joint_length, self.harmonics, strict=True):
            v, dv = circle_spectrum(float(length), int(harmonics))
            v = np.maximum(v, 1e-14)
            both = np.r_[0, np.arange(1, harmonics + 1), np.arange(1, harmonics + 1)]
            variance.append(std**2 * v[both])
            slope.append((dv / v)[both])
        rest = 3 * self.anchor_map.shape[1]
        variance.append(np.full(rest, hyper.rest_std**2))
        slope.append(np.zeros(rest))
        return np.concatenate(variance), np.concatenate(slope)


@dataclass(frozen=True, eq=False)
class Sums:
    """What of n samples enters the likelihood: ΦᵀWΦ, ΦᵀWe, eᵀWe with W = R⁻¹ at noise scale 1."""

    phi_phi: FloatArray
    phi_e: FloatArray
    e_e: float
    n: int

    @classmethod
    def of(cls, basis: Basis, design: Design, e: FloatArray, noise_variance: FloatArray) -> Self:
        """Sum over samples with errors and noise variances (n, 3), in parts."""
        p = sum(count for _, count in basis.groups)
        phi_phi, phi_e, e_e = np.zeros((p, p)), np.zeros(p), 0.0
        for start in range(0, len(e), _CHUNK):
            part = slice(start, start + _CHUNK)
            root = 1.0 / np.sqrt(noise_variance[part].reshape(-1))
            phi = basis.columns(take(design, part)) * root[:, None]
            y = e[part].reshape(-1) * root
            phi_phi += phi.T @ phi
            phi_e += phi.T @ y
            e_e += float(y @ y)
        return cls(phi_phi, phi_e, e_e, len(e))


def negative_log_likelihood(basis: Basis, sums: Sums, hyper: Hyper, scale: float) -> tuple[float, FloatArray, float]:
    """Return the value, its gradient by the logarithms of the weights' prior variances, and by log of the noise scale.

    Parameters
    ----------
    basis : Basis
    sums : Sums
    hyper : Hyper
    scale : float
        Factor c of the noise variances in `sums`.
    """
    variance, _ = basis.prior(hyper)
    root = np.sqrt(variance)
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


def gradient_by_hyper(basis: Basis, hyper: Hyper, by_variance: FloatArray, by_scale: float) -> FloatArray:
    """Return the gradient by the logarithms of `Hyper.to_vector`; the ranges of Z are fixed in a basis, theirs is 0."""
    _, slope = basis.prior(hyper)
    edges = np.cumsum([0, *(count for _, count in basis.groups)])
    part = [slice(a, b) for a, b in pairwise(edges)]
    joints = part[len(GROUPS) : -1]
    by_std = [2.0 * by_variance[p].sum() for p in joints]
    by_length = [float((by_variance[p] * slope[p]).sum()) for p in joints]
    by_tolerance = [2.0 * by_variance[p].sum() for p in part[1 : len(GROUPS)]]
    rest = [2.0 * by_variance[part[-1]].sum(), *np.zeros(len(hyper.rest_range))] if len(hyper.rest_range) else []
    return np.array([*by_std, *by_length, *by_tolerance, 2.0 * by_scale, *rest])


@dataclass(frozen=True, eq=False)
class BasisForm:
    """The posterior of the weights, and what follows from it; the face is that of `CovarianceForm`.

    Attributes
    ----------
    weight : (p,) array
        Posterior mean.
    root : (p, p) array
        Λ½ L⁻ᵀ: the posterior covariance is root rootᵀ.
    """

    basis: Basis
    design: Design
    hyper: Hyper
    noise_variance: FloatArray
    e: FloatArray
    weight: FloatArray
    root: FloatArray

    @classmethod
    def of(cls, basis: Basis, design: Design, hyper: Hyper, e: FloatArray, noise_variance: FloatArray) -> Self:
        """Solve for errors (n, 3) [mm] whose noise has variances (n, 3) [mm²].

        Raises
        ------
        KrigingError
            If the system is singular.
        """
        sums = Sums.of(basis, design, e, noise_variance)
        prior_root = np.sqrt(basis.prior(hyper)[0])
        matrix = sums.phi_phi * (prior_root[:, None] * prior_root)
        matrix[np.diag_indices(len(matrix))] += 1.0
        try:
            factor = np.tril(cho_factor(matrix, lower=True, overwrite_a=True)[0])
        except np.linalg.LinAlgError:
            raise KrigingError("the system of kinematic Kriging is singular; state a larger noise_std") from None
        inverse = solve_triangular(factor, np.eye(len(factor)), lower=True, overwrite_b=True)
        root = prior_root[:, None] * inverse.T
        return cls(basis, design, hyper, noise_variance, e, root @ (root.T @ sums.phi_e), root)

    def mean(self, design: Design) -> FloatArray:
        """Return the predicted errors at m configurations, (m, r) [mm, rad]."""
        return np.concatenate(
            [(self.basis.columns(part) @ self.weight).reshape(-1, design.rows) for part in parts(design)]
        )

    def covariance(self, design: Design) -> FloatArray:
        """Return the covariance of the noise-free error at m configurations, (m, r, r) [mm², rad²]."""
        out = []
        for part in parts(design):
            half = (self.basis.columns(part) @ self.root).reshape(len(part.q), design.rows, -1)
            out.append(half @ np.swapaxes(half, 1, 2) + self.basis.left_out_covariance(part, self.hyper))
        return np.concatenate(out)

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
        counts = [count for _, count in self.basis.groups]
        start = sum(counts[: len(GROUPS) + i])
        harmonics = np.arange(1, self.basis.harmonics[i] + 1)
        modes = np.concatenate(
            [np.ones((len(angle), 1)), np.cos(angle[:, None] * harmonics), np.sin(angle[:, None] * harmonics)], axis=1
        )
        part = slice(start, start + modes.shape[1])
        half = modes @ self.root[part]
        return modes @ self.weight[part], half @ half.T

    def left_out(self, block: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals (n, 3) and covariances (n, 3, 3) when the samples of each block are left out together."""
        n = len(block)
        residual, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
        for label in np.unique(block):
            rows = np.flatnonzero(block == label)
            phi = self.basis.columns(take(self.design, rows))
            noise = self.noise_variance[rows].reshape(-1)
            half = phi @ self.root
            # (R − ΦΣΦᵀ) R⁻¹ (e − Φ ŵ_without) = e − Φŵ; the covariance without the block is R (R − ΦΣΦᵀ)⁻¹ R
            inner = np.diag(noise) - half @ half.T
            miss = self.e[rows].reshape(-1) - phi @ self.weight
            residual[rows] = (noise * np.linalg.solve(inner, miss)).reshape(-1, 3)
            full = (noise[:, None] * np.linalg.inv(inner) * noise).reshape(len(rows), 3, len(rows), 3)
            covariance[rows] = np.einsum("iaib->iab", full)
        return residual, covariance


def take(design: Design, rows: slice | IntArray) -> Design:
    """Return some configurations of a design."""
    return Design(*(getattr(design, name)[rows] for name in ("q", "p", "drift", "lever", "place")))


def parts(design: Design) -> list[Design]:
    """Return a design in parts that are small enough to hold their columns."""
    return [take(design, slice(start, start + _CHUNK)) for start in range(0, len(design.q), _CHUNK)]


def _rest_correlation(terms: Terms, rest_range: FloatArray, design: Design, other: Design) -> FloatArray:
    squared = squared_distances(design.place, other.place, terms.range_of, len(rest_range))
    return matern52(np.tensordot(1.0 / rest_range**2, squared, axes=1))[0]
