"""Choice of the wave for a run: the sine, which turns more sharply, or near its top speed the steep wave."""

from __future__ import annotations

from control.gaits.steering import Wave
from control.identification.identified import SteeringMap

SHARE = 0.95
"""A run uses the steep wave if the requested speed is at least this share of the sine's greatest speed.

The greatest speed of the default worm with the sine is 0.143 m/s, so that at 0.14 m/s the sine has no reserve to catch
up. The mean rms offset from an S-curve is then 0.0046 body lengths with the sine and 0.0030 with the steep wave (seeds
10 to 14). On a circle of 1.5 body lengths it is 0.0024 with both waves (seeds 10 to 12). At 0.12 m/s the sine has an
offset of 0.0029 on the S-curve and 0.0023 on the circle. With half of this share, runs at 0.08 m/s would also use the
steep wave, and their offset at sharp corners would increase by half. With twice this share, no run would use the steep
wave.
"""


def suited(speed: float, sine: SteeringMap, length: float) -> Wave:
    """Return the wave for a run.

    `speed` is the greatest requested speed [m/s], `sine` the map of the sine, and `length` the length of the worm [m].
    The whole run has the same wave. Sharp bends of the path, which the sine follows better, are not considered.
    """
    (_, strong), (_, fast) = sine.ranges.amplitude, sine.ranges.frequency
    return "sine" if abs(speed) < SHARE * length * float(sine.speed(strong, fast, 0.0)) else "steep"
