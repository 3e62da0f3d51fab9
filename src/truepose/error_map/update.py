"""Check a map with new samples, and update it.

A few readings show whether a map still holds after a crash, or with a warm arm, a new tool or a moved tracker. They are
then added to the samples of the map, with its hyperparameters; or only station or tool are fitted again.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map.conditions import knows, strange_conditions, with_conditions
from truepose.error_map.exclusions import gross_held_out, named_gross
from truepose.error_map.facts import Fact, of_import
from truepose.error_map.map import ErrorMap
from truepose.error_map.orientations import mounting_of, orientation_columns
from truepose.error_map.points import points_on_tool
from truepose.error_map.selection import points_named
from truepose.errors import DataError
from truepose.geometry import (
    Registration,
    apply_transform,
    invert_transform,
    register,
    register_with_body,
    register_with_tool,
)
from truepose.predictors.abilities import JointlyPredicting, Updatable
from truepose.predictors.reflectors import on_a_line
from truepose.samples import Samples, on_arm, reflector_index
from truepose.verification.consistency import (
    DOUBTFUL,
    ConsistencyTest,
    Drift,
    Explanation,
    Verdict,
    check_consistency,
    drift,
    explanations,
    length_std,
)

Refit = Literal["station", "tool", "both"]

STATION: Final = "the station moved (tracker or robot base)"
TOOL: Final = "the tool point moved"
GROWTH: Final = "the arm grew"
_LEAST_TIMED: Final = 6  # readings that a search for a drift needs
_MOST_TOGETHER: Final = 1000  # readings whose joint covariance is computed
_SAME_READING: Final = 2e-3  # mm, by the digits of a file; a tracker does not repeat a reading so closely
_TURNED: Final = 0.2  # mm, how far a turn may move a reflector of a tool that is shifted
_ALIKE: Final = 0.02  # smaller differences in the explained part do not separate two causes
_SAID: Final[dict[Verdict, str]] = {
    "holds": "holds",
    "doubtful": "may no longer hold",
    "does not hold": "does not hold",
    "too cautious": "is too cautious, its standard deviations are too wide",
}


@dataclass(frozen=True, eq=False)
class Recheck:
    """The result of checking a map with new samples; made by `recheck`.

    Attributes
    ----------
    holding : ConsistencyTest
        The test of the residuals; its ``far`` are rows of the samples.
    causes : list of Explanation
        The possible causes, the likeliest first; empty where residuals are not larger than predicted.
    time, temperature : Drift, optional
        The drift of the unexplained errors [mm/h], [mm/K]; None where the samples do not determine it.
    strange : list of str
        The conditions of the samples that no sample of the map had and the map does not know, each a sentence.
    """

    holding: ConsistencyTest
    causes: list[Explanation]
    time: Drift | None
    temperature: Drift | None
    strange: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"<Recheck: {' '.join(self.words)}>"

    @property
    def words(self) -> list[str]:
        """The result in sentences."""
        found = self.holding
        size = f"residuals are {found.ratio:.2f} times what it predicts"
        chance = found.p_wide if found.verdict == "too cautious" else found.p_value
        said = [f"The map {_SAID[found.verdict]}: {size} (p = {chance:.2g}, {found.n} readings)."]
        said += [*self.strange, *(_sentence(cause) for cause in self.causes[:1])]
        for other in self.causes[1:3]:
            alike = self.causes[0].explained - other.explained < _ALIKE
            said.append(f"{'Equally likely:' if alike else 'Less likely:'} {other.cause}.")
        for name, unit, one in (("time", "h", self.time), ("temperature", "K", self.temperature)):
            if one is not None:
                slope, std = float(np.linalg.norm(one.slope)), length_std(one.slope, one.std)
                sure = "no significant drift" if one.p_value >= DOUBTFUL else "drift"
                if sure == "drift" and not found.fails:
                    sure = "drift, small enough for the map to hold"
                said.append(f"Over {name}: {sure}: {slope:.4f} ± {std:.4f} mm/{unit} (p = {one.p_value:.2g}).")
        return said

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        return {
            "holding": self.holding.to_dict(),
            "causes": [
                {**vars(cause), "estimate": cause.estimate.tolist(), "std": cause.std.tolist()} for cause in self.causes
            ],
            "time": None if self.time is None else self.time.to_dict("h"),
            "temperature": None if self.temperature is None else self.temperature.to_dict("K"),
            "strange": self.strange,
            "words": self.words,
        }


def recheck(error_map: ErrorMap, samples: Samples) -> Recheck:
    """Test whether a map holds for new samples, and name possible causes where it does not.

    Parameters
    ----------
    error_map : ErrorMap
        The map.
    samples : Samples
        New readings, from the same station and with the same tool.

    Returns
    -------
    Recheck

    Raises
    ------
    DataError
        If the samples lack joints or positions that the map needs.

    Examples
    --------
    >>> from truepose import VirtualCell, fit_cell
    >>> virtual = VirtualCell("paper")
    >>> error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "registration")
    >>> recheck(error_map, virtual.measure(virtual.design(10, seed=1), seed=1)).holding.n
    10
    """
    samples = on_arm(samples, error_map.robot)
    residual, covariance, shared = _surprise(error_map, samples)
    order = np.arange(len(samples)) if samples.time is None else np.argsort(samples.time, kind="stable")
    found = check_consistency(residual[order], _permuted(covariance, order), None if shared is None else shared[order])
    found = replace(found, far=np.sort(order[found.far]).tolist())
    why = explanations(residual, covariance, _causes(error_map, samples)) if found.fails else []

    def over(quantity: FloatArray | None, scale: float) -> Drift | None:
        if quantity is None or len(samples) < _LEAST_TIMED or np.ptp(quantity) == 0:
            return None
        return drift(residual, covariance, quantity * scale)

    strange = strange_conditions(error_map.predictor, error_map.samples, error_map.cell, samples)
    return Recheck(found, why, over(samples.time, 1 / 3600.0), over(samples.temperature, 1.0), strange)


def update_map(
    error_map: ErrorMap, samples: Samples, refit: Refit | None = None, *, checked: Recheck | None = None
) -> ErrorMap:
    """Return a map updated with new samples.

    Parameters
    ----------
    error_map : ErrorMap
        The map, which stays as it is.
    samples : Samples
        New readings.
    refit : {"station", "tool", "both"}, optional
        The part to fit again from three or more samples: the station (a moved tracker), the tool point (another tool or
        reflector), or both; the errors of the arm are kept. By default the samples are added to those of the map, with
        its hyperparameters.
    checked : Recheck, optional
        The result of `recheck` with these samples, if it is at hand: what it found against them is a fact of the new
        map.

    Returns
    -------
    ErrorMap

    Raises
    ------
    DataError
        If the samples lack what is needed, or the map does not know the arm, which another tool needs.
    IdentifiabilityError
        If the samples cannot separate the tool from the station.

    Examples
    --------
    >>> from truepose import VirtualCell, fit_cell
    >>> virtual = VirtualCell("paper")
    >>> error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "registration")
    >>> len(update_map(error_map, virtual.measure(virtual.design(10, seed=1), seed=1)).samples)
    50
    """
    samples = on_arm(samples, error_map.robot)
    if refit is None:
        found = _findings(checked or recheck(error_map, samples))
        known = {*error_map.stated}
        new = [fact for fact in (*of_import(samples.facts), *found) if fact not in known]
        return _joined(error_map, samples).changed(stated=(*error_map.stated, *new))
    if refit == "station":
        e, _ = error_map.predict_errors(samples)
        p_real = error_map.commanded_positions(samples) + e
        return _moved(error_map, register(p_real, samples.p_meas, robust=error_map.cell.tracker.robust))
    if refit not in ("tool", "both"):
        raise DataError(f'refit is {refit!r}; expected "station", "tool", "both", or None to add the samples')
    return _with_tool(error_map, samples, station=refit == "both")


def _findings(checked: Recheck) -> list[Fact]:
    """Return what a check found against samples that are added to a map nevertheless."""
    found = [Fact("new-conditions", words.rstrip("."), "update") for words in checked.strange]
    if checked.holding.verdict != "holds":
        words = " ".join(checked.words[:1]).rstrip(".")
        found.append(Fact("not-holding", f"when {checked.holding.n} samples were added: {words}", "update"))
    return found


def _joined(error_map: ErrorMap, samples: Samples) -> ErrorMap:
    if error_map.p_flange_sampled is not None:
        raise DataError(
            "the map's tool was changed: its samples are of another point; fit a new map with the new samples"
        )
    if samples.distances is not None:
        what = "distances are not added to a map; leave them out, or fit a new map with all samples"
        raise samples.distances.error(what)
    samples = _with_conditions(error_map, _without_known(error_map.samples, samples))
    samples = _without_gross(error_map, samples)
    e, registration = error_map.errors(samples), error_map.registration
    if knows(error_map.predictor, "time"):
        samples = _later(error_map.samples, samples)
    joined = error_map.changed(
        known_worth=None,
        samples=_concatenated(_with_load(error_map.samples, samples, error_map.cell), samples),
        excluded=[*error_map.excluded, *samples.excluded],
        predictor=copy.deepcopy(error_map.predictor),
        registration=replace(
            registration,
            residuals=np.concatenate([registration.residuals, e]),
            outliers=np.concatenate([registration.outliers, np.zeros(len(e), np.bool_)]),
        ),
    )
    new = error_map.reading_noise(samples)
    if isinstance(joined.predictor, Updatable):
        turns = _turns(error_map, samples)
        x = with_conditions(
            error_map.coordinates(samples),
            joined.predictor,
            samples,
            joined.cell,
            time=samples.time,
            orientation=turns,
        )
        if samples.reflector is not None:  # visits go on after those of the map
            x = joined.fitted_inputs[-len(samples) :]
        joined.predictor.update(x, e, new)
        return joined
    old = joined.predictor.noise_std_
    noise = None if old is None or new is None else np.concatenate([old, new])
    x = joined.inputs(joined.samples)
    with points_named(joined.samples):
        return joined.changed(predictor=joined.predictor.with_fitted_parameters().fit(x, joined.e, noise))


def _without_known(old: Samples, new: Samples) -> Samples:
    """Return new samples without those that the map has already: counted twice, a reading claims to be two.

    Raises
    ------
    DataError
        If the map has all of them.
    """
    again = np.asarray(KDTree(old.p_meas).query(new.p_meas)[0]) < _SAME_READING
    if again.all():
        raise new.error(
            "all of these readings are in the map already, and count once; update it with readings that are new"
        )
    if not again.any():
        return new
    left_out = [{**new.identify(i), "reason": "in the map already"} for i in np.flatnonzero(again).tolist()]
    return replace(new[~again], excluded=(*new.excluded, *left_out))


def _with_conditions(error_map: ErrorMap, samples: Samples) -> Samples:
    """Return new samples with the conditions that those of the map state: a payload is that of the cell by default.

    Raises
    ------
    DataError
        If one is missing: the samples of the map would lose theirs.
    """
    own, samples = error_map.samples, _with_load(samples, error_map.samples, error_map.cell)
    for name, column in (("load", "load_kg"), ("temperature", "temp_C")):
        condition = "payload" if name == "load" else name
        missing = getattr(own, name) is not None and getattr(samples, name) is None
        if missing and knows(error_map.predictor, condition):
            raise samples.error(f"the map knows the {condition} of its samples; state that of the new ones in {column}")
    return samples


def _with_load(samples: Samples, others: Samples, cell: Cell) -> Samples:
    """Return samples with the payload of the cell, where they state none and others do."""
    if samples.load is not None or others.load is None or not cell.payload.mass_kg:
        return samples
    return replace(samples, load=np.full(len(samples), cell.payload.mass_kg))


def _without_gross(error_map: ErrorMap, new: Samples) -> Samples:
    """Return new samples without the readings that the map and the others contradict, as `validate` judges them."""
    expected, std = error_map.predict_reading(new)
    left = error_map.errors(new) - expected
    gross = gross_held_out(error_map.commanded_positions(new) if new.q is None else new.q, left, std)
    return named_gross(new, np.linalg.norm(left, axis=1), gross) if gross.any() else new


def _turns(error_map: ErrorMap, samples: Samples) -> FloatArray | None:
    """Return the measured orientations of new samples, on the target as it is mounted in those of the map."""
    old = error_map.samples
    if old.rotation_meas is None or old.q is None:
        return None
    mounting = mounting_of(error_map.robot, old, error_map.registration)
    return orientation_columns(error_map.robot, samples, error_map.registration, mounting)


def _later(old: Samples, new: Samples) -> Samples:
    """Return new samples with times after the old ones, whose clock may be another; the station goes on from there."""
    assert old.time is not None
    passed = np.arange(len(new), dtype=np.float64) if new.time is None else new.time - new.time.min()
    return replace(new, time=old.time.max() + 1.0 + passed)


def _moved(error_map: ErrorMap, station: Registration) -> ErrorMap:
    """Return the map at another station, with its samples transformed to that station."""
    tf_new_old = invert_transform(station.tf_base_tracker) @ error_map.registration.tf_base_tracker
    return error_map.changed(
        samples=_seen_from(error_map.samples, tf_new_old),
        registration=replace(
            error_map.registration,
            tf_base_tracker=station.tf_base_tracker,
            covariance=station.covariance[:6, :6],
            noise_std=station.noise_std,
            hint=station.hint,
        ),
    )


def _with_tool(error_map: ErrorMap, samples: Samples, *, station: bool) -> ErrorMap:
    """Return the map for another tool point, fitted with the predicted true poses of the flange."""
    if samples.q is None:
        raise DataError(f"{samples.source}: fitting another tool needs joints (q1_deg …)")
    body = None if samples.reflector is None else points_on_tool(samples, error_map.cell)
    error, _ = error_map.predict_pose_errors(replace(samples, reflector=None))
    tf_flange = error_map.robot.forward(samples.q, tool=error_map.tf_flange_tool)
    tf_flange[:, :3, 3] += error[:, :3]
    tf_flange[:, :3, :3] = Rotation.from_rotvec(error[:, 3:]).as_matrix() @ tf_flange[:, :3, :3]
    tf_flange = tf_flange @ invert_transform(error_map.tf_flange_tool)
    tf_flange_tool = error_map.tf_flange_tool.copy()
    if body is not None:
        error_map, shift = _with_body(error_map, samples, tf_flange, apply_transform(tf_flange_tool, body), station)
        tf_flange_tool[:3, 3] += shift
    elif station:
        found = register_with_tool(tf_flange, samples.p_meas, tf_flange_tool[:3, 3])
        assert found.p_flange_tool is not None
        error_map = _moved(error_map, found)
        tf_flange_tool[:3, 3] = found.p_flange_tool
    else:
        p_base = apply_transform(error_map.registration.tf_base_tracker, samples.p_meas)
        in_flange = np.einsum("nji,nj->ni", tf_flange[:, :3, :3], p_base - tf_flange[:, :3, 3])
        tf_flange_tool[:3, 3] = np.median(in_flange, axis=0) if len(samples) > 4 else in_flange.mean(axis=0)
    sampled = error_map.tf_flange_sampled[:3, 3]
    return error_map.changed(tf_flange_tool=tf_flange_tool, p_flange_sampled=sampled)


def _with_body(
    error_map: ErrorMap, samples: Samples, tf_flange: FloatArray, p_flange: FloatArray, station: bool
) -> tuple[ErrorMap, FloatArray]:
    """Return the map, at a new station if that is asked for, and how far a body of reflectors is shifted, (3,) [mm].

    `p_flange` (n, 3) [mm] are the points read, flange frame, as they were before; `tf_flange` (n, 4, 4) [mm] the true
    poses of the flange.
    """
    if station:
        which = reflector_index(samples, error_map.cell)
        found = register_with_body(tf_flange, samples.p_meas, p_flange, which, error_map.tf_flange_tool[:3, 3])[0]
        error_map = _moved(error_map, found)
    p_base = apply_transform(error_map.registration.tf_base_tracker, samples.p_meas)
    seen = np.einsum("nji,nj->ni", tf_flange[:, :3, :3], p_base - tf_flange[:, :3, 3])
    points, which = np.unique(p_flange, axis=0, return_inverse=True)
    if not on_a_line(points):
        found_at = np.array([np.median(seen[which.reshape(-1) == k], axis=0) for k in range(len(points))])
        turn, _ = Rotation.align_vectors(found_at - found_at.mean(axis=0), points - points.mean(axis=0))
        reach = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
        if turn.magnitude() * reach > _TURNED:
            raise samples.error(
                f"the reflectors are turned on the flange by {1e3 * turn.magnitude():.1f} mrad, not only shifted; "
                "state their positions and the angles of [tool] anew, and fit a new map"
            )
    moved = seen - p_flange
    return error_map, np.median(moved, axis=0) if len(samples) > 4 else moved.mean(axis=0)


def _surprise(error_map: ErrorMap, samples: Samples) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return residuals (n, 3) of samples against the map, their covariance, and the variance that they may share."""
    x = error_map.inputs(samples)
    e, std = error_map.predict_at(x)  # conditions that no sample of the map had are to be found, not to be expected
    noisy, residual = error_map.reading_std(samples, std), error_map.errors(samples) - e
    predictor, apart = error_map.predictor, error_map.p_flange_sampled is not None or len(samples) > _MOST_TOGETHER
    if apart or not isinstance(predictor, JointlyPredicting):
        alike = np.maximum(std**2 - error_map.unexplained, 0.0)  # the rest differs from pose to pose
        return residual, noisy[:, :, None] ** 2 * np.eye(3), alike
    _, covariance = predictor.predict_together(x)
    noise = noisy**2 - np.diag(covariance).reshape(-1, 3)
    return residual, covariance + np.diag(np.maximum(noise, 0.0).reshape(-1)), None


def _causes(error_map: ErrorMap, samples: Samples) -> dict[str, FloatArray]:
    """Return the columns of possible causes: (n, 3, k) [mm] for one mm, rad, or m/m."""
    p = error_map.commanded_positions(samples)
    from_centre = p - p.mean(axis=0)
    unit = np.tile(np.eye(3), (len(p), 1, 1))
    causes = {STATION: np.concatenate([unit, -np.cross(from_centre[:, :, None], np.eye(3), axis=1)], axis=2)}
    if samples.q is not None:
        causes[TOOL] = error_map.robot.forward(samples.q)[:, :3, :3]
        levers = error_map.robot.joint_jacobian(samples.q, tool=error_map.tf_flange_tool)
        causes |= {f"joint {j + 1} is off": levers[:, :, j : j + 1] for j in range(levers.shape[2])}
    return causes | {GROWTH: p[:, :, None]}


def _sentence(cause: Explanation) -> str:
    size, std = float(np.linalg.norm(cause.estimate[:3])), length_std(cause.estimate[:3], cause.std[:3])
    share = f"; that explains {100 * cause.explained:.0f} % of it"
    rest = "" if cause.p_left > 0.001 else ", not all"
    if cause.cause == STATION:
        turn = 1e3 * float(np.linalg.norm(cause.estimate[3:]))
        return (
            f"Likely {cause.cause}, by {size:.3f} ± {std:.3f} mm and {turn:.3f} mrad{share}{rest}: "
            'fit it again with refit "station".'
        )
    if cause.cause == TOOL:
        return f'Likely {cause.cause}, by {size:.3f} ± {std:.3f} mm{share}{rest}: fit it with refit "tool".'
    if cause.cause == GROWTH:
        return (
            f"Likely {cause.cause}, by {1e6 * cause.estimate[0]:.0f} ± {1e6 * std:.0f} µm/m{share}{rest}: "
            "let it reach the temperature of the map, or measure again."
        )
    angle = 1e3 * cause.estimate[0]
    return (
        f"Likely {cause.cause}, by {angle:.3f} ± {1e3 * std:.3f} mrad{share}{rest}: "
        "master it again, or measure again as after a crash."
    )


def _permuted(covariance: FloatArray, order: IntArray) -> FloatArray:
    if covariance.ndim == 3:
        return np.asarray(covariance[order], np.float64)
    index = (3 * order[:, None] + np.arange(3)).reshape(-1)
    permuted: FloatArray = covariance[np.ix_(index, index)]
    return permuted


def _concatenated(old: Samples, new: Samples) -> Samples:
    """Return both tables in one, with the columns of both; the numbers of new rows follow those of the old ones.

    An approach that one of them does not state is unknown there: 0.

    Lines are left out, as they are of two files.
    """
    columns: dict[str, Any] = {}
    if old.approach is None and new.approach is not None:
        old = replace(old, approach=np.zeros((len(old), new.approach.shape[1])))
    if new.approach is None and old.approach is not None:
        new = replace(new, approach=np.zeros((len(new), old.approach.shape[1])))
    for name in set(old.columns()) & set(new.columns()) - {"line"}:
        a, b = getattr(old, name), getattr(new, name)
        columns[name] = Rotation.concatenate([a, b]) if isinstance(a, Rotation) else np.concatenate([a, b])
    assert old.row is not None
    columns["row"] = np.concatenate([old.row, old.row.max() + 1 + np.arange(len(new))])
    return Samples(**columns, source=f"{old.source}, {new.source}", distances=old.distances)


def _seen_from(samples: Samples, tf_new_old: FloatArray) -> Samples:
    """Return samples in the frame of another station."""
    turn = tf_new_old[:3, :3]
    changed: dict[str, Any] = {"p_meas": apply_transform(tf_new_old, samples.p_meas)}
    for name in ("p_std", "rotation_std"):
        if (std := getattr(samples, name)) is not None:
            changed[name] = np.sqrt(std**2 @ (turn**2).T)
    if samples.rotation_meas is not None:
        changed["rotation_meas"] = Rotation.from_matrix(turn) * samples.rotation_meas
    if (distances := samples.distances) is not None and distances.p_origin is not None:
        changed["distances"] = replace(distances, p_origin=apply_transform(tf_new_old, distances.p_origin))
    return replace(samples, **changed)
