"""Several files with the modules of one name: which of them the controller loads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path


def loaded_of(
    files: Sequence[Path], homes: Iterable[str], alike: Callable[[Path, Path], bool], *, root: Path
) -> Path | None:
    """Return the file that a controller loads of several with one module; None where that is not known.

    Parameters
    ----------
    files : sequence of Path
        The files.
    homes : iterable of str
        The names of the folders from which controllers of this maker load programs, in lower case.
    alike : callable
        Whether two files state the same, so that it does not matter which one is loaded.
    root : Path
        The folder that was given.
    """
    own = frozenset(homes)
    inside = [file for file in files if own & {part.lower() for part in file.relative_to(root).parts[:-1]}]
    first, *others = sorted(inside or files, key=lambda file: (len(file.parts), file.suffix.lower() == ".prg", file))
    if all(first.parent in file.parent.parents or alike(first, file) for file in others):
        return first  # what lies deeper is a copy that a person keeps
    return None
