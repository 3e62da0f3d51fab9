"""The report of an error map: one self-contained page or a PDF."""

from truepose.report.page import write_report

__all__ = ["write_report"]
