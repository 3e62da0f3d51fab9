"""The coverage of programs as a page or a table: what is corrected, why the rest is not, what would allow it."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from truepose._io import files
from truepose._version import version
from truepose.errors import FileError
from truepose.programs.coverage import Coverage, CoverageLine
from truepose.report.document import Attachment, Block, Document, Section, Table, Text

_ENDINGS: Final = (".html", ".htm", ".csv")
_NOTHING: Final = "no option"
_MOST: Final = 400
"""The largest number of programs and of reasons that a page lists; the attached table has all."""


def check_path(path: Path) -> None:
    """Refuse a file for the coverage that is neither a page nor a table, or that this installation cannot make.

    Raises
    ------
    FileError
        If the name has another ending.
    MissingPackageError
        If it is a page, and the packages of ``truepose[report]`` are not installed.
    """
    if path.suffix.lower() not in _ENDINGS:
        raise FileError(path, "expected a name that ends in .html or .csv")
    if path.suffix.lower() != ".csv":
        import truepose.report.page  # noqa: F401


def write_coverage(coverage: Coverage, path: str | Path) -> None:
    """Write the coverage of programs to one file; a failure leaves the old file unchanged.

    Parameters
    ----------
    coverage : Coverage
        The coverage.
    path : str or Path
        The file to write: ``.html`` for a page that loads nothing from elsewhere, ``.csv`` for a table.

    Raises
    ------
    FileError
        If the name has another ending, or the file cannot be written.
    MissingPackageError
        If it is a page, and the packages of ``truepose[report]`` are not installed.
    """
    path = Path(path)
    check_path(path)
    files.write_atomic(path, coverage.to_csv() if path.suffix.lower() == ".csv" else page(coverage))


def page(coverage: Coverage) -> str:
    """Return the page of a coverage as HTML.

    Raises
    ------
    MissingPackageError
        If the packages of ``truepose[report]`` are not installed.
    """
    from truepose.report.page import to_html

    return to_html(document(coverage))


def document(coverage: Coverage) -> Document:
    """Return the content of the page of a coverage."""
    total = coverage.total
    done = "corrected" if coverage.corrected else "correctable"
    how = (
        "as corrected with a map" if coverage.corrected else "as read, without a map: limits and guards are not applied"
    )
    tiles = [
        (f"{100 * total.share:.1f} %", f"of the motion targets {done}"),
        (f"{total.correctable:,}", f"{done} targets"),
        (f"{total.targets - total.correctable:,}", "targets that stay nominal"),
        (f"{len(coverage.programs):,}", "programs"),
    ]
    if coverage.unreadable:
        tiles.append((f"{len(coverage.unreadable):,}", "not read or refused"))
    sections = [_options(total), _reasons(total), _programs(coverage, done)]
    if coverage.unreadable:
        sections.append(Section("Not read or refused", [Text(one) for one in coverage.unreadable[:_MOST]]))
    lead = Text(f"Counts are of targets that motions go to, {how}. A joint target counts, too.")
    attached = Attachment("coverage.csv", "all programs and reasons", coverage.to_csv())
    return Document(
        "en", (), "Coverage of robot programs", f"truepose {version()}", "page", "Tables", tiles, [lead], sections,
        attachments=[attached],
    )  # fmt: skip


def _options(total: CoverageLine) -> Section:
    """Return the section on what options would allow."""
    assumed = {one.remedy.option: one.remedy.assumption for one in total.reasons if one.remedy is not None}
    counts = total.by_option()
    if not counts:
        return Section("What would allow more", [Text("Nothing is left: every target is covered.")])
    rows = [
        [option or _NOTHING, assumed.get(option, "these targets stay as they are"), f"{n:,}", _share(n, total.targets)]
        for option, n in sorted(counts.items(), key=lambda item: (not item[0], -item[1]))
    ]
    told = "Give an option only if what it assumes is true. A target may need more than one."
    return Section("What would allow more", [Text(told), Table(["Option", "It assumes", "Targets", "%"], rows, left=2)])


def _reasons(total: CoverageLine) -> Section:
    rows = [
        [one.reason, one.remedy.option if one.remedy else _NOTHING, f"{one.count:,}", _share(one.count, total.targets)]
        for one in total.reasons[:_MOST]
    ]
    if not rows:
        return Section("Reasons", [Text("No target stays nominal.")])
    blocks: list[Block] = [Table(["Reason", "Option", "Targets", "%"], rows, left=2)]
    return Section("Reasons", [*blocks, *_more(len(total.reasons), "reasons")])


def _programs(coverage: Coverage, done: str) -> Section:
    rows = [
        [line.name, f"{line.targets:,}", f"{line.correctable:,}", f"{100 * line.share:.1f}", _first(line)]
        for line in (coverage.total, *coverage.programs[:_MOST])
    ]
    columns = ["Program", "Targets", done.capitalize(), "%", "Most frequent reason of the others"]
    return Section("Programs", [Table(columns, rows, last_left=1), *_more(len(coverage.programs), "programs")])


def _first(line: CoverageLine) -> str:
    return f"{line.reasons[0].count:,} × {line.reasons[0].reason}" if line.reasons else ""


def _more(n: int, what: str) -> list[Text]:
    return [Text(f"{n - _MOST:,} more {what} are in the attached table.")] if n > _MOST else []


def _share(n: int, total: int) -> str:
    return f"{100 * n / total:.1f}" if total else ""
