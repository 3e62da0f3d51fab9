"""Write a report as one self-contained HTML page or as a PDF; both show the same document."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib import resources
from pathlib import Path
from typing import Any, Final

from truepose._extras import needed
from truepose._io import files
from truepose.cell import Cell
from truepose.error_map import ErrorMap
from truepose.errors import FileError
from truepose.programs import ProgramVerification
from truepose.report import fonts
from truepose.report.document import Document, View
from truepose.report.evidence import Evidence, StoreEntry, gather
from truepose.report.headline import Headline, headline
from truepose.report.locale import load_locale
from truepose.report.plots.palette import COLOURS, DARK, LIGHT
from truepose.report.sections import document
from truepose.report.study import SimilarityStudy
from truepose.samples import Samples

_JOINTS: Final = re.compile(r"(?<=[_/\\])(?=\w)|(?<=\.)(?=[A-Za-z])")
_LONG: Final = 24
"""The length from which a name in a table may be broken."""
_ENDINGS: Final = (".html", ".htm", ".pdf")


def write_report(
    error_map: ErrorMap,
    path: str | Path,
    held_out: Samples | None = None,
    *,
    cell: Cell | None = None,
    sidecars: Sequence[str | Path] = (),
    verifications: Sequence[str | Path | ProgramVerification] = (),
    study: SimilarityStudy | None = None,
    locale: str = "en",
    date: datetime | None = None,
    interactive: bool = False,
    store: StoreEntry | None = None,
) -> Headline:
    """Write a report about an error map to one file, and return its decision; a failure leaves the old file unchanged.

    Parameters
    ----------
    error_map : ErrorMap
        The error map that the report describes.
    path : str or Path
        The file to write. ``.html`` gives one page that loads nothing from elsewhere, ``.pdf`` a PDF/A-3u.
        Complete tables are attached to both as CSV.
    held_out : Samples, optional
        Samples that took no part in the fit, for the accuracy before and after. Without them, each sample is predicted
        from the others, and the report says so.
    cell : Cell, optional
        The cell with the facts of the report (``[report]``) and the tolerance; the map's own if not given.
    sidecars : sequence of str or Path
        Records of corrected programs, as ``truepose correct`` writes them.
    verifications : sequence of str, Path or ProgramVerification
        Verifications of corrected programs, from `truepose.verify_program` or ``truepose verify --out FILE.json``.
    study : SimilarityStudy, optional
        The similarity study of the samples; computed if not given.
    locale : {"en", "de", "zh"}
        The language of the report.
    date : datetime, optional
        The date of the report; the present time if not given.
    interactive : bool
        Whether a page contains a view of the errors and the arm that can be turned; not for a PDF.
    store : StoreEntry, optional
        The state of the map and the head of the audit trail in the store that the report is made with.

    Returns
    -------
    Headline
        The decision at the head of the report: the worst of those on held-out poses and on verified programs.

    Raises
    ------
    FileError
        If the path ends neither in ``.html`` nor in ``.pdf``, an interactive PDF is requested, a record cannot be read,
        or the path cannot be written.
    MissingPackageError
        If the packages of ``truepose[report]``, or of ``truepose[pdf]`` for a PDF, are not installed.
    DataError
        If the locale is not known, or the held-out samples or the cell do not fit the error map.

    Examples
    --------
    >>> import truepose as tp
    >>> error_map = tp.load_map("map.truepose")  # doctest: +SKIP
    >>> write_report(error_map, "report.html", tp.read_samples("test.csv"))  # doctest: +SKIP
    """
    ending, say = Path(path).suffix.lower(), load_locale(locale)
    if ending not in _ENDINGS:
        raise FileError(path, f"expected a name that ends in .html or .pdf, got {ending or 'no ending'}")
    if ending == ".pdf":
        if interactive:
            raise FileError(path, "a PDF cannot be interactive; name an .html file")
        _typst()
    else:
        _jinja2()
    evidence: Evidence = gather(
        error_map,
        held_out,
        cell=cell,
        sidecars=sidecars,
        verifications=verifications,
        study=study,
        date=date,
        store=store,
    )
    made = document(evidence, say, interactive=interactive)
    files.write_atomic(path, to_pdf(made, evidence.date, path) if ending == ".pdf" else to_html(made))
    return headline(evidence)


def to_html(made: Document) -> str:
    """Return a document as one page that loads nothing; fonts for Chinese characters are embedded."""
    jinja2 = _jinja2()
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_resource),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["themed"] = _themed
    environment.filters["breakable"] = _breakable
    interactive = any(isinstance(block, View) for section in made.sections for block in section.blocks)
    script = _resource("view.js") if interactive else ""
    allowed = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii") if script else ""
    font = fonts.embedded(made.text())
    page: str = environment.get_template("report.html").render(
        made=made.to_dict(),
        font=font,
        family=fonts.FAMILY,
        light=_properties(LIGHT),
        dark=_properties(DARK),
        script=script,
        allowed=allowed,
    )
    return page


def to_pdf(made: Document, date: datetime, path: str | Path = "report.pdf") -> bytes:
    """Return a document as PDF; `path` is used in messages.

    Raises
    ------
    FileError
        If no installed font has a character of the report.
    MissingPackageError
        If typst is not installed.

    Notes
    -----
    The PDF is a PDF/A-3u for archiving, with all fonts embedded and the complete tables attached as CSV. A character
    without a font is an error.
    """
    typst = _typst()

    def compiled(with_system_fonts: bool) -> bytes:
        known = typst.Fonts(include_system_fonts=with_system_fonts, font_paths=[str(fonts.folder())])
        pdf: bytes = typst.compile(
            _resource("report.typ").encode(),
            font_paths=known,
            sys_inputs={"report": json.dumps(made.to_dict(), ensure_ascii=False)},
            timestamp=int(date.timestamp()),
            pdf_standards=["a-3u"],
        )
        return pdf

    try:
        return compiled(False)
    except typst.TypstError:  # probably a character that the report's fonts lack
        try:
            return compiled(True)
        except typst.TypstError as error:
            remedy = "install a font with this character, such as Noto Sans CJK, or write .html"
            raise FileError(path, f"cannot be typeset: {' '.join(error.message.split())}; {remedy}") from None


def _properties(colours: Mapping[str, str]) -> str:
    """Return colours by name as properties of a style sheet."""
    return " ".join(f"--{name}: {colour};" for name, colour in colours.items())


def _themed(svg: str) -> str:
    """Return a picture with the colours of the page, for its light and dark schemes."""
    for colour, name in COLOURS.items():
        svg = svg.replace(colour, f"var(--{name})")
    return svg


def _breakable(text: str) -> Any:
    """Return escaped text in which a long name may be broken after its underscores, dots and slashes."""
    with needed("a report", "report"):
        from markupsafe import Markup, escape

    return Markup("<wbr>").join(escape(part) for part in _JOINTS.split(text)) if len(text) > _LONG else text


def _jinja2() -> Any:
    with needed("a report", "report"):
        import jinja2
    return jinja2


def _typst() -> Any:
    with needed("a report as PDF", "pdf", "write .html and print it"):
        import typst
    return typst


def _resource(name: str) -> str:
    return resources.files("truepose.report").joinpath("templates", name).read_text(encoding="utf-8")
