"""
What each term of kinematic Kriging is
======================================

A prediction is a sum of terms: each has a cause, depends on its own quantities, and can be switched off. Another
example shows :doc:`harmonics of gears <plot_14_gears>`, and another :doc:`what else can be measured
<plot_16_measured>`.
"""

# %%
# Virtual arms with the effects of each panel, and maps of their samples. The pictures of the pose show a sweep of
# joint 2 by ±20° about one of the poses, in the direction in which the tool moves with it.
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from truepose import VirtualCell, fit_cell
from truepose.samples import Poses
from truepose.simulation import PRESETS

KRIGING = "kinematic-kriging"


def fitted(preset, n=100, **conditions):
    virtual = VirtualCell(preset, seed=1)
    q = virtual.design(n, seed=1)
    return virtual, fit_cell(virtual.cell, virtual.measure(q, seed=1, **conditions), KRIGING)


plain, plain_map = fitted("hard")
turning, turning_map = fitted("backlash")
uneven, uneven_map = fitted(replace(PRESETS["backlash"], backlash_wave=(0.3, 0.6)), n=150)
warm, warm_map = fitted("cold-start")
_, loaded_map = fitted("hard", payload_kg=np.where(np.arange(100) % 2, 20.0, 120.0))
creeping, creeping_map = fitted("creep")

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


def band(axis, x, value, std, **style):
    """Draw values with their 95 % interval."""
    axis.plot(x, value, **style)
    axis.fill_between(x, value - 1.96 * std, value + 1.96 * std, alpha=0.3)


# %%
# Terms of the pose: registration and geometry are smooth, each joint's own error is not, Z is what remains.
figure, axes = plt.subplots(5, 2, figsize=(9, 14), layout="constrained")
(terms, curve), (rest, backlash), (shape, load), (heat, station), (warming, offset) = axes
parts = plain_map.predictor.explain(plain_map.inputs(Poses(q=q)))
joints = sum(part for name, part in parts.items() if name.startswith("joint"))
named = {name: parts[name] for name in ("registration", "geometry", "compliance")} | {"errors of the joints": joints}
for name, part in named.items():
    shown = np.sum(part * along, axis=1)
    terms.plot(angle, shown - shown.mean(), label=name)
terms.set(title="terms of the pose, less their means", xlabel="joint 2 [deg]", ylabel="error [mm]")
terms.legend(fontsize="x-small")

# %%
# The error of joint 2 as a function of its own angle; and the rest Z, of an arm with one more error of 0.1 mm that
# depends on joints 1 and 2 together: no other term can follow it.
found = next(one for one in plain_map.predictor.joint_curves() if one.joint == 1)
band(curve, np.rad2deg(found.angle), 1e6 * found.error, 1e6 * found.std)
curve.set(title="joint 2 alone", xlabel="joint 2 [deg]", ylabel="error of the joint [µrad]")
samples = plain_map.samples
more = 0.1 * np.cos(6.0 * samples.q[:, 0]) * np.sin(4.0 * samples.q[:, 1])
odd_map = fit_cell(plain.cell, replace(samples, p_meas=samples.p_meas + more[:, None] * [0.0, 0.0, 1.0]), KRIGING)
for name, part in zip("xyz", odd_map.predictor.explain(odd_map.inputs(Poses(q=q)))["rest"].T, strict=True):
    rest.plot(angle, part, label=name)
rest.set(title="rest Z", xlabel="joint 2 [deg]", ylabel="error [mm]")
rest.plot(angle, 0.1 * np.cos(6.0 * q[:, 0]) * np.sin(4.0 * q[:, 1]), "k--", label="true, z")
rest.legend(fontsize="x-small")

# %%
# Backlash: the same poses, reached from below and from above; and, where the lost motion of a joint varies with its
# angle, half of it as a function of the angle.
for sign, side in ((1.0, "below"), (-1.0, "above")):
    backlash.plot(angle, errors(turning_map, approach=np.full(q.shape, sign)), label=f"from {side}")
backlash.set(title="backlash", xlabel="joint 2 [deg]", ylabel="error [mm]")
backlash.legend(fontsize="x-small")

rows = {row["name"]: row for row in uneven_map.predictor.parameters_}
turn = np.linspace(*np.percentile(uneven_map.samples.q[:, 0], [0, 100]), 81)
waves = {"backlash q1": np.ones_like(turn)} | {
    f"backlash {name} {m} q1": wave(m * turn) for m in (1, 2) for name, wave in (("sin", np.sin), ("cos", np.cos))
}
known = sum(rows[name]["estimate"] * wave for name, wave in waves.items())
every = np.tile(turn[:, None], uneven.robot.dof)
half = 0.5 * uneven.truth.backlash * (1.0 + uneven.truth.backlash_wave(every))
shape.plot(np.rad2deg(turn), 1e6 * half[:, 0], "k--", label="true")
shape.plot(np.rad2deg(turn), -1e6 * known, label="map")
shape.set(title="backlash that varies", xlabel="joint 1 [deg]", ylabel="half of the lost motion [µrad]")
shape.legend(fontsize="x-small")


# %%
# Payload and temperature: the error at the middle of the sweep, with its 95 % interval.
def scan(axis, error_map, name, values):
    """Draw the change of the error at the middle of the sweep by a condition."""
    poses = [Poses(q=middle, **{name: np.array([value])}) for value in values]
    found = [error_map.predict_errors(one) for one in poses]
    shift = np.array([float((e - found[0][0])[0] @ along[40]) for e, _ in found])
    band(axis, values, shift, np.array([float(np.linalg.norm(s[0] * along[40])) for _, s in found]))


scan(load, loaded_map, "load", np.linspace(20.0, 120.0, 9))
load.set(title="compliance under the payload", xlabel="payload [kg]", ylabel="change of the error [mm]")
known = warm_map.samples.temperature
scan(heat, warm_map, "temperature", np.linspace(known.min(), known.max(), 9))
heat.set(title="expansion", xlabel="temperature [°C]", ylabel="change of the error [mm]")

# %%
# Time: each step of a slow motion is a parameter. The station of a tracker moves; an arm whose temperature was not
# measured grows; the offset of joint 2 moves. Where the truth is known, it is dashed.


def walked(error_map, name):
    """Return the sum of the steps of a motion, from its start."""
    steps = [row["estimate"] for row in error_map.predictor.parameters_ if row["name"].startswith(f"{name} ")]
    return np.r_[0.0, np.cumsum(steps)]


for axis in "xyz":
    station.plot(walked(creeping_map, f"station base {axis}"), label=axis)
station.set(title="moving station", xlabel="step of the campaign", ylabel="station [mm]")
station.legend(fontsize="x-small")

samples = warm.measure(warm.design(100, seed=1), seed=1)
growing = fit_cell(warm.cell, replace(samples, temperature=None), KRIGING)
warming.plot(samples.time / 60.0, 1e6 * warm.truth.expansion.mean() * (samples.temperature - 20.0), "k--", label="true")
steps = walked(growing, "warming")
warming.plot(np.quantile(samples.time, np.linspace(0.0, 1.0, len(steps))) / 60.0, 1e6 * steps, label="map")
warming.set(title="growing arm", xlabel="time [min]", ylabel="growth of all lengths [µm/m]")
warming.legend(fontsize="x-small")

commanded = plain.design(100, seed=1)
time = np.linspace(0.0, 5400.0, len(commanded))
moved = commanded + 3e-4 * (time / time[-1])[:, None] * np.eye(6)[1]
samples = plain.measure(commanded, seed=1, time=4 * 3600.0 + time)
samples = replace(samples, p_meas=plain.measure(moved, seed=1, time=4 * 3600.0 + time).p_meas)
slipping = fit_cell(plain.cell, samples, KRIGING)
offset.plot([0.0, 90.0], [0.0, 300.0], "k--", label="true")
steps = walked(slipping, "offset q2")
offset.plot(np.linspace(0.0, 90.0, len(steps)), 1e6 * steps, label="map")
offset.set(title="moving offset of joint 2", xlabel="time [min]", ylabel="offset [µrad]")
offset.legend(fontsize="x-small")
plt.show()
