"""How far a run has come: a bar on a terminal, one line elsewhere, nothing when quiet."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

import typer


@contextmanager
def progress(title: str, total: int, *, quiet: bool, what: str = "step") -> Iterator[Callable[[int], None]]:
    """Give a function to call with the number of finished steps, or whatever; all goes to standard error."""
    if quiet or not _bars():
        if not quiet:
            typer.echo(f"{title}: {counted(total, what)}", err=True)
        yield lambda done: None
        return
    from rich.console import Console  # takes as long as a short run
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


def counted(number: int, what: str) -> str:
    """Return `1 step`, `2 steps`."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def busy(what: str, *, quiet: bool) -> AbstractContextManager[object]:
    """Say on a terminal what takes a while; nothing elsewhere."""
    if quiet or not _bars():
        return nullcontext()
    from rich.console import Console

    return Console(stderr=True).status(what)


def _bars() -> bool:
    """Return whether bars can be drawn on standard error."""
    return sys.stderr.isatty()
