"""The form of an executor that runs tasks on a cluster of `dask.distributed`, which is imported with the connection."""

from __future__ import annotations

import hashlib
import logging
import pickle
import threading
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from truepose._extras import needed
from truepose._version import version
from truepose.errors import DataError
from truepose.jobs.executor.identity import differences, identity
from truepose.jobs.executor.results import FinishedResults
from truepose.numerics.executor import AHEAD, Function, Inputs, ReadInputs, Returned, Task, Waiting, work

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT_S: Final = 10
_POLL_S: Final = 0.2
_CLOSE_S: Final = 5.0
_CLOSE_INTERRUPTED_S: Final = 1.0


@dataclass(frozen=True)
class Security:
    """The files of an encrypted connection: certificate authority, own certificate and its key (PEM)."""

    ca: Path
    cert: Path
    key: Path


class Cluster:
    """The form that runs tasks on the workers of a cluster, each with one thread.

    A worker that is killed costs the time of its task. If the scheduler is lost, finished results are kept, and the
    next run of the same work starts from them; after a run they are removed.

    Parameters
    ----------
    address : str
        The scheduler, such as ``tcp://10.0.0.5:8786`` or ``tls://…``.
    security : Security, optional
        The files for ``tls://``; by default those of Dask's own configuration.
    folder : Path, optional
        A folder on a volume that all workers see at the same path: workers take inputs from it, and write results into
        it. Without it, both travel through the network.
    kept : Path, optional
        The folder of finished results of this machine, if there is no shared one.
    purpose : str
        What the tasks are for, in the message of an error.

    Raises
    ------
    DataError
        If the scheduler cannot be reached, has no worker, or has workers of another version or with several threads.
    """

    def __init__(
        self,
        address: str,
        *,
        security: Security | None = None,
        folder: Path | None = None,
        kept: Path | None = None,
        purpose: str = "tasks",
    ) -> None:
        self._address, self._folder, self._purpose = address, folder, purpose
        keep = kept if folder is None else folder
        self._results = None if keep is None else FinishedResults(keep)
        self._held: dict[str, Future[Any]] = {}
        self._used: list[str] = []
        self._pending: dict[Future[Any], tuple[int, Task, str]] = {}
        self._changed = threading.Event()
        self._client = _connect(address, security)
        try:
            self.workers = _check_workers(self._client, address)
        except BaseException:
            self._client.close(timeout=1)
            raise

    def share(self, encode: Callable[[], bytes], value: Any) -> str:
        """Put an input into the shared folder, or hand it to the scheduler, which sends it to workers."""
        data = encode()
        if self._folder is not None and self._results is not None:
            return self._results.blobs.put(data)
        key = hashlib.sha256(data).hexdigest()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that the input is large
            self._held[key] = self._client.submit(_hold, data, key=f"truepose-input-{key}")
        return key

    def run(self, function: Function, tasks: Iterable[Task | None], *, ahead: int = AHEAD) -> Iterator[tuple[int, Any]]:
        """Run tasks; yield results that an interrupted run of the same tasks has left first.

        Raises
        ------
        DataError
            If the scheduler is lost, or a task ends several workers.
        """
        if self._pending:  # of a run that was not read to its end
            self._client.cancel(list(self._pending))
            self._pending.clear()
        waiting = Waiting(tasks)
        finished = 0
        while True:
            while len(self._pending) < ahead * self.workers and (following := waiting.next()):
                index, task = following
                key = self._key(function, task)
                if (before := self._known(key)) is not None:
                    finished += 1
                    yield index, before.delivered()
                else:
                    self._pending[self._submit(function, task, key)] = index, task, key
            if not self._pending:
                return
            for future in self._wait(finished):
                index, task, key = self._pending.pop(future)
                returned = self._result(future, function, key, finished)
                finished += 1
                yield index, returned.delivered()

    def _key(self, function: Function, task: Task) -> str:
        if not task.key or self._results is None:
            return ""
        key = FinishedResults.key(function.__qualname__, *task.inputs, task.key, *identity().values())
        self._used.append(key)
        return key

    def _known(self, key: str) -> Returned | None:
        data = self._results.get(key) if key and self._results is not None else None
        return None if data is None else _returned(data)

    def _submit(self, function: Function, task: Task, key: str) -> Future[Any]:
        # bytes of inputs are results of tasks: if the worker that has them is lost, they are sent again
        held = {one: self._held[one] for one in task.inputs if one in self._held}
        name = f"truepose-{uuid.uuid4().hex}"
        folder = None if self._folder is None else str(self._folder)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that the task is large
            future = self._client.submit(_run, function, task, held, folder, key, identity(), key=name, pure=False)
        future.add_done_callback(lambda _: self._changed.set())
        return future

    def _wait(self, finished: int) -> list[Future[Any]]:
        """Return futures that are done; wait for at least one."""
        while True:
            if done := [future for future in self._pending if future.status != "pending"]:
                return done
            if self._client.status != "running":
                raise self._lost(finished)
            self._changed.wait(_POLL_S)
            self._changed.clear()

    def _result(self, future: Future[Any], function: Function, key: str, finished: int) -> Returned:
        from concurrent.futures import CancelledError

        with needed("a cluster", "scale"):
            from distributed.client import FutureCancelledError
            from distributed.scheduler import KilledWorker

        try:
            found: bytes | str = future.result()
        except (CancelledError, FutureCancelledError, OSError, TimeoutError) as error:
            if isinstance(error, OSError) and self._client.status == "running" and future.status == "error":
                raise DataError(f"{self._purpose}: a worker of {self._address} failed: {error}") from None
            raise self._lost(finished) from None
        except KilledWorker as error:
            raise DataError(
                f"{self._purpose}: a task ended {error.allowed_failures + 1} workers of {self._address}, perhaps out "
                "of memory; give the workers more memory (dask worker --memory-limit)"
            ) from None
        if isinstance(found, str):  # a worker has written the result into the shared folder
            assert self._results is not None
            found = self._results.blobs.read(found)
        elif key and self._results is not None:
            self._results.put(key, found)
        return _returned(found)

    def _lost(self, finished: int) -> DataError:
        place = "" if self._results is None else f" and kept in {self._results.root}"
        return DataError(
            f"{self._purpose}: the scheduler {self._address} was lost; {finished} results were finished{place}; "
            "start it again and run the same command again"
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        # an interrupted command does not wait long: the scheduler also forgets the tasks of a client that is gone
        close = threading.Thread(target=self._close, args=(list(self._pending),), name="truepose-cluster", daemon=True)
        self._pending.clear()
        self._held.clear()
        close.start()
        close.join(_CLOSE_S if kind is None else _CLOSE_INTERRUPTED_S)
        if kind is None and self._results is not None:
            for key in self._used:
                self._results.discard(key)

    def _close(self, unfinished: list[Future[Any]]) -> None:
        """Cancel tasks that have not run, and end the connection."""
        with suppress(Exception):
            self._client.cancel(unfinished)
        with suppress(Exception):
            self._client.close(timeout=1)


def _connect(address: str, security: Security | None) -> Client:
    with needed("a cluster", "scale"):
        from distributed import Client
        from distributed import Security as DaskSecurity
    for name in ("distributed.client", "distributed.core", "distributed.comm"):  # what they log is raised here
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    secret = None
    if security is not None:
        if not address.startswith("tls://"):
            raise DataError(
                f"--cluster {address} is not encrypted: certificates need an address such as tls://HOST:8786"
            )
        secret = DaskSecurity(
            tls_ca_file=str(security.ca),
            tls_client_cert=str(security.cert),
            tls_client_key=str(security.key),
            require_encryption=True,
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # other versions are found below, with a remedy
            return Client(address, security=secret, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError, ImportError) as error:
        raise DataError(
            f"no scheduler answers at {address} ({error}); start one with: dask scheduler --no-dashboard"
        ) from None


def _check_workers(client: Client, address: str) -> int:
    """Return the number of workers; refuse those whose results could differ."""
    threads: dict[str, int] = client.nthreads()
    if not threads:
        raise DataError(f"{address} has no worker; start some with: dask worker {address} --nworkers 2 --nthreads 1")
    if several := [worker for worker, count in threads.items() if count != 1]:
        raise DataError(
            f"worker {several[0]} of {address} has {threads[several[0]]} threads, and results need one each; start "
            f"workers with: dask worker {address} --nworkers N --nthreads 1"
        )
    found: dict[str, Any] = client.run(identity, on_error="return")
    for worker, other in found.items():
        if isinstance(other, BaseException):
            raise DataError(
                f"worker {worker} of {address} cannot run truepose ({other}); install truepose[scale] {version()} there"
            )
        if differing := differences(identity(), other):
            raise DataError(_unlike(worker, differing))
    return len(threads)


def _unlike(worker: str, differing: str) -> str:
    return (
        f"worker {worker} would give other results: {differing}; install the same versions there, and for other "
        "kernels of linear algebra set OPENBLAS_CORETYPE alike on all machines"
    )


def _returned(data: bytes) -> Returned:
    found: Returned = pickle.loads(data)  # from workers of a cluster that this user trusts
    return found


def _hold(data: bytes) -> bytes:
    return data


def _run(
    function: Function,
    task: Task,
    held: dict[str, bytes],
    folder: str | None,
    key: str,
    asked_by: dict[str, str],
) -> bytes | str:
    """Run a task on a worker; return its result, or the hash under which it is in the shared folder."""
    if differing := differences(asked_by, identity()):  # a worker that came after the check
        raise DataError(_unlike("that joined later", differing))
    results = None if folder is None else FinishedResults(folder)
    read = held.__getitem__ if results is None else results.blobs.read
    inputs: Inputs = ReadInputs(read)
    data = pickle.dumps(work(function, inputs, task))
    if results is None:
        return data
    return results.put(key, data) if key else results.blobs.put(data)
