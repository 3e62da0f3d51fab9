"""From the options of a command to an executor."""

from __future__ import annotations

from pathlib import Path

from truepose.errors import DataError
from truepose.jobs.executor.cluster import Cluster, Security
from truepose.numerics.executor import Executor
from truepose.numerics.processes import local
from truepose.numerics.threads import cores
from truepose.programs.history import stores


def make_executor(
    purpose: str,
    *,
    workers: int = 0,
    cluster: str = "",
    security: Security | None = None,
    folder: Path | None = None,
    pays: bool = True,
) -> Executor:
    """Return the executor that a command uses.

    Parameters
    ----------
    purpose : str
        What the tasks are for, in messages.
    workers : int
        The number of processes of this machine; 0: one for each processor if they pay.
    cluster : str
        The address of a scheduler; empty for this machine.
    security, folder
        The files for ``tls://``, and the folder that all workers see; see `Cluster`.
    pays : bool
        Whether the work takes longer than the start of processes.

    Raises
    ------
    DataError
        If workers are given for a cluster, or the cluster cannot be used.
    """
    if not cluster:
        if security is not None or folder is not None:
            raise DataError("--cluster-ca, --cluster-cert, --cluster-key and --cluster-folder need --cluster ADDRESS")
        return local(workers or (cores() if pays else 1), purpose)
    if workers:
        raise DataError("--workers counts processes of this machine and --cluster has its own; give only one of them")
    own = next(iter(stores(None)), None)
    kept = None if own is None else own.parent / "unfinished"
    return Cluster(cluster, security=security, folder=folder, kept=kept, purpose=purpose)
