"""
The paper's method on a CSV of your own
=======================================

From a table of commanded and measured poses to a validated error map: errors, their similarity, Kriging, and the test
on poses that took no part. The table here is that of a measured UR10, which comes with truepose; replace the path and
the cell by your own.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp

# %%
# The table
# ---------
# One row for each pose: joints in degrees or commanded positions in mm, and the tracker's reading in its own frame. The
# unit is in the name of each column (``q1_deg``, ``x_meas_mm``). From pandas, use ``tp.Samples.from_frame(frame)``.

example = tp.load_example("ur10")
with TemporaryDirectory() as folder:
    csv = Path(folder) / "samples.csv"
    tp.write_samples(csv, example.samples)  # stands for your own file
    samples = tp.read_samples(csv)
cell = example.cell  # yours: tp.load_cell("cell.toml")
print(len(samples), "poses;", cell.robot.model)

# %%
# Some poses are kept for the test. They are drawn at random here; a split by regions is harder.

order = np.random.default_rng(0).permutation(len(samples))
training, held_out = samples[order[:250]], samples[order[250:450]]

# %%
# The errors, and their similarity
# --------------------------------
# A registration finds the station of the tracker (and here the tool); what remains are the positional errors.
# The semivariogram shows how alike the errors of near poses are. Weights and held parameters are those of gstat.

registered = tp.fit_cell(cell, training, "registration")
experimental = tp.experimental_variogram(registered.p_cmd, registered.e, bins=15, max_lag=1000.0)
model = tp.fit_variogram(experimental, "best", weights="pairs/h2", fixed={"nugget": 0.01})
envelope = tp.permutation_envelope(registered.p_cmd, registered.e, experimental.edges, rng=0)
print(model)
print(f"chance of this similarity: p = {envelope.p_value:.3f}")

# %%
# Kriging, and the test on unseen poses
# -------------------------------------
# Ordinary Kriging is the paper's predictor. The validation compares it with other predictors: the arm of this robot is
# known, and a model of the arm does far better. Never stop at the first map.

kriging = tp.fit_cell(cell, training, "ordinary-kriging")
result = kriging.validate(held_out)
print(result)

# %%
better = tp.fit_cell(cell, training, result.better.rival)
print(better.validate(held_out))

# %%
# The pictures: the semivariogram with the band of chance, and below the errors before and after Kriging.

figure = plt.figure(figsize=(9, 7.5), layout="constrained")
upper, lower = figure.subfigures(2, 1)
tp.plot(experimental, figure=upper, model=model, envelope=envelope)
tp.plot(result, figure=lower)
