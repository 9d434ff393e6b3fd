"""Which wave suits a run: the sine, which turns more sharply, or the steep wave where that is hardly fast enough."""

from __future__ import annotations

from control.gaits.steering import Wave
from control.identification.identified import SteeringMap

SHARE = 0.95
"""Share of the sine's greatest speed from which on a run takes the steep wave.

The sine of the default worm makes 0.143 m/s. Mean rms offsets in body lengths, sine and steep, are 0.0029 and 0.0025 on
an S-curve at 0.12 m/s (seeds 10 to 14), 0.0031 and 0.0032 at 0.13, 0.0044 and 0.0037 at 0.14 (seeds 10 to 24), where
the sine has no room left to catch up; on a circle of 1.5 body lengths 0.0023 and 0.0026, 0.0023 and 0.0030, 0.0024 and
0.0034 (seeds 10 to 12). Half of it takes the steep wave for 0.08 m/s round sharp corners too, with three times the
offset; of the double, no run does that this worm can follow."""


def suited(speed: float, sine: SteeringMap, length: float) -> Wave:
    """Return the wave for a run by the greatest speed that is asked for [m/s], a worm's length [m] and its sine's map.

    It is one wave for the whole run: sharp bends on the way, which the sine follows better, do not count.
    """
    (_, strong), (_, fast) = sine.ranges.amplitude, sine.ranges.frequency
    return "sine" if abs(speed) < SHARE * length * float(sine.speed(strong, fast, 0.0)) else "steep"
