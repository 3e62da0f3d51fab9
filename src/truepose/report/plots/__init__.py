"""Pictures: `truepose.plot` of any result, semivariograms, and the figures of report, explain and similarity.

Whatever imports a module of this package needs matplotlib, of the extra ``truepose[report]``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from truepose._extras import needed
from truepose._lazy import lazy_names

with needed("a picture or a report", "report"):
    import matplotlib  # noqa: F401  # for all modules of the package

if TYPE_CHECKING:
    from truepose.report.plots.results import plot
    from truepose.report.plots.similarity import draw_variogram, plot_variogram

__all__ = ["draw_variogram", "plot", "plot_variogram"]

__getattr__ = lazy_names(__name__, {"draw_variogram": "similarity", "plot": "results", "plot_variogram": "similarity"})


def __dir__() -> list[str]:
    return __all__
