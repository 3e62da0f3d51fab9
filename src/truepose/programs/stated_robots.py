"""The robots of maps whose cell stated none when they were fitted, as their users have stated them since.

A statement adds a line of JSON to ``MAP.robot`` beside the map, and to ``robots.jsonl`` in the user's own state folder
(see `truepose.programs.history`), so that it is asked for once. The last line about a map counts.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from truepose.programs import history


def stated_robot(map_hash: str | None, map_path: Path | None) -> str | None:
    """Return the id of the robot that a map is stated to be of; None if nobody has stated it."""
    found = None
    for path in _lists(map_path):
        for line in _lines(path):
            try:
                entry = json.loads(line)
                if map_hash is not None and entry["map_sha256"] == map_hash:
                    found = str(entry["robot"])
            except (ValueError, KeyError, TypeError, RecursionError):  # what a killed run left of a line
                continue
    return found


def state_robot(map_hash: str, map_path: Path | None, robot_id: str) -> None:
    """Keep of which robot a map is."""
    date = datetime.now(UTC).isoformat(timespec="seconds")
    line = json.dumps({"date": date, "map_sha256": map_hash, "robot": robot_id}, ensure_ascii=False)
    for path in _lists(map_path):
        try:
            history.append(path, f"\n{line}\n")
        except OSError as error:
            what = f"cannot be written ({error.strerror or error}), and the robots of maps are stated there"
            warnings.warn(f"{path}: {what}", UserWarning, stacklevel=2)


def _lists(map_path: Path | None) -> list[Path]:
    beside = [] if map_path is None else [map_path.with_name(f"{map_path.name}.robot")]
    return [*(path.with_name("robots.jsonl") for path in history.stores(None)), *beside]


def _lines(path: Path) -> Iterator[str]:
    try:
        yield from path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return
