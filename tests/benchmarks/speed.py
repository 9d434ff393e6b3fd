"""How fast the 3D worm is: time of a step by the number of segments, what a step is spent on, batches, start, memory.

    python tests/benchmarks/speed.py [--quick] [--out PAGE.md]

prints a page and writes it. Takes minutes; nothing else should run meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

from calibration import calibrate
from measuring import options, publish
from speed_measures import (
    FLATTENED,
    SEGMENTS,
    growth,
    measure_memory,
    measure_speed,
    measure_start,
    measure_throughput,
)
from speed_parts import measure_shares

from scenes.records.text import Column, markdown_table, table
from scenes.running.packages import machine
from scenes.running.terminal import counted, each

SPEEDS = {
    "N": Column("segments"),
    "us/step": Column("us_per_step", ".1f"),
    "slowest": Column("slowest_over_fastest", ".2f"),
    "real time": Column("real_time_factor", ".1f"),
    "whole call": Column("real_time_factor_of_call", ".1f"),
    "Jacobians": Column("newton_iterations", ".2f"),
    "other residuals": Column("gradient_evaluations", ".2f"),
    "fallbacks": Column("fallbacks"),
    "error at dt/20": Column("distance_error", ".2%"),
}
BATCH = {
    "simulated [s]": Column("duration_s", "g"),
    "threads": Column("threads"),
    "single runs [s]": Column("single_s", ".2f"),
    "batch [s]": Column("batch_s", ".2f"),
    "over single": Column("gain", ".2f"),
    "over 1 thread": Column("over_one_thread", ".2f"),
    "worm steps/s": Column("worm_steps_per_s", ".0f"),
}

show = partial(each, quiet=False)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much is measured."""

    segments: tuple[int, ...] = (3, 6, 12, 25, 50, 100, 200)
    """Segments of the worms whose speed is measured."""
    shares_of: tuple[int, ...] = (6, 100)
    """Segments of the worms of whose steps the parts are measured."""
    duration_s: float = 10.0
    repeats: int = 4
    """Runs of which the fastest counts."""
    batch: int = 64
    """Worms of a batch."""
    batch_s: tuple[float, ...] = (2.0, 5.0, 10.0)
    """Simulated by each of them [s]: the longer, the less the calls themselves count."""
    steps: int = 100_000
    """Steps of the run whose memory is measured."""


QUICK = Plan(segments=(3, 6, 12), shares_of=(6,), duration_s=2.0, repeats=2, batch_s=(1.0,), steps=10_000)


def page(plan: Plan) -> str:
    """Measure everything, and return the page.

    Raises
    ------
    StoppedError
        A run or a process failed.
    """
    about = machine()
    cores = counted(about["cores"], "core")
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    lines = ["# How fast worm3d is", ""]
    lines += [f"{about['cpu']}, {cores}, {about['system']}, {about['date']}; one core unless it says threads."]
    lines += ["", f"Versions: {versions}.", ""]
    sections = (speeds, shares, batches, start, memory)
    return "\n".join([*lines, *chain.from_iterable(section(plan) for section in sections)])


def speeds(plan: Plan) -> Iterator[str]:
    """Measure the time of a step, and yield lines."""
    yield "## Time of a step\n"
    calibration = calibrate()
    yield (
        "The default worm of N segments on a plane with sticking friction, crawling by a travelling wave: BDF2 at "
        f"dt = 10 ms, every step recorded, ledger on; the fastest of {plan.repeats} after a run that warms up. "
        "Slowest: the slowest run over the fastest; far from 1 the machine was busy and the line is worth little. "
        f"Loops: the time of a step over that of the calibration loop ({calibration:.2f} us), to be compared between "
        "machines. Real time: simulated over computing time of the steps, and of the whole call of `simulate`. "
        "Jacobians, and residuals with a Jacobian that is kept, count a step, fallbacks the whole run. The error is "
        f"that of the distance, relative to a run at dt/20. Simulated: {plan.duration_s:g} s.\n"
    )
    measure = partial(measure_speed, duration=plan.duration_s, repeats=plan.repeats)
    found = list(show("speeds", plan.segments, measure, "worm").values())
    yield from markdown_table(*table({**SPEEDS, "loops": Column("us_per_step", ".1f", 1.0 / calibration)}, found))
    exponent, sizes = growth(found)
    yield f"\nGrowth: N^{exponent:.2f}, least squares in log-log over N = {', '.join(map(str, sizes))}.\n"
    for segments in plan.segments:
        if segments <= FLATTENED:
            yield f"N = {segments}: the default worm would be pressed flat, its chambers are thrice as stiff.\n"


def shares(plan: Plan) -> Iterator[str]:
    """Measure the parts of a step, and yield lines."""
    yield "## What a step is spent on\n"
    yield (
        "Parts are timed in compiled loops on the data of one step, in turns with the step itself, times how often "
        "they run in a step on average; of a Jacobian after a step's first one it is taken that it differs in one "
        'contact; what is left of the measured step is "other": larger changes of Jacobians, cold caches, and what '
        "happens in rare steps.\n"
    )
    found = show("shares", plan.shares_of, partial(measure_shares, duration=plan.duration_s), "worm")
    rows = []
    for part in found[plan.shares_of[0]]:
        cells = ((f"{us[part]:.2f}", f"{us[part] / us['a step']:.1%}") for us in found.values())
        rows.append((part, *chain.from_iterable(cells)))
    yield from markdown_table(("part", *chain.from_iterable((f"N = {n} [us]", "") for n in found)), rows)
    yield ""


def batches(plan: Plan) -> Iterator[str]:
    """Measure batches, and yield lines."""
    yield f"## {plan.batch} worms at once\n"
    yield (
        f"`simulate_batch` of {plan.batch} worms of N = {SEGMENTS}, gaits of different periods, against as many "
        "single calls of `simulate`; wall time of the calls.\n"
    )
    found = show("batches", plan.batch_s, lambda s: measure_throughput(plan.batch, s, plan.repeats), "length")
    rows = list(chain.from_iterable(found.values()))
    yield from markdown_table(*table(BATCH, rows))
    yield ""
    for row in rows:
        if not row.equal:
            yield f"{row.duration_s:g} s, {row.threads} threads: distances differ from single runs.\n"


def start(plan: Plan) -> Iterator[str]:
    """Measure the start, and yield lines."""
    cold, warm, said = measure_start()
    yield "## Start\n"
    yield f"From the start of Python to the end of the first step, N = {SEGMENTS}, import included.\n"
    yield from markdown_table(("cache", "first step [s]"), [("cold", f"{cold:.2f}"), ("warm", f"{warm:.2f}")])
    yield f"\nThe cold start compiles {'with' if said.strip() else 'without'} a message.\n"


def memory(plan: Plan) -> Iterator[str]:
    """Measure the growth of the memory, and yield lines."""
    grown = measure_memory(plan.steps)
    yield "## Memory\n"
    yield (
        f"Peak of the process after a run with recording off (`record_every` = steps), N = {SEGMENTS}, less the peak "
        "after 1000 steps.\n"
    )
    found = "not known on this system" if grown is None else f"{grown / 1024.0:.1f} MiB"
    yield f"Growth over {plan.steps} steps: {found}.\n"


if __name__ == "__main__":
    given = options(__doc__, quick=False, out=Path("runs", "speed.md"))
    publish(page(QUICK if given.quick else Plan()), given.out)
