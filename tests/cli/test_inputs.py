"""What is no readable file, in place of each input of each command: one line, exit code 1 or 2, no traceback."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

HERE = "INPUT"
COMMANDS: dict[str, list[str]] = {
    "plan": [HERE, "--count", "10"],
    "import cell": [HERE, "test", "--plan", "test"],
    "import readings": ["cell", HERE, "--plan", "test"],
    "import plan": ["cell", "test", "--plan", HERE],
    "similarity cell": [HERE, "samples"],
    "similarity samples": ["cell", HERE],
    "check-point": [HERE],
    "fit cell": [HERE, "samples"],
    "fit samples": ["cell", HERE],
    "predict map": [HERE, "test"],
    "predict poses": ["map", HERE],
    "validate map": [HERE, "test"],
    "validate test": ["map", HERE],
    "explain": [HERE],
    "update map": [HERE, "test"],
    "update samples": ["map", HERE],
    "iso9283": [HERE],
    "report map": [HERE],
    "report program": ["map", "--program", HERE],
    "correct map": [HERE, "test"],
    "correct program": ["map", HERE],
    "correct cell": ["map", "test", "--cell", HERE],
    "correct config": ["map", "test", "--config-dat", HERE],
    "check": [HERE],
    "check cell": ["test", "--cell", HERE],
}
ENDINGS = {
    "map": ".truepose",
    "cell": ".toml",
    "readings": ".txt",
    "program": ".src",
    "check": ".src",
    "config": ".dat",
}


def inputs(folder: Path, ending: str) -> dict[str, Path]:
    """Return what is no input, by what it is."""
    paths = {kind: folder / f"{kind}{ending}" for kind in ("folder", "empty", "binary", "fifo", "secret", "absent")}
    paths["folder"].mkdir()
    paths["empty"].touch()
    paths["binary"].write_bytes(bytes(range(256)) * 8)
    os.mkfifo(paths["fifo"])
    paths["secret"].write_text("x")
    paths["secret"].chmod(0)
    if os.access(paths["secret"], os.R_OK):  # root may read it
        del paths["secret"]
    return paths


@pytest.mark.promise("Every command answers an unreadable input with one line and exit code 1 or 2")
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.sampled(2)
def test_what_is_no_input(
    command: str, cell_files: Any, run: Callable[..., Any], tmp_path: Path, monkeypatch: Any, record_property: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    name, _, role = command.partition(" ")
    found = inputs(tmp_path, ENDINGS.get(role or name, ".csv"))
    for kind, path in found.items():
        words = [
            getattr(cell_files, word) if word in ("cell", "samples", "test", "map") else word
            for word in COMMANDS[command]
        ]
        done = run(name, *(path if word == HERE else word for word in words))
        assert done.code in (1, 2), (kind, done)
        assert "Traceback" not in done.err, (kind, done)
        assert "internal error" not in done.err, (kind, done)
        assert done.code == 2 or done.err.count("\n") == 1, (kind, done.err)
    record_property("cases", len(found))
