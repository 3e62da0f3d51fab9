"""KUKA KRL."""

from truepose.programs.krl.reader import read

__all__ = ["read"]
