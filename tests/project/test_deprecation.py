"""Former names: they work with a typed warning, until the version that removes them."""

from __future__ import annotations

import ast
import inspect
import json
import warnings
from pathlib import Path

import pytest
from typer.testing import CliRunner

import truepose
from truepose._deprecated import Former, former_arguments, present_options, warn_former
from truepose.cli import app, options
from truepose.errors import TrueposeDeprecationWarning

SOURCES = Path(truepose.__file__).parent


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of a package with a present name, and former names that were renamed, moved and made methods."""
    folder = tmp_path / "lathes"
    folder.mkdir()
    (folder / "turning.py").write_text("def turn(): return 'turned'\ndef mill(): return 'milled'\n")
    (folder / "__init__.py").write_text(
        "from truepose._deprecated import Former\n"
        "from truepose._lazy import lazy_names\n"
        "__getattr__ = lazy_names(__name__, {'turn': 'turning'}, {\n"
        "    'rotate': Former('lathes.turn', removed_in='9.0.0'),\n"
        "    'mill': Former('lathes.turning.mill', removed_in='9.0.0'),\n"
        "    'cut': Former('Lathe.mill', removed_in='9.0.0', at='lathes.turning.mill'),\n"
        "})\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return "lathes"


@pytest.mark.parametrize(
    ("former", "new", "result"),
    [("rotate", "lathes.turn", "turned"), ("mill", "lathes.turning.mill", "milled"), ("cut", "Lathe.mill", "milled")],
)
def test_a_former_name_of_a_package_gives_the_object(package: str, former: str, new: str, result: str) -> None:
    module = __import__(package)
    told = rf"^{package}\.{former} is now {new}; version 9\.0\.0 removes the former name$"
    with pytest.warns(TrueposeDeprecationWarning, match=told) as caught:
        assert getattr(module, former)() == result
    assert [one.filename for one in caught] == [__file__]  # the line of the user, not one of truepose


def test_a_former_name_can_be_imported_from_a_package(package: str) -> None:
    with pytest.warns(TrueposeDeprecationWarning, match=r"^lathes\.rotate is now lathes\.turn;") as caught:
        exec("from lathes import rotate")  # the package exists in this test only
    assert {one.filename for one in caught} == {"<string>"}


def test_present_and_unknown_names_give_no_warning(package: str) -> None:
    module = __import__(package)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert module.turn() == "turned"
        with pytest.raises(AttributeError, match="module 'lathes' has no attribute 'grind'"):
            _ = module.grind


def test_python_shows_the_warning_by_default() -> None:
    assert issubclass(TrueposeDeprecationWarning, FutureWarning)


@former_arguments(removed_in="9.0.0", sidecars="records", seed="rng")
def write(path: str, records: str = "", *, rng: int = 0) -> tuple[str, str, int]:
    """Return the arguments."""
    return path, records, rng


def test_a_former_argument_is_taken() -> None:
    told = r"^write\(sidecars=…\) is now write\(records=…\); version 9\.0\.0 removes the former name$"
    with pytest.warns(TrueposeDeprecationWarning, match=told) as caught:
        assert write("p", sidecars="s", rng=2) == ("p", "s", 2)
    assert [one.filename for one in caught] == [__file__]
    with pytest.warns(TrueposeDeprecationWarning) as caught:
        assert write("p", sidecars="s", seed=3) == ("p", "s", 3)
    assert len(caught) == 2


def test_present_arguments_give_no_warning_and_a_name_given_twice_is_an_error() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert write("p", "r", rng=1) == ("p", "r", 1)
        with pytest.raises(TypeError, match=r"write\(\) got 'seed' and 'rng', which mean the same; give 'rng' only"):
            write("p", seed=1, rng=1)
        with pytest.raises(TypeError, match="unexpected keyword argument 'other'"):
            write("p", other=1)
    with pytest.warns(TrueposeDeprecationWarning), pytest.raises(TypeError, match=r"multiple values.*'records'"):
        write("p", "r", sidecars="s")


def test_help_shows_the_present_arguments() -> None:
    assert list(inspect.signature(write).parameters) == ["path", "records", "rng"]
    assert write.__doc__ == "Return the arguments."


FORMER = {
    "--fast": Former("--quick", removed_in="9.0.0"),
    "--size": Former("--length", removed_in="9.0.0"),
    "--accept-weak": Former("--accept=weak", removed_in="9.0.0"),
}


@pytest.mark.parametrize(
    ("given", "present", "count"),
    [
        (["--fast", "a"], ["--quick", "a"], 1),
        (["--size", "3"], ["--length", "3"], 1),
        (["--size=3", "--fast"], ["--length=3", "--quick"], 2),
        (["--accept-weak"], ["--accept=weak"], 1),
        (["--quick", "--", "--fast"], ["--quick", "--", "--fast"], 0),
        (["a", "-f", "--faster"], ["a", "-f", "--faster"], 0),
    ],
)
def test_former_options_are_replaced(given: list[str], present: list[str], count: int) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert present_options(given, ["--quick", "--length", "--accept"], FORMER) == present
    assert [one.category for one in caught] == [TrueposeDeprecationWarning] * count


def test_a_former_option_of_other_commands_stays() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert present_options(["--fast"], ["--length"], FORMER) == ["--fast"]


def test_a_command_takes_a_former_option(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(options.FORMER_OPTIONS, "--as-data", Former("--json", removed_in="9.0.0"))
    with pytest.warns(TrueposeDeprecationWarning, match=r"^--as-data is now --json; version 9"):
        done = CliRunner().invoke(app, ["robots", "--as-data"])
    assert done.exit_code == 0
    assert json.loads(done.stdout)
    assert CliRunner().invoke(app, ["robots", "--as-text"]).exit_code == 2


def _removals() -> list[tuple[str, str]]:
    """Return each stated version of a removal in the sources, with its file."""
    found = []
    for path in SOURCES.rglob("*.py"):
        text = path.read_text("utf-8")
        for node in ast.walk(ast.parse(text if "removed_in" in text else "")):
            if isinstance(node, ast.Call):
                stated = [k.value for k in node.keywords if k.arg == "removed_in"]
                found += [(path.name, one.value) for one in stated if isinstance(one, ast.Constant)]
    return found


def _minor(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split(".")[:2])


@pytest.mark.parametrize(("file", "version"), _removals() or [("", "9.0.0")])
def test_no_former_name_stays_longer_than_stated(file: str, version: str) -> None:
    assert _minor(version) > _minor(truepose.__version__), f"{file}: remove the former name of version {version}"


def test_a_warning_names_both_names_and_the_version() -> None:
    with pytest.warns(TrueposeDeprecationWarning, match=r"^a is now b; version 1\.0\.0 removes"):
        warn_former("a", "b", removed_in="1.0.0", stacklevel=2)
