"""The paper's experiment on a virtual robot: semivariogram, ordinary Kriging, and one-step corrections, measured."""

import truepose as tp

virtual = tp.VirtualCell("paper", seed=0)  # a KUKA KR210 whose errors are unknown to the software
error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(125)), "registration")
p, e = error_map.p_cmd, error_map.e  # commanded positions and errors after registration, (n, 3) mm, base frame

similarity = tp.experimental_variogram(p, e)  # equation (4)
print(similarity)
kriging = tp.OrdinaryKriging(tp.fit_variogram(similarity, "spherical")).fit(p, e)  # equation (7)

p_target = virtual.robot.forward(virtual.design(100, seed=1), tool=virtual.cell.tf_flange_tool)[:, :3, 3]
p_command = p_target - kriging.predict(p_target)  # equation (15)
reached = [virtual.measure(virtual.reach(command), seed=2) for command in (p_target, p_command)]
before, after = (error_map.registration.apply(measured.p_meas) - p_target for measured in reached)
print(tp.accuracy(before, after))
