"""Choice of the wave for a run: the sine, which turns more sharply, or the steep wave near the sine's top speed."""

from __future__ import annotations

from control.gaits.steering import Wave
from control.identification.identified import SteeringMap

SHARE = 0.95
"""Share of the sine's greatest speed from which on a run takes the steep wave.

The sine of the default worm makes 0.143 m/s, and at 0.14 has no reserve to catch up. The mean rms offset from an
S-curve is 0.0046 body lengths with the sine and 0.0030 with the steep wave (seeds 10 to 14); on a circle of 1.5 body
lengths both waves have 0.0024 (seeds 10 to 12). At 0.12 m/s the sine has 0.0029 and 0.0023. With half of the share,
runs at 0.08 m/s round sharp corners take the steep wave too, and the offset grows by half; with the double no run
does."""


def suited(speed: float, sine: SteeringMap, length: float) -> Wave:
    """Return the wave for a run, from the greatest wanted speed [m/s], the worm's length [m] and the map of the sine.

    The whole run has one wave: sharp bends on the way, which the sine follows better, do not count.
    """
    (_, strong), (_, fast) = sine.ranges.amplitude, sine.ranges.frequency
    return "sine" if abs(speed) < SHARE * length * float(sine.speed(strong, fast, 0.0)) else "steep"
