"""The error of a run: the deviation of the worm from its task, as one number.

Positions are averaged over a moving window of the length `WINDOW`. The window is the same for all controllers,
regardless of the period of their waves.

If the task is a path, let s be the arc length along the path of the projection of the centre of mass, (L2) in
`control.tracking.paths`. e is the offset of the centre of mass from the path, and S(t) = int V_ref dt is the desired
distance. At each time the worm is compared with a reference point. One window ago, this point was on the path beside
the worm; since then it has moved along the path at the desired speed. With the moving mean m of s - S, d is the
distance of the worm from the reference point:

    ahead = m(t) - m(t - WINDOW),   d^2 = ahead^2 + e^2                                                        (B4)

The desired distance during one window is D = M(t) - M(t - WINDOW), where M is the moving mean of S. If the task is a
heading psi, let w be the displacement of the worm along its own heading h during one window. In this case
d^2 = w^2 + D^2 - 2 w D cos(h - psi). The error of a run is

    error = min(1, rms d / rms D)                                                                             (B5)

A worm that rests on its path has an error of 1, which is the maximum. A worm that follows the path at half the desired
speed has an error of 0.5. A worm at the desired speed that stays at the distance D/2 from its path (0.1 m at 0.08 m/s)
also has an error of 0.5. e is squared without averaging, so that it does not cancel if a worm weaves about the path.
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
"""Length of the window [s]. It is two waves at 0.8 Hz, the frequency that the controllers choose most often with the
default map. With 2 s, a worm with exactly the desired speed would have an error of 5 %, due to the rocking in such a
wave. With 5 s, the average would hide the response to a step."""
STARTUP_TIME_S = 2.5
"""Time that a worm takes to reach its speed from rest, two waves [s]. This part of a run is in no window."""
MIN_RUN_DURATION_S = STARTUP_TIME_S + 2.0 * WINDOW
"""Time of a run after which its errors are counted [s]. A run must be longer."""
COARSEST = WINDOW / 25.0
"""Maximum time between stored states of a record [s]. The window, a whole number of such times, then differs from
`WINDOW` by at most half of this time."""


def error_of(record: Record, reference: Reference, length: float) -> dict[str, float | None]:
    """Return the error (B5) of a run, and its parts.

    Parameters
    ----------
    record
        A run that is longer than `MIN_RUN_DURATION_S`.
    reference
        Task of the worm.
    length
        Length of the body [m].

    Returns
    -------
    dict
        "error": the error (B5). "way": rms value of `ahead` divided by rms D. "offset_bl": rms value of e in body
        lengths. "heading_deg": rms value of h - psi in degrees. A part that the task does not define is None.
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
