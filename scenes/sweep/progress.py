"""Display of the progress of a sweep on standard error: a bar on a terminal, otherwise a line every 30 s."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer

from scenes.running.terminal import counted
from scenes.sweep.engine import Progress

Watch = Callable[[Progress], None]

BETWEEN_LINES_S = 30.0
"""Shortest time between two lines if standard error is not a terminal [s]."""


@contextmanager
def shown(title: str, *, quiet: bool, workers: int = 0) -> Iterator[Watch]:
    """Yield a function that displays the progress. It is to be called at the beginning and after each case.

    `workers` is the number of processes that start before the first case, which takes some seconds.
    """
    if quiet:
        yield lambda progress: None
    elif sys.stderr.isatty():
        yield from _bar(title, workers)
    else:
        yield _lines(title, workers)


def summed_up(progress: Progress, seconds: float, workers: int = 0) -> str:
    """Return the progress of a sweep as text, such as `57 of 200 cases, 3 failed, 1.9 cases/s, 75 s left`.

    `seconds` is the time since the first case was started [s]. `workers` is explained in `shown`.
    """
    done = progress.ended
    parts = [f"{done} of {counted(progress.total, 'case')}"]
    if progress.kept:
        parts.append(f"{progress.kept} kept from before")
    if progress.failed:
        why = f" ({progress.refused} refused, not run)" if progress.refused else ""
        parts.append(f"{progress.failed} failed{why}")
    if workers and not progress.ran and done < progress.total:
        parts.append(f"{counted(min(workers, progress.total - done), 'worker')} starting")
    if progress.ran and seconds > 0.0:
        rate = progress.ran / seconds
        parts.append(f"{rate:.2g} cases/s" if rate < 10 else f"{rate:.0f} cases/s")
        if left := progress.total - done:
            parts.append(f"{_duration(left / rate)} left")
    return ", ".join(parts)


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _lines(title: str, workers: int) -> Watch:
    """Return a function that prints the progress as a line, if the last line is at least `BETWEEN_LINES_S` old."""
    begun, told = time.monotonic(), 0.0

    def show(progress: Progress) -> None:
        nonlocal begun, told
        now = time.monotonic()
        begun = begun if progress.ran else now
        if progress.ran == 0 or now >= told + BETWEEN_LINES_S:
            told = now
            typer.echo(f"{title}: {summed_up(progress, now - begun, workers)}", err=True)

    return show


def _bar(title: str, workers: int) -> Iterator[Watch]:
    from rich.console import Console  # this import takes as much time as a short run
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bars

    begun = time.monotonic()
    with Bars(TextColumn(title), BarColumn(), TextColumn("{task.description}"), console=Console(stderr=True)) as bars:
        task = bars.add_task("", total=None)

        def show(progress: Progress) -> None:
            text = summed_up(progress, time.monotonic() - begun, workers)
            bars.update(task, total=progress.total, completed=progress.ended, description=text)

        yield show
