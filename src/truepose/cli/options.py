"""Options and arguments that several commands share, each defined once, and the checks of their values."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, get_args, get_type_hints

import typer
from typer.core import TyperCommand

from truepose._deprecated import Former, present_options
from truepose._io.strict import is_whole, to_float
from truepose.errors import DataError

if TYPE_CHECKING:
    from truepose.numerics.executor import Executor

CellPath = Annotated[Path, typer.Argument(metavar="CELL", help="The cell file.")]
SamplesPath = Annotated[Path, typer.Argument(metavar="SAMPLES", help="The table of samples (CSV).")]
MapPath = Annotated[Path, typer.Argument(metavar="MAP", help="An error map written by 'truepose fit'.")]
AcceptCampaign = Annotated[
    bool,
    typer.Option("--accept-campaign", help="Accept a campaign with a moved tracker, a scale error or a drift."),
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing results. Inputs are never overwritten.")]
Json = Annotated[bool, typer.Option("--json", help="Write JSON to stdout and nothing else.")]


_PREDICTORS = (
    "registration, nearest, idw, radial-basis, grid-cell, ordinary-kriging, ordinary-kriging-joint, universal-kriging, "
    "vector-kriging, local-kriging, local-kriging-joint, vecchia-kriging, calibration, calibration-network, "
    "kinematic-kriging"  # as text: help imports no predictor
)
PredictorName = Annotated[
    str,
    typer.Option("--predictor", help=f"auto, or one of {_PREDICTORS}; with options, as in calibration:method=ekf."),
]
Candidates = Annotated[
    str,
    typer.Option(
        "--candidates",
        help="Candidates of auto: all, names separated by commas, or quick (registration, idw, ordinary-kriging, "
        "universal-kriging, ordinary-kriging-joint, calibration, kinematic-kriging).",
    ),
]


@dataclass(frozen=True, kw_only=True)
class Execution:
    """The options of where long work runs; see `with_groups`."""

    workers: Annotated[
        int, typer.Option("--workers", help="Number of processes of this machine; 0: as many as pay.", min=0)
    ] = 0
    cluster: Annotated[
        str,
        typer.Option(
            "--cluster", envvar="TRUEPOSE_CLUSTER", help="Scheduler of a cluster, such as tls://10.0.0.5:8786."
        ),
    ] = ""
    cluster_ca: Annotated[
        Path | None, typer.Option("--cluster-ca", help="tls://: certificate authority; default: Dask's configuration.")
    ] = None
    cluster_cert: Annotated[Path | None, typer.Option("--cluster-cert", help="tls://: own certificate.")] = None
    cluster_key: Annotated[Path | None, typer.Option("--cluster-key", help="tls://: key of the certificate.")] = None
    cluster_folder: Annotated[
        Path | None,
        typer.Option(
            "--cluster-folder",
            envvar="TRUEPOSE_CLUSTER_FOLDER",
            help="Folder that all workers see at the same path, for inputs and results; default: the network.",
        ),
    ] = None

    @property
    def asked(self) -> bool:
        """Whether the number of processes or a cluster is given."""
        return bool(self.workers or self.cluster)

    def executor(self, purpose: str, *, pays: bool = True) -> Executor:
        """Return the executor, to be used as a context manager; `pays`: whether processes do if no number is given."""
        from truepose.jobs.executor import Security, make_executor

        files = [one for one in (self.cluster_ca, self.cluster_cert, self.cluster_key) if one is not None]
        if len(files) not in (0, 3):
            raise DataError("--cluster-ca, --cluster-cert and --cluster-key belong together; give all three or none")
        security = Security(*files) if files else None
        folder = self.cluster_folder if self.cluster else None
        return make_executor(
            purpose, workers=self.workers, cluster=self.cluster, security=security, folder=folder, pays=pays
        )


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each parameter of a command whose default is a dataclass by one option per field of it."""
    kind, hints = Parameter.KEYWORD_ONLY, get_type_hints(command, include_extras=True)
    groups: dict[str, tuple[type[Any], list[str]]] = {}
    shown: list[Parameter] = []
    for name, parameter in signature(command).parameters.items():
        if not is_dataclass(group := parameter.default):
            shown.append(parameter.replace(kind=kind, annotation=hints[name]))
            continue
        options = get_type_hints(type(group), include_extras=True)
        groups[name] = (type(group), [field.name for field in fields(group)])
        shown += [Parameter(f.name, kind, default=f.default, annotation=options[f.name]) for f in fields(group)]

    @wraps(command)
    def run(**values: Any) -> None:
        made = {name: of(**{option: values.pop(option) for option in names}) for name, (of, names) in groups.items()}
        command(**made, **values)

    run.__annotations__ = {parameter.name: parameter.annotation for parameter in shown}
    run.__signature__ = Signature(shown)  # type: ignore[attr-defined]  # typer reads the options from it
    return run


def check_pairs(*pairs: tuple[str, Any, str, Any]) -> None:
    """Refuse an option that is given without the option that it depends on: (option, value, other option, value)."""
    for option, value, needed, other in pairs:
        if value is not None and other is None:
            raise DataError(f"{option} has no effect without {needed}; give both")


def parse_numbers(text: str, option: str) -> list[float]:
    """Return the numbers of an option, separated by blanks or commas.

    Raises
    ------
    DataError
        If there is none, or a word is not a finite number.
    """
    words = text.replace(",", " ").split() or [text]
    try:
        numbers = [to_float(word) for word in words]
    except ValueError as error:
        raise DataError(f"{option}: {error}; write numbers separated by blanks or commas") from None
    if not all(map(math.isfinite, numbers)):
        raise DataError(f"{option}: expected finite numbers, got {text!r}")
    return numbers


FORMER_OPTIONS: Final[dict[str, Former]] = {}
"""The options that had another name in the last minor version; none at present."""


class Command(TyperCommand):
    """A command that knows former options, and whose numeric options take plain numbers only.

    Plain numbers are those without Python's ``1_000``, ``٣`` and ``nan``.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments after a replacement of former options and a check of the numbers."""
        args = present_options(args, [flag for one in self.params for flag in one.opts], FORMER_OPTIONS)
        kinds = {flag: kind for one in self.params for flag in one.opts if (kind := _kind(one)) is not None}
        tokens = args[: args.index("--")] if "--" in args else args
        for token, following in zip(tokens, [*tokens[1:], ""], strict=False):
            flag, equals, value = token.partition("=")
            if flag in kinds:
                _check(flag, value if equals else following, kinds[flag])
        return super().parse_args(ctx, args)


def _kind(parameter: Any) -> type | None:
    """Return int or float for a numeric parameter, in any version of typer; else None."""
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
