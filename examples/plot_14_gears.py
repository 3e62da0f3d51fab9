"""
Harmonics of the gears: errors that repeat with each turn of a motor
====================================================================

A gear turns its joint by a few ten microradians too much and too little, once or twice in each turn of the motor. With
a ratio of 100 the period is 3.6°: some hundred poses do not show its shape, unless the ratio is known.
"""

# %%
# A virtual arm with 20 to 50 µrad of ripple. Its file states the gear ratios, which the model then takes.
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from truepose import VirtualCell, fit_cell
from truepose.robots import load_robot
from truepose.robots.io.toml import to_toml

arm = replace(load_robot("kuka-kr210-r2700-extra"), gear_ratio=[141.0, 153.5, 120.0, 101.0, 80.0, 51.0])
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "arm.toml"
    path.write_text(to_toml(arm), "utf-8")
    virtual = VirtualCell("ripple", robot=path, seed=3)
    samples = virtual.measure(virtual.design(150, seed=3), seed=3)
    maps = {
        "ratio not used": fit_cell(virtual.cell, samples, "kinematic-kriging:gear_harmonics=no"),
        "ratio used": fit_cell(virtual.cell, samples, "kinematic-kriging"),
    }

# %%
# The ripple of joint 1 over 10°, true and as the map knows it with its 95 % interval. Marks are the angles of samples.
rows = {row["name"]: row for row in maps["ratio used"].predictor.parameters_}
angle = np.deg2rad(np.linspace(0.0, 10.0, 400))
waves = {
    f"gear {name} {m} q1": wave(m * 141.0 * angle) for m in (1, 2) for name, wave in (("sin", np.sin), ("cos", np.cos))
}
known = sum(rows[name]["estimate"] * wave for name, wave in waves.items())
std = np.sqrt(sum((rows[name]["std"] * wave) ** 2 for name, wave in waves.items()))
joints = np.zeros((len(angle), 6))
joints[:, 0] = angle
figure, (over, left) = plt.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
over.plot(np.rad2deg(angle), 1e6 * virtual.truth.ripple(joints)[:, 0], "k--", label="true")
over.plot(np.rad2deg(angle), 1e6 * known, label="map")
over.fill_between(np.rad2deg(angle), 1e6 * (known - 1.96 * std), 1e6 * (known + 1.96 * std), alpha=0.3)
sampled = np.rad2deg(samples.q[:, 0])
sampled = sampled[(sampled >= 0.0) & (sampled <= 10.0)]
over.plot(sampled, np.full(len(sampled), over.get_ylim()[0]), "|", color="grey", markersize=12)
over.set(xlabel="joint 1 [deg]", ylabel="error of the joint [µrad]")
over.legend()

# %%
# At new poses, the errors that are left.
test = virtual.measure(virtual.design(200, seed=4), seed=4)
for name, error_map in maps.items():
    distance = np.linalg.norm(error_map.errors(test) - error_map.predict_errors(test)[0], axis=1)
    left.hist(distance, bins=np.linspace(0.0, 0.2, 41), alpha=0.7, label=f"{name}: mean {distance.mean():.3f} mm")
left.set(xlabel="distance from the prediction [mm]", ylabel="poses")
left.legend()
plt.show()
