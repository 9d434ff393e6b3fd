"""What `worm3d bench plant` found as text: lines for the terminal, Markdown for a file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from scenes.bench.contest import Contender
from scenes.bench.crawl import FLATTENED, STIFFER
from scenes.bench.plant import Study
from scenes.bench.shares import Shares
from scenes.bench.speed import Speed
from scenes.bench.tables import Cells, aligned, markdown_table
from scenes.bench.throughput import Throughput

SPEEDS = (
    "N",
    "us/step",
    "slowest",
    "real time",
    "whole call",
    "Jacobians",
    "other residuals",
    "fallbacks",
    "error at dt/20",
)
BATCH = ("simulated [s]", "threads", "single runs [s]", "batch [s]", "over single", "over 1 thread", "worm steps/s")
RIVALS = (
    "N",
    "simulator",
    "dt [ms]",
    "error [%]",
    "us/step",
    "real time",
    "worm3d over it",
    "with the whole call",
)


@dataclass(frozen=True)
class Section:
    """A title, an explanation, a table and remarks.

    Attributes
    ----------
    title, says : str
    header : sequence of str
    rows : sequence of tuples of str
    remarks : sequence of str
    """

    title: str
    says: str
    header: Sequence[str] = ()
    rows: Sequence[Cells] = ()
    remarks: Sequence[str] = ()


def terminal_lines(study: Study) -> Iterator[str]:
    """Yield the lines to print."""
    yield _machine(study)
    for section in _sections(study):
        yield from ("", section.title)
        if section.rows:
            yield from aligned(section.header, section.rows)
        yield from section.remarks


def markdown(study: Study, picture: str) -> str:
    """Return the report; `picture` is the file beside it, which it shows."""
    return "\n".join(_markdown_lines(study, picture)) + "\n"


def _markdown_lines(study: Study, picture: str) -> Iterator[str]:
    yield "# How fast worm3d is"
    yield from ("", _machine(study), "")
    yield "Versions: " + ", ".join(f"{name} {version}" for name, version in study.machine["versions"].items()) + "."
    yield from ("", f"![time of a step and what it is spent on]({picture})")
    for section in _sections(study):
        yield from ("", f"## {section.title}", "", section.says)
        if section.rows:
            yield from ("", *markdown_table(section.header, section.rows))
        for remark in section.remarks:
            yield from ("", remark)


def _machine(study: Study) -> str:
    about = study.machine
    cores = f"{about['cores']} core" + ("" if about["cores"] == 1 else "s")
    return f"{about['cpu']}, {cores}, {about['system']}, {about['date']}; one core unless it says threads."


def _sections(study: Study) -> Iterator[Section]:
    yield _speeds(study)
    yield _shares(study)
    yield _batch(study)
    yield _start(study)
    yield _memory(study)
    yield _rivals(study)


def _speeds(study: Study) -> Section:
    growth = study.growth
    sizes = ", ".join(map(str, growth.segments))
    simulated = ", ".join(f"{s.duration_s:g} s for N = {s.segments}" for s in study.speeds)
    return Section(
        "Time of a step",
        "The default worm of N segments on a plane with sticking friction, crawling by a travelling wave: BDF2 at "
        f"dt = 10 ms, every step recorded, ledger on; the fastest of {study.plan.repeats} after a run that warms up, "
        "and by what factor the slowest took longer (far from 1: the machine was busy, do not trust the line). "
        "Real time: simulated over computing time of the steps, and of the whole call of `simulate`. Jacobians, and "
        "residuals with a Jacobian that is kept, count a step, fallbacks the whole run. The error is that of the "
        f"distance, relative to a run at dt/20. Simulated: {simulated}.",
        SPEEDS,
        [_speed_cells(speed) for speed in study.speeds],
        [f"Growth: N^{growth.exponent:.2f}, least squares in log-log over N = {sizes}.", *_stiffened(study)],
    )


def _stiffened(study: Study) -> Iterator[str]:
    for speed in study.speeds:
        if speed.segments <= FLATTENED:
            yield (
                f"N = {speed.segments}: the default worm would be pressed flat by its weight, its chambers are "
                f"{STIFFER:g} times as stiff here."
            )


def _speed_cells(speed: Speed) -> Cells:
    return (
        f"{speed.segments}",
        f"{speed.us_per_step:.1f}",
        f"x {speed.slowest_over_fastest:.2f}",
        f"{speed.real_time_factor:.1f}",
        f"{speed.real_time_factor_of_call:.1f}",
        f"{speed.newton_iterations:.2f}",
        f"{speed.gradient_evaluations:.2f}",
        f"{speed.fallbacks}",
        _percent(speed.distance_error),
    )


def _shares(study: Study) -> Section:
    sizes = [f"N = {shares.segments}" for shares in study.shares]
    parts = list(study.shares[0].us) if study.shares else []
    header = ("part", *(cell for size in sizes for cell in (f"{size} [us]", "[%]")))
    rows = [(part, *(cell for shares in study.shares for cell in _share_cells(shares, part))) for part in parts]
    whole = (cell for shares in study.shares for cell in (f"{shares.us_per_step:.2f}", "100"))
    return Section(
        "What a step is spent on",
        "Parts are timed in compiled loops on the data of one step, in turns with the step itself, times how often "
        "they run in a step on average; of a Jacobian after a step's first one it is taken that it differs in one "
        'contact; what is left of the measured step is "other": larger changes of Jacobians, cold caches, and what '
        "happens in rare steps.",
        header,
        [*rows, ("a step", *whole)] if rows else (),
    )


def _share_cells(shares: Shares, part: str) -> Cells:
    return f"{shares.us[part]:.2f}", f"{100.0 * shares.fractions[part]:.1f}"


def _batch(study: Study) -> Section:
    first = study.batch[0]
    differ = [
        f"{each.duration_s:g} s, {each.threads} threads: distances differ from single runs."
        for each in study.batch
        if not each.equal
    ]
    return Section(
        f"{first.runs} worms at once",
        f"`simulate_batch` of {first.runs} worms of N = {first.segments}, gaits of different periods, "
        "against as many single calls of `simulate`; wall time of the calls.",
        BATCH,
        [_batch_cells(each) for each in study.batch],
        differ,
    )


def _batch_cells(each: Throughput) -> Cells:
    return (
        f"{each.duration_s:g}",
        f"{each.threads}",
        f"{each.single_s:.2f}",
        f"{each.batch_s:.2f}",
        f"{each.gain:.2f}",
        f"{each.over_one_thread:.2f}",
        f"{each.worm_steps_per_s:.0f}",
    )


def _start(study: Study) -> Section:
    start = study.start
    said = "with a message" if start.cold_says_so else "without a message"
    return Section(
        "Start",
        f"From the start of Python to the end of the first step of a worm of {start.segments} segments, import "
        "included.",
        ("cache", "first step [s]"),
        [("cold", f"{start.cold_s:.2f}"), ("warm", f"{start.warm_s:.2f}")],
        [f"The cold start compiles {said}."],
    )


def _memory(study: Study) -> Section:
    memory = study.memory
    grown = "not known on this system" if memory.grown_kib is None else f"{memory.grown_kib / 1024.0:.1f} MiB"
    return Section(
        "Memory",
        f"Peak of the process after a run with recording off (`record_every` = steps), N = {memory.segments}, less the "
        "peak after 1000 steps.",
        remarks=[f"Growth over {memory.steps} steps: {grown}."],
    )


def _rivals(study: Study) -> Section:
    remarks = [f"{c.name}, N = {c.segments}: {c.settings}." for c in study.rivals]
    cannot = [f"{name} cannot express: {'; '.join(what)}." for name, what in study.cannot.items()]
    return Section(
        "Beside other simulators",
        "Each at the largest step at which its own distance after 10 s is within 1 % of its own converged one, in the "
        "same run on the same machine; real-time factors of the steps alone, and worm3d's of the whole call too.",
        RIVALS,
        [_rival_cells(each) for each in study.rivals],
        [*study.missing, *remarks, *cannot],
    )


def _rival_cells(each: Contender) -> Cells:
    remark = f" ({each.remark})" if each.remark else ""
    return (
        f"{each.segments}",
        f"{each.name}{remark}",
        f"{1e3 * each.dt_s:.3g}",
        _number(None if each.error is None else 100.0 * each.error, ".2f"),
        f"{each.us_per_step:.1f}",
        f"{each.real_time_factor:.1f}",
        _number(each.ratio, ".1f"),
        _number(each.ratio_of_call, ".1f"),
    )


def _percent(value: float) -> str:
    return f"{100.0 * value:.2f} %"


def _number(value: float | None, form: str) -> str:
    return "" if value is None or math.isnan(value) else f"{value:{form}}"
