"""Which wave suits a run: the sine, which turns more sharply, or the steep wave where that is hardly fast enough."""

from __future__ import annotations

from control.gaits.steering import Wave
from control.identification.identified import SteeringMap

SHARE = 0.95
"""Share of the sine's greatest speed from which on a run takes the steep wave.

The sine of the default worm makes 0.143 m/s, and at 0.14 it has no room left to catch up: its mean rms offset from an
S-curve is 0.0046 body lengths, that of the steep wave 0.0030 (seeds 10 to 14); on a circle of 1.5 body lengths both
have 0.0024 (seeds 10 to 12). At 0.12 m/s the sine has 0.0029 and 0.0023. With half of the share
runs at 0.08 m/s round sharp corners take the steep wave too, with half as much offset again; with the double none."""


def suited(speed: float, sine: SteeringMap, length: float) -> Wave:
    """Return the wave for a run by the greatest speed that is asked for [m/s], a worm's length [m] and its sine's map.

    It is one wave for the whole run: sharp bends on the way, which the sine follows better, do not count.
    """
    (_, strong), (_, fast) = sine.ranges.amplitude, sine.ranges.frequency
    return "sine" if abs(speed) < SHARE * length * float(sine.speed(strong, fast, 0.0)) else "steep"
