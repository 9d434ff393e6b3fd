"""The deviation of a worm from its task, as one number per run.

Means are taken over a moving window of one length, `WINDOW`, for every controller and regardless of the waves that the
controller reports. Let s be the way along the path (the projection of the centre of mass, (L2)), e the offset of the
centre of mass from the path, and S(t) = int V_ref dt the wanted way. At each instant the worm is compared with a point
that left the path beside the worm one window ago, and has followed the path at the wanted speed since. The distance
between the worm and this point is d:

    m = mean of s - S,   ahead = m(t) - m(t - WINDOW),   d^2 = ahead^2 + e^2                                   (B4)

The wanted way in that time is D = M(t) - M(t - WINDOW), with the mean M of S. If the task is a heading psi, and the
worm makes the way w along its own heading h, d^2 = w^2 + D^2 - 2 w D cos(h - psi). The error of a run is

    error = min(1, rms d / rms D)                                                                             (B5)

A worm at rest on its path has an error of 1. A worm at half the speed has 0.5, and so does a worm at the full speed
that stays beside its path at a distance of D/2 (0.1 m at 0.08 m/s). The offset is not averaged before it is squared, so
that weaving does not hide the offset. No error is greater than the error of a worm at rest.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from control.tracking.paths import offset, track
from control.tracking.references import Reference
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray

WINDOW = 2.5
"""Length of the window [s]: two waves at 0.8 Hz, the frequency that the default map prefers. At 2 s the rocking by such
a wave alone would give a worm with perfect speed an error of 5 %; at 5 s a step response would be averaged away."""
STARTUP_TIME_S = 2.5
"""Time that a worm at rest needs to reach its speed, two waves; no window includes this time [s]."""
MIN_RUN_DURATION_S = STARTUP_TIME_S + 2.0 * WINDOW
"""Time from which errors count [s]; a run has to be longer."""
COARSEST = WINDOW / 25.0
"""Longest time between two states of a record [s]: the length of a window is then off by at most half of this time."""


def error_of(record: Record, reference: Reference, length: float) -> dict[str, float | None]:
    """Return (B5) and its parts: rms of `ahead` [rms D], of e [body lengths], of h - psi [deg]; None if undefined.

    Parameters
    ----------
    record
        A run that is longer than `MIN_RUN_DURATION_S`.
    reference
        Task of the worm.
    length
        Length of the body [m].
    """
    time, com = record["time"], record["com"][:, :2]
    rows = round(WINDOW / float(time[1] - time[0]))
    counted = time[2 * rows :] > MIN_RUN_DURATION_S - 1e-9

    def mean(values: FloatArray) -> FloatArray:
        total = np.cumsum(values, axis=0)
        found: FloatArray = (total[rows:] - total[:-rows]) / rows
        return found

    def gained(values: FloatArray) -> FloatArray:
        return (mean(values)[rows:] - mean(values)[:-rows])[counted]

    def between(values: FloatArray) -> FloatArray:
        return (mean(values)[rows:] + mean(values)[:-rows])[counted] / 2.0

    wanted = scipy.integrate.cumulative_trapezoid(np.asarray(reference.speed(time), dtype=float), time, initial=0.0)
    asked = gained(wanted)
    offset_bl: float | None = None
    heading_deg: float | None = None
    if reference.path is not None:
        s = track(reference.path, com)
        ahead, aside = gained(s - wanted), offset(reference.path, com, s)[2 * rows :][counted]
        missed, offset_bl = np.hypot(ahead, aside), _rms(aside / length)
    else:
        h = between(record["heading"])
        psi = h if reference.heading is None else between(np.asarray(reference.heading(time), dtype=float))
        way = np.sum(gained(com) * np.column_stack([np.cos(h), np.sin(h)]), axis=1)
        missed, ahead = np.abs(way * np.exp(1j * h) - asked * np.exp(1j * psi)), way - asked
        heading_deg = math.degrees(_rms(np.remainder(h - psi + np.pi, 2.0 * np.pi) - np.pi))
    return {
        "error": min(1.0, _rms(missed) / _rms(asked)),
        "way": _rms(ahead) / _rms(asked),
        "offset_bl": offset_bl,
        "heading_deg": heading_deg,
    }


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
