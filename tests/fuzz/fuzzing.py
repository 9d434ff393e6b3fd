"""What tests that draw their inputs at random share: the same examples each time, or more of them when asked."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from hypothesis import HealthCheck, Phase, settings

from control.sensing.sensors import Measurement

TIMES = int(os.environ.get("WORM3D_FUZZ", "1"))
"""Factor of the number of examples; above 1 they are new ones each time."""

LIMIT_S = 60
"""No single input may take longer: it is a hang. Wide, for a busy machine."""


def examples(count: int) -> settings:
    """Return the settings of a test with so many examples."""
    return settings(
        max_examples=count * TIMES,
        derandomize=TIMES == 1,
        database=None,
        deadline=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )


@contextmanager
def no_hang() -> Iterator[None]:
    """Fail where what is done within takes too long."""

    def late(number: int, frame: FrameType | None) -> None:
        raise AssertionError(f"took more than {LIMIT_S} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(LIMIT_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def replaced(measured: Measurement, **parts: Any) -> Measurement:
    """Return a measurement with other values of some channels (`com`), or other instants (`com_time`)."""
    return measured.changed(
        **{
            name: (parts.get(name, sample.value), parts.get(f"{name}_time", sample.time))
            for name, sample in measured.items()
            if {name, f"{name}_time"} & parts.keys()
        }
    )
