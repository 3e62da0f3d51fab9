"""`make release` on a small repository: what it writes, what it refuses, and that a failure leaves nothing."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from collections.abc import Callable
from datetime import date
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from truepose._version import RELEASE

ROOT = Path(__file__).resolve().parents[2]
DAY = date(2027, 2, 3)
CHANGES = """# Changelog

## Unreleased

### Maps

- A change.

## 0.2.0, 2026-11-22

- An older change.
"""
CITATION = "cff-version: 1.2.0\nversion: 0.2.0\ndate-released: 2026-11-22\n"
MODULE = '"""The version."""\n\nRELEASE = "0.3.0"\n'


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("release_tool", ROOT / "tools" / "release.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def git(root: Path, *words: str) -> str:
    return subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a repository with the files that a release changes, and without the settings of this machine."""
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", str(tmp_path / "none"))
    monkeypatch.setenv("GIT_CONFIG_NOSYSTEM", "1")
    for who in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{who}_NAME", "A")
        monkeypatch.setenv(f"GIT_{who}_EMAIL", "a@b.example")
    made = tmp_path / "clone"
    (made / "src" / "truepose").mkdir(parents=True)
    files = {"CHANGELOG.md": CHANGES, "CITATION.cff": CITATION, "src/truepose/_version.py": MODULE}
    for name, text in {**files, "README.md": "text\n", ".gitignore": "dist/\n"}.items():
        (made / name).write_text(text, "utf-8")
    git(made, "init", "--quiet", "--initial-branch=main")
    git(made, "add", "--all")
    git(made, "commit", "--quiet", "--message", "Begin")
    return made


def built(root: Path, version: str, out: Path) -> None:
    """Stand for the build: write two files."""
    (out / f"truepose-{version}.tar.gz").write_text("sdist")
    (out / f"truepose-{version}-py3-none-any.whl").write_text("wheel")


def state(root: Path) -> tuple[str, ...]:
    """Return all that a release changes."""
    names = sorted(path for path in root.rglob("*") if path.is_file() and ".git" not in path.parts)
    return (
        git(root, "rev-parse", "HEAD"),
        git(root, "tag"),
        git(root, "status", "--porcelain"),
        *(path.read_text("utf-8") for path in names),
    )


def test_a_release(tool: ModuleType, root: Path) -> None:
    seen = {}

    def build(at: Path, version: str, out: Path) -> None:
        seen["version"] = version
        seen["commit"] = git(at, "describe", "--tags", "--exact-match", "--dirty")
        built(at, version, out)

    said = tool.release("0.3.0", root, build, DAY)
    assert seen == {"version": "0.3.0", "commit": "v0.3.0"}  # built from the commit with the tag, without changes
    assert git(root, "log", "--format=%s") == "Begin 0.4.0\nRelease 0.3.0\nBegin"
    assert git(root, "status", "--porcelain") == ""
    assert git(root, "cat-file", "-t", "v0.3.0") == "tag"
    assert git(root, "show", "v0.3.0:src/truepose/_version.py") == MODULE.strip()
    assert (root / "src" / "truepose" / "_version.py").read_text() == MODULE.replace("0.3.0", "0.4.0")
    new = "## Unreleased\n\n## 0.3.0, 2027-02-03\n\n### Maps"
    assert (root / "CHANGELOG.md").read_text() == CHANGES.replace("## Unreleased\n\n### Maps", new)
    assert (root / "CITATION.cff").read_text() == "cff-version: 1.2.0\nversion: 0.3.0\ndate-released: 2027-02-03\n"
    files = ["dist/truepose-0.3.0-py3-none-any.whl", "dist/truepose-0.3.0.tar.gz"]
    assert sorted(path.relative_to(root).as_posix() for path in (root / "dist").iterdir()) == files
    assert f"git push origin main v0.3.0 && uv publish {' '.join(files)}" in said


def test_a_fault_is_released_before_the_next_minor_version(tool: ModuleType, root: Path) -> None:
    tool.release("0.2.1", root, built, DAY)
    assert 'RELEASE = "0.2.1"' in git(root, "show", "v0.2.1:src/truepose/_version.py")
    assert (root / "src" / "truepose" / "_version.py").read_text() == MODULE


def _change(root: Path) -> None:
    (root / "README.md").write_text("other\n")


def _new_file(root: Path) -> None:
    (root / "notes.txt").touch()


def _branch(root: Path) -> None:
    git(root, "switch", "--quiet", "--create", "work")


def _no_branch(root: Path) -> None:
    git(root, "switch", "--quiet", "--detach")


def _tagged(root: Path) -> None:
    git(root, "tag", "v0.3.0")


def _newer_tag(root: Path) -> None:
    git(root, "tag", "v0.10.0")


def _changelog(text: str) -> Callable[[Path], None]:
    def change(root: Path) -> None:
        (root / "CHANGELOG.md").write_text(text)
        git(root, "commit", "--quiet", "--all", "--message", "x")

    return change


def _nothing(root: Path) -> None:
    """Change nothing."""


REFUSED = {
    "a changed file": (_change, "0.3.0", r"^files differ from the last commit: README\.md; commit or remove"),
    "a new file": (_new_file, "0.3.0", r"^files differ from the last commit: notes\.txt; commit or remove"),
    "another branch": (_branch, "0.3.0", r"branch main, this is work; run: git switch main$"),
    "no branch": (_no_branch, "0.3.0", r"branch main, this is no branch"),
    "a tag": (_tagged, "0.3.0", r"^the tag v0\.3\.0 exists already"),
    "the last release": (_nothing, "0.2.0", r"newer than 0\.2\.0, the last release, got 0\.2\.0$"),
    "an older release": (_nothing, "0.1.9", r"newer than 0\.2\.0, the last release, got 0\.1\.9$"),
    "a newer tag": (_newer_tag, "0.9.0", r"newer than 0\.10\.0, the last release, got 0\.9\.0$"),
    "no version": (_nothing, "0.3", r"^expected a version X\.Y\.Z, such as 0\.3\.0, got '0\.3'$"),
    "a letter": (_nothing, "v0.3.0", r"^expected a version X\.Y\.Z"),
    "no change": (
        _changelog(CHANGES.replace("- A change.\n", "")),
        "0.3.0",
        r"^the section '## Unreleased' of CHANGELOG\.md is empty",
    ),
    "no section": (
        _changelog(CHANGES.replace("## Unreleased", "## Later")),
        "0.3.0",
        r"^CHANGELOG\.md has no section '## Unreleased'$",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_precondition_that_does_not_hold(tool: ModuleType, root: Path, name: str) -> None:
    change, version, message = REFUSED[name]
    change(root)
    before = state(root)

    def build(*_: object) -> None:
        pytest.fail("built")

    with pytest.raises(tool.ReleaseError, match=message):
        tool.release(version, root, build, DAY)
    assert state(root) == before


def _fails(root: Path, version: str, out: Path) -> None:
    built(root, version, out)
    raise RuntimeError("the demonstration failed")


def _interrupted(root: Path, version: str, out: Path) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("build", [_fails, _interrupted])
def test_a_failed_check_leaves_neither_commit_nor_tag(tool: ModuleType, root: Path, build: Any) -> None:
    before = state(root)
    with pytest.raises((RuntimeError, KeyboardInterrupt)):
        tool.release("0.3.0", root, build, DAY)
    assert state(root) == before


@pytest.mark.parametrize("subject", ["Release", "Begin"])
def test_a_refused_commit_leaves_nothing(tool: ModuleType, root: Path, subject: str) -> None:
    hook = root / ".git" / "hooks" / "commit-msg"
    hook.parent.mkdir(exist_ok=True)
    hook.write_text(f'#!/bin/sh\n! grep -q "^{subject}" "$1"\n')
    hook.chmod(0o755)
    before = state(root)
    with pytest.raises(tool.ReleaseError, match=r"'git commit .* failed with exit code 1"):
        tool.release("0.3.0", root, built, DAY)
    assert state(root) == before


@pytest.mark.parametrize("name", ["CITATION.cff", "src/truepose/_version.py"])
def test_a_file_without_the_line_to_change(tool: ModuleType, root: Path, name: str) -> None:
    (root / name).write_text("text\n")
    git(root, "commit", "--quiet", "--all", "--message", "x")
    before = state(root)
    with pytest.raises(tool.ReleaseError, match=f"expected one line .* in {re.escape(name)}, got 0"):
        tool.release("0.3.0", root, built, DAY)
    assert state(root) == before


def test_what_was_changed_meanwhile_stays(tool: ModuleType, root: Path) -> None:
    def build(at: Path, _version: str, _out: Path) -> None:
        _change(at)
        raise RuntimeError

    with pytest.raises(RuntimeError):
        tool.release("0.3.0", root, build, DAY)
    assert git(root, "tag") == ""
    assert git(root, "log", "--format=%s") == "Begin"
    assert git(root, "status", "--porcelain") == "M README.md"


def test_commits_of_others_are_not_removed(tool: ModuleType, root: Path) -> None:
    def build(at: Path, _version: str, _out: Path) -> None:
        git(at, "commit", "--quiet", "--allow-empty", "--message", "Other work")
        raise RuntimeError

    with pytest.raises(tool.ReleaseError, match=r"main has other commits since the release began; remove .* by hand"):
        tool.release("0.3.0", root, build, DAY)
    assert git(root, "log", "--format=%s") == "Other work\nRelease 0.3.0\nBegin"
    assert git(root, "tag") == ""


def interpreter(version: str, path: str, **changes: str) -> dict[str, Any]:
    major, minor = re.findall(r"\d+", version)[:2]
    parts = {"major": int(major), "minor": int(minor)}
    usual = {"implementation": "cpython", "variant": "default"}
    return {"version": version, "version_parts": parts, "path": path, **usual, **changes}


def test_interpreters_for_the_check(tool: ModuleType) -> None:
    listed = [
        interpreter("3.15.0a2", "early"),
        interpreter("3.14.2", "threads", variant="freethreaded"),
        interpreter("3.13.9", "another", implementation="pypy"),
        interpreter("3.13.0", "newest"),
        interpreter("3.11.2", "old"),
        interpreter("3.11.10", "oldest"),
        interpreter("3.11.10", "again"),
        interpreter("3.10.1", "unsupported"),
    ]
    supported = {(3, minor) for minor in range(11, 16)}
    assert tool.at_hand(json.dumps(listed), supported) == {(3, 13): "newest", (3, 11): "oldest"}


def test_a_missing_interpreter_is_named(tool: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool, "_uv", lambda: "uv")
    monkeypatch.setattr(tool, "_run", lambda *_, **__: json.dumps([interpreter("3.13.0", "newest")]))
    with pytest.raises(tool.ReleaseError, match=r"Python 3\.11, the oldest supported, .*uv python install 3\.11"):
        tool.interpreters(ROOT)


def test_the_files_of_the_repository_agree(tool: ModuleType) -> None:
    """The last section of the changelog is what CITATION.cff cites; what is not released yet has a newer version."""
    changes = (ROOT / "CHANGELOG.md").read_text("utf-8")
    last = re.search(r"^## (\d+\.\d+\.\d+), (\d{4}-\d\d-\d\d)$", changes, re.MULTILINE)
    assert last is not None
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert tool.cited(citation, last[1], date.fromisoformat(last[2])) == citation
    module = (ROOT / "src" / "truepose" / "_version.py").read_text("utf-8")
    assert tool.with_release(module, RELEASE) == module
    released, worked_on = ([int(part) for part in text.split(".")] for text in (last[1], RELEASE))
    unreleased = changes[: last.start()].split("## Unreleased", 1)[1].strip()
    assert worked_on > released if unreleased else worked_on >= released


def test_the_command_explains_itself() -> None:
    command = [sys.executable, ROOT / "tools" / "release.py", "not-a-version", "--dry-run"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "expected a version X.Y.Z, such as 0.3.0, got 'not-a-version'\n"
