"""Each word of a RAPID routine is understood by some rule, or distrusted."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from tests.programs.corpus_rapid import RAPID
from tests.programs.executors.rapid_check import text_of
from tests.programs.executors.rapid_programs import random_task
from tests.programs.hazards import rapid as hazards

from truepose.errors import FileError
from truepose.programs import FrameTable, Program, ReadOptions, read_program
from truepose.programs.rapid.names import ModuleNames

RT = "[[600,0,800],[0,0,-1,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]]"
FRAMES = FrameTable(tools={"t": np.eye(4)}, bases={"w": np.eye(4)})
DATA = f"CONST robtarget p1:={RT};\nCONST robtarget p2:={RT};\nVAR num h;\n"
MOVE = "MoveL p1,v100,z10,t\\WObj:=w;"
SHIFT = "PDispSet [[0,0,30],[1,0,0,0]];"


def read(folder: Path, code: str, more: str = "PROC foo()\nENDPROC", **options: Any) -> Program:
    path = folder / "a.mod"
    path.write_text(f"MODULE m\n{DATA}PROC main()\n{code}\nPDispOff;\nENDPROC\n{more}\nENDMODULE\n", encoding="utf-8")
    return read_program(path, FRAMES, ReadOptions(**{"whole_task": True, **options}))


def verdict(program: Program, name: str) -> str:
    (found,) = {target.verdict for target in program.targets if target.name == name}
    return found


@pytest.fixture
def left(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the words that no rule took, as they are found."""
    found: list[str] = []
    original = ModuleNames.take_rest

    def take_rest(self: ModuleNames, items: Any, line: int) -> None:
        for before, token in zip([None, *items], items, strict=False):
            known = token.start in self.taken or (before is not None and before.text in (".", "\\"))
            found.extend([token.text] * (token.kind == "word" and not known))
        original(self, items, line)

    monkeypatch.setattr(ModuleNames, "take_rest", take_rest)
    return found


def test_no_word_of_the_corpus_is_left(tmp_path: Path, left: list[str]) -> None:
    for example in RAPID.values():
        for name, data in example.data().items():
            (tmp_path / name).write_bytes(data)
            read_program(tmp_path / name, example.frames, example.options)
    assert left == []


def test_no_word_of_random_programs_is_left(tmp_path: Path, left: list[str]) -> None:
    for seed in range(12):
        folder = tmp_path / str(seed)
        folder.mkdir()
        for name, lines in random_task(Random(seed)).items():
            (folder / name).write_text(text_of(lines))
        read_program(folder, FrameTable(), ReadOptions(whole_task=True, derived=True))
    assert left == []


def test_words_of_the_hazards_are_left_only_where_they_are_not_understood(tmp_path: Path, left: list[str]) -> None:
    understood = [key for key in hazards.CELLS if key not in ("unknown-statement", "argument-by-name")]
    for cell in (cell for key in understood for cell in hazards.CELLS[key]):
        (path,) = [tmp_path / name for name in cell.files]
        path.write_text(cell.files[path.name], encoding="utf-8")
        read_program(path, FrameTable(), cell.options)
    assert left == []


@pytest.mark.promise(
    "A RAPID statement that is not understood distrusts what it names, and what is in force behind it."
)
@pytest.mark.parametrize(
    "code",
    [
        f"<ABC>\n{SHIFT}", f"@@ {SHIFT}", f"foo {SHIFT}", f"foo h {SHIFT}", f"h:=5\n{SHIFT}", f"Set do1\n{SHIFT}",
        f"VAR num n\n{SHIFT}", f"VAR num n:=5\n{SHIFT}", f"MoveL p2,v100,z10,t\\WObj:=w\n{SHIFT}", f"h:=0x1F\n{SHIFT}",
        f"IF h=5 <SMT>\n{SHIFT}", f"IF h=5 h:=5\n{SHIFT}",
    ],
)  # fmt: skip
def test_a_statement_does_not_swallow_a_displacement(tmp_path: Path, code: str) -> None:
    assert verdict(read(tmp_path, f"{code}\n{MOVE}"), "p1") == "refuse"


@pytest.mark.parametrize(
    "code", ["foo p1 h;", "p1 h;", "@@ p1;", "Set p1 do1;", "IF h=5 <EXP>:=p1 h;", "VAR num n p1;"]
)
def test_what_is_not_understood_is_read(tmp_path: Path, code: str) -> None:
    assert verdict(read(tmp_path, f"{MOVE}\n{code}\nEOffsOff;"), "p1") != "correct"
    assert verdict(read(tmp_path, f"{MOVE}\n{code.replace('p1', 'p2')}\nEOffsOff;"), "p1") == "correct"


@pytest.mark.parametrize("word", ["ENDPROC", "ENDIF", "PROC foo()", "CONST num n:=5;", "ELSE"])
def test_a_structure_needs_a_semicolon_in_front(tmp_path: Path, word: str) -> None:
    with pytest.raises(FileError, match="the statement TPWRITE … has no semicolon"):
        read(tmp_path, f'TPWrite "x"\n{word}\n{MOVE}')


@pytest.mark.parametrize(
    "code",
    [
        "h:=h-5;", "h:=h -5;", "h:=5 MOD 2;", "h:=-5;", "h:=k{1}*2-k{2};", "IF h=5 AND NOT b Set do1;", "%\"foo\"%;",
        "CONNECT i1 WITH tr;", "MoveL\\Conc,p2,v100,z10,t\\WObj:=w;", "MoveL *,v100,z10,t;", "h:=Abs(-5)+(3-2);",
        "IF h=0xFF foo;", "IF h=0b1 AND b foo;", "WaitTime\\InPos,0.2;", "Load\\Dynamic,\"HOME:\"\\File:=\"a.mod\";",
        "<SMT>", "IF <EXP> THEN\n<SMT>\nELSEIF <EXP> THEN\n<SMT>\nELSE\n<SMT>\nENDIF", "TEST <EXP>\n<CSE>\nENDTEST",
        "<SMT>;", "foo\\a\\b:=5,7;", "IF h=5 <SMT>\n", "again:\nIF h<3 GOTO again;", "h:=GInput(gi1) DIV 2;",
    ],
)  # fmt: skip
def test_statements_that_are_understood(tmp_path: Path, code: str) -> None:
    assert verdict(read(tmp_path, f"{code}\n{MOVE}"), "p1") == "correct"


@pytest.mark.promise("Blanks of Unicode are blanks in RAPID, too.")
@pytest.mark.parametrize("blank", ["\u00a0", "\u3000", "\u2003", "\u200b", "\ufeff", "\u202f", "\u2028"])
def test_blanks_of_unicode(tmp_path: Path, blank: str) -> None:
    text = f"{blank}\nCONST{blank}robtarget{blank}p3:={RT};{blank}\n{blank}PROC foo()\n{blank}ENDPROC"
    program = read(tmp_path, f"{blank}{MOVE}\n{blank}MoveL{blank}p3,v100,z10,t\\WObj:=w;", text)
    assert [verdict(program, name) for name in ("p1", "p3")] == ["correct", "correct"]


def test_blanks_of_other_encodings(tmp_path: Path) -> None:
    for blank in (b"\xa0", b"\xa1\xa1"):
        (tmp_path / "a.mod").write_bytes(b"MODULE m\n%bCONST robtarget p1:=%b;\nPROC main()\n%b\nENDPROC\nENDMODULE" % (
            blank, RT.encode(), MOVE.encode()
        ))  # fmt: skip
        assert verdict(read_program(tmp_path / "a.mod", FRAMES, ReadOptions(whole_task=True)), "p1") == "correct"
    letter = "p\u4e20".encode()  # e4 b8 a0: the last byte is no blank
    code = MOVE.encode().replace(b"p1", letter)
    (tmp_path / "a.mod").write_bytes(b"MODULE m\nCONST robtarget %b:=%b;\nPROC main()\n%b\nENDPROC\nENDMODULE" % (
        letter, RT.encode(), code
    ))  # fmt: skip
    assert read_program(tmp_path / "a.mod", FRAMES, ReadOptions(whole_task=True)).counts()["correct"] == 1


def test_an_alias_of_a_type_hides_data_of_the_task(tmp_path: Path) -> None:
    frame = '[FALSE,TRUE,"",[[0,0,{}],[1,0,0,0]],[[0,0,0],[1,0,0,0]]]'
    (tmp_path / "a.mod").write_text(
        f"MODULE a\n{DATA}PERS wobjdata w:={frame.format(5)};\nPROC main()\ngo;\nENDPROC\nENDMODULE"
    )
    local = f"ALIAS wobjdata wd;\nLOCAL PERS wd w:={frame.format(300)};"
    (tmp_path / "b.mod").write_text(f"MODULE b\n{local}\nPROC go()\n{MOVE}\nENDPROC\nENDMODULE")
    program = read_program(tmp_path, FrameTable(tools={"t": np.eye(4)}), ReadOptions(whole_task=True))
    (target,) = [target for target in program.targets if target.name == "p1"]
    assert target.tf_base_frame is not None
    np.testing.assert_allclose(target.tf_base_frame[:3, 3], [0, 0, 300])
    (tmp_path / "b.mod").write_text(f"MODULE b\nLOCAL PERS bool w;\nPROC go()\n{MOVE}\nENDPROC\nENDMODULE")
    program = read_program(tmp_path, FrameTable(tools={"t": np.eye(4)}), ReadOptions(whole_task=True))
    assert verdict(program, "p1") == "refuse"


@pytest.mark.promise(
    "A tool that a procedure gets as PERS counts as changed only where the procedure, or one it calls, writes it."
)
@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        ("MoveL p2,v100,z10,t\\WObj:=o;", "correct"),
        ("h:=o.uframe.trans.x;", "correct"),
        ("o.uframe.trans.x:=5;", "refuse"),
        ("b:=StrToVal(s,o);", "refuse"),
        ("inner\\o?o;", "refuse"),
        ("inner\\o:=o;", "refuse"),
        ("%\"outer\"% o;", "refuse"),
    ],
)  # fmt: skip
def test_tools_and_work_objects_as_pers(tmp_path: Path, body: str, wanted: str) -> None:
    more = (
        f"PROC outer(\\PERS wobjdata o)\n{body}\nENDPROC\nPROC inner(\\PERS wobjdata o)\no.oframe.trans.z:=5;\nENDPROC"
    )
    assert verdict(read(tmp_path, f"{MOVE}\nouter\\o:=w;", more), "p1") == wanted
