"""Very many texts in two files: their bytes one after the other, and the place of each."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from truepose._typing import BoolArray

_PLACE: Final = np.dtype("<i8")
_A, _Z, _CASE = ord("a"), ord("z"), ord("a") - ord("A")
_BLOCK: Final = 1 << 24


class TextsWriter:
    """Writes texts to a folder.

    Parameters
    ----------
    folder : Path
        The folder.
    name : str
        The name of the files in it.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._text, self._places = (folder / f"{name}.text").open("xb"), (folder / f"{name}.places").open("xb")
        self._end = 0

    def write(self, texts: list[str]) -> None:
        """Add some texts."""
        encoded = [text.encode("utf-8", "backslashreplace") for text in texts]
        ends = self._end + np.cumsum([len(one) + 1 for one in encoded], dtype=_PLACE)
        self._text.write(b"".join(one + b"\0" for one in encoded))
        self._places.write(ends.tobytes())
        self._end = int(ends[-1]) if len(ends) else self._end

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: type | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        self._text.close()
        self._places.close()


class Texts:
    """Texts that a `TextsWriter` wrote; they stay on the disk until they are asked for.

    Parameters
    ----------
    folder : Path
        The folder.
    name : str
        The name of the files in it.
    """

    def __init__(self, folder: Path, name: str) -> None:
        self._text = mapped(folder / f"{name}.text", np.dtype("u1"))
        self._ends = mapped(folder / f"{name}.places", _PLACE)

    def __len__(self) -> int:
        return len(self._ends)

    def __getitem__(self, i: int) -> str:
        start = int(self._ends[i - 1]) if i else 0
        return bytes(self._text[start : int(self._ends[i]) - 1]).decode("utf-8", "replace")

    def containing(self, text: str) -> BoolArray:
        """Return which texts contain a text, (n,); the case of letters from a to z does not matter."""
        found = np.zeros(len(self), np.bool_)
        wanted = text.encode("utf-8", "replace").lower()
        if not wanted:
            return ~found
        for start in range(0, len(self._text), _BLOCK):
            block = np.asarray(self._text[start : start + _BLOCK + len(wanted) - 1])
            at = np.arange(0) if len(block) < len(wanted) else _places(block, wanted)
            found[np.searchsorted(self._ends, at + start, side="right")] = True
        return found


def _places(block: NDArray[np.uint8], wanted: bytes) -> NDArray[np.intp]:
    """Return where a text begins in a block of bytes."""
    at = np.flatnonzero(_same(block[: len(block) - len(wanted) + 1], wanted[0]))
    for k, letter in enumerate(wanted[1:], 1):
        at = at[_same(block[at + k], letter)]
    return at


def _same(found: NDArray[np.uint8], letter: int) -> BoolArray:
    same: BoolArray = found == letter
    return same | (found == letter - _CASE) if _A <= letter <= _Z else same


def mapped(path: Path, dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    """Return the numbers of a file, read from the disk when they are used."""
    if not path.stat().st_size:
        return np.empty(0, dtype)
    return np.memmap(path, dtype, "r")
