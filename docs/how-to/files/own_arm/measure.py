"""Play the laboratory: write measured.csv and later.csv, with the headers of a MATLAB script.

The arm has errors of its geometry and of its gears that the tables do not show. Nothing here is from truepose.
"""

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

RIGHT = np.pi / 2
NOMINAL = np.array(  # theta [rad], d [m], a [m], alpha [rad] of each joint, standard D-H
    [
        [0, 0.42, 0.09, -RIGHT],
        [-RIGHT, 0, 0.51, 0],
        [0, 0, 0.06, -RIGHT],
        [0, 0.48, 0, RIGHT],
        [0, 0, 0, -RIGHT],
        [0, 0.09, 0, 0],
    ]
)
TOOL = np.array([0.05, 0.0, 0.12, 1.0])


def positions(dh: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the positions of the reflector (n, 3) [m] at joints (n, 6) [rad]."""
    tf = np.eye(4)
    for (offset, d, a, alpha), angle in zip(dh, q.T, strict=True):
        about_z, along = np.tile(np.eye(4), (len(q), 1, 1)), np.eye(4)
        about_z[:, :3, :3] = Rotation.from_euler("z", angle[:, None] + offset).as_matrix()
        along[:3, :3], along[:3, 3] = Rotation.from_euler("x", alpha).as_matrix(), [a, 0, d]
        tf = tf @ about_z @ along
    return (tf @ TOOL)[:, :3]


rng = np.random.default_rng(5)
true = NOMINAL + rng.normal(size=(6, 4)) * [4e-4, 3e-4, 3e-4, 4e-4]
q = np.deg2rad(rng.uniform([-60, -30, -40, -60, -60, -90], [60, 40, 30, 60, 60, 90], (200, 6)))
gears = 3e-4 * np.sin(q + 1) + 2e-4 * np.cos(2 * q)
tracker = Rotation.from_euler("zyx", [130, 2, 1], degrees=True)  # the station, unknown to the evaluation
read = tracker.apply(positions(true, q + gears) - [2.5, -1.1, 0.4], inverse=True) + rng.normal(
    scale=2e-5, size=(200, 3)
)

columns = [*(f"theta{j} [rad]" for j in range(1, 7)), *(f"{axis}{kind} [m]" for kind in "dm" for axis in "XYZ")]
table = pd.DataFrame(np.column_stack([q, positions(NOMINAL, q), read]), columns=columns).round(7)
table.insert(0, "id", [f"k{i}" for i in range(1, 201)])
table[:150].to_csv("measured.csv", index=False)
table[150:].to_csv("later.csv", index=False)
