"""One document, as page and as PDF, in three languages: whole, self-contained, and honest about what it lacks."""

from __future__ import annotations

import base64
import csv
import hashlib
import html
import io
import json
import re
import sys
import warnings
import zipfile
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from fontTools.ttLib import TTFont
from scipy.spatial.transform import Rotation

from truepose.cell import Cell
from truepose.error_map import load_map
from truepose.error_map.fit import fit_cell
from truepose.errors import DataError, FileError
from truepose.report import write_report
from truepose.report.conformity import decision
from truepose.report.document import Document, Facts, Table
from truepose.report.evidence import Evidence, gather
from truepose.report.locale import LOCALES, load_locale
from truepose.report.page import to_html, to_pdf
from truepose.report.records import read_record
from truepose.report.region import planes
from truepose.report.sections import controller_angles, document
from truepose.report.study import similarity_study
from truepose.samples import Poses
from truepose.simulation import VirtualCell

EN = load_locale("en")
DATE = datetime(2025, 3, 7, 9, 15, tzinfo=UTC)


@pytest.fixture(scope="module")
def cell():
    virtual = VirtualCell("paper", seed=4)
    samples, held_out = (virtual.measure(virtual.design(n, seed=n)) for n in (60, 30))
    return virtual, samples, held_out


@pytest.fixture(scope="module")
def error_map(cell):
    virtual, samples, _ = cell
    return fit_cell(virtual.cell, samples, "ordinary-kriging")


@pytest.fixture(scope="module")
def study(error_map):
    return similarity_study(error_map)


@pytest.fixture(scope="module")
def documents(evidence) -> dict[str, Document]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # matplotlib warns of a glyph that no font has
        return {locale: document(evidence, load_locale(locale)) for locale in LOCALES}


@pytest.fixture(scope="module")
def evidence(error_map, cell, study) -> Evidence:
    return gather(error_map, cell[2], study=study, date=DATE)


def record(map_sha256: str, n: int = 2, **changes) -> dict:
    target = {
        "file": "panel.dat", "line": 7, "name": "XP1", "before_mm": [1.0, -2.0, 3.0], "after_mm": [1.1, -2.0, 3.0],
        "correction_mm": [0.1, 0.0, 0.0], "std_mm": 0.0125, "verdict": "correct", "reason": "",
    }  # fmt: skip
    left = {
        **target,
        "name": "XP0",
        "std_mm": None,
        "correction_mm": [None] * 3,
        "verdict": "skip",
        "reason": "too far",
    }
    summary = {"targets": n, "corrected": n - 1, "clipped": 0, "skipped": 1, "refused": 0}
    return {
        "format": "truepose corrections",
        "schema": 1,
        "program": r"C:\krc\panel.src",
        "files": [{"file": r"C:\krc\panel.dat", "sha256_before": "a" * 64, "sha256_after": "b" * 64}],
        "map_sha256": map_sha256,
        "on_guard": "skip",
        "summary": {**summary, "largest_correction_mm": 0.1, "largest_std_mm": 0.0125},
        "targets": [left, *[target] * (n - 1)],
        **changes,
    }


@pytest.fixture
def sidecar(tmp_path):
    def write(content: dict) -> Path:
        path = tmp_path / "panel.corrections.json"
        path.write_text(json.dumps(content))
        return path

    return write


class Asked(HTMLParser):
    """What a page loads, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.loads: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.loads += [
            value for name, value in attrs if name in ("src", "href", "xlink:href", "action", "data") and value
        ]

    def handle_data(self, data):
        self.text += data


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


@pytest.mark.parametrize("locale", LOCALES)
def test_every_section_is_told(evidence, documents, locale):
    say, made = load_locale(locale), documents[locale]
    titles = [section.title for section in made.sections]
    keys = (
        "job",
        "conformity",
        "accuracy",
        "signatures",
        "cell",
        "errors",
        "maps",
        "registration",
        "similarity_section",
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


@pytest.mark.parametrize("locale", LOCALES)
def test_pdf_is_whole_and_the_same_each_time(documents, locale):
    pdf = to_pdf(documents[locale], DATE)
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")
    assert pdf == to_pdf(documents[locale], DATE)
    assert (b"TrueposeSans" in pdf) == (locale == "zh")
    assert (b"Libertinus" in pdf) == (locale != "zh")


def test_names_in_other_characters(error_map, study, sidecar, no_figures):
    made = document(gather(error_map, study=study, sidecars=[sidecar(record(error_map.hash, program="面板.src"))]), EN)
    assert b"TrueposeSans" in to_pdf(made, DATE)
    assert "@font-face" in to_html(made)
    lost = replace(made, title="\U00013000")  # a hieroglyph
    with pytest.raises(
        FileError, match=r"r\.pdf: cannot be typeset: .*\U00013000.*; install a font with this character"
    ):
        to_pdf(lost, DATE, "r.pdf")


def test_without_held_out_poses_the_report_says_so(error_map, study, no_figures):
    made = document(gather(error_map, study=study), EN)
    warned = [text.text for text in made.lead if text.warns]
    assert "leave-one-out" in warned[0]
    assert made.tiles[0] == ("not assessed", "no tolerance stated")
    assert made.tiles[-1] == ("60", "poses, leave-one-out")


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


def test_corrected_programs(error_map, study, sidecar, no_figures):
    say = load_locale("en")
    made = document(gather(error_map, study=study, sidecars=[sidecar(record(error_map.hash))]), say)
    programs = next(section for section in made.sections if section.title == say("programs.title"))
    tables = [block for block in programs.blocks if isinstance(block, Table)]
    assert tables[0].rows == [["panel.src", "2", "1", "0", "0", "1", "0", "0.100", "0.013"]]
    assert tables[1].rows == [["skipped", "too far", "1", "1"]]
    assert tables[2].rows == [["XP1", "panel.dat:7", "1.000", "−2.000", "3.000", "+0.100", "+0.000", "+0.000", "0.013"]]
    assert not any(getattr(block, "warns", False) for block in programs.blocks)
    assert "b" * 64 in made.text()


def test_the_hash_is_that_of_the_file(error_map, tmp_path):
    mine, other = tmp_path / "mine.truepose", tmp_path / "other.truepose"
    error_map.save(mine)
    assert load_map(mine).hash == error_map.hash == hashlib.sha256(mine.read_bytes()).hexdigest()
    with zipfile.ZipFile(mine) as source, zipfile.ZipFile(other, "w", zipfile.ZIP_STORED) as target:
        for name in source.namelist():
            target.writestr(name, source.read(name))
    assert load_map(other).hash == hashlib.sha256(other.read_bytes()).hexdigest() != error_map.hash


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


def test_programs_of_another_map_and_refusals_are_told(error_map, study, sidecar, no_figures):
    content = record("c" * 64, n=100)
    content["summary"]["refused"] = 4
    text = document(gather(error_map, study=study, sidecars=[sidecar(content)]), EN).text()
    assert "panel.src was corrected with another map (cccccccccccc), not with this one." in text
    assert "panel.src: 4 targets refused" in text
    assert "60 of 100 targets are listed; the attached table targets.csv contains all." in text


def test_names_are_text_not_markup(error_map, study, sidecar, no_figures):
    name = '<b>&"#[*_$@`</b>'
    content = record(error_map.hash, n=2)
    content["targets"] = [{**target, "name": name, "reason": name} for target in content["targets"]]
    made = document(gather(error_map, study=study, sidecars=[sidecar(content)]), EN)
    page = to_html(made)
    assert name not in page
    assert "&lt;b&gt;&amp;" in page
    assert to_pdf(made, DATE).startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("no json", r"panel.json: is not the record of a corrected program \(Invalid JSON"),
        ("[]", r"panel.json: is not the record of a corrected program \("),
        ("{}", r"\(program: Field required\); name a .json file written by 'truepose correct'"),
        (json.dumps(record("a", targets=[{"name": 3}])), r"\(targets.0.name: Input should be a valid string\)"),
    ],
)
def test_files_that_are_no_records(tmp_path, content, message):
    path = tmp_path / "panel.json"
    path.write_text(content)
    with pytest.raises(FileError, match=message) as raised:
        read_record(path)
    assert "\n" not in str(raised.value)


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
    with pytest.raises(FileError, match=r"report.pdf: PDF needs the package typst: pip install 'truepose\[pdf\]'; or"):
        write_report(error_map, tmp_path / "report.pdf", study=study)


def test_pictures_are_the_same_each_time(evidence, documents):
    assert to_html(document(evidence, load_locale("de"))) == to_html(documents["de"])


def test_reports_are_written_whole_or_not_at_all(error_map, cell, study, tmp_path):
    path = tmp_path / "deep" / "report.pdf"
    write_report(error_map, path, cell[2], study=study, locale="de", date=DATE)
    whole = path.read_bytes()
    assert whole.startswith(b"%PDF-")
    with pytest.raises(DataError):
        write_report(error_map, path, Poses(q=np.zeros((2, 5))), study=study)
    assert path.read_bytes() == whole
    assert list(path.parent.iterdir()) == [path]


def test_maps_are_what_the_map_predicts(error_map):
    found = planes(error_map)
    assert {frozenset((plane.i, plane.j)) for plane in found} == {frozenset(pair) for pair in ((0, 1), (0, 2), (1, 2))}
    middle = (error_map.p_cmd.min(axis=0) + error_map.p_cmd.max(axis=0)) / 2
    for plane in found:
        assert np.ptp(plane.u) >= np.ptp(plane.v)
        p = middle.copy()
        p[plane.i], p[plane.j] = plane.u[5], plane.v[20]
        e, std = error_map.predict_errors(Poses(p_cmd=p[None]))
        assert plane.error[20, 5] == pytest.approx(np.linalg.norm(e))
        assert plane.std[20, 5] == pytest.approx(np.linalg.norm(std))
        assert plane.std[16, 16] < plane.std[0, 0]  # surer in the middle than in a corner


def test_maps_of_joint_space_are_asked_by_inverse_kinematics(cell):
    virtual, samples, _ = cell
    error_map = fit_cell(virtual.cell, samples, "ordinary-kriging-joint")
    plane = planes(error_map)[0]
    assert np.isfinite(plane.error).mean() > 0.9
    assert plane.error[16, 16] == pytest.approx(np.linalg.norm(error_map.e, axis=1).mean(), rel=1.0)


def test_samples_on_a_line_have_no_maps(error_map):
    p = np.array([[0.0, 0.0, z] for z in range(5)])
    flat = replace(error_map)
    vars(flat)["p_cmd"] = p
    assert planes(flat) == []


@pytest.mark.promise("the report names the faults of the measuring campaign, in each language")
@pytest.mark.parametrize("language", LOCALES)
def test_faults_of_the_campaign_are_named(evidence, language, no_figures):
    def told(campaign: dict) -> str:
        error_map = replace(evidence.error_map, campaign=campaign)
        return document(replace(evidence, error_map=error_map), load_locale(language)).text()

    size = {"shift": 0.234, "shift_std": 0.011, "turn": 0.2e-3, "turn_std": 0.03e-3, "scale": 5e-3, "scale_std": 6e-4}
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


def test_nothing_is_decided_without_proof(error_map, cell, stated_cell, study):
    assert decision(gather(error_map, cell=stated_cell, study=study)) is None
    assert decision(gather(error_map, cell[1], cell=stated_cell, study=study)) is None
    assert decision(gather(error_map, cell[2], study=study)) is None
    other = Cell.from_toml('[robot]\nmodel = "kuka-kr150-2"\n')
    with pytest.raises(DataError, match=r"describes a kuka-kr150-2, but the map is of a kuka-kr210-r2700-extra"):
        gather(error_map, cell=other, study=study)


def test_a_logo_that_cannot_be_used_is_named(error_map, cell, stated_cell, study, no_figures):
    lost = stated_cell.model_copy(update={"report": stated_cell.report.model_copy(update={"logo": "gone.png"})})
    made = document(gather(error_map, cell[2], cell=lost, study=study), EN)
    assert made.logo is None
    assert any("The logo gone.png was not found" in text.text for text in made.lead)


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


@pytest.mark.promise("the report has one row for each program, groups reasons, and attaches the complete tables")
def test_many_programs(error_map, study, tmp_path, no_figures):
    paths = []
    for k in range(4):
        content = record(error_map.hash, n=6, program=f"cell/p{k}.src")
        content["targets"][0]["reason"] = f"{0.31 + k / 100:.3f} mm, above P1's limit of 0.300 mm"
        content["limits"] = {"max_std_mm": {"value": 0.2 if k else 0.1, "origin": "option"}}
        paths.append(tmp_path / f"p{k}.corrections.json")
        paths[-1].write_text(json.dumps(content))
    made = document(gather(error_map, study=study, sidecars=paths, date=DATE), EN)
    section = next(section for section in made.sections if section.title == EN("programs.title"))
    rows, reasons, *limits, targets = [block.rows for block in section.blocks if isinstance(block, Table)]
    assert [row[0] for row in rows] == ["p0.src", "p1.src", "p2.src", "p3.src", "total"]
    assert rows[-1][1:3] == ["24", "20"]
    assert reasons == [["skipped", "… mm, above P1's limit of … mm", "4", "4"]]
    assert len(limits) == 2
    assert len(targets) == 20
    poses, table = made.attachments
    assert (poses.name, table.name) == ("poses.csv", "targets.csv")
    assert len(poses.text.splitlines()) == 61
    listed = list(csv.DictReader(io.StringIO(table.text)))
    assert len(listed) == 24
    assert (listed[0]["verdict"], listed[0]["x_correction_mm"], listed[1]["file"]) == ("skip", "", "panel.dat")
    assert "/EmbeddedFile" in to_pdf(made, DATE).decode("latin-1")
    saved = re.search(r'<a download="targets.csv" href="data:text/csv;charset=utf-8;base64,([^"]+)"', to_html(made))
    assert base64.b64decode(saved[1]).decode() == table.text


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
