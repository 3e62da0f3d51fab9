"""Everything that a report tells, computed once: the page and the PDF, in any language, are made of the same."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from truepose._io import files
from truepose._typing import FloatArray
from truepose._version import __version__
from truepose.error_map import ErrorMap
from truepose.report.records import Record, read_record
from truepose.report.region import Plane, planes
from truepose.report.study import SimilarityStudy, similarity_study
from truepose.samples import Samples
from truepose.verification import held_out as held_out_figures
from truepose.verification import usual_groups

SEED: Final = 0
"""Of the permutations of the similarity and of the bootstrap."""
_TOLD: Final = ("numpy", "scipy", "numba")


@dataclass(frozen=True, eq=False)
class Evidence:
    """What was measured, found and done; see `gather`.

    Attributes
    ----------
    error_map : ErrorMap
    held_out : Samples or None
    p : (n, 3) array [mm], base frame
        Positions of the poses that accuracy is told of: held out, or each left out once.
    before, after : (n, 3) arrays [mm], base frame
        Their errors, and what the map leaves of them.
    accuracy : dict
        As `truepose.verification.HeldOut.to_dict`; with held-out poses also ``seen``.
    study : SimilarityStudy
    planes : list of Plane
    records : list of Record
        Of corrected programs.
    date : datetime
    """

    error_map: ErrorMap
    held_out: Samples | None
    p: FloatArray
    before: FloatArray
    after: FloatArray
    accuracy: dict[str, Any]
    study: SimilarityStudy
    planes: list[Plane]
    records: list[Record]
    date: datetime

    @property
    def versions(self) -> str:
        """The software that made this."""
        libraries = ", ".join(f"{name} {metadata.version(name)}" for name in _TOLD)
        return f"truepose {__version__}, Python {platform.python_version()}, {libraries}"

    @property
    def held_out_sha256(self) -> str:
        """SHA-256 of the file that the held-out poses came from; empty if it is not there."""
        path = None if self.held_out is None else Path(self.held_out.source)
        return hashlib.sha256(files.read_bytes(path)).hexdigest() if path is not None and path.is_file() else ""


def gather(
    error_map: ErrorMap,
    held_out: Samples | None = None,
    *,
    sidecars: Sequence[str | Path] = (),
    study: SimilarityStudy | None = None,
    date: datetime | None = None,
) -> Evidence:
    """Compute what a report tells; see `truepose.report.write_report`."""
    records = [read_record(path) for path in sidecars]
    if held_out is None:
        p, before = error_map.p_cmd, error_map.e
        after, _ = error_map.leave_one_out()
        groups = usual_groups(p, q=error_map.samples.q, robot=error_map.robot, time=error_map.samples.time)
        figures = held_out_figures(before, after, groups=groups, rng=SEED).to_dict()
    else:
        p, before = error_map.commanded_positions(held_out), error_map.errors(held_out)
        after = before - error_map.predict_errors(held_out)[0]
        figures = error_map.validate(held_out)
    return Evidence(
        error_map=error_map,
        held_out=held_out,
        p=p,
        before=before,
        after=after,
        accuracy=figures,
        study=study or similarity_study(error_map, rng=SEED),
        planes=planes(error_map),
        records=records,
        date=(date or datetime.now(UTC)).astimezone(UTC),
    )
