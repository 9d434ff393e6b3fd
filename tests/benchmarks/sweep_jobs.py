"""Jobs that stand in for cases of a sweep: what workers do with them is written in their scene's place."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import time
import zlib
from collections.abc import Callable
from pathlib import Path

from scenes.language.errors import DiscError
from scenes.records.folder import write_bytes
from scenes.sweep.job import Ended, Job
from scenes.sweep.limit import Clock


def jobs(folder: Path, what: str, number: int, first: int = 0) -> list[Job]:
    """Return jobs that all do the same: `spin 0.1`, `kill`, `hang`, `crash`, `raise`, `full`."""
    keys = [f"{what.split()[0]}{k:04}" for k in range(first, first + number)]
    return [Job(key, key, zlib.compress(what.encode()), str(folder / f"{key}.json")) for key in keys]


def perform(job: Job, stopped: Callable[[], bool] = lambda: False) -> Ended:
    """Do what a job says, and note in its file that it was done: once for each time."""
    path = Path(job.path)
    if path.exists():
        return Ended(job.key, "done", "found")
    what, _, seconds = job.scene.partition(" ")
    if what == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    elif what == "hang":
        Clock(job.limit_s).looks()
        re.match(r"(a+)+$", "a" * 60 + "b")  # takes years in a single step, in which no other thread of Python runs
    elif what == "crash":
        ctypes.string_at(0)
    elif what == "raise":
        raise ZeroDivisionError("nothing to divide by")
    elif what == "full":
        raise DiscError(f"cannot write {path}: no space left on device")
    _spin(float(seconds or 0.0))
    with (path.parent / f"begun-{job.key}").open("a") as file:
        file.write(f"{os.getpid()}\n")
    write_bytes(path, b"{}")
    return Ended(job.key, "done")


def _spin(seconds: float) -> None:
    """Use the processor."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
