"""Masked samples: rows that are left out for a stated reason, such as a beam that was cut.

The tidy table has a column ``masked`` for it: the reason, or nothing where a row counts. Readers leave such rows out
and name them in `Samples.excluded`, so that a map records them. A mask file states the reasons before the table
exists: the columns ``point`` (or ``row``) and ``reason``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._io.delimited import csv_cell, parse, read_tabular, unescaped
from truepose._io.files import write_atomic
from truepose._io.strict import is_whole
from truepose.errors import FileError
from truepose.samples.columns import POINT_NAMES
from truepose.samples.masked import MASKED, SampleTable
from truepose.samples.table import Poses, Samples
from truepose.samples.tidy import append_columns, read_all_samples, read_samples_but

_REASON, _ROW = "reason", "row"
_LONGEST: Final = 200


@dataclass(frozen=True)
class Mask:
    """The reasons to leave points out.

    Attributes
    ----------
    reasons : dict of str or int to str
        The reason of each masked point, by its name, or by its row from 0. Of a pose with several reflectors, "P3" is
        the whole pose and "P3/A" one reading.
    source : str
        The file, for messages.
    lines : dict of str or int to int
        The line of each point in the file.
    """

    reasons: dict[str | int, str]
    source: str = "mask"
    lines: dict[str | int, int] | None = None

    def of(self, poses: Poses | SampleTable, plan: Poses | None = None) -> NDArray[np.str_]:
        """Return the reason of each row of a table, (n,); empty where it counts.

        Parameters
        ----------
        poses : Poses or SampleTable
            The table.
        plan : Poses, optional
            The plan that the rows are of; masked points of it need not be in the table, since they have no reading.

        Raises
        ------
        FileError
            If a masked point is not in the table, or its name stands for several rows.
        """
        if plan is not None:
            assert plan.row is not None
            assert poses.row is not None
            known = dict(zip(plan.row.tolist(), self.of(plan).tolist(), strict=True))
            return np.array([known[row] for row in poses.row.tolist()], dtype=np.str_)
        assert poses.row is not None
        names = [] if poses.name is None else [name.strip().casefold() for name in poses.name.tolist()]
        several: list[str] = [] if poses.reflector is None else poses.reflector.tolist()
        readings = [f"{name}/{one.casefold()}" for name, one in zip(names, several, strict=False)]
        rows: list[Any] = poses.row.tolist()
        found = [""] * len(poses)
        for point, reason in self.reasons.items():
            key: Any = point if isinstance(point, int) else point.strip().casefold()
            among: list[Any] = rows if isinstance(point, int) else names
            among = readings if key in readings else among
            line = (self.lines or {}).get(point)
            count = among.count(key)
            if count > 1 and several and among is names:  # a pose with all its reflectors
                found = [reason if name == key else one for name, one in zip(names, found, strict=True)]
                continue
            if count != 1:
                what = f"the point {point}" if isinstance(point, str) else f"row {point}"
                why = "is not among the samples" if not count else f"stands for {count} samples; state their rows"
                raise FileError(self.source, f"{what} {why}", line=line)
            found[among.index(key)] = reason
        return np.array(found, dtype=np.str_)

    def write(self, path: str | Path) -> None:
        """Write the mask as a file that `read_mask` reads."""
        by_row = all(isinstance(point, int) for point in self.reasons)
        lines = [f"{csv_cell(str(point))},{csv_cell(reason)}" for point, reason in self.reasons.items()]
        write_atomic(path, "\n".join([f"{_ROW if by_row else 'point'},{_REASON}", *lines]) + "\n")


def read_mask(path: str | Path) -> Mask:
    r"""Read a mask file: a table with the columns ``point`` (or ``row``) and ``reason``.

    Raises
    ------
    FileError
        If a column is missing, or a point has no reason or two; with the line.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "mask.csv").write_text("point,reason\nP003,beam was cut\n")
    ...     read_mask(f"{folder}/mask.csv").reasons
    {'P003': 'beam was cut'}
    """
    text, source = read_tabular(path)
    table = parse(text, source)
    header = [name.strip().lower() for name in table.header]
    named = next((name for name in (*POINT_NAMES, _ROW) if name in header), None)
    if named is None or _REASON not in header:
        raise FileError(
            source, f"needs the columns point (or row) and reason; it has {', '.join(table.header)}", line=1
        )
    reasons: dict[str | int, str] = {}
    lines: dict[str | int, int] = {}
    columns = table.fields[:, [header.index(named), header.index(_REASON)]].tolist()
    for line, (field, reason) in zip(table.line.tolist(), columns, strict=True):
        point: str | int = unescaped(field)
        if named == _ROW:
            if not is_whole(field):
                raise FileError(source, f"row is {field!r}, which is not a whole number", line=line)
            point = int(field)
        if point in reasons:
            raise FileError(source, f"states {point} a second time; keep one line", line=line)
        reasons[point], lines[point] = checked_reason(unescaped(reason), source, line), line
    return Mask(reasons, str(source), lines)


def mask_table(path: str | Path, out: str | Path, mask: Mask | None) -> Samples:
    """Copy a table of samples with other rows left out: those of the mask; all other rows count.

    Parameters
    ----------
    path : str or Path
        The table of samples. Its own masks do not matter.
    out : str or Path
        The table to write; every other column is as in the first.
    mask : Mask, optional
        The rows to leave out; without it all rows count.

    Returns
    -------
    Samples
        The samples that count, with the others in `Samples.excluded`.

    Raises
    ------
    FileError
        If the table cannot be read, a masked point is not in it, a value of a row that would count is invalid, no row
        would count, or the file cannot be written.
    """
    table = read_all_samples(path)
    reasons = np.full(len(table), "", dtype="<U1") if mask is None else mask.of(table)
    if (reasons != "").all():
        raise FileError(path, "all rows would be masked; at least one must count")
    samples = read_samples_but(path, reasons)
    append_columns(path, out, {MASKED: reasons})
    return samples


def checked_reason(reason: str, source: str | Path, line: int | None = None) -> str:
    """Return a reason on one line.

    Raises
    ------
    FileError
        If it is empty or too long.
    """
    plain = " ".join(reason.split())
    if not plain:
        raise FileError(source, "has no reason; state why the point is left out", line=line)
    if len(plain) > _LONGEST:
        raise FileError(source, f"has a reason of {len(plain)} characters, expected at most {_LONGEST}", line=line)
    return plain


def set_aside(samples: Samples, reasons: NDArray[np.str_]) -> Samples:
    """Return the samples without a reason (n,); the others are named in `Samples.excluded`.

    Examples
    --------
    >>> samples = Samples(np.array([[0.0, 0.0, 1.0], [5.0, 0.0, 1.0]]), q=np.zeros((2, 6)))
    >>> kept = set_aside(samples, np.array(["", "beam was cut"]))
    >>> len(kept), kept.excluded
    (1, ({'row': 1, 'point': None, 'line': None, 'reason': 'masked: beam was cut'},))
    """
    masked = reasons != ""
    named = [{**samples.identify(int(i)), "reason": f"masked: {reasons[i]}"} for i in np.flatnonzero(masked)]
    return replace(samples[~masked], excluded=(*samples.excluded, *named))
