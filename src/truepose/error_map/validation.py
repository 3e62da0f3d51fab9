"""The accuracy of a map on samples that took no part in its fit."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from truepose._io.tables import by_axis, data_frame, html_table
from truepose._typing import FloatArray, IntArray
from truepose.cell import Cell
from truepose.error_map.exclusions import gross_held_out
from truepose.error_map.prediction import PredictingMap
from truepose.error_map.registration import reading_noise
from truepose.error_map.repeatability import Repeatability
from truepose.error_map.rivals import Better, better_predictor
from truepose.error_map.worth import Worth
from truepose.samples import Samples, name_one, on_arm
from truepose.verification import RP_PER_STD, HeldOut, held_out, usual_groups

if TYPE_CHECKING:
    from pandas import DataFrame


_SHOWN: Final = ("mean", "rms", "p95", "max")


@dataclass(frozen=True, eq=False)
class Residuals:
    """The errors of held-out samples, pose by pose.

    Attributes
    ----------
    row : (n,) array of int
        The row of each sample in its table.
    p_cmd : (n, 3) array [mm], base frame
        The commanded positions.
    before, predicted : (n, 3) arrays [mm], base frame
        The errors, and the errors that the map predicts.
    std : (n, 3) array [mm], base frame
        The predicted standard deviations of `after`, the noise of a reading included.
    """

    row: IntArray
    p_cmd: FloatArray
    before: FloatArray
    predicted: FloatArray
    std: FloatArray

    @property
    def after(self) -> FloatArray:
        """The errors that the map leaves, (n, 3) [mm], base frame."""
        return self.before - self.predicted


@dataclass(frozen=True, eq=False, repr=False)
class Validation:
    """Errors before and after on held-out samples; made by `ErrorMap.validate`.

    Its values are also available by the keys of `to_dict`, as in ``validation["after"]["mean_mm"]``.

    Attributes
    ----------
    figures : HeldOut
        The accuracy before and after, the coverage of the intervals, and the noise floor.
    seen : int
        The number of the samples that took part in the fit; the figures are too good if it is not 0.
    worth : Worth
        The comparison of the map itself with no map.
    residuals : Residuals
        The errors of each pose, for pictures and tables.
    better : Better, optional
        Another predictor that would do far better on these samples.
    gross : list of dict
        The readings that no error of the arm explains, by ``row``, ``point`` and ``line``, with the ``reason``.
    without_gross : HeldOut, optional
        The figures without them; None where none is gross.
    excluded : list of dict
        The rows of the table that were masked and take no part in any figure, as `Samples.excluded`.
    left_out : int
        The number of readings that the fit of the map left out, see `ErrorMap.excluded`.
    """

    figures: HeldOut
    seen: int
    worth: Worth
    residuals: Residuals
    better: Better | None = None
    gross: list[dict[str, Any]] = field(default_factory=list)
    without_gross: HeldOut | None = None
    excluded: list[dict[str, Any]] = field(default_factory=list)
    left_out: int = 0

    def __repr__(self) -> str:
        seen = f"\n{self.seen} of the samples took part in the fit: the figures are too good" if self.seen else ""
        better = "" if self.better is None else f"\n{self.better.words}"
        gross = f"\n{self.words_of_gross}" if self.gross else ""
        return f"{self.figures!r}\nmap: {self.worth.brief}{seen}{better}{gross}\n{self.words_left_out}"

    @property
    def words_left_out(self) -> str:
        """How many readings take no part in the figures, and in the map, without a full stop."""
        return f"left out: {len(self.excluded)} readings of this table, {self.left_out} of the map"

    @property
    def gross_rows(self) -> list[int]:
        """The places of the gross readings among the samples, from 0."""
        return np.flatnonzero(np.isin(self.residuals.row, [one["row"] for one in self.gross])).tolist()

    @property
    def words_of_gross(self) -> str:
        """The gross readings and the mean without them, in one sentence without a full stop; empty without any."""
        if self.without_gross is None:
            return ""
        mean = self.without_gross.to_dict()["after"]["mean_mm"]
        named = "; ".join(f"{name_one(one)}: {one['reason']}" for one in self.gross)
        of_all = f"{len(self.gross)} of {len(self.residuals.row)}"
        return f"{of_all} readings are gross, without them the mean after is {mean:.3f} mm ({named})"

    def _repr_html_(self) -> str:
        figures = self.figures.to_dict()
        rows = [(name, *(figures[when][f"{name}_mm"] for when in ("before", "after"))) for name in _SHOWN]
        notes = repr(self).splitlines()[len(repr(self.figures.accuracy).splitlines()) :]
        return html_table(
            f"Errors at {figures['before']['n']} held-out poses [mm]", ["", "before", "after"], rows, notes
        )

    def __getitem__(self, key: str) -> Any:
        return self.to_dict()[key]

    def to_frame(self) -> DataFrame:
        """Return a pandas table with one row for each pose: errors before, predicted and after, lengths; needs pandas.

        Its index is the row of each sample.
        """
        found = self.residuals
        columns = {
            **by_axis(found.p_cmd, "{}_cmd_mm"),
            **by_axis(found.before, "{}_before_mm"),
            **by_axis(found.predicted, "{}_predicted_mm"),
            **by_axis(found.after, "{}_after_mm"),
            **by_axis(found.std, "{}_std_mm"),
            "before_mm": np.linalg.norm(found.before, axis=1),
            "after_mm": np.linalg.norm(found.after, axis=1),
        }
        return data_frame(columns).set_index(found.row)

    def to_dict(self) -> dict[str, Any]:
        """Return all figures as plain values, for JSON."""
        better = None if self.better is None else self.better.to_dict()
        return {
            **self.figures.to_dict(),
            "seen": self.seen,
            "worth": self.worth.to_dict(),
            "better": better,
            "gross": self.gross,
            "without_gross": None if self.without_gross is None else self.without_gross.to_dict(),
            "excluded": self.excluded,
            "left_out_of_map": self.left_out,
        }


def validate(error_map: PredictingMap, samples: Samples, *, rivals: bool) -> Validation:
    """Compare errors before and after on held-out samples; see `truepose.ErrorMap.validate`."""
    samples = on_arm(samples, error_map.robot)
    e = error_map.errors(samples)
    expected, std = error_map.predict_reading(samples)
    p_cmd = error_map.commanded_positions(samples)
    groups = usual_groups(p_cmd, q=samples.q, robot=error_map.robot, time=samples.time)
    assert samples.row is not None  # set by Poses
    known = {row.tobytes() for row in error_map.samples.p_meas}
    noise, left = motion_noise(error_map, samples), e - expected
    gross = gross_held_out(p_cmd if samples.q is None else samples.q, left, std)
    kept, size = gross == 0, np.linalg.norm(left, axis=1)
    without = None
    if not kept.all():
        parts = {name: labels[kept] for name, labels in groups.items()}
        without = held_out(e[kept], left[kept], std[kept], noise=None if noise is None else noise[kept], groups=parts)
    return Validation(
        held_out(e, left, std, noise=noise, groups=groups),
        sum(row.tobytes() in known for row in samples.p_meas),
        error_map.worth,
        Residuals(samples.row, p_cmd, e, expected, std),
        better_predictor(error_map, samples) if rivals else None,
        [
            {**samples.identify(i), "reason": f"residual of {size[i]:.3f} mm, {gross[i]:.1f} standard deviations"}
            for i in np.flatnonzero(gross).tolist()
        ],
        without,
        list(samples.excluded),
        len(error_map.excluded),
    )


def motion_noise(error_map: PredictingMap, samples: Samples, cell: Cell | None = None) -> FloatArray | None:
    """Return the std of repeatability and reading together, (n, 3) [mm], base frame; None unless both are known.

    A given cell states them instead of the map's own.
    """
    cell = error_map.cell if cell is None else cell
    reading = reading_noise(cell, samples, error_map.registration)
    repeatability = Repeatability.of(cell, error_map.robot).known
    if reading is None or repeatability is None:
        return None
    return np.asarray(np.sqrt(reading**2 + (repeatability / RP_PER_STD) ** 2))
