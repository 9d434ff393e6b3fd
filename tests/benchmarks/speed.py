"""How fast the 3D worm is: time of a step by the number of segments, what a step is spent on, batches, start, memory.

    python tests/benchmarks/speed.py [--quick] [--out PAGE.md]

prints a page, and writes the page with a figure beside. Takes minutes; nothing else should run meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
import pages
from calibration import calibrate
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from speed_measures import (
    FLATTENED,
    STIFFER,
    Growth,
    MemoryGrowth,
    Speed,
    Start,
    Throughput,
    growth,
    measure_memory,
    measure_speed,
    measure_start,
    measure_throughput,
)
from speed_parts import Shares, measure_shares

from scenes.records.text import Cells, Column, markdown_table, table
from scenes.running.packages import machine
from scenes.running.terminal import each

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
COLOURS = ("#1f5a94", "#3f8fc4", "#8cc0df", "#f0b35a", "#d9793a", "#9c4a2f", "#c4c4c4")
"""Colours of the parts, from the bottom of a bar; the last is that of "other"."""
DARK = (COLOURS[0], COLOURS[1], COLOURS[5])
"""Colours on which white is easier to read."""
LEAST_LABELLED = 0.03
"""Least fraction of a step at which a part has a number in its bar."""


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


FULL = Plan()
QUICK = Plan(segments=(3, 6, 12), shares_of=(6,), duration_s=2.0, repeats=2, batch_s=(1.0,), steps=10_000)


@dataclass(frozen=True)
class Study:
    """All that was measured; `machine` has processor, cores, date and versions."""

    machine: dict[str, Any]
    plan: Plan
    calibration_us: float
    """Time of a pass of the calibration loop (`calibration.py`)."""
    speeds: tuple[Speed, ...]
    growth: Growth
    shares: tuple[Shares, ...]
    batch: tuple[Throughput, ...]
    start: Start
    memory: MemoryGrowth


def measure(plan: Plan) -> Study:
    """Measure everything.

    Raises
    ------
    StoppedError
        A run or a process failed.
    """
    duration, repeats = plan.duration_s, plan.repeats
    show = partial(each, quiet=False)
    speeds = show("speeds", plan.segments, lambda n: measure_speed(n, duration, repeats), "worm").values()
    shares = show("shares", plan.shares_of, lambda n: measure_shares(n, duration), "worm").values()
    batches = show("batches", plan.batch_s, lambda s: measure_throughput(plan.batch, s, repeats), "length").values()
    (start,) = show("cold and warm start", (None,), lambda _: measure_start(), "measurement").values()
    (memory,) = show("memory of a long run", (plan.steps,), measure_memory, "measurement").values()
    batch = tuple(chain.from_iterable(batches))
    return Study(
        machine(), plan, calibrate(), tuple(speeds), growth(tuple(speeds)), tuple(shares), batch, start, memory
    )


@dataclass(frozen=True)
class Section:
    """A title, an explanation, a table and remarks."""

    title: str
    says: str
    header: Sequence[str] = ()
    rows: Sequence[Cells] = ()
    remarks: Sequence[str] = ()


def markdown(study: Study, picture: str) -> str:
    """Return the page; `picture` is the file beside the page, which the page shows."""
    versions = ", ".join(f"{name} {version}" for name, version in study.machine["versions"].items())
    lines = ["# How fast worm3d is", "", _machine(study), "", f"Versions: {versions}."]
    lines += ["", f"![time of a step and what it is spent on]({picture})"]
    for section in _sections(study):
        lines += ["", f"## {section.title}", "", section.says]
        if section.rows:
            lines += ["", *markdown_table(section.header, section.rows)]
        for remark in section.remarks:
            lines += ["", remark]
    return "\n".join(lines) + "\n"


def _machine(study: Study) -> str:
    about = study.machine
    cores = f"{about['cores']} core" + ("" if about["cores"] == 1 else "s")
    said = f"{about['cpu']}, {cores}, {about['system']}, {about['date']}; one core unless it says threads"
    return f"{said}; calibration loop {study.calibration_us:.2f} us."


def _sections(study: Study) -> Iterator[Section]:
    growth, first, start, memory = study.growth, study.batch[0], study.start, study.memory
    simulated = ", ".join(f"{s.duration_s:g} s for N = {s.segments}" for s in study.speeds)
    sizes = ", ".join(map(str, growth.segments))
    yield Section(
        "Time of a step",
        "The default worm of N segments on a plane with sticking friction, crawling by a travelling wave: BDF2 at "
        f"dt = 10 ms, every step recorded, ledger on; the fastest of {study.plan.repeats} after a run that warms up. "
        "Slowest: the slowest run over the fastest; far from 1 the machine was busy and the line is worth little. "
        "Loops: the time of a step over that of the calibration loop, to be compared between machines. "
        "Real time: simulated over computing time of the steps, and of the whole call of `simulate`. Jacobians, and "
        "residuals with a Jacobian that is kept, count a step, fallbacks the whole run. The error is that of the "
        f"distance, relative to a run at dt/20. Simulated: {simulated}.",
        *table(SPEEDS | {"loops": Column("us_per_step", ".1f", 1.0 / study.calibration_us)}, study.speeds),
        [f"Growth: N^{growth.exponent:.2f}, least squares in log-log over N = {sizes}.", *_stiffened(study)],
    )
    yield Section(
        "What a step is spent on",
        "Parts are timed in compiled loops on the data of one step, in turns with the step itself, times how often "
        "they run in a step on average; of a Jacobian after a step's first one it is taken that it differs in one "
        'contact; what is left of the measured step is "other": larger changes of Jacobians, cold caches, and what '
        "happens in rare steps.",
        *_shares(study),
    )
    yield Section(
        f"{first.runs} worms at once",
        f"`simulate_batch` of {first.runs} worms of N = {first.segments}, gaits of different periods, "
        "against as many single calls of `simulate`; wall time of the calls.",
        *table(BATCH, study.batch),
        [
            f"{each.duration_s:g} s, {each.threads} threads: distances differ from single runs."
            for each in study.batch
            if not each.equal
        ],
    )
    yield Section(
        "Start",
        f"From the start of Python to the end of the first step of a worm of {start.segments} segments, import "
        "included.",
        ("cache", "first step [s]"),
        [("cold", f"{start.cold_s:.2f}"), ("warm", f"{start.warm_s:.2f}")],
        [f"The cold start compiles {'with' if start.cold_says_so else 'without'} a message."],
    )
    grown = "not known on this system" if memory.grown_kib is None else f"{memory.grown_kib / 1024.0:.1f} MiB"
    yield Section(
        "Memory",
        f"Peak of the process after a run with recording off (`record_every` = steps), N = {memory.segments}, less the "
        "peak after 1000 steps.",
        remarks=[f"Growth over {memory.steps} steps: {grown}."],
    )


def _stiffened(study: Study) -> Iterator[str]:
    for speed in study.speeds:
        if speed.segments <= FLATTENED:
            yield (
                f"N = {speed.segments}: the default worm would be pressed flat by its weight, its chambers are "
                f"{STIFFER:g} times as stiff here."
            )


def _shares(study: Study) -> tuple[Cells, list[Cells]]:
    """Return the header and the rows of the table of shares."""
    times = [{**shares.us, "a step": shares.us_per_step} for shares in study.shares]
    header = ("part", *(cell for shares in study.shares for cell in (f"N = {shares.segments} [us]", "[%]")))
    return header, [
        (part, *(cell for us in times for cell in (f"{us[part]:.2f}", f"{100.0 * us[part] / us['a step']:.1f}")))
        for part in times[0]
    ]


def draw(study: Study) -> Figure:
    """Return the figure: time of a step against the number of segments, and what it is spent on."""
    figure = Figure(figsize=(10.0, 4.6), layout="constrained", dpi=120)
    left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_times(left, study)
    _draw_shares(right, study)
    return figure


def _draw_times(axes: Axes, study: Study) -> None:
    growth, speeds = study.growth, study.speeds
    sizes = [speed.segments for speed in speeds]
    ends = np.array([min(growth.segments), max(growth.segments)], dtype=float)
    label = f"fit: N$^{{{growth.exponent:.2f}}}$ over N = {ends[0]:.0f} to {ends[1]:.0f}"
    axes.loglog(ends, growth.us_of_one * ends**growth.exponent, color=COLOURS[4], lw=1.5, label=label)
    axes.loglog(sizes, [speed.us_per_step for speed in speeds], "o", color=COLOURS[0], label="measured")
    for speed in speeds:
        text = f"{speed.us_per_step:.{0 if speed.us_per_step >= 100.0 else 1}f}"
        place = (speed.segments, speed.us_per_step)
        axes.annotate(text, place, xytext=(5, -10), textcoords="offset points", ha="left", fontsize=8)
    axes.set_xticks(sizes, [str(size) for size in sizes])
    axes.set_xticks([], minor=True)
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set(xlabel="segments N", ylabel="time of a step [µs]")
    axes.set_title("Time of a step, dt = 10 ms", fontsize=11)
    axes.margins(x=0.12, y=0.12)
    axes.grid(True, alpha=0.25)
    axes.legend(loc="upper left", fontsize=9)


def _draw_shares(axes: Axes, study: Study) -> None:
    shares = study.shares
    places, bottom = np.arange(len(shares)), np.zeros(len(shares))
    for part, colour in zip(shares[0].us, COLOURS, strict=False):
        # Parts timed alone may add up to more than the step, where only some segments are evaluated anew.
        heights = np.array([max(0.0, 100.0 * each.fractions[part]) for each in shares])
        bars = axes.bar(places, heights, 0.55, bottom=bottom, color=colour, label=part)
        texts = [f"{height:.0f} %" if height >= 100.0 * LEAST_LABELLED else "" for height in heights]
        axes.bar_label(bars, texts, label_type="center", fontsize=8, color="white" if colour in DARK else "black")
        bottom += heights
    axes.set_xticks(places, [f"N = {each.segments}\n{each.us_per_step:.3g} µs" for each in shares])
    axes.set_xlim(-0.6, len(shares) - 0.4)
    axes.set_ylabel("share of a step [%]")
    axes.set_title("What it is spent on", fontsize=11)
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles[::-1], labels[::-1], loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


if __name__ == "__main__":
    given = pages.options(__doc__, "speed.md")
    found = measure(QUICK if given.quick else FULL)
    pages.publish(markdown(found, given.out.with_suffix(".png").name), given.out, draw(found))
