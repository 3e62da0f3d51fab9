"""Correct the targets of a program.

The error map predicts errors in the robot's base frame. The difference command − target is turned into each target's
own frame and added to its digits. `truepose.programs.proof` requires on every run that nothing else changes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose._io.units import parse_share
from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.compensation import LimitsInForce, Policy, Starts
from truepose.error_map.guards import stated_limits
from truepose.errors import DataError, RefusedError
from truepose.geometry import invert_transform
from truepose.programs.agreement import check_cell, check_identity, check_library, check_maker
from truepose.programs.core.alternatives import Alternatives, alternatives
from truepose.programs.core.approaches import starts_of
from truepose.programs.core.columns import TargetColumns
from truepose.programs.core.configurations import changed_words
from truepose.programs.core.digits import moved
from truepose.programs.core.held_parts import with_held_parts
from truepose.programs.core.joints import joints_along_paths
from truepose.programs.core.modules import RefusedModules
from truepose.programs.core.orientations import turned
from truepose.programs.core.outcomes import DONE, CorrectedShare, Outcomes, digit_step
from truepose.programs.core.paths import Paths
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.core.reasons import kind_of
from truepose.programs.core.segments import STEP, unsafe_segments
from truepose.programs.core.source import printable
from truepose.programs.core.target import Target, Verdict
from truepose.programs.corrected import CorrectedProgram
from truepose.programs.corrector import (
    ChecksArm,
    CorrectionContext,
    Corrector,
    HasHash,
    KnowsApproach,
    KnowsCell,
    KnowsFacts,
    KnowsPayload,
    KnowsWork,
    KnowsWorth,
    LimitsCorrections,
    TurnedTargets,
)
from truepose.programs.frame_table import FrameTable
from truepose.programs.joint_correction import JointCorrection
from truepose.programs.load_data import check_loads
from truepose.programs.payloads import loads_of, tools_without_payload
from truepose.programs.proof import proven_hashes
from truepose.programs.reading import read_program
from truepose.programs.record import check_not_corrected
from truepose.programs.stated_robots import stated_robot
from truepose.programs.unnamed_tools import unnamed_words, with_measured_tool

Progress = Callable[[int, int], Any]
_SHOWN: Final = 3  # reasons that a message names
_ROUNDED: Final = 1e-9  # [mm; deg] by doubles, beside the half digit


def correct_program(
    path: str | Path | Program,
    error_map: Corrector,
    cell: Cell | None = None,
    *,
    frames: FrameTable | None = None,
    on_guard: Policy | None = None,
    resolution: float = 1e-3,
    options: ReadOptions | None = None,
    orientation: bool = False,
    require: float | str | None = None,
    other_maker: bool = False,
    other_robot: str = "",
    this_robot: bool = False,
    accept_weak_map: bool = False,
    accept: Collection[str] = (),
    keep_going: bool = False,
    progress: Progress = lambda _done, _all: None,
    proven: bool = True,
) -> CorrectedProgram:
    r"""Correct the targets of a program. Nothing is written; see `CorrectedProgram.write`.

    Parameters
    ----------
    path : str or Path, or Program
        The path of a program, or a program from `read_program`.
    error_map : Corrector
        The error map, such as `truepose.ErrorMap`.
    cell : Cell, optional
        The cell with tools, bases, limits and policy; by default the map's own. A limit that it does not state is
        that of the map's own cell.
    frames : FrameTable, optional
        The tools and bases, instead of the cell's.
    on_guard : {"refuse", "skip", "clip"}, optional
        The policy for refused targets: ``refuse`` the program, ``skip`` such targets, or skip and ``clip`` corrections
        that are too long. By default the cell's ``on_guard``; without a cell ``refuse``.
    resolution : float [mm]
        The step of corrections, where the number in the file is not finer.
    options : ReadOptions, optional
        The options of reading. A program from `read_program` keeps its own.
    orientation : bool
        Whether to correct orientations, too. Without it their digits never change.
    require : float or str, optional
        The share of the motion targets that must be corrected, such as 0.95 or "95%". By default that of the cell's
        ``[correction]``, or of the map's own cell.
    other_maker : bool
        Whether to accept a program of another maker than that of the map's robot.
    other_robot : str
        The reason why the map of another robot of the same type is used, which the record keeps; by default a cell
        whose ``[robot] id`` is another one is refused.
    this_robot : bool
        Whether a map that names no robot is that of the robot that the cell names; kept when the result is written, so
        that it is stated once.
    accept_weak_map : bool
        Whether to use a map that is not shown to be better than no map; see `truepose.ErrorMap.correct`.
    accept : collection of str
        The codes of facts of the map that refuse corrections and are accepted; see `truepose.ErrorMap.facts`.
    keep_going : bool
        Whether to refuse only the modules with refused targets, if the program is a project (KRL) or a task (RAPID) of
        several modules. Their targets stay nominal, and `CorrectedProgram.refused` names their files.
    progress : callable
        A function that is called with the number of targets that are done, and the number of all.
    proven : bool
        Whether to check that the program was not corrected before, and to prove the result. A result that is not proven
        cannot be written; see `truepose.programs.parallel`.

    Returns
    -------
    CorrectedProgram
        The corrected program, proven.

    Raises
    ------
    FileError
        If a file is missing or broken.
    DataError
        If a setting can have no effect: frames or options for a program that was read already, or a limit that does not
        apply to the map.
    RefusedError
        If a target or a path is refused under ``refuse``, nothing can be corrected, fewer targets than `require` are
        corrected, the program was corrected already, the map is weak, or it is of another robot than the program or the
        cell.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from types import SimpleNamespace
    >>> class Shift:
    ...     def correct(self, poses, **_):  # every error is 0.5 mm along x
    ...         p, n = poses[:, :3, 3], len(poses)
    ...         e = np.tile([0.5, 0.0, 0.0], (n, 1))
    ...         return SimpleNamespace(
    ...             p_target=p, p_command=p - e, e=e, std=np.full((n, 3), 0.05),
    ...             verdict=np.full(n, "correct"), reason=[""] * n)
    >>> path = Path(tempfile.mkdtemp()) / "a.src"
    >>> _ = path.write_text("DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\nEND\n")
    >>> print(correct_program(path, Shift()).diff().splitlines()[-2])
    +LIN {X 0.5,Y 2,Z 3,A 0,B 0,C 0}
    """
    if on_guard not in (None, "refuse", "skip", "clip"):
        raise DataError(f'on_guard is {on_guard!r}, expected "refuse", "skip" or "clip"')
    if not 1e-6 <= resolution <= 1.0:
        raise DataError(f"resolution is {resolution!r} mm, expected 0.000001 to 1")
    asked_share = None if require is None else parse_share(require)
    limits = _limits_in_force(error_map, cell, on_guard=on_guard, require=asked_share)
    on_guard = limits.on_guard
    known = CorrectionContext.of(error_map)
    program = _read(path, cell or known.cell, frames, options, orientation)
    program = with_held_parts(program, known.robot)
    warnings = _check_robot(error_map, program, cell, other_maker, (other_robot, this_robot))
    if proven:
        warnings = [*check_not_corrected(program, known.path), *warnings]
    resolution = max(resolution, program.finest)
    own = _reasons(program, "refuse") if on_guard == "refuse" else {}
    several = keep_going and len({source.path.with_suffix("") for source in program.sources}) > 1
    if not several:
        _refuse(program, own)
    counts = program.counts()
    if not counts["correct"] and not all(why.startswith("joint target") for why in _reasons(program).values()):
        raise RefusedError(f"{program.path}: nothing can be corrected: {_listed(program, _reasons(program))}")
    outcomes = Outcomes.none(program, program.width if orientation else 3)
    change = outcomes.after[:, : 6 if orientation else 3]  # until the digits take their place
    near: FloatArray | None = None
    more: dict[str, Any] = {}
    if isinstance(error_map, LimitsCorrections):
        more = {"limits": limits, "accept_weak_map": accept_weak_map, "accept": accept}
        if known.robot is not None:
            near = joints_along_paths(known.robot, program.targets, known.tf_flange_tool)
    reversing = isinstance(error_map, KnowsApproach) and error_map.depends_on_approach
    starts: Starts | None = None
    if reversing and known.robot is not None:
        starts = starts_of(program, known.robot, known.tf_flange_tool)
        warnings += _from_any_side(error_map, int((~starts.known).sum()))
    asked_map = error_map.at_work(cell) if cell and isinstance(error_map, KnowsWork) else error_map
    if cell and asked_map is not error_map:
        words = cell.conditions.words or f"payload_kg {cell.payload.mass_kg:g}"
        warnings.append(f"corrected for the conditions at work that the cell states: {words}")
    if isinstance(asked_map, KnowsCell) and isinstance(asked_map, KnowsPayload):
        warnings += check_loads(program, cell or asked_map.cell, asked_map.payload_at_work)
    warnings += tools_without_payload(program, asked_map)
    warnings += _on_held_parts(program)
    warnings += unnamed_words(with_measured_tool(program), known.tf_flange_tool)
    done = 0
    for rows, columns in program.correctable_columns():
        if near is not None:
            more["near"] = near[rows]
        if starts is not None:
            more["before"] = starts.take(rows)
        asked = _ask(asked_map, columns, on_guard, orientation, more)
        for k, shared in _shared(asked_map, program, columns, asked, limits, orientation, more).items():
            i = int(rows[k])
            outcomes.differences[i] = shared.difference
            if not shared.refused:
                outcomes.notes[i] = shared.note
            else:
                asked[0][k], asked[3][k], asked[4][k] = 0.0, _left(on_guard), shared.refused
        change[rows] = asked[0]
        _note(outcomes, rows, asked)
        done += len(rows)
        progress(done, counts["correct"])
    joints = JointCorrection(outcomes, known, "refuse" if on_guard == "refuse" else "skip")
    for posed in joints.posed():
        if starts is not None:
            more["before"] = starts.take(posed.rows)
        asked = _ask(asked_map, posed.poses, on_guard, orientation, {**more, "near": posed.q} if more else more)
        asked[4].update(joints.settle(posed, asked[0], asked[3], resolution))
        _note(outcomes, posed.rows, asked)
        done += len(posed.rows)
        progress(done, counts["correct"])
    refused = {i: reason for i, reason in outcomes.why.items() if DONE[outcomes.code[i]] == "refuse"}
    refused = refused | own if on_guard == "refuse" else {}
    modules = RefusedModules(outcomes) if several else None
    if modules is None:
        _refuse(program, refused)
    else:
        modules.leave(refused)
    outcomes.leave_circles()
    paths = Paths(program, outcomes, limits.values.get("max_bend_mm"))
    if known.robot is not None:
        pairs = paths.segments(outcomes, STEP)
        unsafe = unsafe_segments(known.robot, outcomes, pairs, near, known.tf_flange_tool)
        _leave_unsafe(outcomes, unsafe, on_guard, modules)
    continuity = paths.settle(outcomes, on_guard, modules)
    refused_files = {} if modules is None else modules.files
    if modules is not None and modules.all:
        raise RefusedError("; ".join(list(modules.reasons.values())[:_SHOWN]))
    limits = limits.with_found({"max_bend_mm": (paths.limit, paths.origin)})
    CorrectedShare.of([outcomes]).check(limits.values["require"], program.path)
    warnings += _weakness(error_map)
    outcomes.tell_followers()
    _write_digits(program, outcomes, change.shape[1], resolution)
    joints.finish()
    hashes = proven_hashes(outcomes, resolution) if proven else {}
    return CorrectedProgram(
        program,
        outcomes,
        on_guard,
        resolution,
        _hash(error_map),
        hashes,
        limits,
        continuity,
        tuple(warnings),
        known.path,
        refused_files,
        robot=_robot(known.cell, cell, other_robot, this_robot),
        facts=tuple(error_map.facts) if isinstance(error_map, KnowsFacts) else (),
    )


def _hash(error_map: Corrector) -> str | None:
    return error_map.hash if isinstance(error_map, HasHash) else None


def _robot(own: Cell | None, cell: Cell | None, reason: str, this_robot: bool) -> dict[str, str]:
    """Return what the record says of the robot; see `CorrectedProgram.robot`."""
    mine, theirs = (one and one.robot_id for one in (own, cell))
    stated = theirs if this_robot and mine is None else None
    ids = {"map": mine, "cell": theirs, "other_robot": reason, "stated": stated}
    return {name: text for name, text in ids.items() if text}


def _leave_unsafe(outcomes: Outcomes, unsafe: dict[int, str], on_guard: Policy, modules: RefusedModules | None) -> None:
    """Refuse the targets of unsafe segments, or leave them nominal."""
    if on_guard == "refuse" and modules is None:
        _refuse(outcomes.program, unsafe)
    elif on_guard == "refuse" and modules is not None:
        modules.leave(unsafe)
    for i, why in unsafe.items():
        outcomes.leave(np.array([i]), why)
    outcomes.leave_circles()


def _from_any_side(error_map: Corrector, n: int) -> list[str]:
    """Return the warning of n targets of which the side is not known, by a map of samples from one side."""
    facts = error_map.facts if n and isinstance(error_map, KnowsFacts) else []
    if not any(fact.code == "one-sided" for fact in facts):
        return []
    where = "half of the variance of the lost motion that the samples did not measure is in their standard deviation"
    return [f"{n} targets: it is not known from which side their joints come; {where}"]


def _on_held_parts(program: Program) -> list[str]:
    """Return the line that tells how many targets are corrected at a tool that stands."""
    n = sum(int(columns.held.sum()) for _, columns in program.correctable_columns())
    where = "the robot holds the part to a tool that stands, and the error of the part at the tool is corrected"
    return [f"{n} {'target' if n == 1 else 'targets'}: {where}"] if n else []


def _limits_in_force(error_map: Corrector, cell: Cell | None, **options: Any) -> LimitsInForce:
    """Return the limits in force; for a corrector without limits of its own, those of the cells."""
    if isinstance(error_map, LimitsCorrections):
        return error_map.limits_in_force(cell, **options)
    return stated_limits(CorrectionContext.of(error_map).cell, cell, options)


def _check_robot(
    error_map: Corrector,
    program: Program,
    cell: Cell | None,
    other_maker: bool,
    whose: tuple[str, bool],
) -> list[str]:
    """Refuse a program or a cell of another robot than the map's; return the warnings."""
    known = CorrectionContext.of(error_map)
    if known.robot is None:
        return []
    facts = error_map.facts if isinstance(error_map, KnowsFacts) else []
    placed = any(fact.effect == "transforms" for fact in facts)
    warnings = [fact.sentence for fact in facts if fact.effect in ("transforms", "widens")]
    names = {"weak": "a weak map was accepted"}
    warnings += [f"{names.get(fact.code, 'accepted')}: {fact.words}" for fact in facts if fact.effect == "refuses"]
    if known.cell is not None:
        warnings += check_library(known.cell, known.robot, placed=placed)
        if cell is not None:
            stated = stated_robot(_hash(error_map), known.path)
            warnings += check_identity(known.cell, cell, whose[0], stated=stated, this_robot=whose[1])
            warnings += check_cell(known.cell, known.robot, cell, placed=placed)
    warnings += check_maker(known.robot, program, other_maker=other_maker)
    if isinstance(error_map, ChecksArm) and not error_map.arm_check.checked:
        warnings.append(error_map.arm_check.words)
    return warnings


def _read(
    path: str | Path | Program,
    cell: Cell | None,
    frames: FrameTable | None,
    options: ReadOptions | None,
    orientation: bool,
) -> Program:
    """Return the program, read unless it was read already."""
    if not isinstance(path, Program):
        if frames is None and cell is not None:
            frames = FrameTable.from_cell(cell)
        return read_program(path, frames, replace(options or ReadOptions(), orientation=orientation))
    if frames is not None or options is not None:
        raise DataError(f"{path.path}: was read already: frames and options have no effect; pass them to read_program")
    if orientation and path.options is not None and not path.options.orientation:
        raise DataError(f"{path.path}: was read for positions; read it with ReadOptions(orientation=True)")
    return path


_Asked = tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int8], dict[int, str]]


def _weakness(error_map: Corrector) -> list[str]:
    """Return the warning of a weak map that is used."""
    if isinstance(error_map, KnowsWorth) and not isinstance(error_map, KnowsFacts) and error_map.worth.weak:
        return [f"a weak map was accepted: {error_map.worth.words}"]
    return []


def _left(on_guard: Policy) -> int:
    """Return the code of a target that a guard refuses."""
    return DONE.index("refuse" if on_guard == "refuse" else "skip")


class _Shared(NamedTuple):
    """The largest difference [mm] of a correction that several positions share, a note, and why it is refused."""

    difference: float
    note: str
    refused: str


def _shared(
    error_map: Corrector,
    program: Program,
    columns: TargetColumns,
    asked: _Asked,
    limits: LimitsInForce,
    orientation: bool,
    more: Mapping[str, Any],
) -> dict[int, _Shared]:
    """Compare corrections with those at all other positions that share them; return the results by row.

    The other positions are derived ones, and those within the tolerance of a frame; see
    `truepose.programs.core.alternatives`.
    """
    options = program.options or ReadOptions()
    within = options.frame_tolerance, options.tool_tolerance
    most_mm, most_mrad = (limits.values[f"max_difference_{unit}"] for unit in ("mm", "mrad"))
    if "limits" in more:  # a correction that is too small to be applied counts with its size
        more = {**more, "limits": replace(limits, values={**limits.values, "min_correction_stds": 0.0})}
    found: dict[int, _Shared] = {}
    for others in alternatives(columns, np.flatnonzero(np.isin(asked[3], (1, 2))), *within):
        near = {"near": more["near"][others.owner]} if "near" in more else {}
        at = columns.take(others.owner)
        if "before" in more:  # derived positions are reached in the same way, from where the line is moved to as well
            moved = others.poses @ invert_transform(at.poses_base())
            start = more["before"].take(others.owner)
            near["before"] = start._replace(poses=moved @ start.poses)
        change, _, _, code, reasons = _ask(error_map, at, limits.on_guard, orientation, {**more, **near}, others)
        differs = change - others.corrections(asked[0])
        size = np.linalg.norm(differs[:, :3], axis=1)
        turned = 1e3 * np.linalg.norm(differs[:, 3:], axis=1)
        excess = np.maximum(size / most_mm, turned / most_mrad)
        excess[~np.isin(code, (1, 2))] = np.inf  # a guard refuses there
        for k in np.unique(others.owner).tolist():
            mine = np.flatnonzero(others.owner == k)
            i, why = int(mine[np.argmax(excess[mine])]), ""
            if np.isinf(excess[i]):
                why = f"{others.words[i]}: {reasons.get(i, 'the map gives no correction')}"
            elif excess[i] > 1.0:
                why = f"{others.words[i]}, the correction differs by {size[i]:.3f} mm"
                why += f" and {turned[i]:.3f} mrad" if orientation else ""
                why += f", limit {most_mm:g} mm" + (f" and {most_mrad:g} mrad" if orientation else "")
            largest = float(size[mine].max())
            found[k] = _Shared(largest, _assumes(columns.target(k), largest), why)
    return found


def _assumes(target: Target, difference: float) -> str:
    """Return what the correction of a target assumes."""
    texts = []
    if target.derived:
        n, first = sum(len(one.shifts) for one in target.derived), target.derived[0].how
        others = f" and {n - 1} more" if n > 1 else ""
        texts.append(f"shared with the position derived from it, {first}{others}")
    if target.tool_changed:
        texts.append(f"corrected with the stored tool: {target.tool_changed}")
    if target.frame_changed:
        texts.append(f"corrected in the stored frame: {target.frame_changed}")
    return f"{'; '.join(texts)}; corrections differ by up to {difference:.3f} mm"


def _ask(
    error_map: Corrector,
    columns: TargetColumns,
    on_guard: Policy,
    orientation: bool,
    more: Mapping[str, Any],
    others: Alternatives | None = None,
) -> _Asked:
    """Ask the map about targets; return changes in their frames (n, 3 or 6), e, std, codes, and reasons by row.

    With `others`, it is asked about these instead, one for each of the columns.
    """
    known = CorrectionContext.of(error_map)
    poses, turns = columns.poses_base(), columns.base_to_frame()
    if others is not None:
        poses, turns = others.poses, np.swapaxes(others.tf_base_frame[:, :3, :3], 1, 2)
    tools = columns.tf_flange_tool(known.tf_flange_tool)
    if others is not None:
        tools = tools @ others.tool
    answer = error_map.correct(
        poses,
        tf_flange_tool=tools,
        status=columns.status,
        turn=np.where(columns.on_paths, -1, columns.turn),  # controllers ignore Turn along paths
        on_guard=on_guard,
        orientation=orientation,
        **loads_of(columns, error_map),
        **more,
    )
    code = np.array([DONE.index(verdict) for verdict in np.asarray(answer.verdict).tolist()], np.int8)
    reasons = {k: reason for k, reason in enumerate(answer.reason) if reason}
    after = poses.copy()
    after[:, :3, 3] = answer.p_command
    change = answer.p_command - answer.p_target
    if orientation:
        if not isinstance(answer, TurnedTargets) or answer.rotation is None:
            raise DataError("the map gives no orientations; correct positions alone")
        after[:, :3, :3] = Rotation.from_rotvec(answer.rotation).as_matrix() @ poses[:, :3, :3]
        change = np.concatenate([change, answer.rotation], axis=1)
    wrong = np.isin(code, (1, 2)) & ~np.isfinite(change).all(axis=1)
    if wrong.any():
        target = columns.target(int(np.argmax(wrong)))
        raise RefusedError(f"{target.where}: {target.name}: the map gave a correction that is not a number")
    if known.robot is not None:
        for k, why in changed_words(known.robot, columns, poses, after, tools).items():
            if code[k] in (1, 2):
                code[k], reasons[k] = _left(on_guard), why
    change = np.einsum("nij,nkj->nki", turns, change.reshape(len(change), -1, 3))
    change = np.where(np.isin(code, (1, 2))[:, None, None], change, 0.0).reshape(len(change), -1)
    return change, answer.e, answer.std, code, reasons


def _note(outcomes: Outcomes, rows: IntArray, asked: _Asked) -> None:
    """Note what the map answered about targets."""
    _, outcomes.e[rows], outcomes.std[rows], outcomes.code[rows], why = asked
    outcomes.why.update({int(rows[k]): reason for k, reason in why.items()})


def _write_digits(program: Program, outcomes: Outcomes, size: int, resolution: float) -> None:
    """Replace the changes in `after` (the first 3 or 6 columns) by the numbers that are written."""
    corrected = outcomes.corrected
    for rows, columns in program.correctable_columns():
        change = outcomes.after[rows, :size]
        outcomes.after[rows] = np.nan
        here = np.flatnonzero(corrected[rows])
        if len(here):
            outcomes.after[rows[here]] = _digits(program, columns.take(here), change[here], resolution)


def _digits(program: Program, columns: TargetColumns, change: FloatArray, resolution: float) -> FloatArray:
    """Return the written numbers of targets after a change, (n, 3 or 3 + k)."""
    data = next(source.data for source in program.sources if source.path == columns.path)
    before, wanted = columns.values[:, :3], columns.values[:, :3] + change[:, :3]
    if change.shape[1] > 3:
        before = columns.values
        angles = turned(columns.controller, columns.values[:, 3:], Rotation.from_rotvec(change[:, 3:]))
        wanted = np.concatenate([wanted, angles], axis=1)
    after = before.copy()
    for axis in range(before.shape[1]):
        unit, step = digit_step(columns, axis, resolution)
        old = before[:, axis] / unit
        new = moved(data, columns.spans[:, axis], old, (wanted - before)[:, axis] / unit, step)
        after[:, axis] = np.where(new == old, before[:, axis], new * unit)
        missed = np.abs(after[:, axis] - wanted[:, axis]) > 0.5 * step * unit + _ROUNDED
        if missed.any():
            target = columns.target(int(np.argmax(missed)))
            raise RefusedError(f"{target.where}: {target.name}: its digits cannot hold the correction")
    return after


def _reasons(program: Program, verdict: Verdict | None = None) -> dict[int, str]:
    """Return the reasons of the program's own verdicts, by index."""
    found = {}
    for first, columns in program.targets.chunks():
        kinds, which = columns.shared()
        wanted = np.array([t.verdict != "correct" and verdict in (None, t.verdict) for t in kinds])
        found.update({first + i: kinds[which[i]].reason for i in np.flatnonzero(wanted[which]).tolist()})
    return found


def _refuse(program: Program, reasons: dict[int, str]) -> None:
    if reasons:
        remedy = 'leave such targets as they are with on_guard "skip"'
        raise RefusedError(f"{_listed(program, reasons)}; {remedy}")


def _listed(program: Program, reasons: dict[int, str]) -> str:
    """Return the first reasons, each once with its first target and the number of the others."""
    groups: dict[str, list[int]] = {}
    for i, reason in reasons.items():
        groups.setdefault(kind_of(reason), []).append(i)
    shown = []
    for rows in list(groups.values())[:_SHOWN]:
        target, alike = program.targets[rows[0]], f" ({len(rows) - 1} more alike)" if len(rows) > 1 else ""
        shown.append(f"{target.where}: {target.name}: {reasons[rows[0]]}{alike}")
    more = f" (and {len(groups) - _SHOWN} more reasons)" if len(groups) > _SHOWN else ""
    return printable("; ".join(shown)) + more
