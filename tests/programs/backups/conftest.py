"""A format of backups of the tests in place of the makers'."""

from __future__ import annotations

import pytest
from tests.programs.backups import small, small_other


@pytest.fixture
def small_format(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `small` be KUKA's format and `small_other` FANUC's."""
    formats = {"KUKA": small.__name__, "FANUC": small_other.__name__}
    monkeypatch.setattr("truepose.programs.backups.backup.FORMATS", formats)
