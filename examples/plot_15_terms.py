"""
What each term of kinematic Kriging is
======================================

A prediction is a sum of terms: each has a cause, depends on its own quantities, and can be switched off.
"""

# %%
# Virtual arms with the effects of each panel, and maps of 100 poses. The pictures show a sweep of joint 2 by ±20°
# about one of the poses, in the direction in which the tool moves with it.
import matplotlib.pyplot as plt
import numpy as np

from truepose import VirtualCell, fit_cell
from truepose.samples import Poses


def fitted(preset, **conditions):
    virtual = VirtualCell(preset, seed=1)
    q = virtual.design(100, seed=1)
    return virtual, fit_cell(virtual.cell, virtual.measure(q, seed=1, **conditions), "kinematic-kriging")


plain, plain_map = fitted("hard")
turning, turning_map = fitted("backlash")
warm, warm_map = fitted("cold-start")
_, loaded_map = fitted("hard", payload_kg=np.where(np.arange(100) % 2, 20.0, 120.0))
_, creeping_map = fitted("creep")

angle = np.linspace(-20.0, 20.0, 81)
q = np.tile(np.median(plain_map.samples.q, axis=0), (len(angle), 1))
q[:, 1] += np.deg2rad(angle)
angle = np.rad2deg(q[:, 1])
middle = q[40:41]
along = plain.robot.joint_jacobian(q, tool=plain_map.tf_flange_tool)[:, :3, 1]
along /= np.linalg.norm(along, axis=1, keepdims=True)


def errors(error_map, **conditions):
    """Return the predicted errors along the sweep, in its direction [mm]."""
    return np.sum(error_map.predict_errors(Poses(q=q, **conditions))[0] * along, axis=1)


# %%
# Terms of the pose: registration and geometry are smooth, each joint's own error is not, Z is what remains.
figure, axes = plt.subplots(2, 3, figsize=(11, 6), layout="constrained")
(terms, curve, backlash), (heat, load, station) = axes
parts = plain_map.predictor.explain(plain_map.inputs(Poses(q=q)))
joints = sum(part for name, part in parts.items() if name.startswith("joint"))
named = {name: parts[name] for name in ("registration", "geometry", "compliance")} | {
    "errors of the joints": joints,
    "rest Z": parts["rest"],
}
for name, part in named.items():
    shown = np.sum(part * along, axis=1)
    terms.plot(angle, shown - shown.mean(), label=name)
terms.set(title="terms of the pose, less their means", xlabel="joint 2 [deg]", ylabel="error [mm]")
terms.legend(fontsize="x-small")

# %%
# The error of joint 2 as a function of its own angle, with its 95 % interval.
found = next(one for one in plain_map.predictor.joint_curves() if one.joint == 1)
degrees, error, std = np.rad2deg(found.angle), 1e6 * found.error, 1e6 * found.std
curve.plot(degrees, error)
curve.fill_between(degrees, error - 1.96 * std, error + 1.96 * std, alpha=0.3)
curve.set(title="joint 2 alone", xlabel="joint 2 [deg]", ylabel="error of the joint [µrad]")

# %%
# Backlash: the same poses, reached from below and from above.
for sign, side in ((1.0, "below"), (-1.0, "above")):
    backlash.plot(angle, errors(turning_map, approach=np.full(q.shape, sign)), label=f"from {side}")
backlash.set(title="backlash", xlabel="joint 2 [deg]", ylabel="error [mm]")
backlash.legend(fontsize="x-small")

# %%
# Temperature and payload: the error at the middle of the sweep, with its 95 % interval.


def scan(axis, error_map, values, **state):
    """Draw the length of the change of the error at the middle of the sweep by a condition."""
    (name,) = state
    poses = [Poses(q=middle, **{name: np.array([value])}) for value in values]
    found = [error_map.predict_errors(one) for one in poses]
    shift = np.array([float((e - found[0][0])[0] @ along[40]) for e, _ in found])
    std = np.array([float(np.linalg.norm(s[0] * along[40])) for _, s in found])
    axis.plot(values, shift)
    axis.fill_between(values, shift - 1.96 * std, shift + 1.96 * std, alpha=0.3)


known = warm_map.samples.temperature
scan(heat, warm_map, np.linspace(known.min(), known.max(), 9), temperature=True)
heat.set(title="expansion", xlabel="temperature [°C]", ylabel="change of the error [mm]")
scan(load, loaded_map, np.linspace(20.0, 120.0, 9), load=True)
load.set(title="compliance under the payload", xlabel="payload [kg]", ylabel="change of the error [mm]")

# %%
# Time: the station of the tracker moves slowly; each step of its walk is a parameter.
rows = creeping_map.predictor.parameters_
for axis in "xyz":
    steps = [row["estimate"] for row in rows if row["name"].startswith(f"station base {axis} ")]
    station.plot(np.r_[0.0, np.cumsum(steps)], label=axis)
station.set(title="moving station", xlabel="step of the campaign", ylabel="station [mm]")
station.legend(fontsize="x-small")
plt.show()
