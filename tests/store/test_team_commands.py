"""The team's day at the command line, on both engines: users, tokens, release, correction, recall, and refusals."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.store.people import PASSWORD
from tests.store.plant import plant

from truepose.store.store import Store

pytestmark = pytest.mark.usefixtures("quick_hashes")


@pytest.fixture
def enter(run, address: str, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Run a command with a token, or with lines on stdin."""
    monkeypatch.setenv("TRUEPOSE_STORE", address)

    def entered(*arguments: object, token: str = "", stdin: tuple[str, ...] = ()) -> Any:
        monkeypatch.setenv("TRUEPOSE_STORE_TOKEN", token)
        monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in stdin)))
        return run(*arguments, *(["--password-stdin"] if stdin else []))

    return entered


@pytest.fixture
def tokens(enter) -> dict[str, str]:
    """Tokens of Anna, who measures and fits, Ben, who corrects, and Eva, who releases."""
    people = {"chief": "admin", "anna": "measure", "ben": "program", "eva": "release"}
    for name, role in people.items():
        log_in = () if name == "chief" else ("--user", "chief")
        lines = (PASSWORD,) if name == "chief" else (PASSWORD, PASSWORD)
        done = enter("store", "user", "add", name, "--role", role, *log_in, stdin=lines)
        assert done.code == 0, done.err
    made = {}
    for name in people:
        done = enter("store", "token", "create", "--user", name, stdin=(PASSWORD,))
        assert done.code == 0, done.err
        made[name] = done.out.strip()
        assert made[name] not in done.err
    return made


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """The plant without its maps, in a folder of its own."""
    folder = tmp_path / "robot17"
    folder.mkdir()
    for path in (plant().cell, plant().samples, plant().later, plant().program, plant().readings):
        shutil.copy(path, folder)
    return folder


FIT = ("--predictor", "ordinary-kriging")
CORRECT = ("--on-guard", "skip", "--accept-weak-map", "--force")
VERIFY = ("--tolerance", "0.5", "--uncertainty", "0.01")


@pytest.mark.exhaustive
def test_two_engineers_and_a_quality_manager(enter, tokens, files, tmp_path):
    march, out = files / "march.truepose", tmp_path / "corrected"
    assert (
        enter("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", march, token=tokens["anna"]).code == 0
    )
    correct = ("correct", march, files / "part.csv", "--out", out, *CORRECT)
    refused = enter(*correct, "--released-only", token=tokens["ben"])
    assert "is a draft, but only a released map may be used" in refused.failed()
    assert not out.exists()
    done = enter(*correct, token=tokens["ben"])
    assert "DRAFT: the map is not released" in done.out
    assert json.loads((out / "part.corrections.json").read_text())["map_state"] == "draft"
    assert (
        "so somebody else must release it"
        not in enter("store", "release", "march", token=tokens["anna"], stdin=(PASSWORD,)).failed()
    )  # Anna may not release at all
    assert enter("store", "release", "march", token=tokens["eva"], stdin=(PASSWORD,)).out.startswith("Released march (")
    named = ("correct", "march", files / "part.csv", "--out", tmp_path / "again", *CORRECT, "--released-only", "--json")
    assert enter(*named, token=tokens["ben"]).json["programs"][0]["map_state"] == "released"
    done = enter("verify", "march", out / "part.csv", files / "readings.txt", *VERIFY, token=tokens["ben"])
    assert done.code == 0, done
    assert "DRAFT: the program was corrected with a map that was not released" in done.out
    listed = enter("store", "list", "corrections", "--json", token=tokens["ben"]).json["corrections"]
    assert [(one["draft"], one["made_by"]) for one in listed] == [(False, "ben"), (True, "ben")]
    (verified,) = enter("store", "list", "verifications", "--json", token=tokens["eva"]).json["verifications"]
    assert verified["correction_id"] in {one["id"] for one in listed}
    withdrawn = enter(
        "store", "withdraw", "march", "--reason", "loose nest", "--json", token=tokens["eva"], stdin=(PASSWORD,)
    )
    assert [one["program"] for one in withdrawn.json["corrections"]] == ["part.csv", "part.csv"]
    rows = list(csv.DictReader(io.StringIO(enter("store", "recall", "march", "--csv", token=tokens["ben"]).out)))
    assert [(row["map"], row["robot"], row["made_by"]) for row in rows] == [("march", "robot17", "ben")] * 2
    for map_ in (march, "march"):
        again = enter("correct", map_, files / "part.csv", "--out", out, *CORRECT, token=tokens["ben"])
        assert "is withdrawn" in again.failed()


@pytest.mark.exhaustive
def test_an_update_keeps_its_parent_for_the_recall(enter, tokens, files, tmp_path):
    march, april = files / "march.truepose", files / "april.truepose"
    enter("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", march, token=tokens["anna"])
    done = enter("update", march, files / "later.csv", "--out", april, "--anyway", token=tokens["anna"])
    assert done.code == 0, done.err
    enter("correct", april, files / "part.csv", "--out", tmp_path / "c", *CORRECT, token=tokens["ben"])
    found = enter("store", "recall", "march", "--json", token=tokens["eva"]).json
    assert found["corrections"] == []
    (updated,) = found["updated"]
    assert (updated["map"]["name"], [one["program"] for one in updated["corrections"]]) == ("april", ["part.csv"])
    text = enter("store", "recall", "march", token=tokens["eva"]).out
    assert "0 with this map, 1 with maps updated from it." in text


def test_a_corrected_program_is_refused_on_another_machine(enter, tokens, files, tmp_path, monkeypatch):
    """The copy has another name and no record beside it, and the other machine has no list of corrected programs."""
    march, out = files / "march.truepose", tmp_path / "corrected"
    enter("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", march, token=tokens["anna"])
    assert enter("correct", march, files / "part.csv", "--out", out, *CORRECT, token=tokens["ben"]).code == 0
    monkeypatch.setenv("TRUEPOSE_STATE", str(tmp_path / "state of another machine"))
    programs = tmp_path / "another machine"
    programs.mkdir()
    shutil.copy(out / "part.csv", programs / "copy.csv")
    shutil.copy(files / "part.csv", programs / "part.csv")
    named = ("correct", "march", programs / "copy.csv", programs / "part.csv", "--out", tmp_path / "again", *CORRECT)
    refused = enter(*named, token=tokens["ben"]).failed()
    reason = r"copy\.csv: was corrected already: on 20\d\d-\d\d-\d\d with the map march \(\w{12}\), from part\.csv"
    assert re.search(reason, refused)
    assert "do not correct it twice: take the original" in refused
    assert not (tmp_path / "again").exists()
    done = enter(*named, "--keep-going", "--json", token=tokens["ben"])
    assert done.code == 1
    assert [Path(one["file"]).name for one in done.json["refused"]] == ["copy.csv"]
    assert sorted(path.name for path in (tmp_path / "again").glob("*.csv")) == ["part.corrections.csv", "part.csv"]


@pytest.mark.exhaustive
def test_a_validation_is_recorded_with_its_samples(enter, tokens, files):
    """Of a map of the store by its name, also of one that was withdrawn; twice is one row."""
    enter("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", files / "m.truepose", token=tokens["anna"])
    assert enter("store", "withdraw", "m", "--reason", "x", token=tokens["eva"], stdin=(PASSWORD,)).code == 0
    for named in ("m", files / "m.truepose"):
        done = enter("validate", named, files / "later.csv", "--json", token=tokens["anna"])
        assert done.code == 0, done
    (row,) = enter("store", "list", "verifications", "--json", token=tokens["eva"]).json["verifications"]
    assert (row["kind"], row["made_by"]) == ("map", "anna")
    assert row["figures"]["after"]["mean_mm"] == done.json["after"]["mean_mm"]
    assert row["reading_set_id"] == 2
    assert "needs the role" in enter("validate", "m", files / "later.csv", token=tokens["eva"]).failed()


@pytest.mark.exhaustive
def test_a_report_shows_the_head_and_the_state(enter, tokens, files, address, no_figures):
    enter("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", files / "m.truepose", token=tokens["anna"])
    with Store.open(address) as store:
        head = store.head()
    out = files / "report.html"
    assert enter("report", "m", "--out", out, token=tokens["eva"]).code == 0
    text = out.read_text()
    assert head.hash in text
    assert "DRAFT: this map is not released." in text
    with Store.open(address) as store:
        assert store.head().sequence == head.sequence + 1


def test_a_command_that_may_not_record_does_nothing(enter, tokens, files):
    out = files / "m.truepose"
    fit = ("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", out)
    for token, message in ((tokens["ben"], "needs the role measure"), ("tp_0_0", "not known"), ("", "has users")):
        assert message in enter(*fit, token=token).failed()
    assert not out.exists()
    unreachable = enter(*fit, "--store", files / "nowhere", token=tokens["anna"])
    assert "nowhere" in unreachable.failed()
    assert not out.exists()


@pytest.mark.exhaustive
def test_files_that_the_store_lost_are_named_and_taken_in_later(enter, tokens, files, monkeypatch):
    """The user is disabled while the command works: its file stays, and the message says what to do."""
    from truepose.store import access, users

    out, checks = files / "m.truepose", []
    check = access.check

    def disabling(connection, identity, action):
        check(connection, identity, action)
        if action == "fit" and not checks:
            checks.append(identity)
            monkeypatch.setattr(access, "check", check)

    monkeypatch.setattr(access, "check", disabling)
    changing = access.changing

    def lost(store, identity, action):
        if action == "fit":
            with changing(store, access.log_in(store, "chief", PASSWORD), "manage"):
                pass
            users.set_disabled(store, access.log_in(store, "chief", PASSWORD), "anna", True)
        return changing(store, identity, action)

    monkeypatch.setattr(access, "changing", lost)
    failed = enter("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", out, token=tokens["anna"]).failed()
    assert "anna is disabled" in failed
    assert f"{out} is written, but the store has no row of it: take it in with 'truepose store import {out}" in failed
    assert out.is_file()
    monkeypatch.setattr(access, "changing", changing)
    assert enter("store", "list", "maps", "--json", token=tokens["eva"]).json["maps"] == []
    assert enter("store", "import", files, "--json", token=tokens["ben"]).json["taken"]
    (made,) = enter("store", "list", "maps", "--json", token=tokens["eva"]).json["maps"]
    assert (made["name"], made["made_by"]) == ("m", "ben")


@pytest.mark.exhaustive
def test_a_map_file_that_the_store_does_not_have_is_refused(enter, tokens, files, tmp_path):
    shutil.copy(plant().map, files / "m.truepose")
    correct = ("correct", files / "m.truepose", files / "part.csv", "--out", tmp_path / "c", *CORRECT)
    failed = enter(*correct, token=tokens["ben"]).failed()
    assert f"this map is not in the store; add it with 'truepose store import {files / 'm.truepose'}" in failed
    assert "no such file, and the store has no map" in enter("correct", "x", *correct[2:], token=tokens["ben"]).failed()
    assert "--released-only has no effect without --store" in _without_store(enter, correct)


def _without_store(enter, correct) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("TRUEPOSE_STORE")
        return enter(*correct, "--released-only").failed()


@pytest.mark.exhaustive
def test_users_and_tokens_are_managed(enter, tokens):
    known = enter("store", "user", "list", "--json", token=tokens["ben"]).json["users"]
    assert [(one["name"], one["roles"]) for one in known][:2] == [("anna", ["measure"]), ("ben", ["program"])]
    assert "needs the role admin" in enter("store", "user", "disable", "anna", token=tokens["ben"]).failed()
    assert enter("store", "user", "roles", "BEN", "--role", "measure", token=tokens["chief"]).code == 0
    assert enter("store", "user", "disable", "Anna", token=tokens["chief"]).code == 0
    assert "disabled" in enter("store", "user", "list", token=tokens["anna"]).failed()
    assert enter("store", "user", "enable", "anna", token=tokens["chief"]).code == 0
    changed = ("store", "user", "password", "anna", "--user", "anna")
    assert enter(*changed, stdin=(PASSWORD, "a new long password")).code == 0
    assert "password is wrong" in enter(*changed, stdin=(PASSWORD, "another long one")).failed()
    (own,) = enter("store", "token", "list", "--json", token=tokens["ben"]).json["tokens"]
    assert own["identity"] in tokens["ben"]
    assert enter("store", "token", "revoke", own["identity"], token=tokens["ben"]).code == 0
    assert "revoked" in enter("store", "token", "list", token=tokens["ben"]).failed()


def test_passwords_are_never_arguments_and_need_a_terminal_or_stdin(enter, tokens):
    done = enter("store", "user", "password", "anna", "--password", "x", token=tokens["chief"])
    assert done.code == 2
    assert "--password-stdin" in enter("store", "user", "password", "anna", token=tokens["chief"]).failed()


def test_a_store_without_users_is_open_but_nobody_can_release(enter, files):
    out = files / "m.truepose"
    assert enter("fit", files / "cell.toml", files / "samples.csv", *FIT, "--out", out).code == 0
    assert "needs the role release" in enter("store", "release", "m", stdin=(PASSWORD,)).failed()
    assert (
        "must have the role admin" in enter("store", "user", "add", "x", "--role", "read", stdin=(PASSWORD,)).failed()
    )
