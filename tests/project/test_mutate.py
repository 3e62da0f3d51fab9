"""The tool that shows by mutation what tests notice, on a tiny package."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"
GUARD = '''"""A guard."""
from __future__ import annotations

_LIMIT = 2.0


def check(size: float) -> str:
    """Return whether a size is allowed; 3 - 2."""
    return "yes" if size <= round(_LIMIT, 9) else refused()


def refused() -> str:
    return "no"
'''
TESTS = """
import os, subprocess, sys
import pytest
from tiny.guard import check, refused

@pytest.fixture(scope="module")
def told():
    return refused()

def test_a_limit():
    assert check(1.9) == "yes" and check(2.1) == "no"

def test_a_process():
    code = "from tiny.guard import check; raise SystemExit(check(5.0) != 'no')"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0

def test_a_fixture(told):
    assert told == "no"

@pytest.mark.skipif("ALL" not in os.environ, reason="second tier")
@pytest.mark.exhaustive
def test_the_limit_itself():
    assert check(2.0) == "yes"

def test_that_fails():
    assert check(0.0) == "no"
"""
SETTINGS = """
root = "."
source = "src"
package = "tiny"
places = ["guard.py:check"]
second_tier = { ALL = "1" }
[[equivalent]]
file = "guard.py"
line = 'return "yes" if size <= round(_LIMIT, 9) else refused()'
becomes = 'return "yes" if size <= round(_LIMIT, 10) else refused()'
reason = "for this test"
"""


@pytest.fixture
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(TOOLS))


def changed(source: str) -> set[tuple[str, str]]:
    from mutation.mutants import mutants

    return {(one.before, one.after) for one in mutants("a.py", source.encode())}


@pytest.mark.usefixtures("tools")
@pytest.mark.parametrize(
    ("line", "becomes"),
    [
        ("a = b < (c)", ["a = b <= (c)", "a = b > (c)"]),
        ("a = b <= c < d", ["a = b < c < d", "a = b >= c < d", "a = b <= c <= d", "a = b <= c > d"]),
        ("a = b is not None", ["a = b is None"]),
        ("a = b not in c", ["a = b in c"]),
        ("a = b and c or d", ["a = b or c or d", "a = b and c and d"]),
        ("a = not b", ["a = b"]),
        ("a = ~(b)", ["a = (b)"]),
        ("a = (b + c) * -d", ["a = (b - c) * -d", "a = (b + c) / -d", "a = (b + c) * d"]),
        ("a -= b // c", ["a += b // c", "a -= b * c"]),
        ("a = 2", ["a = 3", "a = 1"]),
        ("a = 0.5", ["a = 1.0", "a = 0.25"]),
        ("a = 1e-9", ["a = 1e-07", "a = 1e-11"]),
        ("a = 0.0", ["a = 1.0"]),
        ("a = f(x=True)", ["a = f(x=False)"]),
        ("a = b if c else d", ["a = b if True else d", "a = b if False else d"]),
        ("a = [b for b in c if d]", ["a = [b for b in c if True]", "a = [b for b in c if False]"]),
        ("f(b)", ["pass"]),
        ('a: Literal[3] = "text" + b', []),
        ('raise F(f"{b + 1}", 2)', []),
        ("assert b < 3", []),
        ("a = zip(b, c, strict=True)", []),
        ('a = "" if b else f"{c}"', []),
        ("a = int | str", []),
        ("a = b < c # < d", ["a = b <= c # < d", "a = b > c # < d"]),
        ("a = 'ü' < c", ["a = 'ü' <= c", "a = 'ü' > c"]),
    ],
)
def test_each_place_is_changed_alone(line: str, becomes: list[str]) -> None:
    assert changed(f"{line}\n") == {(line, other) for other in becomes}


@pytest.mark.usefixtures("tools")
def test_statements_are_changed_where_they_stand() -> None:
    found = changed(
        '@cache(1)\ndef f(a: int = 1) -> 2:\n    """3 < 4."""\n    while a:\n        if a:\n            continue\n'
        "        break\n    return [a]\n"
    )
    assert found == {
        ("def f(a: int = 1) -> 2:", "def f(a: int = 2) -> 2:"),
        ("def f(a: int = 1) -> 2:", "def f(a: int = 0) -> 2:"),
        ("while a:", "while False:"),
        ("if a:", "if True:"),
        ("if a:", "if False:"),
        ("continue", "break"),
        ("break", "continue"),
        ("break", "pass"),
        ("return [a]", "return None"),
    }


@pytest.mark.usefixtures("tools")
def test_a_sample_takes_files_in_turn_and_is_part_of_a_larger_one() -> None:
    from mutation.mutants import mutants, sample

    sources = {"a.py": b"a = 1\nb = 2\nc = 3\n", "b.py": b"d = 1\n"}
    changes = [one for file, source in sources.items() for one in mutants(file, source)]
    few, all_ = (sample(changes, sources, 1, number) for number in (5, 99))
    assert few == all_[:5]
    assert [one.file for one in few] == ["a.py", "b.py", "a.py", "b.py", "a.py"]
    assert len({one.line for one in few if one.file == "a.py"}) == 3
    assert len({one.key for one in all_}) == len(all_) == len(changes)
    assert sample(changes, sources, 2, 99) != all_


@pytest.mark.exhaustive
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
def test_a_tiny_package(tmp_path: Path) -> None:
    """What each tier kills, what survives, what is reviewed; a second run tries again only what it is asked for."""
    (tmp_path / "src" / "tiny").mkdir(parents=True)
    (tmp_path / "src" / "tiny" / "__init__.py").touch()
    (tmp_path / "src" / "tiny" / "guard.py").write_text(GUARD, "utf-8")
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_tiny.py").write_text(TESTS, "utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = exhaustive", "utf-8")
    (tmp_path / "mutants.toml").write_text(SETTINGS, "utf-8")

    def tool(*arguments: str) -> str:
        command = [sys.executable, str(TOOLS / "mutate.py"), *arguments, "--settings", str(tmp_path / "mutants.toml")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert "Traceback" not in done.stderr, done.stderr
        return done.stdout

    assert "1 failed, 4 passed" in tool("record", "-j", "1", "tests")
    record = tmp_path / "build" / "mutants" / "reached.json"
    reached = json.loads(record.read_text("utf-8"))
    both = ["guard.py:check", "guard.py:refused"]
    assert {name.partition("::")[2]: row["functions"] for name, row in reached["tests"].items()} == {
        "test_a_limit": both,
        "test_a_process": both,
        "test_a_fixture": [],
        "test_the_limit_itself": ["guard.py:check"],
        "test_that_fails": ["guard.py:check"],
    }
    assert [row["functions"] for row in reached["fixtures"].values()] == [["guard.py:refused"]]

    example = {**reached["tests"]["tests/test_tiny.py::test_a_limit"], "seconds": 0.0}
    reached["tests"]["src/tiny/guard.py::tiny.guard.check"] = example  # runs the source without a change
    record.write_text(json.dumps(reached), "utf-8")

    shown = tool("run", "--number", "99", "-j", "2")
    results = json.loads((tmp_path / "build" / "mutants" / "results.json").read_text("utf-8"))
    line = 'return "yes" if size <= round(_LIMIT, 9) else refused()'
    assert {(row["before"], row["after"]): row["outcome"] for row in results} == {
        ("_LIMIT = 2.0", "_LIMIT = 4.0"): "default",
        ("_LIMIT = 2.0", "_LIMIT = 1.0"): "default",
        (line, "return None"): "default",
        (line, line.replace("size <= round(_LIMIT, 9)", "True")): "default",
        (line, line.replace("size <= round(_LIMIT, 9)", "False")): "default",
        (line, line.replace("<=", ">=")): "default",
        (line, line.replace("<=", "<")): "complete",
        (line, line.replace("9", "8")): "survived",
        (line, line.replace("9", "10")): "equivalent",
    }
    assert "| guard.py | 9 | 1 | 6 | 0 | 7 | 1 |" in shown
    assert f"  -{line}\n  +{line.replace('9', '8')}\n" in shown
    assert (tmp_path / "src" / "tiny" / "guard.py").read_text("utf-8") == GUARD

    assert "9 mutants, 1 of them to be tried" in tool("run", "--number", "99", "--again", "survived")


@pytest.mark.usefixtures("tools")
def test_reviewed_changes_can_still_be_made() -> None:
    import mutate

    assert mutate.unknown(mutate.Settings.read(mutate.SETTINGS)) == []
