"""Response of a worm to steps of the reference: the time to reach 90 % of a change of speed or heading.

Let y be the mean over the last commanded period (`control.tracking.metrics`). The reference steps from a to b at t_0.
The response ends at the first time t after which (y - a)/(b - a) is at least 0.9 for a whole period, or until the next
step:

    response time = t - t_0, of the slowest step                                                       (V2)
"""

from __future__ import annotations

import numpy as np

from control.tracking.references import Profile, Steps
from worm3d.measures import NoValueError
from worm3d.measures.stability import rise_time
from worm3d.values.arrays import FloatArray


def response_time(profile: Profile | None, time: FloatArray, values: FloatArray, period: float) -> float:
    """Return (V2) [s].

    Parameters
    ----------
    profile : callable or None
        Profile of the reference. Only the class `control.tracking.references.Steps` has steps.
    time, values : ndarray, shape (K,)
        Ends of the windows [s], and means over the windows.
    period : float
        Length of a window [s].

    Raises
    ------
    NoValueError
        The profile has no step within the run, or the values do not reach 90 % of a change.
    """
    if not isinstance(profile, Steps):
        raise NoValueError("what is asked for has no step")
    slowest: float | None = None
    edges = zip(
        profile.times, (*profile.times[1:], np.inf), (profile.first, *profile.values), profile.values, strict=False
    )
    for begin, end, before, after in edges:
        rows = (time >= begin) & (time < end)
        if before == after or not rows.any():
            continue
        try:
            risen = rise_time(time[rows], values[rows], before, after, period)
        except NoValueError as none:
            raise NoValueError(f"after the step at {begin:g} s {none}") from None
        slowest = max(slowest or 0.0, float(time[rows][0]) - begin + risen)
    if slowest is None:
        raise NoValueError("no step lies within the run")
    return slowest
