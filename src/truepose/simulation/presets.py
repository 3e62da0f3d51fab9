"""The presets of virtual cells, and the sizes of their errors (docs/virtual-cell.md)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from truepose.simulation.tracker import TrackerNoise

Range = tuple[float, float]
_ARCSEC: Final = float(np.pi / 180.0 / 3600.0)

EFFECTS: Final = (
    "geometry",
    "compliance",
    "harmonics",
    "transmission",
    "ripple",
    "backlash",
    "thermal",
    "tool",
    "repeatability",
    "tracker",
)
"""The usual sources of error of a virtual cell, each switched on by its name."""

TROUBLES: Final = ("heavy-tails", "rounding", "joint-step", "pedestal", "creep")
"""Further faults, each switched on by its name; off in the presets paper, hard and ideal."""


@dataclass(frozen=True)
class Preset:
    """The properties of a virtual cell. Sizes are drawn from their ranges for each joint, whether switched on or not.

    Attributes
    ----------
    robot : str
        The library name.
    tool_mm, tool_abc_deg : tuple of 3
        The tool as stated in the cell file, flange to reflector, with KUKA angles.
    centre_mm, size_mm : tuple of 3
        The work region, a box in the base frame.
    abc_deg : tuple of 3
        The orientation of the tool in the work region, as KUKA angles.
    orientation_deg : float
        The largest deviation of a design from this orientation, about each axis of the tool.
    home_deg : tuple of 6
        A joint vector on the branch used for work.
    effects : frozenset of str
        The names from `EFFECTS` and `TROUBLES` that are switched on.
    length_std : float [mm]
        The standard deviation of the errors of every a and d.
    angle_std : float [rad]
        The standard deviation of the errors of every joint offset, alpha and beta.
    repeatability_std : float [mm]
        The standard deviation of the TCP in each direction; RP of ISO 9283 is about 3.6 times as large.
    tracker : TrackerNoise
        The noise of readings.
    tool_std, tool_angle_std : float [mm], [rad]
        The standard deviations of the difference between the stated and the real tool, in each direction.
    largest_error : float [mm], optional
        The largest error over the work region after rigid registration, to which the parameter errors are scaled.
    compliance : pair of ranges [rad/Nm]
        The compliances of joints 1–3, and of the others.
    payload_kg, payload_mm : float, tuple of 3
        The mass on the flange and its centre, flange frame, as stated in the cell file.
    own_weight : range
        The share of each link's weight that bends the joints; balancers and mastering compensate the rest.
    harmonic : range [rad]
        The amplitudes of the first and the second harmonic of each joint's angle.
    transmission : range [rad]
        The standard deviation of each joint's smooth error in addition to the harmonics.
    transmission_length : range [rad]
        The correlation length of this error.
    ripple : range [rad]
        The amplitude of the error that repeats with each turn of a motor.
    gear_ratio : range
        The motor turns for one turn of the joint, where the robot does not state them.
    backlash : range [rad]
        The lost motion between the two directions of approach.
    backlash_wave : range
        The share of its mean by which the lost motion of a joint is larger at one angle, and smaller opposite to it.
    expansion : range [1/K]
        The coefficient of thermal expansion of every length.
    warm_up_kelvin, warm_up_s : float
        The final rise of temperature, and its time constant.
    first_reading_s, seconds_per_reading : float
        The time of the first reading after the cold start, and the time between readings.
    acceptance_deg : float
        The angle from its axis up to which a reflector is visible; at the centre of the region the axis points to the
        tracker.
    reflector_radius_mm : float
        The radius of the circle about the tool point on which several reflectors are mounted.
    approach : {"up", "order"}
        The default approach: every joint upwards, or straight from pose to pose.
    work_payload_kg : float, optional
        The mass on the flange at work; that of the measurement when not given.
    work_s : float, optional
        The time of work after the cold start; the times of a measurement when not given.
    degrees_of_freedom : float
        The degrees of freedom of Student's t, the distribution of readings with ``heavy-tails``.
    decimals_mm, decimals_deg : int
        The decimals of positions [mm] and angles [deg] in the file of samples, with ``rounding``.
    joint_step : range [rad]
        The jump of one joint's offset, with ``joint-step``.
    joint_step_within_deg : float
        The largest distance of the jump from the joint's home angle.
    pedestal_tilt : range [rad/m]
        The tilt of the pedestal per metre of the arm's horizontal extension, with ``pedestal``.
    creep_mm : range [mm]
        The distance that the tracker's station moves during a campaign, with ``creep``.
    """

    robot: str
    tool_mm: tuple[float, float, float]
    tool_abc_deg: tuple[float, float, float]
    centre_mm: tuple[float, float, float]
    size_mm: tuple[float, float, float]
    abc_deg: tuple[float, float, float]
    home_deg: tuple[float, ...]
    length_std: float
    angle_std: float
    repeatability_std: float
    tracker: TrackerNoise = field(default_factory=TrackerNoise)
    tool_std: float = 0.0
    tool_angle_std: float = 0.0
    largest_error: float | None = None
    orientation_deg: float = 0.0
    effects: frozenset[str] = frozenset({"geometry", "tool", "repeatability", "tracker"})
    compliance: tuple[Range, Range] = ((3e-7, 7e-7), (2e-6, 3.5e-6))
    payload_kg: float = 0.0
    payload_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    own_weight: Range = (0.2, 0.4)
    harmonic: Range = (1.0 * _ARCSEC, 20.0 * _ARCSEC)
    transmission: Range = (1.0 * _ARCSEC, 20.0 * _ARCSEC)
    transmission_length: Range = (0.15, 0.6)
    ripple: Range = (1.0 * _ARCSEC, 1.5 * _ARCSEC)
    gear_ratio: Range = (80.0, 250.0)
    backlash: Range = (0.0, 0.3e-3)
    backlash_wave: Range = (0.0, 0.0)
    expansion: Range = (8e-6, 14e-6)
    warm_up_kelvin: float = 8.0
    warm_up_s: float = 2400.0
    first_reading_s: float = 3600.0
    seconds_per_reading: float = 15.0
    acceptance_deg: float = 30.0
    reflector_radius_mm: float = 120.0
    approach: Literal["up", "order"] = "up"
    work_payload_kg: float | None = None
    work_s: float | None = None
    degrees_of_freedom: float = 3.0
    decimals_mm: int = 1
    decimals_deg: int = 2
    joint_step: Range = (0.1e-3, 0.5e-3)
    joint_step_within_deg: float = 10.0
    pedestal_tilt: Range = (0.05e-3, 0.25e-3)
    creep_mm: Range = (0.1, 0.5)


_PAPER: Final = Preset(
    robot="kuka-kr210-r2700-extra",
    tool_mm=(110.0, 0.0, 360.0),
    tool_abc_deg=(0.0, 0.0, 0.0),
    centre_mm=(1700.0, 0.0, 900.0),
    size_mm=(900.0, 1600.0, 900.0),
    abc_deg=(180.0, 20.0, 180.0),
    home_deg=(0.0, -75.0, 95.0, 0.0, 50.0, 0.0),
    length_std=0.35,
    angle_std=0.35e-3,
    repeatability_std=0.014,
    tool_std=2.0,
    largest_error=1.29,
)
_HARD: Final = replace(
    _PAPER,
    largest_error=None,
    orientation_deg=15.0,
    tool_angle_std=3e-3,
    effects=frozenset(EFFECTS),
    payload_kg=120.0,
    payload_mm=(60.0, 0.0, 220.0),
)

PRESETS: Final[dict[str, Preset]] = {
    # The paper's experiment: positions in a box at one orientation, 1.2912 mm at most before compensation.
    "paper": _PAPER,
    # All effects of docs/virtual-cell.md on the same arm, with orientations that vary by 15° about each axis.
    "hard": _HARD,
    # An arm without errors: only noise, and the unknown station.
    "ideal": replace(_HARD, effects=frozenset({"repeatability", "tracker"})),
    # The troubled cells: hard, with one further fault that no predictor models.
    **{name: replace(_HARD, effects=_HARD.effects | {name}) for name in TROUBLES},
    "cold-start": replace(_HARD, first_reading_s=0.0, work_s=4.0 * _HARD.warm_up_s),
    "backlash": replace(_HARD, backlash=(0.1e-3, 1e-3), approach="order"),
    "ripple": replace(_HARD, ripple=(20e-6, 50e-6)),
    "other-payload": replace(_HARD, work_payload_kg=0.25 * _HARD.payload_kg),
}
