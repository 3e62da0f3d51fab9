"""The documentation keeps step with the code: messages, names, rooms, decisions."""

from __future__ import annotations

import ast
import importlib
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

import truepose

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
QUOTED = re.findall(r"^### `(.+)`$", (DOCS / "troubleshooting.md").read_text("utf-8"), re.MULTILINE)


def texts() -> list[str]:
    """Return all texts of the source, with … for what is put in when it runs."""
    found = []
    for path in (ROOT / "src").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
            elif isinstance(node, ast.JoinedStr):
                found.append(
                    "".join(
                        str(getattr(part, "value", "")) if isinstance(part, ast.Constant) else "…"
                        for part in node.values
                    )
                )
    return found


@pytest.fixture(scope="module")
def source() -> str:
    return "\n".join(texts())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("message", QUOTED)
def test_quoted_messages_exist(message: str, source: str) -> None:
    fragments = [fragment.strip() for fragment in message.split("…") if len(fragment.strip(" ;?,.:")) > 3]
    missing = [fragment for fragment in fragments if fragment not in source]
    assert not missing, (
        f"docs/troubleshooting.md quotes {missing}, which no message of src has; change the page with the message"
    )


def test_enough_messages_are_explained() -> None:
    assert len(QUOTED) >= 30
    assert len(set(QUOTED)) == len(QUOTED)


def test_the_api_index_has_every_public_name() -> None:
    listed = re.findall(r"\{tp\}`(\w+)`", (DOCS / "api" / "index.md").read_text("utf-8"))
    assert set(listed) == set(truepose.__all__) - {"__version__"}


@pytest.mark.parametrize("path", sorted((DOCS / "decisions").glob("[0-9]*.md")), ids=lambda path: path.stem)
def test_decisions_are_short_and_whole(path: Path) -> None:
    text = path.read_text("utf-8")
    assert len(text.splitlines()) <= 40
    assert text.startswith(f"# {int(path.name[:2])}. ")
    assert all(f"**{part}.**" in text for part in ("Context", "Decision", "Consequences"))


@pytest.fixture
def house(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return tools/house.py as a module."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    module = importlib.import_module("house")
    monkeypatch.delitem(sys.modules, "house")
    return module


def test_the_drawing_shows_every_room(house: ModuleType) -> None:
    _, rooms, between = house.build()
    drawing = house.drawing(rooms, between)
    packages = {path.parent.name for path in (ROOT / "src" / "truepose").glob("*/__init__.py")}
    assert packages <= set(rooms)
    assert all(f">{name}</text>" in drawing for name in packages)
    assert drawing.count("<path d=") > len(packages)


def test_there_are_no_import_circles(house: ModuleType) -> None:
    graph, _, _ = house.build()
    arrows = [(a, b) for a in graph.modules for b in graph.find_modules_directly_imported_by(a)]
    assert list(house.circles(graph, arrows)) == []


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "GOVERNANCE.md", "SECURITY.md"])
def test_links_of_the_pages_above_lead_somewhere(page: str) -> None:
    links = re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", (ROOT / page).read_text("utf-8"))
    assert links
    assert not [link for link in links if not (ROOT / link).exists()]


@pytest.mark.parametrize("page", ["tutorials/metrologist.md", "how-to/compare-predictors.md"])
def test_readers_of_measurements_need_no_text_tools(page: str) -> None:
    """What a command prints is short enough to be shown whole."""
    blocks = re.findall(r"```\{run\}\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)
    assert blocks
    assert not re.search(r"\b(grep|sed|awk|cut|tail)\b|\|", "".join(blocks))


RELEASE = re.compile(r"^## (\d+)\.(\d+)\.(\d+), (\d{4}-\d\d-\d\d)$", re.MULTILINE)


def test_the_changelog_begins_each_release_with_what_to_do() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    heads = re.findall(r"^## .*$", text, re.MULTILINE)
    assert heads[0] == "## Unreleased"
    assert len(RELEASE.findall(text)) == len(heads) - 1 > 0
    numbers = [tuple(map(int, release[:3])) for release in RELEASE.findall(text)]
    assert numbers == sorted(set(numbers), reverse=True)
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        topics = re.findall(r"^### (.*)$", section, re.MULTILINE)
        assert len(set(topics)) == len(topics)
        assert topics[:1] in ([], ["What you must do"])


def test_the_citation_has_the_newest_release_and_the_fields_of_its_format() -> None:
    text = (ROOT / "CITATION.cff").read_text("utf-8")
    fields = dict(re.findall(r"^([a-z-]+): *(.*)$", text, re.MULTILINE))
    newest = RELEASE.search((ROOT / "CHANGELOG.md").read_text("utf-8"))
    assert newest is not None
    assert fields["version"] == ".".join(newest.groups()[:3])
    assert fields["date-released"] == newest[4]
    assert fields["cff-version"] == "1.2.0"
    assert fields["license"] == "BSD-3-Clause"
    assert fields.keys() >= {"message", "title", "authors", "type"}
