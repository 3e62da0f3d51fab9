"""What an example program is, and the frames that examples use."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from truepose.programs import FrameTable, ReadOptions

NAMES = (
    "tGrip",
    "tWeldGun",
    "tool_1",
    "Torch",
    "wFix",
    "wobj_table",
    "Workobject_1",
    "world",
    "flange",
    "tJaw",
    "fJig",
)
FRAMES = FrameTable(
    tools={**{n: np.eye(4) for n in range(17)}, **dict.fromkeys(NAMES, np.eye(4))},
    bases={**{n: np.eye(4) for n in range(33)}, **dict.fromkeys(NAMES, np.eye(4)), "G54": np.eye(4)},
)
MEASURED = replace(FRAMES, tool="map")
"""The same, where the tool in force is the one that the map was measured with."""


@dataclass(frozen=True)
class Example:
    """A program: files by name (the first is given), and how many targets have which verdict."""

    files: dict[str, str]
    correct: int
    skip: int = 0
    refuse: int = 0
    encoding: str = "latin-1"
    options: ReadOptions = field(default_factory=ReadOptions)
    frames: FrameTable = FRAMES

    def data(self) -> dict[str, bytes]:
        """Return the files as they are on disk."""
        return {name: text.encode(self.encoding) for name, text in self.files.items()}


def crlf(text: str) -> str:
    """Return the text with line ends of Windows."""
    return text.replace("\n", "\r\n")
