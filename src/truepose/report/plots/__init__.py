"""Pictures: semivariograms, and the figures of report, explain and similarity."""

from truepose.report.plots.similarity import draw_variogram, plot_variogram

__all__ = ["draw_variogram", "plot_variogram"]
