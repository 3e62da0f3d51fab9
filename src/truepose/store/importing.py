"""Take a folder of files into a store: each object whole or not at all, each file once, the others with a reason."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from truepose._io.files import read_bytes
from truepose._io.folders import files_within
from truepose.error_map import ErrorMap
from truepose.errors import DataError, RefusedError, StoreError, TrueposeError
from truepose.store import recording, schema
from truepose.store.access import Identity, changing, check
from truepose.store.ancestry import parent_of
from truepose.store.folder import FileObject, FolderContent, LeftOut, read_folder
from truepose.store.recording import CellFile
from truepose.store.rows import find, reading_sets_of

if TYPE_CHECKING:
    from truepose.store.change import Change
    from truepose.store.store import Store


@dataclass
class Imported:
    """What an import took.

    Attributes
    ----------
    taken : list of FileObject
        The objects that are new in the store.
    known : list of FileObject
        The objects that the store had.
    left_out : list of LeftOut
        The files that were not taken, with the reasons.
    others : int
        The number of files that are no objects.
    """

    taken: list[FileObject] = field(default_factory=list)
    known: list[FileObject] = field(default_factory=list)
    left_out: list[LeftOut] = field(default_factory=list)
    others: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        return {
            "taken": [{"kind": one.kind, "file": str(one.path), "sha256": one.sha256} for one in self.taken],
            "known": [{"kind": one.kind, "file": str(one.path), "sha256": one.sha256} for one in self.known],
            "left_out": [{"file": str(one.path), "reason": one.reason} for one in self.left_out],
            "others": self.others,
        }

    def counts(self) -> dict[str, int]:
        """Return the number of new objects by kind."""
        return dict(Counter(one.kind for one in self.taken))


def import_folder(
    store: Store, by: Identity, folder: Path, progress: Callable[[int, int], None] = lambda done, total: None
) -> Imported:
    """Take in the cells, samples, maps, corrections and verifications of a folder, or of one file.

    Parameters
    ----------
    store : Store
        The store.
    by : Identity
        Who imports; counts as the maker of the maps.
    folder : Path
        The folder, or a file.
    progress : callable
        Called with the number of files that are read, and of all.

    Raises
    ------
    FileError
        If the folder cannot be read.
    RefusedError
        If `by` may not import.
    StoreError
        If the store is lost; the objects before are in it, and another run takes the others.
    """
    with store.reading() as connection:
        check(connection, by, "import")
    content = read_folder(folder, progress)
    importer = _Importer(store, content)
    result = Imported(left_out=list(content.left_out), others=content.others)
    for one in content.objects:
        try:
            with changing(store, by, "import") as change:
                before = change.head
                importer.add(change, one)
                (result.known if change.head == before else result.taken).append(one)
        except (StoreError, RefusedError):
            raise
        except TrueposeError as error:
            result.left_out.append(LeftOut(one.path, str(error)))
    return result


class _Importer:
    """Adds the objects of a folder, and knows which of them belong together by where they lie."""

    def __init__(self, store: Store, content: FolderContent) -> None:
        self._store, self._content = store, content
        self._cells = {one.path.parent: one for one in reversed(content.objects) if one.kind == "cell"}
        self._samples: dict[Path, int] = {}

    def add(self, change: Change, one: FileObject) -> None:
        """Add an object."""
        match one.kind:
            case "cell":
                recording.add_cell(change, CellFile.of(one.path, one.content))
            case "samples":
                cell_id = self._cell(change, one.path)
                self._samples[one.path.resolve()] = recording.add_samples(change, cell_id, one.path, one.content)
            case "map":
                self._add_map(change, one)
            case "correction":
                recording.add_corrections(change, one.path.read_bytes(), one.content, self._content_of)
            case "verification":
                self._add_verification(change, one)

    def _add_map(self, change: Change, one: FileObject) -> None:
        error_map: ErrorMap = one.content
        if find(change.connection, schema.map, sha256=error_map.hash) is not None:
            return
        source = Path(error_map.samples.source)
        places = (source, one.path.parent / source, one.path.parent / source.name)
        sets = [self._samples[place.resolve()] for place in places if place.resolve() in self._samples][:1]
        cell_id = self._cell(change, one.path, error_map)
        parent = parent_of(self._store, change.connection, cell_id, error_map)
        if parent is not None:
            known = [row["id"] for row in reading_sets_of(change.connection, parent["id"])]
            sets = [*known, *self._appended(error_map, parent["figures"]["n"])]
        parent_id = None if parent is None else parent["id"]
        recording.add_map(change, cell_id, one.path, error_map, reading_sets=tuple(sets), parent_id=parent_id)

    def _appended(self, error_map: ErrorMap, n: int) -> list[int]:
        """Return the reading set of the folder that an update appended after the first n samples."""
        added = error_map.samples.p_meas[n:]
        tables = [one for one in self._content.objects if one.kind == "samples" and len(one.content) == len(added)]
        same = [one.path.resolve() for one in tables if len(added) and np.array_equal(one.content.p_meas, added)]
        return [self._samples[path] for path in same if path in self._samples][:1]

    def _add_verification(self, change: Change, one: FileObject) -> None:
        name = Path(one.content.program.replace("\\", "/")).name
        hashes = [sha for sha, path in self._content.by_hash.items() if path.name == name]
        outputs = [sha for sha in hashes if find(change.connection, schema.correction, output_sha256=sha) is not None]
        only = outputs[0] if len(outputs) == 1 else None
        recording.add_verification(change, one.content, one.path.read_bytes(), output_sha256=only)

    def _cell(self, change: Change, path: Path, error_map: ErrorMap | None = None) -> int:
        """Return the cell of a file: that of the cell file in its folder or above; a map may bring its own."""
        for folder in path.parents:
            if (file := self._cells.get(folder)) is not None:
                return recording.add_cell(change, CellFile.of(file.path, file.content))
        if error_map is None:
            raise DataError(f"no cell file lies in the folder of {path.name} or above; import the folder of the cell")
        own = error_map.cell
        return recording.add_cell(change, CellFile(path.resolve().parent.name, own.to_toml().encode(), own))

    @cached_property
    def _packed(self) -> dict[str, Path]:
        """The files in the .zip files of the folder, such as backups of controllers, by their SHA-256."""
        found: dict[str, Path] = {}
        for archive in self._content.archives:
            with suppress(TrueposeError):  # a file that is no .zip that can be read holds no original
                for path in files_within(archive).files:
                    found.setdefault(hashlib.sha256(read_bytes(path)).hexdigest(), path)
        return found

    def _content_of(self, sha256: str) -> bytes | None:
        path = self._content.by_hash.get(sha256) or self._packed.get(sha256)
        if path is not None:
            return read_bytes(path)
        with self._store.reading() as connection:
            known = connection.execute(sa.select(schema.blob.c.size).where(schema.blob.c.sha256 == sha256)).scalar()
        return None if known is None else self._store.read_blob(sha256)
