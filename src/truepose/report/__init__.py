"""One self-contained page about a map: what was measured, what was found, what was corrected."""

from truepose.report.page import write_report

__all__ = ["write_report"]
