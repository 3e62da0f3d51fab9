"""Every warning that import, fit and update can say is a fact of the map, or says nothing about its corrections."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import truepose as tp
from truepose.cell import Cell
from truepose.error_map import recheck, update_map
from truepose.error_map.facts import CODES, of_import
from truepose.error_map.importing import import_samples
from truepose.samples import Poses, read_samples, write_samples
from truepose.samples.masks import mask_table
from truepose.trackers import write_readings

SOURCE = Path(__file__).parents[2] / "src" / "truepose"
ABOUT = "about the choice of a predictor, not about the map: corrections are those of the map that was written"
NUMBERS = "about the numerics of the fit, which refuses where they do not suffice; the figures of the study have it"
SAID = {
    # a part of what is said, with the code of its fact, or the reason why it is none
    ("cli/importing.py", "Left out"): "left-out",
    ("cli/importing.py", "Large residual"): "suspect-readings",
    ("cli/fit.py", "was chosen, which takes nothing from maps"): ABOUT,
    ("cli/fit.py", "Arm and tool"): "arm-not-checked",
    ("cli/fit.py", "registration.hint"): "registration",
    ("cli/fit.py", "without their centre of mass"): "load-centre",
    ("cli/fit.py", "Left out"): "left-out",
    ("cli/update.py", "Far from the prediction"): "not-holding",
    ("cli/summaries.py", "effect on the samples"): "moved",
    ("cli/summaries.py", "too few samples to test"): "campaign-not-tested",
    ("cli/summaries.py", "Weak map"): "weak",
    ("cli/summaries.py", "better.words"): ABOUT,
    ("cli/summaries.py", "calibration.hint_"): "identification",
    ("cli/tool.py", "found.suspicion"): "reflector-off",
    ("error_map/fit.py", "told"): "approximated",
    ("predictors/kriging/system.py", "the covariance matrix of"): NUMBERS,
    ("similarity/model.py", "variogram: "): NUMBERS,
}
MODULES = [
    *(f"cli/{name}.py" for name in ("importing", "fit", "update", "summaries", "tool")),
    *("error_map", "trackers", "samples", "predictors", "similarity", "geometry", "robots", "cell", "verification"),
]
"""Where these commands and what they call may warn."""
MATCHED = {
    "averaged": "averaged",
    "missing_points": "missing",
    "reordered_points": "reordered",
    "outlier_points": "suspect-readings",
    "notes": "import-note",
}
"""What a summary of an import says, with the codes."""
FIGURES = {"layout", "unit", "frame", "source", "readings", "plan", "samples", "scatter_mm", "median_mm", "max_mm"}
"""Parts of a summary that are no findings."""


def warnings_in(path: Path) -> Iterator[str]:
    """Yield the source of each warning: of warnings.warn, and of coloured lines of the commands."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            text = ast.unparse(node)
            if name == "warn" or (name == "say" and any(f"[{c}]" in text for c in ("yellow", "red", "{colour}"))):
                yield text


def test_every_warning_is_a_fact() -> None:
    unused, unknown = set(SAID), []
    for module in MODULES:
        for path in [SOURCE / module] if module.endswith(".py") else sorted((SOURCE / module).rglob("*.py")):
            file = path.relative_to(SOURCE).as_posix()
            for text in warnings_in(path):
                found = [key for key in SAID if key[0] == file and key[1] in text]
                unused -= set(found)
                if len(found) != 1:
                    unknown.append(f"{file}: {text}")
    assert not unknown, "state a fact of each, or why it is none"
    assert not unused
    assert {said for said in SAID.values() if " " not in said} <= set(CODES)


def test_every_part_of_the_summary_of_an_import_is_a_fact_or_a_figure() -> None:
    from dataclasses import fields

    from truepose.trackers import ImportSummary

    rows = {"missing", "reordered", "outliers"}  # the numbers of the points that are named
    assert {field.name for field in fields(ImportSummary)} == {*MATCHED, *FIGURES, *rows}
    assert set(MATCHED.values()) <= set(CODES)


@pytest.fixture(scope="module")
def virtual() -> tp.VirtualCell:
    return tp.VirtualCell("paper", seed=4)


def imported(virtual: tp.VirtualCell, folder: Path) -> tuple[Cell, Path]:
    """Import readings of which one is missing, one lies 300 mm off, one is repeated, and two came in another order."""
    design = virtual.design(40)
    samples = virtual.measure(design)
    p = samples.p_meas.copy()
    p[7] += [300.0, 0.0, 0.0]
    order = np.array([0, 1, 2, 4, 3, *range(5, 20), 19, *range(21, 40)])
    write_readings(folder / "tracker.csv", tp.Samples(p[order], p_cmd=p[order]), "spatial-analyzer")
    plan = Poses(q=design, p_cmd=virtual.robot.forward(design, tool=virtual.tf_flange_tool)[:, :3, 3])
    found = import_samples(virtual.cell, folder / "tracker.csv", plan, missing=True, reorder=True)
    found.write(folder / "samples.csv")
    assert {code for code, _ in found.samples.facts} >= {"missing", "suspect-readings"}
    return virtual.cell, folder / "samples.csv"


def test_what_the_import_finds_travels_with_the_samples_into_the_map(virtual: tp.VirtualCell, tmp_path: Path) -> None:
    cell, path = imported(virtual, tmp_path)
    samples = read_samples(path)
    assert samples.facts
    error_map = tp.fit_cell(cell, samples, "registration")
    facts = of_import(samples.facts)
    assert [fact for fact in error_map.facts if fact.step == "import"] == facts
    error_map.save(tmp_path / "map.truepose")
    assert set(facts) <= set(tp.load_map(tmp_path / "map.truepose").facts)
    masked = mask_table(path, tmp_path / "masked.csv", None)
    assert masked.facts == samples.facts
    later = tp.fit_cell(cell, virtual.measure(virtual.design(30)), "registration")
    updated = update_map(later, samples[:5])
    assert set(facts) <= set(updated.facts)
    assert update_map(updated, samples[5:9]).stated.count(facts[0]) == 1


def test_facts_in_a_table_are_kept_whatever_their_number(virtual: tp.VirtualCell, tmp_path: Path) -> None:
    from dataclasses import replace

    samples = virtual.measure(virtual.design(3))
    facts = tuple([("import-note", f"note {k}, said: so") for k in range(8)])
    for name in ("a.csv", "a.xlsx"):
        write_samples(tmp_path / name, replace(samples, facts=facts))
        assert sorted(read_samples(tmp_path / name).facts) == sorted(facts)
    write_samples(tmp_path / "b.csv", samples)
    assert "fact" not in (tmp_path / "b.csv").read_text().splitlines()[0]
    assert [fact.code for fact in of_import([("of-tomorrow", "something")])] == ["import-note"]


def test_samples_that_contradict_the_map_are_a_fact_of_the_updated_one(virtual: tp.VirtualCell) -> None:
    from dataclasses import replace

    error_map = tp.fit_cell(virtual.cell, virtual.measure(virtual.design(40)), "ordinary-kriging")
    new = virtual.measure(virtual.design(12, seed=1), seed=1)
    assert not update_map(error_map, new).stated
    moved = replace(new, p_meas=new.p_meas + np.array([3.0, 0.0, 0.0]))
    checked = recheck(error_map, moved)
    for given in (None, checked):
        (fact,) = update_map(error_map, moved, checked=given).stated
        assert (fact.code, fact.step) == ("not-holding", "update")
        assert "does not hold" in fact.words
