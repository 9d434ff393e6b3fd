"""A run on a terminal: the display of the progress, Ctrl-C, and the report at the end."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Protocol, TypeVar

import typer

from scenes.models.base import Model
from scenes.records.folder import VIEWER
from scenes.records.record import Cell, Record

K = TypeVar("K")
R = TypeVar("R")

SIGNALS = (signal.SIGINT, signal.SIGTERM)

HEADLINES = (
    ("distance_m", "distance", "m"),
    ("mean_speed_m_s", "mean speed", "m/s"),
    ("work_contract_J", "net work", "J"),
    ("work_friction_J", "loss by friction", "J"),
    ("cost_of_transport", "cost of transport", ""),
    ("energy_balance_error", "energy balance error", ""),
)

USES = ("friction", "hysteresis", "damping", "impact", "numerical", "gained")
"""What the work of the actuators is used for. The summary has an entry for each, such as `work_friction_J`."""

NOT_IN_ALL = "hysteresis"
"""Entry of `USES` that is printed only if it is not zero. Some models do not have it."""

DOUBTS = {
    "unconverged_steps": "Newton's iteration left {} above its tolerance: try a smaller run.dt_s",
    "inverted_steps": "a segment is inside out after {}: these are shapes that no worm has",
}
"""Warnings for numbers of steps in the summary that should be 0, by the name of the entry."""


class Show(Protocol):
    """Function that is to be called with the number of finished items, and possibly a new title of the display."""

    def __call__(self, done: int, title: str = ...) -> None:
        """Update the display."""


@contextmanager
def progress(title: str, total: int, *, quiet: bool, what: str = "step") -> Iterator[Show]:
    """Yield a function of the number of finished items, and display the progress.

    The display is written to standard error. `total` is the number of items, and `what` the word for an item.
    """
    if quiet or not sys.stderr.isatty():
        if not quiet:
            typer.echo(f"{title}: {counted(total, what)}", err=True)
        yield lambda done, title=title: None
        return
    from rich.console import Console  # this import takes as much time as a short run
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done, title=title: bar.update(task, completed=done, description=title)


def each(title: str, keys: Iterable[K], go: Callable[[K], R], what: str, *, quiet: bool) -> dict[K, R]:
    """Return the results of the function `go` for each key, by key. The progress is displayed.

    `what` is the word for a key in the display.
    """
    wanted, found = list(keys), {}
    with progress(title, len(wanted), quiet=quiet, what=what) as show:
        for done, key in enumerate(wanted, start=1):
            found[key] = go(key)
            show(done)
    return found


def counted(number: int, what: str) -> str:
    """Return a number with a noun in the singular or plural, such as `1 step` or `2 steps`."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def busy(what: str, *, quiet: bool) -> AbstractContextManager[object]:
    """Return a context that shows the running task `what` on a terminal."""
    if quiet or not sys.stderr.isatty():
        return nullcontext()
    from rich.console import Console

    return Console(stderr=True).status(what)


class Interruption:
    """Context where the first SIGINT or SIGTERM sets `requested` only. A second signal has its usual effect."""

    def __init__(self) -> None:
        self.requested = False
        """Whether the user wants to stop the run."""
        self.cause = "Ctrl-C"
        """Cause of the request in words: Ctrl-C, which is SIGINT, or the name of another signal."""
        self._previous: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        if threading.current_thread() is threading.main_thread():
            self._previous = {s: signal.signal(s, self._note) for s in SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._restore()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.requested = True
        if number != signal.SIGINT:
            self.cause = f"the signal {signal.Signals(number).name}"
        self._restore()

    def _restore(self) -> None:
        # In a background job, SIGINT is ignored by default. It is made effective, so that a second one ends the run.
        for number, handler in self._previous.items():
            ignored = number == signal.SIGINT and handler in (signal.SIG_IGN, None)
            signal.signal(number, signal.default_int_handler if ignored else handler or signal.SIG_DFL)
        self._previous = {}


def ending(record: Record, model: Model[Any], folder: Path) -> str:
    """Return the lines that are printed at the end of a run: the main metrics, and where the files are."""
    page = folder / VIEWER
    seen = (f"{'to look at':22}{page}",) if model.view is not None and page.is_file() else ()
    titled = () if record.title == record.name else (f"{'title':22}{record.title}",)
    return "\n".join(
        (
            f"{record.name}: {_sentence(record)}",
            *(f"  {line}" for line in (*_metrics(record, model), *titled, f"{'files':22}{folder}", *seen)),
        )
    )


def failure(record: Record, model: Model[Any]) -> str:
    """Return the line about a failed run: how, when and where it failed, and the advice of the model."""
    return f"{record.status}: {record.sentence}; {model.advice}"


def failed(record: Record) -> bool:
    """Return whether a run failed."""
    return record.status == "diverged"


def warnings(record: Record) -> list[str]:
    """Return the reasons why the results of a run are doubtful, including its faults."""
    found = ((record.summary.metrics.get(name), text) for name, text in DOUBTS.items())
    doubts = [text.format(counted(number, "step")) for number, text in found if isinstance(number, int) and number]
    return [*doubts, *map(_fault, record.summary.faults)]


def _fault(row: dict[str, Cell]) -> str:
    when = f" (from {row['time_s']:.1f} s on)" if isinstance(row["time_s"], float) else ""
    return f"{row['what']}{when}: {row['advice']}"


def _metrics(record: Record, model: Model[Any]) -> list[str]:
    headlines = (*(HEADLINES if model.moves else ()), *model.headlines, *_error(record))
    lines = [f"{label:22}{_metric(record, key, unit)}" for key, label, unit in headlines]
    return [*lines, *_uses(record)]


def _error(record: Record) -> list[tuple[str, str, str]]:
    """Return the headline for the error of the distance, as a list with at most one item.

    The list is empty if the run has no error estimate. On uneven ground the list has the headline without an estimate,
    because its reason contains advice for the user.
    """
    from worm3d.measures.spread import UNEVEN_GROUND_ADVICE

    name = "distance_error_m"
    known = record.summary.metrics.get(name) is not None or UNEVEN_GROUND_ADVICE in record.summary.reasons.get(name, "")
    return [(name, "error of the distance", "m")] if known else []


def _uses(record: Record) -> list[str]:
    """Return a line with the share of each use in the work; an empty list if the work is not positive."""
    parts = {name: record.summary.metrics.get(f"work_{name}_J") for name in USES}
    joules = {name: float(part) for name, part in parts.items() if isinstance(part, float | int)}
    work = sum(joules.values())
    if not {*USES} - {NOT_IN_ALL} <= {*joules} or work <= 0.0:
        return []
    told = {name: part for name, part in joules.items() if name != NOT_IN_ALL or part != 0.0}
    return [f"{'uses of the work':22}" + ", ".join(f"{name} {part / work:.2%}" for name, part in told.items())]


def timing(record: Record) -> dict[str, float]:
    """Return the computing times of a run that are single numbers, by name."""
    return {v.name: float(v.values) for v in record.timing if not v.dims}


def _sentence(record: Record) -> str:
    how, faults = record.status if failed(record) else record.sentence, record.summary.faults
    how += f", with {counted(len(faults), 'fault')}" if faults else ""
    speed = f"{timing(record)['real_time_factor']:.3g} times real time"
    return f"{how} ({record.summary['duration_s']:g} s simulated, {speed})"


def _metric(record: Record, key: str, unit: str) -> str:
    from worm3d.values.metrics import written  # imported here, since most commands do not need it

    value = record.summary[key]
    return (
        f"{written(value, unit)} {unit}".rstrip()
        if isinstance(value, float | int)
        else f"none: {record.summary.reasons[key]}"
    )
