"""The targets of a correction as a table: sorted, filtered and searched, some rows at a time."""

from __future__ import annotations

import json
import struct
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from truepose._typing import IntArray
from truepose.web.corrections.columns import CODES, DTYPES, ORDERS, POSITIONS, SIZES, VERDICTS
from truepose.web.corrections.texts import Texts, mapped

SUMMARY: Final = "summary.json"
_KEPT: Final = 8
_DONE: Final = tuple(VERDICTS.index(verdict) for verdict in ("correct", "clip", "follows"))


@dataclass(frozen=True)
class View:
    """What of the targets is shown, and in which order.

    Attributes
    ----------
    sort : str
        The column, one of `truepose.web.corrections.columns.ORDERS`; empty for the order of the program.
    descending : bool
        Whether the largest come first.
    verdicts : tuple of str
        The verdicts that are shown; all if there are none.
    kind : int, optional
        The kind of reason that is shown.
    search : str
        A text that the name, the file, the reason or the note contains.
    """

    sort: str = ""
    descending: bool = False
    verdicts: tuple[str, ...] = ()
    kind: int | None = None
    search: str = ""


class TargetTable:
    """The columns of a record, as `truepose.web.corrections.columns.write_columns` wrote them; read where they are.

    Parameters
    ----------
    folder : Path
        The folder of the columns.
    """

    def __init__(self, folder: Path) -> None:
        self.summary: Mapping[str, Any] = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        self._columns = {name: mapped(folder / name, dtype) for name, dtype in DTYPES.items()}
        for name in POSITIONS:
            self._columns[name] = self._columns[name].reshape(-1, 3)
        self._texts = {name: Texts(folder, name) for name in CODES}
        self._names = Texts(folder, "names")
        self._shown: OrderedDict[View, IntArray] = OrderedDict()

    def __len__(self) -> int:
        return int(self.summary["targets"])

    def rows(self, view: View) -> NDArray[Any]:
        """Return the rows of a view in its order, (k,)."""
        if (known := self._shown.get(view)) is not None:
            return known
        order: NDArray[Any] = np.arange(len(self), dtype=np.int32)
        if view.sort:
            order = np.asarray(self._columns[f"{view.sort}.order"])
        if view.descending:
            last = self._without_number(view.sort)
            order = np.concatenate([order[: len(order) - last][::-1], order[len(order) - last :]])
        if (wanted := self._wanted(view)) is not None:
            order = order[wanted[order]]
        self._shown[view] = order
        while len(self._shown) > _KEPT:
            self._shown.popitem(last=False)
        return order

    def _without_number(self, sort: str) -> int:
        """Return the number of rows without a number in a column; they come last in either order."""
        if sort not in SIZES:
            return 0
        return int(np.count_nonzero(np.isnan(self._columns[sort])))

    def _wanted(self, view: View) -> NDArray[np.bool_] | None:
        """Return which targets a view shows, (n,); None for all."""
        wanted: NDArray[np.bool_] | None = None
        if view.verdicts:
            codes = [VERDICTS.index(verdict) for verdict in view.verdicts]
            wanted = np.isin(self._columns["verdict"], codes)
        if view.kind is not None:
            same = np.asarray(self._columns["kind"] == view.kind)
            wanted = same if wanted is None else wanted & same
        if view.search:
            found = self._names.containing(view.search)
            for name in ("file", "reason", "note", "frame", "tool"):
                found |= self._texts[name].containing(view.search)[self._columns[name]]
            wanted = found if wanted is None else wanted & found
        return wanted

    def page(self, rows: IntArray) -> list[dict[str, Any]]:
        """Return some targets with all that is known of them, for JSON."""
        columns = {name: np.asarray(column[rows]) for name, column in self._columns.items() if name not in _ORDERED}
        texts = {name: [self._texts[name][code] for code in columns[name].tolist()] for name in CODES}
        kinds = self.summary["kinds"]
        sizes = {name: _or_none(columns[name]) for name in SIZES}
        places = {name: [_or_none(one) for one in columns[name]] for name in POSITIONS}
        found = []
        for k, row in enumerate(rows.tolist()):
            kind = kinds[int(columns["kind"][k])]
            found.append(
                {
                    "row": row,
                    "name": self._names[row],
                    "line": int(columns["line"][k]),
                    "verdict": VERDICTS[int(columns["verdict"][k])],
                    "remedy": kind["option"],
                    "assumption": kind["assumption"],
                    **{name: texts[name][k] for name in CODES},
                    **{name: sizes[name][k] for name in SIZES},
                    **{name: None if places[name][k][0] is None else places[name][k] for name in POSITIONS},
                }
            )
        return found

    def path(self, most: int) -> bytes:
        """Return the path in the base frame, for a picture.

        Little-endian: the number of points n and that of all targets with a known position (uint32 each); the
        positions before, and the corrections, in the base frame [mm] (float32, 3 n each); the rows of the targets
        (uint32, n); the codes of their verdicts (uint8, n).

        Parameters
        ----------
        most : int
            The largest number of points. Of more, targets that are not corrected are kept first, up to half of it, and
            of the others every kth.
        """
        base = self._columns["base_mm"]
        known = np.flatnonzero(np.isfinite(np.asarray(base[:, 0])))
        rows = known
        if len(known) > most:
            left = known[~np.isin(self._columns["verdict"][known], _DONE)]
            left = left[:: max(1, -(-len(left) // (most // 2)))]
            others = known[:: -(-len(known) // (most - len(left)))]
            rows = np.union1d(left, others)
        before = np.asarray(base[rows])
        change = np.nan_to_num(np.asarray(self._columns["base_after_mm"][rows]) - before)
        parts = [before.astype("<f4"), change.astype("<f4"), rows.astype("<u4"), self._columns["verdict"][rows]]
        return struct.pack("<2I", len(rows), len(known)) + b"".join(part.tobytes() for part in parts)


_ORDERED: Final = {f"{name}.order" for name in ORDERS}


def _or_none(values: NDArray[Any]) -> list[float | None]:
    """Return numbers for JSON, rounded to a nanometre; None where there is none."""
    rounded = np.round(values.astype(np.float64), 6)
    return [None if number != number else number for number in rounded.tolist()]
