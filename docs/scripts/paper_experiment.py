"""The paper's experiment: errors of a robot are similar, Kriging predicts them, and corrected targets are measured."""

import truepose as tp

virtual = tp.VirtualCell("paper", seed=0)
error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(125)), "ordinary-kriging")
print(error_map)

similarity = tp.experimental_variogram(error_map.p_cmd, error_map.e)
print(f"semivariance {similarity.semivariance.mean(axis=1).round(4)} mm² at {similarity.lag.round()} mm")

q = virtual.design(100, seed=1)  # new targets, within the sampled region
corrections = error_map.correct(q)
before = error_map.errors(virtual.measure(q))
reached = virtual.measure(virtual.reach(corrections.p_command))
after = error_map.registration.apply(reached.p_meas) - corrections.p_target
print(tp.accuracy(before, after))
