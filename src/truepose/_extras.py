"""Packages that only some functions need: they belong to extras of the installation, and a missing one is one error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from truepose.errors import MissingPackageError


@contextmanager
def needed(what: str, extra: str, otherwise: str = "") -> Iterator[None]:
    """Import packages of an extra: a missing one becomes an error that says how to install it.

    Parameters
    ----------
    what : str
        The function that needs the packages, as the subject of the message.
    extra : str
        The name of the extra.
    otherwise : str
        What to do without the package.

    Raises
    ------
    MissingPackageError
        If a package that is imported within this context is not installed.

    Examples
    --------
    >>> with needed("it", "report"):
    ...     import nothing
    Traceback (most recent call last):
        ...
    truepose.errors.MissingPackageError: it needs the package nothing; install it with: pip install 'truepose[report]'
    """
    try:
        yield
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name in ("", "truepose"):
            raise
        remedy = f"install it with: pip install 'truepose[{extra}]'" + (f", or {otherwise}" if otherwise else "")
        raise MissingPackageError(f"{what} needs the package {name}; {remedy}") from None
