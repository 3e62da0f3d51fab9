r"""
Effects in a virtual arm
========================

The virtual cell ``hard`` has all effects that cause errors of real arms. Here they are switched on one by one. The
figure shows the errors after a rigid registration with the tool point fitted: this is what a map must learn. A wrong
tool point is found together with the station and leaves no error, so it is not shown.
"""

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp
from truepose.simulation import EFFECTS

rng = np.random.default_rng(0)
sizes = {}
for effect in sorted({*EFFECTS} - {"tool"}):
    cell = tp.VirtualCell("hard", seed=0, effects=[effect])
    q = cell.design(200)
    samples = cell.measure(q, approach=rng.choice([-1.0, 1.0], q.shape))
    found = tp.register_with_tool(cell.robot.forward(q), samples.p_meas)
    sizes[effect] = np.linalg.norm(found.residuals, axis=1)

order = sorted(sizes, key=lambda effect: sizes[effect].mean())
figure, axes = plt.subplots(figsize=(7.5, 4), layout="constrained")
axes.boxplot([sizes[effect] for effect in order], orientation="horizontal", whis=(0, 100), widths=0.6)
axes.set_yticks(range(1, len(order) + 1), order)
axes.set(xscale="log", xlabel="error after registration with tool [mm]: smallest, quartiles, largest")
axes.grid(axis="x", color="#e5e5e5")
