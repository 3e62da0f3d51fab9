"""The search of kinematic Kriging: hyperparameters, weights and linearisation, and what is taken of a fleet."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.predictors.kinematic.basis import Basis
from truepose.predictors.kinematic.basis_form import BasisForm, BasisSums
from truepose.predictors.kinematic.covariance_form import CovarianceForm, Likelihood
from truepose.predictors.kinematic.design import Design, take
from truepose.predictors.kinematic.distant import DistantKriging
from truepose.predictors.kinematic.fitting import (
    Start,
    log_evidence,
    refine,
    search,
    search_near,
    spread_starts,
    without_effects,
)
from truepose.predictors.kinematic.fleet import LEVELS, PAYS, Fleet
from truepose.predictors.kinematic.hyperparameters import Hyperparameters, HyperPrior
from truepose.predictors.kinematic.inflation import SEARCHED
from truepose.predictors.kinematic.placing import INSIDE
from truepose.predictors.kinematic.terms import GROUPS
from truepose.predictors.kinematic.weights import ROUNDS, SETTLED, first_weights, robust_weights
from truepose.predictors.reflectors import REFLECTOR, whole_poses

_FIRST: Final = 150  # samples for the comparison of starting points
_ANCHORS: Final = 250  # samples that represent Z in a basis
_LINEARISATIONS, _FAR = 8, 0.3  # the most, and the root mean square change in noise that asks for one more
_SEARCHED_FOR: Final = ("hyper_", "log_likelihood_", "bounds_hit_", "_weight", "_fleet")
_SCALE_SETTLED: Final = 0.05


class _Tried(NamedTuple):
    """The result of a search with a step of a fleet: its log evidence, its optimum, and attributes by name."""

    evidence: float
    optimum: Start
    found: dict[str, Any]


class SearchedKriging(DistantKriging):
    """Kinematic Kriging with its search: `_search` estimates, `_solve` solves with known hyperparameters."""

    if TYPE_CHECKING:
        random_state: int
        solver_: str

    _from: tuple[IntArray, Start] | None = None  # the joints and the start of `start_from`

    def _taking(self, fleet: Fleet) -> Start:
        """Solve with what raises the evidence: nothing of the fleet, its hyperparameters, or also its mean error."""
        rows = np.sort(np.random.default_rng(self.random_state).permutation(len(self._e))[:SEARCHED])
        first = self._tried(replace(fleet, level=LEVELS[0]), rows)
        tried = [first, self._tried(replace(fleet, level=LEVELS[1]), rows, first)]
        if len(fleet.curves):
            tried.append(self._tried(replace(fleet, level=LEVELS[2], scale=1.0), rows, first))
            scale = self._best_scale(rows)
            if abs(scale - 1.0) > _SCALE_SETTLED:
                tried.append(self._tried(replace(fleet, level=LEVELS[2], scale=scale), rows, first))
        best = max(tried, key=lambda one: one.evidence - PAYS * LEVELS.index(one.found["_fleet"].level))
        for name, value in best.found.items():
            setattr(self, name, value)
        self._fleet = replace(best.found["_fleet"], gain=best.evidence - first.evidence)
        self._solve()
        return best.optimum

    def _tried(self, fleet: Fleet, rows: IntArray, first: _Tried | None = None) -> _Tried:
        """Search with a step of the fleet; the evidence is that of some rows with the weights of the first search."""
        self._fleet, self._terms = fleet, self._nominal
        optimum = self._search()
        found = {name: getattr(self, name) for name in _SEARCHED_FOR}
        self._weight = self._weight if first is None else first.found["_weight"]
        return _Tried(log_evidence(self._likelihood(self._form.design, rows), optimum), optimum, found)

    def _best_scale(self, rows: IntArray) -> float:
        """Return the factor of the fleet's mean error with the largest likelihood, which is quadratic in it; 0 to 1."""
        assert self._fleet is not None
        full, value = self._fleet, []
        for scale in (0.0, 0.5, 1.0):
            self._fleet = replace(full, scale=scale)
            value.append(self._likelihood(self._form.design, rows)(self.hyper_)[0])
        curved = value[0] - 2.0 * value[1] + value[2]
        return float(np.clip(0.5 + 0.25 * (value[0] - value[2]) / curved, 0.0, 1.0)) if curved > 0.0 else 1.0

    def _search(self) -> Start:
        """Solve with the best hyperparameters; again about the estimated base and tool while they leave their prior."""
        found = self._search_here()
        for _ in range(_LINEARISATIONS):
            own = self._nominal.placed
            estimate = self._form.drift_estimate()[0][own]
            if np.abs(estimate).max(initial=0.0) <= INSIDE:
                break
            centre = self._nominal.centre[own] + estimate * self._nominal.prior_std[own]
            self._terms = self._nominal = self._nominal.centred(centre)
            found = self._search_here(None if self.bounds_hit_ else found)  # what a bound holds may be stuck
        return found

    def _search_here(self, start: Start | None = None) -> Start:
        """Solve with the best hyperparameters, found at the nominal arm, and again where the estimated one is far."""
        found, searched_at = self._estimate(self._nominal.at(self._x), start), np.zeros_like(self._e)
        for _ in range(_LINEARISATIONS):
            self._solve()
            curvature = self._terms.curvature(self._form.design)
            if _size(curvature - searched_at) < _FAR * self.hyper_.noise:
                return found
            found, searched_at = self._estimate(self._form.design, found), curvature
        self._solve()
        return found

    def _estimate(self, design: Design, start: Start | None) -> Start:
        """Search hyperparameters and robust weights alternately until the weights settle; return the optimum."""
        n, target = len(self._e), self._target(design)
        order = np.random.default_rng(self.random_state).permutation(n)
        if start is None:
            self._weight = first_weights(design.drift, target) if self.robust else np.ones(n)
            start = self._first_start(design, np.sort(order[:_FIRST]))
        for turn in range(ROUNDS):
            if turn == 0 or self.solver_ == "covariance":
                found, start = search_near(self._likelihood(design, np.sort(order[:SEARCHED])), start)
                self.hyper_, self.log_likelihood_ = found.hyper, found.log_likelihood
                groups = [GROUPS[group] for group in self._terms.scaled_groups]
                names = found.hyper.names(self.joints_.tolist(), groups, self._terms.range_names)
                self.bounds_hit_ = [names[place] for place in found.bounds_hit]
            self._form = self._solved(design, refining=turn == 0)
            if not self.robust:
                break
            weight = robust_weights(*self._left_out_alone())
            change = np.abs(np.sqrt(weight) - np.sqrt(self._weight))
            self._weight = weight
            if change.max() < SETTLED:
                break
        self.hyper_ = without_effects(self._likelihood(design, np.sort(order[:SEARCHED])), self.hyper_)
        return Start(self.hyper_, start.curvature)

    def _first_start(self, design: Design, rows: IntArray) -> Start:
        """Return the start of the search: that of `start_from` if it has the same joints, or the optimum of `rows`."""
        if self._from is not None and self._fleet is None and np.array_equal(self._from[0], self.joints_):
            return self._from[1]
        conditions = len(self._terms.scaled_groups) - 2
        weak = HyperPrior().for_angles(design.q[:, self.joints_])
        if self._fleet is not None:
            weak = self._fleet.prior(self.joints_, self._terms.range_names, weak)
        hyper = Hyperparameters.start(len(self.joints_), len(self._terms.range_names), conditions, weak=weak)
        return search(self._likelihood(design, rows), spread_starts(hyper) if len(self.joints_) else [hyper])[1]

    def _likelihood(self, design: Design, rows: IntArray) -> Likelihood:
        target = self._target(design)[rows]
        return Likelihood(
            self._terms, take(design, rows), self.joints_, target, self._reading[rows], self._weight[rows]
        )

    def _solved(self, design: Design, refining: bool = False) -> CovarianceForm | BasisForm:
        """Return the posterior; in a basis, all samples may refine the hyperparameters first."""
        if self.solver_ == "covariance":
            return CovarianceForm.of(
                self._terms, design, self.joints_, self.hyper_, self._target(design), self._noise_variance()
            )
        rng = np.random.default_rng(self.random_state)
        anchor = take(design, np.sort(rng.permutation(len(self._e))[:_ANCHORS])) if self._terms.range_names else None
        basis = Basis.of(self._terms, self.joints_, self.hyper_, anchor, angles=design.q)
        if refining:
            found = refine(
                basis,
                BasisSums.of(basis, design, self.hyper_, self._target(design), self._noise_variance()),
                self.hyper_,
            )
            self.hyper_, self.log_likelihood_ = found.hyper, found.log_likelihood
        return BasisForm.of(basis, design, self.hyper_, self._target(design), self._noise_variance())

    def _solve(self) -> None:
        """Solve at the nominal arm, and at the estimated registration and geometry until these stand still."""
        self._terms = self._nominal
        self._form = self._solved(self._terms.at(self._x))
        before = np.zeros_like(self._e)
        for _ in range(_LINEARISATIONS):
            self._aim()
            moved = self._form.drift_estimate()[0] * self._terms.prior_std
            self._terms = self._terms.shifted(self._terms.centre + moved)
            design = self._terms.at(self._x)
            self._form = self._solved(design)
            curvature = self._terms.curvature(design)
            if _size(curvature - before) < _FAR * self.hyper_.noise:
                break
            before = curvature

    def _target(self, design: Design) -> FloatArray:
        """Return the errors of the samples minus what is known of them at the current linearisation."""
        return self._e - self._known(design)

    def _poses_out(self) -> tuple[FloatArray, FloatArray]:
        """Return residuals and covariances of each reading without those of its pose."""
        if REFLECTOR in self.conditions:
            return self._form.left_out(whole_poses(self._form.design.q, self._form.design.visit))
        return self._form.alone if len(self._own) == len(self._given[1]) else self._form.left_out(self._own)


def _size(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))
