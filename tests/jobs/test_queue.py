"""Jobs: order, progress, results, cancelling, and whatever goes wrong with a process or a disk."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.jobs.conftest import LONG, QUICK, SLOW, until, with_step

from truepose._io import commits
from truepose.cli import app
from truepose.errors import DataError, FileError, RecoveryWarning, RefusedError
from truepose.jobs import Job, JobQueue, UnknownJobError
from truepose.jobs import folder as job_folder
from truepose.jobs.job import COMMANDS

Submit = Callable[..., Job]
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


def test_every_command_that_ends_on_its_own_can_be_a_job() -> None:
    assert {command.name for command in app.registered_commands} - {"watch", "app"} == COMMANDS


def test_the_result_is_the_json_of_the_command(queue: JobQueue, submit: Submit, run: Any) -> None:
    job = queue.wait(submit(*QUICK).id, timeout=LONG)
    assert (job.state, job.problem, job.warnings) == ("done", None, ())
    assert job.result == run(*QUICK, "--json").json
    assert job.started is not None
    assert job.ended is not None
    assert job.seconds is not None
    assert 0 < job.seconds < LONG


@pytest.mark.exhaustive
def test_steps_and_counts_are_seen_while_the_job_runs(queue: JobQueue, submit: Submit) -> None:
    job = submit("warm-up")
    steps, counts, revision = set(), [], -1
    while job.active:
        job = queue.wait(job.id, after=revision, timeout=LONG)
        assert job.revision > revision
        revision = job.revision
        steps.add(job.step)
        counts.append((job.done, job.total))
    assert job.state == "done"
    assert "Compiling" in steps
    done, total = counts[-1]
    assert done == total
    assert done > 0


def test_names_with_any_characters_and_folders_arrive(queue: JobQueue, workspace: Path) -> None:
    folder = workspace / "Zelle 1 – 测试" / "sub"
    folder.mkdir(parents=True)
    job = queue.submit(["init", "neu 新", "--robot", "kuka-kr150-2"], folder=folder, cell="c", title="Neu – 新")
    job = queue.wait(job.id, timeout=LONG)
    assert job.state == "done", job
    assert Path(job.result["cell"]) == Path("neu 新", "cell.toml")
    assert (folder / "neu 新" / "cell.toml").is_file()
    assert job.folder == "Zelle 1 – 测试/sub"


def test_a_module_in_the_folder_is_not_imported(queue: JobQueue, submit: Submit, workspace: Path) -> None:
    for name in ("json", "typer", "numpy", "truepose"):
        (workspace / f"{name}.py").write_text("raise SystemExit('imported')")
    assert queue.wait(submit(*QUICK).id, timeout=LONG).state == "done"


@pytest.mark.exhaustive
def test_one_worker_runs_jobs_in_their_order(queue: JobQueue, submit: Submit) -> None:
    ids = [submit(*QUICK, title=str(k)).id for k in range(4)]
    seen: list[str] = []
    while len(seen) < 4:
        running = [job.id for job in queue.list(states=["running"])]
        assert len(running) <= 1
        ended = [job.id for job in reversed(queue.list(states=["done"]))]
        assert ended == ids[: len(ended)]
        seen = ended
        time.sleep(0.005)
    assert [job.id for job in queue.list()] == ids[::-1]


def test_two_workers_run_two_jobs_at_once_and_share_the_processors(
    workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads = []

    class Spy(subprocess.Popen):  # type: ignore[type-arg]
        def __init__(self, *args: Any, env: dict[str, str], **options: Any) -> None:
            threads.append(env.get("NUMBA_NUM_THREADS"))
            super().__init__(*args, env=env, **options)

    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    monkeypatch.setattr("truepose.jobs.process.subprocess.Popen", Spy)
    monkeypatch.setattr("truepose.numerics.threads.cores", lambda: 6)
    with JobQueue(workspace, workers=2, ready=False) as queue:
        jobs = [queue.submit(SLOW, folder=workspace, cell="", title="") for _ in range(3)]
        until(lambda: len(queue.list(states=["running"])) == 2)
        assert [job.state for job in queue.list()] == ["queued", "running", "running"]
        queue.cancel(jobs[0].id)
        until(lambda: queue.get(jobs[2].id).state == "running")
    assert threads == ["3"] * 3
    with JobQueue(workspace, workers=1, ready=False) as queue:
        assert queue._processes._threads() is None


def test_the_order_does_not_depend_on_the_clock(
    queue: JobQueue, submit: Submit, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = submit(*QUICK)
    monkeypatch.setattr("truepose.jobs.queue._now", lambda: "1999-01-01T00:00:00Z")
    second = submit(*QUICK)
    assert second.created < first.created
    assert [job.id for job in queue.list()] == [second.id, first.id]


@pytest.mark.exhaustive
def test_the_list_is_filtered_and_has_no_results(queue: JobQueue, submit: Submit) -> None:
    one, other = submit(*QUICK, cell="one"), submit(*QUICK, cell="other")
    queue.wait(one.id, timeout=LONG)
    queue.wait(other.id, timeout=LONG)
    assert [job.id for job in queue.list(cell="one")] == [one.id]
    assert queue.list(cell="one", states=["failed"]) == []
    assert all(job.result is None and job.result_bytes for job in queue.list())


# --- cancelling ------------------------------------------------------------------------------------------------


def test_a_running_job_is_cancelled(queue: JobQueue, submit: Submit, workspace: Path) -> None:
    job = with_step(queue, submit(*SLOW))
    cancelled = queue.cancel(job.id)
    assert cancelled.state == "cancelled"
    assert (cancelled.problem, cancelled.result) == (None, None)
    assert list(workspace.glob("truepose-study/*")) == []
    assert queue.cancel(job.id) == cancelled


@pytest.mark.exhaustive
@posix
def test_a_job_that_ignores_the_interrupt_is_killed(
    queue: JobQueue, submit: Submit, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("truepose.jobs.process.CommandProcess.interrupt", lambda _: None)
    job = with_step(queue, submit(*SLOW))
    assert queue.cancel(job.id).state == "cancelled"
    assert queue.wait(submit(*QUICK).id, timeout=LONG).state == "done"


def test_a_queued_job_is_cancelled_at_once(queue: JobQueue, submit: Submit) -> None:
    first, second, third = submit(*SLOW), submit(*QUICK), submit(*QUICK)
    assert queue.cancel(second.id).state == "cancelled"
    queue.cancel(first.id)
    assert queue.wait(third.id, timeout=LONG).state == "done"
    assert queue.get(second.id).started is None


def test_a_job_may_be_cancelled_before_its_process_exists(queue: JobQueue, submit: Submit) -> None:
    for _ in range(5):
        assert queue.cancel(submit(*SLOW).id).state == "cancelled"


@pytest.mark.exhaustive
def test_jobs_may_be_cancelled_by_many_at_once(queue: JobQueue, submit: Submit) -> None:
    job = with_step(queue, submit(*SLOW))
    found: list[str] = []
    threads = [threading.Thread(target=lambda: found.append(queue.cancel(job.id).state)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LONG)
    assert found == ["cancelled"] * 8


@pytest.mark.exhaustive
def test_a_job_that_has_ended_runs_again_as_a_new_one(queue: JobQueue, submit: Submit) -> None:
    job = submit(*SLOW, title="Study", cell="c")
    with pytest.raises(RefusedError, match="cancel it first"):
        queue.run_again(job.id)
    queue.cancel(job.id)
    again = queue.run_again(job.id)
    assert again.id > job.id
    assert (again.command, again.folder, again.cell, again.title) == (job.command, job.folder, job.cell, job.title)
    with_step(queue, again)


# --- refusals and failures -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command", [[], [""], ["--version"], ["-h"], ["watch", "a", "b", "c"], ["app"], ["rm"], ["robots", "a\0b"]]
)
def test_what_cannot_be_a_job_is_refused(queue: JobQueue, workspace: Path, command: list[str]) -> None:
    with pytest.raises(DataError, match=r"cannot be run as a job|zero byte"):
        queue.submit(command, folder=workspace, cell="", title="")
    assert queue.list() == []


def test_folders_outside_of_the_workspace_are_refused(queue: JobQueue, workspace: Path, tmp_path: Path) -> None:
    (workspace / "link").symlink_to(tmp_path)
    for folder in (tmp_path, workspace / "..", workspace / "link"):
        with pytest.raises(DataError, match="not in the workspace"):
            queue.submit(QUICK, folder=folder, cell="", title="")
    with pytest.raises(FileError, match="no such folder"):
        queue.submit(QUICK, folder=workspace / "missing", cell="", title="")


def test_an_unknown_job_is_named(queue: JobQueue) -> None:
    for call in (queue.get, queue.cancel, queue.run_again, queue.revision, queue.result_file, queue.wait):
        with pytest.raises(UnknownJobError, match="'nonsense' is unknown"):
            call("nonsense")


@pytest.mark.exhaustive
def test_a_refusal_names_the_file_and_its_line(queue: JobQueue, submit: Submit, workspace: Path) -> None:
    (workspace / "cell.toml").write_text("# a cell\n[robot\n")
    job = queue.wait(submit("plan", "cell.toml", "--n", "5", "--out", "plan").id, timeout=LONG)
    assert job.state == "failed"
    assert job.problem is not None
    assert job.problem["type"] == "FileError"
    assert (job.problem["file"], job.problem["line"], job.problem["status"]) == ("cell.toml", 2, 422)


def test_wrong_usage_is_a_problem(queue: JobQueue, submit: Submit) -> None:
    job = queue.wait(submit("fit", "--no-such-option").id, timeout=LONG)
    assert job.state == "failed"
    assert job.problem is not None
    assert job.problem["type"] == "UsageError"
    assert "--no-such-option" in job.problem["detail"]


@posix
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
@pytest.mark.sampled(1)
def test_a_killed_process_fails_with_words(queue: JobQueue, submit: Submit, number: signal.Signals) -> None:
    job = with_step(queue, submit(*SLOW))
    process = queue._running[job.id].process
    assert process is not None
    os.kill(process._process.pid, number)
    job = queue.wait(job.id, timeout=LONG)
    assert job.state == "failed"
    assert job.problem is not None
    assert job.problem["type"] == "ProcessError"
    assert number.name in job.problem["detail"]
    assert queue.wait(submit(*QUICK).id, timeout=LONG).state == "done"


def test_a_process_that_cannot_start_fails_the_job_only(
    queue: JobQueue, submit: Submit, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    with monkeypatch.context() as patch:
        patch.setattr("truepose.jobs.process.subprocess.Popen", fail)
        job = queue.wait(submit(*QUICK).id, timeout=LONG)
    assert job.state == "failed"
    assert job.problem is not None
    assert "Cannot allocate memory" in job.problem["detail"]
    assert queue.wait(submit(*QUICK).id, timeout=LONG).state == "done"


def test_a_folder_that_has_gone_fails_the_job_only(queue: JobQueue, submit: Submit, workspace: Path) -> None:
    (workspace / "sub").mkdir()
    slow = submit(*SLOW)
    job = queue.submit(QUICK, folder=workspace / "sub", cell="", title="")
    (workspace / "sub").rmdir()
    queue.cancel(slow.id)
    job = queue.wait(job.id, timeout=LONG)
    assert job.problem is not None
    assert (job.state, job.problem["file"]) == ("failed", "sub")


# --- disks -----------------------------------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_a_large_result_stays_in_its_file(
    queue: JobQueue, submit: Submit, monkeypatch: pytest.MonkeyPatch, run: Any
) -> None:
    monkeypatch.setattr(job_folder, "LARGEST_RESULT", 100)
    job = queue.wait(submit(*QUICK).id, timeout=LONG)
    assert (job.state, job.result) == ("done", None)
    path = queue.result_file(job.id)
    assert path.stat().st_size == job.result_bytes
    assert json.loads(path.read_text("utf-8")) == run(*QUICK, "--json").json


def test_a_full_disk_fails_what_cannot_be_written_and_the_queue_lives(
    queue: JobQueue, submit: Submit, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> Any:
        raise OSError(errno.ENOSPC, "No space left on device")

    before = submit(*SLOW)
    waiting = submit(*QUICK)
    until(lambda: queue._running[before.id].process)
    with monkeypatch.context() as patch:
        patch.setattr(commits, "_new_journal", full)
        with pytest.raises(FileError, match="No space left"):
            submit(*QUICK)
        queue.cancel(before.id)
        job = queue.wait(waiting.id, timeout=LONG)
    assert queue.get(before.id).state == "cancelled"
    assert any("No space left" in told for told in queue.get(before.id).warnings)
    assert job.state == "failed"
    assert job.problem is not None
    assert "No space left" in job.problem["detail"]
    assert queue.wait(submit(*QUICK).id, timeout=LONG).state == "done"
    assert len(queue.list()) == 3
    assert not any("No space left" in told for told in queue.get(before.id).warnings)
    kept = {path.stem: json.loads(path.read_text()) for path in (queue._workspace / ".truepose/jobs").glob("*.json")}
    assert kept[before.id]["state"] == "cancelled"  # written later
    assert kept[waiting.id]["state"] == "failed"


@posix
@pytest.mark.exhaustive
def test_a_disk_that_gets_full_under_the_result_is_told(queue: JobQueue, submit: Submit) -> None:
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    job = submit(*SLOW)
    second = submit("robots")
    until(lambda: queue._running[job.id].process)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1200, before[1]))  # shorter than the list of robots
    try:
        queue.cancel(job.id)
        second = queue.wait(second.id, timeout=LONG)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert second.state == "failed"
    assert second.problem is not None
    assert "the output: cannot be read or written: File too large" in second.problem["detail"]
    assert queue.wait(submit(*QUICK).id, timeout=LONG).state == "done"


# --- other applications, earlier and at once -------------------------------------------------------------------


def test_jobs_are_read_again(workspace: Path) -> None:
    with JobQueue(workspace, ready=False) as queue:
        job = queue.wait(queue.submit(QUICK, folder=workspace, cell="c", title="T").id, timeout=LONG)
        assert job.state == "done"
    with JobQueue(workspace, ready=False) as later:
        assert later.get(job.id) == job
        new = later.submit(QUICK, folder=workspace, cell="c", title="T")
        assert new.number == job.number + 1


@pytest.mark.exhaustive
def test_stopping_interrupts_what_runs_and_what_waits(workspace: Path) -> None:
    with JobQueue(workspace, ready=False) as queue:
        running = queue.submit(SLOW, folder=workspace, cell="", title="")
        waiting = queue.submit(QUICK, folder=workspace, cell="", title="")
        with_step(queue, running)
        process = queue._running[running.id].process
    assert process is not None
    assert process._process.returncode is not None
    with pytest.raises(DataError, match="stopping"):
        queue.submit(QUICK, folder=workspace, cell="", title="")
    with JobQueue(workspace, ready=False) as later:
        for job in later.list():
            assert job.state == "interrupted"
            assert job.problem is not None
            assert "run it again" in job.problem["detail"]
        again = later.run_again(waiting.id)
        assert later.wait(again.id, timeout=LONG).state == "done"


@pytest.mark.exhaustive
@posix
def test_jobs_of_a_killed_application_are_interrupted_and_gone(workspace: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from truepose.jobs import JobQueue\n"
        "root = Path(sys.argv[1]); queue = JobQueue(root); queue.start()\n"
        "job = queue.submit(sys.argv[2:], folder=root, cell='', title='')\n"
        "queue.submit(['robots', 'kuka-kr150-2'], folder=root, cell='', title='')\n"
        "while queue.get(job.id).step is None: queue.wait(job.id, after=queue.revision(job.id))\n"
        "print(queue._running[job.id].process._process.pid, flush=True); import time; time.sleep(600)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(workspace), *SLOW], stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None
        child = int(server.stdout.readline())
        server.kill()
    until(lambda: _gone(child), 5)
    with JobQueue(workspace, ready=False) as queue:
        second, first = queue.list()
        assert (first.state, second.state) == ("interrupted", "interrupted")
        assert queue.wait(queue.run_again(second.id).id, timeout=LONG).state == "done"


def _gone(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    state = Path(f"/proc/{process}/stat")
    return state.exists() and state.read_text().rpartition(")")[2].split()[0] == "Z"  # nobody waits for it


def test_two_queues_in_one_workspace_are_refused(queue: JobQueue, workspace: Path) -> None:
    other = JobQueue(workspace, ready=False)
    with pytest.raises(FileError, match=rf"in use by another truepose app \(process {os.getpid()}\); .*stop it"):
        other.start()
    queue.stop()
    with other:
        pass


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"\xff\xfe",
        b"null",
        b"[]",
        b"{}",
        b'{"format": "truepose job 1"}',
        b'{"format": "truepose job 99", "id": "00000007-00000000"}',
        b"[" * 100_000,
    ],
)
@pytest.mark.sampled(1)
def test_torn_and_foreign_files_are_left_out(workspace: Path, content: bytes) -> None:
    with JobQueue(workspace, ready=False) as queue:
        job = queue.submit(QUICK, folder=workspace, cell="", title="")
        queue.wait(job.id, timeout=LONG)
    (workspace / ".truepose" / "jobs" / "00000007-00000000.json").write_bytes(content)
    later = JobQueue(workspace, ready=False)
    with pytest.warns(RecoveryWarning, match=r"00000007-00000000.json: left out, because"):
        later.start()
    with later:
        assert [one.id for one in later.list()] == [job.id]
        assert later.submit(QUICK, folder=workspace, cell="", title="").number == 8


@pytest.mark.parametrize(
    "change",
    [
        {"folder": "../other"},
        {"folder": "/etc"},
        {"command": ["rm", "-rf"]},
        {"command": "fit"},
        {"state": "flying"},
        {"id": "../../x"},
        {"revision": "many"},
    ],
)
@pytest.mark.sampled(1)
def test_a_job_with_strange_values_is_left_out(workspace: Path, change: dict[str, Any]) -> None:
    with JobQueue(workspace, ready=False) as queue:
        job = queue.submit(QUICK, folder=workspace, cell="", title="")
        queue.wait(job.id, timeout=LONG)
    path = workspace / ".truepose" / "jobs" / f"{job.id}.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    later = JobQueue(workspace, ready=False)
    with pytest.warns(RecoveryWarning, match="cannot read it as a job"):
        later.start()
    with later:
        assert later.list() == []


def test_a_job_survives_its_dictionary(queue: JobQueue, submit: Submit) -> None:
    job = queue.wait(submit(*QUICK).id, timeout=LONG)
    assert Job.from_dict(json.loads(json.dumps(job.to_dict()))) == job


@pytest.mark.exhaustive
def test_a_removed_folder_of_jobs_is_made_again(queue: JobQueue, submit: Submit, workspace: Path) -> None:
    import shutil

    job = queue.wait(submit(*QUICK).id, timeout=LONG)
    shutil.rmtree(workspace / ".truepose")
    assert "lost" in queue.get(job.id).warnings[-1]
    assert queue.wait(submit(*QUICK).id, timeout=LONG).state == "done"


def test_a_process_that_waits_ready_runs_the_next_job(workspace: Path) -> None:
    with JobQueue(workspace) as queue:
        spare = queue._processes._spare
        assert spare is not None
        job = queue.submit(SLOW, folder=workspace, cell="", title="")
        with_step(queue, job)
        assert queue._running[job.id].process is spare
        assert queue.cancel(job.id).state == "cancelled"
        until(lambda: queue._processes._spare is not None)
        spare = queue._processes._spare
        spare._process.kill()
        spare._process.wait()
        assert queue.wait(queue.submit(QUICK, folder=workspace, cell="", title="").id, timeout=LONG).state == "done"
        last = queue._processes._spare
    assert last is None or last._process.returncode is not None
