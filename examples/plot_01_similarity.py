r"""
What similarity looks like
==========================

The semivariogram is half the mean squared difference between the errors of two poses, as a function of their distance:

.. math:: \gamma(h) = \frac{1}{2N(h)} \sum_{|P_i - P_j| \approx h} \lVert e(P_i) - e(P_j) \rVert^2 .

Near poses have nearly the same error, so the curve starts low. The grey band shows where it would lie if the same
errors were shuffled among the poses. Points below the band show structure that a map can use.
"""

import matplotlib.pyplot as plt

import truepose as tp
from truepose.report.plots import draw_variogram

cell = tp.VirtualCell("paper", seed=1)
samples = cell.measure(cell.design(200))
error_map = tp.fit_cell(cell.cell, samples, "registration")  # errors are what registration leaves
x, e = error_map.p_cmd, error_map.e

experimental = tp.experimental_variogram(x, e, bins=15)
model = tp.fit_variogram(experimental, family="best")
envelope = tp.permutation_envelope(x, e, bins=15, rng=0)
figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
draw_variogram(axes, experimental, model, envelope)
