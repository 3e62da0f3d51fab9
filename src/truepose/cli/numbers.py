"""Numbers of the command line: ASCII digits and finite, unlike Python's own ``1_000``, ``٣`` and ``nan``."""

from __future__ import annotations

from typing import Any, get_args

import typer
from typer.core import TyperCommand

from truepose._io.strict import is_whole, to_float


class Command(TyperCommand):
    """A command whose options take plain numbers only."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Refuse options whose text Python takes for a number, and people do not; then as usual."""
        kinds = {flag: kind for one in self.params for flag in one.opts if (kind := _kind(one)) is not None}
        tokens = args[: args.index("--")] if "--" in args else args
        for token, following in zip(tokens, [*tokens[1:], ""], strict=False):
            flag, equals, value = token.partition("=")
            if flag in kinds:
                _check(flag, value if equals else following, kinds[flag])
        return super().parse_args(ctx, args)


def _kind(parameter: Any) -> type | None:
    """Return whether a parameter takes an int or a float, in any version of typer; else None."""
    descriptor = getattr(parameter, "type_descriptor", None)
    if descriptor is None:  # typer on click
        name = parameter.type.name.split(" ")[0]
        return {"integer": int, "float": float}.get(name)
    of = {descriptor.annotation, *get_args(descriptor.annotation)}
    return int if int in of else float if float in of else None


def _check(flag: str, text: str, kind: type) -> None:
    expected = "a whole number in digits 0 to 9" if kind is int else "a finite number such as 2.5"
    try:
        plain = is_whole(text.lstrip("+-")) if kind is int else abs(to_float(text)) < float("inf")
    except ValueError:
        plain = False
    if not plain:
        raise typer.BadParameter(f"{text!r} for {flag} is not {expected}")
