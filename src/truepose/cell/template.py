"""The commented cell file that `truepose init` writes."""

from __future__ import annotations

from typing import Final

from truepose.cell.poses import ANGLE_KEYS, CONTROLLER
from truepose.robots import load_robot

_TEMPLATE: Final = """\
# A cell for truepose. Lengths are mm; angles are the controller's own ({angles}).
# Everything but the robot's model may be left out.

[robot]
model = "{model}"        # `truepose robots` lists the library; or a path to a .toml or .urdf file
# repeatability_mm = 0.06  # RP of ISO 9283; with the noise of a reading it says how good any map can be

[tool]                   # from the flange to the measured point (the reflector)
x_mm = 0.0
y_mm = 0.0
z_mm = 0.0
{zero_angles}
fit = "position"         # "none": the values are exact; "position", "pose": found from the samples, starting there

[tracker]
fit = "pose"             # "pose": the station is found by registration; "none": x_mm … and the angles say where it is
robust = true            # gross readings are found and left out of the registration
# std_mm = 0.02          # noise of a reading, or, along and across the beam:
# range_um = 5.0
# range_um_per_m = 0.5
# angle_um = 7.5
# angle_um_per_m = 3.0

# [base]                 # the robot's base in the measuring frame; to fit it is to fit the tracker's station
# x_mm = 0.0
# fit = "none"

# [payload]
# mass_kg = 0.0
# x_mm = 0.0             # centre of mass in the flange frame
# y_mm = 0.0
# z_mm = 0.0

# [frames]               # the controller's frames, which programs refer to by number or name
# config_dat = "$config.dat"
# [frames.tools.1]
# x_mm = 0.0
# [frames.bases.1]
# x_mm = 0.0

# [region]               # where the work is, for `truepose plan`: a box, and the tool's orientation in it
# x_mm = 1500.0          # its centre
# y_mm = 0.0
# z_mm = 900.0
{region_angles}
# size_mm = [900.0, 1600.0, 900.0]
# tilt_deg = 15.0        # by how much the work turns away from that orientation, about each axis of the tool
# home_deg = {home}      # joints on the branch of the work; the measuring program starts there
# frame = 1              # the base frame of the controller that all this is stated in; left out: the robot's own

# [obstacles.table]      # boxes that the arm must not touch, robot base frame
# x_mm = [900.0, 2400.0]
# y_mm = [-1000.0, 1000.0]
# z_mm = [0.0, 400.0]

# [measuring]
# dwell_s = 2.0          # at each pose, for the arm to come to rest and the tracker to read
# speed_percent = 20.0
# trigger_output = 1     # digital output that tells the tracker to read; left out: no signal
# approach_deg = 3.0     # every joint comes to its pose from that far below, so that backlash is always the same
# limit_margin_deg = 5.0
# reflector_axis = [0.0, 0.0, 1.0]  # where the reflector looks, tool frame; left out: it is seen from all sides
# acceptance_deg = 30.0
# link_radius_mm = 150.0 # of the rods that stand for the arm's links
# repeatability_mm = 0.02  # standard deviation in each direction, for the accuracy expected

[correction]
max_correction_mm = 5.0
on_guard = "refuse"      # "refuse" the program, "skip" the target, or "clip" the correction
# tolerance_mm = 0.3     # how far the tool may be from its target
# max_std_mm = 0.15      # largest predicted standard deviation; left out: half of the tolerance, else 4 times RP
# min_correction_stds = 1.0  # a correction smaller than this many of its standard deviations is not applied
# max_distance_mm = 200  # to the nearest sample; left out: 1.5 times the widest gap between samples
# max_bend_mm = 0.3      # largest bend that corrections make in a path; left out: found from their standard deviations
# require = "95%"        # of a program's motion targets must be corrected, or nothing is written
# max_distance_deg = 30  # the same for maps in joint space
# max_angle_deg = 10.0   # between a target's orientation and that of the sample most alike; left out: as far as the
                         # samples support it, which is the limit in any case
max_tool_mm = 50.0       # between the tool point of a target and the measured one
max_rotation_mrad = 10.0      # largest correction of orientation, where that is asked for
max_rotation_std_mrad = 3.0   # largest predicted standard deviation of orientation
"""


def template(robot_name: str) -> str:
    """Return a commented ``cell.toml`` for a robot, which loads as it is.

    Raises
    ------
    RobotError
        If the robot is not known.
    """
    robot = load_robot(robot_name)
    maker = robot.maker.lower()
    keys = ANGLE_KEYS.get(CONTROLLER.get(maker, maker), ANGLE_KEYS["kuka"])
    zero = [f"{key} = {1.0 if key == 'q1' else 0.0}" for key in keys]
    return _TEMPLATE.format(
        model=robot_name,
        angles=", ".join(keys),
        zero_angles="\n".join(zero),
        region_angles="\n".join(f"# {line}" for line in zero),
        home=[0.0] * robot.dof,
    )
