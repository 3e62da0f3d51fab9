r"""
Correcting a program
====================

A robot should move along a line in 25 steps. Its map predicts where it will really be. Each command is solved so that
its predicted outcome is the target, :math:`P_c + \hat e(P_c) = P_t`. Then the virtual robot runs both programs, and the
tracker measures both.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import truepose as tp
from truepose.geometry import apply_transform
from truepose.programs import FrameTable

cell = tp.VirtualCell("paper", seed=4)
error_map = tp.fit_cell(cell.cell, cell.measure(cell.design(120)), "kinematic-kriging")
frames = FrameTable(tools={1: cell.tf_flange_tool})

along = np.linspace(-600.0, 600.0, 25)
moves = "".join(f"LIN {{X 1750.000,Y {y:.3f},Z 950.000,A 180.000,B 20.000,C 180.000}} C_DIS\n" for y in along)
text = f"DEF SEAM( )\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n{moves}END\n"

with TemporaryDirectory() as folder:
    source = Path(folder) / "seam.src"
    source.write_text(text)
    corrected = tp.correct_program(source, error_map, frames=frames)
    corrected.write(Path(folder) / "out")
    targets = tp.read_program(source, frames).positions_base()
    commands = tp.read_program(Path(folder) / "out" / "seam.src", frames).positions_base()
    changed = (Path(folder) / "out" / "seam.src").read_text()

print(text.splitlines()[3])
print(changed.splitlines()[3])

# %%
# Only digits differ between the two lines. The tracker measures both programs:

figure, axes = plt.subplots(figsize=(8, 3.6), layout="constrained")
for label, p, colour in (("as programmed", targets, "#c8442b"), ("corrected", commands, "#1f4e79")):
    seen = apply_transform(error_map.registration.tf_base_tracker, cell.measure(cell.reach(p), seed=7).p_meas)
    miss = np.linalg.norm(seen - targets, axis=1)
    axes.plot(along, miss, "o-", color=colour, ms=4, label=f"{label}: at most {miss.max():.3f} mm")
axes.axhline(cell.noise_floor, color="k", ls=":", label="noise floor")
axes.set(xlabel="y along the line [mm]", ylabel="distance to the target [mm]", ylim=(0, None))
axes.legend()
