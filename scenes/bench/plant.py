"""The measurements of `worm3d bench plant`, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from scenes.bench import contest, rivals
from scenes.bench.contest import Contender
from scenes.bench.fresh import MemoryGrowth, Start, measure_memory, measure_start
from scenes.bench.machine import machine
from scenes.bench.rivals import MissingRivalError, Rival
from scenes.bench.search import NotConvergedError
from scenes.bench.shares import Shares, measure_shares
from scenes.bench.speed import Growth, Speed, growth, measure_speed
from scenes.bench.throughput import Throughput, measure_throughput
from scenes.commands.progress import progress

K = TypeVar("K")
R = TypeVar("R")

LONG_WORM = 50
"""Segments from which on runs are shorter."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How much is measured.

    Attributes
    ----------
    segments, shares_of, rivals_at : tuple of int
        Segments of the worms whose speed, shares, and rivals are measured.
    duration_s : float
        Simulated [s].
    repeats : int
        Runs of which the fastest counts.
    batch : int
        Worms at once.
    batch_s : tuple of float
        Simulated by each of them [s]: the longer, the less the calls themselves count.
    steps : int
        Whose memory is measured.
    search_s : float
        Wall clock that the search for a rival's step may take [s].
    """

    segments: tuple[int, ...] = (3, 6, 12, 25, 50, 100, 200)
    shares_of: tuple[int, ...] = (6, 100)
    rivals_at: tuple[int, ...] = (6, 100)
    duration_s: float = 10.0
    repeats: int = 4
    batch: int = 64
    batch_s: tuple[float, ...] = (2.0, 5.0, 10.0)
    steps: int = 100_000
    search_s: float = 60.0


FULL = Plan()
QUICK = Plan(
    segments=(3, 6, 12),
    shares_of=(6,),
    rivals_at=(6,),
    duration_s=2.0,
    repeats=2,
    batch_s=(1.0,),
    steps=10_000,
    search_s=20.0,
)


@dataclass(frozen=True)
class Study:
    """All that was measured.

    Attributes
    ----------
    machine : dict
        Processor, cores, date, versions.
    plan : Plan
    speeds, growth, shares, batch, start, memory
    rivals : tuple of Contender
        worm3d first, for each number of segments.
    cannot : dict
        What each rival cannot express.
    missing : tuple of str
        A sentence for each rival that is not there, or that found no step.
    """

    machine: dict[str, Any]
    plan: Plan
    speeds: tuple[Speed, ...]
    growth: Growth
    shares: tuple[Shares, ...]
    batch: tuple[Throughput, ...]
    start: Start
    memory: MemoryGrowth
    rivals: tuple[Contender, ...] = ()
    cannot: dict[str, tuple[str, ...]] = field(default_factory=dict)
    missing: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the study as `plant.json` holds it."""
        content = asdict(self)
        for kept, shares in zip(content["shares"], self.shares, strict=True):
            kept["fractions"] = shares.fractions
        return content


def study(plan: Plan, *, with_rivals: bool, quiet: bool) -> Study:
    """Measure everything.

    Raises
    ------
    StoppedError, ChildError
        A run or a process failed.
    """
    speeds = _each(
        "speeds", plan.segments, lambda n: measure_speed(n, plan.duration_s, plan.repeats), quiet, what="worm"
    )
    shares = _each("shares", plan.shares_of, lambda n: measure_shares(n, plan.duration_s), quiet, what="worm")
    batches = _each(
        "batches", plan.batch_s, lambda s: measure_throughput(plan.batch, s, plan.repeats), quiet, what="length"
    )
    batch = tuple(each for of_length in batches for each in of_length)
    start = _one("cold and warm start, in fresh processes", measure_start, quiet)
    memory = _one("memory of a long run, in a fresh process", lambda: measure_memory(plan.steps), quiet)
    beside = _rivals(plan, quiet) if with_rivals else ((), {}, ("rivals left out: --without-rivals",))
    return Study(machine(), plan, speeds, growth(speeds), shares, batch, start, memory, *beside)


def _rivals(plan: Plan, quiet: bool) -> tuple[tuple[Contender, ...], dict[str, tuple[str, ...]], tuple[str, ...]]:
    """Return the contenders, what they cannot express, and who is missing."""
    there, missing = _present(plan.search_s)
    if not there:
        return (), {}, missing
    found = _each("rivals", plan.rivals_at, lambda n: _beside(n, there, plan.search_s), quiet, what="worm")
    entries = [entry for entries in found for entry in entries]
    contenders = tuple(entry for entry in entries if isinstance(entry, Contender))
    failed = tuple(entry for entry in entries if isinstance(entry, str))
    return contenders, contest.cannot(list(there.values())), (*missing, *failed)


def _present(seconds: float) -> tuple[dict[str, Rival], tuple[str, ...]]:
    """Return the rivals that are installed, and a sentence for each that is not."""
    there, missing = {}, []
    for name in rivals.names():
        try:
            there[name] = rivals.load(name, seconds)
        except MissingRivalError as error:
            missing.append(str(error))
    return there, tuple(missing)


def _beside(segments: int, there: dict[str, Rival], seconds: float) -> list[Contender | str]:
    """Measure worm3d and every rival with N segments."""
    try:
        own = contest.ours(segments)
    except NotConvergedError as error:
        return [str(error)]
    found: list[Contender | str] = [own]
    for name, rival in there.items():
        entry = contest.theirs(rival, own)
        found.append(entry)
        if name == "mujoco" and segments >= LONG_WORM and isinstance(entry, Contender):
            found.extend(contest.one_tree(own, entry, seconds / 2.0))
    return found


def _each(title: str, keys: Iterable[K], go: Callable[[K], R], quiet: bool, *, what: str) -> tuple[R, ...]:
    """Measure one after the other, and show how far it has come."""
    wanted, found = list(keys), []
    with progress(title, len(wanted), quiet=quiet, what=what) as show:
        for done, key in enumerate(wanted, start=1):
            found.append(go(key))
            show(done)
    return tuple(found)


def _one(title: str, go: Callable[[], R], quiet: bool) -> R:
    (found,) = _each(title, (None,), lambda _: go(), quiet, what="measurement")
    return found
