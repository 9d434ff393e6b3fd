"""Loops that keep deadlines."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

PRIORITY = 10
"""Real-time priority of a loop, between 1 and 99: above all usual processes, and below most drivers of the system."""


@contextmanager
def hurried() -> Iterator[None]:
    """Context that lets this thread run before all usual threads, if the system and the user's rights allow real time.

    Threads and processes that begin in the context run so, too.
    """
    with ExitStack() as after:
        with suppress(AttributeError, OSError):
            before = os.sched_getscheduler(0), os.sched_getparam(0)
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
            after.callback(os.sched_setscheduler, 0, *before)
        yield


def following(due: float, began: float, period: float, now: float) -> tuple[float, int]:
    """Return instant [s] and number of the tick after the instant `due`. Ticks later than a period are left out.

    Before the begin of a run is known (NaN), the number is -1. Before the begin, numbers are below 0.
    """
    due = max(due + period, now - period)
    if math.isnan(began):
        return due, -1
    k = round((due - began) / period)
    return began + k * period, k
