r"""
Where to measure
================

Forty poses are chosen before anything is measured: once for the lowest predicted uncertainty over the work region, and
once on a grid. The expected error needs no reading. The virtual arm then shows the error that is really left.
"""

import matplotlib.pyplot as plt

import truepose as tp

cell = tp.VirtualCell("hard", seed=4)
held_out = cell.measure(cell.design(200, seed=99), seed=99)

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
for method, colour in {"posterior": "#1f4e79", "grid": "#c8442b"}.items():
    plan = tp.plan(cell.cell, 40, method)
    error_map = tp.fit_cell(cell.cell, cell.measure(plan.q, seed=1), "kinematic-kriging")
    found = error_map.validate(held_out, rivals=False)["after"]["mean_mm"]
    print(f"{method}: {plan.expected_mm:.3f} mm expected, {found:.3f} mm found")
    left.bar(method, plan.expected_mm, 0.5, color="none", edgecolor=colour, ls="--", label=f"{method}: expected")
    left.plot(method, found, "o", color=colour, label=f"{method}: found")
    p = plan.poses.p_cmd
    right.plot(p[:, 0], p[:, 2], "o", ms=4, color=colour, label=method)
left.set(title="forty poses measured", ylabel="mean difference from readings [mm]")
left.axhline(cell.noise_floor, color="k", ls=":", label="noise floor")
left.legend()
right.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal", title="forty poses, seen from the side")
right.legend()
