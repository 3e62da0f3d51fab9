"""Errors of a corrected program, measured at the machine: `python verify.py FOLDER READINGS`."""

import sys
from pathlib import Path

import truepose as tp

folder, readings = Path(sys.argv[1]), Path(sys.argv[2])
cell, error_map = tp.load_cell(folder / "cell.toml"), tp.load_map(folder / "map.truepose")

original = tp.read_program(folder / "program" / "panel.src", tp.FrameTable.from_cell(cell))
p_target = original.positions_base()  # (n, 3) mm: where the tool should be
p_meas = tp.read_readings(readings).p  # (n, 3) mm, tracker frame; one reading for each target, in order

left = error_map.registration.apply(p_meas) - p_target  # the station of the map: nothing is fitted again
before = error_map.predict(tp.Poses(p_cmd=p_target)).e  # what the map predicts for the original program
result = tp.accuracy(before, left)
print(f"predicted before: {result.before['mean_mm']:.3f} mm in the mean, {result.before['max_mm']:.3f} mm at most")
print(f"measured after:   {result.after['mean_mm']:.3f} mm in the mean, {result.after['max_mm']:.3f} mm at most")
