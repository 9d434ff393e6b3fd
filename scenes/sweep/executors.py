"""Who runs the cases of a sweep: this process, processes of its own, or the workers of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from scenes.sweep.job import INTERRUPTED, Ended, Job

Stopped = Callable[[], bool]

LOOPBACK = "127.0.0.1"
"""Address that only programs of the same machine reach."""


class Perform(Protocol):
    """Runs a job, unless its file is there, and may end it early where it is stopped (`scenes.sweep.job.perform`)."""

    def __call__(self, job: Job, stopped: Stopped = ...) -> Ended:
        """Return how it ended."""
        ...


class Executor(Protocol):
    """Runs jobs, in whatever order and place."""

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        """Yield how each job ended, as they end; where `stopped` returns True, no more are begun, and it returns.

        `perform` is a function of a module, which all workers can import. Jobs that were under way when it was stopped
        may have been run and not be yielded: their files tell.

        Raises
        ------
        SceneError
            The executor cannot go on, or `perform` raised one, as where a disc is full.
        """
        ...


class InProcess:
    """Runs jobs one after the other in this process."""

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        """Yield how each job ended; see `Executor.run`."""
        for job in jobs:
            if stopped():
                return
            if (ended := perform(job, stopped)).status != INTERRUPTED:
                yield ended
