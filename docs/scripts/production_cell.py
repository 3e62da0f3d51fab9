"""A production cell: from the tracker's readings to a corrected program and a report."""

import truepose as tp

cell = tp.load_cell("cell.toml")
samples, summary = tp.import_readings("fit_readings.txt", tp.read_poses("fit_plan.csv"), cell=cell)
print(summary)
error_map = tp.fit_cell(cell, samples, "kinematic-kriging")
print(error_map)

held_out, _ = tp.import_readings("held_out_readings.txt", tp.read_poses("held_out_plan.csv"), cell=cell)
print(tp.recheck(error_map, held_out))
print(error_map.validate(held_out)["reduction_mean_percent"], "% less")
error_map.save("map.truepose")

corrected = tp.correct_program("program/panel.src", error_map, cell)
corrected.write("corrected")
tp.write_report(error_map, "report.html", held_out)
