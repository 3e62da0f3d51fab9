"""Write the targets of a record as columns of numbers, so that a table of a million rows is quick and takes no memory.

The record has one target a line. Some thousand lines are read at a time, and each column is a file of its own.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from truepose._typing import FloatArray, IntArray
from truepose.errors import FileError
from truepose.programs.core.outcomes import DONE, follows_corrected
from truepose.programs.core.reasons import kind_of
from truepose.programs.core.remedies import remedy_of
from truepose.programs.coverage import Coverage
from truepose.programs.record import TARGETS, head_of
from truepose.web.corrections.texts import TextsWriter

VERDICTS: Final = (*DONE, "follows")
"""The verdicts by their codes; "follows": derived from corrected points, whose corrections it gets."""
FOLLOWS: Final = VERDICTS.index("follows")
CODES: Final = ("file", "motion", "frame", "tool", "reason", "note")
"""Columns of texts that targets share; the numbers are their places among the texts."""
SIZES: Final = ("change", "std", "error", "bend_mm", "turn_deg", "spacing_mm", "difference_mm", "remaining_mm")
POSITIONS: Final = ("before_mm", "after_mm", "base_mm", "base_after_mm")
ORDERS: Final = ("name", "line", "verdict", "change", "std", "error", "reason")
"""The columns by which the targets can be sorted."""
DTYPES: Final[Mapping[str, np.dtype[Any]]] = {
    **{name: np.dtype("<i4") for name in (*CODES, "line", "kind", *(f"{one}.order" for one in ORDERS))},
    **{name: np.dtype("<f4") for name in SIZES},
    **{name: np.dtype("<f8") for name in POSITIONS},
    "verdict": np.dtype("u1"),
}
_ROWS: Final = 2000
_KEY: Final = 48
_MOST_KINDS: Final = 1000
_DIGITS: Final = re.compile(rb"\d+")
Progress = Callable[[int, int], Any]


def write_columns(record: Path, folder: Path, progress: Progress) -> dict[str, Any]:
    """Write the columns of a record to a folder; return what is not a column: the counts, the reasons, the coverage.

    Raises
    ------
    FileError
        If the file is no record of corrections.
    """
    head = head_of(record)
    total = int(head.get("summary", {}).get("targets", 0))
    writer = _Writer(folder)
    try:
        with writer:
            for targets in _targets(record):
                writer.write(targets)
                progress(writer.count, total)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise FileError(record, "is no readable record of corrections; move it away if it is not one") from None
    return writer.finished(head)


def _targets(record: Path) -> Iterator[list[Mapping[str, Any]]]:
    """Yield the targets of a record, some thousand at a time."""
    with record.open(encoding="utf-8-sig") as lines:
        if any(line.rstrip() == TARGETS for line in lines):
            ours = (line.rstrip().rstrip(",") for line in lines if line.startswith("{"))
            while some := list(islice(ours, _ROWS)):
                yield json.loads(f"[{','.join(some)}]")
            return
    with record.open(encoding="utf-8-sig") as whole:  # written again by another program
        yield json.load(whole)["targets"]


class _Writer:
    def __init__(self, folder: Path) -> None:
        self.count = 0
        self._folder = folder
        self._codes: dict[str, dict[str, int]] = {name: {} for name in CODES}
        self._kinds: dict[tuple[str, str], int] = {}
        self._kind_of: list[int] = []
        self._examples: list[str] = []

    def __enter__(self) -> _Writer:
        self._open = ExitStack()
        names = [name for name in DTYPES if not name.endswith(".order")]
        self._files: dict[str, BinaryIO] = {
            name: self._open.enter_context((self._folder / name).open("xb")) for name in names
        }
        self._names = self._open.enter_context(TextsWriter(self._folder, "names"))
        return self

    def __exit__(self, *_error: object) -> None:
        self._open.close()

    def write(self, targets: Sequence[Mapping[str, Any]]) -> None:
        """Add some targets."""
        self.count += len(targets)
        self._names.write([str(one["name"]) for one in targets])
        self._add("line", [one["line"] for one in targets])
        for name in CODES:
            known = self._codes[name]
            codes = [known.setdefault(str(one.get(name) or ""), len(known)) for one in targets]
            self._add(name, codes)
            if name == "reason":
                self._learn_kinds()
                self._add("kind", [self._kind_of[code] for code in codes])
        self._add("verdict", [_verdict(one) for one in targets])
        for name in POSITIONS:
            self._add(name, _vectors(targets, name))
        sizes = {"change": _lengths(targets, "correction_mm"), "error": _lengths(targets, "e_mm")}
        sizes["std"] = _numbers(targets, "std_mm")
        for name in SIZES:
            self._add(name, sizes[name] if name in sizes else _numbers(targets, name))

    def _add(self, name: str, values: Any) -> None:
        self._files[name].write(np.asarray(values).astype(DTYPES[name]).tobytes())

    def _learn_kinds(self) -> None:
        """Find the kind of each new reason; very many kinds become one."""
        for reason in islice(self._codes["reason"], len(self._kind_of), None):
            remedy = remedy_of(reason)
            key = kind_of(reason), "" if remedy is None else remedy.option
            if key not in self._kinds and len(self._kinds) >= _MOST_KINDS:
                key = "…", ""
            if key not in self._kinds:
                self._examples.append(reason)
            self._kind_of.append(self._kinds.setdefault(key, len(self._kinds)))

    def finished(self, head: Mapping[str, Any]) -> dict[str, Any]:
        """Write the texts and the orders; return the rest."""
        for name, known in self._codes.items():
            with TextsWriter(self._folder, name) as texts:
                texts.write(list(known))
        columns = {name: np.fromfile(self._folder / name, DTYPES[name]) for name in ("verdict", "kind", "line", "file")}
        self._write_orders(columns)
        return {
            "targets": self.count,
            "verdicts": {VERDICTS[code]: n for code, n in _counted(columns["verdict"])},
            "kinds": self._described(columns["verdict"], columns["kind"]),
            "coverage": self._coverage(head).to_dict(),
            "box": self._box(),
        }

    def _write_orders(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write for each column by which the table is sorted the rows in its order; rows without a number come last."""
        keys: dict[str, Any] = {"line": np.lexsort((columns["line"], columns["file"]))}
        keys["name"] = np.argsort(self._name_keys(), kind="stable")
        for name in ("verdict", "reason", "change", "std", "error"):
            values = np.fromfile(self._folder / name, DTYPES[name])
            if name == "reason":
                values = _places([text.casefold() for text in self._codes["reason"]])[values]
            keys[name] = np.argsort(values, kind="stable")
        for name, order in keys.items():
            order.astype(DTYPES[f"{name}.order"]).tofile(self._folder / f"{name}.order")

    def _name_keys(self) -> NDArray[np.bytes_]:
        """Return the names so that P2 comes before P10, (n,)."""
        names = (self._folder / "names.text").read_bytes().lower().split(b"\0")[: self.count]
        return np.array([_DIGITS.sub(lambda m: m[0][:10].rjust(10, b"0"), name)[:_KEY] for name in names], f"S{_KEY}")

    def _described(self, verdict: IntArray, kind: IntArray) -> list[dict[str, Any]]:
        """Return each kind of reason with its remedy and the number of targets of each verdict."""
        texts = list(self._kinds)
        found: list[dict[str, Any]] = []
        for k, (text, option) in enumerate(texts):
            remedy = remedy_of(self._examples[k])
            found.append(
                {
                    "kind": k,
                    "reason": text,
                    "example": self._examples[k],
                    "option": option,
                    "assumption": "" if remedy is None else remedy.assumption,
                    "counts": {},
                }
            )
        for code, n in _counted(kind.astype(np.int64) * len(VERDICTS) + verdict):
            found[code // len(VERDICTS)]["counts"][VERDICTS[code % len(VERDICTS)]] = n
        return found

    def _coverage(self, head: Mapping[str, Any]) -> Coverage:
        """Return the coverage: of each module the motion targets, and why those that stay nominal do."""
        file, motion, reason, verdict = (
            np.fromfile(self._folder / name, DTYPES[name]) for name in ("file", "motion", "reason", "verdict")
        )
        moved_to = motion != self._codes["motion"].get("", -1)
        left = moved_to & ~np.isin(verdict, (DONE.index("correct"), DONE.index("clip"), FOLLOWS))
        texts, reasons = list(self._codes["file"]), list(self._codes["reason"])
        modules: dict[str, tuple[str, Counter[str], Counter[str]]] = {}
        for one in head.get("files", []):
            modules.setdefault(_module(one["file"]), (str(one["file"]), Counter(), Counter()))
        for code, n in _counted(file[moved_to]):
            modules.setdefault(_module(texts[code]), (texts[code], Counter(), Counter()))[1][""] += n
        for pair, n in _counted(file[left].astype(np.int64) * len(reasons) + reason[left]):
            modules[_module(texts[pair // len(reasons)])][2][reasons[pair % len(reasons)]] += n
        found = [(name, moved[""], why) for name, moved, why in modules.values() if moved[""] or len(modules) == 1]
        return Coverage.of_counts(found, head.get("refused", {}).values())

    def _box(self) -> list[list[float]] | None:
        """Return the smallest and largest coordinates of the targets in the base frame [mm]."""
        base = np.fromfile(self._folder / "base_mm", DTYPES["base_mm"]).reshape(-1, 3)
        known = base[np.isfinite(base).all(axis=1)]
        return [known.min(axis=0).tolist(), known.max(axis=0).tolist()] if len(known) else None


def _module(file: str) -> str:
    """Return what the files of a module share: a .src and its .dat are one module."""
    return str(Path(file).with_suffix(""))


def _verdict(target: Mapping[str, Any]) -> int:
    return FOLLOWS if follows_corrected(str(target["reason"])) else DONE.index(target["verdict"])


def _numbers(targets: Sequence[Mapping[str, Any]], key: str) -> FloatArray:
    return np.array([one.get(key) for one in targets], np.float64)


def _vectors(targets: Sequence[Mapping[str, Any]], key: str) -> FloatArray:
    """Return the vectors of targets, (n, 3); NaN where there is none, as in records of earlier releases."""
    none = [None] * 3
    found = np.array([one.get(key) or none for one in targets], np.float64)
    return found.reshape(len(targets), 3)


def _lengths(targets: Sequence[Mapping[str, Any]], key: str) -> FloatArray:
    lengths: FloatArray = np.linalg.norm(_vectors(targets, key), axis=1)
    return lengths


def _counted(codes: NDArray[Any]) -> list[tuple[int, int]]:
    values, counts = np.unique(codes, return_counts=True)
    return list(zip(values.tolist(), counts.tolist(), strict=True))


def _places(texts: list[str]) -> IntArray:
    """Return the place of each text in their alphabetical order, (n,)."""
    places = np.empty(len(texts), np.int64)
    places[np.array(sorted(range(len(texts)), key=texts.__getitem__), np.int64)] = np.arange(len(texts))
    return places
