"""Reports: that of an error map, as one self-contained page or a PDF, and that of what is corrected of programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from truepose._lazy import lazy_names

if TYPE_CHECKING:
    from truepose.report.coverage import write_coverage
    from truepose.report.page import write_report

__all__ = ["write_coverage", "write_report"]

__getattr__ = lazy_names(__name__, {"write_coverage": "coverage", "write_report": "page"})


def __dir__() -> list[str]:
    return __all__
