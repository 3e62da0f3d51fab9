"""Long work as jobs: commands of truepose that run in processes of their own, with progress, cancel and history.

A job is a command line, so its results, refusals and files are those of the command line by construction.
"""

from truepose.jobs.job import Job, State, UnknownJobError
from truepose.jobs.queue import JobQueue

__all__ = ["Job", "JobQueue", "State", "UnknownJobError"]
