"""The tests of a measuring campaign in ``import`` and ``fit``: see `truepose.verification.campaign`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map.points import commanded_points, of_one_reflector, points_on_tool
from truepose.error_map.registration import reading_noise
from truepose.error_map.repeatability import Repeatability
from truepose.errors import DataError
from truepose.geometry import Registration
from truepose.identification import ParametricArm, Positions
from truepose.numerics.threads import blas_threads
from truepose.robots import Load, Robot, error_model, thermal_columns
from truepose.robots.nongeometric import STEEL
from truepose.samples import Samples, name_one
from truepose.verification import RP_PER_STD
from truepose.verification.alternating import alternating
from truepose.verification.campaign import FEWEST, LARGEST, Campaign, changes, noise, suspected_drift
from truepose.verification.faults import Change, reference_change

ACCEPT: Final = "accept it with --accept-campaign (accept_campaign=True in Python)"
_TERMS: Final = ("sin1", "cos1", "sin2", "cos2", "compliance")
_STRAIN: Final = 1e-3  # tolerance of an arm's errors per length, where its joints are unknown
_LOADED: Final = 5.0  # mm and mrad: largest displacement by another load
_SAME: Final = 1e-6  # rad, mm
_FAR_MM: Final = 1e3  # from the flange to the centre of a payload of which moments are multiples
_LEAST_LIMIT: Final = 0.1  # mm
_REMEDIES: Final = {
    "moved": "fit the samples before and after it as two maps, or measure again",
    "drift": "warm the robot up, check that tracker and robot base stand firmly, and measure again",
    "scale": "check the unit and the weather station of the tracker, and the robot model of the cell",
    "alternating": "name reflectors in a column reflector, leave out the readings of one population, or measure again",
    "reference": "check that tracker, robot base and tool are fixed, and measure again",
}
_CAUSES: Final = {
    "flange": "two reflectors, or two nests on the tool, were probably used in turn",
    "base": "two trackers or stations were probably used in turn",
}


@dataclass(frozen=True, eq=False)
class CampaignCheck:
    """The faults of a measuring campaign.

    Attributes
    ----------
    changes : list of Change
        The significant faults that are large enough to be named; their rows are the samples' own numbers.
    words : list of str
        A sentence without a full stop for each: estimate ± standard error, samples, p-value.
    limit : float [mm]
        The root mean square displacement above which a fault stops the fit.
    tested : int
        The number of samples tested; 0 where there are too few.
    suspected_drift : float [mm]
        The root mean square displacement of a drift that is too uncertain to be named; it widens the map's standard
        deviation.
    ends : list
        The first and the last sample of each fault by row, point and line, see `Poses.identify`.
    """

    changes: list[Change]
    words: list[str]
    limit: float
    tested: int
    suspected_drift: float = 0.0
    ends: list[list[dict[str, Any]]] = field(default_factory=list)

    def __repr__(self) -> str:
        return f"<CampaignCheck of {self.tested} samples: {'; '.join(self.words) or 'no faults'}>"

    @property
    def drifts(self) -> bool:
        """Whether a drift was found, or is suspected."""
        return self.suspected_drift > 0.0 or any(change.kind == "drift" for change in self.changes)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values, as in a map file."""
        faults = [
            {
                **asdict(change),
                "rows": list(change.rows),
                "members": list(change.members),
                "ends": ends,
                "words": words,
                "stops": change.size > self.limit,
            }
            for change, words, ends in zip(self.changes, self.words, self.ends, strict=True)
        ]
        drift = {"suspected_drift_mm": self.suspected_drift}
        return {"tested": self.tested, "limit_mm": self.limit, **drift, "faults": faults}

    def refuse(self, source: str, accepted: tuple[str, ...] = ()) -> None:
        """Raise an error if a fault is above the limit and its kind is not accepted.

        Raises
        ------
        DataError
            With estimate ± standard error, samples or points, and the remedy.
        """
        stopping = [
            (change.kind, words)
            for change, words in zip(self.changes, self.words, strict=True)
            if change.size > self.limit and change.kind not in accepted
        ]
        if stopping:
            faults = "; ".join(words for _, words in stopping)
            raise DataError(f"{source}: {faults}; {_REMEDIES[stopping[0][0]]}, or {ACCEPT}")


def check_campaign(
    cell: Cell,
    robot: Robot,
    samples: Samples,
    registration: Registration,
    tf_flange_tool: FloatArray,
    *,
    expansion: bool = False,
) -> CampaignCheck:
    """Test whether the tracker moved, lengths have a scale, errors drift, or reference points changed.

    Parameters
    ----------
    cell : Cell
        The cell that was measured.
    robot : Robot
        The nominal robot.
    samples : Samples
        The samples in the order of measuring; with times, these define the order.
    registration : Registration
        The registration of the samples.
    tf_flange_tool : (4, 4) array [mm]
        The tool fitted with it, or as stated.
    expansion : bool
        Whether growth of the arm with its temperature counts as an error of the arm, not as a drift: the predictor
        will know the temperature.

    Returns
    -------
    CampaignCheck

    Notes
    -----
    The limit is ``max_std_mm`` of the cell's ``[correction]`` where it is stated, else twice the robot's repeatability,
    at least 0.1 mm: the uncertainty that is accepted of a correction.
    """
    if samples.reflector is not None:
        rows, tf_flange_tool = of_one_reflector(samples, cell, tf_flange_tool)
        registration = replace(registration, residuals=registration.residuals[rows])
        samples = replace(samples[rows], reflector=None)
    order = np.arange(len(samples)) if samples.time is None else np.argsort(samples.time, kind="stable")
    campaign = campaign_of(cell, robot, samples, registration, tf_flange_tool, expansion)[order]
    with blas_threads(LARGEST):
        found = changes(campaign)
        named = any(change.kind in ("drift", "moved") for change in found)
        suspected = 0.0 if named else suspected_drift(campaign)
        two = None if named else alternating(campaign)
    if two is not None and two.notable:
        found.append(two)
    before, after = _references(samples, order)
    others = np.setdiff1d(np.arange(len(samples)), after)
    std = (
        noise(campaign[others])
        if len(before) and len(others) >= FEWEST
        else _stated(cell, robot, samples, registration)
    )
    reference = reference_change(campaign.e, campaign.p, before, after, std)
    if reference is not None and reference.notable:
        found.append(reference)
    assert samples.row is not None
    ends = [[samples.identify(int(order[place])) for place in change.rows] for change in found]
    members = [samples.rows(np.sort(order[list(change.members)])) if change.members else "" for change in found]
    rows = samples.row[order]
    found = [
        replace(
            change,
            rows=(int(rows[change.rows[0]]), int(rows[change.rows[1]])),
            members=tuple(sorted(rows[list(change.members)].tolist())) if change.members else (),
        )
        for change in found
    ]
    limit = cell.correction.max_std_mm or max(_LEAST_LIMIT, 2.0 * (Repeatability.of(cell, robot).known or 0.0))
    tested = len(samples) if len(samples) >= FEWEST or reference is not None else 0
    words = [
        _two_populations(change, tested, named, _centres_unknown(samples))
        if named
        else _sentence(change, *map(name_one, pair))
        for change, pair, named in zip(found, ends, members, strict=True)
    ]
    return CampaignCheck(found, words, limit, tested, suspected, ends)


def _stated(cell: Cell, robot: Robot, samples: Samples, registration: Registration) -> float | None:
    """Return the standard deviation of a reading, repeatability included [mm], where both are known."""
    reading, repeatability = reading_noise(cell, samples, registration), Repeatability.of(cell, robot).known
    if reading is None or repeatability is None:
        return None
    return float(np.sqrt(np.mean(reading**2) + (repeatability / RP_PER_STD) ** 2))


def campaign_of(
    cell: Cell,
    robot: Robot,
    samples: Samples,
    registration: Registration,
    tf_flange_tool: FloatArray,
    expansion: bool = False,
) -> Campaign:
    """Return the errors of samples in the order of their rows, with the columns of their model; see `Campaign`."""
    when = np.arange(len(samples), dtype=np.float64) if samples.time is None else samples.time
    if samples.q is None:
        p = samples.p_cmd
        assert p is not None  # Poses holds one of them
        columns, coordinates = _strains(p), p
        if samples.rotation_cmd is not None:  # turned by 1 rad is as far as 1 m away
            turned = (samples.rotation_cmd * samples.rotation_cmd[0].inv()).as_rotvec()
            coordinates = np.column_stack([p, 1e3 * turned])
    else:
        p, coordinates = commanded_points(robot, cell, samples, tf_flange_tool), samples.q
        columns = _of_arm(cell, robot, samples, tf_flange_tool)
        if expansion and samples.temperature is not None:
            kelvin = samples.temperature - samples.temperature.mean()
            _, growth = thermal_columns(error_model(robot, tool=tf_flange_tool), samples.q, kelvin)
            columns = np.concatenate([columns, STEEL * growth], axis=2)
    campaign = Campaign(registration.apply(samples.p_meas) - p, p, coordinates, columns, when, _turned(robot, samples))
    if samples.load is None or np.ptp(samples.load) == 0:
        return campaign
    loaded = (samples.load - samples.load.mean()) / np.ptp(samples.load)
    bent = campaign.rigid * loaded[:, None, None] * (_LOADED * np.repeat([1.0, 1e-3], 3))
    return replace(campaign, columns=np.concatenate([columns, bent], axis=2))


def _turned(robot: Robot, samples: Samples) -> FloatArray | None:
    """Return the orientations of the flange, or those of the tool where there are no joints, (n, 3, 3)."""
    if samples.q is not None:
        return np.asarray(robot.forward(samples.q)[:, :3, :3])
    return None if samples.rotation_cmd is None else np.asarray(samples.rotation_cmd.as_matrix())


def _of_arm(cell: Cell, robot: Robot, samples: Samples, tf_flange_tool: FloatArray) -> FloatArray:
    """Return the errors by one tolerance of each parameter of the arm, without those of the base."""
    assert samples.q is not None
    payload, approach = cell.payload, samples.approach
    reversing = approach is not None and bool((np.ptp(approach, axis=0) > 0).any())
    n, r = len(samples), None if samples.reflector is None else points_on_tool(samples, cell)
    data = Positions(samples.q, np.zeros((n, 3)), np.zeros((n, 3, 3)), approach, r)

    def under(mass: float, centre: FloatArray) -> FloatArray:
        arm = ParametricArm.of(
            robot, tf_flange_tool, terms=(*_TERMS, "backlash") if reversing else _TERMS, load=Load(mass, centre)
        )
        columns = data.jacobian(arm, np.zeros(len(arm.parameters)))
        own = np.array([parameter.group != "base" for parameter in arm.parameters])
        return np.asarray(columns[:, :, own] * arm.tolerance[own])

    stated = np.array([payload.x_mm, payload.y_mm, payload.z_mm])
    if samples.load is None or (np.ptp(samples.load) == 0.0 and samples.p_load is None):
        return under(payload.mass_kg, stated)
    # the columns are linear in the payload, and in its moment
    known = np.full((n, 3), np.nan) if samples.p_load is None else samples.p_load
    moment = samples.load[:, None] * np.where(np.isnan(known), stated, known)
    without, origin = under(0.0, np.zeros(3)), under(1.0, np.zeros(3))
    columns = without + samples.load[:, None, None] * (origin - without)
    for axis in range(3):
        along = under(1.0, _FAR_MM * np.eye(3)[axis]) - origin
        columns += (moment[:, axis] / _FAR_MM)[:, None, None] * along
    return columns


def _strains(p: FloatArray) -> FloatArray:
    """Return the displacements of six strains of one tolerance each, (n, 3, 6) [mm]."""
    centred = p - p.mean(axis=0)
    pairs = [(a, b) for a in range(3) for b in range(a, 3)]
    columns = np.zeros((len(p), 3, len(pairs)))
    for k, (a, b) in enumerate(pairs):
        columns[:, a, k] += _STRAIN * centred[:, b]
        if a != b:
            columns[:, b, k] += _STRAIN * centred[:, a]
    return columns


def _references(samples: Samples, order: IntArray) -> tuple[IntArray, IntArray]:
    """Return the first and the last place, in the order of time, of each command that was repeated late.

    Late is after half of the campaign or more: immediate repetitions show no change.
    """
    if samples.q is not None:
        keys = [samples.q]
    else:
        assert samples.p_cmd is not None
        keys = [samples.p_cmd]
        if samples.rotation_cmd is not None:
            keys.append(samples.rotation_cmd.as_matrix().reshape(len(samples), 9))
    keys += [one.reshape(len(samples), -1) for one in (samples.approach, samples.load) if one is not None]
    key = np.round(np.column_stack(keys)[order] / _SAME).astype(np.int64)
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    last = np.zeros(len(first), np.intp)
    np.maximum.at(last, group.reshape(-1), np.arange(len(samples)))
    late = 2 * (last - first) >= len(samples) - 1
    late &= last > first
    return first[late], last[late]


def _centres_unknown(samples: Samples) -> bool:
    return samples.load is not None and bool(np.ptp(samples.load) > 0.0) and samples.p_load is None


def _two_populations(change: Change, n: int, rows: str, centres_unknown: bool) -> str:
    m, cause = len(change.members), _CAUSES[change.frame]
    if centres_unknown:
        cause += ", or the centres of mass of the payloads differ, which no column states"
    by = f"{change.shift:.3f} ± {change.shift_std:.3f} mm"
    if change.turn_std:
        by += f" and {1e3 * change.turn:.3f} ± {1e3 * change.turn_std:.3f} mrad"
    return (
        f"the readings are of two populations {by} apart in the frame of the {change.frame}, {m} against {n - m}: "
        f"{cause} ({rows}; p = {change.p_value:.1g})"
    )


def _sentence(change: Change, first: str, last: str) -> str:
    chance = f"p = {change.p_value:.1g}"
    if change.kind == "scale":
        longer = "longer" if change.scale > 0 else "shorter"
        scale = f"{100 * abs(change.scale):.2f} ± {100 * change.scale_std:.2f} %"
        return f"measured lengths are {scale} {longer} than commanded ones, from {first} to {last} ({chance})"
    by = f"{change.shift:.3f} ± {change.shift_std:.3f} mm"
    if change.turn_std:
        by += f" and {1e3 * change.turn:.3f} ± {1e3 * change.turn_std:.3f} mrad"
    if change.kind == "moved":
        return f"the tracker, the robot base or the tool moved between {first} and {last}, by {by} ({chance})"
    if change.kind == "drift":
        return f"the readings drift by {by} from {first} to {last} ({chance})"
    points = f"{change.points} reference point" + ("s" if change.points > 1 else "")
    return f"{points} moved by {by} between {first} and {last} ({chance})"
