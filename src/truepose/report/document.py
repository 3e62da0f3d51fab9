"""What a report is made of: sections of blocks that hold finished text. The page and the PDF only lay it out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Final

_TIED: Final = re.compile(r"(?<=[0-9]) (?=(?:mm|µm|rad|kg|°|%)(?![a-z]))|(?<=\b[xyz]) (?=[−0-9])|(?<=±) | (?=±)")


@dataclass(frozen=True)
class Text:
    """A paragraph; one with ``warns`` is set apart."""

    kind: ClassVar[str] = "text"
    text: str
    warns: bool = False


@dataclass(frozen=True)
class Facts:
    """Names and what is to say about each."""

    kind: ClassVar[str] = "facts"
    rows: list[tuple[str, str]]


@dataclass(frozen=True)
class Table:
    """Rows of cells: the first ``left`` columns and the last ``last_left`` hold words, the others numbers."""

    kind: ClassVar[str] = "table"
    columns: list[str]
    rows: list[list[str]]
    left: int = 1
    last_left: int = 0

    @property
    def words(self) -> list[bool]:
        """Which columns are of words."""
        n = len(self.columns)
        return [k < self.left or k >= n - self.last_left for k in range(n)]


@dataclass(frozen=True)
class Picture:
    """An SVG element in the colours of `report.plots.figures`, its caption, and its share of the page's width."""

    kind: ClassVar[str] = "picture"
    svg: str
    caption: str
    width: float = 1.0


@dataclass(frozen=True)
class Signatures:
    """Fields to sign: what the signatures stand for, and who did what, with columns for name, date and signature."""

    kind: ClassVar[str] = "signatures"
    about: str
    columns: list[str]
    rows: list[str]


Block = Text | Facts | Table | Picture | Signatures


@dataclass(frozen=True)
class Section:
    """A titled part of the report."""

    title: str
    blocks: list[Block]


@dataclass(frozen=True)
class Document:
    """A whole report.

    Attributes
    ----------
    language : str
        Language tag.
    fonts : tuple of str
        Families of the PDF's text.
    title, stamp, page : str
        Heading; what every page says of its origin; the word for page.
    tiles : list of (str, str)
        The figures that matter, and what each is.
    lead : list of Text
        What a reader should know first.
    sections : list of Section
    """

    language: str
    fonts: tuple[str, ...]
    title: str
    stamp: str
    page: str
    tiles: list[tuple[str, str]]
    lead: list[Text]
    sections: list[Section]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values; each block names its ``kind``, and a table which columns are ``words``."""
        plain = asdict(self)
        for own, section in zip(self.sections, plain["sections"], strict=True):
            for block, values in zip(own.blocks, section["blocks"], strict=True):
                values["kind"] = block.kind
                if isinstance(block, Table):
                    values["words"] = block.words
        tied: dict[str, Any] = _tied(plain)
        return tied

    def text(self) -> str:
        """Return all that is set as text, in one; what stands in pictures is shapes."""
        return "".join(_strings(asdict(self)))


def _tied(value: Any) -> Any:
    """Return plain values with their numbers tied to their units and names, so that no line ends between."""
    if isinstance(value, str):
        return value if value.startswith("<svg") else _TIED.sub("\u00a0", value)
    if isinstance(value, dict):
        return {key: _tied(inner) for key, inner in value.items()}
    return [_tied(inner) for inner in value] if isinstance(value, list | tuple) else value


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str) and not value.startswith("<svg"):
        yield value
    elif isinstance(value, dict | list | tuple):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _strings(inner)
