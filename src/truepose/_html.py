"""Tables of results as HTML, for notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any


def facts_table(caption: str, facts: Mapping[str, Any]) -> str:
    """Return a table with one row for each fact.

    Examples
    --------
    >>> facts_table("Samples", {"rows": 5})
    '<table><caption>Samples</caption><tr><th>rows</th><td>5</td></tr></table>'
    """
    rows = (f"<tr><th>{escape(name)}</th><td>{_cell(value)}</td></tr>" for name, value in facts.items())
    return f"<table><caption>{escape(caption)}</caption>{''.join(rows)}</table>"


def html_table(caption: str, header: Sequence[str], rows: Iterable[Sequence[Any]], notes: Sequence[str] = ()) -> str:
    """Return a table with a header, and notes below it.

    Examples
    --------
    >>> html_table("Bins", ["lag"], [[12.5]])
    '<table><caption>Bins</caption><tr><th>lag</th></tr><tr><td>12.5</td></tr></table>'
    """
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join(f"<tr>{''.join(f'<td>{_cell(value)}</td>' for value in row)}</tr>" for row in rows)
    below = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return f"<table><caption>{escape(caption)}</caption><tr>{head}</tr>{body}</table>{below}"


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))
