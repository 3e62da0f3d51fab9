"""Robots: chains, the library of nominal robots, URDF, inverse kinematics, KUKA's Status and Turn."""

from truepose.robots.chain import Robot
from truepose.robots.library import list_robots, load_robot, parse_robot

__all__ = ["Robot", "list_robots", "load_robot", "parse_robot"]
