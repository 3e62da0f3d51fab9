"""Observability of parameters: rank, condition number, indices, and the parameters that cannot be separated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from scipy.linalg import qr, solve_triangular

from truepose._typing import FloatArray
from truepose.errors import DataError
from truepose.identification.arm import ParametricArm

_RANK: Final = 1e-8  # singular values of scaled columns, relative to the largest
_UNSEEN: Final = 1e-9  # length of a column, relative to the longest
_PART: Final = 0.05  # of the largest share: parameters with smaller shares are not listed
_NAMED: Final = 6


@dataclass(frozen=True, eq=False, repr=False)
class Observability:
    """The observability of p parameters in n observations.

    Attributes
    ----------
    names : tuple of str
        The names of the parameters.
    rank : int
        The number of combinations of parameters that are determined.
    singular_values : (p,) array
        The singular values of the columns, each scaled to unit length.
    condition : float
        The ratio of the largest to the smallest of the first `rank` singular values.
    indices : dict of str to float
        The indices O1 (volume, Borm and Menq 1989), O2 (inverse condition number, Driels and Pathre 1990), O3
        (smallest, Nahvi et al. 1994), O4 (noise amplification, Nahvi and Hollerbach 1996), O5 (inverse sum, Sun and
        Hollerbach 2008), of the `rank` singular values of the columns scaled by `scale`; with full rank they are the
        published indices.
    apart : dict of str to tuple of str
        The partners of each parameter that cannot be separated; empty for one without any effect.
    """

    names: tuple[str, ...]
    rank: int
    singular_values: FloatArray
    condition: float
    indices: dict[str, float]
    apart: dict[str, tuple[str, ...]]

    def __repr__(self) -> str:
        mixed = f"; not separable: {self.describe()}" if self.apart else ""
        return f"<Observability: rank {self.rank} of {len(self.names)}, condition number {self.condition:.3g}{mixed}>"

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        return asdict(self) | {"singular_values": self.singular_values.tolist()}

    def describe(self) -> str:
        """Return the parameters that cannot be separated, for a message: "d2 with d3; theta1 with base rz"."""
        lines = [f"{name} with {', '.join(others)}" if others else name for name, others in self.apart.items()]
        more = f" and {len(lines) - _NAMED} more" if len(lines) > _NAMED else ""
        return "; ".join(lines[:_NAMED]) + more


def observability(columns: FloatArray, names: Sequence[str], scale: FloatArray | None = None) -> Observability:
    """Analyse a Jacobian by the singular values of its scaled columns.

    Parameters
    ----------
    columns : (n, k, p) array
        The Jacobian, as from `Robot.error_jacobian`, or whitened.
    names : sequence of p str
        The names of the parameters.
    scale : (p,) array, optional
        The size of a typical change of each parameter, for the indices O1–O5; unit columns when not given.

    Raises
    ------
    DataError
        If shapes disagree or a number is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from truepose.robots import load_robot
    >>> robot = load_robot("kuka-kr150-2")
    >>> q = np.random.default_rng(0).uniform(-1.5, 1.5, (50, 6))
    >>> seen = observability(robot.error_jacobian(q, tool=[100, 0, 200]), robot.parameter_names)
    >>> seen.rank, "d3" in seen.apart["d2"]
    (25, True)
    """
    rows = np.asarray(columns, float).reshape(-1, np.shape(columns)[-1])
    if len(names) != rows.shape[1] or not np.isfinite(rows).all():
        raise DataError(f"expected as many finite columns as names, got {rows.shape[1]} columns and {len(names)} names")
    length = np.linalg.norm(rows, axis=0)
    seen = length > _UNSEEN * length.max()
    unit = rows[:, seen] / length[seen]
    singular = np.zeros(rows.shape[1])
    values = np.linalg.svd(unit, compute_uv=False)
    singular[: len(values)] = values
    rank = int((values > _RANK * values[0]).sum())
    sized = np.asarray(values if scale is None else np.linalg.svd(rows * scale, compute_uv=False), dtype=np.float64)
    return Observability(
        names=tuple(names),
        rank=rank,
        singular_values=singular,
        condition=float(values[0] / values[rank - 1]),
        indices=_indices(sized[:rank], len(columns)),
        apart=_apart(unit, [name for name, s in zip(names, seen, strict=True) if s], rank)
        | {name: () for name, s in zip(names, seen, strict=True) if not s},
    )


def poses_to_add(
    arm: ParametricArm, q: FloatArray, count: int = 3, candidates: int = 300, rng: int | np.random.Generator = 0
) -> FloatArray:
    """Return configurations whose measurement reduces the uncertainty most, in addition to those at q.

    The search is greedy: among random configurations within the limits (±180 degrees where there are none), the one
    that increases the determinant of the information matrix most is taken first.

    Parameters
    ----------
    arm : ParametricArm
        The arm and its parameters.
    q : (n, dof) array [rad]
        The configurations measured so far.
    count : int
        The number of configurations to add.
    candidates : int
        The number of random configurations.
    rng : int or Generator
        The seed, or source, of the random configurations.

    Returns
    -------
    (count, dof) array [rad]
    """
    robot = arm.model.robot
    limits = np.clip(robot.limits, -np.pi, np.pi)
    pool = np.random.default_rng(rng).uniform(limits[:, 0], limits[:, 1], (candidates, robot.dof))
    zero, scale = np.zeros(len(arm.parameters)), arm.tolerance / 0.1  # mm, the accuracy of a reading

    def rows(q: FloatArray) -> FloatArray:
        return arm.jacobian(q, zero, np.ones_like(q) if arm.terms.needs_approach else None) * scale

    known = rows(q).reshape(-1, len(scale))
    information = np.eye(len(scale)) + known.T @ known
    offered, taken = rows(pool), []
    for _ in range(count):
        inner = np.eye(3) + offered @ np.linalg.solve(information, np.swapaxes(offered, 1, 2))
        taken.append(int(np.argmax(np.linalg.slogdet(inner)[1])))
        information = information + offered[taken[-1]].T @ offered[taken[-1]]
    return np.asarray(pool[taken])


def _indices(singular: FloatArray, n: int) -> dict[str, float]:
    first, last = singular[0], singular[-1]
    return {
        "O1": float(np.exp(np.log(singular).mean()) / np.sqrt(n)),
        "O2": float(last / first),
        "O3": float(last),
        "O4": float(last**2 / first),
        "O5": float(1.0 / (1.0 / singular).sum()),
    }


def _apart(unit: FloatArray, names: list[str], rank: int) -> dict[str, tuple[str, ...]]:
    """Express each column outside a basis (pivoted QR) in this basis, and list the columns that take part."""
    if rank == len(names):
        return {}
    # base and tool first, so that a parameter of a link is listed with them, not they with those of several links
    weight = np.array([10.0 if name.startswith(("base", "tool")) else 1.0 for name in names])
    r, order = qr(unit * weight, mode="r", pivoting=True)
    shares = solve_triangular(r[:rank, :rank], r[:rank, rank:]) * weight[order[:rank], None] / weight[order[rank:]]
    partners: dict[str, list[str]] = {}
    for share, dependent in zip(np.abs(shares).T, order[rank:], strict=True):
        others = [names[order[i]] for i in np.flatnonzero(share > _PART * share.max())]
        partners.setdefault(names[dependent], []).extend(others)
        for other in others:
            partners.setdefault(other, []).append(names[dependent])
    return {name: tuple(dict.fromkeys(partners[name])) for name in names if name in partners}
