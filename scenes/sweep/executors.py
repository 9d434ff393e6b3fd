"""Interface of the executors, which run the cases of a sweep, and the executor that runs them in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from scenes.sweep.job import INTERRUPTED_STATUS, Ended, Job

Stopped = Callable[[], bool]

LOOPBACK = "127.0.0.1"
"""Network address that only programs on the same machine can reach."""


class Perform(Protocol):
    """Type of `scenes.sweep.job.perform`, which runs a job and writes its file.

    If `stopped` returns True during the job, the job ends early, without a file.
    """

    def __call__(self, job: Job, stopped: Stopped = ...) -> Ended:
        """Return how the job ended."""
        ...


class Executor(Protocol):
    """Runs jobs, in any order and in any process."""

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        """Run the jobs, and yield how each job ended as soon as it ends.

        After `stopped` has returned True, no further job is started. Jobs that are running then may finish and write
        their files without being yielded. `perform` must be a function of a module, so that workers can import it.

        Raises
        ------
        SceneError
            If the executor cannot continue, or `perform` raises a SceneError, for example because the disc is full.
        """
        ...


class InProcess:
    """Executor that runs jobs one after the other in this process."""

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        """Yield how each job ended; see `Executor.run`."""
        for job in jobs:
            if stopped():
                return
            if (ended := perform(job, stopped)).status != INTERRUPTED_STATUS:
                yield ended
