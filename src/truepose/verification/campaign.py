"""Find faults of a measuring campaign: a moved tracker, a wrong scale, a drift, changed reference points.

The errors e (n, 3) of a campaign are modelled as

    e = X x + H θ + g + r,        x ~ N(0, T²),   g ~ GP(0, γ² k(u, u′)) per component,   r ~ N(0, σ²)

X are the columns of the arm's own deviations (kinematic parameters with their tolerances T; the station is free), g is
a smooth field of the remaining errors over the coordinates u (joints or positions), and H are the columns of a fault:
six for a rigid motion between two parts of the campaign, six for a rigid motion that grows with time, one for a scale.
σ, γ and the length of k are estimated by restricted likelihood (Patterson and Thompson 1971) with H in the model, so
that a fault does not inflate the noise. An F test compares θ with its covariance, which includes all that X and g can
imitate: if a plan visits the region in order, a drift is hardly distinguishable from the arm's own errors, and its
standard error is large.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, Final

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.spatial.distance import cdist
from scipy.special import chdtri, fdtrc

from truepose._typing import BoolArray, FloatArray, IntArray
from truepose.geometry.transforms import cross_matrix
from truepose.verification.faults import Change, Kind, fault

FEWEST: Final = 16
"""The smallest number of samples that is tested."""
LARGEST: Final = 300
"""The largest number of samples that is tested; larger campaigns are thinned at random."""

_SIDE: Final = 8  # samples on either side of a motion
_CUTS: Final = 48  # positions of a motion tried before the best is refined
_LENGTHS: Final = (0.15, 0.4, 1.0)  # of k, in units of the spread of the coordinates
_RATIOS: Final = (0.3, 3.0, 30.0, 300.0)  # γ²/σ², beside 0
_STEPS: Final = 4  # for σ
_WORTH: Final = 0.01  # p-value below which a fault is fitted
_DEGREE: Final = 3
_GROSS: Final = 40.0  # squared distance beyond which a sample is gross; χ² with three degrees of freedom: 1 in 10⁸
_ROUNDS: Final = 4
_KINDS: Final = ("moved", "drift", "scale")
_DIFFUSE: Final = 1e-6  # prior weight of free columns [1/mm²]
_FLOOR: Final = 1e-4  # of σ [mm]


@dataclass(frozen=True, eq=False)
class Campaign:
    """The errors of a campaign in order of time, with the columns of their model.

    Attributes
    ----------
    e : (n, 3) array [mm], base frame
        The positional errors.
    p : (n, 3) array [mm], base frame
        The commanded positions.
    coordinates : (n, d) array
        The coordinates over which the arm's errors are smooth.
    columns : (n, 3, k) array
        The change of the errors by one tolerance of each parameter of the arm [mm].
    when : (n,) array
        The time, or the rank in order of time.
    rotation : (n, 3, 3) array, optional
        The orientations of the flange, or of the tool.
    """

    e: FloatArray
    p: FloatArray
    coordinates: FloatArray
    columns: FloatArray
    when: FloatArray
    rotation: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.e)

    def __getitem__(self, rows: IntArray | BoolArray) -> Campaign:
        rotation = None if self.rotation is None else self.rotation[rows]
        own = self.e[rows], self.p[rows], self.coordinates[rows], self.columns[rows], self.when[rows]
        return Campaign(*own, rotation)

    @cached_property
    def rigid(self) -> FloatArray:
        """The columns of a rigid motion about the samples' centre, (n, 3, 6): translation [mm], rotation [rad]."""
        turned = -cross_matrix(self.p - self.p.mean(axis=0))
        return np.concatenate([np.tile(np.eye(3), (len(self), 1, 1)), turned], axis=2)

    @cached_property
    def smooth(self) -> FloatArray:
        """The columns of fields cubic in the position, (n, 3, 57) [mm]; the RMS of each is 1 mm over its degree."""
        unit = (self.p - self.p.mean(axis=0)) / np.maximum(self.p.std(axis=0), 1.0)
        powers = [w for w in product(range(_DEGREE + 1), repeat=3) if 0 < sum(w) <= _DEGREE]
        terms = np.stack([np.prod(unit**w, axis=1) for w in powers], axis=1)
        terms = terms / np.maximum(np.sqrt(np.mean(terms**2, axis=0)), 1e-9) / np.sum(powers, axis=1)
        return np.asarray(np.einsum("nk,ab->nakb", terms, np.eye(3)).reshape(len(self), 3, -1))

    @cached_property
    def tested(self) -> tuple[IntArray, Campaign]:
        """The rows and the samples that are tested: at most `LARGEST`, without gross ones."""
        rows = thinned(len(self))
        part = self[rows]
        if len(rows) >= FEWEST and not (keep := _sound(part)).all():
            return rows[keep], part[keep]
        return rows, part

    @cached_property
    def field(self) -> Fitted:
        """The fitted model without faults, with the cubic fields."""
        return fit(self, [])

    @cached_property
    def spectra(self) -> list[tuple[FloatArray, FloatArray]]:
        """Uᵀ and the eigenvalues of the Matérn 3/2 correlation of the samples, for each length of k."""
        spread = float(np.sqrt(self.coordinates.var(axis=0).sum())) or 1.0
        distance = cdist(self.coordinates, self.coordinates) / spread
        found = []
        for length in _LENGTHS:
            r = np.sqrt(3.0) * distance / length
            value, vectors = np.linalg.eigh((1.0 + r) * np.exp(-r))
            found.append((np.asarray(vectors.T), np.maximum(value, 0.0)))
        return found

    @property
    def growing(self) -> FloatArray:
        """The columns of a rigid motion that grows by 1 from the first sample to the last, (n, 3, 6)."""
        span = np.ptp(self.when)
        return np.asarray(self.rigid * ((self.when - self.when.mean()) / (span or 1.0))[:, None, None])

    @property
    def stretched(self) -> FloatArray:
        """The column of a scale, (n, 3, 1)."""
        return np.asarray((self.p - self.p.mean(axis=0))[:, :, None])

    def moved(self, at: int) -> FloatArray:
        """Return the columns of a rigid motion of a sample and all later ones, (n, 3, 6)."""
        return np.asarray(self.rigid * (np.arange(len(self)) >= at)[:, None, None])


def changes(campaign: Campaign) -> list[Change]:
    """Return the faults of a campaign, the clearest first; empty below `FEWEST` samples.

    Faults are added one at a time, the most significant first, and each is tested together with those found before.

    Parameters
    ----------
    campaign : Campaign
        The errors and the columns of their model.

    Returns
    -------
    list of Change
        The faults that are significant and large enough.
    """
    rows, part = campaign.tested
    if len(rows) < FEWEST:
        return []
    found: list[_Cause] = []
    for _ in _KINDS:
        known = [cause.columns for cause in found]
        tested = [
            (change.p_value, cause)
            for cause in _causes(part, known)
            if cause.kind not in {one.kind for one in found} and (change := _change(part, cause, known)).notable
        ]
        if not tested:
            break
        found.append(min(tested, key=lambda one: one[0])[1])
    final = [_change(part, one, [other.columns for other in found if other is not one]) for one in found]
    return [replace(change, rows=(int(rows[change.rows[0]]), int(rows[change.rows[1]]))) for change in final]


def suspected_drift(campaign: Campaign) -> float:
    """Return the root mean square displacement of a drift that is too uncertain to be named as a fault [mm].

    Zero where a drift as large as the estimate has a chance of 1 % or more without a drift. The square of the estimate
    is reduced by its variance, so that noise does not add to it.
    """
    rows, part = campaign.tested
    if len(rows) < FEWEST or np.ptp(campaign.when) == 0:
        return 0.0
    drift = _Cause("drift", 0, part.growing)
    if part.field.chance(drift.columns) >= _WORTH:
        return 0.0
    model = fit(part, [drift.columns])
    mean_square = np.einsum("nap,naq->pq", part.rigid, part.rigid) / len(part)
    excess = model.theta @ mean_square @ model.theta - np.trace(mean_square @ model.covariance)
    return float(np.sqrt(max(excess, 0.0)))


def thinned(n: int) -> IntArray:
    """Return the rows of n that are tested, at most `LARGEST`."""
    return np.sort(np.random.default_rng(0).choice(n, min(n, LARGEST), replace=False))


def noise(campaign: Campaign) -> float:
    """Return the standard deviation of the errors beyond the arm's parameters and a smooth field [mm]."""
    return campaign[thinned(len(campaign))].field.sigma


@dataclass(frozen=True, eq=False)
class Fitted:
    """The fitted model: σ, θ of the added columns with its covariance, and the factors for tests of further columns."""

    sigma: float
    freedom: float
    theta: FloatArray
    covariance: FloatArray
    turned: FloatArray  # Uᵀ of the eigenvectors of k
    weight: FloatArray  # 1 / variance of each eigenvector
    design: FloatArray  # Uᵀ X, (n, 3, k)
    factor: FloatArray  # Cholesky factor of the normal matrix
    pulled: FloatArray  # (n, 3): weighted residuals, turned

    def chance(self, columns: FloatArray, tries: int = 1) -> float:
        """Return the p-value of further columns to first order: with the variances of the model without them."""
        explained, k = _explained(*self.against(columns)), columns.shape[2]
        left = max(self.freedom - explained, 1e-9)
        return min(1.0, tries * float(fdtrc(k, self.freedom, max(explained, 0.0) / k / left * self.freedom)))

    def against(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return Hᵀ P H and Hᵀ P e of further columns (n, 3, k), P the precision after the model's own columns."""
        n, k = len(columns), columns.shape[2]
        turned = (self.turned @ columns.reshape(n, -1)).reshape(n * 3, k)
        weighted = turned * np.repeat(self.weight, 3)[:, None]
        half = solve_triangular(self.factor, self.design.reshape(n * 3, -1).T @ weighted, lower=True)
        return weighted.T @ turned - half.T @ half, turned.T @ self.pulled.reshape(-1)


@dataclass(frozen=True, eq=False)
class _Cause:
    """A fault to test: its first sample, its columns, and the number of positions that were tried."""

    kind: Kind
    at: int
    columns: FloatArray
    tries: int = 1


def fit(campaign: Campaign, added: list[FloatArray], smooth: bool = True) -> Fitted:
    """Fit σ, γ and the length of k by restricted likelihood, with additional columns that have no prior."""
    n = len(campaign)
    free = np.concatenate([campaign.rigid, *added], axis=2)
    unit = np.maximum(np.sqrt(np.mean(free**2, axis=(0, 1))), 1e-12)
    own = [campaign.columns, campaign.smooth] if smooth else [campaign.columns]
    design = np.concatenate([*own, free / unit], axis=2)
    prior = np.r_[np.ones(design.shape[2] - free.shape[2]), np.full(free.shape[2], _DIFFUSE)]
    best: tuple[float, Any] = (np.inf, None)
    start = float(np.median(np.abs(campaign.e))) + _FLOOR
    for i, (turned, value) in enumerate(campaign.spectra):
        x = (turned @ design.reshape(n, -1)).reshape(n * 3, -1)
        y = (turned @ campaign.e).reshape(-1)
        for ratio in _RATIOS if i else (0.0, *_RATIOS):
            shape = np.repeat(1.0 + ratio * value, 3)
            loss, rest = _scaled(x, y, prior, shape, start)
            if loss < best[0]:
                best = loss, (turned, x, y, shape, *rest)
    turned, x, y, shape, sigma, factor, beta, freedom = best[1]
    weight = 1.0 / (sigma**2 * shape)
    k = free.shape[2] - 6
    covariance = cho_solve((factor, True), np.eye(len(factor)))[len(factor) - k :, len(factor) - k :]
    unit = unit[6:]
    return Fitted(
        sigma=sigma,
        freedom=freedom,
        theta=beta[len(beta) - k :] / unit,
        covariance=covariance / np.outer(unit, unit),
        turned=turned,
        weight=weight[::3],
        design=x.reshape(n, 3, -1),
        factor=factor,
        pulled=(weight * (y - x @ beta)).reshape(n, 3),
    )


def _scaled(
    x: FloatArray, y: FloatArray, prior: FloatArray, shape: FloatArray, sigma: float
) -> tuple[float, tuple[float, FloatArray, FloatArray, float]]:
    """Find σ for one shape of the variances; return the restricted −log likelihood and σ, factor, x̂, freedom."""
    scaled, seen = x / shape[:, None], x.T @ (x / shape[:, None])
    right = scaled.T @ y
    for _ in range(_STEPS):
        normal = seen / sigma**2 + np.diag(prior)
        factor = np.asarray(cholesky(normal, lower=True))
        beta = np.asarray(cho_solve((factor, True), right / sigma**2))
        left = y - x @ beta
        spread = (solve_triangular(factor, np.eye(len(factor)), lower=True) ** 2).sum(axis=0)
        used = len(factor) - float(prior @ spread)
        freedom = max(len(y) - used, 1.0)
        before, sigma = sigma, max(float(np.sqrt(left**2 @ (1.0 / shape) / freedom)), _FLOOR)
    squares = float(left**2 @ (1.0 / shape)) / before**2 + float(prior @ beta**2)
    logs = float(np.log(shape).sum()) + len(y) * np.log(before**2) + 2.0 * float(np.log(np.diag(factor)).sum())
    return 0.5 * (squares + logs), (before, factor, beta, freedom)


def _causes(campaign: Campaign, known: list[FloatArray]) -> list[_Cause]:
    """Return the faults whose first-order p-value justifies a fit."""
    cuts = np.arange(_SIDE, len(campaign) - _SIDE + 1)
    field = fit(campaign, known) if known else campaign.field
    arm = fit(campaign, known, smooth=False)
    at = _best_cut(campaign, field, cuts)
    listed = [(field, _Cause("moved", at, campaign.moved(at), len(cuts)))]
    if np.ptp(campaign.when) > 0:
        listed.append((field, _Cause("drift", 0, campaign.growing)))
    listed.append((arm, _Cause("scale", 0, campaign.stretched)))
    return [cause for model, cause in listed if model.chance(cause.columns, cause.tries) < _WORTH]


def _best_cut(campaign: Campaign, model: Fitted, cuts: IntArray) -> int:
    """Return the position of the motion that explains most.

    A motion that starts at the edge of a segment is a sum of the segments' own columns, so one product serves all of
    them; the positions near the best one are then tried one by one.
    """
    rough = np.unique(np.linspace(cuts[0], cuts[-1], min(_CUTS, len(cuts))).astype(np.intp))
    segment = np.searchsorted(rough, np.arange(len(campaign)), side="right")
    parts = campaign.rigid[:, :, None, :] * (segment[:, None] == np.arange(1, len(rough) + 1))[:, None, :, None]
    squares, right = model.against(parts.reshape(len(campaign), 3, -1))
    k = len(rough)
    blocks = squares.reshape(k, 6, k, 6)[::-1, :, ::-1].cumsum(axis=0).cumsum(axis=2)[::-1, :, ::-1]
    sums = right.reshape(k, 6)[::-1].cumsum(axis=0)[::-1]
    explained = [_explained(blocks[i, :, i], sums[i]) for i in range(k)]
    i = int(np.argmax(explained))
    near = cuts[(cuts > rough[max(i - 1, 0)]) & (cuts < rough[min(i + 1, k - 1)])]
    tried = {int(rough[i]): explained[i]}
    tried |= {int(at): _explained(*model.against(campaign.moved(int(at)))) for at in near if at not in tried}
    return max(tried, key=tried.__getitem__)


def _explained(squares: FloatArray, right: FloatArray) -> float:
    return float(right @ np.linalg.lstsq(squares, right, rcond=1e-10)[0])


def _sound(campaign: Campaign) -> BoolArray:
    """Return the samples that are not gross, (n,); single gross readings would hide all other effects.

    Samples are gross only if they are also far off when the best motion is in the model.
    """
    keep = np.ones(len(campaign), np.bool_)
    for _ in range(_ROUNDS):
        rows = np.flatnonzero(keep)
        part = campaign if keep.all() else campaign[rows]
        if len(rows) < FEWEST or not (gross := _gross(part.field)).any():
            break
        cuts = np.arange(_SIDE, len(part) - _SIDE + 1)
        gross &= _gross(fit(part, [part.moved(_best_cut(part, part.field, cuts))]))
        if not gross.any():
            break
        keep[rows[gross]] = False
    return keep


def _gross(model: Fitted) -> BoolArray:
    distance = _left_out(model)
    return np.asarray(distance > _GROSS * max(float(np.median(distance)) / chdtri(3, 0.5), 1e-12))


def _left_out(model: Fitted) -> FloatArray:
    """Return the squared standardised distance of each sample from what the others predict, (n,)."""
    n = len(model.pulled)
    pulled = model.turned.T @ model.pulled  # P e
    weighted = model.design * model.weight[:, None, None]
    half = solve_triangular(
        model.factor, (model.turned.T @ weighted.reshape(n, -1)).reshape(n * 3, -1).T, lower=True
    ).reshape(-1, n, 3)
    own = np.einsum("ki,k,ki->i", model.turned, model.weight, model.turned)[:, None, None] * np.eye(3)
    own = own - np.einsum("pia,pib->iab", half, half)
    return np.asarray(np.einsum("ia,ia->i", pulled, np.linalg.solve(own, pulled[..., None])[..., 0]))


def _change(campaign: Campaign, cause: _Cause, known: list[FloatArray]) -> Change:
    """Return a fault, tested together with known ones."""
    model, k = fit(campaign, [*known, cause.columns], smooth=cause.kind != "scale"), cause.columns.shape[2]
    columns = campaign.stretched if cause.kind == "scale" else campaign.rigid
    ends = (cause.at - 1, cause.at) if cause.kind == "moved" else (0, len(campaign) - 1)
    return fault(cause.kind, model.theta[-k:], model.covariance[-k:, -k:], columns, model.freedom, cause.tries, ends)
