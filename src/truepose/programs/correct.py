"""A program with its targets corrected: what each target becomes, the patches, and the proof.

The error map speaks of the robot's base frame; the difference command − target is turned into each target's own frame
and added to its digits. Nothing else changes, which `truepose.programs.source.prove` requires on every run.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from truepose.errors import DataError, FileError, RefusedError
from truepose.programs import sidecar
from truepose.programs.configurations import changed_words
from truepose.programs.paths import bends
from truepose.programs.source import Patch, apply_patches, format_number, prove, unified_diff
from truepose.programs.targets import IDENTITY, FloatArray, FrameTable, Program, ReadOptions, Target, linked

if TYPE_CHECKING:
    from truepose.cell import Cell
    from truepose.robots import Robot

Policy = Literal["refuse", "skip", "clip"]
_DIALECTS: Final = {
    **dict.fromkeys((".src", ".dat"), "krl"),
    **dict.fromkeys((".mod", ".prg", ".sys", ".modx"), "rapid"),
    ".ls": "fanuc",
    ".script": "urscript",
    ".jbi": "inform",
    ".dtx": "val3",
    ".csv": "table",
    **dict.fromkeys((".apt", ".cls"), "apt"),
    **dict.fromkeys((".nc", ".ngc", ".gcode", ".tap", ".cnc"), "gcode"),
}
_REFUSED: Final = {
    ".urp": "is a program of Universal Robots' own editor (packed XML); save it as .script and correct that",
    ".tp": "is a compiled FANUC program; export it as .ls and correct that",
}
_SHOWN: Final = 3  # refused targets that a message names
_CORRECTED: Final = ("correct", "clip")


class CorrectionsLike(Protocol):
    """What a map answers: commands for targets, each with its verdict (see `truepose.compensation.Corrections`)."""

    @property
    def p_target(self) -> FloatArray: ...  # noqa: D102
    @property
    def p_command(self) -> FloatArray: ...  # noqa: D102
    @property
    def e(self) -> FloatArray: ...  # noqa: D102
    @property
    def std(self) -> FloatArray: ...  # noqa: D102
    @property
    def verdict(self) -> NDArray[np.str_]: ...  # noqa: D102
    @property
    def reason(self) -> Sequence[str]: ...  # noqa: D102


class Corrector(Protocol):
    """What corrects: poses (n, 4, 4), base to tool, in; commands out."""

    def correct(  # noqa: D102
        self,
        poses: FloatArray,
        *,
        tf_flange_tool: FloatArray,
        status: NDArray[np.int64],
        turn: NDArray[np.int64],
        on_guard: Policy,
    ) -> CorrectionsLike: ...


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What was done to a target.

    Attributes
    ----------
    target : Target
    verdict : {"correct", "clip", "skip"}
    reason : str
        Why not ``correct``; empty where it is.
    p_after : (3,) array [mm], the target's own frame
        As written; NaN where the target has no position.
    e, std : (3,) arrays [mm], base frame
        Predicted error at the command and its standard deviation; NaN where nothing was predicted.
    """

    target: Target
    verdict: str
    reason: str
    p_after: FloatArray
    e: FloatArray
    std: FloatArray

    @property
    def name(self) -> str:
        """Of the target."""
        return self.target.name

    @property
    def line(self) -> int:
        """Of the target."""
        return self.target.line

    @property
    def p_before(self) -> FloatArray:
        """Position in the target's own frame, (3,) [mm]."""
        return self.target.p

    @property
    def correction(self) -> FloatArray:
        """What was added, (3,) [mm], the target's own frame."""
        return self.p_after - self.p_before


@dataclass(frozen=True, eq=False)
class CorrectedProgram:
    """A corrected program, not yet written.

    Attributes
    ----------
    program : Program
        The original.
    files : dict of Path to bytes
        Every file of the program by its original path, changed or not.
    targets : tuple of Outcome
    on_guard : {"refuse", "skip", "clip"}
    resolution : float [mm]
    map_hash : str, optional
    warnings : tuple of str
        What a user should look at: straight paths that bend (see `truepose.programs.paths`).
    """

    program: Program
    files: dict[Path, bytes]
    targets: tuple[Outcome, ...]
    on_guard: Policy
    resolution: float
    map_hash: str | None
    warnings: tuple[str, ...] = ()

    def summary(self) -> dict[str, Any]:
        """Return how many targets were corrected, skipped, refused, and the largest correction and deviation [mm]."""
        done = [outcome for outcome in self.targets if outcome.verdict in _CORRECTED]
        return {
            "targets": len(self.targets),
            "corrected": len(done),
            "clipped": sum(outcome.verdict == "clip" for outcome in done),
            "skipped": sum(outcome.verdict == "skip" for outcome in self.targets),
            "refused": sum(outcome.verdict == "refuse" for outcome in self.targets),
            "largest_correction_mm": max((float(np.linalg.norm(outcome.correction)) for outcome in done), default=0.0),
            "largest_std_mm": max((float(np.linalg.norm(outcome.std)) for outcome in done), default=0.0),
        }

    def sidecar(self) -> dict[str, Any]:
        """Return the record of this correction for JSON; see `truepose.programs.sidecar`."""
        return sidecar.record(self)

    def to_csv(self) -> str:
        """Return the targets as CSV, units in the names."""
        return sidecar.to_csv(self)

    def diff(self) -> str:
        """Return what changes as a unified diff, decoded as latin-1."""
        sources = self.program.sources
        return "".join(unified_diff(source.path, source.data, self.files[source.path]) for source in sources)

    def write(self, out_dir: str | Path) -> list[Path]:
        """Write every file of the program and its record (JSON and CSV) to a folder; return their paths.

        Raises
        ------
        FileError
            If the folder is that of the program, or cannot be written; nothing new is left there then.
        """
        return sidecar.write(self, Path(out_dir))

    def write_in_place(self) -> list[Path]:
        """Write over the program; each file that changes is kept as it was beside it, with ``.original`` added.

        Raises
        ------
        FileError
            If such a copy is there already, or a file cannot be written; the program is as it was then.
        """
        return sidecar.write_in_place(self)


def read_program(path: str | Path, frames: FrameTable | None = None, options: ReadOptions | None = None) -> Program:
    r"""Read a robot program; its ending names the language.

    Parameters
    ----------
    path : str or Path
        KUKA: the .src, or the .dat beside it. Others: docs/programs.md.
    frames : FrameTable, optional
        The controller's tools and bases. Without it only number 0 is known.
    options : ReadOptions, optional

    Returns
    -------
    Program

    Raises
    ------
    FileError
        If the file is missing, broken, or of no known language; with its line.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "a.src"
    >>> _ = path.write_text("DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n")
    >>> read_program(path).positions_base()
    array([[1., 2., 3.]])
    """
    path = Path(path)
    if path.exists() and not path.is_file() and not path.is_dir():
        raise FileError(path, "is no file but a device or a pipe; name a program")
    if path.is_dir():
        raise FileError(path, "is a folder; name the program's files one by one")
    dialect = _DIALECTS.get(path.suffix.lower())
    if dialect is None:
        if not path.exists():
            raise FileError(path, "no such file")
        if why := _REFUSED.get(path.suffix.lower()):
            raise FileError(path, why)
        raise FileError(path, f"is no robot program of a known language; known endings: {', '.join(_DIALECTS)}")
    module = importlib.import_module(f"truepose.programs.{dialect}")
    program: Program = module.read(path, frames or FrameTable(), options or ReadOptions())
    return program


def correct_program(
    path: str | Path,
    error_map: Corrector,
    cell: Cell | None = None,
    *,
    frames: FrameTable | None = None,
    on_guard: Policy = "refuse",
    resolution: float = 1e-3,
    options: ReadOptions | None = None,
) -> CorrectedProgram:
    """Correct the targets of a program. Nothing is written; see `CorrectedProgram.write`.

    Parameters
    ----------
    path : str or Path
    error_map : Corrector
        Such as `truepose.ErrorMap`.
    cell : Cell, optional
        Whose tools and bases are used, unless `frames` are given.
    frames : FrameTable, optional
    on_guard : {"refuse", "skip", "clip"}
        What happens when a target is refused: no program at all (the default), or that target stays as it is. ``clip``
        also shortens corrections that are too long.
    resolution : float [mm]
        Step of a correction, where the number in the file is not finer.
    options : ReadOptions, optional

    Returns
    -------
    CorrectedProgram

    Raises
    ------
    FileError
        If a file is missing or broken.
    RefusedError
        If a target is refused under ``refuse``, nothing can be corrected, or the program was corrected already.
    """
    if on_guard not in ("refuse", "skip", "clip"):
        raise DataError(f'on_guard is {on_guard!r}, expected "refuse", "skip" or "clip"')
    if not 1e-6 <= resolution <= 1.0:
        raise DataError(f"resolution is {resolution!r} mm, expected 0.000001 to 1")
    if frames is None and cell is not None:
        frames = FrameTable.from_cell(cell)
    program = read_program(path, frames, options)
    sidecar.check_not_corrected(program)
    resolution = max(resolution, program.finest)
    if on_guard == "refuse":
        _refuse(program, {i: t.reason for i, t in enumerate(program.targets) if t.verdict == "refuse"})
    chosen = program.correctable()
    if not len(chosen) and any(not target.reason.startswith("joint target") for target in program.targets):
        reasons = {i: target.reason for i, target in enumerate(program.targets)}
        raise RefusedError(f"{program.path}: nothing can be corrected: {_listed(program, reasons)}")
    outcomes: dict[int, Outcome] = {}
    patches: dict[Path, list[Patch]] = {source.path: [] for source in program.sources}
    warnings: list[str] = []
    if len(chosen):
        warnings = _correct(program, chosen, error_map, on_guard, resolution, outcomes, patches)
    done = [outcomes.get(i) or _untouched(target) for i, target in enumerate(program.targets)]
    files = {}
    for source in program.sources:
        files[source.path] = apply_patches(source.data, patches[source.path])
        prove(source, files[source.path], patches[source.path], program.lexer)
    map_hash = getattr(error_map, "hash", None)
    return CorrectedProgram(program, files, tuple(done), on_guard, resolution, map_hash, tuple(warnings))


def _correct(
    program: Program,
    chosen: NDArray[np.intp],
    error_map: Corrector,
    on_guard: Policy,
    resolution: float,
    outcomes: dict[int, Outcome],
    patches: dict[Path, list[Patch]],
) -> list[str]:
    """Ask the map, and put what it says into outcomes and patches; return what a user should look at."""
    targets = [program.targets[i] for i in chosen]
    poses, tools = program.poses_base(), program.tools(getattr(error_map, "tf_flange_tool", IDENTITY))
    answer = error_map.correct(
        poses,
        tf_flange_tool=tools,
        status=np.array([-1 if t.status is None else t.status for t in targets]),
        turn=np.array([-1 if t.turn is None else t.turn for t in targets]),
        on_guard=on_guard,
    )
    verdict = [str(v) for v in answer.verdict]
    reason = list(answer.reason)
    robot: Robot | None = getattr(error_map, "robot", None)
    if robot is not None:
        for k, why in changed_words(robot, targets, poses, answer.p_command, tools).items():
            if verdict[k] in _CORRECTED:
                verdict[k], reason[k] = "refuse" if on_guard == "refuse" else "skip", why
    if on_guard == "refuse":
        _refuse(program, {int(i): reason[k] for k, i in enumerate(chosen) if verdict[k] == "refuse"})
    place = {int(i): k for k, i in enumerate(chosen)}
    left_out = [int(i) for k, i in enumerate(chosen) if verdict[k] not in _CORRECTED]
    for j, i in linked(program.circles, left_out).items():
        verdict[place[j]] = "skip"
        reason[place[j]] = f"its circle's other point {program.targets[i].name} is not corrected"
    tf_base_frame = np.array([t.tf_base_frame for t in targets])
    difference = answer.p_command - answer.p_target
    # R_frame_base = R_base_frameᵀ
    moved = np.einsum("nji,nj->ni", tf_base_frame[:, :3, :3], difference)
    data = {source.path: source.data for source in program.sources}
    for k, i in enumerate(chosen):
        target = targets[k]
        if verdict[k] not in _CORRECTED:
            outcomes[i] = Outcome(target, "skip", reason[k], target.p, answer.e[k], answer.std[k])
            continue
        if not np.isfinite(moved[k]).all():
            raise RefusedError(f"{target.where}: {target.name}: the map gave a correction that is not a number")
        after = _patch(data[target.path], target, moved[k], resolution, patches[target.path])
        outcomes[i] = Outcome(target, verdict[k], reason[k], after, answer.e[k], answer.std[k])
    added = np.where(np.isin(verdict, _CORRECTED)[:, None], difference, 0.0)
    return [
        f"{targets[k].where}: {targets[k].name} {what}" for k, what in bends(targets, answer.p_target, added).items()
    ]


def _patch(data: bytes, target: Target, moved: FloatArray, resolution: float, patches: list[Patch]) -> FloatArray:
    """Add the patches of one target; return its position as written."""
    after = target.p
    for axis, (start, end) in enumerate(target.spans[:3]):
        token = data[start:end]
        written = format_number(token, float(moved[axis]) / target.unit, resolution / target.unit)
        if written != token:
            patches.append(Patch(start, end, written))
            after[axis] = float(written) * target.unit
            if abs(after[axis] - target.p[axis] - moved[axis]) > resolution:
                raise RefusedError(f"{target.where}: {target.name}: {written!r} is not what the correction asks for")
    return after


def _untouched(target: Target) -> Outcome:
    nothing = np.full(3, np.nan)
    return Outcome(target, "skip", target.reason, target.p, nothing, nothing)


def _refuse(program: Program, reasons: dict[int, str]) -> None:
    if reasons:
        remedy = 'leave such targets as they are with on_guard "skip"'
        raise RefusedError(f"{_listed(program, reasons)}; {remedy}")


def _listed(program: Program, reasons: dict[int, str]) -> str:
    shown = [
        f"{program.targets[i].where}: {program.targets[i].name}: {why}" for i, why in list(reasons.items())[:_SHOWN]
    ]
    more = f" (and {len(reasons) - _SHOWN} more)" if len(reasons) > _SHOWN else ""
    return "; ".join(shown) + more
