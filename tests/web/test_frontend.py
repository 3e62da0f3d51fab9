"""The build of the pages: when their sources changed, and by nothing but its own command; what a wheel takes of it."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from tests.needs import needed

from truepose.cli import browser

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

    def npm(root: Path, *words: str, **_options: str) -> None:
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
    with pytest.raises(frontend.FrontendError, match="a syntax error"):
        frontend.build(tree)
    assert not frontend.is_current(tree)


def test_a_build_installs_what_it_needs_and_checks_install_the_rest(
    frontend: ModuleType, tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    works, words = frontend._npm, []

    def listen(root: Path, *given: str, **_options: str) -> None:
        words.append(given)
        works(root, *given)

    monkeypatch.setattr(frontend, "_npm", listen)
    frontend.build(tree)
    frontend._install(tree, to_check=False)
    frontend._install(tree, to_check=True)
    frontend._install(tree, to_check=False)  # what is there already is not removed
    assert [("--omit=dev" in given) for given in words if given[0] == "ci"] == [True, False]


@pytest.mark.parametrize(("edit", "word"), [(None, None), (_change, "outdated"), (_delete_build, "missing")])
def test_one_line_says_what_pages_lack(frontend: ModuleType, tree: Path, edit, word: str | None) -> None:
    frontend.build(tree)
    if edit is not None:
        edit(tree)
    line = frontend.lacking(tree)
    assert (line is None) is (word is None)
    if line is not None:
        assert word in line
        assert line.endswith("build them with: make frontend")
        assert "\n" not in line


@pytest.fixture
def project(tree: Path) -> Path:
    """A project with this one's build and little else; its npm, node and git are nowhere."""
    for name in ("pyproject.toml", "README.md", "LICENSE", "tools", "src/truepose/_version.py"):
        source, target = ROOT / name, tree / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copytree(source, target) if source.is_dir() else shutil.copy(source, target)
    (tree / "src" / "truepose" / "__init__.py").touch()
    shutil.copy(ROOT / ".gitignore", tree)  # which names the built pages
    return tree


def _wheel(project: Path, **environment: str) -> tuple[int, str, set[str]]:
    """Build a wheel without Node or network; return the exit code, the output, and the names of its files."""
    needed("hatchling", "hatchling")
    out, nowhere = project / "dist", project / "nowhere"
    nowhere.mkdir(exist_ok=True)
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)],
        cwd=project,
        env={
            **{
                name: value
                for name, value in os.environ.items()
                if name in ("PYTHONPATH", "SYSTEMROOT", "TEMP", "TMPDIR")
            },
            "PATH": str(nowhere),
            "HTTPS_PROXY": "http://127.0.0.1:9",
            "npm_config_registry": "http://127.0.0.1:9",
            **environment,
        },
        capture_output=True,
        text=True,
        check=False,
    )
    names = {name for wheel in out.glob("*.whl") for name in zipfile.ZipFile(wheel).namelist()}
    return done.returncode, done.stdout + done.stderr, names


PAGES = {"truepose/web/static/index.html", "truepose/web/static/.sources"}


def test_a_wheel_needs_neither_node_nor_pages(project: Path) -> None:
    code, output, names = _wheel(project)
    assert code == 0, output
    assert "truepose/__init__.py" in names
    assert not PAGES & names
    assert output.count("made without pages: the pages of 'truepose app' are missing in ") == 1


def test_a_wheel_for_a_release_fails_without_pages(project: Path) -> None:
    code, output, names = _wheel(project, TRUEPOSE_PAGES="require")
    assert code != 0
    assert names == set()
    (line,) = output.splitlines()  # and no traceback
    assert line.startswith("TRUEPOSE_PAGES=require, but the pages of 'truepose app' are missing in ")


def test_a_wheel_takes_the_pages_of_its_sources(frontend: ModuleType, project: Path) -> None:
    frontend.build(project)
    code, output, names = _wheel(project, TRUEPOSE_PAGES="require")
    assert code == 0, output
    assert names >= PAGES


def test_a_wheel_takes_no_pages_of_other_sources(frontend: ModuleType, project: Path) -> None:
    frontend.build(project)
    _change(project)
    code, output, names = _wheel(project)
    assert code == 0, output
    assert not PAGES & names
    assert "are outdated in " in output


def test_an_unknown_wish_for_pages_is_refused(project: Path) -> None:
    code, output, _ = _wheel(project, TRUEPOSE_PAGES="yes")  # not a wheel that silently has none
    assert code != 0
    assert "TRUEPOSE_PAGES is 'yes'; expected 'require', or leave it unset" in output


@pytest.mark.parametrize(
    ("clone", "remedy"), [(True, "run 'make frontend' in the clone"), (False, "install the wheel of a release")]
)
def test_the_application_says_how_to_get_pages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, clone: bool, remedy: str
) -> None:
    from truepose.web import pages

    monkeypatch.setattr(pages, "STATIC", tmp_path / "static")
    monkeypatch.setattr(pages, "CLONE", tmp_path)
    if clone:
        (tmp_path / "frontend").mkdir()
        (tmp_path / "frontend" / "package.json").touch()
    line = pages.not_built()
    assert line is not None
    assert remedy in line
    application = FastAPI()
    pages.install(application)
    answer = TestClient(application).get("/")
    assert (answer.status_code, answer.json()["detail"]) == (503, line)
    monkeypatch.setattr("truepose.web.server.serve", lambda *_, **options: calls.append(options["browser"]))
    calls: list[bool] = []
    with pytest.warns(UserWarning, match=re.escape(line)):
        browser.app(tmp_path / "workspace")
    (tmp_path / "static").mkdir()
    (tmp_path / "static" / "index.html").touch()
    browser.app(tmp_path / "workspace")
    assert calls == [False, True]


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
