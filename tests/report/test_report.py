"""One document, as page and as PDF, in three languages: whole, self-contained, and honest about what it lacks."""

from __future__ import annotations

import base64
import hashlib
import html
import io
import json
import re
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from fontTools.ttLib import TTFont
from scipy.spatial.transform import Rotation
from tests.report.conftest import DATE, EN, Asked

import truepose
from truepose.error_map import load_map
from truepose.error_map.fit import fit_cell
from truepose.errors import DataError, FileError, MissingPackageError
from truepose.report import write_report
from truepose.report.document import Table
from truepose.report.evidence import gather
from truepose.report.locale import LOCALES, load_locale
from truepose.report.page import to_html, to_pdf
from truepose.report.sections import controller_angles, document
from truepose.samples import Samples


@pytest.mark.exhaustive
@pytest.mark.parametrize("locale", LOCALES)
def test_page_asks_for_nothing(documents, locale):
    page = to_html(documents[locale])
    asked = Asked(page)
    assert not {"script", "link", "iframe", "object", "base"} & set(asked.tags)
    assert [target for target in asked.loads if not target.startswith(("#", "data:text/csv;"))] == []
    assert re.findall(r"url\((?!data:|#)|@import", page) == []
    assert re.findall(r"https?://(?!www\.w3\.org/)", page) == []
    assert "default-src 'none'" in page
    assert f'<html lang="{locale}">' in page


@pytest.mark.exhaustive
@pytest.mark.parametrize("locale", LOCALES)
def test_every_section_is_told(evidence, documents, locale):
    say, made = load_locale(locale), documents[locale]
    titles = [section.title for section in made.sections]
    keys = (
        "headline",
        "job",
        "conformity",
        "accuracy",
        "signatures",
        "cell",
        "errors",
        "maps",
        "registration",
        "similarity_section",
        "facts",
        "model",
        "programs",
    )
    assert titles == [*(say(f"{key}.title") for key in keys), say("provenance.title")]
    text = Asked(to_html(made)).text.replace("\u00a0", " ")
    found = evidence.accuracy
    for value in (found["before"]["mean_mm"], found["after"]["max_mm"], *found["intervals_95"]["after_mean_mm"]):
        assert say.number(value, ".3f") in text
    for word in (
        evidence.error_map.hash,
        "2025-03-07 09:15 UTC",
        "ordinary-kriging",
        "numpy",
        say("signatures.approved"),
    ):
        assert word in text


@pytest.mark.sampled(1)
@pytest.mark.parametrize("locale", LOCALES)
def test_the_report_names_the_software_that_wrote_it(documents, locale):
    shown = f"truepose {truepose.__version__}"
    assert shown in documents[locale].stamp
    assert shown in documents[locale].text()


def test_german_numbers_have_commas_everywhere(documents):
    text = documents["de"].text()
    assert re.findall(r"\d\.\d+ (?:mm|%|rad)", text) == []
    assert re.search(r"\d,\d{3} mm", text)


def test_figures_hold_shapes_not_fonts(documents):
    page = to_html(documents["zh"])
    assert page.count("<svg") == 5  # arrows, histogram, maps, two variograms
    assert not {"text", "tspan", "image"} & set(Asked(page).tags)


def test_pages_carry_their_chinese_characters(documents):
    say = load_locale("zh")
    page = to_html(documents["zh"])
    font = TTFont(io.BytesIO(base64.b64decode(re.search(r"data:font/woff;base64,([^)]+)\)", page)[1])))
    assert {c for text in (say("report.of", robot=""), say("signatures.approved")) for c in text} <= set(
        map(chr, font.getBestCmap())
    )
    assert "@font-face" not in to_html(documents["en"])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("locale", LOCALES)
def test_pdf_is_whole_and_the_same_each_time(documents, locale):
    pdf = to_pdf(documents[locale], DATE)
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")
    assert pdf == to_pdf(documents[locale], DATE)
    assert (b"TrueposeSans" in pdf) == (locale == "zh")
    assert (b"Libertinus" in pdf) == (locale != "zh")


def test_without_held_out_poses_the_report_says_so(error_map, study, no_figures):
    made = document(gather(error_map, study=study), EN)
    warned = [text.text for text in made.lead if text.warns]
    assert "leave-one-out" in warned[0]
    assert made.tiles[0] == ("NOT ASSESSED", "no tolerance stated")
    assert made.tiles[-1] == ("60", "poses, leave-one-out")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("language", LOCALES)
def test_a_far_better_predictor_is_named(cell, evidence, study, language, no_figures):
    """The ratio is recomputed: registration leaves more than kinematics does."""
    virtual, samples, held_out = cell
    say, poor = load_locale(language), fit_cell(virtual.cell, samples, "registration")
    for test, key in ((held_out, "held_out"), (None, "left_out")):
        found = gather(poor, test, study=study)
        assert found.better is not None
        assert found.better.rival_mean_mm < 0.3 * found.better.mean_mm
        assert found.better.mean_mm == pytest.approx(found.accuracy["after"]["mean_mm"])
        values = {"theirs": found.better.rival_mean_mm, "own": found.better.mean_mm}
        told = say(f"model.better_{key}", rival="kinematic-kriging", predictor="registration", **values)
        model = next(s for s in document(found, say).sections if s.title == say("model.title"))
        assert [block.text for block in model.blocks if getattr(block, "warns", False)] == [told]
    assert (
        say.texts["model.better_held_out"].split(":")[0].split("：")[0]
        not in document(replace(evidence, better=None), say).text()
    )


@pytest.mark.parametrize("language", LOCALES)
def test_a_map_that_makes_errors_larger_is_not_praised(evidence, language, no_figures):
    """The same sentence holds for a smaller and for a larger error."""
    turned = {**evidence.accuracy, "before": evidence.accuracy["after"], "after": evidence.accuracy["before"]}
    say, texts = load_locale(language), []
    for figures in (evidence.accuracy, turned):
        text = document(replace(evidence, accuracy=figures), say).lead[1].text
        texts.append(re.sub(r"[\d.,]+", "#", text))
    assert texts[0] == texts[1]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("language", LOCALES)
def test_the_noise_of_a_reading_has_one_source(error_map, cell, study, language, no_figures):
    """A table with standard deviations outweighs the cell file, and the report names what it used."""
    say, held_out = load_locale(language), cell[2]
    assert held_out.p_std is not None
    text = document(gather(error_map, held_out, study=study), say).text()
    assert say("conformity.reading_table_source") in text
    stated = error_map.cell.model_copy(update={"tracker": error_map.cell.tracker.model_copy(update={"std_mm": 0.0321})})
    text = document(gather(error_map, replace(held_out, p_std=None), cell=stated, study=study), say).text()
    assert say("conformity.reading_cell_source") in text
    assert say("cell.tracker_std", std=0.0321) in text
    text = document(gather(error_map, held_out, cell=stated, study=study), say).text()
    assert say.number(0.0321, ".4f") not in text


def test_variograms_of_the_predictor_have_units(documents):
    model = next(section for section in documents["en"].sections if section.title == EN("model.title"))
    table = next(block for block in model.blocks if isinstance(block, Table))
    assert table.columns == ["variogram", "family", "nugget [mm²]", "sill [mm²]", "range [mm]"]
    assert [row[0] for row in table.rows] == ["x", "y", "z"]
    assert table.words == [True, True, False, False, False]


def test_poses_of_the_fit_are_told(error_map, cell, study, no_figures):
    made = document(gather(error_map, cell[1], study=study), load_locale("de"))
    warned = [text.text for text in made.lead if text.warns]
    assert warned[0].startswith("60 der Prüfposen gingen in die Anpassung ein")


def test_held_out_table_is_hashed(error_map, cell, study, tmp_path, no_figures):
    table = tmp_path / "held_out.csv"
    table.write_text("q1_deg\n")
    held_out = replace(cell[2], source=str(table))
    assert gather(error_map, held_out, study=study).held_out_sha256 == hashlib.sha256(b"q1_deg\n").hexdigest()
    made = document(gather(error_map, cell[2], study=study), EN)
    assert "file no longer available" in made.text()


def test_the_hash_is_that_of_the_file(error_map, tmp_path):
    mine, other = tmp_path / "mine.truepose", tmp_path / "other.truepose"
    error_map.save(mine)
    assert load_map(mine).hash == error_map.hash == hashlib.sha256(mine.read_bytes()).hexdigest()
    with zipfile.ZipFile(mine) as source, zipfile.ZipFile(other, "w", zipfile.ZIP_STORED) as target:
        for name in source.namelist():
            target.writestr(name, source.read(name))
    assert load_map(other).hash == error_map.hash != hashlib.sha256(other.read_bytes()).hexdigest()  # packed again


def test_ranking_of_the_choice(error_map, study, no_figures):
    figures_of = {"mean_mm": 0.04, "mean_interval_mm": [0.035, 0.045], "p95_mm": 0.07, "within_95": 0.94}
    splits = {"points": {"mean_mm": 0.03}, "blocks": {"mean_mm": 0.05}}
    taken = {"predictor": "ordinary-kriging", **figures_of, "splits": splits, "worse_by_mm": 0.0, "level": True}
    ranking = [
        taken,
        {**taken, "predictor": "idw", "worse_by_mm": 0.001},
        {"predictor": "grid-cell", "note": "failed: few"},
    ]
    chosen = replace(
        error_map,
        ranking=ranking,
        expected={"mean_mm": 0.041, "mean_interval_mm": [0.036, 0.046], "chosen": {"idw": 9}},
    )
    made = document(gather(chosen, study=study), EN)
    model = next(section for section in made.sections if section.title == EN("model.title"))
    table = [block for block in model.blocks if isinstance(block, Table)][-1]
    figures_shown = ["0.040", "0.035 … 0.045", "0.030", "0.050", "0.070", "94 %"]
    assert table.rows[0] == ["ordinary-kriging", *figures_shown, ""]
    assert table.rows[1] == ["idw", *figures_shown, "not significant"]
    assert table.rows[2] == ["grid-cell", *["–"] * 6, "failed: few"]
    assert table.words == [True, *[False] * 6, True]
    assert "0.041 mm (95 % interval 0.036 … 0.046 mm). Chosen without them: idw 9." in made.text()


def test_bad_input(error_map, study, tmp_path):
    with pytest.raises(FileError, match=r"report.docx: expected a name that ends in .html or .pdf, got .docx"):
        write_report(error_map, tmp_path / "report.docx", study=study)
    with pytest.raises(FileError, match=r"got no ending"):
        write_report(error_map, tmp_path / "report", study=study)
    with pytest.raises(DataError, match=r"expected a locale of en, de, zh; got 'xx'"):
        write_report(error_map, tmp_path / "report.html", study=study, locale="xx")
    with pytest.raises(FileError, match=r"gone.json: no such file"):
        write_report(error_map, tmp_path / "report.html", study=study, sidecars=[tmp_path / "gone.json"])
    assert list(tmp_path.iterdir()) == []


def test_pdf_without_typst_names_the_remedy(error_map, study, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "typst", None)
    message = r"a report as PDF needs the package typst; install it with: pip install 'truepose\[pdf\]', or write .html"
    with pytest.raises(MissingPackageError, match=message):
        write_report(error_map, tmp_path / "report.pdf", study=study)


@pytest.mark.exhaustive
def test_pictures_are_the_same_each_time(evidence, documents):
    assert to_html(document(evidence, load_locale("de"))) == to_html(documents["de"])


@pytest.mark.exhaustive
def test_reports_are_written_whole_or_not_at_all(error_map, cell, study, tmp_path):
    path = tmp_path / "deep" / "report.pdf"
    write_report(error_map, path, cell[2], study=study, locale="de", date=DATE)
    whole = path.read_bytes()
    assert whole.startswith(b"%PDF-")
    with pytest.raises(DataError):
        write_report(error_map, path, Samples(np.ones((2, 3)), q=np.zeros((2, 5))), study=study)
    assert path.read_bytes() == whole
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.promise("the report names the faults of the measuring campaign, in each language")
@pytest.mark.parametrize("language", LOCALES)
def test_faults_of_the_campaign_are_named(evidence, language, no_figures):
    def told(campaign: dict) -> str:
        error_map = replace(evidence.error_map, campaign=campaign)
        return document(replace(evidence, error_map=error_map), load_locale(language)).text()

    size = {
        "words": "a fault",
        "size": 0.2,
        "size_std": 0.01,
        "shift": 0.234,
        "shift_std": 0.011,
        "turn": 0.2e-3,
        "turn_std": 0.03e-3,
        "scale": 5e-3,
        "scale_std": 6e-4,
    }
    faults = [{"kind": kind, "rows": [7, 59], "points": 3, **size} for kind in ("moved", "drift", "scale", "reference")]
    say = load_locale(language)
    for fault in faults:
        text = told({"tested": 60, "limit_mm": 0.1, "faults": [fault]})
        if fault["kind"] == "scale":
            assert f"+{say.number(0.5, '.2f')} ± {say.number(0.06, '.2f')} %" in text
        else:
            assert f"{say.number(0.234, '.3f')} ± {say.number(0.011, '.3f')} mm" in text
            assert "59" in text
    assert say("cell.campaign_none", n=60) in told({"tested": 60, "limit_mm": 0.1, "faults": []})
    assert say("cell.campaign_missing") in told({})


@pytest.mark.parametrize(
    ("controller", "text"),
    [
        ("kuka", "A 90.00000°; B 0.00000°; C 0.00000°"),
        ("fanuc", "W 0.00000°; P 0.00000°; R 90.00000°"),
        ("ur", "rx 0.0000000 rad; ry 0.0000000 rad; rz 1.5707963 rad"),
        ("abb", "q1 0.7071068; q2 0.0000000; q3 0.0000000; q4 0.7071068 (quaternion w, x, y, z)"),
        (None, "q1 0.7071068; q2 0.0000000; q3 0.0000000; q4 0.7071068 (quaternion w, x, y, z)"),
    ],
)
def test_orientations_are_the_controllers_own(controller, text):
    assert controller_angles(Rotation.from_euler("z", 90, degrees=True), controller, EN).replace("−", "") == text


@pytest.mark.sampled(1)
@pytest.mark.promise("the interactive view needs no network, and only its own script may run")
@pytest.mark.parametrize("language", LOCALES)
def test_interactive_view(evidence, language, no_figures):
    made = document(evidence, load_locale(language), interactive=True)
    page = to_html(made)
    data, script = re.findall(r"<script[^>]*>(.*?)</script>", page, re.DOTALL)
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = html.unescape(re.search(r'Security-Policy" content="([^"]+)"', page)[1])
    assert f"script-src 'sha256-{allowed}'" in policy
    assert [target for target in Asked(page).loads if not target.startswith(("#", "data:text/csv;"))] == []
    assert not {"fetch(", "XMLHttpRequest", "import ", "eval(", "innerHTML"} & {w for w in script.split() if w}
    scene = json.loads(data)
    np.testing.assert_allclose(scene["before"], evidence.before, atol=1e-4)
    np.testing.assert_allclose(scene["p"], evidence.p, atol=0.1)
    arm = np.array(scene["arm"])
    assert arm[0].tolist() == [0, 0, 0]
    tips = evidence.error_map.robot.forward(evidence.error_map.samples.q, tool=evidence.error_map.tf_flange_tool)
    assert np.linalg.norm(tips[:, :3, 3] - arm[-1], axis=1).min() < 0.1
    assert b"%PDF-" in to_pdf(made, DATE)


def test_a_pdf_is_not_interactive(error_map, study, tmp_path):
    with pytest.raises(FileError, match=r"r\.pdf: a PDF cannot be interactive; name an \.html file"):
        write_report(error_map, tmp_path / "r.pdf", study=study, interactive=True)
