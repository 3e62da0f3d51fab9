"""Names of a package that are imported when they are first used, so that importing the package is cheap."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from truepose._deprecated import Former


def lazy_names(
    package: str, homes: Mapping[str, str], former: Mapping[str, Former] | None = None
) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package.

    Parameters
    ----------
    package : str
        The package.
    homes : mapping of str to str
        The submodule that defines each name.
    former : mapping of str to Former, optional
        The names that the package had before; using one gives a `TrueposeDeprecationWarning`.
    """

    def find(name: str) -> Any:
        if name in homes:
            return getattr(importlib.import_module(f"{package}.{homes[name]}"), name)
        if former and name in former:
            return former[name].found(f"{package}.{name}")
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return find
