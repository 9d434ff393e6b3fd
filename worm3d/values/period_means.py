"""Path of the centre of mass, averaged over a gait period to remove the oscillation with each wave."""

from __future__ import annotations

import numpy as np

from worm3d.values.arrays import FloatArray

SHORT_RUN = "the run is shorter than one period of the gait, and the centre of mass is averaged over one period"


def averaged(com: FloatArray, window: int) -> FloatArray:
    """Return the mean of the centre of mass over `window` samples, shape (T - window + 1, 3) [m]."""
    total = np.cumsum(np.vstack([np.zeros((1, com.shape[1])), com]), axis=0)
    return np.asarray((total[window:] - total[:-window]) / window)


def path_length(com: FloatArray, time: FloatArray, period: float) -> float:
    """Return the length of the path of the averaged centre of mass [m].

    Each point of the path is the mean of the centre of mass over a period around an instant. This mean removes the
    oscillation with each wave. In the first and the last half period of the run, the path is a straight line: from the
    first position to the mean over the first period, and from the mean over the last period to the last position.
    Between the times in `time`, the centre of mass is assumed to move on straight lines. A run shorter than a period
    has a single mean, over the whole run.

    Parameters
    ----------
    com : ndarray, shape (T, D)
        Centre of mass [m].
    time : ndarray, shape (T,)
        Increasing times [s].
    period : float
        Period over which the centre of mass is averaged [s].
    """
    if len(time) < 2:
        return 0.0
    half = 0.5 * min(period, float(time[-1] - time[0]))
    inner = time[(time > time[0] + half) & (time < time[-1] - half)]
    middle = np.concatenate([time[:1] + half, inner, time[-1:] - half])
    swept = (integrals(com, time, middle + half) - integrals(com, time, middle - half)) / (2.0 * half)
    path = np.vstack([com[:1], swept, com[-1:]])
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def integrals(values: FloatArray, time: FloatArray, t: FloatArray) -> FloatArray:
    """Return the integrals of `values` from time[0] to each time in t, shape (K, D).

    The values are assumed to be linear between the times in `time`. The shape of `values` is (T, D), the shape of
    `time` is (T,), and the shape of t is (K,).
    """
    step = np.diff(time)[:, None]
    up_to = np.vstack([np.zeros(values.shape[1]), np.cumsum(0.5 * step * (values[1:] + values[:-1]), axis=0)])
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(step) - 1)
    since = (t - time[k])[:, None]
    return np.asarray(up_to[k] + since * (values[k] + 0.5 * since / step[k] * (values[k + 1] - values[k])))
