"""The cells of a notebook: look at samples, fit, look at the residuals."""

# %%
import matplotlib.pyplot as plt
import numpy as np

import truepose as tp

virtual = tp.VirtualCell("paper", seed=7)  # your own: tp.load_cell("cell.toml"), tp.read_samples("samples.csv")
cell, samples = virtual.cell, virtual.measure(virtual.design(120))

# %% What was measured, as a table of columns
print(len(samples.p_meas), "poses; largest joint angle", np.rad2deg(np.abs(samples.q).max()).round(1))

# %% Fit, and predict every sample from the others
error_map = tp.fit_cell(cell, samples, "ordinary-kriging")
residual, std = error_map.leave_one_out()

# %% Where are the errors, and how large are they afterwards?
before, after = np.linalg.norm(error_map.e, axis=1), np.linalg.norm(residual, axis=1)
figure, axes = plt.subplots()
axes.hist([before, after], bins=20, label=["errors", "left, each predicted from the others"])
axes.set(xlabel="mm", ylabel="samples")
axes.legend()

# %% The prediction at new joints, with its standard deviation
p, p_std = error_map.predict_measured(virtual.design(5, seed=1))
print(np.column_stack([p, p_std]).round(3))
