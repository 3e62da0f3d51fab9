"""Tables of results: as HTML for notebooks, and for pandas, which is optional (``pip install 'truepose[pandas]'``)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from truepose._extras import needed

if TYPE_CHECKING:
    from pandas import DataFrame


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


def data_frame(columns: Mapping[str, Any], **facts: Any) -> DataFrame:
    """Return a pandas table of columns (n,) by name; `facts` are kept in its ``attrs``.

    Raises
    ------
    MissingPackageError
        If pandas is not installed.

    Examples
    --------
    >>> data_frame({"lag": [1.0, 2.0]}, estimator="matheron").attrs
    {'estimator': 'matheron'}
    """
    with needed("a table of pandas", "pandas"):
        from pandas import DataFrame
    frame = DataFrame(dict(columns))
    frame.attrs.update(facts)
    return frame


def by_axis(values: NDArray[Any], name: str) -> dict[str, NDArray[Any]]:
    """Return the columns of a (n, 3) array by name: ``{}`` in it stands for x, y, z.

    Examples
    --------
    >>> import numpy as np
    >>> list(by_axis(np.zeros((5, 3)), "{}_std_mm"))
    ['x_std_mm', 'y_std_mm', 'z_std_mm']
    """
    return {name.format(axis): values[:, k] for k, axis in enumerate("xyz")}


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))
