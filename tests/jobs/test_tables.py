"""Large tables of poses: equal predictions in all forms of the executor, with constant memory, whole or not at all."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import sys
from pathlib import Path

import numpy as np
import pandas
import pytest
from tests.needs import needed

import truepose as tp
from truepose.cli import maps
from truepose.error_map import bulk
from truepose.jobs.executor import FinishedResults
from truepose.numerics import processes
from truepose.samples import write_samples
from truepose.samples.parquet import ParquetTable

pyarrow = needed("pyarrow", "'truepose[scale]'")


@pytest.fixture
def poses(virtual: tp.VirtualCell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A table of 230 poses, which is predicted in 23 parts."""
    monkeypatch.setattr(processes, "cores", lambda: 2)
    monkeypatch.setattr(bulk, "ROWS", 10)
    path = tmp_path / "poses.parquet"
    tp.Poses(q=virtual.design(230, seed=6)).to_frame().assign(part="door").to_parquet(path)
    return path


@pytest.fixture
def expected(poses: Path, map_path: Path, run) -> bytes:
    """The table that one process writes."""
    out = poses.with_name("expected.parquet")
    assert run("predict", map_path, poses, "--out", out, "--workers", 1).code == 0
    return out.read_bytes()


def names(folder: Path) -> set[str]:
    """Return the names of all files in a folder, drafts and journals included."""
    return {path.name for path in folder.iterdir()}


@pytest.mark.exhaustive
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_table_is_predicted_to_the_same_bytes_in_all_forms(
    cluster, virtual, map_path, tmp_path, monkeypatch, run, ending
):
    monkeypatch.setattr(processes, "cores", lambda: 2)
    monkeypatch.setattr(bulk, "ROWS", 10)
    poses = tp.Poses(q=virtual.design(230, seed=6))
    table = tmp_path / f"poses.{ending}"
    if ending == "csv":
        write_samples(table, poses)
    else:
        poses.to_frame().assign(part="door").to_parquet(table)
    found = []
    for options in (["--workers", "1"], ["--workers", "2"], ["--cluster", cluster.address]):
        out = tmp_path / f"out{len(found)}.{ending}"
        done = run("predict", map_path, table, "--out", out, "--json", *options)
        assert done.code == 0, done
        found.append((hashlib.sha256(out.read_bytes()).hexdigest(), json.loads(done.out)["max_std_mm"]))
    assert found[0] == found[1] == found[2]
    if ending == "parquet":
        written = pandas.read_parquet(tmp_path / "out0.parquet")
        assert list(written["part"].unique()) == ["door"]
        p, std = tp.load_map(map_path).predict_measured(poses)
        np.testing.assert_allclose(written[["x_pred_mm", "y_pred_mm", "z_pred_mm"]], p, atol=1e-9)
        np.testing.assert_allclose(written["std_mm"], np.linalg.norm(std, axis=1), atol=1e-9)
        assert not [path for path in tmp_path.iterdir() if path.name.startswith(".truepose")]


def test_damaged_parquet_is_refused_by_name(map_path, tmp_path, run):
    whole = tmp_path / "poses.parquet"
    pandas.DataFrame({"q1_deg": np.zeros(9)}).to_parquet(whole)
    (tmp_path / "cut.parquet").write_bytes(whole.read_bytes()[:-9])
    (tmp_path / "text.parquet").write_text("q1_deg,q2_deg\n1,2\n")
    pandas.DataFrame({"q1_deg": [0.0, np.nan]}).to_parquet(tmp_path / "nan.parquet")
    pandas.DataFrame({"q1": ["a"]}).to_parquet(tmp_path / "words.parquet")
    for name, reason in (
        ("cut", "is not a table in Parquet"),
        ("text", "is not a table in Parquet"),
        ("nan", "q1_deg is not a number"),
        ("words", "needs columns q1_deg"),
        ("missing", "no such file"),
    ):
        done = run("predict", map_path, tmp_path / f"{name}.parquet", "--out", tmp_path / "out.parquet")
        assert done.code == 1
        assert reason in done.err, name
        assert f"{name}.parquet" in done.err
        assert not (tmp_path / "out.parquet").exists()
    done = run("predict", map_path, whole, "--out", tmp_path / "out.csv")
    assert "give both as Parquet" in done.err


@pytest.mark.exhaustive
@pytest.mark.parametrize("rows", [400_000, 50_000])  # of a row group
def test_memory_does_not_grow_with_the_table(tmp_path, rows):
    rng = np.random.default_rng(0)
    table = pandas.DataFrame({f"q{k}_deg": rng.uniform(-90, 90, 400_000) for k in range(1, 7)})
    table.to_parquet(tmp_path / "poses.parquet", row_group_size=rows, compression=None)
    size, before = (tmp_path / "poses.parquet").stat().st_size, pyarrow.total_allocated_bytes()
    most = max(pyarrow.total_allocated_bytes() for _ in ParquetTable(tmp_path / "poses.parquet").parts(1000)) - before
    assert most < 0.75 * size  # buffers of each column; the whole table takes 1.4 times the file


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupted_prediction_continues_on_a_cluster(
    cluster, poses, expected, map_path, tmp_path, monkeypatch, run
):
    before, out = names(tmp_path), tmp_path / "out.parquet"
    known: list[bytes] = []
    get = FinishedResults.get

    def noted(self: FinishedResults, key: str) -> bytes | None:
        found = get(self, key)
        known.extend([] if found is None else [found])
        return found

    def interrupted(totals: maps._Totals, *part: np.ndarray) -> dict[str, np.ndarray]:
        if totals.done == 50:
            raise KeyboardInterrupt
        return add(totals, *part)

    add = maps._Totals.add
    monkeypatch.setattr(FinishedResults, "get", noted)
    with monkeypatch.context() as patch:
        patch.setattr(maps._Totals, "add", interrupted)
        assert run("predict", map_path, poses, "--out", out, "--cluster", cluster.address).code == 130
    assert names(tmp_path) == before
    assert known == []
    assert run("predict", map_path, poses, "--out", out, "--cluster", cluster.address).code == 0
    assert len(known) >= 5
    assert out.read_bytes() == expected
    known.clear()
    assert run("predict", map_path, poses, "--out", out, "--force", "--cluster", cluster.address).code == 0
    assert known == []  # nothing is kept of a run that has ended


@pytest.mark.exhaustive
def test_a_killed_process_costs_no_row(poses, expected, map_path, tmp_path, monkeypatch, run):
    killed: list[int] = []

    def kill(totals: maps._Totals, *part: np.ndarray) -> dict[str, np.ndarray]:
        if totals.done == 50:
            process = multiprocessing.active_children()[0]
            process.kill()
            killed.append(process.pid or 0)
        return add(totals, *part)

    add = maps._Totals.add
    monkeypatch.setattr(maps._Totals, "add", kill)
    out = tmp_path / "out.parquet"
    assert run("predict", map_path, poses, "--out", out, "--workers", 2).code == 0
    assert len(killed) == 1
    assert out.read_bytes() == expected


@pytest.mark.skipif(sys.platform == "win32", reason="file sizes cannot be limited on Windows")
def test_a_full_disk_leaves_no_part_of_a_table(poses, expected, map_path, tmp_path, run):
    import resource

    before, out = names(tmp_path), tmp_path / "out.parquet"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(expected) // 2, hard))
    try:
        done = run("predict", map_path, poses, "--out", out, "--workers", 1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "out.parquet: cannot be written: File too large" in done.failed()
    assert names(tmp_path) == before
    assert run("predict", map_path, poses, "--out", out, "--workers", 1).code == 0
    assert out.read_bytes() == expected
