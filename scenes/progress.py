"""How far a run has come: a bar on a terminal, one line elsewhere, nothing when quiet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn


@contextmanager
def progress(title: str, total: int, *, quiet: bool, what: str = "step") -> Iterator[Callable[[int], None]]:
    """Give a function to call with the number of finished steps, or whatever; all goes to standard error."""
    console = Console(stderr=True, quiet=quiet)
    if quiet or not console.is_terminal:
        console.print(f"{title}: {counted(total, what)}", highlight=False, soft_wrap=True)
        yield lambda done: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


def counted(number: int, what: str) -> str:
    """Return `1 step`, `2 steps`."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def busy(what: str, *, quiet: bool) -> AbstractContextManager[object]:
    """Say on a terminal what takes a while; nothing elsewhere."""
    return Console(stderr=True, quiet=quiet).status(what)
