"""Two arms of one's own: positions at poses that one can check by hand or on the controller."""

import sys
from pathlib import Path

import numpy as np

import truepose as tp

folder = Path(sys.argv[1])
STRETCHED, TURNED = [0, 0, 0, 0, 0, 0], [90, 0, 0, 0, 0, 0]
for file, q_deg in (("ur5e.csv", STRETCHED), ("irb120.toml", STRETCHED), ("irb120.toml", TURNED)):
    robot = tp.load_robot(folder / file)
    q = np.deg2rad(q_deg)
    pose = robot.forward(q)
    print(robot.name, q_deg, "flange [mm]", (pose[:3, 3].round(3) + 0.0).tolist())
    away = np.abs(robot.forward(robot.inverse(robot.forward(q + 0.3))) - robot.forward(q + 0.3))
    assert np.nanmax(away) < 1e-6  # every branch of the inverse kinematics leads back to the pose
