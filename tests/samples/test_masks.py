"""Masked samples: left out with a reason, by a file of points or in the table, and named in the map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from truepose import VirtualCell
from truepose.error_map import load_map, update_map
from truepose.error_map.fit import fit_cell
from truepose.error_map.importing import import_samples
from truepose.errors import DataError, FileError
from truepose.samples import Mask, Poses, Samples, mask_table, read_mask, read_samples, set_aside, write_samples
from truepose.samples.tidy import read_all_samples
from truepose.trackers import write_readings

CUT, COMMA = "beam was cut", '=1+2, moved "again"'


@pytest.fixture(scope="module")
def virtual() -> VirtualCell:
    return VirtualCell("paper")


@pytest.fixture(scope="module")
def measured(virtual: VirtualCell) -> Samples:
    return virtual.measure(virtual.design(40))


def reasons_for(samples: Poses, masked: dict[int, str]) -> np.ndarray:
    return np.array([masked.get(i, "") for i in range(len(samples))])


@pytest.mark.parametrize("ending", [".csv", ".xlsx"])
def test_reasons_survive_in_the_table(measured: Samples, tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"samples{ending}"
    write_samples(path, measured, reasons_for(measured, {4: CUT, 17: COMMA}))
    found = read_samples(path)
    assert [one["reason"] for one in found.excluded] == [f"masked: {CUT}", f"masked: {COMMA}"]
    assert [one["row"] for one in found.excluded] == [4, 17]
    assert found.row is not None
    assert found.row.tolist() == [i for i in range(40) if i not in (4, 17)]
    table = read_all_samples(path)
    assert len(table) == 40
    assert {i: table.reasons[i] for i in np.flatnonzero(table.reasons != "")} == {4: CUT, 17: COMMA}


def test_a_masked_row_may_hold_anything_and_rows_keep_their_numbers(tmp_path: Path) -> None:
    path = tmp_path / "samples.csv"
    path.write_text(
        "name,q1_deg,x_meas_mm,y_meas_mm,z_meas_mm,masked\n"
        "A,10,1000,0,0,\nB,20,nan,0,0,no reading\nC,30,1300,9,0,\nD,40,1500,nan,5,cut\n",
        "utf-8",
    )
    found = read_samples(path)
    assert found.row is not None
    assert found.row.tolist() == [0, 2]
    assert found.excluded == (
        {"row": 1, "point": "B", "line": 3, "reason": "masked: no reading"},
        {"row": 3, "point": "D", "line": 5, "reason": "masked: cut"},
    )


def test_masked_rows_of_a_pandas_table_do_not_count(measured: Samples) -> None:
    frame = measured.to_frame()
    frame["masked"] = ["" if i else CUT for i in range(len(frame))]
    found = Samples.from_frame(frame)
    assert len(found) == len(measured) - 1
    assert found.excluded[0]["reason"] == f"masked: {CUT}"


def test_all_rows_masked_is_an_error(measured: Samples, tmp_path: Path) -> None:
    write_samples(tmp_path / "samples.csv", measured, np.full(len(measured), CUT))
    with pytest.raises(FileError, match="all rows are masked"):
        read_samples(tmp_path / "samples.csv")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("point,why\nP1,x\n", "needs the columns point"),
        ("reason\nx\n", "needs the columns point"),
        ("point,reason\nP1,\n", ":2: has no reason"),
        ("point,reason\nP1,x\nP1,y\n", ":3: states P1 a second time"),
        ("row,reason\nP1,x\n", ":2: row is 'P1'"),
        (f"row,reason\n1,{'x' * 300}\n", ":2: has a reason of 300 characters"),
    ],
)
def test_a_mask_file_says_what_it_lacks(tmp_path: Path, text: str, match: str) -> None:
    (tmp_path / "mask.csv").write_text(text, "utf-8")
    with pytest.raises(FileError, match=match):
        read_mask(tmp_path / "mask.csv")


def test_a_mask_is_written_as_it_is_read(tmp_path: Path) -> None:
    for reasons in ({"P1": CUT, "=P2": COMMA}, {3: CUT, 5: COMMA}):
        mask = Mask(dict(reasons))
        mask.write(tmp_path / "mask.csv")
        assert read_mask(tmp_path / "mask.csv").reasons == reasons


def test_points_that_are_not_there_or_not_one_are_refused(measured: Samples) -> None:
    with pytest.raises(FileError, match="row 99 is not among the samples"):
        Mask({99: CUT}).of(measured)
    named = Poses(q=np.zeros((3, 6)), name=np.array(["a", "A", "b"]))
    assert Mask({"B ": CUT}).of(named).tolist() == ["", "", CUT]
    with pytest.raises(FileError, match="stands for 2 samples"):
        Mask({"a": CUT}).of(named)


def test_a_map_is_that_of_the_other_samples_and_names_the_masked_ones(
    virtual: VirtualCell, measured: Samples, tmp_path: Path
) -> None:
    reasons = reasons_for(measured, {7: CUT})
    masked = fit_cell(virtual.cell, set_aside(measured, reasons), "ordinary-kriging")
    other = fit_cell(virtual.cell, measured[reasons == ""], "ordinary-kriging")
    poses = Poses(q=virtual.design(5, seed=3))
    np.testing.assert_array_equal(masked.predict_errors(poses)[0], other.predict_errors(poses)[0])
    assert [one["reason"] for one in masked.excluded] == [f"masked: {CUT}"]
    masked.save(tmp_path / "map.truepose")
    assert load_map(tmp_path / "map.truepose").excluded == masked.excluded
    new = virtual.measure(virtual.design(10, seed=4), seed=4)
    updated = update_map(masked, set_aside(new, reasons_for(new, {2: COMMA})))
    assert len(updated.samples) == 39 + 9
    assert [one["reason"] for one in updated.excluded] == [f"masked: {CUT}", f"masked: {COMMA}"]


def test_import_takes_a_mask_and_masks_a_gross_reading(
    virtual: VirtualCell, measured: Samples, tmp_path: Path, run: Callable[..., Any]
) -> None:
    gross = measured.p_meas.copy()
    gross[11] += [30.0, -20.0, 10.0]
    names = np.array([f"P{i:03d}" for i in range(40)])
    plan = Poses(q=measured.q, name=names)
    readings = Samples(gross, q=measured.q, name=names)
    write_readings(tmp_path / "tracker.csv", readings, "tidy")
    write_samples(tmp_path / "plan.csv", plan)
    (tmp_path / "cell.toml").write_text(virtual.cell.to_toml(), "utf-8")
    Mask({"P011": CUT}).write(tmp_path / "mask.csv")
    found = import_samples(virtual.cell, tmp_path / "tracker.csv", plan, mask=Mask({"P011": CUT}))
    without = import_samples(virtual.cell, tmp_path / "tracker.csv", plan)
    assert [one["point"] for one in without.outliers] == ["P011"]
    assert found.outliers == []
    row = found.rows()[11]
    assert (row["masked"], row["outlier"]) == (CUT, False)
    assert row["residual_mm"] == pytest.approx(np.linalg.norm([30.0, -20.0, 10.0]), abs=5.0)
    done = run(
        *("import", tmp_path / "cell.toml", tmp_path / "tracker.csv", "--plan", tmp_path / "plan.csv", "--json"),
        *("--mask", tmp_path / "mask.csv", "--out", tmp_path / "samples.csv"),
    )
    assert [one["reason"] for one in done.json["masked"]] == [f"masked: {CUT}"]
    assert [one["point"] for one in read_samples(tmp_path / "samples.csv").excluded] == ["P011"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("key", ["P011", 11])
@pytest.mark.parametrize("row", [["nan"] * 3, ["0"] * 3, None])
def test_a_masked_point_may_lack_its_reading(
    virtual: VirtualCell, measured: Samples, tmp_path: Path, key: str | int, row: list[str] | None
) -> None:
    names = np.array([f"P{i:03d}" for i in range(40)])
    path, plan = tmp_path / "tracker.csv", Poses(q=measured.q, name=names)
    lines = [[name, *(f"{x:.4f}" for x in p)] for name, p in zip(names, measured.p_meas, strict=True)]
    lines[11:12] = [] if row is None else [["P011", *row]]
    path.write_text("\n".join(map(",".join, [["name", "x_meas_mm", "y_meas_mm", "z_meas_mm"], *lines])) + "\n", "utf-8")
    with pytest.raises(DataError, match="without a reading: point P011"):
        import_samples(virtual.cell, path, plan, mask=Mask({"P012": CUT}))
    found = import_samples(virtual.cell, path, plan, mask=Mask({key: CUT, 12: COMMA} if key == 11 else {key: CUT}))
    assert found.understood.missing_points == ("P011",)
    assert len(found.table) == 39
    assert len(found.samples) == (38 if key == 11 else 39)


@pytest.mark.parametrize("ending", [".csv", ".xlsx"])
def test_a_table_is_masked_anew_and_nothing_else_in_it_changes(tmp_path: Path, ending: str) -> None:
    path, out, back = tmp_path / "a.csv", tmp_path / f"b{ending}", tmp_path / "c.csv"
    text = (
        "operator;name;q1_deg;x_meas_mm;y_meas_mm;z_meas_mm;Masked\n"
        "A;P1;10.50;1000;0;0;\nB;P2;20;7;0;0;no reading\n'=C;P3;30;1300;9;0;\n"
    )
    path.write_text(text, "utf-8")
    found = mask_table(path, out, Mask({"P1": COMMA, 1: CUT}))
    assert path.read_text("utf-8") == text
    assert (len(found), [one["row"] for one in found.excluded]) == (1, [0, 1])
    assert read_all_samples(out).reasons.tolist() == [COMMA, CUT, ""]
    if ending == ".csv":
        first = out.read_text("utf-8").splitlines()
        assert first[0] == "operator;name;q1_deg;x_meas_mm;y_meas_mm;z_meas_mm;masked"
        assert first[1].startswith("A;P1;10.50;1000;0;0;")
        assert first[3] == "'=C;P3;30;1300;9;0;"
    mask_table(out, back, None)
    assert read_all_samples(back).reasons.tolist() == ["", "", ""]


@pytest.mark.parametrize("bad", ["nan", "inf", "", "no reading", "1e300", "٣", "1_0"])
@pytest.mark.parametrize("column", range(1, 5))
def test_a_row_that_is_masked_may_hold_anything_before_and_after(tmp_path: Path, bad: str, column: int) -> None:
    path, out, back = tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "c.csv"
    fields = ["P2", "20", "1200", "7", "0"]
    fields[column] = bad
    header = "name,q1_deg,x_meas_mm,y_meas_mm,z_meas_mm"
    path.write_text(f"{header}\nP1,10,1000,0,0\n{','.join(fields)}\nP3,30,1300,9,0\n", "utf-8")
    shown = read_all_samples(path)
    values = np.column_stack([shown.values["q"], shown.values["p_meas"]])
    assert np.argwhere(~np.isfinite(values)).tolist() == [[1, column - 1]]
    with pytest.raises(FileError, match=":3: "):
        read_samples(path)
    found = mask_table(path, out, Mask({"P2": CUT}))
    assert found.excluded == read_samples(out).excluded
    assert [one["line"] for one in found.excluded] == [3]
    assert found.p_meas.tolist() == [[1000.0, 0.0, 0.0], [1300.0, 9.0, 0.0]]
    assert out.read_text("utf-8").splitlines()[2] == f"{','.join(fields)},{CUT}"
    with pytest.raises(FileError, match=":3: "):
        mask_table(out, back, Mask({"P1": CUT}))
    assert not back.exists()
    assert len(mask_table(out, back, Mask({1: COMMA}))) == 2


def test_a_mask_that_fits_no_row_or_leaves_none_writes_nothing(tmp_path: Path) -> None:
    path, out = tmp_path / "a.csv", tmp_path / "b.csv"
    path.write_text("name,q1_deg,x_meas_mm,y_meas_mm,z_meas_mm\nP1,1,1,1,1\nP2,1,1,1,1\n", "utf-8")
    for mask, words in ((Mask({"P9": CUT}), "P9 is not among"), (Mask({0: CUT, 1: CUT}), "at least one must count")):
        with pytest.raises(FileError, match=words):
            mask_table(path, out, mask)
    assert not out.exists()


def test_the_command_masks_a_table_and_never_writes_over_one(
    measured: Samples, tmp_path: Path, run: Callable[..., Any]
) -> None:
    path, mask, out = tmp_path / "a.csv", tmp_path / "mask.csv", tmp_path / "b.csv"
    write_samples(path, measured, reasons_for(measured, {4: CUT}))
    Mask({7: COMMA}).write(mask)
    done = run("mask", path, "--mask", mask, "--out", out, "--json")
    assert (done.json["n"], done.json["masked"]) == (39, 1)
    assert [one["row"] for one in read_samples(out).excluded] == [7]
    assert run("mask", path, "--out", out).code == 1
    assert run("mask", path, "--out", path, "--force").code == 1
    assert run("mask", path, "--out", out, "--force").code == 0
    assert read_samples(out).excluded == ()
