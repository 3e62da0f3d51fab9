"""Measured data sets that come with the package."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.resources import as_file, files
from pathlib import Path

from truepose.cell import Cell, load_cell
from truepose.errors import DataError
from truepose.samples.table import Samples
from truepose.samples.tidy import read_samples

_FOLDER = files("truepose.samples") / "data"


@dataclass(frozen=True, eq=False, repr=False)
class Example:
    """A measured data set; made by `load_example`.

    Attributes
    ----------
    name : str
        The name of the data set.
    cell : Cell
        The cell that was measured.
    samples : Samples
        The commanded poses and readings.
    description : str
        The source, the licence and the columns of the data, as Markdown.
    """

    name: str
    cell: Cell
    samples: Samples
    description: str

    def __repr__(self) -> str:
        title = self.description.partition("\n")[0].removeprefix("# ")
        return f"<Example {self.name}: {title}; robot {self.cell.robot.model}>"


def load_example(name: str = "ur10") -> Example:
    """Return a measured data set that comes with the package.

    Parameters
    ----------
    name : {"ur10"}
        The name of the data set. ``ur10`` is a Universal Robots UR10 measured with a laser tracker at 632 poses
        (Fraunhofer IPA, 2021; MIT licence).

    Returns
    -------
    Example
        The cell, the samples, and a description with the source and the licence.

    Raises
    ------
    DataError
        If there is no data set of this name.

    Examples
    --------
    >>> example = load_example("ur10")
    >>> example
    <Example ur10: UR10 measured with a laser tracker: ISO 9283 cubes, 632 poses; robot universal-robots-ur10>
    >>> len(example.samples), example.cell.tool.fit
    (632, 'position')
    """
    known = sorted(entry.name for entry in _FOLDER.iterdir() if entry.is_dir())
    if name not in known:
        raise DataError(f"no example {name!r}; expected one of {', '.join(known)}")
    with as_file(_FOLDER / name) as folder:
        return _read(name, folder)


def _read(name: str, folder: Path) -> Example:
    return Example(
        name,
        load_cell(folder / "cell.toml"),
        replace(read_samples(folder / "samples.csv"), source=f"{name}/samples.csv"),
        (folder / "README.md").read_text("utf-8"),
    )
