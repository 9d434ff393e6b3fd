"""The command `worm3d sweep`: check, run and report of a sweep."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import typer

from scenes.language.sweep_section import CASE_LIMIT
from scenes.models.loading import Scene
from scenes.records import folder as folders
from scenes.running.runner import EXIT_CODES
from scenes.running.terminal import Interruption, busy, counted, progress
from scenes.sweep.design import Design, told
from scenes.sweep.engine import Sweep, chosen, require_place
from scenes.sweep.executors import LOOPBACK, Executor
from scenes.sweep.limit import limit_of
from scenes.sweep.outputs import CSV, MOST_LINES, report, write_outputs
from scenes.sweep.plan import Plan, Source, planned
from scenes.sweep.progress import shown, summed_up
from scenes.sweep.table import Table
from scenes.sweep.vary import cases_of, texts

QUICKLY_CHECKED = 500
"""From this number of cases on, the progress of the checks is displayed. Fewer cases take only a moment."""


@dataclass(frozen=True)
class Options:
    """Options of the command, described in `worm3d sweep --help`."""

    vary: Sequence[str] = ()
    random: int | None = None
    listed: Path | None = None
    results: bool = False
    retry_failed: bool = False
    workers: int | None = None
    scheduler: str | None = None
    bind: str = LOOPBACK
    case_limit_s: float | None = None
    force: bool = False
    quiet: bool = False


Then = Callable[[Path, Scene, Table], Iterable[str]]
"""Function that writes further files about the cases into the folder of a sweep, and returns lines for the report."""


def run(
    scene: str | Path, overrides: Sequence[str], out: Path | None, options: Options, then: Then = lambda *told: ()
) -> int:
    """Run a sweep, or the missing cases of a sweep, write the outputs, and return the exit code.

    Parameters
    ----------
    scene, overrides
        Name or path of the scene, and items `section.key=value` for all cases.
    out : Path, optional
        Folder of the sweep. The default is `runs/<scene>-<time>`.
    options : Options
    then : callable
        Function that is called at the end, unless the sweep was stopped.

    Raises
    ------
    SceneError
        If there is a mistake in the scene, the varied keys or the options, the folder cannot be used, or a package is
        missing.
    """
    executor = chosen(options.workers, options.scheduler, options.bind)
    source = Source.of(scene, overrides)
    plan = checked(source, options)
    limit_s = limit_of(plan.base.sweep, options.case_limit_s)
    if out is not None:
        require_place(out, force=options.force)
    with folders.prepared(out, source.name, force=True) as folder:
        return _run_into(folder, plan, executor, replace(options, case_limit_s=limit_s), then)


def checked(source: Source, options: Options) -> Plan:
    """Return the plan of a sweep, with all cases checked. For many cases, the progress is displayed."""
    listed = cases_of(options.listed) if options.listed else ()
    with ExitStack() as stack:
        shows: list[Callable[[int], None]] = []

        def watch(done: int, total: int) -> None:
            if total >= QUICKLY_CHECKED and not shows:
                shows.append(stack.enter_context(progress("checking", total, quiet=options.quiet, what="case")))
            for show in shows:
                show(done)

        return planned(source, texts(options.vary), random=options.random, listed=listed, watch=watch)


def _run_into(folder: Path, plan: Plan, executor: Executor, options: Options, then: Then) -> int:
    name, interruption = plan.base.name, Interruption()
    try:
        status, told_at_end = _run_and_write(folder, plan, executor, options, then, interruption)
    except KeyboardInterrupt:
        status, told_at_end = "interrupted", ()
    if status == "interrupted":
        how = f"stopped by {interruption.cause}"
        typer.echo(f"{name}: {how}; finished cases are safe, and the same command runs the rest", err=True)
    if not options.quiet:
        for line in told_at_end:
            typer.echo(line)
    return EXIT_CODES[status]


def _run_and_write(
    folder: Path, plan: Plan, executor: Executor, options: Options, then: Then, interruption: Interruption
) -> tuple[str, Sequence[str]]:
    """Return the status of the sweep, and the lines at the end of the report."""
    sweep = Sweep(plan, folder, options.results, options.case_limit_s or CASE_LIMIT)
    name, begun = plan.base.name, time.monotonic()
    with interruption, shown(name, quiet=options.quiet, workers=options.workers or 0) as show:
        far = sweep.run(
            executor, lambda: interruption.requested, show, anew=options.force, retry_failed=options.retry_failed
        )
    seconds = time.monotonic() - begun
    with busy("drawing", quiet=options.quiet):
        table = write_outputs(folder, plan.base, plan.design, sweep.ended())
        more = () if interruption.requested else tuple(then(folder, plan.base, table))
    for line in failures(plan.design, table):
        typer.echo(line, err=True)
    lines = (*report(plan.base, table), *more, f"{'files':22}{folder}")
    told_at_end = (f"{name}: {summed_up(far, seconds)}", *(f"  {line}" for line in lines))
    return "interrupted" if interruption.requested else table.ending, told_at_end


def failures(design: Design, table: Table) -> Iterator[str]:
    """Yield a line for each failed case. If there are many, the last line says how many more have failed."""
    failed = [(row, values) for row, values in enumerate(design.cases()) if table.failed[row]]
    for row, values in failed[:MOST_LINES]:
        yield f"with {told(values)}: {table.status[row]}: {table.reasons[row]}"
    if len(failed) > MOST_LINES:
        yield f"and {counted(len(failed) - MOST_LINES, 'case')} more failed: see {CSV}"
