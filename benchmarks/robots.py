"""Forward and inverse kinematics of arrays of poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.harness import Job
from truepose.robots import load_robot

TITLE = "Benchmarks: robots"
PACKAGES = ("truepose", "numpy", "pin", "roboticstoolbox-python", "py-opw-kinematics")


def jobs(*, quick: bool = False) -> Iterator[Job]:
    """Yield the jobs."""
    n = 1_000 if quick else 100_000
    robot = load_robot("kuka-kr210-r2700-extra")
    q = np.random.default_rng(0).uniform(robot.limits[:, 0], robot.limits[:, 1], size=(n, 6))
    poses = robot.forward(q)
    yield Job(f"forward kinematics, {n:,} poses", {"truepose": lambda: robot.forward(q)}, items=n)
    yield Job(f"all branches of the inverse, {n:,} poses", {"truepose": lambda: robot.inverse(poses)}, items=n)
