"""Largest length of time steps: the rules for scenes and for Python."""

from __future__ import annotations

EQUAL = 1e-9
"""Largest relative difference of times that count as equal: 0.7 / 0.07 is not quite 10."""

PER_PERIOD = 10
"""Fewest time steps of a gait's period.

The default worm goes 17 % less far on level ground with 10 steps a period than with 200; with 5 it goes 35 % less far,
with 20 5 % (gait of 2 s and amplitude 0.2, in 20 s).
"""

WAVE_MISSED = "or the wave falls between the steps"
CONTRACTION_MISSED = "or the steps miss the contraction"


def fits(dt: float, span: float, times: int = 1) -> bool:
    """Return whether `times` time steps fit into a span of time [s]."""
    return dt * times <= span * (1.0 + EQUAL)


def require_fit(dt: float, name: str, span: float, why: str = "", times: int = 1) -> None:
    """Raise ValueError unless `times` time steps fit into a span of time [s]; `name` describes the span."""
    if not fits(dt, span, times):
        most = "at most" if times == 1 else f"at most a {times}th of"
        raise ValueError(f"dt: got {dt:g} s, must be {most} {name}, {span:g} s{why and f', {why}'}")


def require_period(dt: float, name: str, period: float) -> None:
    """Raise ValueError if a gait period [s], called `name`, has too few time steps [s]."""
    require_fit(dt, name, period, WAVE_MISSED, PER_PERIOD)
