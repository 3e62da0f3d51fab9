"""Programs in the styles that are met in the field, written for this project: each language, many hands and generators.

Each has the verdicts that its author expects. `tests/programs/test_corpus.py` reads them, `tests/programs/fuzz.py`
injures them.
"""

from __future__ import annotations

from pathlib import Path

from tests.programs.corpus_fanuc import FANUC
from tests.programs.corpus_krl import KRL
from tests.programs.corpus_other import OTHER
from tests.programs.corpus_rapid import RAPID
from tests.programs.corpus_urscript import UR
from tests.programs.example import FRAMES, MEASURED, Example

from truepose.programs import ReadOptions

__all__ = ["CORPUS", "FRAMES", "Example"]

SAMPLES = Path(__file__).parent / "samples"
"""Many constructs of a language in one file, as far as they fit."""


def sample(*names: str) -> dict[str, str]:
    """Return files of the folder of samples."""
    return {name: (SAMPLES / name).read_bytes().decode("latin-1") for name in names}


LENIENT = ReadOptions(calls_keep_frames=True, angles="kuka", whole_task=True)
MANY = {
    "k1": Example(sample("k1.src"), 3, 10, 1, options=LENIENT),
    "k2": Example(sample("k2.src", "k2.dat"), 2, options=LENIENT),
    "k3": Example(sample("k3.src"), 9, 12, 1, options=LENIENT),
    "k4": Example(sample("k4.src"), 0, 1, options=LENIENT),
    "r1": Example(sample("r1.mod"), 0, 6, 2, options=LENIENT),
    "r2": Example(sample("r2.prg"), 3, 4, 3, options=LENIENT),
    "f1": Example(sample("f1.ls"), 4, 3, 1, options=LENIENT),
    "f2": Example(sample("f2.ls"), 6, 0, 4, options=LENIENT),
    "u1": Example(sample("u1.script"), 2, 2, 1, options=LENIENT),
    "u2": Example(sample("u2.script"), 4, 4, 2, options=LENIENT),
    "u3": Example(sample("u3.script"), 2, options=LENIENT, frames=MEASURED),
    "j1": Example(sample("j1.jbi"), 1, 3, 2, options=LENIENT),
    "v1": Example(sample("v1.dtx"), 1, 3, 1, options=LENIENT, frames=MEASURED),
    "n1": Example(sample("n1.nc"), 3, 2, options=LENIENT),
    "g2": Example(sample("g2.nc"), 1, 0, 10, options=LENIENT),
    "a1": Example(sample("a1.apt"), 0, 1, 5, options=LENIENT),
}

CORPUS = {
    f"{language}-{name}": example
    for language, examples in {
        "krl": KRL,
        "rapid": RAPID,
        "fanuc": FANUC,
        "ur": UR,
        "other": OTHER,
        "many": MANY,
    }.items()
    for name, example in examples.items()
}
