"""The section on verified programs: its table, its picture and its warnings, in each language."""

from __future__ import annotations

import csv
import io
import json

import pytest

import truepose
from truepose.errors import FileError
from truepose.programs import ProgramVerification, VerifiedTarget
from truepose.report.document import Picture, Table
from truepose.report.locale import LOCALES, load_locale
from truepose.report.verification import attachment, read_verification, section

HASH = "c" * 64


def verification(n: int = 8, **changes) -> ProgramVerification:
    decisions = ["pass"] * (n - 2) + ["undecided", "fail"]
    targets = tuple(
        VerifiedTarget(
            name=f"P{k + 1}",
            file="panel.dat",
            line=k + 7,
            correction="correct",
            nominal_mm=(1500.0, 0.0, 900.0),
            measured_mm=(1500.1, 0.0, 900.0),
            error_mm={"pass": 0.05 + 0.01 * (k % 7), "undecided": 0.19, "fail": 0.31}[decision],
            uncertainty_mm=0.02,
            before_mm=0.6 - 0.02 * (k % 9),
            readings=3,
            decision=decision,
        )
        for k, decision in enumerate(decisions)
    )
    fields = {
        "program": "corrected/panel.src", "readings": "after.txt", "record": "corrected/panel.corrections.json",
        "map_sha256": HASH, "tolerance_mm": 0.2, "tolerance_origin": "[correction] of the cell", "station": "map",
        "station_std_mm": 0.015, "before": "predicted", "targets": targets, "unmeasured": (), "unknown": 0,
    }  # fmt: skip
    return ProgramVerification(**{**fields, **changes})


@pytest.mark.parametrize("locale", LOCALES)
def test_section_has_the_decision_a_picture_and_the_table(locale):
    say = load_locale(locale)
    made = section([verification()], HASH, say)
    first, *_ = made.blocks
    assert say("conformity.fail") in first.text
    assert first.warns
    assert say.number(0.31, ".3f") in first.text
    table = next(block for block in made.blocks if isinstance(block, Table))
    assert [row[-1] for row in table.rows] == [say("conformity.fail"), say("conformity.undecided")]
    assert sum(isinstance(block, Picture) for block in made.blocks) == 1
    assert say("conformity.title") in made.blocks[-1].text


def test_a_verification_names_the_software_that_wrote_it():
    assert verification().to_dict()["written_by"] == f"truepose {truepose.__version__}"


def test_what_weakens_the_proof_is_a_warning():
    say = load_locale("en")
    one = verification(station="registered", unmeasured=("P9",), record="", map_sha256="d" * 64)
    warnings = [block.text for block in section([one], HASH, say).blocks if getattr(block, "warns", False)]
    for key in ("registered", "original", "other_map"):
        assert say(f"verification.{key}") in warnings
    assert say("verification.unmeasured", n=1, names="P9") in warnings


def test_targets_that_do_not_pass_are_shown_and_all_are_attached():
    say = load_locale("en")
    one = verification(100)
    table = next(block for block in section([one], HASH, say).blocks if isinstance(block, Table))
    assert [row[-1] for row in table.rows] == ["FAIL", "UNDECIDED"]
    (attached,) = attachment([one, verification(8)], say)
    rows = list(csv.DictReader(io.StringIO(attached.text)))
    assert (len(rows), {row["program"] for row in rows}) == (108, {one.program})
    assert sum(row["decision"] == "fail" for row in rows) == 2


@pytest.mark.parametrize("run", ["corrected", "original"])
def test_readings_of_another_run_are_a_warning(run):
    say = load_locale("en")
    warnings = [
        block.text
        for block in section([verification(run=run, record="")], HASH, say).blocks
        if getattr(block, "warns", False)
    ]
    assert say(f"verification.run_{run}") in warnings
    assert say("verification.original") not in warnings


def test_no_verification_gives_no_section():
    assert section([], HASH, load_locale("en")) is None


def test_file_of_a_verification_is_read_and_another_refused(tmp_path):
    path = tmp_path / "proof.json"
    path.write_text(json.dumps(verification().to_dict()))
    assert read_verification(path) == verification()
    path.write_text('{"program": "a.src"}')
    with pytest.raises(FileError, match=r"is not the verification of a program .*name a \.json file written by"):
        read_verification(path)
    path.write_text(json.dumps({**verification().to_dict(), "targets": []}))
    with pytest.raises(FileError, match="is the verification of no target"):
        read_verification(path)
