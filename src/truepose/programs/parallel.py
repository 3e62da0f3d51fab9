"""Correct many programs by an executor.

A program travels as it was read, so that workers need none of its files; the map travels as its file, by hash. Whether
a program was corrected before is checked where the lists of corrected programs are: in this process. A worker proves
its result if it can read the program again from the bytes that it has; otherwise this process proves it.
"""

from __future__ import annotations

import hashlib
import io
import pickle
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final

from truepose.cell import Cell
from truepose.error_map.bulk import share_map, shared_map
from truepose.error_map.map import ErrorMap
from truepose.errors import FileError, TrueposeError
from truepose.numerics.executor import Executor, Inputs, Task
from truepose.programs.core.program import Program
from truepose.programs.correct import correct_program
from truepose.programs.corrected import CorrectedProgram, RenderedParts
from truepose.programs.proof import proven_hashes, sha256_of
from truepose.programs.record import check_not_corrected

_LEVEL: Final = 1  # of compression: records shrink to a fifth
_PIECE: Final = 2**20  # bytes that are decompressed at once
Outcome = CorrectedProgram | TrueposeError


@dataclass(frozen=True)
class _Sent:
    """A corrected program on its way back: `data` refers to the program, `parts` are compressed."""

    data: bytes
    files: Mapping[Path, bytes]
    json_rows: bytes
    csv_rows: bytes


def correct_in_tasks(
    programs: Sequence[Program],
    error_map: ErrorMap,
    cell: Cell | None,
    executor: Executor,
    *,
    progress: Callable[[int, int], Any] = lambda _done, _all: None,
    **settings: Any,
) -> Iterator[tuple[Program, Outcome]]:
    """Yield programs in their order, each corrected or with the error that refuses it.

    Parameters
    ----------
    programs : sequence of Program
        The programs.
    error_map, cell
        The arguments of `correct_program`.
    executor : Executor
        Where they are corrected.
    progress : callable
        A function of the number of programs that are done, and of all.
    **settings
        The other options of `correct_program`.
    """
    shared = share_map(error_map, executor)
    here: dict[int, Outcome] = {}
    places: list[int] = []
    warned: list[list[str]] = []

    def tasks() -> Iterator[Task]:
        for place, program in enumerate(programs):
            try:
                told = check_not_corrected(program, error_map.path)
                task = _task(shared, program, error_map.path, cell, settings)
            except (TrueposeError, pickle.PicklingError, TypeError, AttributeError):  # the last three: not to be sent
                here[place] = _tried(program, error_map, cell, settings)
            else:
                places.append(place)
                warned.append(told)
                yield task

    spool = _Spool()
    found: dict[int, Outcome] = {}
    following = 0
    for index, sent in executor.run(correct_task, tasks()):
        program = programs[places[index]]
        done = sent if isinstance(sent, TrueposeError) else _received(program, sent, spool)
        if isinstance(done, CorrectedProgram):
            done = replace(done, warnings=(*warned[index], *done.warnings))
        found[places[index]] = done
        found |= here
        here.clear()
        progress(following + len(found), len(programs))
        while following in found:
            yield programs[following], found.pop(following)
            following += 1
    found |= here
    for place in range(following, len(programs)):
        yield programs[place], found[place]


def correct_task(inputs: Inputs, task: Task) -> _Sent | TrueposeError:
    """Correct a program in a worker."""
    data, path, cell, settings = task.values
    error_map = shared_map(inputs, task.inputs[0], path)
    program: Program = pickle.loads(data)
    try:
        one = correct_program(program, error_map, cell, proven=False, **settings)
    except TrueposeError as error:
        return error
    files: dict[Path, bytes] = {}
    if program.again is not None:
        try:
            one = replace(one, hashes=proven_hashes(one.targets, one.resolution))
        except (TrueposeError, OSError):  # files that only the process that asked has
            pass
        else:
            files = {s.path: _packed(one.content(s)) for s in program.sources}
    csv_rows = _Packed()
    json_rows = _packed(one.json_rows(csv_rows.add))
    return _Sent(_without(program, one), files, json_rows, csv_rows.end())


def _tried(program: Program, error_map: ErrorMap, cell: Cell | None, settings: Mapping[str, Any]) -> Outcome:
    try:
        return correct_program(program, error_map, cell, **settings)
    except TrueposeError as error:
        return error


def _task(shared: str, program: Program, path: Path | None, cell: Cell | None, settings: Mapping[str, Any]) -> Task:
    values = _dumped(program), path, cell, dict(settings)
    return Task((shared,), values, hashlib.sha256(pickle.dumps(values)).hexdigest())


def _dumped(program: Program) -> bytes:
    """Return a program as bytes; without the way to read it again if that cannot be sent."""
    try:
        return pickle.dumps(program)
    except (pickle.PicklingError, TypeError, AttributeError):
        return pickle.dumps(replace(program, again=None))


def _received(program: Program, sent: _Sent, spool: _Spool) -> Outcome:
    """Return a program that a worker has corrected, proven."""
    one = _with(program, sent.data)
    if not one.hashes:
        try:
            one = replace(one, hashes=proven_hashes(one.targets, one.resolution))
        except TrueposeError as error:
            return error
    for path, data in sent.files.items():
        if sha256_of(_unpacked([data])) != one.hashes[path]:
            return FileError(path, "the corrected file did not arrive whole; run again")
    files = {path: spool.add(data) for path, data in sent.files.items()}
    return replace(one, rendered=RenderedParts(files, spool.add(sent.json_rows), spool.add(sent.csv_rows)))


class _Packed:
    """Bytes that are compressed as they come."""

    def __init__(self) -> None:
        self._pack, self._parts = zlib.compressobj(_LEVEL), list[bytes]()

    def add(self, data: bytes) -> None:
        self._parts.append(self._pack.compress(data))

    def end(self) -> bytes:
        return b"".join([*self._parts, self._pack.flush()])


def _packed(pieces: Iterable[bytes]) -> bytes:
    packed = _Packed()
    for piece in pieces:
        packed.add(piece)
    return packed.end()


def _unpacked(parts: Iterable[bytes]) -> Iterator[bytes]:
    unpack = zlib.decompressobj()
    for part in parts:
        while part:
            yield unpack.decompress(part, _PIECE)
            part = unpack.unconsumed_tail
    yield unpack.flush()


class _Spool:
    """Parts in a temporary file, so that a million targets need no memory."""

    def __init__(self) -> None:
        self._file: BinaryIO = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the last part that refers to it

    def add(self, data: bytes) -> Callable[[], Iterator[bytes]]:
        start = self._file.seek(0, io.SEEK_END)
        self._file.write(data)
        return partial(self._read, start, len(data))

    def _read(self, start: int, size: int) -> Iterator[bytes]:
        return _unpacked(self._parts(start, start + size))

    def _parts(self, start: int, end: int) -> Iterator[bytes]:
        for place in range(start, end, _PIECE):
            self._file.seek(place)
            yield self._file.read(min(_PIECE, end - place))


def _parts(program: Program) -> list[Any]:
    return [program, program.targets, *program.sources]


def _without(program: Program, one: CorrectedProgram) -> bytes:
    """Return a corrected program as bytes that refer to the program and do not hold it."""
    known = {id(part): place for place, part in enumerate(_parts(program))}

    class Pickler(pickle.Pickler):
        def persistent_id(self, part: Any) -> int | None:
            return known.get(id(part))

    file = io.BytesIO()
    Pickler(file, pickle.HIGHEST_PROTOCOL).dump(one)
    return file.getvalue()


def _with(program: Program, data: bytes) -> CorrectedProgram:
    """Return a corrected program from bytes that refer to its program."""
    parts = _parts(program)

    class Unpickler(pickle.Unpickler):
        def persistent_load(self, place: Any) -> Any:
            return parts[place]

    found: CorrectedProgram = Unpickler(io.BytesIO(data)).load()
    return found
