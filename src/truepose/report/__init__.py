"""Reports: that of an error map, as one self-contained page or a PDF, and that of what is corrected of programs."""

from truepose.report.coverage import write_coverage
from truepose.report.page import write_report

__all__ = ["write_coverage", "write_report"]
