"""The columns that represent theory (10) in a basis.

Each f_j is represented by knots over the angles of its joint, Z by a subset of samples (Nyström). The variance that the
columns do not represent is added to the noise of each sample and prediction (FITC, Snelson and Ghahramani 2006);
without it, predicted standard deviations would be too small between knots and anchors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from scipy.spatial.distance import cdist

from truepose._typing import FloatArray, IntArray
from truepose.predictors.kinematic.covariance_form import tolerances
from truepose.predictors.kinematic.design import Design
from truepose.predictors.kinematic.hyperparameters import Hyperparameters
from truepose.predictors.kinematic.kernels import joint_chord, matern32, matern52
from truepose.predictors.kinematic.noise import add_to_blocks
from truepose.predictors.kinematic.terms import GROUPS, Terms
from truepose.predictors.kinematic.visits import with_shared

_KNOTS: Final = 8.0  # per length l of a joint; they miss less than 0.1 % of the variance of f_j
_MOST_KNOTS: Final = 150
_NEGLIGIBLE: Final = 1e-4
_TINY: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Basis:
    """The columns that represent (10) at given lengths and ranges.

    Attributes
    ----------
    joints : (k,) array of int
        The joints with an error of their own.
    joint_length : (k,) array [rad]
        The lengths l_j.
    knots : tuple of k arrays [rad]
        The knots of each f_j.
    knot_maps : tuple of k arrays
        The maps from correlations with the knots to the columns of f_j.
    anchor : Design, optional
        The configurations that represent Z.
    anchor_map : (a, r) array
        The map from correlations with the anchors to the columns of Z.
    """

    terms: Terms
    joints: IntArray
    joint_length: FloatArray
    knots: tuple[FloatArray, ...]
    knot_maps: tuple[FloatArray, ...]
    rest_range: FloatArray
    anchor: Design | None
    anchor_map: FloatArray

    @classmethod
    def of(
        cls,
        terms: Terms,
        joints: IntArray,
        hyper: Hyperparameters,
        anchor: Design | None,
        *,
        angles: FloatArray | None = None,
        knots: float = _KNOTS,
        most: int = _MOST_KNOTS,
        negligible: float = _NEGLIGIBLE,
    ) -> Self:
        """Return a basis for the lengths of `hyper`, with Z on the anchors at its ranges.

        Parameters
        ----------
        terms, joints, hyper
            The terms, joints and hyperparameters of the model.
        anchor : Design, optional
            The configurations that represent Z.
        angles : (n, dof) array [rad], optional
            The angles that the knots span; default: those of the anchors, or a full turn.
        knots, most : float, int
            The number of knots per length l, and the largest number of knots of a joint.
        negligible : float
            The share of the largest eigenvalue of the anchors' correlation below which eigenvalues count as noise.
        """
        spans = np.array([[-np.pi], [np.pi]]) if angles is None and anchor is None else angles
        spans = anchor.q if spans is None and anchor is not None else spans
        assert spans is not None
        at, maps = [], []
        for j, length in zip(joints, hyper.joint_length, strict=True):
            angle = spans[:, j if spans.shape[1] > 1 else 0]
            low, high = float(angle.min()), min(float(angle.max()), float(angle.min()) + 2.0 * np.pi)
            count = int(np.clip(np.ceil((high - low) * knots / length) + 1, 2, most))
            at.append(np.linspace(low, high, count))
            maps.append(_root(matern32(joint_chord(at[-1], at[-1]), float(length))[0], _TINY))
        anchor_map = np.empty((0, 0))
        if anchor is not None and len(hyper.rest_range):
            anchor_map = _root(_rest_correlation(terms, hyper.rest_range, anchor, anchor), negligible)
        kept = anchor if anchor_map.size else None
        return cls(terms, joints, hyper.joint_length, tuple(at), tuple(maps), hyper.rest_range, kept, anchor_map)

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Names and numbers of columns of the terms, in order."""
        drift = [(name, int((self.terms.group == g).sum())) for g, name in enumerate(GROUPS)]
        joint = [(f"joint {j + 1}", m.shape[1]) for j, m in zip(self.joints, self.knot_maps, strict=True)]
        return [*drift, *joint, ("rest", 3 * self.anchor_map.shape[1])]

    def joint_columns(self, i: int, angle: FloatArray) -> FloatArray:
        """Return the columns of f_j of the i-th joint at angles (m,) [rad], for unit variance: (m, k)."""
        rho = matern32(joint_chord(angle, self.knots[i]), float(self.joint_length[i]))[0]
        return np.asarray(rho @ self.knot_maps[i])

    def rest_columns(self, design: Design) -> FloatArray:
        """Return the columns of one component of Z at m configurations, for unit variance: (m, r)."""
        if self.anchor is None:
            return np.empty((len(design.q), 0))
        return np.asarray(_rest_correlation(self.terms, self.rest_range, design, self.anchor) @ self.anchor_map)

    def columns(self, design: Design) -> FloatArray:
        """Return Φ at m configurations, (r m, p); Z knows no orientation."""
        return self.columns_with_missing(design)[0]

    def columns_with_missing(
        self, design: Design, hyper: Hyperparameters | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return Φ, and with hyperparameters the prior covariance missing in it, (m, r, r) [mm², rad²]."""
        m, rows = len(design.q), design.rows
        counts = [count for _, count in self.groups]
        edges = np.cumsum([0, *counts])
        phi = np.zeros((m, rows, int(edges[-1])))
        first = edges[len(GROUPS)]
        phi[:, :, :first] = design.drift[:, :, np.argsort(self.terms.group, kind="stable")]
        missing = np.zeros((m, rows, rows))
        for i, j in enumerate(self.joints):
            own, lever = self.joint_columns(i, design.q[:, j]), design.lever[:, :, j]
            start, end = edges[len(GROUPS) + i : len(GROUPS) + i + 2]
            np.multiply(lever[:, :, None], own[:, None, :], out=phi[:, :, start:end])
            if hyper is not None:
                left = hyper.joint_std[i] ** 2 * np.maximum(1.0 - np.einsum("mk,mk->m", own, own), 0.0)
                missing += left[:, None, None] * lever[:, :, None] * lever[:, None, :]
        rest = self.rest_columns(design)
        width = rest.shape[1]
        for a in range(3):
            phi[:, a, edges[-2] + a * width : edges[-2] + (a + 1) * width] = rest
        if hyper is not None and self.anchor is not None:
            left = hyper.rest_std**2 * np.maximum(1.0 - np.einsum("mr,mr->m", rest, rest), 0.0)
            missing += left[:, None, None] * np.diag(np.arange(rows) < 3)
        return phi.reshape(rows * m, -1), missing

    def left_out_covariance(self, design: Design, hyper: Hyperparameters) -> FloatArray:
        """Return the prior covariance missing in the columns at m configurations, (m, r, r) [mm², rad²].

        It belongs to Z away from the anchors, and to joint errors between the knots and beyond the sampled angles.
        """
        return self.columns_with_missing(design, hyper)[1]

    def prior(self, hyper: Hyperparameters) -> FloatArray:
        """Return the prior variances Λ of the weights, (p,)."""
        order = np.argsort(self.terms.group, kind="stable")
        joint = [np.full(m.shape[1], std**2) for std, m in zip(hyper.joint_std, self.knot_maps, strict=True)]
        rest = np.full(3 * self.anchor_map.shape[1], hyper.rest_std**2)
        return np.concatenate([tolerances(self.terms, hyper)[order] ** 2, *joint, rest])

    def whitened(
        self, design: Design, hyper: Hyperparameters, e: FloatArray, noise_variance: FloatArray, together: int = 1
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return L⁻¹Φ (3m, p), L⁻¹e (3m,) and the noise covariance L Lᵀ (g, 3t, 3t) of each t samples of one visit.

        The noise covariance sums the variances (m, 3), or covariances (m, 3, 3) [mm²], of the readings and the
        covariance missing in the columns.
        """
        phi, noise = self.columns_with_missing(design, hyper)
        add_to_blocks(noise, noise_variance)
        rows = 3 * together
        if together > 1:
            shared = self.terms.share * hyper.noise**2
            noise = with_shared(noise.reshape(-1, together, 3, 3), design.visit.reshape(-1, together), shared)
        white, g = np.linalg.inv(np.linalg.cholesky(noise)), len(noise)
        return (white @ phi.reshape(g, rows, -1)).reshape(rows * g, -1), (white @ e.reshape(g, rows, 1)).ravel(), noise


def _root(correlation: FloatArray, negligible: float) -> FloatArray:
    """Return V λ^(−½) of the larger eigenvalues: correlations times it are columns of unit prior variance."""
    value, vector = np.linalg.eigh(correlation)
    kept = value > negligible * value.max()
    return np.asarray(vector[:, kept] / np.sqrt(value[kept]))


def _rest_correlation(terms: Terms, rest_range: FloatArray, design: Design, other: Design) -> FloatArray:
    near = design.place / rest_range[terms.range_of], other.place / rest_range[terms.range_of]
    return matern52(cdist(*near, "sqeuclidean"))[0]
