"""A format of backups for the tests of what all makers share: controller.txt, KRL programs, frames.txt, logs."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from truepose._io.files import read_bytes
from truepose.programs.backups.controller import Contents, StoredFrame, StoredFrames

PROGRAM = "DEF {name}()\n$TOOL=TOOL_DATA[1]\n$BASE=BASE_DATA[{base}]\nLIN {{X {x},Y 2.5,Z 300,A 0,B 0,C 0}}\nEND\n"
FRAMES = "tool 1 0 0 150 probe\nbase 1 900 0 0 table\nbase 2 0 0 0 -\n"


def files_of(robot: str = "KR 10", *, first: float = 10.0, n: int = 2, frames: str = FRAMES) -> dict[str, bytes]:
    """Return the files of a controller with n programs."""
    made = {"controller.txt": robot.encode(), "Frames.TXT": frames.encode(), "run.log": b"LIN {X 1" * 400}
    for k in range(n):
        text = PROGRAM.format(name=f"p{k}", base=1, x=first + k)
        made[f"programs/p{k}.src"] = text.replace("\n", "\r\n").encode()
    return made


def lay(folder: Path, files: Mapping[str, bytes]) -> Path:
    """Write files below a folder."""
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder


def packed(files: Mapping[str, bytes], *, comment: bytes = b"") -> bytes:
    """Return a .zip with time stamps, attributes and comments of its own."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for k, (name, data) in enumerate(files.items()):
            info = zipfile.ZipInfo(name, (2019, 3, 1 + k % 28, 12, 30, 2 * (k % 30)))
            info.external_attr, info.comment = (0o640 << 16) | 0x20, f"no {k}".encode()
            info.compress_type = zipfile.ZIP_STORED if k % 3 == 2 else zipfile.ZIP_DEFLATED
            archive.writestr(info, data, compresslevel=9 - k % 3)
        archive.comment = comment
    return out.getvalue()


def roots(files: Sequence[Path]) -> list[Path]:
    return [file.parent for file in files if file.name.lower() == "controller.txt"]


def contents(root: Path, files: Sequence[Path]) -> Contents:
    own = [file for file in files if file.is_relative_to(root)]
    programs = tuple(file for file in own if file.suffix.lower() in (".src", ".dat"))
    logs = {file: "log" for file in own if file.suffix.lower() == ".log"}
    (head,) = (file for file in own if file.name.lower() == "controller.txt")
    told = ["a.tp: is compiled"] if any(file.name == "a.tp" for file in own) else []
    return Contents([programs] if programs else [], logs, told, robot=read_bytes(head).decode())


def stored_frames(root: Path, files: Sequence[Path]) -> StoredFrames:
    found: dict[str, dict[int | str, StoredFrame]] = {"tool": {}, "base": {}}
    for file in files:
        if file.name.lower() == "frames.txt" and file.is_relative_to(root):
            for number, line in enumerate(read_bytes(file).decode().splitlines(), 1):
                which, key, x, y, z, name, *problem = line.split()
                tf = np.eye(4)
                tf[:3, 3] = float(x), float(y), float(z)
                place = f"{file.name}, line {number}"
                found[which][int(key)] = StoredFrame(tf, name.strip("-"), place, " ".join(problem))
    return StoredFrames(found["tool"], found["base"])
