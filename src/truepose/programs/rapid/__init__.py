"""ABB RAPID."""

from truepose.programs.rapid.reader import read

__all__ = ["read"]
