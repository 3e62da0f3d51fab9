"""The accuracy to expect of a plan: theory (10) integrated over what is not known of its hyperparameters.

One set of hyperparameters promises too much: real joints have errors of shorter lengths and of other sizes than a
typical arm. Each draw of them gives the covariance of the error after the readings; the expected length of a
difference is the mean over the draws, and its 10 % and 90 % quantiles tell how far the arm at hand may be from it. As
each joint has a size and a length of its own in each draw, the joint errors have heavier tails than normal ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist
from scipy.special import ndtri

from truepose._typing import FloatArray
from truepose.planning.prior import Prior, is_elastic, mean_lengths
from truepose.predictors.kinematic.covariance_form import CovarianceForm
from truepose.predictors.kinematic.hyperparameters import Hyperparameters

_DRAWS: Final = 16
_FEWER_DRAWS: Final = 4  # with many earlier samples, which tell the hyperparameters themselves
_MANY: Final = 300
_TARGETS: Final = 128
_LENGTHS: Final = {True: (0.02, 0.15), False: (0.1, 0.6)}
"""Lengths of joint errors [rad], by whether gears are strain-wave gears, whose lengths are fitted ones. Those of other
gears are an assumption, near that of the virtual cells: no such arm was measured for it."""
_SPREAD: Final = {"joint_std": 0.4, "tolerance": 0.2, "noise": 0.2, "rest_std": 0.5, "rest_range": 0.3}
"""Standard deviations of the logarithms before any sample."""
_SPREAD_AFTER: Final = 0.3
_SAME: Final = 1e-6  # rad
_LIKELY: Final = (0.1, 0.9)


@dataclass(frozen=True, eq=False)
class Forecast:
    """The accuracy to expect over targets, for draws of the hyperparameters.

    Attributes
    ----------
    prior : Prior
        The prior of the plan, before the measurement or after a first series.
    draws : tuple of Hyperparameters
        The draws, each as likely as the others.
    targets : (m, dof) array [rad]
        The configurations at which errors are to be predicted.
    known : (k, dof) array [rad]
        The configurations of the first series.
    """

    prior: Prior
    draws: tuple[Hyperparameters, ...]
    targets: FloatArray
    known: FloatArray

    @classmethod
    def of(cls, prior: Prior, targets: FloatArray, known: FloatArray, rng: int = 0) -> Forecast:
        """Return the forecast of a plan; the draws surround the fitted hyperparameters once there are samples."""
        some = np.random.default_rng(rng).permutation(targets)[:_TARGETS]
        return cls(prior, _drawn(prior.hyper, len(known), is_elastic(prior.basis.terms.robot)), some, known)

    def after(self, q: FloatArray, counts: Sequence[int]) -> list[dict[str, float]]:
        """Return ``n``, ``mean_mm``, ``low_mm`` and ``high_mm`` after the first n of configurations (k, dof) [rad].

        Targets that are measured themselves do not count, as long as others are left: their errors are known better
        than those of the poses at work.
        """
        by_columns = len(self.known) > _MANY
        found = [(self._by_columns if by_columns else self._exactly)(hyper, q, counts) for hyper in self.draws]
        low, high = np.quantile(found, _LIKELY, axis=0)
        return [
            {"n": n, "mean_mm": float(mean), "low_mm": float(a), "high_mm": float(b)}
            for n, mean, a, b in zip(counts, np.mean(found, axis=0), low, high, strict=True)
        ]

    def _exactly(self, hyper: Hyperparameters, q: FloatArray, counts: Sequence[int]) -> list[float]:
        """Factorise the covariance of all readings once; its leading blocks belong to fewer poses."""
        terms, joints = self.prior.basis.terms, self.prior.basis.joints
        every = np.concatenate([self.known, q])
        zero = np.zeros((len(every), 3))
        form = CovarianceForm.of(terms, terms.at(every), joints, hyper, zero, zero + hyper.noise**2)
        targets = terms.at(self.targets)
        told = form.told(targets).reshape(len(every), 3, len(self.targets), 3)
        before = form.prior_covariance(targets) + hyper.noise**2 * np.eye(3)
        lengths, done = [], 0
        for n in counts:
            rows = told[done : len(self.known) + n].reshape(-1, len(self.targets), 3)
            columns = np.moveaxis(rows, 0, 2)
            before = before - columns @ np.swapaxes(columns, 1, 2)
            done = len(self.known) + n
            lengths.append(self._over_open(mean_lengths(before), q[:n]))
        return lengths

    def _by_columns(self, hyper: Hyperparameters, q: FloatArray, counts: Sequence[int]) -> list[float]:
        """Use columns, whose number does not grow with the samples."""
        prior = self.prior.redrawn(hyper).given(self.known)
        lengths = []
        for n in counts:
            then = prior.given(q[:n]) if n else prior
            lengths.append(self._over_open(then.lengths(*then.at(self.targets)), q[:n]))
        return lengths

    def _over_open(self, lengths: FloatArray, q: FloatArray) -> float:
        """Return the mean of the targets' lengths (m,) over those not among joints (n, dof) or the known ones."""
        every = np.concatenate([self.known, q])
        measured = cdist(self.targets, every, "chebyshev").min(axis=1, initial=np.inf) < _SAME
        return float(lengths[~measured].mean() if not measured.all() else lengths.mean())


def _drawn(hyper: Hyperparameters, known: int, elastic: bool) -> tuple[Hyperparameters, ...]:
    """Return draws around hyperparameters; before any sample the joints' lengths are those of measured robots."""
    from scipy.stats import qmc  # takes longer to import than the rest of the package

    count = _DRAWS if known <= _MANY else _FEWER_DRAWS
    theta = hyper.to_vector()
    unit = qmc.Sobol(len(theta), rng=np.random.default_rng(0)).random(count).clip(1e-3, 1 - 1e-3)
    spread = np.full(len(theta), _SPREAD_AFTER)
    if not known:
        kinds = {name: np.size(getattr(hyper, name)) for name in _SPREAD}
        k = len(hyper.joint_std)
        sizes = (
            [_SPREAD["joint_std"]] * k + [0.0] * k + [_SPREAD["tolerance"]] * kinds["tolerance"] + [_SPREAD["noise"]]
        )
        rest = [_SPREAD["rest_std"]] + [_SPREAD["rest_range"]] * kinds["rest_range"] if kinds["rest_range"] else []
        spread = np.array(sizes + rest)
    drawn = [hyper.with_vector(theta + spread * ndtri(row)) for row in unit]
    if known:
        return tuple(drawn)
    k = len(hyper.joint_std)
    low, high = np.log(_LENGTHS[elastic])
    return tuple(
        replace(one, joint_length=np.exp(low + (high - low) * row[k : 2 * k]))
        for one, row in zip(drawn, unit, strict=True)
    )
