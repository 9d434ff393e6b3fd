"""The deviation of a worm from its task, as one number per run.

Means are taken over a moving window of length `WINDOW`, the same for every controller. They do not depend on the waves
that a controller reports. Let s be the distance along the path of the projected centre of mass (see (L2) in
`control.tracking.paths`), e the offset of the centre of mass from the path, and S(t) = int V_ref dt the required
distance. At each instant the worm is compared with a point that started on the path beside the worm one window ago, and
has followed the path at the required speed since then. The distance between the worm and this point is d:

    m = mean of s - S,   ahead = m(t) - m(t - WINDOW),   d^2 = ahead^2 + e^2                                   (B4)

The required distance in this time is D = M(t) - M(t - WINDOW), where M is the mean of S over the window. If the task is
a heading psi, and the worm moves the distance w along its own heading h, then d^2 = w^2 + D^2 - 2 w D cos(h - psi). The
error of a run is

    error = min(1, rms d / rms D)                                                                             (B5)

A worm at rest on its path has an error of 1. A worm at half the required speed has an error of 0.5. A worm at the full
speed that stays at a distance of D/2 from its path (0.1 m at 0.08 m/s) also has an error of 0.5. The offset is not
averaged before it is squared, because the mean offset of a worm that weaves about its path is near zero. The error is
at most 1.
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
"""Length of the window [s]. It holds two waves at 0.8 Hz, the frequency that the default map prefers. With 2 s, such a
wave moves the centre of mass to and fro so that a worm with perfect speed would have an error of 5 %. With 5 s, the
response to a step of the reference would be averaged out."""
STARTUP_TIME_S = 2.5
"""Time that a worm at rest needs to reach its speed [s], two waves. No window includes this time."""
MIN_RUN_DURATION_S = STARTUP_TIME_S + 2.0 * WINDOW
"""Instant from which the error is evaluated [s]; a run has to be longer."""
COARSEST = WINDOW / 25.0
"""Longest time between two rows of a record [s]. A window is a whole number of rows, so that its length differs from
`WINDOW` by at most half of this time."""


def error_of(record: Record, reference: Reference, length: float) -> dict[str, float | None]:
    """Return the error (B5) and its parts.

    The parts are `way` (rms of `ahead`, in units of rms D), `offset_bl` (rms of e, in body lengths) and `heading_deg`
    (rms of h - psi, in degrees). `offset_bl` is None if the task is a heading, and `heading_deg` is None if the task is
    a path.

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
