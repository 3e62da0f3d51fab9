"""The version names the commit of the sources that run, wherever they are: a table of situations."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

import truepose
from truepose import _version
from truepose._version import RELEASE

ROOT = Path(__file__).resolve().parents[2]
HAS_GIT = shutil.which("git") is not None
FILE = "src/truepose/_version.py"
NOTE = ROOT / ".git_archival.txt"
ARCHIVED = (".gitattributes", NOTE.name) if NOTE.is_file() and "$Format" in NOTE.read_text("utf-8") else ()
"""What ``git archive`` needs; none where the tests run in such an archive."""

pytestmark = pytest.mark.skipif(not HAS_GIT, reason="git is not installed")


def version_of(file: Path) -> str:
    """Return the version that a copy of the module finds."""
    spec = importlib.util.spec_from_file_location("copied_version", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    found: str = module.version()
    return found


class Clone:
    """A small repository with the module of the version, and the files that the version depends on."""

    def __init__(self, root: Path) -> None:
        self.root = root
        (root / "src" / "truepose").mkdir(parents=True)
        shutil.copy(ROOT / FILE, root / FILE)
        for name in ("pyproject.toml", *ARCHIVED):
            shutil.copy(ROOT / name, root / name)
        (root / ".gitignore").write_text("__pycache__/\n", "utf-8")
        self.git("init", "--quiet", "--initial-branch=main")

    def git(self, *words: str) -> str:
        """Run git as an author whose machine has no settings; return what it prints."""
        own = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
        names = {f"GIT_{who}_{what}": "a@b.example" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
        settings = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
        command = ["git", *words]
        done = subprocess.run(
            command, cwd=self.root, env=own | names | settings, capture_output=True, text=True, check=True
        )
        return done.stdout.strip()

    def commit(self, number: int = 1) -> None:
        """Commit all files, and add empty commits up to a number."""
        self.git("add", "--all")
        for _ in range(number):
            self.git("commit", "--quiet", "--allow-empty", "--message", "x")

    @property
    def hash(self) -> str:
        """The seven digits that name the last commit."""
        return self.git("rev-parse", "HEAD")[:7]

    @property
    def version(self) -> str:
        """The version that the sources find."""
        return version_of(self.root / FILE)


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    made = Clone(tmp_path / "clone")
    made.commit()
    return made


def _tag(clone: Clone) -> None:
    clone.git("tag", "--annotate", f"v{RELEASE}", "--message", "x")


def _light_tag(clone: Clone) -> None:
    clone.git("tag", f"v{RELEASE}")


def _older_tag(clone: Clone) -> None:
    clone.git("tag", "v0.0.1")
    clone.commit(3)


def _other_tag(clone: Clone) -> None:
    clone.git("tag", "nightly")


def _changed(clone: Clone) -> None:
    (clone.root / "pyproject.toml").write_text("[project]\n")


def _staged(clone: Clone) -> None:
    _changed(clone)
    clone.git("add", "pyproject.toml")


def _new_source(clone: Clone) -> None:
    (clone.root / "src" / "truepose" / "new.py").touch()


def _new_note(clone: Clone) -> None:
    (clone.root / "notes.txt").touch()


def _later_commits(clone: Clone) -> None:
    clone.commit(4)


def _later_line(clone: Clone) -> None:
    clone.commit(2)
    with (clone.root / FILE).open("a") as file:  # the release of the constant began earlier
        file.write("# a line\n")
    clone.commit()


def _next_release(clone: Clone) -> None:
    clone.commit(5)
    changed = (clone.root / FILE).read_text("utf-8").replace(f'RELEASE = "{RELEASE}"', 'RELEASE = "99.1.0"')
    (clone.root / FILE).write_text(changed, "utf-8")
    clone.commit(2)


def _foreign_variables(clone: Clone) -> None:
    """Set what git sets for the hooks of another repository."""
    other = Clone(clone.root.parent / "other")
    other.commit()
    for name, value in (("GIT_DIR", ".git"), ("GIT_WORK_TREE", "."), ("GIT_INDEX_FILE", ".git/index")):
        os.environ[name] = str(other.root / value)


CHECKOUTS: dict[str, tuple[tuple[Callable[[Clone], None], ...], str]] = {
    "the tag of the release": ((_tag,), RELEASE),
    "a lightweight tag": ((_light_tag,), RELEASE),
    "an untracked file that is no source": ((_tag, _new_note), RELEASE),
    "the tag and a change": ((_tag, _changed), RELEASE + "+g{hash}.dirty"),
    "after an older tag": ((_older_tag,), RELEASE + ".dev3+g{hash}"),
    "the tag of an older release": ((_older_tag, _tag), RELEASE),
    "a tag of another kind": ((_other_tag,), RELEASE + ".dev1+g{hash}"),
    "no tags": ((), RELEASE + ".dev1+g{hash}"),
    "no tags, later": ((_later_commits,), RELEASE + ".dev5+g{hash}"),
    "no tags, another line of the module changed": ((_later_line,), RELEASE + ".dev4+g{hash}"),
    "no tags, the next release began": ((_next_release,), "99.1.0.dev2+g{hash}"),
    "a changed file": ((_changed,), RELEASE + ".dev1+g{hash}.dirty"),
    "a staged file": ((_staged,), RELEASE + ".dev1+g{hash}.dirty"),
    "a new source": ((_new_source,), RELEASE + ".dev1+g{hash}.dirty"),
    "a hook of another repository": ((_foreign_variables, _later_commits), RELEASE + ".dev5+g{hash}"),
}


@pytest.mark.parametrize("name", CHECKOUTS)
def test_a_checkout(clone: Clone, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.setenv(variable, "")  # to be restored
        monkeypatch.delenv(variable)
    steps, wanted = CHECKOUTS[name]
    for step in steps:
        step(clone)
    assert clone.version == wanted.format(hash=clone.hash)


def test_versions_are_those_of_the_packaging_rules(clone: Clone) -> None:
    """Installers accept each form, and sort a development version before its release."""
    packaging = pytest.importorskip("packaging.version")
    clone.commit(11)
    _changed(clone)
    parsed = packaging.Version(clone.version)
    assert str(parsed) == clone.version
    assert packaging.Version("0.2.0") < parsed < packaging.Version(RELEASE)


def test_a_tagged_clone_and_one_without_tags_count_alike(clone: Clone) -> None:
    """A release has a tag, and the commit after it begins the next one."""
    clone.git("tag", "v99.0.0")
    _next_release(clone)
    clone.git("tag", "--delete", "v99.0.0")
    clone.git("tag", "v99.0.0", "HEAD~2")
    tagged = clone.version
    clone.git("tag", "--delete", "v99.0.0")
    assert clone.version == tagged


def test_a_shallow_clone(clone: Clone, tmp_path: Path) -> None:
    clone.commit(5)
    clone.git("clone", "--quiet", "--depth=2", clone.root.as_uri(), str(tmp_path / "shallow"))
    assert version_of(tmp_path / "shallow" / FILE) == f"{RELEASE}.dev0+g{clone.hash}"


def test_another_working_tree(clone: Clone, tmp_path: Path) -> None:
    clone.git("worktree", "add", "--quiet", str(tmp_path / "tree"))
    assert version_of(tmp_path / "tree" / FILE) == clone.version


def test_without_the_program_git(clone: Clone, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert clone.version == f"{RELEASE}.dev0+unknown"


def test_a_repository_without_commits(tmp_path: Path) -> None:
    assert Clone(tmp_path / "clone").version == f"{RELEASE}.dev0+unknown"


def test_sources_without_repository_are_not_those_that_are_installed(clone: Clone) -> None:
    shutil.rmtree(clone.root / ".git")
    assert clone.version == f"{RELEASE}.dev0+unknown"


@pytest.mark.parametrize("repository", [False, True])
def test_an_sdist_keeps_the_version_of_its_build(clone: Clone, repository: bool) -> None:
    if not repository:
        shutil.rmtree(clone.root / ".git")
    lines = ["Metadata-Version: 2.4", "Name: truepose", "Version: 1.2.3.dev4+g1234567", "", "Version: 9 of the text"]
    (clone.root / "PKG-INFO").write_text("\n".join(lines))
    assert clone.version == "1.2.3.dev4+g1234567"


@pytest.mark.parametrize(
    ("step", "wanted"),
    [(_tag, RELEASE), (_older_tag, RELEASE + ".dev3+g{hash}"), (_later_commits, RELEASE + ".dev0+g{hash}")],
)
@pytest.mark.skipif(not ARCHIVED, reason="the sources are an archive themselves")
def test_an_archive_of_a_commit(clone: Clone, tmp_path: Path, step: Callable[[Clone], None], wanted: str) -> None:
    step(clone)
    clone.git("archive", "--output", str(tmp_path / "archive.tar"), "HEAD")
    with tarfile.open(tmp_path / "archive.tar") as archive:
        archive.extractall(tmp_path / "archive", filter="data")
    assert version_of(tmp_path / "archive" / FILE) == wanted.format(hash=clone.hash)


def test_an_installed_wheel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "truepose").mkdir()
    installed = shutil.copy(ROOT / FILE, tmp_path / "truepose")
    assert version_of(Path(installed)) == f"{RELEASE}.dev0+unknown"
    info = tmp_path / "truepose-1.2.3.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.4\nName: truepose\nVersion: 1.2.3\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert version_of(Path(installed)) == "1.2.3"


def test_the_build_asks_the_module(clone: Clone) -> None:
    """Hatch evaluates an expression in the module, which it loads without the package."""
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["hatch"]["version"]
    assert asked == {"source": "code", "path": FILE, "expression": f"{_version.version.__name__}()"}
    code = f"import sys; sys.path.insert(0, 'src/truepose'); import _version; print(_version.{asked['expression']})"
    command = [sys.executable, "-I", "-S", "-c", code]
    done = subprocess.run(command, cwd=clone.root, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == clone.version


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="the sources are not in a repository")
def test_this_checkout_names_its_commit() -> None:
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    found = re.search(r"\+g([0-9a-f]{7,})", truepose.__version__)
    assert head.startswith(found[1]) if found else truepose.__version__ == RELEASE
