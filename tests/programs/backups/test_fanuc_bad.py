"""Backups of FANUC that are incomplete, broken or contradictory."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.programs.backups import fanuc as corpus

from truepose.errors import FileError
from truepose.programs import FrameTable, ReadOptions
from truepose.programs.backups import fanuc
from truepose.programs.core.program import Program
from truepose.programs.core.target import Target
from truepose.programs.tp.reader import read

SMALL = """/PROG  SMALL
/ATTR
OWNER\t\t= MNEDITOR;
DEFAULT_GROUP\t= 1,*,*,*,*;
/MN
   1:  UFRAME_NUM=1 ;
   2:L P[1] 500mm/sec FINE    ;
   3:L PR[20:Home] 500mm/sec FINE    ;
/POS
P[1]{
   GP1:
\tUF : 1, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   100.000  mm,\tY =     0.000  mm,\tZ =    50.000  mm,
\tW =   180.000 deg,\tP =     0.000 deg,\tR =     0.000 deg
};
/END
"""
GERMAN = SMALL.replace("OWNER", "EIGN.").replace("DEFAULT_GROUP", "DEFAULT_GRUP").replace("CONFIG", "KONFIG")
GERMAN = GERMAN.replace("UFRAME_NUM", "BENUTZER_NUM").replace("mm/sec", "mm/sek")


def files(root: Path) -> list[Path]:
    return sorted(file for file in root.rglob("*") if file.is_file())


def lay(root: Path, texts: dict[str, str]) -> Path:
    for name, text in texts.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode("latin-1"))
    return root


def only(program: Program, name: str) -> Target:
    return next(target for target in program.targets if target.name == name)


def judged(root: Path) -> Program:
    ((program,),) = fanuc.contents(root, files(root)).programs
    stored = fanuc.stored_frames(root, files(root))
    frames = FrameTable(*({key: one.tf for key, one in table.items()} for table in (stored.tools, stored.bases)))
    return read(program, frames, ReadOptions(), **fanuc.for_reader(root, files(root)))


def test_programs_without_variables(tmp_path: Path) -> None:
    root = lay(tmp_path, {"SMALL.LS": SMALL, "SMALL.TP": ""})
    assert fanuc.roots(files(root)) == [root]
    (warning,) = fanuc.contents(root, files(root)).warnings
    assert "has no SYSFRAME.VA, so its tools and user frames are not known" in warning
    assert "UTOOL[1] is not known; give it in [frames.tools.1]" in only(judged(root), "P[1]").reason
    assert fanuc.roots([root / "SMALL.LS"]) == []  # an ordinary folder of programs


def test_compiled_programs_alone_are_named(tmp_path: Path) -> None:
    root = lay(tmp_path, {f"P{k:02}.TP": "" for k in range(12)} | {"BACKDATE.DT": ""})
    found = fanuc.contents(root, files(root))
    assert not found.programs
    (warning,) = found.warnings
    assert "12 programs are there in compiled form alone (.TP), which cannot be read: P00, P01, " in warning
    assert warning.count("P0") == 8


@pytest.mark.parametrize("folder", ["ENGLISH", "english", "ENGLISH.ZIP"])
def test_the_english_copy_is_used(tmp_path: Path, folder: str) -> None:
    root = lay(tmp_path, {"SMALL.TP": "", "GERMAN/SMALL.LS": GERMAN, f"{folder}/SMALL.LS": SMALL})
    assert fanuc.roots(files(root)) == [root]
    found = fanuc.contents(root, files(root))
    assert found.programs == [(root / folder / "SMALL.LS",)]
    assert found.others[root / "GERMAN/SMALL.LS"] == "copy"
    (root / "SMALL.LS").write_text(GERMAN)  # beside the compiled program, but not in English
    assert fanuc.contents(root, files(root)).programs == [(root / folder / "SMALL.LS",)]
    (root / "SMALL.LS").write_text(SMALL)
    assert fanuc.contents(root, files(root)).programs == [(root / "SMALL.LS",)]


def test_a_program_in_german_alone_is_refused_by_name(tmp_path: Path) -> None:
    root = lay(tmp_path, {"SMALL.TP": "", "GERMAN/SMALL.LS": GERMAN})
    with pytest.raises(FileError, match=r"SMALL\.LS:3: EIGN\. is a keyword of another language; give the English"):
        judged(root)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("  X:   900.000", "  X:   9#0.000", r"SYSFRAME\.VA:8: X: 9#0\.000 is not a number"),
        (
            "  W:     0.000   P:     0.000   R:    90.000",
            "",
            r"SYSFRAME\.VA:6: .* has no W, P, R: the file is truncated",
        ),
        ("    [1,2] = ", "    [1,1] = ", r"\$MNUFRAME\[1,1\] is given twice, first in line 6"),
        ("    [1,2] = ", "    [2] = ", r"SYSFRAME\.VA:10: \$MNUFRAME: expected \[group,number\]"),
    ],
)
def test_broken_variables_are_named_and_not_known(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = corpus.variables()["SYSFRAME.VA"]
    assert old in text
    root = lay(tmp_path, {"SMALL.LS": SMALL, "SYSFRAME.VA": text.replace(old, new, 1)})
    (warning,) = fanuc.contents(root, files(root)).warnings
    assert re.search(message, warning)
    assert "so its tools and user frames are not known" in warning
    assert not fanuc.stored_frames(root, files(root)).bases
    assert "UTOOL[1] is not known; give it in [frames.tools.1]" in only(judged(root), "P[1]").reason


def test_frames_that_contradict_each_other(tmp_path: Path) -> None:
    text = corpus.variables()["SYSFRAME.VA"]
    root = lay(tmp_path, {"SMALL.TP": "", "ENGLISH/SYSFRAME.VA": text, "GERMAN/SYSFRAME.VA": text})
    lay(root, {"ENGLISH/SMALL.LS": SMALL})
    assert only(judged(root), "P[1]").verdict == "correct"
    (root / "GERMAN/SYSFRAME.VA").write_text(text.replace("900.000", "901.000"))
    (warning,) = fanuc.contents(root, files(root)).warnings
    assert re.search(r"GERMAN/SYSFRAME\.VA: contradicts .*ENGLISH/SYSFRAME\.VA", warning)
    assert "UTOOL[1] is not known" in only(judged(root), "P[1]").reason
    lay(root, {"SYSFRAME.VA": text})  # of the controller itself
    np.testing.assert_allclose(fanuc.stored_frames(root, files(root)).bases[1].tf[0, 3], 900.0)


def test_broken_registers_count_as_unknown(tmp_path: Path) -> None:
    texts = {name: corpus.variables()[name] for name in ("SYSFRAME.VA", "POSREG.VA")}
    root = lay(tmp_path, {"SMALL.LS": SMALL, **texts})
    reason = "position register: its value stands in POSREG.VA, which is not written; teach a position instead"
    assert only(judged(root), "PR[20:Home]").reason == reason
    (root / "OTHER.LS").write_text(SMALL.replace("UFRAME_NUM=1", "PR[20:Home]=LPOS"))
    others = fanuc.for_reader(root, files(root))
    program = read(root / "SMALL.LS", FrameTable(), ReadOptions(), **others)
    assert "which OTHER may write" in only(program, "PR[20:Home]").reason
    (root / "OTHER.LS").unlink()
    (root / "POSREG.VA").write_text(texts["POSREG.VA"].replace("640.000", "640.0.0"))
    (warning,) = fanuc.contents(root, files(root)).warnings
    assert warning.endswith("correct the file; the registers count as unknown")
    assert only(judged(root), "PR[20:Home]").reason == "position register, known at run time only"


def test_another_robot_of_the_controller_has_frames_of_its_own(tmp_path: Path) -> None:
    text = corpus.variables()["SYSFRAME.VA"].replace("[2,3] = \n  Group: 1", "[2,3] = \n  Group: 2")
    lines = text.split("[2,3] = \n", 1)
    lines[1] = lines[1].replace("X:     0.000", "X:   500.000", 1)
    root = lay(tmp_path, {"SMALL.LS": SMALL, "SYSFRAME.VA": "[2,3] = \n".join(lines)})
    bases = fanuc.stored_frames(root, files(root)).bases
    assert (bases[3].tf[0, 3], bases["gp2-3"].tf[0, 3]) == (1180.0, 500.0)
