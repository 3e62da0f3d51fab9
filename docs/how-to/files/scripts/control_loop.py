"""Predict the error of each set point of a motion in a control loop, from a frozen map."""

import sys
import time
from pathlib import Path

import numpy as np

import truepose as tp

folder = Path(sys.argv[1])

# once, offline: fit or load the map, freeze it, keep the file beside the map
virtual = tp.VirtualCell("paper", seed=1)
error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(60)), "kinematic-kriging")
error_map.freeze().save(folder / "cell.frozen")

# in the controller's process: load, compare with the map in force, compile by a first call
frozen = tp.FrozenMap.load(folder / "cell.frozen", error_map)
start, end = virtual.design(2, seed=5)
path = start + np.linspace(0.0, 1.0, 1000)[:, None] * (end - start)  # set points, (1000, 6) [rad]
error = np.empty(3)
frozen.predict_into(path[0], error)

seconds, largest = [], 0.0
for q in path:
    begin = time.perf_counter()
    frozen.predict_into(q, error)  # mm, base frame: measured - commanded
    seconds.append(time.perf_counter() - begin)
    largest = max(largest, float(np.linalg.norm(error)))
print(frozen)
print(f"{len(path)} set points, largest error {largest:.2f} mm")
print(f"half of the calls took less than {1e6 * float(np.median(seconds)):.0f} microseconds", file=sys.stderr)
assert np.abs(frozen.predict(path) - error_map.predict_errors(tp.Poses(q=path))[0]).max() < 1e-3
