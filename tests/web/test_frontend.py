"""The build of the pages: built when sources changed, never missing from a wheel, nothing from elsewhere."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "frontend" / "src").rglob("*.svelte"))


@pytest.fixture
def frontend(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the build script with an npm that works offline: it installs nothing, and builds one file."""
    spec = importlib.util.spec_from_file_location("frontend_build", ROOT / "tools" / "frontend.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "frontend_build", module)
    spec.loader.exec_module(module)

    def npm(root: Path, *words: str) -> None:
        if words[0] == "ci":
            (root / "frontend" / "node_modules").mkdir(exist_ok=True)
        else:
            static = root / "src" / "truepose" / "web" / "static"
            shutil.rmtree(static, ignore_errors=True)
            static.mkdir(parents=True)
            (static / "index.html").write_text("built")

    monkeypatch.setattr(module, "_npm", npm)
    return module


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "frontend" / "src" / "lib").mkdir(parents=True)
    for name in ("package.json", "package-lock.json", "src/main.ts", "src/lib/a.ts", "src/lib/b.ts"):
        (tmp_path / "frontend" / name).write_text(name)
    return tmp_path


def _change(tree: Path) -> None:
    (tree / "frontend" / "src" / "main.ts").write_text("other")


def _rename(tree: Path) -> None:
    (tree / "frontend" / "src" / "lib" / "a.ts").rename(tree / "frontend" / "src" / "lib" / "c.ts")


def _swap(tree: Path) -> None:
    for name, text in (("a.ts", "src/lib/b.ts"), ("b.ts", "src/lib/a.ts")):
        (tree / "frontend" / "src" / "lib" / name).write_text(text)


def _add(tree: Path) -> None:
    (tree / "frontend" / "src" / "empty.ts").touch()


def _remove(tree: Path) -> None:
    (tree / "frontend" / "src" / "lib" / "b.ts").unlink()


def _delete_build(tree: Path) -> None:
    shutil.rmtree(tree / "src" / "truepose" / "web" / "static")


@pytest.mark.parametrize("edit", [_change, _rename, _swap, _add, _remove, _delete_build])
def test_pages_are_built_again_after_any_change(frontend: ModuleType, tree: Path, edit) -> None:
    assert frontend.build(tree)
    assert not frontend.build(tree)
    edit(tree)
    assert not frontend.is_current(tree)
    assert frontend.build(tree)


def test_what_the_build_itself_writes_is_no_source(frontend: ModuleType, tree: Path) -> None:
    frontend.build(tree)
    (tree / "frontend" / "node_modules" / "other.js").write_text("x")
    (tree / "frontend" / "src" / "lib" / "contract.d.ts").write_text("x")
    assert not frontend.build(tree)


def test_a_failed_build_is_tried_again(frontend: ModuleType, tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    works = frontend._npm

    def fails(root: Path, *words: str) -> None:
        works(root, *words)
        if words[0] == "run":
            raise frontend.FrontendError("a syntax error")

    monkeypatch.setattr(frontend, "_npm", fails)
    for version in ("standard", "editable"):
        with pytest.raises(frontend.FrontendError, match="a syntax error"):
            frontend.build_for(version, tree)
    assert not frontend.is_current(tree)


def test_only_an_editable_installation_does_without_pages(
    frontend: ModuleType, tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def offline(_root: Path, *_words: str) -> None:
        raise frontend.FrontendError("no network")

    monkeypatch.setattr(frontend, "_npm", offline)
    assert (
        frontend.build_for("editable", tree)
        == "no network; build the pages of 'truepose app' later with: make frontend"
    )
    with pytest.raises(frontend.NoPackagesError, match="no network"):
        frontend.build_for("standard", tree)


def test_the_lock_file_names_no_host() -> None:
    lock = json.loads((ROOT / "frontend" / "package-lock.json").read_text())
    assert len(lock["packages"]) > 20
    for name, package in lock["packages"].items():
        assert "resolved" not in package, name
        assert not name or "integrity" in package, name


def test_direct_dependencies_have_one_version() -> None:
    package = json.loads((ROOT / "frontend" / "package.json").read_text())
    for name, version in {**package["dependencies"], **package["devDependencies"]}.items():
        assert re.fullmatch(r"\d+\.\d+\.\d+", version), name


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT / "frontend" / "src").as_posix())
def test_nothing_is_styled_inline(path: Path) -> None:
    # the Content-Security-Policy refuses the attribute; style:width={…} sets the property instead
    assert not re.search(r"\sstyle=[\"']", path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", [p for p in SOURCES if p.parent.name == "components"], ids=lambda path: path.stem)
def test_components_say_what_they_take(path: Path) -> None:
    head = path.read_text(encoding="utf-8").split("-->")[0]
    assert head.startswith("<!--\n@component ")
    code = path.read_text(encoding="utf-8")
    taken = re.search(r"let \{(.*?)\}: Props", code, re.DOTALL)
    assert taken is not None
    names = re.findall(r"(?:^|,)\s*(\w+)", re.sub(r"= [^,]+", "", taken[1]))
    for name in names:
        assert re.search(rf"\b{name}\b", head) or name == "others", name
