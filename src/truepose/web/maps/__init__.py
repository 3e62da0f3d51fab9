"""Error maps: figures, arrows, slices, curves and variograms."""
