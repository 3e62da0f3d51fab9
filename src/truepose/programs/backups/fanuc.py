"""Backups of FANUC: .LS programs with SYSFRAME.VA, FRAMEVAR.VA and the registers.

A backup is a flat folder. Texts of programs (.LS) stand beside the compiled ones (.TP) or in a folder of their
language; the English ones are used.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from truepose._io.files import read_bytes
from truepose.errors import FileError
from truepose.programs.backups.controller import Contents, StoredFrame, StoredFrames
from truepose.programs.backups.fanuc_va import entries, numbers, transform
from truepose.programs.core.program import Key
from truepose.programs.core.source import Source, parse_number
from truepose.programs.tp.registers import ANYTHING, Effects, Registers, StoredRegister, effects_of
from truepose.programs.tp.words import is_english

_MARKS: Final = re.compile(
    r"(?:backdate\.dt|(?:sysframe|framevar|posreg|numreg|symotn|sysmast|sysvars)\.(?:va|sv|vr)|(?:version|summary)\.dg"
    r"|.+\.tp)",
    re.I,
)
"""Names of files that only a backup of FANUC has."""
_LANGUAGE: Final = re.compile(
    r"(?:english|german|french|spanish|italian|portuguese|japanese|chinese|czech|polish)\b", re.I
)
_KINDS: Final = {
    ".tp": "compiled program", ".pc": "compiled program", ".sv": "encoded", ".vr": "encoded", ".io": "encoded",
    ".va": "variables", ".dg": "diagnosis", ".dt": "data", ".cm": "commands", ".cf": "commands",
}  # fmt: skip
_PROG: Final = re.compile(rb"^[ \t]*/PROG\b", re.I | re.M)
_HEAD: Final = 1 << 16
_SHOWN: Final = 8
_ROBOT: Final = re.compile(rb"\$SCR_GRP\[(\d+)\]\.\$ROBOT_ID\b[^=\r\n]*=[ \t]*'([^'\r\n]*)'", re.I)
_VERSION: Final = re.compile(rb"(?:\$VERSION|Version)[ \t]*:[ \t]*([\w./-]+)", re.I)
_COMMENT: Final = re.compile(
    rb"SETUP_DATA[ \t]*\[(\d+),[ \t]*(\d+),[ \t]*(\d+)\]\.\$COMMENT\b[^=\r\n]*=[ \t]*'([^'\r\n]*)'", re.I
)
_TABLES: Final = {b"$MNUTOOL": ("tools", 1), b"$MNUFRAME": ("bases", 3)}
"""The arrays of frames, with the number of their kind in the comments of FRAMEVAR.VA."""
_NUMREG: Final = re.compile(rb"[ \t]*([-+.\deE]+)")


def roots(files: Sequence[Path]) -> list[Path]:
    """Return the folders of the controllers among the files of a backup.

    A single file such as a .TP makes none where no text of a program (.LS) lies beside it.
    """
    marks = Counter(file.parent for file in files if _MARKS.fullmatch(file.name))
    texts = [file.parent for file in files if file.suffix.lower() == ".ls"]
    beside = {*texts, *(folder.parent for folder in texts if _LANGUAGE.match(folder.name))}
    marked = {folder for folder, n in marks.items() if n > 1 or folder in beside}
    return sorted(folder for folder in marked if not (_LANGUAGE.match(folder.name) and folder.parent in marked))


def contents(root: Path, files: Sequence[Path]) -> Contents:
    """Return the files of one controller, sorted.

    The English text of a program is the one in the root, else that in a folder ENGLISH. Texts in other languages stand
    among the others if there is an English one, and are refused by the reader if not.
    """
    own = _own(root, files)
    others = {file: kind for file in own if (kind := _KINDS.get(file.suffix.lower()))}
    copies: dict[str, list[Path]] = {}
    for file in own:
        if file.suffix.lower() == ".ls":
            if _is_program(file):
                copies.setdefault(file.stem.upper(), []).append(file)
            else:
                others[file] = "log"
    programs: list[Path] = []
    for found in copies.values():
        first, *rest = sorted(found, key=partial(_rank, root)) if len(found) > 1 else found
        programs.append(first)
        others.update(dict.fromkeys(rest, "copy"))
    order = {file: k for k, file in enumerate(own)}
    return Contents(
        [(file,) for file in sorted(programs, key=order.__getitem__)],
        others,
        list(_warnings(root, own, copies)),
        _found(_robots(root, own)),
        _found(_versions(root, own)),
    )


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    """Return the tools and bases of one controller.

    The key of a frame is its number for motion group 1, and such as ``gp2-3`` for number 3 of group 2. None are known
    where SYSFRAME.VA is missing or broken; then `contents` has a warning.
    """
    try:
        return _frames(root, files)
    except FileError:
        return StoredFrames()


def _frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    tables: dict[str, dict[Key, StoredFrame]] = {"tools": {}, "bases": {}}
    file = _named(root, files, "sysframe.va")
    if file is None:
        return StoredFrames()
    source, names = Source.read(file), _names(root, files)
    for array, (table, kind) in _TABLES.items():
        for entry in entries(source, array):
            if len(entry.indices) != 2:
                raise source.error(entry.line, f"{array.decode()}: expected [group,number]; correct the file")
            values = numbers(source, entry)
            if values is None:
                continue
            group, number = entry.indices
            place = f"{file.name}, line {entry.line}"
            name = names.get((group, kind, number), "")
            tables[table][_key(group, number)] = StoredFrame(transform(values), name, place)
    return StoredFrames(tables["tools"], tables["bases"])


def for_reader(root: Path, files: Sequence[Path]) -> dict[str, Any]:
    """Return the registers of one controller, as `truepose.programs.tp.reader.read` takes them."""
    programs: dict[str, Effects] = {}
    for (file,) in contents(root, files).programs:
        try:
            programs[file.stem.upper()] = effects_of(read_bytes(file))
        except FileError:  # its own reader tells why
            programs[file.stem.upper()] = ANYTHING
    try:
        stored = _position_registers(root, files), _numeric_registers(root, files)
    except FileError:  # a warning of `contents`
        return {"registers": Registers(programs=programs)}
    return {"registers": Registers(*stored, programs)}


def _own(root: Path, files: Sequence[Path]) -> list[Path]:
    """Return the files of a root, and of its folders of languages, which may be a .zip."""
    return [file for file in files if file.is_relative_to(root) and _is_own(file.relative_to(root).parts)]


def _is_own(parts: tuple[str, ...]) -> bool:
    return len(parts) == 1 or _LANGUAGE.match(parts[0]) is not None


def _rank(root: Path, file: Path) -> tuple[bool, bool, bool]:
    """Return the place of a copy among those of one program: English ones first, those in the root before others."""
    try:
        english = is_english(read_bytes(file))
    except FileError:
        english = False
    folder = file.relative_to(root).parts[0]
    return not english, file.parent != root, not folder.lower().startswith("english")


def _is_program(file: Path) -> bool:
    try:
        return _PROG.search(read_bytes(file), 0, _HEAD) is not None
    except FileError:
        return True  # its own reader tells why


def _warnings(root: Path, own: Sequence[Path], copies: Mapping[str, Sequence[Path]]) -> Iterator[str]:
    names = sorted({file.stem.upper() for file in own if file.suffix.lower() == ".tp"} - copies.keys())
    if names:
        shown = ", ".join(names[:_SHOWN]) + (", …" if len(names) > _SHOWN else "")
        yield (
            f"{root}: {len(names)} programs are there in compiled form alone (.TP), which cannot be read: {shown}; "
            "save them in text form (.LS), which the controller does with the option ASCII upload"
        )
    try:
        missing = "" if _named(root, own, "sysframe.va") else f"{root}: has no SYSFRAME.VA"
        _frames(root, own)
    except FileError as error:
        missing = str(error)
    if copies and missing:
        yield (
            f"{missing}, so its tools and user frames are not known; give that file, or state them in "
            "[frames.tools.1], [frames.bases.1] … of the cell file"
        )
    try:
        _position_registers(root, own), _numeric_registers(root, own)
    except FileError as error:
        yield f"{error}; the registers count as unknown"


def _named(root: Path, files: Sequence[Path], name: str) -> Path | None:
    """Return the file of a name in the root, else in a folder of a language; several there must be equal."""
    found = [file for file in _own(root, files) if file.name.lower() == name]
    here = [file for file in found if file.parent == root] or found
    for file in here[1:]:
        if read_bytes(file) != read_bytes(here[0]):
            raise FileError(file, f"contradicts {here[0]}; keep the one that is valid")
    return here[0] if here else None


def _names(root: Path, files: Sequence[Path]) -> dict[tuple[int, int, int], str]:
    """Return the comments of frames by group, kind and number."""
    if (file := _named(root, files, "framevar.va")) is None:
        return {}
    return {
        (int(m[1]), int(m[2]), int(m[3])): m[4].decode("latin-1").strip()
        for m in _COMMENT.finditer(Source.read(file).data)
    }


def _key(group: int, number: int) -> Key:
    return number if group == 1 else f"gp{group}-{number}"


def _position_registers(root: Path, files: Sequence[Path]) -> dict[tuple[int, int], StoredRegister]:
    if (file := _named(root, files, "posreg.va")) is None:
        return {}
    source = Source.read(file)
    found = {}
    for entry in entries(source, b"$POSREG"):
        group, number = entry.indices if len(entry.indices) == 2 else (1, entry.indices[0])
        found[group, number] = StoredRegister(numbers(source, entry), entry.name)
    return found


def _numeric_registers(root: Path, files: Sequence[Path]) -> dict[int, float]:
    if (file := _named(root, files, "numreg.va")) is None:
        return {}
    source, found = Source.read(file), dict[int, float]()
    for entry in entries(source, b"$NUMREG"):
        if m := _NUMREG.match(entry.text):
            try:
                found[entry.indices[-1]] = parse_number(m[1])
            except ValueError:
                continue  # beyond any length or angle: no shift
    return found


def _robots(root: Path, own: Sequence[Path]) -> Iterator[str]:
    if file := _named(root, own, "symotn.va"):
        yield from (m[2].decode("latin-1").strip() for m in _ROBOT.finditer(Source.read(file).data))


def _versions(root: Path, own: Sequence[Path]) -> Iterator[str]:
    for name in ("version.dg", "summary.dg", "backdate.dt"):
        if (file := _named(root, own, name)) and (m := _VERSION.search(Source.read(file).data)):
            yield m[1].decode("latin-1")
            return


def _found(words: Iterator[str]) -> str:
    return ", ".join(dict.fromkeys(word for word in words if word))
