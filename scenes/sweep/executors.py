"""Who runs the cases of a sweep: this process, processes of its own, or the workers of a Dask scheduler."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from scenes.language.errors import SceneError
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


def chosen(workers: int | None = None, scheduler: str | None = None, bind: str = LOOPBACK) -> Executor:
    """Return the executor that a user asks for; this process if nothing is asked for.

    Parameters
    ----------
    workers : int, optional
        Processes to start on this machine, which Dask looks after.
    scheduler : str, optional
        Address of a Dask scheduler that is running, such as tcp://127.0.0.1:8786.
    bind : str
        Address that the scheduler started for `workers` listens on. Beyond 127.0.0.1 others can reach it.

    Raises
    ------
    SceneError
        Both are given, or one makes no sense.
    """
    if workers is not None and scheduler is not None:
        raise SceneError(
            "--workers starts processes, --scheduler uses those of a running scheduler: give one of the two"
        )
    if workers is None and bind != LOOPBACK:
        raise SceneError("--bind is the address of the scheduler that --workers starts: give --workers too")
    if workers is None and scheduler is None:
        return InProcess()
    from scenes.sweep import cluster  # imports Dask, which takes as long as a short run

    return cluster.Remote(scheduler) if scheduler is not None else cluster.Local(workers or 0, bind)
