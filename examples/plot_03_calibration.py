r"""
What calibration finds, and what it cannot
==========================================

Errors of the links move the tool by :math:`e \approx J(q)\,\Delta\psi`, equation (3). Identifying :math:`\Delta\psi`
from positions is a least-squares problem, but not all parameters can be separated: some have the same effect on the
tool point. Each row of the table names them. The errors of this virtual arm are known, so the combinations that *can*
be identified are compared with the truth.
"""

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp

cell = tp.VirtualCell("hard", seed=0, effects=["geometry", "repeatability", "tracker"])
q = cell.design(100)
error_map = tp.fit_cell(cell.cell, cell.measure(q), "calibration")
model = error_map.predictor

for row in model.parameters_:
    std = "kept" if row["std"] is None else f"± {row['std']:.5f}"
    print(f"{row['parameter']:16s} {row['change']:9.5f} {std:10s} {row['unit']:4s} {row['note']}")

# %%
# Parameters that only their tolerances separate differ from the truth, but the arm that they describe together is
# right. Therefore the next figure compares the effect: the length of the error at new poses with the nominal arm, and
# with the identified one.

new = cell.design(200, seed=5)
truth = cell.true_position(new)
nominal = cell.robot.forward(new, tool=cell.tf_flange_tool)[:, :3, 3]
# from the true base frame to the one that registration found
base = error_map.registration.tf_base_tracker @ np.linalg.inv(cell.truth.tf_base_tracker)
seen = truth @ base[:3, :3].T + base[:3, 3]
left = seen - nominal - error_map.predictor.predict(new)

figure, axes = plt.subplots(figsize=(7, 3.4), layout="constrained")
bins = np.geomspace(1e-3, 3.0, 50)
axes.hist(np.linalg.norm(seen - nominal, axis=1), bins, color="#c8442b", alpha=0.8, label="nominal arm")
axes.hist(np.linalg.norm(left, axis=1), bins, color="#1f4e79", alpha=0.8, label="identified arm")
axes.set(xscale="log", xlabel="true error at 200 new poses, without noise [mm]", ylabel="poses")
axes.legend()
