"""Bars of speed: ratios of one checkout to another, from runs that take turns on one machine.

    python tests/benchmarks/speed_bars.py OLD NEW [--repeats 7] [--only NAME ...] [--cold]

OLD and NEW are checkouts, each with its own `.venv`. A line has the time of OLD and of NEW [µs], the least of the
repeats, their ratio, the median of the ratios of neighbouring runs, and the bar. All is processor time of the process,
so that what else the machine does counts for little; of a start it is that of the new process and its children.

step_N        a step of the default worm's crawl: the difference between a long and a short run
growth        exponent of the step's time from 25 to 200 segments
call          `simulate` for one step, the same worm on the same world
call_new      the same for a worm that has not been there
batch         a step of a worm in `simulate_batch`: 64 runs of 2 s
start         a new process: import and one step, with everything compiled on disk
cold          the same with an empty cache; takes long, and is left out without --cold
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

STEP_SIZES = {6: 20.0, 25: 2.0, 100: 1.0, 200: 1.0}
"""Segments, and the simulated time beyond a short run [s]."""
BARS = {"step_6": 0.6, "step_100": 0.6, "call": 0.2, "call_new": 0.2, "batch": 1 / 1.8, "start": 0.5, "cold": 0.25}
"""Largest ratios of NEW to OLD."""
GROWTH, SHORT, LONG = 1.15, 25, 200
"""Largest exponent, and the segments between which it is taken."""

WORKER = f"""
import sys, time
import numpy as np
import worm3d
from control.gaits import TravellingWave

DURATIONS, REST = {STEP_SIZES!r}, 0.2
periods = np.linspace(1.6, 2.4, 64)
made = 0

def run(worm, duration):
    begun = time.process_time()
    worm3d.simulate(worm, worm3d.Plane(), actuation=TravellingWave(bias=0.1), duration=duration)
    return time.process_time() - begun

def measured(name):
    global made
    what, _, size = name.partition("_")
    if what == "step":
        worm = worm3d.Worm(segments=int(size))
        more = DURATIONS[int(size)]
        return (run(worm, REST + more) - min(run(worm, REST) for _ in range(3))) / (100.0 * more)
    if what == "call":
        worm, calls = worm3d.Worm(segments=6), 20
        if size == "new":
            made += 1
            worms = [worm3d.Worm(segments=6, k_spring=worm.k_spring * (1.1 + 1e-4 * (made * calls + k)))
                     for k in range(calls)]
        else:
            worms = [worm3d.Worm(segments=6) for _ in range(calls)]
        return sum(run(each, 0.01) for each in worms) / calls
    gaits = [TravellingWave(period=float(period)) for period in periods]
    begun = time.process_time()
    worm3d.simulate_batch(worm3d.Worm(segments=6), worm3d.Plane(), actuation=gaits, duration=2.0, tolerance=1e-9)
    return (time.process_time() - begun) / (64 * 200)

for line in sys.stdin:
    print(measured(line.strip()), flush=True)
"""
"""Answers the name of a measure with its seconds."""

START = """
import worm3d
worm3d.simulate(worm3d.Worm(segments=6), worm3d.Plane(), actuation=None, duration=0.01)
"""


class Worker:
    """A process of a checkout that measures what it is asked for."""

    def __init__(self, checkout: Path) -> None:
        self.checkout, self._python = checkout, checkout / ".venv" / "bin" / "python"
        command = [self._python, "-c", WORKER]
        self._process = subprocess.Popen(
            command, cwd=checkout, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def measured(self, name: str) -> float:
        """Return the seconds of a measure."""
        if name in ("start", "cold"):
            return self._started(empty=name == "cold")
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(name + "\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())

    def _started(self, *, empty: bool) -> float:
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "XDG_CACHE_HOME": folder} if empty else dict(os.environ)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([self._python, "-c", START], cwd=self.checkout, env=environment, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def main() -> int:
    """Print what the command line asks for; return the number of bars that are not kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--only", nargs="*", help="measures; all but the cold start if left out")
    parser.add_argument("--cold", action="store_true", help="measure the cold start too, once")
    given = parser.parse_args()
    steps = [f"step_{n}" for n in STEP_SIZES]
    names = given.only or [*steps, "growth", "call", "call_new", "batch", "start"]
    if "growth" in names:
        names = [*dict.fromkeys([*(name for name in names if name != "growth"), f"step_{SHORT}", f"step_{LONG}"])]
    workers = [Worker(given.old.resolve()), Worker(given.new.resolve())]
    times = {name: _in_turns(workers, name, given.repeats) for name in names}
    if given.cold:
        times["cold"] = _in_turns(workers, "cold", 1)
    for worker in workers:
        worker.close()
    return _print_all(times)


def _in_turns(workers: list[Worker], name: str, repeats: int) -> list[list[float]]:
    """Return the seconds of a measure for each worker, after one that warms up."""
    if name != "cold":
        for worker in workers:
            worker.measured(name)
    rounds = [[worker.measured(name) for worker in workers] for _ in range(repeats)]
    return [list(column) for column in zip(*rounds, strict=True)]


def _print_all(times: dict[str, list[list[float]]]) -> int:
    """Print the measures, and return the number of bars that are not kept."""
    missed = 0
    sys.stdout.write(f"{'measure':10s} {'old us':>12s} {'new us':>12s} {'ratio':>7s} {'median':>7s} {'bar':>6s}\n")
    for name, (old, new) in times.items():
        ratio, median = min(new) / min(old), statistics.median(b / a for a, b in zip(old, new, strict=True))
        bar = BARS.get(name, math.nan)
        missed += ratio > bar
        verdict = "" if math.isnan(bar) else " missed" if ratio > bar else " kept"
        line = f"{name:10s} {1e6 * min(old):12.1f} {1e6 * min(new):12.1f} {ratio:7.3f} {median:7.3f} {bar:6.2f}"
        sys.stdout.write(f"{line}{verdict}\n")
    ends = [times.get(f"step_{n}") for n in (SHORT, LONG)]
    if ends[0] is not None and ends[1] is not None:
        old, new = (math.log(min(b) / min(a)) / math.log(LONG / SHORT) for a, b in zip(*ends, strict=True))
        missed += new > GROWTH
        verdict = "missed" if new > GROWTH else "kept"
        sys.stdout.write(f"growth from {SHORT} to {LONG}: N^{old:.3f} became N^{new:.3f}, bar {GROWTH} {verdict}\n")
    return missed


if __name__ == "__main__":
    sys.exit(main())
