r"""
Pose accuracy by ISO 9283
=========================

Five poses on the diagonals of a cube are measured in thirty cycles. Pose accuracy AP is the distance from the commanded
position to the mean of the attained ones; repeatability RP is their scatter, :math:`\bar l + 3 S_l`. Correcting the
commands lowers AP. It cannot lower RP, because no map can predict what a robot does differently each time.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp
from truepose.geometry import apply_transform, euler, make_transform

cell = tp.VirtualCell("paper", seed=5)
error_map = tp.fit_cell(cell.cell, cell.measure(cell.design(100)), "kinematic-kriging")

rotation = euler("kuka", cell.preset.abc_deg)
poses = tp.iso9283_poses(cell.cell, edge_mm=630.0, centre_mm=cell.preset.centre_mm, rotation=rotation)
corrections = error_map.correct(make_transform(rotation, poses.p_cmd))


def attained(p_command):
    """Go to commands, and return the figures against the standard's poses."""
    seen = cell.measure(cell.reach(p_command, rotation))
    p_base = apply_transform(error_map.registration.tf_base_tracker, seen.p_meas)
    return tp.iso9283(replace(seen, q=poses.q, p_cmd=poses.p_cmd, p_meas=p_base), registered=True)


results = {"as programmed": attained(poses.p_cmd), "corrected": attained(corrections.p_command)}
figure, panels = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
for k, (label, figures) in enumerate(results.items()):
    place = np.arange(5) + 0.2 * (2 * k - 1)
    colour = ("#c8442b", "#1f4e79")[k]
    panels[0].bar(place, [pose.AP_mm for pose in figures.poses], 0.38, color=colour, label=label)
    panels[1].bar(place, [pose.RP_mm for pose in figures.poses], 0.38, color=colour)
    print(f"{label:14s} AP {figures.AP_mm:.3f} mm, RP {figures.RP_mm:.3f} mm")
for axes, title in zip(panels, ("AP [mm]", "RP [mm]"), strict=True):
    axes.set(title=title, xticks=range(5), xticklabels=[f"P{i}" for i in range(1, 6)])
panels[0].legend()
