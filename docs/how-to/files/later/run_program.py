"""Run a corrected program of the practice cell on its virtual robot, and write the tracker's readings."""

import sys
from pathlib import Path

import truepose as tp

folder = Path(sys.argv[1])
virtual, cell = tp.VirtualCell("paper", seed=7), tp.load_cell(folder / "cell.toml")
path = Path(sys.argv[2]) if len(sys.argv) > 2 else folder / "corrected" / "panel.src"
program = tp.read_program(path, tp.FrameTable.from_cell(cell))
tp.write_readings("after.txt", virtual.measure(virtual.reach(program.positions_base()), seed=9), "spatial-analyzer")
