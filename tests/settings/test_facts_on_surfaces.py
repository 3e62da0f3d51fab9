"""Every surface shows every fact of a map with its effect: commands, their JSON, records, reports, store and pages."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from tests.conftest import Run
from tests.store.plant import plant

import truepose as tp
from truepose.error_map import fit
from truepose.error_map.facts import CODES, EFFECTS, Fact, how_to_accept
from truepose.store.recording import add_map
from truepose.web import Workspace, create_app
from truepose.web.security import Guard

REFUSING = [code for code, kind in CODES.items() if kind.effect == "refuses"]
ACCEPT = [f"--accept={code}" for code in REFUSING]
FACTS = tuple([Fact(code, f"the finding of {code}", "fit", 0.5, 0.1, "mm") for code in CODES])
"""A fact of every code."""


@pytest.fixture(scope="module")
def map_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "map.truepose"
    tp.load_map(plant().map).changed(stated=FACTS).save(path)
    return path


Surface = Callable[[Path, Callable[..., Run], Path, bool], str]


def _command(*arguments: str | Path) -> Surface:
    def shown(map_path: Path, run: Callable[..., Run], folder: Path, as_json: bool) -> str:
        known = {"MAP": map_path, "OUT": folder / "out", "READINGS": plant().readings}
        given = [known.get(str(one), one) for one in arguments]
        done = run(*given, *(["--json"] if as_json else []))
        assert done.code == 0, done
        return done.out

    return shown


def _fit(map_path: Path, run: Callable[..., Run], folder: Path, as_json: bool) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fit, "in_controllers_base", lambda robot, *_, **__: (robot, list(FACTS)))
        given = (
            "fit",
            plant().cell,
            plant().samples,
            "--predictor",
            "ordinary-kriging",
            "--out",
            folder / "a.truepose",
        )
        done = run(*given, *(["--json"] if as_json else []))
    assert done.code == 0, done
    return done.out


CORRECT = ("correct", "MAP", plant().program, "--out", "OUT", "--on-guard", "skip", *ACCEPT)
SURFACES: dict[str, Surface] = {
    "fit": _fit,
    "update": _command("update", "MAP", plant().later),
    "validate": _command("validate", "MAP", plant().later),
    "explain": _command("explain", "MAP", "--suggestions", "0"),
    "correct": _command(*CORRECT),
    "verify": _command("verify", "MAP", plant().program, "READINGS", "--tolerance", "0.5", "--uncertainty", "0.01"),
    "report": _command("report", "MAP", "--out", "OUT.html", "--force"),
}
SHOWN: dict[tuple[str, Path, bool], str] = {}
"""What each surface shows, which is asked once."""


def shown(name: str, map_path: Path, run: Callable[..., Run], folder: Path, *, as_json: bool) -> str:
    """Return what a surface shows."""
    key = name, map_path, as_json
    if key not in SHOWN:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            SHOWN[key] = SURFACES[name](map_path, run, folder, as_json)
    return SHOWN[key]


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("name", SURFACES)
def test_a_command_shows_each_fact_that_does_something_with_its_effect(
    run: Callable[..., Run], map_path: Path, tmp_path: Path, name: str, code: str
) -> None:
    out = " ".join(shown(name, map_path, run, tmp_path, as_json=False).split())
    effect = CODES[code].effect
    does = EFFECTS[effect].format(how=how_to_accept(code))
    if effect == "told":
        assert name != "explain" or f"Fact {code}: the finding of {code}." in out
    elif name == "correct":
        assert (f"the finding of {code} ({does})" if effect != "refuses" else f"accepted: the finding of {code}") in out
    else:
        assert f"Fact {code}: the finding of {code} ({does})." in out


@pytest.mark.parametrize("name", SURFACES)
def test_the_json_of_a_command_holds_all_facts(
    run: Callable[..., Run], map_path: Path, tmp_path: Path, name: str
) -> None:
    found = json.loads(shown(name, map_path, run, tmp_path, as_json=True))
    facts = found["programs"][0]["facts"] if name == "correct" else found["facts"]
    for fact in FACTS:
        assert {**fact.to_dict(), "effect": CODES[fact.code].effect} in facts


def test_the_record_of_a_correction_holds_the_facts_and_those_accepted(map_path: Path, tmp_path: Path) -> None:
    error_map = tp.load_map(map_path)
    done = tp.correct_program(plant().program, error_map, on_guard="skip", accept=REFUSING)
    done.write(tmp_path)
    (record,) = tmp_path.glob("*.corrections.json")
    found = json.loads(record.read_text())
    assert [Fact.from_dict(one) for one in found["facts"]] == list(error_map.facts)
    assert set(found["accepted"]) == set(REFUSING)
    for fact in FACTS:
        told = [text for text in found["warnings"] if fact.words in text]
        assert len(told) == (0 if fact.effect == "told" else 1), fact


@pytest.mark.sampled(1)
@pytest.mark.parametrize("locale", ["en", "de", "zh"])
def test_a_report_lists_all_facts(map_path: Path, tmp_path: Path, locale: str) -> None:
    from truepose.report.evidence import gather
    from truepose.report.locale import load_locale
    from truepose.report.sections import document

    say = load_locale(locale)
    made = document(gather(tp.load_map(map_path)), say).to_dict()
    (section,) = (one for one in made["sections"] if one["title"] == say("facts.title"))
    rows = [row for block in section["blocks"] if block["kind"] == "table" for row in block["rows"]]
    for fact in FACTS:
        assert [fact.code, say(f"facts.{fact.effect}"), fact.words] in rows


def test_the_store_keeps_the_facts_of_a_map(map_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from truepose.store import records

    kept: list[Any] = []
    monkeypatch.setattr(records, "put_map", lambda _change, new: kept.append(new) or 1)
    add_map(None, 1, map_path, tp.load_map(map_path))  # type: ignore[arg-type]  # the store is not asked
    assert all(fact.to_dict() in kept[0].figures["facts"] for fact in FACTS)


def test_the_page_of_a_map_gets_all_facts(map_path: Path, tmp_path: Path) -> None:
    (tmp_path / "one" / "maps").mkdir(parents=True)
    (tmp_path / "one" / "cell.toml").write_bytes(plant().cell.read_bytes())
    (tmp_path / "one" / "maps" / "map.truepose").write_bytes(map_path.read_bytes())
    guard = Guard(port=8765)
    with TestClient(create_app(Workspace(tmp_path), guard), base_url="http://127.0.0.1:8765") as client:
        client.get(f"/?token={guard.token}")
        answer = client.get(f"/api/v1/maps/{tp.load_map(map_path).hash}")
    assert answer.status_code == 200, answer.text
    facts = answer.json()["figures"]["facts"]
    assert all(fact.to_dict() in facts for fact in FACTS)
    page = (Path(__file__).parents[2] / "frontend" / "src" / "pages" / "map" / "Figures.svelte").read_text()
    assert "facts.figures['facts']" in page
    for locale in ("en", "de", "zh"):
        texts = json.loads(
            (Path(__file__).parents[2] / "frontend" / "src" / "lib" / "i18n" / locale / "map.json").read_text()
        )
        assert {f"effect_{effect}" for effect in EFFECTS} <= set(texts)
