"""
Backlash: the side from which a joint comes
===========================================

A gear has play. A joint whose angle grew before it stopped stands behind its command, and one whose angle shrank stands
before it. A map that does not know the side takes the difference for noise; one that knows it corrects for it.
"""

# %%
# A virtual arm with 0.1 to 1 mrad of lost motion is measured straight from pose to pose, so every joint comes from both
# sides.
import matplotlib.pyplot as plt
import numpy as np

from truepose import VirtualCell, fit_cell
from truepose.samples import Poses

virtual = VirtualCell("backlash", seed=3)
samples = virtual.measure(virtual.design(80, seed=3), seed=3)
maps = {
    "side not known": fit_cell(virtual.cell, samples, "kinematic-kriging:conditions=none"),
    "side known": fit_cell(virtual.cell, samples, "kinematic-kriging"),
}

# %%
# The map knows the backlash of each joint with its uncertainty. The last joint turns about an axis near the tool point:
# it hardly moves the point, so its backlash is uncertain and does not matter.
rows = [row for row in maps["side known"].predictor.parameters_ if row["group"] == "backlash"]
for row, true in zip(rows, -0.5e6 * virtual.truth.backlash, strict=True):
    print(f"{row['name']}: {1e6 * row['estimate']:6.0f} ± {1e6 * row['std']:3.0f} µrad, true {true:6.0f}")

# %%
# At new poses, the errors that are left, with the side stated and left open.
q = virtual.design(150, seed=4)
side = np.sign(np.diff(q, axis=0, prepend=q[:1]))
reached = virtual.measure(q, seed=4, approach=side)
figure, axes = plt.subplots(figsize=(7, 3.5), layout="constrained")
for name, error_map in maps.items():
    predicted, _ = error_map.predict_errors(Poses(q=q, approach=side))
    left = np.linalg.norm(error_map.errors(reached) - predicted, axis=1)
    axes.hist(left, bins=np.linspace(0.0, 1.2, 49), alpha=0.7, label=f"{name}: mean {left.mean():.3f} mm")
axes.set(xlabel="distance from the prediction [mm]", ylabel="poses")
axes.legend()
plt.show()
