"""Robots: kinematic chains, the library of nominal robots, files, inverse kinematics and arm configurations."""

from truepose.robots.chain import Chain
from truepose.robots.configuration import (
    abb_configuration,
    fanuc_configuration,
    joints_of_abb,
    joints_of_fanuc,
    joints_of_pose,
    select,
    status_turn,
)
from truepose.robots.conventions import CONVENTIONS
from truepose.robots.convert import to_mdh
from truepose.robots.data_sheet import DataSheet
from truepose.robots.error_model import ErrorModel, error_model
from truepose.robots.inverse.branches import Branches, find_branches, nearest_branch
from truepose.robots.io.csv import parse_robot_csv
from truepose.robots.io.library import list_robots, load_robot
from truepose.robots.io.template import robot_template
from truepose.robots.io.toml import parse_robot, to_toml
from truepose.robots.io.urdf import load_urdf, to_urdf
from truepose.robots.motions import Parameter
from truepose.robots.nongeometric import JointTerms, Load, gravity_torque, joint_terms, thermal_columns
from truepose.robots.pendant import ShownJoints, shown_joints
from truepose.robots.reach import max_reach
from truepose.robots.robot import Robot

__all__ = [
    "CONVENTIONS",
    "Branches",
    "Chain",
    "DataSheet",
    "ErrorModel",
    "JointTerms",
    "Load",
    "Parameter",
    "Robot",
    "ShownJoints",
    "abb_configuration",
    "error_model",
    "fanuc_configuration",
    "find_branches",
    "gravity_torque",
    "joint_terms",
    "joints_of_abb",
    "joints_of_fanuc",
    "joints_of_pose",
    "list_robots",
    "load_robot",
    "load_urdf",
    "max_reach",
    "nearest_branch",
    "parse_robot",
    "parse_robot_csv",
    "robot_template",
    "select",
    "shown_joints",
    "status_turn",
    "thermal_columns",
    "to_mdh",
    "to_toml",
    "to_urdf",
]
