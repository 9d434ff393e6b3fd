"""Measures of how a run settles: the return map, and the time to reach the final speed.

**Return map.** The shape x_k is sampled at instants that are a period of the gait apart, counted back from the end of
the run. x_k contains the positions of the joints relative to the centre of mass. On level ground, the shape is also
rotated so that the heading is 0. Position and heading are left out because a gait does not determine them. As the worm
approaches a limit cycle, |x_(k+1) - x_k| shrinks from period to period. The factor is the largest modulus among those
multipliers of the limit cycle that the start excites:

    return_map_radius = exp(slope of log |x_(k+1) - x_k| over k, least squares)                          (J7)

Only differences above rounding are used: more than 1e-10 (rms over the joints, in body lengths). The slope is taken
over the later half of these differences, and over at least two. The value is 0 if there is at most one such difference.

**Response.** Let w(t) be the distance in the period before t (the worm is at rest before the start), and D the mean
distance per period in the last waves:

    response_time = first t from which w >= 0.9 D for a period                                       (J8)
"""

from __future__ import annotations

import numpy as np

from worm3d.measures.gait import way_made
from worm3d.measures.table import NoValueError, measure
from worm3d.measures.waves import waves_of
from worm3d.measures.way import along_the_ground
from worm3d.recorded.finished import FinishedRun
from worm3d.values.arrays import FloatArray, IntArray

RISEN = 0.9
"""A worm is considered to have responded after this fraction of a change of speed or heading."""
FEW_PERIODS = "the run has fewer than three whole periods"
UNEVEN_ROWS = "a period of the gait is no whole number of recorded rows: choose dt and record_every so that it is one"


@measure("return_map_radius", "factor by which the change of shape shrinks from wave to wave; stable if below 1")
def _return_map(result: FinishedRun) -> float:
    waves, apart = waves_of(result), float(result.time[1] - result.time[0])
    step = round(waves.period / apart)
    if abs(waves.period / apart - step) > 1e-6 * step:
        raise NoValueError(UNEVEN_ROWS)
    rows = np.arange(len(result.time) - 1, -1, -step)[::-1]
    if len(rows) < 4:
        raise NoValueError(FEW_PERIODS)
    return decay(np.diff(shapes(result, rows), axis=0))


def shapes(result: FinishedRun, rows: IntArray) -> FloatArray:
    """Return the joints relative to the centre of mass at R rows, shape (R, N+1, 3) [body lengths].

    On level ground, the joints are also rotated about the vertical so that the heading is 0.
    """
    shape: FloatArray = (result.joints[rows] - result.com[rows, None]) / result.worm.length
    heading = result.heading[rows]
    if np.isfinite(heading).all() and _is_level(result):
        cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
        x, y = shape[..., 0], shape[..., 1]
        shape = np.stack([cos * x + sin * y, cos * y - sin * x, shape[..., 2]], axis=2)
    return shape


def decay(changes: FloatArray) -> float:
    """Return the factor (J7) for changes of shape, an array (K, N+1, 3); 0 if at most one change exceeds rounding."""
    size = np.sqrt((changes**2).sum(axis=2).mean(axis=1))
    large = np.flatnonzero(size > 1e-10)
    if len(large) < 2:
        return 0.0
    later = large[-max(2, (len(large) + 1) // 2) :]
    return float(np.exp(np.polyfit(later, np.log(size[later]), 1)[0]))


def _is_level(result: FinishedRun) -> bool:
    if result.world is None or not result.world.flat:
        return result.world is None
    normal = result.world.normal(result.joints[0].mean(axis=0), result.worm.length)
    return bool(abs(abs(normal[2]) - 1.0) < 1e-9)


@measure("response_time_s", "time from the start to 90 % of the last waves' speed")
def _response(result: FinishedRun) -> float:
    waves = waves_of(result)
    time, period = result.time - result.time[0], waves.period
    if time[-1] < 3.0 * period * (1.0 - 1e-9):
        raise NoValueError(FEW_PERIODS)
    goal = way_made(result, waves) / waves.count
    if waves.course is None:
        way = along_the_ground(result)
    else:
        assert result.world is not None
        rows = slice(None, None, max(1, int(period / (32 * (time[1] - time[0])))))  # a course takes long to compute
        course = result.world.course(result.com[rows], result.joints[0])
        assert course is not None
        time, way = time[rows], course[:, None]
    made = np.linalg.norm(way - _earlier(time, way, period), axis=1)
    return rise_time(time, made, 0.0, goal, period)


def _earlier(time: FloatArray, values: FloatArray, by: float) -> FloatArray:
    """Return the values, an array (T, D), at times earlier by `by`; before the start, the first values."""
    return np.column_stack([np.interp(time - by, time, column) for column in values.T])


def rise_time(time: FloatArray, values: FloatArray, before: float, after: float, lasting: float) -> float:
    """Return the time from time[0] until at least 90 % of the change from `before` to `after` is reached and kept.

    Parameters
    ----------
    time, values : ndarray, shape (T,)
        Ascending times [s], and the values at these times.
    before, after : float
        Initial value and final value.
    lasting : float
        Time for which at least 90 % of the change has to be kept [s]. A change that is kept until the end also counts.

    Raises
    ------
    NoValueError
        The values do not keep at least 90 % of the change for this time.
    """
    share = (values - before) / (after - before)
    risen = share >= RISEN
    begins = np.flatnonzero(risen & ~np.concatenate([[False], risen[:-1]]))
    for k in begins:
        falls = np.flatnonzero(~risen[k:])
        if len(falls) == 0 or time[k + falls[0]] - time[k] >= lasting:
            if k == 0:
                return 0.0
            part = (RISEN - share[k - 1]) / (share[k] - share[k - 1])
            return float(time[k - 1] + part * (time[k] - time[k - 1]) - time[0])
    raise NoValueError(f"it does not keep {RISEN:.0%} of its new value")
