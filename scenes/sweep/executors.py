"""Executors of the cases of a sweep: this process, new processes, or the workers of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from scenes.sweep.job import INTERRUPTED_STATUS, Ended, Job

Stopped = Callable[[], bool]

LOOPBACK = "127.0.0.1"
"""Address that is reachable only from the same machine."""


class Perform(Protocol):
    """Function that runs a job without a file, and may end the job early when stopped (`scenes.sweep.job.perform`)."""

    def __call__(self, job: Job, stopped: Stopped = ...) -> Ended:
        """Return how the job ended."""
        ...


class Executor(Protocol):
    """Executor of jobs, in any order and place."""

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        """Yield how each job ended, as soon as the job ends; no new jobs start after `stopped` returns True.

        `perform` is a function in a module, so that all workers can import the function. Jobs that are running at a
        stop may finish without being yielded; the files of the jobs show this.

        Raises
        ------
        SceneError
            The executor cannot continue, or `perform` raised the error, for example because a disc is full.
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
