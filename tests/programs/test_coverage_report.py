"""How much of programs is corrected, and the one table of options: complete, and true."""

from __future__ import annotations

import ast
import csv
import io
import re
from collections.abc import Iterator
from dataclasses import fields
from html.parser import HTMLParser
from pathlib import Path

import pytest
from tests.programs.conftest import FakeMap

import truepose
from truepose._io.delimited import unescaped
from truepose.errors import FileError
from truepose.programs import Coverage, ReadOptions, correct_program, read_program, read_programs
from truepose.programs.core.remedies import FRAMES, GROUPS, REMEDIES, remedy_of
from truepose.report.coverage import write_coverage

POSE = "{X 1,Y 2,Z 3,A 0,B 0,C 0}"
TEXT = f"""DEF a()
$TOOL=$NULLFRAME
$BASE=$NULLFRAME
LIN {POSE}
LIN {POSE}
LIN_REL {{X 1}}
LIN {{X 1,Y 2,Z 3,A 0,B 0,C 0,E1 5}}
BAS(#TOOL,4)
LIN {POSE}
BAS(#TOOL,5)
LIN {POSE}
END
"""
NO_REASON = {
    *("--match", "--unit", "--register", "--uncertainty", "--tolerance", "--cell", "--config-dat", "--force"),
    *(
        "--other-maker",
        "--other-robot",
        "--this-robot",
        "--store",
        "--controller",
        "--whole",
        "--in-place",
        "--out",
        "--keep-going",
        "--accept-weak-map",
    ),
}
"""Options of messages that are no reasons of targets."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "a.src").write_text(TEXT)
    return tmp_path / "a.src"


def texts() -> Iterator[tuple[str, str]]:
    """Yield the texts of the library's modules on programs that are no documentation, each with its module."""
    folder = Path(truepose.__file__).parent / "programs"
    for file in sorted(folder.rglob("*.py")):
        if file.name == "remedies.py":
            continue
        tree = ast.parse(file.read_text())
        documented = {
            id(node.value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        }
        for node in ast.walk(tree):
            joined = isinstance(node, ast.JoinedStr)
            if joined or (
                isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documented
            ):
                parts = node.values if isinstance(node, ast.JoinedStr) else [node]
                text = "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in parts)
                yield file.name, text


@pytest.mark.exhaustive
def test_every_option_that_a_reason_names_is_in_the_table() -> None:
    named = {option for one in REMEDIES for option in re.split(", ", one.option)}
    missing = []
    for module, text in texts():
        options = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", text)) - NO_REASON
        options |= {f"--{word.replace('_', '-')}" for word in re.findall(r"\ballow (\w+_\w+|offsets)", text)}
        options = {"--derived" if option == "--offsets" else option for option in options}
        for option in options:
            found = remedy_of(text)
            if option not in named or found is None or option not in found.option:
                missing.append((module, option, text[:80]))
    assert not missing


@pytest.mark.exhaustive
def test_every_reason_that_asks_for_the_cell_file_is_in_the_table() -> None:
    messages = ("agreement.py", "frame_table.py", "robot_base.py", "fanuc.py", "kuka.py", "used_frames.py")
    asking = [text for module, text in texts() if "[frames." in text and module not in messages and " " in text]
    assert len(asking) > 3
    remedies = {text: remedy_of(text) for text in asking if "give it in" in text or "add it to" in text}
    assert len(remedies) > 3
    assert {one.option for one in remedies.values() if one is not None} == {FRAMES, GROUPS}
    assert all(remedies.values())


def test_every_option_of_reading_that_allows_targets_is_in_the_table() -> None:
    named = " ".join(one.option for one in REMEDIES)
    options = [f"--{field.name.replace('_', '-')}" for field in fields(ReadOptions)]
    other = {"--ambiguous", "--orientation", "--offsets"}  # they leave targets out, or are part of another
    assert [option for option in options if option not in named and option not in other] == []
    assert FRAMES in named


def test_the_counts_add_up(path: Path) -> None:
    coverage = Coverage.of_programs([read_program(path)])
    (line,) = coverage.programs
    assert (line.targets, line.correctable) == (6, 2)
    assert sum(one.count for one in line.reasons) == line.targets - line.correctable
    assert coverage.total.by_option() == {FRAMES: 2, "": 1, "--external-axes": 1}
    found = {option: n for option, n in line.by_option().items() if option}
    allowed = Coverage.of_programs([read_program(path, options=ReadOptions(external_axes=True))])
    assert allowed.total.correctable == 2 + found["--external-axes"]


def test_reasons_of_a_map_count_after_a_correction(path: Path) -> None:
    done = correct_program(path, FakeMap((1.0, 0.0, 0.0), {1: "too far"}), on_guard="skip")
    coverage = Coverage.of_outcomes([done.targets])
    assert (coverage.total.targets, coverage.total.correctable) == (6, 1)
    assert {one.reason: one.count for one in coverage.total.reasons}["too far"] == 1


def test_each_module_of_a_project_is_a_line(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / f"{name}.src").write_text(TEXT.replace("DEF a", f"DEF {name}"))
    coverage = Coverage.of_programs(read_programs([tmp_path]).programs)
    assert [Path(one.name).name for one in coverage.programs] == ["a.src", "b.src"]
    assert (coverage.total.targets, coverage.total.correctable) == (12, 4)


def test_the_table_has_a_row_for_each_reason(path: Path, tmp_path: Path) -> None:
    coverage = Coverage.of_programs([read_program(path)])
    write_coverage(coverage, tmp_path / "c.csv")
    rows = list(csv.DictReader(io.StringIO((tmp_path / "c.csv").read_text())))
    total = [row for row in rows if row["program"] == "in all"]
    assert sum(int(row["count"]) for row in total) == 4
    assert {unescaped(row["option"]) for row in total} == {FRAMES, "", "--external-axes"}
    assert all(bool(row["option"]) == bool(row["assumption"]) for row in rows)


class Page(HTMLParser):
    """The text of a page, and what it would load."""

    def __init__(self) -> None:
        super().__init__()
        self.text, self.loads = "", list[str]()

    def handle_data(self, data: str) -> None:
        self.text += data

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.loads += [value or "" for key, value in attributes if key in ("src", "href")]


def test_the_page_tells_options_and_loads_nothing(path: Path, tmp_path: Path) -> None:
    evil = tmp_path / "<b>&.src"
    evil.write_text(TEXT)
    coverage = Coverage.of_programs([read_program(path), read_program(evil)], ["c.src: <i>broken"])
    write_coverage(coverage, tmp_path / "c.html")
    page = Page()
    page.feed((tmp_path / "c.html").read_text())
    for text in ("--external-axes", "<b>&.src", "c.src: <i>broken", REMEDIES[0].assumption, "33.3"):
        assert text in page.text
    assert all(link.startswith("data:") for link in page.loads)


def test_only_pages_and_tables_are_written(path: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"\.html or \.csv"):
        write_coverage(Coverage.of_programs([read_program(path)]), tmp_path / "c.pdf")


def test_nothing_to_allow_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.src").write_text(f"DEF a()\n$TOOL=$NULLFRAME\n$BASE=$NULLFRAME\nLIN {POSE}\nEND\n")
    write_coverage(Coverage.of_programs([read_program(tmp_path / "a.src")]), tmp_path / "c.html")
    assert "every target is covered" in (tmp_path / "c.html").read_text()
