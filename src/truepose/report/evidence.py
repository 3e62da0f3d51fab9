"""The content of a report, computed once for all formats and languages."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._io import files
from truepose._typing import FloatArray
from truepose._version import version
from truepose.cell import Cell
from truepose.error_map import ErrorMap
from truepose.error_map.registration import reading_noise
from truepose.error_map.rivals import Better, better_predictor
from truepose.error_map.validation import motion_noise
from truepose.errors import DataError
from truepose.programs import ProgramVerification
from truepose.report.records import Record, read_record
from truepose.report.region import Plane, planes
from truepose.report.study import SimilarityStudy, similarity_study
from truepose.report.verification import read_verification
from truepose.samples import Samples
from truepose.verification import held_out as held_out_figures
from truepose.verification import usual_groups

SEED: Final = 0
"""The seed of the similarity permutations and of the bootstrap."""
_LIBRARIES: Final = ("numpy", "scipy", "numba")


@dataclass(frozen=True)
class StoreEntry:
    """The state of a store when a report was made.

    Attributes
    ----------
    sequence : int
        The number of the last entry of the audit trail.
    head : str
        The hash of that entry, which covers all earlier entries.
    map_state : str
        The state of the map: ``draft``, ``released``, ``superseded`` or ``withdrawn``.
    """

    sequence: int
    head: str
    map_state: str


@dataclass(frozen=True, eq=False)
class Evidence:
    """The content of a report; made by `gather`.

    Attributes
    ----------
    error_map : ErrorMap
        The map.
    cell : Cell
        The cell with the facts of the report, its tolerance and its logo.
    held_out : Samples or None
        The held-out samples.
    p : (n, 3) array [mm], base frame
        The positions of the evaluated poses: held out, or each sample left out once.
    before, after : (n, 3) arrays [mm], base frame
        The errors of these poses, and the errors that remain after the prediction.
    std : (n, 3) array [mm], base frame
        The predicted standard deviations of these errors.
    reading_std : (n,) array [mm] or None
        The standard uncertainties of these readings in their worst direction; None if they are not known.
    accuracy : dict
        The accuracy figures (`truepose.verification.HeldOut.to_dict`); with held-out poses also ``seen``.
    study : SimilarityStudy
        The similarity study of the samples.
    better : Better or None
        Another predictor that would do far better than that of the map.
    planes : list of Plane
        The predictions on planes through the work region.
    records : list of Record
        The records of corrected programs.
    verifications : list of ProgramVerification
        The verifications of programs.
    date : datetime
        The date of the report, UTC.
    store : StoreEntry, optional
        The state of the store that the report was made with.
    """

    error_map: ErrorMap
    cell: Cell
    held_out: Samples | None
    p: FloatArray
    before: FloatArray
    after: FloatArray
    std: FloatArray
    reading_std: FloatArray | None
    accuracy: dict[str, Any]
    study: SimilarityStudy
    better: Better | None
    planes: list[Plane]
    records: list[Record]
    verifications: list[ProgramVerification]
    date: datetime
    store: StoreEntry | None = None

    @property
    def reading_source(self) -> str:
        """The source of `reading_std`: the ``table`` of samples, or the ``cell`` file."""
        evaluated = self.error_map.samples if self.held_out is None else self.held_out
        return "cell" if evaluated.p_std is None else "table"

    @property
    def versions(self) -> str:
        """The versions of truepose, Python and the numerical libraries."""
        libraries = ", ".join(f"{name} {metadata.version(name)}" for name in _LIBRARIES)
        return f"truepose {version()}, Python {platform.python_version()}, {libraries}"

    @property
    def held_out_sha256(self) -> str:
        """The SHA-256 of the file of the held-out poses; empty if there is no such file."""
        path = None if self.held_out is None else Path(self.held_out.source)
        return hashlib.sha256(files.read_bytes(path)).hexdigest() if path is not None and path.is_file() else ""


def gather(
    error_map: ErrorMap,
    held_out: Samples | None = None,
    *,
    cell: Cell | None = None,
    sidecars: Sequence[str | Path] = (),
    verifications: Sequence[str | Path | ProgramVerification] = (),
    study: SimilarityStudy | None = None,
    date: datetime | None = None,
    store: StoreEntry | None = None,
) -> Evidence:
    """Compute the content of a report; see `truepose.report.write_report` for the parameters."""
    records = [read_record(path) for path in sidecars]
    verified = [one if isinstance(one, ProgramVerification) else read_verification(one) for one in verifications]
    cell = _cell(error_map, cell)
    if held_out is None:
        p, before = error_map.p_cmd, error_map.e
        after, std = error_map.leave_one_out()
        groups = usual_groups(p, q=error_map.samples.q, robot=error_map.robot, time=error_map.samples.time)
        figures = held_out_figures(before, after, groups=groups, rng=SEED).to_dict()
        better = better_predictor(error_map)
    else:
        found = error_map.validate(held_out)
        p, before, after = found.residuals.p_cmd, found.residuals.before, found.residuals.after
        std = error_map.predict_errors(held_out)[1]
        figures, better = found.to_dict(), found.better
    evaluated = error_map.samples if held_out is None else held_out
    noise = motion_noise(error_map, evaluated, cell)
    if noise is not None and "noise_floor" not in figures:
        figures["noise_floor"] = held_out_figures(before, after, noise=noise, rng=SEED).noise_floor
    return Evidence(
        error_map=error_map,
        cell=cell,
        held_out=held_out,
        p=p,
        before=before,
        after=after,
        std=std,
        reading_std=_reading_std(error_map, cell, evaluated),
        accuracy=figures,
        study=study or similarity_study(error_map, rng=SEED),
        better=better,
        planes=planes(error_map),
        records=records,
        verifications=verified,
        date=(date or datetime.now(UTC)).astimezone(UTC),
        store=store,
    )


def _cell(error_map: ErrorMap, cell: Cell | None) -> Cell:
    """Return the cell with the facts of the report, by default the map's own."""
    if cell is None:
        return error_map.cell
    if cell.load_robot().name != error_map.robot.name:
        raise DataError(f"the cell file describes a {cell.robot.model}, but the map is of a {error_map.robot.name}")
    return cell


def _reading_std(error_map: ErrorMap, cell: Cell, samples: Samples) -> FloatArray | None:
    """Return the standard uncertainties of readings (n,) [mm], as the given cell or the map's own states them."""
    for stated in (cell, error_map.cell):
        std = reading_noise(stated, samples, error_map.registration)
        if std is not None:
            return np.asarray(std.max(axis=1))
    return None
