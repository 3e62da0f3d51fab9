"""
A cell from readings to a corrected program
===========================================

The daily work in Python: plan, measure, match the tracker's file with the plan, fit a map, check it, and correct a
robot program. A virtual cell with the errors of a real robot stands for the robot and the tracker.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp

folder = TemporaryDirectory()
root = Path(folder.name)
virtual = tp.VirtualCell("paper", seed=7)
cell = virtual.cell  # yours: tp.load_cell("cell.toml")

# %%
# Readings
# --------
# The tracker exports a file; `import_readings` recognises its layout and finds the pose of the plan for each reading.

plan = tp.Poses(q=virtual.design(80), source="plan")
tp.write_readings(root / "tracker.txt", virtual.measure(plan.q), "spatial-analyzer")  # stands for the tracker
samples, summary = tp.import_readings(root / "tracker.txt", plan, cell=cell)
print(f"{summary.readings} readings, {len(samples)} samples, {len(summary.missing)} missing")

# %%
# The map
# -------
# ``tp.fit_cell(cell, samples)`` chooses the predictor by cross-validation; here it is named, to be quick.

error_map = tp.fit_cell(cell, samples, "kinematic-kriging")
result = error_map.validate(virtual.measure(virtual.design(30, seed=1)))
print(result)

# %%
# The program
# -----------
# A KRL program of eight points on a circle. Everything but the numbers of its targets stays as it is, byte by byte.

angle = np.linspace(0, 2 * np.pi, 8, endpoint=False)
circle = [1750.0, 0.0, 950.0] + 150.0 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(8)])
moves = "".join(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A 180.000,B 20.000,C 180.000}}\n" for x, y, z in circle)
source = root / "circle.src"
source.write_text(f"DEF circle( )\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n{moves}END\n")

frames = tp.FrameTable(tools={1: virtual.tf_flange_tool})  # yours: the folder that holds $config.dat
corrected = tp.correct_program(source, error_map, frames=frames)
corrected.write(root / "out")
print(source.read_text().splitlines()[3], (root / "out" / "circle.src").read_text().splitlines()[3], sep="\n")

# %%
# The picture: is the map right on poses that it has not seen?

tp.plot(result, figure=plt.figure(figsize=(10, 3.6), layout="constrained"))
folder.cleanup()
