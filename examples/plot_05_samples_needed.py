r"""
How many poses does each method need?
=====================================

The virtual arm has all effects, its tool is turned by up to 15° about each axis, and its tool point is known. Each
method gets the same 20 to 80 readings and predicts the errors of 200 other poses. Cartesian Kriging does not know the
orientation of the tool; calibration knows only geometry; kinematic Kriging knows geometry and the similarity of each
joint's errors.
"""

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp
from truepose.simulation import EFFECTS

cell = tp.VirtualCell("hard", seed=3, effects={*EFFECTS} - {"tool"})
held_out = cell.measure(cell.design(200, seed=99), seed=99)
samples = cell.measure(cell.design(80))
counts = [20, 40, 80]
methods = {
    "ordinary-kriging": "#8a5aa8",
    "ordinary-kriging-joint": "#5a8f3d",
    "calibration": "#c8442b",
    "kinematic-kriging": "#1f4e79",
}

figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
for name, colour in methods.items():
    after = [
        tp.fit_cell(cell.cell, samples[:n], name).validate(held_out, rivals=False)["after"]["mean_mm"] for n in counts
    ]
    print(name.ljust(24), np.round(after, 3))
    axes.plot(counts, after, "o-", color=colour, label=name)
axes.axhline(cell.noise_floor, color="k", ls=":", label="noise floor")
axes.set(xlabel="poses measured", ylabel="mean error left on held-out poses [mm]", ylim=(0, None))
axes.legend()
