"""Find two populations among the readings of a campaign that are not apart in time.

Two reflectors, nests or trackers that are used in turn give readings of two populations, which differ by a constant
vector in the frame of the flange or by a rigid motion in the base frame. With the model of
`truepose.verification.campaign`, of a reading i of the second population

    e_i = (X x)_i + H_i θ + g_i + r_i,        H_i = R_i (flange), or the columns of a rigid motion (base)

Which readings these are is not known: their probabilities and θ are estimated in turn (expectation maximisation). Each
reading is judged by its residual from all others, with Student's t, so that heavy tails make no population. Twice the
gain of the log density by a second population, for as many readings as there are degrees of freedom, is compared with
χ² of twice the number of unknowns (θ and the share). Errors of the arm that the model lacks divide readings as well,
but not far apart (two populations hardly overlap), or as a step in one parameter of the arm. The
arm does not change in turn, from one reading to the next.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import chdtrc

from truepose._typing import BoolArray, FloatArray
from truepose.verification import campaign as testing
from truepose.verification.faults import Change, fault

_LEAST: Final = 5  # readings of a population
_SHARE: Final = 0.1  # of all readings, at least
_APART: Final = 5.0  # standard deviations of a reading between two populations; halves of one are 2 to 4 apart
_ROUNDS: Final = 12
_TAIL: Final = 5.0  # degrees of freedom of Student's t
_SCALES: Final = np.geomspace(0.01, 2.0, 24)  # of the variances of a model without a second population
_MEDIAN: Final = 2.366  # χ² with three degrees of freedom
_MIXED: Final = 0.05  # of readings that change in turn but for these
_ALIKE: Final = 1.1  # ratio of gains, of populations and of a step in the arm
_CONSTANT: Final = 0.012  # of the squared length of vectors
_FARTHEST: Final = 6  # readings
_WORTH: Final = 5.0  # gain from which a model with two populations is fitted
_FAR: Final = 40.0  # squared distance of gross readings


class _LeftOut(NamedTuple):
    """P and P e of a fitted model, and the precision of each reading as predicted from all others, (n, 3, 3)."""

    precision: FloatArray
    e: FloatArray
    own: FloatArray

    @classmethod
    def of(cls, model: testing.Fitted, e: FloatArray) -> _LeftOut:
        """Return them for the fitted model of errors e (n, 3)."""
        n = len(e)
        half = solve_triangular(
            model.factor,
            (model.turned.T @ (model.design * model.weight[:, None, None]).reshape(n, -1)).reshape(n * 3, -1).T,
            lower=True,
        )
        spread = np.einsum("ki,k,kj->ij", model.turned, model.weight, model.turned)
        precision = np.kron(spread, np.eye(3)) - half.T @ half
        return cls(precision, e.reshape(-1), precision.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n)])

    def residual(self, of: FloatArray) -> FloatArray:
        """Return the residual of each reading from all others, (n, 3)."""
        pulled = (self.precision @ of).reshape(-1, 3)
        return np.asarray(np.linalg.solve(self.own, pulled[..., None])[..., 0])

    def distance(self, residual: FloatArray) -> FloatArray:
        """Return the squared distance of residuals in standard deviations, (n,)."""
        return np.asarray(np.einsum("ia,iab,ib->i", residual, self.own, residual))

    def density(self, residual: FloatArray) -> FloatArray:
        """Return the log density of residuals as Student's t for each of `_SCALES`, without its constant, (s, n)."""
        squared = self.distance(residual) / _SCALES[:, None]
        logs = np.linalg.slogdet(self.own)[1] - 3.0 * np.log(_SCALES[:, None])
        return np.asarray(0.5 * logs - 0.5 * (_TAIL + 3.0) * np.log1p(squared / (_TAIL - 2.0)))


class _Second(NamedTuple):
    """A second population: the probabilities of its readings (n,), its columns, and the gain of the log density."""

    member: FloatArray
    columns: FloatArray
    gain: float


def alternating(campaign: testing.Campaign) -> Change | None:
    """Return the two populations of a campaign as a fault, whose `Change.members` are the readings of the smaller one.

    Parameters
    ----------
    campaign : Campaign
        The errors and the columns of their model.
    """
    rows = testing.thinned(len(campaign))
    part = campaign[rows]
    if len(rows) < testing.FEWEST:
        return None
    left = _LeftOut.of(part.field, part.e)
    residual = left.residual(left.e)
    distance = left.distance(residual)
    near = distance <= _FAR * max(float(np.median(distance)) / _MEDIAN, 1e-12)
    if not near.all() and (~near).sum() < max(_LEAST, _SHARE * len(rows)):  # single gross readings
        rows, part = rows[near], part[near]
        if len(rows) < testing.FEWEST:
            return None
        left = _LeftOut.of(part.field, part.e)
        residual = left.residual(left.e)
    found, alone = None, float(left.density(residual).sum(axis=1).max())
    for frame, columns, seen in _frames(part, residual):
        for member in _starts(seen):
            tried = _searched(left, columns, member, alone)
            if tried is not None and tried.gain > _WORTH and (found is None or tried.gain > found[1].gain):
                found = frame, tried
    if found is None:
        return None
    frame, second = found
    member, k = (second.member > 0.5).astype(float), second.columns.shape[2]
    model = testing.fit(part, [second.columns * member[:, None, None]])
    share, smaller = member.mean(), 1.0 if member.mean() <= 0.5 else 0.0
    in_turn = abs(np.mean(member == _by_turns(len(member))) - 0.5) > 0.5 - _MIXED
    if not in_turn and _of_the_arm(left, part, second, alone):
        return None
    members = rows[member == smaller]
    between = fault(
        "alternating",
        model.theta[-k:],
        model.covariance[-k:, -k:],
        second.columns * (member - share)[:, None, None],
        model.freedom,
        1,
        (int(members[0]), int(members[-1])),
    )
    independent = part.field.freedom / part.e.size  # residuals share what the model takes from them
    chance = float(chdtrc(2.0 * (k + 1), 2.0 * second.gain * independent))
    return replace(between, p_value=chance, members=tuple(members.tolist()), frame=frame)


def _of_the_arm(left: _LeftOut, part: testing.Campaign, second: _Second, alone: float) -> bool:
    """Return whether a step in one parameter of the arm explains the second population about as well.

    A parameter that moves all these readings by the same vector does not count: it cannot be told from a population.
    """
    for column in np.moveaxis(part.columns, 2, 0):
        step = _searched(left, column[:, :, None], second.member, alone)
        if step is None or _ALIKE * step.gain < second.gain:
            continue
        own = step.member > 0.5
        turned = column if part.rotation is None else np.einsum("iba,ib->ia", part.rotation, column)
        if not _is_constant(column[own]) and not _is_constant(turned[own]):
            return True
    return False


def _is_constant(vectors: FloatArray) -> bool:
    """Return whether vectors (n, 3) are nearly the same."""
    return bool(np.mean((vectors - vectors.mean(axis=0)) ** 2) < _CONSTANT * np.mean(vectors**2))


def _frames(part: testing.Campaign, residual: FloatArray) -> list[tuple[str, FloatArray, FloatArray]]:
    """Return the frames in which populations may differ: name, columns (n, 3, k), and the residuals in it (n, 3)."""
    found = [("base", part.rigid[:, :, :3], residual)]
    if part.rotation is not None:
        found.insert(0, ("flange", part.rotation, np.einsum("iba,ib->ia", part.rotation, residual)))
    return found


def _starts(seen: FloatArray) -> list[FloatArray]:
    """Return memberships to start from.

    They are either side of the middle along the main directions; by turns; and the readings that are nearer to one of
    the farthest ones than to the middle, since few readings hardly turn the main directions.
    """
    centred = seen - np.median(seen, axis=0)
    size = np.linalg.norm(centred, axis=1)
    beside = [np.linalg.norm(centred - centred[i], axis=1) < size for i in np.argsort(-size)[:_FARTHEST]]
    limited = centred * np.minimum(1.0, 3.0 * np.median(np.abs(centred)) / np.maximum(np.abs(centred), 1e-12))
    axes = np.linalg.svd(limited, full_matrices=False)[2][:2]
    return [*(limited @ axis > 0.0 for axis in axes), _by_turns(len(seen)), *beside]


def _by_turns(n: int) -> BoolArray:
    return np.arange(n) % 2 > 0


def _searched(left: _LeftOut, columns: FloatArray, start: FloatArray, alone: float) -> _Second | None:
    """Find membership and θ in turn, with the variances of one population but for their scale.

    `alone` is the log density of all readings as one population.
    """
    n, k = len(columns), columns.shape[2]
    member, gain = np.asarray(start, float), 0.0
    for _ in range(_ROUNDS):
        if not 1.0 <= member.sum() <= n - 1.0:  # one of the populations has vanished
            return None
        own = (columns * member[:, None, None]).reshape(3 * n, k)
        pulled = left.precision @ own
        theta = np.linalg.lstsq(own.T @ pulled, pulled.T @ left.e, rcond=1e-10)[0]
        away, left_out, share = columns @ theta, left.residual(left.e - own @ theta), np.clip(member.mean(), 0.05, 0.95)
        first = left.density(left_out + member[:, None] * away) + np.log(1.0 - share)
        second = left.density(left_out - (1.0 - member)[:, None] * away) + np.log(share)
        total = np.logaddexp(first, second)  # (scales, n)
        best = int(total.sum(axis=1).argmax())
        gain, member = float(total[best].sum()) - alone, np.exp(second[best] - total[best])
    apart = float(np.sqrt(np.median(left.distance(away)) / _SCALES[best]))
    smaller = min((member > 0.5).sum(), (member <= 0.5).sum())
    if apart < _APART or smaller < max(_LEAST, _SHARE * n):
        return None
    return _Second(member, columns, gain)
