r"""
Comparing methods
=================

This tutorial is for those who have a predictor of their own, or want to know which one to trust. It needs data with
known errors, fair folds, intervals that can be checked, and the noise floor.

Data
----

A virtual cell gives readings; `fit_cell` with the predictor ``registration`` turns them into arrays: joints :math:`q`
(n, 6) in rad, commanded positions :math:`P` (n, 3) in mm, and errors :math:`e` (n, 3) in mm, measured − commanded, in
the base frame. For an arm that you have measured, take ``tp.load_cell("cell.toml")`` and
``tp.read_samples("samples.csv")`` instead.
"""

import matplotlib.pyplot as plt
import numpy as np
from sklearn.base import clone
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import truepose as tp
from truepose.predictors import ArmContext, block_folds, make_predictor, random_folds
from truepose.simulation import EFFECTS
from truepose.verification import coverage, summary

cell = tp.VirtualCell("hard", seed=6, effects={*EFFECTS} - {"tool"})  # the tool point is known
error_map = tp.fit_cell(cell.cell, cell.measure(cell.design(60)), "registration")
q, p, e = error_map.samples.q, error_map.p_cmd, error_map.e
print(f"{len(e)} samples, error {summary(e)['mean_mm']:.3f} mm in the mean, noise floor {cell.noise_floor:.3f} mm")

# %%
# Competitors
# -----------
#
# All predictors have ``fit(X, e)`` and ``predict(X)``, so anything with scikit-learn's contract can compete: here a
# Gaussian process on joints. Those of the library are made by name; some need to know the arm.

arm = ArmContext(cell.robot, error_map.tf_flange_tool, (cell.preset.payload_kg, *cell.preset.payload_mm))
competitors = {
    "inverse distance": (make_predictor("idw"), p),
    "ordinary Kriging": (make_predictor("ordinary-kriging"), p),
    "ordinary Kriging, joints": (make_predictor("ordinary-kriging-joint"), q),
    "yours: scikit-learn": (
        make_pipeline(
            StandardScaler(), GaussianProcessRegressor(RBF(np.ones(6)) + WhiteKernel(1e-2), normalize_y=True)
        ),
        q,
    ),
    "calibration": (make_predictor("calibration", arm=arm), q),
    "kinematic Kriging": (make_predictor("kinematic-kriging", arm=arm), q),
}

# %%
# Folds
# -----
#
# Random folds leave neighbours of each held-out pose in the fit; blocks of the work space do not. An interpolator
# looks better in the first, and the program to be corrected may be more like the second. Report both.

splits = {"random folds": random_folds(len(e), rng=0), "blocks of space": block_folds(p, rng=0)}
left = {}
for split, fold in splits.items():
    for name, (predictor, x) in competitors.items():
        residual = np.empty_like(e)
        for k in np.unique(fold):
            out = fold == k
            residual[out] = e[out] - clone(predictor).fit(x[~out], e[~out]).predict(x[out])
        left[name, split] = np.linalg.norm(residual, axis=1)

for name in competitors:
    print(f"{name:26s}", *(f"{split}: {left[name, split].mean():.3f}  " for split in splits))

# %%
# Are the standard deviations right?
# ----------------------------------
#
# A standard deviation is right if 68 % of new readings lie within one of them, and 95 % within 1.96.

new = cell.measure(cell.design(200, seed=77), seed=77)
e_new = error_map.errors(new)
for name in ("ordinary Kriging, joints", "calibration", "kinematic Kriging"):
    predictor, x = competitors[name]
    mean, std = clone(predictor).fit(x, e).predict(new.q, return_std=True, include_nugget=True)
    held = coverage(e_new - mean, std)
    print(f"{name:26s} within 68 %: {held.within_68:.0%}, within 95 %: {held.within_95:.0%}")

# %%
# The result
# ----------
#
# One arm is one draw. Before you conclude anything, run over seeds, and give medians with their range, as
# :doc:`/validation/paper` does.

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
for k, split in enumerate(splits):
    means = [left[name, split].mean() for name in competitors]
    axes.barh(
        np.arange(len(competitors)) + 0.2 * (2 * k - 1), means, 0.38, color=("#1f4e79", "#c28a1e")[k], label=split
    )
axes.axvline(cell.noise_floor, color="k", ls=":", label="noise floor")
axes.set_yticks(range(len(competitors)), competitors)
axes.invert_yaxis()
axes.set(xlabel="mean error left [mm]")
axes.legend()
