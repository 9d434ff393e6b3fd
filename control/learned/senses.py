"""Observation of a learned controller: the reference relative to the worm's measured position, averaged over waves.

The observation does not depend on the worm's position, azimuth, length or number of segments. Let L be the body length,
V the speed along the path by (LC1) and (LC2) of `control.learned.course`, e the offset to the left of the path (L2),
and V_ref the reference speed. The numbers of the observation, each clipped to [-2, 2], are:

    0          1 if a velocity is known, otherwise 0; in this case 2, 4 and 5 are also 0
    1          10 s V_ref / L
    2          V/V_ref - 1
    3          10 e/L
    4, 5       sine and cosine - 1 of the angle from the path to the velocity, both at the middle of the velocity's time
    6 ... 9    curvature of the path times L, at the worm and 0.15, 0.3 and 0.45 L ahead
    10, 11     exponentially weighted means of 10 e/L and of V/V_ref - 1, with a time constant of 10 s
    12         mean of the last number of the actions (the steering) over the last wave
    13 ...     the previous action, then the latest samples of the additional channels, in SI units
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, tau

import numpy as np
from numpy.typing import ArrayLike

from control.gaits.steering import GaitParameters
from control.learned.course import Course
from control.sensing.sensors import QUANTITIES, Measurement
from control.tracking.paths import offset
from control.tracking.preview import turn_rate
from control.tracking.references import Reference
from worm3d import Worm
from worm3d.values.arrays import FloatArray

BASE_OBSERVATION_SIZE = 13
"""Size of the observation without the previous action and the additional channels."""
SPEED, CURVATURE = 1, 6
"""Indices of the reference speed and of the present curvature in the observation."""
FAST = 10.0
"""Factor of speeds in the observation: 10 s times the speed in body lengths/s [s]."""
OBSERVATION_LIMIT = 2.0
"""The numbers of the observation are clipped to at most this absolute value."""
CURVATURE_DISTANCES = np.array([0.0, 0.15, 0.3, 0.45])
"""The curvature is observed at these distances ahead of the worm [body lengths]."""
FADING = 10.0
"""Time constant of the exponentially weighted means [s]."""
MIN_REFERENCE_SPEED = 1e-3
"""Smallest reference speed that is used as a divisor of relative errors [body lengths/s]."""


class Senses:
    """Observation of a learned controller.

    Parameters
    ----------
    worm : Worm
    reference : Reference
    actions : int
        Size of an action.
    channels : sequence of str
        Additional observed sensor channels, such as "strain".

    Raises
    ------
    ValueError
        This worm does not have one of the channels.
    """

    def __init__(self, worm: Worm, reference: Reference, actions: int, channels: Sequence[str] = ()) -> None:
        for name in channels:
            if name not in QUANTITIES or not QUANTITIES[name].exists(worm):
                known = ", ".join(name for name, each in QUANTITIES.items() if each.exists(worm))
                raise ValueError(f"channels: got {name!r}, must be among {known}")
        self._length, self._reference, self._actions = worm.length, reference, actions
        self._shapes = {name: QUANTITIES[name].shape(worm) for name in channels}
        self.size = BASE_OBSERVATION_SIZE + actions + sum(int(np.prod(shape)) for shape in self._shapes.values())
        self.reset()

    def reset(self) -> None:
        """Reset to the initial state."""
        self._course = Course()
        self._latest = {name: np.zeros(shape) for name, shape in self._shapes.items()}
        self._action, self._steering = np.zeros(self._actions), list[tuple[float, float]]()
        self._near: float | None = None
        self._means, self._seen_at = np.zeros(2), float("nan")

    def take(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> None:
        """Process a measurement that has passed the gate (`control.sensing.gate`).

        The measurement is of the time t [s], when the wave has the given phase [rad].
        """
        if measurement.com is not None and isfinite(measurement.com_time):
            waves = phase / tau - parameters.frequency * (t - measurement.com_time)
            self._course.add(waves, measurement.com_time, measurement.com[:2])
        for name, latest in self._latest.items():
            sample = measurement[name].value if name in measurement else None
            if sample is not None:
                self._latest[name] = np.where(np.isfinite(sample), sample, latest)

    def estimate(self, _: float) -> None:
        """Return None, since a controller with these senses decides without estimates."""

    def acted(self, action: FloatArray, waves: float) -> None:
        """Store the action, shape (A,), that is used from the given phase [waves] on."""
        self._action = np.asarray(action, dtype=float)
        self._steering = [each for each in self._steering if each[0] >= waves - 1.0] + [(waves, float(action[-1]))]

    def observed(self, t: float) -> FloatArray:
        """Return the observation at time t [s], shape (size,). It must be called once per control period."""
        speed, fast, aside, course, curvatures = self._tracked(t)
        miss = 0.0 if fast is None else fast / max(speed, MIN_REFERENCE_SPEED * self._length) - 1.0
        errors = np.clip([10.0 * aside / self._length, miss], -OBSERVATION_LIMIT, OBSERVATION_LIMIT)
        left = np.exp(-(t - self._seen_at) / FADING) if isfinite(self._seen_at) else 1.0
        self._means, self._seen_at = left * self._means + (1.0 - left) * errors, t
        steering = float(np.mean([each[1] for each in self._steering])) if self._steering else 0.0
        place = (speed / self._length, miss, aside / self._length, course, self._length * curvatures)
        own = assembled(fast is not None, *place, self._means, steering, self._action)
        further = [np.clip(latest.ravel(), -OBSERVATION_LIMIT, OBSERVATION_LIMIT) for latest in self._latest.values()]
        return np.concatenate([own, *further])

    def _tracked(self, t: float) -> tuple[float, float | None, float, float, FloatArray]:
        """Return reference speed, speed [m/s], offset [m], angle to the path [rad] and curvatures [1/m].

        The speed is None as long as it is unknown.
        """
        reference, motion = self._reference, self._course.motion()
        speed, velocity = float(reference.speed(t)), None if motion is None else motion.velocity
        if motion is None:
            return speed, None, 0.0, 0.0, np.zeros(len(CURVATURE_DISTANCES))
        if reference.path is None:
            heading = None if reference.heading is None else float(reference.heading(t))
            fast, course = along(velocity, heading)
            turn = 0.0 if heading is None else turn_rate(reference, t, 0.0)
            curvature = turn / max(speed, MIN_REFERENCE_SPEED * self._length)
            return speed, fast, 0.0, course, np.full(len(CURVATURE_DISTANCES), curvature)
        path = reference.path
        self._near = s = float(path.project(motion.place, self._near))
        # The velocity's middle lies a quarter of a wave behind the place, which lies half a wave behind the worm.
        way = 0.0 if velocity is None else float(np.hypot(*velocity)) * motion.wave
        heading, before = path.heading(s - 0.25 * way * np.array([0.0, 1.0])).tolist()
        fast, course = along(velocity, before)
        ahead = path.curvature(s + 0.5 * way + self._length * CURVATURE_DISTANCES)
        return speed, fast, float(offset(path, motion.place, s, heading)), course, ahead


def assembled(
    known: ArrayLike,
    speed: ArrayLike,
    miss: ArrayLike,
    aside: ArrayLike,
    course: ArrayLike,
    curvatures: FloatArray,
    means: FloatArray,
    steering: ArrayLike,
    action: FloatArray,
) -> FloatArray:
    """Return the observation without additional channels, from its parts in body lengths and seconds.

    If the parts have a last axis for B worms, the result has this axis, too.
    """
    errors = (miss, 10.0 * np.asarray(aside), np.sin(course), np.cos(course) - 1.0)
    parts = ((known, FAST * np.asarray(speed), *errors), curvatures, means, (steering,), action)
    seen: FloatArray = np.concatenate([np.asarray(part, dtype=float) for part in parts])
    return np.clip(seen, -OBSERVATION_LIMIT, OBSERVATION_LIMIT)


def along(velocity: FloatArray | None, heading: float | None) -> tuple[float | None, float]:
    """Return the speed along a heading, and the angle from the heading to the velocity.

    Without a heading, they are the magnitude of the velocity and 0.
    """
    if velocity is None:
        return None, 0.0
    if heading is None:
        return float(np.hypot(*velocity)), 0.0
    towards = np.array([np.cos(heading), np.sin(heading)])
    fast, beside = float(velocity @ towards), float(towards[0] * velocity[1] - towards[1] * velocity[0])
    return fast, float(np.arctan2(beside, fast))
