"""A production cell from readings to a corrected program: `python production_cell.py FOLDER`."""

import sys
from pathlib import Path

import truepose as tp

folder = Path(sys.argv[1])
cell = tp.load_cell(folder / "cell.toml")
samples = tp.read_samples(folder / "fit_samples.csv")  # written by `truepose import`
held_out = tp.read_samples(folder / "held_out_samples.csv")

error_map = tp.fit_cell(cell, samples, predictor="ordinary-kriging")  # "auto" chooses, in a minute or two
result = error_map.validate(held_out)
print(f"{result['before']['mean_mm']:.3f} mm before, {result['after']['mean_mm']:.3f} mm after")
if result["after"]["p95_mm"] > 0.15:
    sys.exit("The map is not good enough for this program; measure more poses.")

error_map.save(folder / "production.truepose")
corrected = tp.correct_program(folder / "program" / "panel.src", error_map, cell, require=0.95)
corrected.write(folder / "production")
record = folder / "production" / "panel.corrections.json"
tp.write_report(error_map, folder / "production.html", held_out, sidecars=[record])
