"""Equation (10) by the covariance of all readings: exact, for some hundred samples.

Cov(e(q), e(q')) = J Σ0 J'ᵀ + Σ_j s_j² ρ(q_j, q'_j) (∂P/∂q_j)(∂P'/∂q_j)ᵀ + b² ρ_Z I + δ R, factorised once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solve_triangular

from truepose.errors import KrigingError
from truepose.predictors.kinematic.hyper import Hyper
from truepose.predictors.kinematic.kernels import joint_chord, matern32, matern52, squared_distances
from truepose.predictors.kinematic.terms import COMPLIANCE, GEOMETRY, Design, Terms

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def tolerances(terms: Terms, hyper: Hyper) -> FloatArray:
    """Return the factor of each drift column's prior standard deviation, (p,)."""
    return np.asarray(np.r_[1.0, hyper.tolerance][terms.group])


class Likelihood:
    """Negative log marginal likelihood of (10), the drift integrated out, with its gradient: REML under priors.

    With wide priors of base and tool the marginal likelihood is the restricted likelihood, up to a constant.

    Parameters
    ----------
    terms : Terms
    design : Design
        Of the n samples.
    joints : (k,) array of int
        Joints with an error f_j of their own.
    e : (n, 3) array [mm]
    noise_std : (n, 3) array [mm]
        Of the readings, beside the fitted noise.
    weight : (n,) array
        Of each sample; its noise variance is divided by it.
    """

    def __init__(
        self, terms: Terms, design: Design, joints: IntArray, e: FloatArray, noise_std: FloatArray, weight: FloatArray
    ) -> None:
        self._n = len(e)
        self._y = e.reshape(-1)
        self._lever = [np.ascontiguousarray(design.lever[:, :, j]) for j in joints]
        self._chord = [joint_chord(design.q[:, j], design.q[:, j]) for j in joints]
        flat = design.drift.reshape(3 * self._n, -1)
        self._drift = [flat[:, terms.group == g] for g in (0, GEOMETRY, COMPLIANCE)]
        self._outer = [d @ d.T for d in self._drift]
        ranges = len(terms.range_names)
        self._squared = squared_distances(design.place, design.place, terms.range_of, ranges) if ranges else None
        self._reading = (noise_std**2 / weight[:, None]).reshape(-1)
        self._weight = np.repeat(weight, 3)

    def __call__(self, hyper: Hyper) -> tuple[float, FloatArray]:
        """Return the value and its gradient by the logarithms of `Hyper.to_vector`."""
        n, k = self._n, len(self._lever)
        covariance = self._outer[0].copy()
        for outer, scale in zip(self._outer[1:], hyper.tolerance, strict=True):
            covariance += scale**2 * outer
        blocks = covariance.reshape(n, 3, n, 3)
        joints = []
        for lever, chord, std, length in zip(
            self._lever, self._chord, hyper.joint_std, hyper.joint_length, strict=True
        ):
            rho, slope = matern32(chord, float(length))
            rho *= std**2
            slope *= std**2
            joints.append((rho, slope))
            for a in range(3):
                for b in range(3):
                    blocks[:, a, :, b] += rho * np.outer(lever[:, a], lever[:, b])
        rest = self._rest(hyper)
        if rest is not None:
            for a in range(3):
                blocks[:, a, :, a] += rest[0]
        diagonal = np.arange(3 * n)
        covariance[diagonal, diagonal] += hyper.noise**2 / self._weight + self._reading
        factor, failed = lapack.dpotrf(covariance.T, lower=1, clean=1, overwrite_a=1)
        if failed:
            return np.inf, np.zeros(len(hyper.to_vector()))
        alpha = lapack.dpotrs(factor, self._y, lower=1)[0]
        value = 0.5 * float(self._y @ alpha) + float(np.log(np.diag(factor)).sum())
        inverse = lapack.dpotri(factor, lower=1, overwrite_c=1)[0]
        inverse += np.tril(inverse, -1).T
        w = inverse.T  # symmetric, and in C order
        w -= np.outer(alpha, alpha)
        gradient = np.empty(2 * k + 3)
        w_blocks = w.reshape(n, 3, n, 3)
        for i, (lever, (rho, slope)) in enumerate(zip(self._lever, joints, strict=True)):
            seen = sum(w_blocks[:, a, :, b] * np.outer(lever[:, a], lever[:, b]) for a in range(3) for b in range(3))
            gradient[i] = np.vdot(seen, rho)
            gradient[k + i] = 0.5 * np.vdot(seen, slope)
        for i, (drift, scale) in enumerate(zip(self._drift[1:], hyper.tolerance, strict=True)):
            gradient[2 * k + i] = scale**2 * np.vdot(drift, w @ drift)
        gradient[2 * k + 2] = hyper.noise**2 * float((np.diag(w) / self._weight).sum())
        if rest is not None:
            assert self._squared is not None
            seen = w_blocks[:, 0, :, 0] + w_blocks[:, 1, :, 1] + w_blocks[:, 2, :, 2]
            by_range = [
                0.5 * np.vdot(seen, rest[1] * d) / length**2
                for d, length in zip(self._squared, hyper.rest_range, strict=True)
            ]
            gradient = np.r_[gradient, np.vdot(seen, rest[0]), by_range]
        return value, gradient

    def _rest(self, hyper: Hyper) -> tuple[FloatArray, FloatArray] | None:
        if self._squared is None:
            return None
        rho, slope = matern52(np.tensordot(1.0 / hyper.rest_range**2, self._squared, axes=1))
        return hyper.rest_std**2 * rho, hyper.rest_std**2 * slope


@dataclass(frozen=True, eq=False)
class CovarianceForm:
    """The factorised covariance of all readings, and what follows from it.

    Attributes
    ----------
    factor : (3n, 3n) array
        Cholesky factor, lower.
    alpha : (3n,) array
        K⁻¹ e.
    """

    terms: Terms
    design: Design
    joints: IntArray
    hyper: Hyper
    factor: FloatArray
    alpha: FloatArray

    @classmethod
    def of(
        cls,
        terms: Terms,
        design: Design,
        joints: IntArray,
        hyper: Hyper,
        e: FloatArray,
        noise_variance: FloatArray,
    ) -> Self:
        """Factorise for errors (n, 3) [mm] whose noise has variances (n, 3) [mm²].

        Raises
        ------
        KrigingError
            If the covariance is singular.
        """
        blank = cls(terms, design, joints, hyper, np.empty((0, 0)), np.empty(0))
        covariance = blank._covariance_with(design)
        covariance[np.diag_indices(len(covariance))] += noise_variance.reshape(-1)
        factor, failed = lapack.dpotrf(covariance.T, lower=1, clean=1, overwrite_a=1)
        if failed:
            raise KrigingError(
                "the covariance of kinematic Kriging is singular: poses repeat without noise; state a noise_std"
            )
        alpha = lapack.dpotrs(factor, e.reshape(-1), lower=1)[0]
        return cls(terms, design, joints, hyper, factor, alpha)

    def mean(self, design: Design) -> FloatArray:
        """Return the predicted errors at m configurations, (m, r) [mm, rad]."""
        cross = self._covariance_with(design)
        return np.asarray((cross @ self.alpha).reshape(-1, design.rows))

    def covariance(self, design: Design) -> FloatArray:
        """Return the covariance of the noise-free error at m configurations, (m, r, r) [mm², rad²]."""
        cross = self._covariance_with(design)
        half: FloatArray = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
        half = half.reshape(len(self.alpha), -1, design.rows)
        return np.asarray(self.prior_covariance(design) - np.einsum("kma,kmb->mab", half, half, optimize=True))

    def covariance_together(self, design: Design) -> FloatArray:
        """Return the covariance of the noise-free errors at m configurations with each other, (3m, 3m) [mm²]."""
        half = solve_triangular(self.factor, self._covariance_with(design).T, lower=True, check_finite=False)
        return np.asarray(replace(self, design=design)._covariance_with(design) - half.T @ half)

    def prior_covariance(self, design: Design) -> FloatArray:
        """Return what is expected at m configurations before any reading, (m, r, r) [mm², rad²]."""
        drift = design.drift * tolerances(self.terms, self.hyper)
        lever = design.lever[:, :, self.joints] * self.hyper.joint_std
        rest = self.hyper.rest_std**2 * np.diag(np.arange(design.rows) < 3)  # Z knows no orientation
        return np.asarray(np.einsum("map,mbp->mab", drift, drift) + np.einsum("maj,mbj->mab", lever, lever) + rest)

    def contributions(self, design: Design) -> dict[str, FloatArray]:
        """Return the predicted error of each term at m configurations, (m, r) [mm, rad] each."""
        return {name: (cross @ self.alpha).reshape(-1, design.rows) for name, cross in self._cross(design).items()}

    def drift_estimate(self) -> tuple[FloatArray, FloatArray]:
        """Return the drift coefficients (p,) in prior standard deviations, and their covariance (p, p)."""
        scale = tolerances(self.terms, self.hyper)
        cross = (self.design.drift * scale**2).reshape(len(self.alpha), -1)
        half = solve_triangular(self.factor, cross, lower=True, check_finite=False)
        return cross.T @ self.alpha, np.diag(scale**2) - half.T @ half

    def joint_error(self, i: int, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return f_j of the i-th joint seen at angles (m,) [rad]: mean (m,) [rad] and covariance (m, m) [rad²]."""
        j, std, length = self.joints[i], float(self.hyper.joint_std[i]), float(self.hyper.joint_length[i])
        rho = std**2 * matern32(joint_chord(angle, self.design.q[:, j]), length)[0]
        cross = (rho[:, :, None] * self.design.lever[None, :, :, j]).reshape(len(angle), -1)
        half = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
        return cross @ self.alpha, std**2 * matern32(joint_chord(angle, angle), length)[0] - half.T @ half

    def left_out(self, block: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals and covariances when the samples of each block are left out together.

        With the inverse K⁻¹ in blocks: residual (K⁻¹_bb)⁻¹ (K⁻¹ e)_b of covariance (K⁻¹_bb)⁻¹, noise included.

        Parameters
        ----------
        block : (n,) array of int
            Label of each sample; all different: leave-one-out.

        Returns
        -------
        residual : (n, 3) array [mm]
        covariance : (n, 3, 3) array [mm²]
        """
        inverse = lapack.dpotri(self.factor, lower=1)[0]
        inverse += np.tril(inverse, -1).T
        n = len(block)
        residual, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
        for label in np.unique(block):
            rows = np.flatnonzero(block == label)
            index = (3 * rows[:, None] + np.arange(3)).reshape(-1)
            part = np.linalg.inv(inverse[np.ix_(index, index)])
            residual[rows] = (part @ self.alpha[index]).reshape(-1, 3)
            covariance[rows] = np.einsum("iaib->iab", part.reshape(len(rows), 3, len(rows), 3))
        return residual, covariance

    def _covariance_with(self, design: Design) -> FloatArray:
        """Return the covariance between m configurations and the samples, (r m, 3n) [mm²]."""
        return np.asarray(np.sum(list(self._cross(design).values()), axis=0))

    def _cross(self, design: Design) -> dict[str, FloatArray]:
        """Return the covariances of each term between m configurations and the samples, (r m, 3n) [mm²] each."""
        m, n, rows = len(design.q), len(self.design.q), design.rows
        scale = tolerances(self.terms, self.hyper)
        out: dict[str, FloatArray] = {}
        for g, name in enumerate(("registration", "geometry", "compliance")):
            columns = np.flatnonzero(self.terms.group == g)
            if len(columns):
                left = (design.drift[:, :, columns] * scale[columns] ** 2).reshape(rows * m, -1)
                out[name] = left @ self.design.drift[:, :, columns].reshape(3 * n, -1).T
        for j, std, length in zip(self.joints, self.hyper.joint_std, self.hyper.joint_length, strict=True):
            rho = std**2 * matern32(joint_chord(design.q[:, j], self.design.q[:, j]), float(length))[0]
            block = np.empty((m, rows, n, 3))
            for a in range(rows):
                for b in range(3):
                    block[:, a, :, b] = rho * np.outer(design.lever[:, a, j], self.design.lever[:, b, j])
            out[f"joint {j + 1}"] = block.reshape(rows * m, 3 * n)
        if len(self.hyper.rest_range):
            squared = squared_distances(
                design.place, self.design.place, self.terms.range_of, len(self.hyper.rest_range)
            )
            rho = self.hyper.rest_std**2 * matern52(np.tensordot(1.0 / self.hyper.rest_range**2, squared, axes=1))[0]
            block = np.zeros((m, rows, n, 3))
            for a in range(3):
                block[:, a, :, a] = rho
            out["rest"] = block.reshape(rows * m, 3 * n)
        return out
