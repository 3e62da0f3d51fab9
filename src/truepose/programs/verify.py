"""Verify a program: compare re-measured targets with nominal ones, and decide by a tolerance."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map import ErrorMap
from truepose.errors import DataError, RefusedError
from truepose.geometry.transforms import invert_transform
from truepose.programs.core.held_parts import with_held_parts
from truepose.programs.core.program import Program, ReadOptions
from truepose.programs.frame_table import FrameTable
from truepose.programs.nominal import NominalTargets, nominal_targets
from truepose.programs.other_run import other_run
from truepose.programs.reading import read_program
from truepose.programs.record import CHANGED
from truepose.programs.remeasured import MatchBy, Remeasured, remeasured
from truepose.programs.verified import OtherRun, ProgramVerification, VerifiedTarget
from truepose.programs.verified_uncertainty import uncertainty
from truepose.trackers import Columns, Readings, read_readings
from truepose.verification.conformity import conformity

_SAME: Final = 1e-6  # [mm; 1] of poses
_OTHER_POINT_MM: Final = 0.01


def verify_program(
    error_map: ErrorMap,
    program: str | Path | Program,
    readings: str | Path | Readings,
    *,
    cell: Cell | None = None,
    tolerance_mm: float | None = None,
    before: str | Path | Readings | None = None,
    register: bool = False,
    match: MatchBy = "auto",
    uncertainty_mm: float | None = None,
    frames: FrameTable | None = None,
    options: ReadOptions | None = None,
    columns: Columns | None = None,
) -> ProgramVerification:
    r"""Compare re-measured targets of a program with its nominal targets, and decide by a tolerance.

    Parameters
    ----------
    error_map : ErrorMap
        The map that corrected the program: it gives the station of the tracker and the measured point.
    program : str or Path, or Program
        The corrected program, with the record that ``correct`` wrote beside it, or the original program.
    readings : str or Path, or Readings
        The readings of the targets, in any layout that `truepose.read_readings` knows.
    cell : Cell, optional
        The cell with frames, tolerance and noise of the tracker; by default the map's own.
    tolerance_mm : float [mm], optional
        The tolerance of an error's length; by default ``tolerance_mm`` of the cell's ``[report]`` or ``[correction]``.
    before : str or Path, or Readings, optional
        Readings of the original program. Without them, the errors before are those that the map predicted.
    register : bool
        Whether to register the readings again to the nominal targets, for a tracker that was moved. A common shift or
        turn of all targets is not seen then.
    match : {"auto", "name", "position"}
        The way to match readings with targets: by name where names of readings are names of targets, else by position.
    uncertainty_mm : float [mm], optional
        The standard uncertainty of a reading; by default that of the file, of the cell's ``[tracker]``, or of repeats.
    frames : FrameTable, optional
        The tools and bases, instead of the cell's.
    options : ReadOptions, optional
        The options of reading the program, as in its correction.
    columns : Columns, optional
        The columns of readings of unknown layout.

    Returns
    -------
    ProgramVerification
        The errors and decisions, by the rule of ISO 14253-1.

    Raises
    ------
    FileError
        If a file cannot be read, or the program was changed after the correction.
    DataError
        If there is no tolerance, the uncertainty of the readings is not known, or readings fit no target.
    RefusedError
        If the record of a corrected program is missing, or no target can be verified.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from truepose import VirtualCell, fit_cell
    >>> virtual = VirtualCell("paper")
    >>> error_map = fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "registration")
    >>> path = Path(tempfile.mkdtemp()) / "targets.csv"
    >>> _ = path.write_text("x_mm,y_mm,z_mm,a_deg,b_deg,c_deg\n1500,0,900,0,90,0\n")
    >>> at = error_map.registration.tf_tracker_base @ [1500.1, 0.0, 900.0, 1.0]
    >>> reading = Readings(at[None, :3], np.array([1]), "readings.txt")
    >>> found = verify_program(error_map, path, reading, tolerance_mm=0.2, uncertainty_mm=0.01)
    >>> found.targets[0].decision, round(found.targets[0].error_mm, 3)
    ('pass', 0.1)
    """
    cell = cell or error_map.cell
    tolerance, origin = _tolerance(tolerance_mm, cell)
    if not isinstance(program, Program):
        program = read_program(program, frames or FrameTable.from_cell(cell), options)
    program, tool = with_held_parts(program, error_map.robot), error_map.tf_flange_tool
    nominal = nominal_targets(program, error_map.path, tool)
    if not len(nominal):
        raise RefusedError(f"{program.path}: no target has a known position and frame; {_remedy(program)}")
    task = _Task(error_map, cell, nominal, register, match, uncertainty_mm)
    measured = task.measure(_read(readings, columns))
    earlier, kind = nominal.predicted, "predicted"
    if before is not None:
        first = task.measure(_read(before, columns))
        earlier, kind = np.full((len(nominal), 3), np.nan), "measured"
        earlier[first.target] = first.p_base - task.p[first.target]
    elif nominal.record is None:
        kind = ""
    run: OtherRun = "" if register else other_run(nominal, measured, task.p, error_map)
    return _result(task, program, measured, _Statement(tolerance, origin, kind, earlier, _source(readings), run))


def _remedy(program: Program) -> str:
    """Return how a program whose frames are not known can be verified."""
    if program.path.is_dir() and (program.path / CHANGED).is_file():
        return "these are the changed files of a backup: copy them with the records over it, or correct with --whole"
    return "give --cell or --config-dat, or name the folder of its backup"


@dataclass(frozen=True, eq=False)
class _Statement:
    """The figures that a verification compares with."""

    tolerance: float
    origin: str
    before: str
    earlier: FloatArray
    source: str
    run: OtherRun


@dataclass(frozen=True, eq=False)
class _Task:
    """The nominal targets, and how readings are matched with them."""

    error_map: ErrorMap
    cell: Cell
    nominal: NominalTargets
    register: bool
    match: MatchBy
    uncertainty_mm: float | None

    @property
    def p(self) -> FloatArray:
        """The nominal positions of the measured point, (n, 3) [mm], base frame."""
        return self.nominal.positions_of(self.error_map.tf_flange_tool)

    @property
    def place(self) -> IntArray:
        """The first target with the same pose as each target, (n,)."""
        nominal = self.nominal
        flanges = nominal.tf_base_tool @ invert_transform(nominal.tf_flange_tool)
        poses = np.round(flanges.reshape(len(nominal), -1) / _SAME)
        _, first, group = np.unique(poses, axis=0, return_index=True, return_inverse=True)
        return np.asarray(first[group.reshape(-1)])

    def measure(self, readings: Readings) -> Remeasured:
        """Return the readings of the targets."""
        return remeasured(
            readings,
            self.nominal.names,
            self.p,
            self.place,
            None if self.register else self.error_map.registration,
            self.cell,
            by=self.match,
            uncertainty_mm=self.uncertainty_mm,
        )


def _tolerance(stated: float | None, cell: Cell) -> tuple[float, str]:
    if stated is not None:
        return stated, "stated for this verification"
    if cell.tolerance_mm is not None:
        return cell.tolerance_mm, "cell file"
    raise DataError(
        "no tolerance is known; state tolerance_mm under [report] or [correction] in the cell file, or give --tolerance"
    )


def _read(readings: str | Path | Readings, columns: Columns | None) -> Readings:
    return readings if isinstance(readings, Readings) else read_readings(readings, columns)


def _source(readings: str | Path | Readings) -> str:
    return readings.source if isinstance(readings, Readings) else str(readings)


def _result(task: _Task, program: Program, measured: Remeasured, stated: _Statement) -> ProgramVerification:
    nominal, place = task.nominal, task.place
    # targets of one pose share its readings
    row = np.full(len(nominal), -1)
    row[measured.target] = np.arange(len(measured.target))
    shared = {int(place[k]): i for i, k in reversed(list(enumerate(measured.target.tolist())))}
    row = np.array([own if own >= 0 else shared.get(int(place[k]), -1) for k, own in enumerate(row.tolist())])
    known = np.flatnonzero(row >= 0)
    row = row[known]
    error = np.linalg.norm(measured.p_base[row] - task.p[known], axis=1)
    found = uncertainty(task.error_map, task.cell, nominal, measured, known, row)
    expanded = found.expanded
    earlier = np.linalg.norm(stated.earlier[known], axis=1)
    targets = tuple(
        VerifiedTarget(
            name=nominal.targets[k].name,
            file=str(nominal.targets[k].path),
            line=nominal.targets[k].line,
            correction=nominal.outcomes[k],
            nominal_mm=_point(task.p[k]),
            measured_mm=_point(measured.p_base[row[i]]),
            error_mm=float(error[i]),
            uncertainty_mm=float(expanded[i]),
            before_mm=None if np.isnan(earlier[i]) else float(earlier[i]),
            readings=int(measured.count[row[i]]),
            decision=decision,
        )
        for i, (k, decision) in enumerate(
            zip(known.tolist(), conformity(error, expanded, stated.tolerance), strict=True)
        )
    )
    missing = np.setdiff1d(np.arange(len(nominal)), known)
    return ProgramVerification(
        program=str(program.path),
        readings=stated.source,
        record="" if nominal.record is None else str(nominal.record),
        map_sha256=task.error_map.hash,
        tolerance_mm=stated.tolerance,
        tolerance_origin=stated.origin,
        station="registered" if task.register else "map",
        station_std_mm=next(line.u_mm or 0.0 for line in found.lines if line.source == "station"),
        before=stated.before,
        targets=targets,
        unmeasured=tuple(nominal.targets[k].name for k in missing.tolist()),
        unknown=nominal.unknown,
        notes=tuple(_notes(task, measured)),
        run=stated.run,
        coverage_factor=float(found.k.max()),
        budget=found.lines,
    )


def _point(p: FloatArray) -> tuple[float, float, float]:
    x, y, z = np.round(p, 6).tolist()
    return x, y, z


def _notes(task: _Task, measured: Remeasured) -> list[str]:
    nominal, notes = task.nominal, []
    if nominal.record is not None and nominal.map_sha256 != task.error_map.hash:
        notes.append("The record names another map than this one: the program was corrected with another map.")
    away = np.linalg.norm(nominal.tf_flange_tool[:, :3, 3] - task.error_map.tf_flange_tool[:3, 3], axis=1).max()
    if away > _OTHER_POINT_MM:
        notes.append(
            f"The measured point lies {away:.3f} mm from the tool of the program; its nominal positions follow from "
            "the poses of the targets, so errors of orientation are included."
        )
    if task.register and measured.registration.outliers.any():
        notes.append(
            f"{int(measured.registration.outliers.sum())} readings were left out of the registration as outliers; "
            "their targets are judged like the others."
        )
    return notes
