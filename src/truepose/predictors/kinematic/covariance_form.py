"""Solve theory (10) with the covariance of all readings: exact, for up to some hundred samples.

Cov(e(q), e(q')) = J Σ0 J'ᵀ + Σ_j s_j² ρ(q_j, q'_j) (∂P/∂q_j)(∂P'/∂q_j)ᵀ + b² ρ_Z I + δ R, factorised once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

import numpy as np
from scipy.linalg import blas, lapack, solve_triangular
from scipy.spatial.distance import cdist

from truepose._typing import FloatArray, IntArray
from truepose.errors import KrigingError
from truepose.numerics.kinematic import add_joints_and_rest, slopes
from truepose.predictors.folds import blocks_by_size
from truepose.predictors.kinematic.design import Design, parts
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.kernels import joint_chord, matern32, matern52
from truepose.predictors.kinematic.noise import add_to_diagonal
from truepose.predictors.kinematic.terms import GROUPS, REGISTRATION, Terms
from truepose.predictors.kinematic.visits import add_shared, pairs_of

_CHUNK: Final = 256  # configurations per block of cross-covariances in memory


def tolerances(terms: Terms, hyper: Hyperparameters) -> FloatArray:
    """Return the factor of each drift column's prior standard deviation, (p,)."""
    scale = np.ones(len(GROUPS))
    scale[terms.scaled_groups] = hyper.tolerance
    return np.asarray(scale[terms.group])


class Likelihood:
    """The negative log marginal likelihood of (10) with its gradient; the drift is integrated out.

    With wide priors of base and tool it equals the restricted likelihood up to a constant that does not depend on the
    samples. The term ½ 3n log 2π of the normal density is in `constant`.

    Parameters
    ----------
    terms : Terms
        The terms of the model.
    design : Design
        The columns at the n samples.
    joints : (k,) array of int
        The joints with an error f_j of their own.
    e : (n, 3) array [mm]
        The positional errors.
    noise_std : (n, 3) array [mm]
        The standard deviations of the readings, in addition to the fitted noise.
    weight : (n,) array
        The weights of the samples, which divide their noise variances.

    Attributes
    ----------
    n : int
        The number of samples.
    """

    def __init__(
        self, terms: Terms, design: Design, joints: IntArray, e: FloatArray, noise_std: FloatArray, weight: FloatArray
    ) -> None:
        self.n = len(e)
        self._y = e.reshape(-1)
        self._half, self._lever = _turns_and_levers(design, joints)
        flat = design.drift.reshape(3 * self.n, -1)
        self._drift = [np.asfortranarray(flat[:, terms.group == g]) for g in (REGISTRATION, *terms.scaled_groups)]
        self._place, self._range_of, self._ranges = design.place, terms.range_of, len(terms.range_names)
        self._reading = (noise_std**2 / weight[:, None]).reshape(-1)
        self._weight = np.repeat(weight, 3)
        self._pairs, self._share = pairs_of(design.visit), terms.share
        self.constant = 0.5 * len(self._y) * math.log(2 * math.pi)

    def __call__(self, hyper: Hyperparameters) -> tuple[float, FloatArray]:
        """Return the value and its gradient by the logarithms of `Hyperparameters.to_vector`."""
        scaled = np.hstack([d * s for d, s in zip(self._drift, (1.0, *hyper.tolerance), strict=True)])
        place = _over_ranges(self._place, self._range_of, hyper)
        covariance = blas.dsyrk(1.0, scaled.T, trans=1).T  # its lower triangle alone, in C order
        here = (self._half, self._lever)
        add_joints_and_rest(
            covariance, *here, *here, hyper.joint_std, hyper.joint_length, place, place, hyper.rest_std, True
        )
        noise = hyper.noise**2 / self._weight
        covariance[np.diag_indices(3 * self.n)] += noise + self._reading
        add_shared(covariance, self._pairs, self._share * hyper.noise**2)
        factor, failed = lapack.dpotrf(covariance.T, lower=0, clean=0, overwrite_a=1)
        if failed:
            return np.inf, np.zeros(len(hyper.to_vector()))
        alpha = lapack.dpotrs(factor, self._y, lower=0)[0]
        value = 0.5 * float(self._y @ alpha) + float(np.log(np.diag(factor)).sum())
        by_tolerance = [
            scale**2 * (_squares(blas.dtrsm(1.0, factor, drift, trans_a=1)) - _squares(drift.T @ alpha))
            for drift, scale in zip(self._drift[1:], hyper.tolerance, strict=True)
        ]
        inverse = lapack.dpotri(factor, lower=0, overwrite_c=1)[0]
        by_noise = float(((np.diag(inverse) - alpha**2) * noise).sum()) + self._by_shared(inverse, alpha, hyper)
        k = len(hyper.joint_std)
        found = slopes(
            inverse.T, alpha, *here, hyper.joint_std, hyper.joint_length, place, self._range_of, hyper.rest_std,
            self._ranges,
        )  # fmt: skip
        return value, np.concatenate([found[: 2 * k], by_tolerance, [by_noise], found[2 * k :]])

    def _by_shared(self, inverse: FloatArray, alpha: FloatArray, hyper: Hyperparameters) -> float:
        """Return the part of the derivative by the logarithm of the noise that is due to what visits share."""
        later, earlier = (3 * rows[:, None] + np.arange(3) for rows in self._pairs)
        slope = inverse[earlier, later] - alpha[earlier] * alpha[later]
        return 2.0 * self._share * hyper.noise**2 * float(slope.sum())


@dataclass(frozen=True, eq=False)
class CovarianceForm:
    """The posterior from the factorised covariance K of all readings.

    Attributes
    ----------
    factor : (3n, 3n) array
        The lower Cholesky factor of K.
    alpha : (3n,) array
        The vector K⁻¹ e.
    """

    terms: Terms
    design: Design
    joints: IntArray
    hyper: Hyperparameters
    factor: FloatArray
    alpha: FloatArray

    @classmethod
    def of(
        cls,
        terms: Terms,
        design: Design,
        joints: IntArray,
        hyper: Hyperparameters,
        e: FloatArray,
        noise_variance: FloatArray,
    ) -> Self:
        """Factorise for errors (n, 3) [mm] whose noise has variances (n, 3), or covariances (n, 3, 3) [mm²].

        Raises
        ------
        KrigingError
            If the covariance is singular.
        """
        blank = cls(terms, design, joints, hyper, np.empty((0, 0)), np.empty(0))
        covariance = blank._covariance_with(design)
        add_to_diagonal(covariance, noise_variance)
        later, earlier = pairs_of(design.visit)
        add_shared(covariance, (earlier, later), terms.share * hyper.noise**2)  # of the transpose
        factor, failed = lapack.dpotrf(covariance.T, lower=1, clean=1, overwrite_a=1)
        if failed:
            raise KrigingError(
                "the covariance of kinematic Kriging is singular: poses repeat without noise; pass noise_std"
            )
        alpha = lapack.dpotrs(factor, e.reshape(-1), lower=1)[0]
        return cls(terms, design, joints, hyper, factor, alpha)

    def mean(self, design: Design) -> FloatArray:
        """Return the predicted errors at m configurations, (m, r) [mm, rad]."""
        found = [self._covariance_with(part) @ self.alpha for part in parts(design, _CHUNK)]
        return np.concatenate(found).reshape(-1, design.rows)

    def covariance(self, design: Design) -> FloatArray:
        """Return the covariance of the noise-free error at m configurations, (m, r, r) [mm², rad²]."""
        return self.posterior(design)[1]

    def posterior(self, design: Design) -> tuple[FloatArray, FloatArray]:
        """Return `mean` and `covariance`."""
        means, covariances = [], []
        for part in parts(design, _CHUNK):
            cross = self._covariance_with(part)
            means.append((cross @ self.alpha).reshape(-1, design.rows))
            half: FloatArray = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
            half = half.reshape(len(self.alpha), -1, design.rows)
            covariances.append(self.prior_covariance(part) - np.einsum("kma,kmb->mab", half, half, optimize=True))
        return np.concatenate(means), np.concatenate(covariances)

    def covariance_together(self, design: Design) -> FloatArray:
        """Return the covariance of the noise-free errors at m configurations with each other, (3m, 3m) [mm²]."""
        half = solve_triangular(self.factor, self._covariance_with(design).T, lower=True, check_finite=False)
        return np.asarray(replace(self, design=design)._covariance_with(design) - half.T @ half)

    def prior_covariance(self, design: Design) -> FloatArray:
        """Return the prior covariance at m configurations, (m, r, r) [mm², rad²]."""
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
        rho = self._joint_covariance(i, angle)
        cross = (rho[:, :, None] * self.design.lever[None, :, :, j]).reshape(len(angle), -1)
        half = solve_triangular(self.factor, cross.T, lower=True, check_finite=False)
        return cross @ self.alpha, std**2 * matern32(joint_chord(angle, angle), length)[0] - half.T @ half

    def _joint_covariance(self, i: int, angle: FloatArray) -> FloatArray:
        """Return the prior covariances of f_j at angles (m,) and at the samples, (m, n) [rad²]."""
        chord = joint_chord(angle, self.design.q[:, self.joints[i]])
        return np.asarray(self.hyper.joint_std[i] ** 2 * matern32(chord, float(self.hyper.joint_length[i]))[0])

    def joint_mean(self, i: int, angle: FloatArray) -> FloatArray:
        """Return the mean of f_j of the i-th joint seen at angles (m,) [rad], (m,) [rad]."""
        lever = self.design.lever[:, :, self.joints[i]]
        weight = np.einsum("na,na->n", lever, self.alpha.reshape(-1, 3))
        return np.asarray(self._joint_covariance(i, angle) @ weight)

    def told(self, design: Design) -> FloatArray:
        """Return columns (3n, r m) whose squared lengths are the variance that the samples remove from the prior's."""
        return np.asarray(
            solve_triangular(self.factor, self._covariance_with(design).T, lower=True, check_finite=False)
        )

    def projected(self, directions: FloatArray, angle: FloatArray) -> tuple[FloatArray, list[FloatArray], FloatArray]:
        """Return `told` in k directions (3n, k), as factors of the columns of the model.

        Parameters
        ----------
        directions : (3n, k) array
            Orthonormal directions among the rows of `told`.
        angle : (t,) array [rad]
            The angles of the joints' functions.

        Returns
        -------
        drift : (p, k) array
            The factors of the drift columns, per prior standard deviation.
        joints : list of (t, k) arrays
            The factors of the lever of each joint seen, at the angles.
        rest : (3, n, k) array
            The factors of Z's correlations with the samples, for each component.
        """
        n, k = len(self.design.q), directions.shape[1]
        flat = solve_triangular(self.factor, directions, lower=True, trans="T", check_finite=False)
        drift = (self.design.drift * tolerances(self.terms, self.hyper) ** 2).reshape(3 * n, -1).T @ flat
        weight = flat.reshape(n, 3, k)
        levers = [self.design.lever[:, :, j] for j in self.joints]
        joints = [
            self._joint_covariance(i, angle) @ np.einsum("na,nak->nk", lever, weight) for i, lever in enumerate(levers)
        ]
        return drift, joints, self.hyper.rest_std**2 * np.swapaxes(weight, 0, 1)

    def rest_mean(self) -> tuple[FloatArray, FloatArray]:
        """Return coordinates over ranges (n, d) and weights (n, 3) [mm]: Z is the sum of correlations times weights."""
        place = _over_ranges(self.design.place, self.terms.range_of, self.hyper)
        return place, self.hyper.rest_std**2 * self.alpha.reshape(-1, 3)

    def left_out(self, block: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals and covariances with the samples of each block left out together.

        With the inverse K⁻¹ in blocks: residual (K⁻¹_bb)⁻¹ (K⁻¹ e)_b of covariance (K⁻¹_bb)⁻¹, noise included.

        Parameters
        ----------
        block : (n,) array of int
            The label of each sample; leave-one-out if all are different.

        Returns
        -------
        residual : (n, 3) array [mm]
        covariance : (n, 3, 3) array [mm²]
        """
        inverse, n = self._inverse, len(block)
        residual, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
        for rows in blocks_by_size(block):
            g, m = rows.shape
            index = (3 * rows[:, :, None] + np.arange(3)).reshape(g, 3 * m)
            left, right = index[:, :, None], index[:, None, :]
            part = np.linalg.inv(inverse[np.maximum(left, right), np.minimum(left, right)])
            residual[rows] = (part @ self.alpha[index][:, :, None]).reshape(g, m, 3)
            full = part.reshape(g, m, 3, m, 3)
            covariance[rows] = np.swapaxes(full[:, np.arange(m), :, np.arange(m)], 0, 1)
        return residual, covariance

    @cached_property
    def alone(self) -> tuple[FloatArray, FloatArray]:
        """`left_out` with each sample left out alone."""
        return self.left_out(np.arange(len(self.design.q)))

    @cached_property
    def _inverse(self) -> FloatArray:
        """K⁻¹, its lower triangle alone, (3n, 3n)."""
        inverse: FloatArray = lapack.dpotri(self.factor, lower=1)[0]
        return inverse

    def _covariance_with(self, design: Design) -> FloatArray:
        """Return the covariance between m configurations and the samples, (r m, 3n) [mm²]."""
        scale, here = tolerances(self.terms, self.hyper), self.design
        left = (design.drift * scale**2).reshape(design.rows * len(design.q), -1)
        covariance = left @ here.drift.reshape(3 * len(here.q), -1).T
        place, other = (_over_ranges(d.place, self.terms.range_of, self.hyper) for d in (design, here))
        add_joints_and_rest(
            covariance, *_turns_and_levers(design, self.joints), *_turns_and_levers(here, self.joints),
            self.hyper.joint_std, self.hyper.joint_length, place, other, self.hyper.rest_std, False,
        )  # fmt: skip
        return np.asarray(covariance)

    def _cross(self, design: Design) -> dict[str, FloatArray]:
        """Return the covariances of each term between m configurations and the samples, (r m, 3n) [mm²] each."""
        m, n, rows = len(design.q), len(self.design.q), design.rows
        scale = tolerances(self.terms, self.hyper)
        out: dict[str, FloatArray] = {}
        for g, name in enumerate(GROUPS):
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
            place, other = (_over_ranges(d.place, self.terms.range_of, self.hyper) for d in (design, self.design))
            rho = self.hyper.rest_std**2 * matern52(cdist(place, other, "sqeuclidean"))[0]
            block = np.zeros((m, rows, n, 3))
            for a in range(3):
                block[:, a, :, a] = rho
            out["rest"] = block.reshape(rows * m, 3 * n)
        return out


def _turns_and_levers(design: Design, joints: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine of half of each joint's angle (m, k, 2), and levers (m, k, r) [mm/rad]."""
    half = np.ascontiguousarray(0.5 * design.q[:, joints])  # one memory layout: compiled once
    lever = np.ascontiguousarray(np.swapaxes(design.lever[:, :, joints], 1, 2))
    return np.stack([np.cos(half), np.sin(half)], axis=2), lever


def _squares(values: FloatArray) -> float:
    return float(np.vdot(values, values))


def _over_ranges(place: FloatArray, range_of: IntArray, hyper: Hyperparameters) -> FloatArray:
    """Return the coordinates of Z (m, d) divided by their ranges; no columns without Z."""
    return place / hyper.rest_range[range_of] if len(hyper.rest_range) else np.empty((len(place), 0))
