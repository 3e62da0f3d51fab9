"""What in a folder is no program, although it has the ending of one: it is named, and the rest is read."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.programs.example import FRAMES

from truepose.errors import FileError
from truepose.programs import ReadOptions, read_program, read_programs
from truepose.programs.languages import LANGUAGES

GOOD = (
    "MODULE m\n"
    "CONST robtarget p1:=[[600,0,800],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    "PROC main()\nMoveL p1,v100,z10,tGrip;\nENDPROC\nENDMODULE\n"
)
ENDINGS = [ending for name, one in LANGUAGES.items() for ending in one.endings if name not in ("krl", "table")]
BLANK = (b"", b"\r\n", b"\xef\xbb\xbf", b" \n\t\n")
EMPTY_DATA = "<Database><Datas/></Database>"
NO_PROGRAMS = {
    "alarm.jbi": "Alarm history\r\n1, 2\r\n",
    "modem.mod": "modem log\n12:00 started\n",
    "trace.sys": "system log (\n",
    "manual.prg": "%PDF-1.4 x",
    "run.nc": "log of a run\n12:00 started\n",
    "picture.tap": "\0\1\2",
    "cap.urp": "<URCap/>",
    "errall.ls": 'ERRALL.LS     Robot Name ROBOT 01-JAN-24 10:00:00\n\n1" 01-JAN-24 SYST-026 System normal power up\n',
    "include.script": "global speed=0.25\nglobal home=[0,-1.57,0,-1.57,0,0]\n",
    "a.dtx": f'<?xml version="1.0" encoding="utf-8"?>\n{EMPTY_DATA}\n',
    "b.dtx": "<Database/>",
    "notes.apt": "$$ nothing here\n",
}


def empty_zip() -> bytes:
    found = io.BytesIO()
    zipfile.ZipFile(found, "w").close()
    return found.getvalue()


def read_beside(folder: Path, name: str, content: bytes) -> list[str]:
    """Return what is said of a file beside a program, which must be read."""
    (folder / "good.mod").write_text(GOOD)
    (folder / name).write_bytes(content)
    found = read_programs([folder], FRAMES, ReadOptions(whole_task=True))
    assert [(t.name, t.verdict) for p in found.programs for t in p.targets] == [("p1", "correct")]
    assert not found.unreadable
    return [text for text in found.left_out if name in text]


@pytest.mark.parametrize("ending", [*ENDINGS, ".installation", ".pjx", ".tp"])
@pytest.mark.parametrize("content", BLANK)
@pytest.mark.sampled(12)
def test_an_empty_file_is_named_and_blocks_nothing(tmp_path: Path, ending: str, content: bytes) -> None:
    (text,) = read_beside(tmp_path, f"x{ending}", content)
    assert "is empty and is left out" in text


@pytest.mark.parametrize("ending", ENDINGS)
def test_an_empty_file_that_is_given_by_name_is_an_error(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"x{ending}"
    path.write_bytes(b"")
    with pytest.raises(FileError):
        read_program(path)


@pytest.mark.parametrize("content", [b"", empty_zip()])
def test_an_empty_zip_is_named_and_blocks_nothing(tmp_path: Path, content: bytes) -> None:
    (text,) = read_beside(tmp_path, "backup.zip", content)
    assert text.endswith("it is left out")
    with pytest.raises(FileError, match=r"backup\.zip: is "):
        read_program(tmp_path / "backup.zip")


@pytest.mark.parametrize("name", NO_PROGRAMS)
def test_logs_includes_and_data_without_values_are_no_programs(tmp_path: Path, name: str) -> None:
    (text,) = read_beside(tmp_path, name, NO_PROGRAMS[name].encode())
    assert text.endswith("it is left out")
    with pytest.raises(FileError):
        read_program(tmp_path / name)


def test_check_names_them_and_succeeds(tmp_path: Path, run: Callable[..., Any]) -> None:
    read_beside(tmp_path, "errall.ls", NO_PROGRAMS["errall.ls"].encode())
    (tmp_path / "truncated.ls").write_text("/PROG  A\n/MN\n")
    assert "truncated.ls" in run("check", tmp_path, "--whole-task").failed()
    (tmp_path / "truncated.ls").unlink()
    found = run("check", tmp_path, "--whole-task")
    assert (found.code, "has no /PROG" in found.out + found.err) == (0, True)
