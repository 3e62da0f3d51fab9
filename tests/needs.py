"""What tests need that an installation may not have: they are skipped without it, or fail where they must run.

``TRUEPOSE_STORE_TESTS=require`` says that they must run.
"""

from __future__ import annotations

import importlib
import os
from types import ModuleType
from typing import NoReturn

import pytest


def missing(why: str) -> NoReturn:
    """Skip a test or a module of tests, or fail it where it must run."""
    if os.environ.get("TRUEPOSE_STORE_TESTS") == "require":
        pytest.fail(why, pytrace=False)
    pytest.skip(why, allow_module_level=True)


def needed(module: str, install: str) -> ModuleType:
    """Return a module, whose package `install` names; see `missing`."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        missing(f"no module {error.name}: pip install {install}")
