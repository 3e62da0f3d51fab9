"""XML as elements that know where the values of their attributes stand in the text."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple
from xml.parsers import expat

from truepose.errors import FileError
from truepose.programs.core.source import Source

_TAG: Final = re.compile(rb"<[^\s/>]+")
_ATTRIBUTE: Final = re.compile(rb"\s*([\w:.-]+)\s*=\s*(?:\"([^\"<]*)\"|'([^'<]*)')")
_PLACE: Final = re.compile(r"(\w[\w.-]*)(?:\[([0-9]{1,6})\])?")
_DEEPEST: Final = 500
"""The largest depth of elements."""


class Value(NamedTuple):
    """The value of an attribute: its bytes as written, and the first of them."""

    data: bytes
    start: int


@dataclass(slots=True, eq=False)
class Element:
    """An element.

    Attributes
    ----------
    tag : str
        The name.
    line : int
        The line.
    attributes : dict of str to Value
        The attributes.
    parent : Element, optional
        The element around it.
    children : list of Element
        The elements in it.
    words : list of str
        The text in it, without that of its children.
    """

    tag: str
    line: int
    attributes: dict[str, Value]
    parent: Element | None
    children: list[Element] = field(default_factory=list)
    words: list[str] = field(default_factory=list)

    def get(self, name: str) -> str:
        """Return the text of an attribute; empty without it."""
        value = self.attributes.get(name)
        return "" if value is None else value.data.decode("utf-8", "replace")

    @property
    def text(self) -> str:
        """The text in it."""
        return "".join(self.words)

    def child(self, tag: str) -> Element | None:
        """Return the first child of a name."""
        return next((child for child in self.children if child.tag == tag), None)

    def walk(self) -> Iterator[Element]:
        """Yield the element and all below it, in the order of the text."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)

    def around(self) -> Iterator[Element]:
        """Yield the elements around it, from the inside."""
        element = self.parent
        while element is not None:
            yield element
            element = element.parent

    def at(self, path: str) -> Element | None:
        """Return the element that a path such as ``../../Move[2]/feature`` leads to from here."""
        element: Element | None = self
        for part in path.split("/"):
            if element is None:
                return None
            if part == "..":
                element = element.parent
            elif m := _PLACE.fullmatch(part):
                alike = [child for child in element.children if child.tag == m[1]]
                k = int(m[2] or 1) - 1
                element = alike[k] if 0 <= k < len(alike) else None
            else:
                return None
        return element


def parse(source: Source) -> Element:
    """Return the root element of a text; a FileError names the line if it is broken or has a DOCTYPE."""
    parser = expat.ParserCreate()
    parser.buffer_text = True
    top: list[Element] = []
    stack: list[Element] = []

    def start(tag: str, _: dict[str, str]) -> None:
        line = parser.CurrentLineNumber
        if len(stack) > _DEEPEST:
            raise source.error(line, f"has elements more than {_DEEPEST} deep; that is no program")
        element = Element(tag, line, _attributes(source, parser.CurrentByteIndex), stack[-1] if stack else None)
        (stack[-1].children if stack else top).append(element)
        stack.append(element)

    def end(_: str) -> None:
        stack.pop()

    def text(words: str) -> None:
        if stack and words.strip():
            stack[-1].words.append(words)

    def doctype(*_: object) -> None:
        raise source.error(parser.CurrentLineNumber, "has a DOCTYPE, which the controller never writes; remove it")

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, text
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(source.data, True)
    except expat.ExpatError as error:
        raise source.error(error.lineno, f"is broken XML: {expat.ErrorString(error.code)}; correct the file") from None
    except (ValueError, LookupError) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(source.path, "has an encoding that is not known; save it as UTF-8") from None
    return top[0]


def _attributes(source: Source, start: int) -> dict[str, Value]:
    """Return the attributes of the tag at a byte."""
    m = _TAG.match(source.data, start)
    found: dict[str, Value] = {}
    while m is not None and (m := _ATTRIBUTE.match(source.data, m.end())):
        k = 2 if m[2] is not None else 3
        found[m[1].decode("latin-1")] = Value(m[k], m.start(k))
    return found
