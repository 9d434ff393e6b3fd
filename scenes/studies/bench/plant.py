"""The measurements of `worm3d bench plant`, one after the other."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain
from typing import Any

from scenes.running.packages import machine
from scenes.running.terminal import each
from scenes.studies.bench.calibration import calibrate
from scenes.studies.bench.plant_measures import (
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
from scenes.studies.bench.plant_parts import Shares, measure_shares


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
    """Time of a pass of the calibration loop (`scenes.studies.bench.calibration`)."""
    speeds: tuple[Speed, ...]
    growth: Growth
    shares: tuple[Shares, ...]
    batch: tuple[Throughput, ...]
    start: Start
    memory: MemoryGrowth

    def as_dict(self) -> dict[str, Any]:
        """Return the study as `plant.json` holds it."""
        content = asdict(self)
        for kept, shares in zip(content["shares"], self.shares, strict=True):
            kept["fractions"] = shares.fractions
        return content


def study(plan: Plan, *, quiet: bool) -> Study:
    """Measure everything.

    Raises
    ------
    StoppedError
        A run or a process failed.
    """
    duration, repeats = plan.duration_s, plan.repeats
    measure = partial(each, quiet=quiet)
    speeds = measure("speeds", plan.segments, lambda n: measure_speed(n, duration, repeats), "worm").values()
    shares = measure("shares", plan.shares_of, lambda n: measure_shares(n, duration), "worm").values()
    batches = measure("batches", plan.batch_s, lambda s: measure_throughput(plan.batch, s, repeats), "length").values()
    (start,) = measure("cold and warm start", (None,), lambda _: measure_start(), "measurement").values()
    (memory,) = measure("memory of a long run", (plan.steps,), measure_memory, "measurement").values()
    batch = tuple(chain.from_iterable(batches))
    return Study(
        machine(), plan, calibrate(), tuple(speeds), growth(tuple(speeds)), tuple(shares), batch, start, memory
    )
