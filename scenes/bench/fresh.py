"""What only a fresh process shows: how long the first step takes to come, and how much memory a long run takes."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import time

from scenes.language.errors import SceneError

SEGMENTS = 6

_RUN = f"""
import worm3d
from control.gaits import TravellingWave
def run(steps):
    worm3d.simulate(worm3d.Worm(segments={SEGMENTS}), worm3d.Plane(), actuation=TravellingWave(),
                    duration=0.01 * steps, dt=0.01, record_every=steps)
"""
FIRST_STEP = _RUN + "run(1)\nimport time\nprint(time.time())\n"
LONG_RUN = """
import sys
def peak():
    with open('/proc/self/status') as lines:
        return next(int(line.split()[1]) for line in lines if line.startswith('VmHWM'))
run(1000)
before = peak()
run(int(sys.argv[1]))
print(peak() - before)
"""


class ChildError(SceneError):
    """A process of the bench failed."""

    exit_code = 3


@dataclass(frozen=True)
class Start:
    """From the start of Python to the end of the first step, the import of the package included.

    Attributes
    ----------
    segments : int
    cold_s, warm_s : float
        Without and with compiled code in the cache [s].
    cold_says_so : bool
        Whether the cold start tells on standard error what takes so long.
    """

    segments: int
    cold_s: float
    warm_s: float
    cold_says_so: bool


@dataclass(frozen=True)
class MemoryGrowth:
    """Peak memory of a run with recording off.

    Attributes
    ----------
    segments, steps : int
    grown_kib : int or None
        Peak after the run less the peak after 1000 steps [KiB]; None where the system does not tell.
    """

    segments: int
    steps: int
    grown_kib: int | None


def measure_start(warm_starts: int = 3) -> Start:
    """Start Python with an empty cache, and then some times more, of which the fastest counts."""
    with tempfile.TemporaryDirectory() as cache:
        cold, said = _first_step(Path(cache))
        warm = min(_first_step(Path(cache))[0] for _ in range(warm_starts))
    return Start(SEGMENTS, cold, warm, bool(said.strip()))


def measure_memory(steps: int) -> MemoryGrowth:
    """Run so many steps in a process of their own."""
    if not Path("/proc/self/status").exists():
        return MemoryGrowth(SEGMENTS, steps, None)
    out, _ = _python(_RUN + LONG_RUN, str(steps))
    return MemoryGrowth(SEGMENTS, steps, int(out))


def _first_step(cache: Path) -> tuple[float, str]:
    """Return the seconds to the end of the first step, and what went to standard error."""
    began = time()
    ended, said = _python(FIRST_STEP, XDG_CACHE_HOME=str(cache))
    return float(ended) - began, said


def _python(code: str, *arguments: str, **environment: str) -> tuple[str, str]:
    """Run code in a Python of its own, and return what it printed."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise ChildError(f"bench: a fresh Python failed: {last}")
    return done.stdout, done.stderr
