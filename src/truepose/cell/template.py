"""The commented cell file that `truepose init` writes."""

from __future__ import annotations

import json
import os
import secrets
from pathlib import Path
from typing import Final

from truepose._io.files import check_outputs, write_atomic
from truepose.cell.poses import ANGLE_KEYS, CONTROLLER
from truepose.robots import load_robot
from truepose.robots.io.library import ROBOT_FILES

_TEMPLATE: Final = """\
# A robot cell for truepose. Lengths are in mm; angles are those of the controller ({angles}).
# Only the robot's model is required.

[robot]
model = {model}        # a library name (see `truepose robots`), or the path of a .toml, .csv or .urdf file
{id}    # this very robot: its serial number, or a name of its own; a map corrects programs of no other
{world}# repeatability_mm = 0.06  # RP of ISO 9283; with the noise of a reading it limits the accuracy of any map

[tool]                   # from the flange to the measured point (the reflector)
x_mm = 0.0
y_mm = 0.0
z_mm = 0.0
{zero_angles}
fit = "position"         # "none": the values are exact; "position" or "pose": fitted, starting from these values

# [reflectors.A]         # several reflectors on the tool, in the flange frame; samples then have a column reflector
# x_mm = 120.0
# y_mm = 0.0
# z_mm = 80.0
# std_mm = 0.02          # what it may deviate from its place on the tool, per axis

# [distances.bar]        # a fixed point, in the tracker frame, from which distances are measured: column distance_mm
# x_mm = 2500.0
# y_mm = 300.0
# z_mm = -400.0
# std_mm = 0.01          # standard deviation of a distance

[tracker]
fit = "pose"             # "pose": the station is found by registration; "none": it is stated as x_mm … and angles
robust = true            # outliers are found and left out of the registration
# std_mm = 0.02          # noise of a reading; or state its parts along and across the beam:
# range_um = 5.0
# range_um_per_m = 0.5
# angle_um = 7.5
# angle_um_per_m = 3.0

# [base]                 # the robot's base in the measuring frame; fitting it is the same as fitting the station
# x_mm = 0.0
# fit = "none"

# [payload]
# mass_kg = 0.0
# x_mm = 0.0             # centre of mass in the flange frame
# y_mm = 0.0
# z_mm = 0.0

# [conditions]
# approach = "from-order"  # samples were reached straight from row to row; default: "stated" by approach1 …; or "none"
# temperature_C = 24.0   # of the air at work; default: that of the samples (temp_C)
# payload_kg = 80.0      # at work; default: mass_kg of [payload], else that of the samples (load_kg)
# [conditions.payloads.1]  # with tool 1 of the controller, at the targets that programs move to with it
# mass_kg = 120.0
# x_mm = 0.0             # centre of mass in the flange frame; default: that of [payload]

# [frames]               # the controller's tools and bases, to which programs refer by number or name
# config_dat = "$config.dat"
# [frames.tools.1]
# x_mm = 0.0
# [frames.bases.1]
# x_mm = 0.0
# [frames.groups]        # motion groups of a FANUC controller: that of this robot, and those that carry
# robot = 1              # neither it nor a user frame
# independent = [2]

# [region]               # the work region for `truepose plan`: a box, and the orientation of the tool in it
# x_mm = 1500.0          # centre of the box
# y_mm = 0.0
# z_mm = 900.0
{region_angles}
# size_mm = [900.0, 1600.0, 900.0]
# tilt_deg = 15.0        # largest deviation from this orientation, about each axis of the tool
# home_deg = {home}      # joints on the branch used for work; the measuring program starts there
# frame = 1              # the controller's base in which the region is stated; default: the robot's own base

# [obstacles.table]      # boxes that the arm must avoid, robot base frame
# x_mm = [900.0, 2400.0]
# y_mm = [-1000.0, 1000.0]
# z_mm = [0.0, 400.0]

# [measuring]
# dwell_s = 2.0          # time at each pose for the arm to settle and the tracker to read
# speed_percent = 20.0
# trigger_output = 1     # digital output that triggers the tracker; default: no signal
# approach_deg = 3.0     # every joint approaches its pose from this far, above or below in about half of the poses each
# approach = "below"     # … or from below at all poses, so that lost motion is not measured; default: "both"
# limit_margin_deg = 5.0
# reflector_axis = [0.0, 0.0, 1.0]  # direction of the reflector, tool frame; default: visible from all sides
# acceptance_deg = 30.0
# link_radius_mm = 150.0 # radius of the cylinders that represent the links of the arm
# repeatability_mm = 0.02  # standard deviation in each direction, for the expected accuracy

[correction]
max_correction_mm = 5.0
on_guard = "refuse"      # "refuse" the program, "skip" the target, or "clip" the correction
# tolerance_mm = 0.3     # tolerated distance of the tool from its target
# max_std_mm = 0.15      # largest predicted standard deviation; default: half of the tolerance, otherwise 4 times RP
# min_correction_stds = 2.0  # smaller corrections, in multiples of their standard deviation, are not applied
# max_distance_mm = 200  # to the nearest sample; default: 1.5 times the widest gap between samples
# max_bend_mm = 0.3      # largest bend that corrections add to a path; default: from their standard deviations
# max_difference_mm = 0.2  # between the corrections of a target and of positions that the program derives from it
# max_difference_mrad = 1.0
# require = "95%"        # share of a program's motion targets that must be corrected, or nothing is written
# max_distance_deg = 30  # the same for maps in joint space
# max_joint_gap_deg = 20 # of each joint's angle to that of a sample; default: from the samples; 360 switches it off
# max_angle_deg = 10.0   # between the orientations of a target and the most similar sample; default, and upper limit:
                         # as far as the samples support it
max_tool_mm = 50.0       # between the tool point of a target and the measured point
max_rotation_mrad = 10.0      # largest correction of orientation, if orientations are corrected
max_rotation_std_mrad = 3.0   # largest predicted standard deviation of orientation

# [report]               # what an auditor expects in `truepose report`; missing facts are flagged there
# company = "Example Ltd."
# logo = "logo.svg"      # .svg, .png or .jpg, relative to this file
# site = "Hall 3, cell 12"
# operator = "A. Example"
# job = "2026-0042"
# part = "Panel 7"
# measured = 2026-03-31  # date of the measurement
# robot_serial = "123456"
# tracker = "maker and model"
# tracker_serial = "7890"
# tracker_calibration_due = 2026-12-31
# reflector = "1.5 in SMR, no. 12"
# reflector_calibration_due = 2026-12-31
# temperature_C = 20.0
# tolerance_mm = 0.3     # decides PASS or FAIL; default: that of [correction]
"""
_WORLD: Final = """\
world_height_mm = {height}  # the robot's base is the controller's world, this far above the mounting face; poses here
                         # are relative to it ([region], [obstacles], [frames.bases], [base])
"""


def template(robot_name: str, folder: str | Path | None = None, robot_id: str | None = None) -> str:
    """Return a commented ``cell.toml`` for a robot, which is valid as it is.

    Parameters
    ----------
    robot_name : str
        The library name, or the path of a .toml, .csv or .urdf file.
    folder : str or Path, optional
        The folder of the cell file, to which the path of a robot file is made relative. When not given, the path is
        written as it is.
    robot_id : str, optional
        The name of this very robot, such as its serial number. When not given, its line is a comment.

    Raises
    ------
    RobotError
        If the robot is unknown.

    Examples
    --------
    >>> print(template("kuka-kr150-2").splitlines()[4])
    model = "kuka-kr150-2"        # a library name (see `truepose robots`), or the path of a .toml, .csv or .urdf file
    """
    robot = load_robot(robot_name)
    maker = robot.maker.lower()
    keys = ANGLE_KEYS.get(CONTROLLER.get(maker, maker), ANGLE_KEYS["kuka"])
    zero = [f"{key} = {1.0 if key == 'q1' else 0.0}" for key in keys]
    return _TEMPLATE.format(
        model=json.dumps(_model(robot_name, folder), ensure_ascii=False),
        id='# id = "123456"' if robot_id is None else f"id = {json.dumps(robot_id, ensure_ascii=False)}",
        angles=", ".join(keys),
        world="" if robot.world_height_mm is None else _WORLD.format(height=robot.world_height_mm),
        zero_angles="\n".join(zero),
        region_angles="\n".join(f"# {line}" for line in zero),
        home=[0.0] * robot.dof,
    )


def write_template(folder: str | Path, robot_name: str, robot_id: str | None = None) -> Path:
    """Write a commented ``cell.toml`` into a folder, which is created if needed; return its path.

    Parameters
    ----------
    folder : str or Path
        The folder of the cell.
    robot_name : str
        The library name, or the path of a .toml, .csv or .urdf file.
    robot_id : str, optional
        The name of this very robot, such as its serial number; a made-up one when not given.

    Raises
    ------
    RobotError
        If the robot is unknown.
    FileError
        If the file exists and may not be overwritten, or cannot be written.
    """
    path = Path(folder) / "cell.toml"
    text = template(robot_name, folder, robot_id or f"robot-{secrets.token_hex(4)}")
    check_outputs(path)
    write_atomic(path, text)
    return path


def _model(robot_name: str, folder: str | Path | None) -> str:
    """Return the value of ``[robot] model``: a library name, or a path with forward slashes."""
    if folder is None or not robot_name.lower().endswith(ROBOT_FILES):
        return robot_name
    try:
        return Path(os.path.relpath(robot_name, folder)).as_posix()
    except ValueError:  # on another drive
        return Path(robot_name).absolute().as_posix()
