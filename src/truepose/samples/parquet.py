"""Tables of poses in Parquet, read and written in parts, so that 10⁸ rows need no memory; needs pyarrow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from truepose._extras import needed
from truepose._io.delimited import TextTable
from truepose._io.files import check_regular, writing
from truepose._io.strict import LARGEST
from truepose._typing import FloatArray
from truepose.errors import FileError
from truepose.samples.checks import check
from truepose.samples.frames import quantities
from truepose.samples.table import Poses

ENDINGS: Final = (".parquet", ".pq")
_LARGEST_FILE: Final = 2**40
_BUFFER: Final = 2**20  # bytes of each column that are read at once


def is_parquet(path: str | Path) -> bool:
    """Return whether a path names a table in Parquet, by its ending."""
    return Path(path).suffix.lower() in ENDINGS


@dataclass(frozen=True)
class _Numbers(TextTable):
    """A table of numbers for the readers of text."""

    values: FloatArray

    def numbers(self, columns: Sequence[int]) -> FloatArray:
        """Return columns of numbers."""
        values = self.values[:, list(columns)]
        bad = np.argwhere(np.isfinite(values) & (np.abs(values) > LARGEST))
        if len(bad):
            row, k = bad[0]
            name = self.header[columns[k]]
            raise FileError(self.path, f"{name} is {values[row, k]:g}, beyond {LARGEST:g}", line=int(self.line[row]))
        return values


class ParquetTable:
    """A table in Parquet that is read in parts.

    Parameters
    ----------
    path : str or Path
        The file.

    Raises
    ------
    FileError
        If the file is not a table in Parquet.
    MissingPackageError
        If pyarrow is not installed.
    """

    def __init__(self, path: str | Path) -> None:
        arrow, parquet = _pyarrow()
        self.path = Path(path)
        try:
            check_regular(path, _LARGEST_FILE)
            # neither whole columns nor whole row groups in memory
            self._file = parquet.ParquetFile(self.path, buffer_size=_BUFFER, pre_buffer=False)
        except FileNotFoundError:
            raise FileError(path, "no such file") from None
        except (OSError, arrow.ArrowException) as error:
            if isinstance(error, FileError):
                raise
            raise FileError(path, f"is not a table in Parquet ({error}); write it again") from None

    def __len__(self) -> int:
        return int(self._file.metadata.num_rows)

    def parts(self, rows: int) -> Iterator[tuple[Any, Poses]]:
        """Yield parts of the table, pyarrow's batches, each with its poses; rows in messages count from 1.

        Raises
        ------
        FileError, DataError
            If the columns are not those of a tidy table, or values are no numbers or implausible.
        """
        arrow, _ = _pyarrow()
        first = 1
        try:
            for batch in self._file.iter_batches(batch_size=rows):
                yield batch, self._poses(batch, first)
                first += len(batch)
        except (OSError, arrow.ArrowException) as error:
            if isinstance(error, FileError):
                raise
            raise FileError(self.path, f"cannot be read to its end ({error}); write it again") from None
        if first == 1:
            raise FileError(self.path, "has no rows; at least one pose is required")

    def _poses(self, batch: Any, first: int) -> Poses:
        arrow, _ = _pyarrow()
        kinds = {field.name: field.type for field in batch.schema}
        names = [name for name, kind in kinds.items() if arrow.types.is_floating(kind) or arrow.types.is_integer(kind)]
        columns = [batch.column(name).to_numpy(zero_copy_only=False).astype(np.float64) for name in names]
        values = np.column_stack(columns) if columns else np.empty((len(batch), 0))
        lines = np.arange(first, first + len(batch))
        shown = np.broadcast_to(np.array("not a number"), values.shape)  # of fields that are not finite
        poses = Poses(
            **quantities(_Numbers(self.path, ",", names, 0, shown, lines, values), measured=False),
            line=lines,
            source=str(self.path),
        )
        check(poses)
        return poses


def write_parts(path: str | Path, parts: Iterable[tuple[Any, Mapping[str, FloatArray]]]) -> None:
    """Write parts of a table with further columns at the end, whole or not at all; each part is a row group.

    Columns of the same name are replaced.
    """
    arrow, parquet = _pyarrow()
    writer = None
    with writing(path) as (file,):
        try:
            for batch, columns in parts:
                kept = [name for name in batch.schema.names if name not in columns]
                arrays = [*(batch.column(name) for name in kept), *(arrow.array(values) for values in columns.values())]
                table = arrow.table(dict(zip([*kept, *columns], arrays, strict=True)))
                writer = writer or parquet.ParquetWriter(file, table.schema)
                writer.write_table(table)
        except BaseException:
            with suppress(OSError, arrow.ArrowException):
                _end(writer)  # before its file is closed
            raise
        _end(writer)


def _end(writer: Any) -> None:
    if writer is not None:
        writer.close()


def _pyarrow() -> tuple[Any, Any]:
    with needed("a table in Parquet", "scale"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow, pyarrow.parquet
