"""The document of a report: sections of blocks with finished text, for the templates to lay out."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any, ClassVar, Final

_TIED: Final = re.compile(
    r"(?<=[0-9]) (?=(?:mm|µm|rad|kg|°|%)(?![a-z]))|(?<=\b[xyz]) (?=[−0-9])|(?<=±) | (?=±)"
    r"|(?<=\bk) (?==)|(?<=\bk =) (?=2)"
)


@dataclass(frozen=True)
class Text:
    """A paragraph; a warning is set apart."""

    kind: ClassVar[str] = "text"
    text: str
    warns: bool = False


@dataclass(frozen=True)
class Facts:
    """A list of names with a text each, in one or two columns; `missing` holds the rows of missing facts."""

    kind: ClassVar[str] = "facts"
    rows: list[tuple[str, str]]
    missing: list[int] = field(default_factory=list)
    columns: int = 1


@dataclass(frozen=True)
class Table:
    """A table; the first ``left`` and the last ``last_left`` columns hold words, the others numbers."""

    kind: ClassVar[str] = "table"
    columns: list[str]
    rows: list[list[str]]
    left: int = 1
    last_left: int = 0

    @property
    def words(self) -> list[bool]:
        """A mask of the columns that hold words."""
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
    """Signature fields: a sentence on what is signed, and a row per role with name, date and signature."""

    kind: ClassVar[str] = "signatures"
    about: str
    columns: list[str]
    rows: list[str]


@dataclass(frozen=True)
class Logo:
    """A picture file of the company: its format (png, jpg, svg), its content, and its description."""

    form: str
    content: bytes
    description: str

    def to_dict(self) -> dict[str, Any]:
        """Return the logo as plain values: a data URI for a page, and a list of bytes for a PDF."""
        kind = {"svg": "svg+xml", "jpg": "jpeg"}.get(self.form, self.form)
        uri = f"data:image/{kind};base64,{base64.b64encode(self.content).decode('ascii')}"
        return {"form": self.form, "uri": uri, "bytes": list(self.content), "description": self.description}


@dataclass(frozen=True)
class Attachment:
    """A table as a CSV file: attached to a PDF, and a link for saving on a page."""

    name: str
    description: str
    text: str

    def to_dict(self) -> dict[str, Any]:
        """Return the attachment as plain values, with a data URI for a page."""
        content = base64.b64encode(self.text.encode("utf-8")).decode("ascii")
        return {**asdict(self), "uri": f"data:text/csv;charset=utf-8;base64,{content}"}


@dataclass(frozen=True)
class View:
    """An interactive view for pages: its scene, caption, words, and the decadic logarithms of the arrows' scale."""

    kind: ClassVar[str] = "view"
    scene: dict[str, Any]
    caption: str
    words: dict[str, str]
    low: float
    start: float
    high: float


Block = Text | Facts | Table | Picture | Signatures | View


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
        The language tag.
    fonts : tuple of str
        The font families of the PDF's text.
    title : str
        The heading.
    stamp : str
        The origin of the report, printed on every page.
    page : str
        The word for page.
    attached : str
        The heading of the attachments.
    tiles : list of (str, str)
        The main figures, each with its caption.
    lead : list of Text
        The summary and the warnings.
    sections : list of Section
        The sections in their order.
    logo : Logo or None
        The company's logo.
    attachments : list of Attachment
        The complete tables.
    """

    language: str
    fonts: tuple[str, ...]
    title: str
    stamp: str
    page: str
    attached: str
    tiles: list[tuple[str, str]]
    lead: list[Text]
    sections: list[Section]
    logo: Logo | None = None
    attachments: list[Attachment] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Return the document as plain values; blocks have a ``kind``, and tables a mask ``words`` of their columns."""
        plain = asdict(self) | {"logo": None, "attachments": []}
        for own, section in zip(self.sections, plain["sections"], strict=True):
            for block, values in zip(own.blocks, section["blocks"], strict=True):
                values["kind"] = block.kind
                if isinstance(block, Table):
                    values["words"] = block.words
        tied: dict[str, Any] = _tied(plain)
        logo = None if self.logo is None else self.logo.to_dict()
        return tied | {"logo": logo, "attachments": [one.to_dict() for one in self.attachments]}

    def text(self) -> str:
        """Return all text of the document as one string, without pictures."""
        shown = replace(self, attachments=[replace(one, text="") for one in self.attachments])
        return "".join(_strings(asdict(shown)))


def _tied(value: Any) -> Any:
    """Return plain values with no-break spaces between numbers and their units."""
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
