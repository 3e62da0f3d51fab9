r"""
Where to measure
================

Forty poses, chosen before anything is measured: for the lowest predicted uncertainty over the work region, and evenly.
The prediction of what they will leave needs no reading; the virtual arm then shows what they do leave.
"""

import matplotlib.pyplot as plt

import truepose as tp

cell = tp.VirtualCell("hard", seed=4)
held_out = cell.measure(cell.design(200, seed=99), seed=99)
counts = [20, 40, 80]

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
for method, colour in {"posterior": "#1f4e79", "grid": "#c8442b"}.items():
    plans = [tp.plan(cell.cell, n, method) for n in counts]
    maps = [tp.fit_cell(cell.cell, cell.measure(plan.q, seed=1), "kinematic-kriging") for plan in plans]
    found = [made.validate(held_out)["after"]["mean_mm"] for made in maps]
    left.plot(counts, [plan.expected_mm for plan in plans], "--", color=colour, label=f"{method}: expected")
    left.plot(counts, found, "o-", color=colour, label=f"{method}: found")
    p = plans[1].poses.p_cmd
    right.plot(p[:, 0], p[:, 2], "o", ms=4, color=colour, label=method)
left.set(xlabel="poses measured", ylabel="mean difference from readings [mm]", ylim=(0, None))
left.axhline(cell.noise_floor, color="k", ls=":", label="noise floor")
left.legend()
right.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal", title="forty poses, seen from the side")
right.legend()
