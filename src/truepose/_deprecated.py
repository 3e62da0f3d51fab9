"""Former names: they work for one minor version, with a warning that says what to write (docs/stability.md)."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Any, NamedTuple, TypeVar

from truepose.errors import TrueposeDeprecationWarning

_F = TypeVar("_F", bound=Callable[..., Any])


class Former(NamedTuple):
    """What replaces a former name; a value of the tables that `truepose._lazy.lazy_names` and `present_options` take.

    Attributes
    ----------
    new : str
        What to write instead. For a name of a package, the full name, such as ``truepose.predictors.GridCell``; for an
        option of the command line, the option, where needed with its value, such as ``--accept=weak-map``.
    removed_in : str
        The version that no longer knows the former name.
    at : str
        For a name of a package: the full name of the object, if `new` is not one, as for a function that is a method
        now.
    """

    new: str
    removed_in: str
    at: str = ""

    def found(self, former: str) -> Any:
        """Return the object of a former name of a package, with a warning at the line that uses the package."""
        warn_former(former, self.new, removed_in=self.removed_in, stacklevel=4)
        module, _, name = (self.at or self.new).rpartition(".")
        return getattr(importlib.import_module(module), name)


def warn_former(former: str, new: str, *, removed_in: str, stacklevel: int = 3) -> None:
    """Warn of a former name.

    Parameters
    ----------
    former, new : str
        The former name as the user wrote it, and what to write instead.
    removed_in : str
        The version that no longer knows the former name.
    stacklevel : int
        The level of the line that the warning names, as of `warnings.warn`; 3 is the caller of the calling function.
    """
    warnings.warn(
        f"{former} is now {new}; version {removed_in} removes the former name",
        TrueposeDeprecationWarning,
        stacklevel=stacklevel,
    )


def former_arguments(*, removed_in: str, **names: str) -> Callable[[_F], _F]:
    """Return a decorator with which a function also takes former names of its keyword arguments, with a warning.

    Parameters
    ----------
    removed_in : str
        The version that no longer knows the former names.
    **names : str
        The present name of each former one.

    Examples
    --------
    >>> @former_arguments(removed_in="9.0.0", seed="rng")
    ... def draw(rng):
    ...     return rng
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     draw(seed=4)
    4
    >>> str(caught[0].message)
    'draw(seed=…) is now draw(rng=…); version 9.0.0 removes the former name'
    """

    def decorate(function: _F) -> _F:
        @wraps(function)
        def call(*args: Any, **given: Any) -> Any:
            for former in names.keys() & given.keys():
                new, what = names[former], function.__name__
                if new in given:
                    raise TypeError(f"{what}() got {former!r} and {new!r}, which mean the same; give {new!r} only")
                warn_former(f"{what}({former}=…)", f"{what}({new}=…)", removed_in=removed_in)
                given[new] = given.pop(former)
            return function(*args, **given)

        return call  # type: ignore[return-value]  # wraps keeps the function's signature

    return decorate


def present_options(args: Sequence[str], known: Sequence[str], former: Mapping[str, Former]) -> list[str]:
    """Return the arguments of a command with present options in place of former ones, with a warning for each.

    Parameters
    ----------
    args : sequence of str
        The arguments; those after ``--`` are no options.
    known : sequence of str
        The options of the command. A former option whose replacement is not among them stays, and is refused later.
    former : mapping of str to Former
        The former options.
    """
    end = args.index("--") if "--" in args else len(args)
    found = []
    for token in args[:end]:
        flag, equals, value = token.partition("=")
        one = former.get(flag)
        if one is not None and one.new.partition("=")[0] in known:
            warn_former(flag, one.new, removed_in=one.removed_in)
            token = one.new + equals + value
        found.append(token)
    return [*found, *args[end:]]
