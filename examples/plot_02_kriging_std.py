r"""
Kriging states its own uncertainty
==================================

Ordinary Kriging weights the samples so that the expected squared error of the prediction is minimal, and states this
minimum. Here one component of the error is predicted over a vertical plane through the work region, from the samples
of the whole region: the standard deviation is low near samples and grows towards the borders. Where it grows beyond a
limit, no target is corrected.
"""

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp

cell = tp.VirtualCell("paper", seed=2)
error_map = tp.fit_cell(cell.cell, cell.measure(cell.design(40)), "registration")
x, e = error_map.p_cmd, error_map.e

kriging = tp.OrdinaryKriging("spherical").fit(x, e)
y, z = np.meshgrid(np.linspace(-900, 900, 61), np.linspace(350, 1450, 41))
plane = np.stack([np.full(y.size, 1700.0), y.ravel(), z.ravel()], axis=1)
predicted, std = kriging.predict(plane, return_std=True)

near = np.abs(x[:, 0] - 1700.0) < 120.0  # samples within 120 mm of the plane
figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained", sharey=True)
for axes, values, title, colours in zip(
    panels, (predicted, std), ("predicted error along z", "its standard deviation"), ("RdBu_r", "viridis"), strict=True
):
    filled = axes.contourf(y, z, values[:, 2].reshape(y.shape), levels=15, cmap=colours)
    axes.plot(*x[near, 1:].T, "k.", ms=6)
    axes.set(title=title, xlabel="y [mm]", aspect="equal")
    figure.colorbar(filled, ax=axes, label="mm", shrink=0.85)
panels[0].set_ylabel("z [mm]")

# %%
# The variogram that was fitted, and a check of the standard deviations: leave-one-out residuals divided by them should
# have a root mean square of one.

residual, left_out_std = kriging.leave_one_out()
print(kriging.variogram_)
print(f"RMS of standardised residuals: {np.sqrt(np.mean((residual / left_out_std) ** 2)):.2f}")
