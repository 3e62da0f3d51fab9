"""A folder of measured robots with their splits, as anybody may publish it; read and checked.

Each robot is a folder with ``cell.toml`` and ``samples.csv`` as `truepose fit` reads them, ``split.csv``, and
``README.md`` with the source and the licence. The first column of ``split.csv``, ``row`` or ``name``, names samples;
each other column is a split, in which a sample is ``fit``, ``test`` or, with an empty cell, left out.
"""

from __future__ import annotations

import csv
import hashlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from truepose import Cell, Samples, load_cell, read_samples
from truepose.errors import FileError

FILES: Final = ("cell.toml", "samples.csv", "split.csv", "README.md")
FEWEST_FIT, FEWEST_TEST = 10, 5
_PARTS: Final = ("fit", "test", "")
_SAME_RAD: Final = np.deg2rad(0.01)
_SAME_MM: Final = 0.01


@dataclass(frozen=True)
class Split:
    """A division of the samples of a robot.

    Attributes
    ----------
    name : str
        The name of the split.
    fit, test : (n,), (m,) arrays of int
        The indices of the samples to fit, and of those that are held out.
    repeated : int
        The number of test poses that a fitted pose repeats, within 0.01 degrees in each joint, or 0.01 mm where there
        are no joints: they measure repeatability more than prediction.
    """

    name: str
    fit: NDArray[np.int64]
    test: NDArray[np.int64]
    repeated: int


@dataclass(frozen=True)
class MeasuredRobot:
    """A measured robot.

    Attributes
    ----------
    name : str
        The name of its folder.
    cell : Cell
        The cell.
    samples : Samples
        All samples.
    splits : tuple of Split
        The splits, in the order of the columns.
    title : str
        The first heading of its README.
    sha256 : str
        The hash of cell, samples and splits together.
    """

    name: str
    cell: Cell
    samples: Samples
    splits: tuple[Split, ...]
    title: str
    sha256: str


def read_robots(folder: Path) -> Iterator[MeasuredRobot]:
    """Yield the robots of a folder in the order of their names.

    Raises
    ------
    FileError, CellError, DataError
        If a file is missing or refused, with file, row and remedy.
    """
    if not folder.is_dir():
        raise FileError(folder, "is no folder; name a folder with a folder for each robot")
    robots = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith((".", "_")))
    if not robots:
        raise FileError(folder, f"has no folder of a robot; each has {', '.join(FILES)}")
    for path in robots:
        yield read_robot(path)


def read_robot(folder: Path) -> MeasuredRobot:
    """Return the robot of a folder; see `read_robots`."""
    for name in FILES:
        if not (folder / name).is_file():
            raise FileError(folder / name, f"is missing; the folder of a robot has {', '.join(FILES)}")
    cell, samples = load_cell(folder / "cell.toml"), read_samples(folder / "samples.csv")
    heads = [line for line in (folder / "README.md").read_text("utf-8").splitlines() if line.startswith("# ")]
    if not heads:
        raise FileError(folder / "README.md", "has no heading; begin with '# ROBOT, TRACKER, SOURCE', then the licence")
    splits = tuple(_splits(folder / "split.csv", samples))
    digest = hashlib.sha256()
    for name in FILES[:3]:
        digest.update(hashlib.sha256((folder / name).read_bytes()).digest())
    return MeasuredRobot(folder.name, cell, samples, splits, heads[0][2:], digest.hexdigest())


def _splits(path: Path, samples: Samples) -> Iterator[Split]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            header, *rows = [[cell.strip() for cell in row] for row in csv.reader(file) if any(row)] or [[]]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(path, f"is no table with commas in UTF-8 ({error})") from None
    if len(header) < 2 or header[0] not in ("row", "name"):
        raise FileError(path, "has another header; expected 'row' or 'name', and a column for each split", line=1)
    if repeated := [name for name, count in Counter(header).items() if count > 1 or not name]:
        raise FileError(path, f"has two splits of the name {repeated[0]!r}, or one without a name", line=1)
    index = _index(path, header[0], samples)
    part = np.full((len(header) - 1, len(samples)), "", dtype="<U4")
    seen: dict[str, int] = {}
    for line, row in enumerate(rows, 2):
        if len(row) != len(header):
            raise FileError(path, f"has {len(row)} cells, expected {len(header)}", line=line)
        if row[0] not in index:
            raise FileError(path, f"{header[0]} {row[0]!r} is not in samples.csv", line=line)
        if row[0] in seen:
            raise FileError(path, f"{header[0]} {row[0]!r} stands in line {seen[row[0]]} already; keep one", line=line)
        seen[row[0]] = line
        for k, word in enumerate(row[1:]):
            if word not in _PARTS:
                where = f"split {header[k + 1]!r}, {header[0]} {row[0]!r}"
                raise FileError(path, f"{where}: {word!r} is none of 'fit', 'test' and an empty cell", line=line)
            part[k, index[row[0]]] = word
    if missing := [name for name in index if name not in seen]:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        what = f"{header[0]} {missing[0]!r}{more} of samples.csv"
        raise FileError(path, f"has no row for {what}; give it one, with empty cells to leave it out")
    for name, words in zip(header[1:], part, strict=True):
        yield _split(path, name, samples, np.flatnonzero(words == "fit"), np.flatnonzero(words == "test"))


def _index(path: Path, column: str, samples: Samples) -> dict[str, int]:
    """Return the indices of samples by what the first column names."""
    names = samples.name if column == "name" else samples.row
    if names is None:
        raise FileError(path, "names samples by 'name', but samples.csv has no such column; use 'row'", line=1)
    index = {str(name): i for i, name in enumerate(names)}
    if len(index) < len(samples):
        twice = Counter(map(str, names)).most_common(1)[0][0]
        raise FileError(path, f"{column} {twice!r} stands twice in samples.csv; name samples by another column", line=1)
    return index


def _split(path: Path, name: str, samples: Samples, fit: NDArray[np.int64], test: NDArray[np.int64]) -> Split:
    for word, rows, fewest in (("fit", fit, FEWEST_FIT), ("test", test, FEWEST_TEST)):
        if len(rows) < fewest:
            raise FileError(path, f"split {name!r} has {len(rows)} samples of {word!r}; it needs {fewest} or more")
    pose, same = (samples.p_cmd, _SAME_MM) if samples.q is None else (samples.q, _SAME_RAD)
    assert pose is not None
    near = cKDTree(pose[fit]).query_ball_point(pose[test], same, p=np.inf)
    for i, others in zip(test, near, strict=True):
        for j in fit[others]:
            if np.array_equal(samples.p_meas[i], samples.p_meas[j]):
                pair = samples.rows(np.array([i, j]))
                raise FileError(path, f"split {name!r}: {pair} of samples.csv are one reading, in both parts; keep one")
    return Split(name, fit, test, sum(bool(others) for others in near))
