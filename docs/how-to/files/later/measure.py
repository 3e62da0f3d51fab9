"""Write 20 new readings of the practice cell, as it is and after its tool was bumped."""

from pathlib import Path

import numpy as np

import truepose as tp

HERE = Path(__file__).parent

virtual = tp.VirtualCell("paper", seed=7)  # the cell of `truepose demo --seed 7`
samples = virtual.measure(virtual.design(20, seed=50), seed=50)
tp.write_samples(HERE / "checks.csv", samples)

bump = np.array([0.3, 0.0, 0.4])  # mm, in the frame of the tool
tf_base_tool = virtual.robot.forward(samples.q, tool=virtual.cell.tf_flange_tool)
moved_in_base = tf_base_tool[:, :3, :3] @ bump
moved = moved_in_base @ virtual.truth.tf_base_tracker[:3, :3]  # base frame to tracker frame
tp.write_samples(HERE / "bumped.csv", tp.Samples(samples.p_meas + moved, q=samples.q))
