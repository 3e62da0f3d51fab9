"""Rank predictors on your own table of samples: `python compare.py cell.toml samples.csv`."""

import sys

import truepose as tp

if __name__ == "__main__":  # needed where workers > 1
    cell, samples = tp.load_cell(sys.argv[1]), tp.read_samples(sys.argv[2])
    names = ["registration", "idw", "ordinary-kriging", "calibration"]
    choice = tp.choose(names, samples, cell, workers=1)
    for row in choice.ranking:
        print(f"{row['predictor']:20s} {row['mean_mm']:.4f} mm")
    print(f"expected of the choice itself: {choice.expected['mean_mm']:.4f} mm")
