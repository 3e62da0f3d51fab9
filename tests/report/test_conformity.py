"""Facts of the cell file in the report: the decision by the tolerance, missing facts, the logo."""

from __future__ import annotations

import numpy as np
import pytest
from tests.report.conftest import DATE, EN

from truepose.cell import Cell
from truepose.error_map.repeatability import USUAL_RP_MM
from truepose.errors import DataError
from truepose.report.conformity import decision, section
from truepose.report.document import Facts, Table
from truepose.report.evidence import gather
from truepose.report.locale import LOCALES, load_locale
from truepose.report.page import to_html, to_pdf
from truepose.report.sections import document


@pytest.fixture(scope="module")
def stated_cell(cell, tmp_path_factory):
    """Return the cell with the facts of a report and a tolerance."""
    folder = tmp_path_factory.mktemp("stated")
    (folder / "logo.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"></svg>')
    text = cell[0].cell.to_toml().replace("[tracker]", "[tracker]\nstd_mm = 0.01") + (
        '\n[report]\ncompany = "Ex & Co"\nlogo = "logo.svg"\nmeasured = 2025-03-01\n'
        "reflector_calibration_due = 2025-02-28\ntolerance_mm = 0.4\n"
    )
    return Cell.from_toml(text, folder=folder)


@pytest.mark.sampled(1)
@pytest.mark.promise("the report decides on conformity by ISO 14253-1, and flags missing facts")
@pytest.mark.parametrize("language", LOCALES)
def test_conformity_and_missing_facts(error_map, cell, stated_cell, study, language, no_figures):
    say = load_locale(language)
    found = gather(error_map, cell[2], cell=stated_cell, study=study, date=DATE)
    made = document(found, say)
    length, u = np.linalg.norm(found.after, axis=1), 2 * found.reading_std
    expected = "pass" if (length + u <= 0.4).all() else "fail" if (length - u > 0.4).any() else "undecided"
    assert made.tiles[0][0] == say(f"conformity.{expected}")
    counts = next(b for s in made.sections for b in s.blocks if isinstance(b, Table) and len(b.columns) == 4)
    assert [int(n) for n in counts.rows[1][1:]] == [
        (length + u <= 0.4).sum(),
        ((length + u > 0.4) & (length - u <= 0.4)).sum(),
        (length - u > 0.4).sum(),
    ]
    warned = " ".join(text.text for text in made.lead if text.warns)
    assert say("job.overdue", what=say("job.reflector_name"), due="2025-02-28", day="2025-03-01") in warned
    assert say("job.operator") in warned
    assert say("job.company") not in warned
    page = to_html(made)
    listed = [block for section in made.sections for block in section.blocks if isinstance(block, Facts)]
    assert page.count('class="missing"') == sum(len(block.missing) for block in listed) > 10
    assert 'src="data:image/svg+xml;base64,' in page
    assert to_pdf(made, DATE).startswith(b"%PDF-")


@pytest.mark.exhaustive
def test_nothing_is_decided_without_proof(error_map, cell, stated_cell, study):
    assert decision(gather(error_map, cell=stated_cell, study=study)) is None
    assert decision(gather(error_map, cell[1], cell=stated_cell, study=study)) is None
    assert decision(gather(error_map, cell[2], study=study)) is None
    other = Cell.from_toml('[robot]\nmodel = "kuka-kr150-2"\n')
    with pytest.raises(DataError, match=r"describes a kuka-kr150-2, but the map is of a kuka-kr210-r2700-extra"):
        gather(error_map, cell=other, study=study)


def test_a_repeatability_that_is_not_believed_is_no_source_of_uncertainty(error_map, cell, stated_cell, study):
    def told(repeatability_mm: float) -> str:
        robot = stated_cell.robot.model_copy(update={"repeatability_mm": repeatability_mm})
        made = gather(error_map, cell[2], cell=stated_cell.model_copy(update={"robot": robot}), study=study)
        return repr(section(made, EN))

    assert told(5.1) == told(USUAL_RP_MM) != told(0.05)


def test_a_logo_that_cannot_be_used_is_named(error_map, cell, stated_cell, study, no_figures):
    lost = stated_cell.model_copy(update={"report": stated_cell.report.model_copy(update={"logo": "gone.png"})})
    made = document(gather(error_map, cell[2], cell=lost, study=study), EN)
    assert made.logo is None
    assert any("The logo gone.png was not found" in text.text for text in made.lead)
