"""Running cases on the workers of a Dask scheduler, with retries if a worker dies.

If a worker dies, the case that the worker was running and the cases in the queue of this worker are lost. One of these
cases may have killed the worker. The lost cases are tried again after all other cases, with a single case at a time on
each worker, and a last time with a single case at a time on all workers together. A case whose worker has died in every
try fails.

A worker reports the outcome of its cases by an event of the scheduler. Fetching the result of a task instead would take
1.5 times as long.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import astuple
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import NamedTuple

import typer
from distributed import Client, Future, KilledWorker, get_worker

from scenes.language.errors import SceneError
from scenes.sweep.case_file import FAILED_STATUS
from scenes.sweep.executors import Perform, Stopped
from scenes.sweep.job import Ended, Job, too_late
from scenes.sweep.limit import ended_when_stuck

COMPANY = (2, 1, 0)
"""Number of tasks that are submitted for each worker at a time, in the first, second and third try. 0 means a single
task for all workers together."""
POLL = 0.2
"""Longest time until the program notices that the user stopped the sweep [s]."""
TASK = 0.5
"""Intended duration of a task [s]. Several short cases are submitted as one task, since the overhead of a task takes as
long as a short case."""
LOOK = 1.0
"""Time between two counts of the workers [s]."""
NOTICE = 10.0
"""Time without a worker until the user gets a message [s]."""
WORKER_TIMEOUT_S = 600.0
"""Time without a worker until the sweep ends [s]."""
DEATH = f"its worker died in each of {len(COMPANY)} tries: killed, out of memory, or a crash of compiled code"
RESUME_ADVICE = "finished cases are kept, the same command runs the rest"

Batch = tuple[Job, ...]
"""Jobs that are submitted as one task."""

_alone = threading.Lock()


class SchedulerError(SceneError):
    """The scheduler has ended, or has had no worker for too long."""

    exit_code = 1


class _Report(NamedTuple):
    """Report of a worker about a task."""

    first: str
    """Key of the first job."""
    seconds: float
    """Duration of the task [s]."""
    ended: Sequence[tuple[str, ...]]
    """How each job ended, as fields of `Ended`."""


class Flight:
    """Runs jobs on the workers of a scheduler.

    Parameters
    ----------
    client : Client
        Connection to the scheduler.
    perform, stopped
        The same as in `Executor.run`.
    hint : str
        Advice on how to start a worker, which is printed if there is none.
    """

    def __init__(self, client: Client, perform: Perform, stopped: Stopped, hint: str = "") -> None:
        self._client, self._perform, self._stopped, self._hint = client, perform, stopped, hint
        self._topic = f"worm3d-{secrets.token_hex(8)}"
        self._news: SimpleQueue[_Report | tuple[Batch, Future]] = SimpleQueue()
        self._under_way: dict[str, Future] = {}
        self._lost: list[Job] = []
        self._size = 1
        self._workers, self._told = 0, not hint
        self._looked, self._deserted = -LOOK, time.monotonic()
        client.subscribe_topic(self._topic, lambda event: self._news.put(_Report(*event[1])))

    def run(self, jobs: Sequence[Job]) -> Iterator[Ended]:
        """Run the jobs, and yield how each job ended as soon as it ends.

        Raises
        ------
        SchedulerError
            If the scheduler has ended, or there has been no worker for `WORKER_TIMEOUT_S`.
        SceneError
            If a job raises a SceneError on a worker.
        """
        rest = jobs
        for number, company in enumerate(COMPANY):
            self._lost = []
            yield from self._try(number, rest, company)
            rest = self._lost
        if not self._stopped():
            yield from (Ended(job.key, FAILED_STATUS, DEATH) for job in rest)

    def wait_for_workers(self) -> bool:
        """Wait for the first worker. Return False if the user stops the sweep before there is a worker."""
        while not self._stopped():
            self._look()
            if self._workers:
                return True
            time.sleep(POLL)
        return False

    def _try(self, number: int, jobs: Sequence[Job], company: int) -> Iterator[Ended]:
        waiting, left = iter(jobs), len(jobs)  # jobs are submitted bit by bit, since memory may be too small for all
        while (left or self._under_way) and not self._stopped():
            self._look()
            places = max(1, company * self._workers)
            while left and len(self._under_way) < places:
                size = 1 if number else max(1, min(self._size, left // (2 * places)))  # small batches at the end
                batch = tuple(islice(waiting, size))
                self._send(batch, number)
                left -= len(batch)
            yield from self._arrived()
        if self._under_way:
            self._client.cancel(list(self._under_way.values()))

    def _send(self, batch: Batch, number: int) -> None:
        """Submit jobs as a task.

        The driver is the process that distributes the cases. If an earlier driver was killed after it had submitted the
        same task, the scheduler does not run the task a second time.
        """
        key = ("case", number, *(job.path for job in batch))
        future = self._client.submit(_perform, self._perform, batch, self._topic, key=key)
        self._under_way[batch[0].key] = future
        future.add_done_callback(lambda future: self._news.put((batch, future)))

    def _arrived(self) -> Iterator[Ended]:
        """Yield the cases that have ended. If there are none, wait for at most `POLL`."""
        with suppress(Empty):
            news = self._news.get(timeout=POLL)
            while True:
                report = news if isinstance(news, _Report) else self._verdict(*news)
                if report is not None and self._under_way.pop(report.first, None) is not None:
                    number = len(report.ended)
                    self._size = max(1, min(2 * number, int(TASK * number / max(report.seconds, 1e-6))))
                    yield from (Ended(*each) for each in report.ended)
                news = self._news.get_nowait()

    def _verdict(self, batch: Batch, future: Future) -> _Report | None:
        """Return the report about the jobs of a finished task.

        Return None if the worker has reported before, or if the jobs are to be tried again.
        """
        if batch[0].key not in self._under_way:
            return None
        if future.status == "finished":
            return _Report(*future.result(timeout=WORKER_TIMEOUT_S))
        if future.status != "error":
            raise SchedulerError(f"the scheduler has ended: {RESUME_ADVICE}")
        error = future.exception()
        if isinstance(error, SceneError):
            raise error
        if isinstance(error, KilledWorker) or len(batch) > 1:  # the next try shows which job is the cause
            del self._under_way[batch[0].key]
            self._lost.extend(batch)
            return None
        return _Report(batch[0].key, TASK, [(batch[0].key, FAILED_STATUS, f"{type(error).__name__}: {error}")])

    def _look(self) -> None:
        """Count the workers, if the last count is older than `LOOK`.

        Raises
        ------
        SchedulerError
            If the scheduler has ended, or there has been no worker for `WORKER_TIMEOUT_S`.
        """
        now = time.monotonic()
        if now < self._looked + LOOK:
            return
        self._looked = now
        if self._client.status != "running":
            raise SchedulerError(f"the scheduler has ended: {RESUME_ADVICE}")
        with suppress(OSError, TimeoutError):
            self._workers = len(self._client.nthreads())
        if self._workers:
            self._deserted = now
        elif now > self._deserted + WORKER_TIMEOUT_S:
            raise SchedulerError(f"no worker for {WORKER_TIMEOUT_S / 60.0:.0f} minutes: {RESUME_ADVICE}")
        elif now > self._deserted + NOTICE and not self._told:
            self._told = True
            typer.echo(f"waiting for a worker: {self._hint}", err=True)


def _perform(perform: Perform, batch: Batch, topic: str) -> _Report:
    """Run jobs on a worker, one after the other, and report to the driver."""
    with _alone:
        begun = time.monotonic()
        ended = [astuple(_performed(perform, job)) for job in batch]
        report = _Report(batch[0].key, time.monotonic() - begun, ended)
    get_worker().log_event(topic, tuple(report))
    return report


def _performed(perform: Perform, job: Job) -> Ended:
    """Run a job, and end this process if the job never ends.

    If the process of an earlier try was ended for this reason, the job is not run again.
    """
    with ended_when_stuck(Path(job.path), job.limit_s) as was_stuck:
        return too_late(job) if was_stuck else perform(job)
