"""The three forms of the executor give the same bytes, and survive workers, disks and schedulers that fail."""

from __future__ import annotations

import asyncio
import hashlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from tests.jobs.clusters import LocalCluster, need_distributed, wait_for_workers
from tests.jobs.executor_tasks import counted, full_disk, held_back, random_product, slow
from tests.needs import needed

import truepose as tp
from truepose.errors import DataError, TrueposeError
from truepose.jobs.executor import Cluster, FinishedResults, Security, make_executor
from truepose.jobs.executor.identity import differences, identity
from truepose.numerics import processes
from truepose.numerics.executor import Executor, Serial, Task
from truepose.numerics.processes import Processes
from truepose.programs import FrameTable, parallel, read_programs
from truepose.programs.batch import correct_programs
from truepose.programs.listing import write_checked
from truepose.studies.paper import METHODS, run_study

distributed = need_distributed()
FORMS = ("serial", "processes", "cluster")
Form = Callable[[str], Executor]


@pytest.fixture
def form(cluster: LocalCluster, monkeypatch: pytest.MonkeyPatch) -> Form:
    monkeypatch.setattr(processes, "cores", lambda: 2)

    def make(name: str) -> Executor:
        if name == "cluster":
            return make_executor("tests", cluster=cluster.address)
        return Serial() if name == "serial" else Processes(2)

    return make


@pytest.fixture
def programs(virtual: tp.VirtualCell, tmp_path: Path) -> Path:
    """Folders of KRL programs, one of which cannot be corrected."""
    p = virtual.cell.load_robot().forward(virtual.design(40, seed=2), tool=virtual.tf_flange_tool)[:, :3, 3]
    folder, (a, b, c) = tmp_path / "programs", virtual.preset.abc_deg
    for k in range(6):
        place = folder / f"part{k}"
        place.mkdir(parents=True)
        lines = "".join(f"LIN {{X {x:.3f},Y {y:.3f},Z {z:.3f},A {a},B {b},C {c}}}\n" for x, y, z in p[k::6])
        text = f"DEF P{k}()\n$TOOL=TOOL_DATA[1]\n$BASE=$NULLFRAME\n{lines}END\n"
        (place / f"p{k}.src").write_text(text if k != 4 else text.replace(",Y", ",Y 1.2.", 1))
    return folder


def hashes(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@contextmanager
def cluster_in_this_process(protocol: str = "tcp://", **options: object) -> Iterator[str]:
    """Run a scheduler and workers as threads, where none has to be killed; yield the address."""
    settings = {"processes": False, "dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    with distributed.LocalCluster(protocol=protocol, **settings, **options) as running:
        yield running.scheduler_address


@pytest.mark.exhaustive
def test_programs_are_read_alike_in_all_forms(form, programs, tmp_path, run):
    for k in range(40):
        moves = "".join(f"  movel(p[{0.5 + k / 1e3},{i / 1e3},0.4,0,3.14,0],a=1,v=0.1)\n" for i in range(9))
        (programs / f"weld{k}.script").write_text(f"def weld{k}():\n{moves}end\n")
    (programs / "broken.script").write_text("def weld(:\n")
    found = set()
    for name in FORMS:
        with form(name) as executor:
            read = read_programs([programs, *sorted(programs.rglob("*.src"))], executor=executor)
        write_checked(tmp_path / "targets.json", read.programs)
        failed = tuple(map(str, read.unreadable))
        found.add((hashlib.sha256((tmp_path / "targets.json").read_bytes()).hexdigest(), len(read.programs), failed))
    assert len(found) == 1
    assert found.pop()[1] == 1 + 40 + 5
    outputs = [run("check", programs, "--json", "--workers", workers).out for workers in (1, 2)]
    assert outputs[0] == outputs[1]
    assert "weld7" in outputs[0]


@pytest.mark.exhaustive
def test_files_that_workers_have_read_are_inputs(form, programs, run):
    program = programs / "part0" / "p0.src"
    before = program.read_bytes()
    done = run("check", *programs.rglob("*.src"), "--targets", program, "--force", "--workers", 2)
    assert "is an input, and inputs are never overwritten" in done.failed()
    assert program.read_bytes() == before


@pytest.mark.exhaustive
@pytest.mark.parametrize("given", ["folders", "files"])  # workers can prove single files only
def test_programs_are_corrected_to_the_same_bytes_in_all_forms(form, virtual, map_path, programs, tmp_path, given):
    error_map = tp.load_map(map_path)
    given = sorted(programs.iterdir() if given == "folders" else programs.rglob("*.src"))
    frames = FrameTable(tools={1: virtual.tf_flange_tool})

    def written(name: str | None) -> dict[str, str]:
        options = {"frames": frames, "on_guard": "skip", "keep_going": True}
        if name is None:
            batch = correct_programs(given, error_map, **options)
        else:
            with form(name) as executor:
                batch = correct_programs(given, error_map, executor=executor, **options)
        assert (batch.n_corrected, batch.n_refused) == (5, 1)
        assert batch.coverage.corrected > 15
        batch.write(tmp_path / str(name))
        return hashes(tmp_path / str(name))

    expected = written(None)
    assert len(expected) >= 15
    for name in FORMS:
        assert written(name) == expected, name


@pytest.mark.exhaustive
def test_the_first_refusal_is_the_same_in_all_forms(form, virtual, map_path, programs):
    error_map = tp.load_map(map_path)
    refusals = set()
    for name in (None, *FORMS):
        with pytest.raises(TrueposeError) as error:  # noqa: SIM117
            with form(name or "serial") as executor:
                correct_programs(sorted(programs.iterdir())[:3], error_map, executor=executor if name else None)
        refusals.add((type(error.value), str(error.value)))
    assert len(refusals) == 1
    assert "p0.src" in refusals.pop()[1]


@pytest.mark.exhaustive
def test_a_program_that_was_corrected_is_refused_in_all_forms(form, virtual, map_path, programs, tmp_path):
    error_map, given = tp.load_map(map_path), sorted(programs.iterdir())[:2]
    options = {"frames": FrameTable(tools={1: virtual.tf_flange_tool}), "on_guard": "skip"}
    correct_programs(given, error_map, **options).write(tmp_path / "out")
    again = sorted(path for path in (tmp_path / "out").iterdir() if path.is_dir())
    for name in FORMS:
        with pytest.raises(TrueposeError, match="was corrected already"), form(name) as executor:
            correct_programs(again, error_map, executor=executor, **options)


def test_parts_of_a_long_program_are_kept_in_pieces():
    data = [np.random.default_rng(k).integers(0, 9, 700_000, np.uint8).tobytes() for k in range(6)]
    spool = parallel._Spool()
    read = [spool.add(parallel._packed(some)) for some in (data, data[:1], [], data[::-1])]
    for some, parts in zip((data, data[:1], [], data[::-1]), read, strict=True):
        pieces = list(parts())
        assert b"".join(pieces) == b"".join(some)
        assert max(map(len, pieces)) <= parallel._PIECE


@pytest.mark.exhaustive
def test_cross_validation_is_the_same_in_all_forms(form, virtual):
    samples = virtual.measure(virtual.design(24, seed=4))
    candidates = ["registration", "ordinary-kriging"]
    found = []
    for name in FORMS:
        with form(name) as executor:
            made = tp.fit_cell(virtual.cell, samples, candidates=candidates, folds=3, executor=executor)
        found.append((made.hash, made.ranking, made.expected))
    assert found[0] == found[1] == found[2]


@pytest.mark.exhaustive
def test_a_study_is_the_same_in_all_forms(form, monkeypatch):
    monkeypatch.setattr("truepose.studies.paper.SAMPLINGS", ("random",))
    found = []
    for name in FORMS:
        with form(name) as executor:
            found.append(run_study(seeds=[3], per_axis=3, methods=METHODS[:1], executor=executor))
    assert len(found[0]) == 2
    assert found[0] == found[1] == found[2]


def test_a_cluster_with_tls_wants_certificates(tmp_path, monkeypatch):
    needed("cryptography", "cryptography")
    made = distributed.Security.temporary()
    files = {"ca": made.tls_ca_file, "cert": made.tls_client_cert, "key": made.tls_client_key}
    for name, text in files.items():
        (tmp_path / f"{name}.pem").write_text(text)
    with cluster_in_this_process(n_workers=1, threads_per_worker=1, protocol="tls://", security=made) as address:
        assert address.startswith("tls://")
        with Cluster(address, security=Security(**{name: tmp_path / f"{name}.pem" for name in files})) as executor:
            key = executor.share(lambda: b"number ", None)
            assert dict(executor.run(slow, [Task((key,), (7, 0.0))])) == {0: "number 7"}
        monkeypatch.setattr("truepose.jobs.executor.cluster._CONNECT_S", 1.0)
        with pytest.raises(DataError, match="no scheduler answers at tls://"):
            Cluster(address)


@pytest.mark.exhaustive
def test_a_killed_worker_loses_nothing_and_a_slow_one_delays_only(cluster, tmp_path):
    extra = cluster.start_worker()
    wait_for_workers(cluster.address, 3)
    shared = tmp_path / "shared"
    with Cluster(cluster.address, folder=shared) as executor:
        key = executor.share(lambda: b"number ", None)
        found = {}
        tasks = (Task((key,), (k, 1.0 if k == 0 else 0.02), str(k)) for k in range(60))
        for index, result in executor.run(slow, tasks):
            found[index] = result
            if len(found) == 10:
                os.kill(extra.pid, 9)
    assert found == {k: f"number {k}" for k in range(60)}
    assert not list((shared / "done").iterdir())  # nothing is left of a run that has ended


@pytest.mark.exhaustive
def test_results_survive_a_lost_scheduler(cluster, tmp_path):
    kept, notes = tmp_path / "kept", tmp_path / "notes"
    notes.mkdir()

    def tasks() -> Iterator[Task]:
        return (Task((), (k, str(notes)), str(k)) for k in range(40))

    lost = LocalCluster(tmp_path)
    try:
        lost.start_scheduler()
        lost.start_worker()
        wait_for_workers(lost.address, 1)
        finished = 0
        with (  # noqa: PT012
            pytest.raises(DataError, match=r"scheduler tcp://\S+ was lost; \d+ results .* run the same command again"),
            Cluster(lost.address, kept=kept) as executor,
        ):
            for _ in executor.run(counted, tasks()):
                finished += 1
                if finished == 20:
                    lost.scheduler.kill()
    finally:
        lost.end()
    before = len(list(notes.iterdir()))
    assert len(list((kept / "done").iterdir())) == finished >= 20
    with Cluster(cluster.address, kept=kept) as executor:
        found = dict(executor.run(counted, tasks()))
    assert found == {k: k**2 for k in range(40)}
    assert len(list(notes.iterdir())) - before == 40 - finished
    assert not list((kept / "done").iterdir())


@pytest.mark.exhaustive
def test_an_interrupt_cancels_the_tasks_that_have_not_run(cluster, tmp_path, monkeypatch):
    def interrupted(client: distributed.Client) -> None:
        monkeypatch.setattr(distributed.Client, "close", lambda *_, **__: None)  # the cancellation alone is tested
        with pytest.raises(KeyboardInterrupt), Cluster(cluster.address) as executor:  # noqa: PT012
            clients.append(executor._client)
            for done, _ in enumerate(executor.run(held_back, (Task((), (k, 5, str(tmp_path))) for k in range(100))), 1):
                if done == 5:
                    raise KeyboardInterrupt
        client.run_on_scheduler(no_queue)
        monkeypatch.undo()

    clients: list[distributed.Client] = []
    with distributed.Client(cluster.address, set_as_default=False) as client:
        try:
            interrupted(client)
        finally:
            (tmp_path / "go").touch()
            for one in clients:
                one.close()
    assert len(list(tmp_path.glob("*.started"))) <= 5 + 2  # two workers


async def no_queue(dask_scheduler: distributed.Scheduler) -> None:
    """Wait until a scheduler has no task that waits for a worker."""
    for _ in range(1000):
        if not (dask_scheduler.queued or dask_scheduler.unrunnable):
            return
        await asyncio.sleep(0.02)
    raise AssertionError("tasks were not cancelled")


@pytest.mark.exhaustive
def test_an_interrupted_correction_on_a_cluster_writes_nothing(cluster, map_path, programs, tmp_path, run, monkeypatch):
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    (programs / "part4" / "p4.src").unlink()
    for program in programs.rglob("*.src"):
        program.write_text(program.read_text().replace("TOOL_DATA[1]", "$NULLFRAME"))
    before = hashes(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("truepose.cli.output._Line.count", interrupt)
    done = run("correct", map_path, *programs.rglob("*.src"), "--on-guard", "skip", "--cluster", cluster.address)
    assert (done.code, done.err) == (130, "truepose: interrupted; no file was written\n")
    assert hashes(tmp_path) == before


@pytest.mark.skipif(sys.platform == "win32", reason="file sizes cannot be limited on Windows")
def test_a_full_disk_of_a_worker_is_named(cluster, tmp_path):
    with (
        pytest.raises(TrueposeError, match=r"cannot be written"),
        Cluster(cluster.address, folder=tmp_path / "shared") as executor,
    ):
        list(executor.run(full_disk, [Task((), (4096,), "large")]))


def test_a_damaged_result_is_computed_again(tmp_path):
    results = FinishedResults(tmp_path)
    key = results.key("map", "program")
    results.blobs.path(results.put(key, b"corrected")).write_bytes(b"corrupted")
    assert results.get(key) is None
    (tmp_path / "done" / key).write_text("../../secret")
    assert results.get(key) is None


def test_other_versions_are_named():
    own = identity()
    assert differences(own, dict(own)) == ""
    assert "numpy 1.0, here " in differences(own, {**own, "numpy": "1.0"})


def test_workers_with_the_same_code_of_other_commits_agree():
    assert re.fullmatch(r"\d+\.\d+\.\d+, code [0-9a-f]{12}", identity()["truepose"])  # and no commit


def test_workers_with_several_threads_are_refused():
    with cluster_in_this_process(n_workers=0) as address, pytest.raises(DataError, match="has no worker; start some"):
        Cluster(address)
    with (
        cluster_in_this_process(n_workers=1, threads_per_worker=2) as address,
        pytest.raises(DataError, match="has 2 threads, and results need one each; start workers with: dask worker"),
    ):
        Cluster(address)


def test_wrong_addresses_and_options_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("truepose.jobs.executor.cluster._CONNECT_S", 0.5)
    with pytest.raises(DataError, match=r"no scheduler answers at tcp://127.0.0.1:1 .*start one with"):
        make_executor("tests", cluster="tcp://127.0.0.1:1")
    with pytest.raises(DataError, match="no scheduler answers at nonsense://x"):
        make_executor("tests", cluster="nonsense://x")
    with pytest.raises(DataError, match="give only one of them"):
        make_executor("tests", cluster="tcp://127.0.0.1:1", workers=2)
    with pytest.raises(DataError, match="need --cluster ADDRESS"):
        make_executor("tests", folder=tmp_path)
    security = Security(tmp_path / "ca", tmp_path / "cert", tmp_path / "key")
    with pytest.raises(DataError, match="is not encrypted"):
        make_executor("tests", cluster="tcp://127.0.0.1:1", security=security)


def test_arrays_of_a_task_are_equal_to_the_last_bit(form):
    found = []
    for name in FORMS:
        with form(name) as executor:
            results = dict(executor.run(random_product, (Task((), (seed,)) for seed in range(8))))
        found.append(np.concatenate([results[k] for k in range(8)]).tobytes())
    assert found[0] == found[1] == found[2]
