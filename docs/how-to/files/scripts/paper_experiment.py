"""The paper's experiment on one virtual robot: its method, on 125 samples and 100 other targets."""

import truepose as tp

virtual = tp.VirtualCell("paper", seed=0)  # a KUKA KR210 whose errors of geometry are unknown to the software
samples = virtual.measure(virtual.design(125))
error_map = tp.fit_cell(virtual.cell, samples, "registration")  # the tracker's frame to the robot's base
p, e = error_map.p_cmd, error_map.e  # (n, 3) mm, base frame

variogram = tp.fit_variogram(tp.experimental_variogram(p, e, bins=20), family="spherical")  # equation (4)
kriging = tp.OrdinaryKriging(variogram).fit(p, e)  # equation (7)

p_target = virtual.robot.forward(virtual.design(100, seed=1), tool=virtual.cell.tf_flange_tool)[:, :3, 3]
p_command = p_target - kriging.predict(p_target)  # equation (15)


def error_of(p):
    """Send the robot to positions, measure, and return the errors against the targets (n, 3) [mm]."""
    measured = virtual.measure(virtual.reach(p), seed=2)
    return error_map.registration.apply(measured.p_meas) - p_target


print(tp.accuracy(error_of(p_target), error_of(p_command)))
