r"""
The error of each joint, seen at the tool
=========================================

Kinematic Kriging models the transmission error of each joint as a random function of that joint's own angle. It moves
the tool by :math:`\partial P / \partial q_j`. Two poses share this error whenever they share the angle of the joint,
wherever the arm is. From positions of the tool point alone the six curves are recovered. Black is the truth of this
virtual arm; the part that geometry can also explain (a constant and the first harmonic) is removed from both.
"""

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp

cell = tp.VirtualCell("hard", seed=1)
samples = cell.measure(cell.design(150))
error_map = tp.fit_cell(cell.cell, samples, "kinematic-kriging")


def without_first_harmonic(angle, error):
    columns = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    return error - columns @ np.linalg.lstsq(columns, error)[0]


figure, panels = plt.subplots(2, 3, figsize=(9, 4.6), layout="constrained")
for curve in error_map.predictor.joint_curves():
    axes = panels.flat[curve.joint]
    turned = np.zeros((len(curve.angle), cell.robot.dof))
    turned[:, curve.joint] = curve.angle
    true = without_first_harmonic(curve.angle, cell.truth.joint_error(turned)[:, curve.joint])
    degrees = np.rad2deg(curve.angle)
    axes.fill_between(
        degrees, 1e3 * (curve.error - 2 * curve.std), 1e3 * (curve.error + 2 * curve.std), color="#1f4e79", alpha=0.25
    )
    axes.plot(degrees, 1e3 * curve.error, color="#1f4e79", label="predicted, ± 2 std")
    axes.plot(degrees, 1e3 * true, "k", lw=1, label="true")
    axes.set_title(f"joint {curve.joint + 1}")
panels[0, 0].legend(fontsize=7)
figure.supxlabel("angle [°]")
figure.supylabel("joint error [mrad]")
