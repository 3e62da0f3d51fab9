"""
What else was measured: reflectors, orientations, distances, other robots
=========================================================================

Beside positions of one point, kinematic Kriging takes readings of several reflectors, orientations of the tool,
distances from fixed points, and maps of other robots of the type. Each is a term, or rows, of the same fit.
"""

# %%
# Three reflectors about the tool point, read at each of 40 poses. The cell states the places of A and B to 5 µm, that
# of C to 1 mm and wrong by 0.3 mm in x: the fit finds where it is, with its 95 % interval. Along z, C may be off or the
# tool may be turned, which readings cannot tell apart.
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

from truepose import Cell, VirtualCell, fit_cell
from truepose.geometry import apply_transform, invert_transform
from truepose.samples import Distances, Poses
from truepose.simulation import VirtualFleet

KRIGING = "kinematic-kriging"
figure, axes = plt.subplots(2, 2, figsize=(10, 7), layout="constrained")
(reflectors, turns), (distances, fleet) = axes
virtual = VirtualCell("hard", seed=1)
cell = virtual.cell_with(3)
each = virtual.measure_each(virtual.design(40, seed=1), seed=1)
wrong = cell.model_dump(exclude_unset=True)
wrong["reflectors"]["C"] |= {"x_mm": cell.reflectors["C"].x_mm - 0.3, "std_mm": 1.0}
error_map = fit_cell(Cell.model_validate(wrong), each, KRIGING)
rows = [row for row in error_map.predictor.parameters_ if row["name"].startswith("reflector")]
reflectors.errorbar(
    [row["name"].removeprefix("reflector ") for row in rows],
    [row["estimate"] for row in rows],
    [1.96 * row["std"] for row in rows],
    fmt="o",
    label="map",
)
reflectors.plot([0.0] * 6 + [0.3, 0.0, 0.0], "k_", markersize=18, label="true")
reflectors.set(title="reflectors away from their stated places", ylabel="deviation [mm]")
reflectors.legend(loc="upper left")

# %%
# The same readings as poses of the tool: measured orientations are rows of their own. At other poses, the orientation
# of the tool is predicted better than from positions alone.
samples = virtual.measure(virtual.design(40, seed=1), seed=1, reflectors=3)
targets = Poses(q=virtual.design(200, seed=2))


def seen(error_map, poses):
    """Return the true poses of the tool as the registration of a map sees them."""
    tf = error_map.registration.tf_base_tracker @ invert_transform(virtual.truth.tf_base_tracker)
    return tf @ virtual.true_poses(poses.q)


for name, predictor in (("positions alone", f"{KRIGING}:conditions=none"), ("with orientations", KRIGING)):
    error_map = fit_cell(virtual.cell, samples, predictor)
    true = Rotation.from_matrix(seen(error_map, targets)[:, :3, :3])
    nominal = Rotation.from_matrix(virtual.robot.forward(targets.q, tool=error_map.tf_flange_tool)[:, :3, :3])
    miss = error_map.predict_pose_errors(targets)[0][:, 3:] - (true * nominal.inv()).as_rotvec()
    turn = 1e3 * np.linalg.norm(miss, axis=1)
    turns.hist(turn, np.linspace(0.0, 0.6, 31), alpha=0.7, label=f"{name}: mean {turn.mean():.2f} mrad")
turns.set(title="orientations", xlabel="error of the predicted orientation [mrad]", ylabel="poses")
turns.legend()

# %%
# Distances to three fixed points at 60 further poses, as draw wires read them, beside 40 positions.
samples = virtual.measure(virtual.design(40, seed=1), seed=1)
points = np.array([[2500.0, -1500.0, 200.0], [2500.0, 1500.0, 800.0], [900.0, 0.0, 1500.0]])  # base frame
p_origin = apply_transform(invert_transform(virtual.truth.tf_base_tracker), points)[np.arange(60) % 3]
further = virtual.measure(virtual.design(60, seed=3), seed=3)
wires = Distances(
    q=further.q,
    distance=np.linalg.norm(further.p_meas - p_origin, axis=1),
    distance_std=np.full(60, 0.02),
    p_origin=p_origin,
)
for name, some in (("40 positions", samples), ("and 60 distances", replace(samples, distances=wires))):
    error_map = fit_cell(virtual.cell, some, KRIGING)
    nominal = virtual.robot.forward(targets.q, tool=error_map.tf_flange_tool)[:, :3, 3]
    miss = error_map.predict_errors(targets)[0] - (seen(error_map, targets)[:, :3, 3] - nominal)
    left = np.linalg.norm(miss, axis=1)
    distances.hist(left, np.linspace(0.0, 0.12, 31), alpha=0.7, label=f"{name}: mean {left.mean():.3f} mm")
distances.set(title="distances", xlabel="error of the predicted position [mm]", ylabel="poses")
distances.legend()

# %%
# Three robots of a type, and the next one with 20 poses: the mean error of the others is a term of its map. The
# picture shows a sweep of joint 2, in the direction in which the tool moves with it, less the mean.
robots = VirtualFleet("hard", share=0.9, seed=1)
maps = [fit_cell(one.cell, one.measure(one.design(100, seed=1), seed=1), KRIGING) for one in map(robots.cell, range(3))]
virtual = robots.cell(3)
samples = virtual.measure(virtual.design(20, seed=1), seed=1)
q = np.tile(np.median(samples.q, axis=0), (81, 1))
q[:, 1] += np.deg2rad(np.linspace(-15.0, 15.0, 81))
sweep = Poses(q=q)
along = virtual.robot.joint_jacobian(q, tool=virtual.tf_flange_tool)[:, :3, 1]
along /= np.linalg.norm(along, axis=1, keepdims=True)


def draw(error, style, label):
    """Draw errors along the sweep."""
    size = np.sum(error * along, axis=1)
    fleet.plot(np.rad2deg(q[:, 1]), size - size.mean(), style, label=label)


alone, liked = fit_cell(virtual.cell, samples, KRIGING), fit_cell(virtual.cell, samples, KRIGING, like=maps)
draw(seen(liked, sweep)[:, :3, 3] - virtual.robot.forward(q, tool=liked.tf_flange_tool)[:, :3, 3], "k--", "true")
draw(alone.predict_errors(sweep)[0], "-", "20 poses alone")
draw(liked.predict_errors(sweep)[0], "-", "with maps of three others")
draw(liked.predictor.explain(liked.inputs(sweep))["fleet"], ":", "of it, their mean error")
fleet.set(title="fleet", xlabel="joint 2 [deg]", ylabel="error [mm]")
fleet.legend(fontsize="small")
plt.show()
