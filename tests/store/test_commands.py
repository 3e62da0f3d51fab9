"""The commands of ``truepose store``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from truepose.cli import main


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    """Run a command in this process and return its exit code."""
    monkeypatch.setattr("sys.argv", ["truepose", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        main()
    return int(end.value.code or 0)


def test_a_store_is_made_checked_moved_and_checked_again(
    new_address: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert callable(new_address)
    monkeypatch.setenv("TRUEPOSE_STORE", new_address())
    assert run(monkeypatch, "store", "init", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert run(monkeypatch, "store", "head") == 0
    assert capsys.readouterr().out == f"1 {made['head']}\n"
    assert run(monkeypatch, "store", "backup", tmp_path / "backup.zip", "--json") == 0
    assert json.loads(capsys.readouterr().out)["head"] == made["head"]
    assert run(monkeypatch, "store", "backup", tmp_path / "backup.zip") == 1
    assert "--force" in capsys.readouterr().err
    assert run(monkeypatch, "store", "restore", tmp_path / "backup.zip", "--store", tmp_path / "copy") == 0
    capsys.readouterr()
    assert run(monkeypatch, "store", "verify", "--store", tmp_path / "copy", "--head", made["head"], "--json") == 0
    assert json.loads(capsys.readouterr().out)["faults"] == []
    assert run(monkeypatch, "store", "migrate", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["from"] == found["to"]


def test_faults_end_verify_with_1(
    address: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "store", "verify", "--store", address, "--head", "f" * 64) == 1
    output = capsys.readouterr()
    assert "Fault: no entry has the head ffff" in output.out
    assert "1 faults, first: no entry has the head" in output.err


def test_a_store_that_is_not_there_is_said_with_its_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in (["verify"], ["head"], ["migrate"], ["backup", tmp_path / "b.zip"]):
        assert run(monkeypatch, "store", *words, "--store", tmp_path / "none") == 1
        assert "truepose store init" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
    assert run(monkeypatch, "store", "restore", tmp_path / "b.zip", "--store", tmp_path / "none") == 1
    assert "no such file" in capsys.readouterr().err


def test_rights_are_granted_to_roles_that_exist(
    address: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "store", "migrate", "--store", address, "--grant", "no_such_role") == 1
    message = capsys.readouterr().err
    assert "has no role 'no_such_role'" in message or "SQLite has no roles" in message
