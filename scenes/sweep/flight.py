"""Cases under way on the workers of a Dask scheduler, and what becomes of those whose worker dies.

A worker that dies takes with it the case that it ran, and those that waited for it. Which of them killed it, if any
did, comes out in further tries: the lost cases wait until the others have ended; then there is one at a time on a
worker, and in the last try one at a time on all of them. A case that has lost its worker in every try is reported as
failed.

A worker reports the end of a case by an event of the scheduler, which costs two thirds of a fetched result.
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
from scenes.sweep.case_file import FAILED
from scenes.sweep.executors import Perform, Stopped
from scenes.sweep.job import Ended, Job, too_late
from scenes.sweep.limit import ended_when_stuck

COMPANY = (2, 1, 0)
"""Cases under way for each worker, in the first try and in the further ones; 0 is one on all workers together."""
POLL = 0.2
"""Longest time until it is seen that the user stops the sweep [s]."""
TASK = 0.5
"""Time that a task takes, about: short cases go to a worker together, as each task costs what a short case does [s]."""
LOOK = 1.0
"""Time between two looks at who works [s]."""
NOTICE = 10.0
"""Time without a worker after which the user is told [s]."""
PATIENCE = 600.0
"""Time without a worker after which the sweep ends [s]."""
DEATH = f"its worker died in each of {len(COMPANY)} tries: killed, out of memory, or a crash of compiled code"
KEPT = "finished cases are kept, the same command runs the rest"

Batch = tuple[Job, ...]
"""Jobs of one task."""

_alone = threading.Lock()


class SchedulerError(SceneError):
    """The scheduler has ended, or nobody works for it."""

    exit_code = 1


class _Report(NamedTuple):
    """What a worker says of a task."""

    first: str
    """Key of its first job."""
    seconds: float
    """Time that it took [s]."""
    ended: Sequence[tuple[str, ...]]
    """How each of its jobs ended, as fields of `Ended`."""


class Flight:
    """Runs jobs on the workers of a client; the hint says how a worker is started, where that is for the user."""

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
        """Yield how each job ended, as they end.

        Raises
        ------
        SchedulerError
            The scheduler has ended, or there is no worker for `PATIENCE`.
        SceneError
            As a worker raised it.
        """
        rest = jobs
        for number, company in enumerate(COMPANY):
            self._lost = []
            yield from self._try(number, rest, company)
            rest = self._lost
        if not self._stopped():
            yield from (Ended(job.key, FAILED, DEATH) for job in rest)

    def wait_for_workers(self) -> bool:
        """Wait for a first worker; return False if the user stops the sweep before one comes."""
        while not self._stopped():
            self._look()
            if self._workers:
                return True
            time.sleep(POLL)
        return False

    def _try(self, number: int, jobs: Sequence[Job], company: int) -> Iterator[Ended]:
        waiting, left = iter(jobs), len(jobs)  # all at once may be more than there is memory for
        while (left or self._under_way) and not self._stopped():
            self._look()
            places = max(1, company * self._workers)
            while left and len(self._under_way) < places:
                size = 1 if number else max(1, min(self._size, left // (2 * places)))  # at the end all have work
                batch = tuple(islice(waiting, size))
                self._send(batch, number)
                left -= len(batch)
            yield from self._arrived()
        if self._under_way:
            self._client.cancel(list(self._under_way.values()))

    def _send(self, batch: Batch, number: int) -> None:
        """Have jobs run; one that a driver sent which was killed is waited for, not run a second time."""
        key = ("case", number, *(job.path for job in batch))
        future = self._client.submit(_perform, self._perform, batch, self._topic, key=key)
        self._under_way[batch[0].key] = future
        future.add_done_callback(lambda future: self._news.put((batch, future)))

    def _arrived(self) -> Iterator[Ended]:
        """Yield the cases that have ended; wait for some, if need be, no longer than `POLL`."""
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
        """Return how jobs ended of which the scheduler says so; None if it was told, or they are tried again."""
        if batch[0].key not in self._under_way:
            return None
        if future.status == "finished":
            return _Report(*future.result(timeout=PATIENCE))
        if future.status != "error":
            raise SchedulerError(f"the scheduler has ended: {KEPT}")
        error = future.exception()
        if isinstance(error, SceneError):
            raise error
        if isinstance(error, KilledWorker) or len(batch) > 1:  # one of them is to blame
            del self._under_way[batch[0].key]
            self._lost.extend(batch)
            return None
        return _Report(batch[0].key, TASK, [(batch[0].key, FAILED, f"{type(error).__name__}: {error}")])

    def _look(self) -> None:
        """Count the workers, now and then."""
        now = time.monotonic()
        if now < self._looked + LOOK:
            return
        self._looked = now
        if self._client.status != "running":
            raise SchedulerError(f"the scheduler has ended: {KEPT}")
        with suppress(OSError, TimeoutError):
            self._workers = len(self._client.nthreads())
        if self._workers:
            self._deserted = now
        elif now > self._deserted + PATIENCE:
            raise SchedulerError(f"no worker for {PATIENCE / 60.0:.0f} minutes: {KEPT}")
        elif now > self._deserted + NOTICE and not self._told:
            self._told = True
            typer.echo(f"waiting for a worker: {self._hint}", err=True)


def _perform(perform: Perform, batch: Batch, topic: str) -> _Report:
    """Run jobs on a worker and tell the driver; one at a time in a process."""
    with _alone:
        begun = time.monotonic()
        ended = [astuple(_performed(perform, job)) for job in batch]
        report = _Report(batch[0].key, time.monotonic() - begun, ended)
    get_worker().log_event(topic, tuple(report))
    return report


def _performed(perform: Perform, job: Job) -> Ended:
    """Run a job, or end this process if it never ends; a job that ended one in another try is not tried again."""
    with ended_when_stuck(Path(job.path), job.limit_s) as was_stuck:
        return too_late(job) if was_stuck else perform(job)
