"""Long work on many processors: the choice of an executor, and the form that runs tasks on a cluster.

The contract is `truepose.numerics.executor.Executor`; the forms on one machine lie beside it, because computations in
Python use them without jobs.
"""

from truepose.jobs.executor.cluster import Cluster, Security
from truepose.jobs.executor.options import make_executor
from truepose.jobs.executor.results import FinishedResults

__all__ = ["Cluster", "FinishedResults", "Security", "make_executor"]
