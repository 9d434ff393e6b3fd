"""Metrics of tracking: how well a run kept to its reference; definitions as in worm3d/NOTATION.md.

A wave rocks the body, so everything is averaged over a moving window of one commanded period: with the commanded phase
w(t) in waves, the window that ends at t begins at b with w(b) = w(t) - 1, and

    mean y (t) = 1/(t - b) int_b^t y,    velocity V = (x(t) - x(b))/(t - b)                                    (V1)

for centre of mass x, heading h and offset e from the path. Speed is V along the path's tangent at the mean place, or
without a path along the mean heading; the reference speed and the reference heading are averaged over the same window.
Bias, rms and greatest values leave out windows that reach into the first three periods of the run. If the worm has to
stop at the end of the path, they also leave out windows from three periods before the end. The speed has a second bias
and rms, `..._settled_relative`, which also leave out windows that reach into the three periods after a step of the
reference speed. The measure of the step itself is the number of periods until the speed stays within 10 %.

The head is the worm's foremost point. The offset of the head is (L2), as for the centre of mass, with a separate
projection: a straight body of length L that is tangent to a circle of radius R has its head sqrt(R^2 + L^2/4) - R
outside.

The clearance of the body is the least distance of the outline, seen from above, from the edge of any obstacle, at any
instant of the run and without averaging; a negative clearance is the depth of the outline inside an obstacle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.tracking.obstacles import nearest
from control.tracking.paths import lengthening, offset, track
from control.tracking.references import Reference, Steps
from control.tracking.response import response_time
from worm3d.measures import NoValueError
from worm3d.values.arrays import FloatArray

Bools = NDArray[np.bool_]

DROPPED_PERIODS = 3.0
"""Number of periods left out at the beginning, and for `SETTLED_METRICS` after a step."""
TIME_ROUNDING = 1e-6
"""Greatest difference of two times that count as equal [s]."""
SETTLED = 0.10
"""Share of the reference speed within which a speed has settled."""
SPEED_METRICS = ("speed_bias_relative", "speed_error_rms_relative")
SETTLED_METRICS = ("speed_bias_settled_relative", "speed_error_rms_settled_relative")
HEADING_METRICS = ("heading_error_mean_deg", "heading_error_rms_deg")
PATH_METRICS = ("cross_track_rms_bl", "cross_track_max_bl", "cross_track_mean_bl")
HEAD_METRICS = ("head_offset_rms_bl", "head_offset_max_bl")
WITHIN = 0.02
"""Greatest offset of a worm that has joined the path [body lengths]."""
BODY_CLEARANCE = "body_clearance_min_bl"
RESPONSE_METRICS = ("speed_response_time_s", "heading_response_time_s")
METRICS = (
    *(*SPEED_METRICS, "speed_bias_m_s", *SETTLED_METRICS, *HEADING_METRICS, *PATH_METRICS, *HEAD_METRICS),
    *("joining_periods", "clearance_min_bl", BODY_CLEARANCE, "end_error_bl", "settling_periods", *RESPONSE_METRICS),
)
"""Names of the metrics that `summary` returns."""
STAYED = 4.0
"""Time for which a worm has to stay at the end of its path at the end of a run, three periods at 0.8 Hz [s]."""
TOO_SHORT = f"the run is shorter than the {DROPPED_PERIODS:g} periods that are left out and one more"
UNSETTLED = f"no window lies beyond the {DROPPED_PERIODS:g} periods after each step of the reference speed"
REASONS = {
    **dict.fromkeys((*SPEED_METRICS, *SETTLED_METRICS), "the reference speed is 0"),
    **dict.fromkeys(HEADING_METRICS, "there is no heading and no path to keep to"),
    **dict.fromkeys((*PATH_METRICS, *HEAD_METRICS, "joining_periods"), "there is no path to follow"),
    "clearance_min_bl": "there is neither a corridor nor an obstacle",
    BODY_CLEARANCE: "there is no obstacle",
}
"""Reason for a missing value of a metric in a run that is long enough."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a worm at T instants."""

    time: FloatArray
    """Instants [s], shape (T,)."""
    com: FloatArray
    """True centre of mass [m], shape (T, 2)."""
    heading: FloatArray
    """True azimuth of the chord, unwrapped [rad], shape (T,)."""
    waves: FloatArray
    """Commanded phase, not falling [waves], shape (T,)."""
    head: FloatArray | None = None
    """True place of the head [m], shape (T, 2); None: no metrics of the head's offset."""
    outline: FloatArray | None = None
    """Corners of the true outline of the body, in turn [m], shape (T, C, 2); None: no metric of the clearance."""


@dataclass(frozen=True, eq=False)
class Tracking:
    """Tracking of a reference by a worm, over K windows of one period, (V1)."""

    time: FloatArray
    """Ends of the windows [s], shape (K,)."""
    waves: FloatArray
    """Commanded phase at the ends of the windows [waves], shape (K,)."""
    place: FloatArray
    """Mean centre of mass [m], shape (K, 2)."""
    speed: FloatArray
    """Speed forward, along the centre line of a pipe that rises [m/s], shape (K,)."""
    wanted_speed: FloatArray
    """Mean reference speed [m/s], shape (K,)."""
    heading: FloatArray
    """Mean heading [rad], shape (K,)."""
    wanted_heading: FloatArray
    """Wanted heading [rad], shape (K,); NaN without a path or heading."""
    cross_track: FloatArray
    """Mean offset to the left of the path [m], shape (K,); NaN without a path."""
    head_offset: FloatArray
    """Mean offset of the head to the left of the path [m], shape (K,); NaN without a path or a head."""
    arriving: Bools
    """Windows in which the worm stops at the end of its path, shape (K,)."""
    counted: Bools
    """Windows that enter the metrics, shape (K,)."""
    settled: Bools
    """Counted windows that also lie beyond the steps of the reference speed, shape (K,)."""

    @property
    def heading_error(self) -> FloatArray:
        """Heading less the wanted heading, within half a turn, shape (K,) [rad]."""
        return np.mod(self.heading - self.wanted_heading + np.pi, 2.0 * np.pi) - np.pi


def tracking(motion: Motion, reference: Reference) -> Tracking:
    """Return the tracking of a reference by a worm; ValueError for less than one commanded period."""
    window = _Window(motion)
    velocity = (motion.com[window.rows] - window.at_begin(motion.com)) / (window.time - window.began)[:, None]
    place, heading = window.mean(motion.com), window.mean(motion.heading)
    wanted_speed = window.mean(np.asarray(reference.speed(motion.time), dtype=float))
    wanted_heading, along, longer = _course(motion, reference, window, place, heading)
    arriving = _arriving(reference, window, place, wanted_speed)
    return Tracking(
        time=window.time,
        waves=window.waves,
        place=place,
        speed=longer * (velocity[:, 0] * np.cos(along) + velocity[:, 1] * np.sin(along)),
        wanted_speed=wanted_speed,
        heading=heading,
        wanted_heading=wanted_heading,
        cross_track=_offset(motion.com, reference, window),
        head_offset=_offset(motion.head, reference, window),
        arriving=arriving,
        counted=_beyond(window, motion, ()) & ~arriving,
        settled=_beyond(window, motion, _step_times(reference)) & ~arriving,
    )


def _course(
    motion: Motion, reference: Reference, window: _Window, place: FloatArray, heading: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the wanted heading, NaN if there is none, the direction of the counted speed, and the factor of the speed.

    Each of shape (K,); the factor is the ratio of the length along a rising pipe to the length seen from above.
    """
    if reference.path is not None:
        s = track(reference.path, place)
        azimuth = reference.path.heading(s)
        return azimuth, azimuth, lengthening(reference.path, s)
    wanted = np.full(len(place), np.nan)
    if reference.heading is not None:
        wanted = window.mean(np.asarray(reference.heading(motion.time), dtype=float))
    return wanted, heading, np.ones(len(place))


def _offset(places: FloatArray | None, reference: Reference, window: _Window) -> FloatArray:
    """Return the mean offsets of places (T, 2) from the path, (K,); NaN without a path or places."""
    if places is None or reference.path is None:
        return np.full(len(window.time), np.nan)
    return window.mean(offset(reference.path, places, track(reference.path, places)))


def measured(motion: Motion, reference: Reference, length: float) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the metrics of a run of any length, and the reasons for missing values; see `summary`."""
    if motion.waves[-1] - motion.waves[0] < 1.0:
        found, reasons = dict[str, float | None].fromkeys(METRICS), dict.fromkeys(METRICS, TOO_SHORT)
    else:
        found, reasons = summary(tracking(motion, reference), reference, length)
    if reference.obstacles and motion.outline is not None:
        found[BODY_CLEARANCE] = float(clearances(motion.outline, reference).min()) / length
    return found, {**reasons, BODY_CLEARANCE: REASONS[BODY_CLEARANCE]}


def clearances(outline: FloatArray, reference: Reference) -> FloatArray:
    """Return the distances of outlines (T, C, 2) from the nearest obstacle [m], shape (T,); below 0 inside.

    The distances are evaluated at the corners and at seven places on each line between two corners, 0.02 body lengths
    apart: an obstacle of radius 0.05 body lengths is at most 0.001 nearer.
    """
    shares = np.arange(8)[:, None] / 8
    begin, end = outline[:, :, None], np.roll(outline, -1, axis=1)[:, :, None]
    places = (begin + shares * (end - begin)).reshape(len(outline), -1, 2)
    return np.asarray(nearest(reference.obstacles, places).min(axis=1))


def summary(tracked: Tracking, reference: Reference, length: float) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the metrics of a worm of the given length [m], and the reasons for missing values."""
    taken = tracked.counted
    metrics: dict[str, float | None] = dict.fromkeys(METRICS)
    if not taken.any():
        return metrics, dict.fromkeys(METRICS, TOO_SHORT)
    metrics |= dict(zip(SPEED_METRICS, _of_speed(tracked, taken), strict=True))
    metrics |= dict(zip(SETTLED_METRICS, _of_speed(tracked, tracked.settled), strict=True))
    metrics["speed_bias_m_s"] = float((tracked.speed - tracked.wanted_speed)[taken].mean())
    error, aside = np.rad2deg(tracked.heading_error[taken]), tracked.cross_track[taken] / length
    head = tracked.head_offset[taken] / length
    apart: dict[str, str] = {}
    if np.isfinite(error).all():
        metrics |= zip(HEADING_METRICS, (float(error.mean()), _rms(error)), strict=True)
    if np.isfinite(aside).all():
        metrics |= zip(PATH_METRICS, (_rms(aside), float(np.abs(aside).max()), float(aside.mean())), strict=True)
        metrics["joining_periods"] = joining_periods(tracked, length)
        beyond = np.abs(tracked.cross_track[taken]) - reference.corridor
        clearance = -float(reference.trespass(tracked.place[taken], beyond).max()) / length
        metrics["clearance_min_bl"] = clearance if np.isfinite(clearance) else None
        apart = {"joining_periods": f"the worm does not come within {WITHIN:g} body lengths of its path for good"}
    if np.isfinite(head).all():
        metrics |= zip(HEAD_METRICS, (_rms(head), float(np.abs(head).max())), strict=True)
    metrics["end_error_bl"], apart["end_error_bl"] = end_error(tracked, reference, length)
    metrics["settling_periods"], why = settling_periods(tracked, reference)
    late = _responses(tracked, reference, metrics)
    unsettled = {} if tracked.settled.any() else dict.fromkeys(SETTLED_METRICS, UNSETTLED)
    return metrics, {**REASONS, **apart, "settling_periods": why, **late, **unsettled}


def _responses(tracked: Tracking, reference: Reference, metrics: dict[str, float | None]) -> dict[str, str]:
    """Enter the response times (V2), and return the reasons for missing values."""
    waves = float(tracked.waves[-1] - tracked.waves[0])
    period = float(tracked.time[-1] - tracked.time[0]) / waves if waves > 0.0 else 0.0
    asked = ((reference.speed, tracked.speed), (reference.heading, tracked.heading))
    reasons = {}
    for name, (profile, values) in zip(RESPONSE_METRICS, asked, strict=True):
        try:
            metrics[name] = response_time(profile, tracked.time, values, period)
        except NoValueError as none:
            reasons[name] = str(none)
    return reasons


def _of_speed(tracked: Tracking, taken: Bools) -> tuple[float | None, float | None]:
    """Return bias and rms error of the speed over some windows, relative to the mean reference there."""
    size = float(np.abs(tracked.wanted_speed[taken]).mean()) if taken.any() else 0.0
    if size == 0.0:
        return None, None
    miss = (tracked.speed - tracked.wanted_speed)[taken]
    return float(miss.mean()) / size, _rms(miss) / size


def settling_periods(tracked: Tracking, reference: Reference) -> tuple[float | None, str]:
    """Return the commanded periods until the speed stays within 10 %, for the slowest step, and a reason for None.

    A reference speed has steps if its class is `control.tracking.references.Steps`.
    """
    steps = _step_times(reference)
    if not steps:
        return None, "the reference speed has no step"
    longest = 0.0
    for begin, end in zip(steps, (*steps[1:], np.inf), strict=True):
        rows = (tracked.time >= begin) & (tracked.time < end - TIME_ROUNDING)  # the next speed begins at the end
        wanted = np.asarray(reference.speed(tracked.time[rows]), dtype=float)
        off = np.flatnonzero(np.abs(tracked.speed[rows] - wanted) > SETTLED * np.abs(wanted))
        waves = tracked.waves[rows]
        if len(waves) == 0 or (len(off) and off[-1] == len(waves) - 1):
            return None, f"the speed has not settled after the step at {begin:g} s"
        began = float(np.interp(begin, tracked.time, tracked.waves))
        longest = max(longest, float(waves[off[-1] + 1]) - began if len(off) else 0.0)
    return longest, ""


def joining_periods(tracked: Tracking, length: float) -> float | None:
    """Return the commanded periods until the offset stays within `WITHIN`; None if the offset never does.

    The count runs from the start of the run to the end of the first window from which on all windows are within. A worm
    that begins on its path has joined the path after 1.
    """
    off = np.flatnonzero(~(np.abs(tracked.cross_track) <= WITHIN * length))
    if len(off) == 0:
        return float(tracked.waves[0])
    return None if off[-1] == len(tracked.waves) - 1 else float(tracked.waves[off[-1] + 1])


def end_error(tracked: Tracking, reference: Reference, length: float) -> tuple[float | None, str]:
    """Return the greatest distance from the end of the path in the last seconds [body lengths], or a reason for None.

    There is no value if the worm does not have to stop there, or has not arrived and still has a reference speed.
    """
    if not reference.ends or reference.path is None:
        return None, "the reference has no end"
    last = tracked.time >= tracked.time[-1] - STAYED  # in seconds: a wave that stands still has no period
    if not (tracked.arriving & last)[last].all():
        return None, f"the worm has not been at the end of its path for {STAYED:g} s"
    off = np.linalg.norm(tracked.place[last] - reference.path.point(reference.path.length), axis=1)
    return float(off.max()) / length, ""


def _arriving(reference: Reference, window: _Window, place: FloatArray, wanted: FloatArray) -> Bools:
    """Return which windows end within the distance of three periods before the end of the path, or beyond the end."""
    path = reference.path
    if path is None or not reference.ends:
        return np.zeros(len(place), dtype=bool)
    near: Bools = track(path, place) >= path.length - DROPPED_PERIODS * np.abs(wanted) * (window.time - window.began)
    return np.logical_or.accumulate(near) & (wanted >= 0.0)


def _step_times(reference: Reference) -> Sequence[float]:
    return reference.speed.times if isinstance(reference.speed, Steps) else ()


def _beyond(window: _Window, motion: Motion, steps: Sequence[float]) -> Bools:
    """Return which windows lie beyond the excluded periods at the beginning and after steps [s]."""
    begins = [motion.time[0], *(t for t in steps if t <= motion.time[-1])]
    first = np.interp(begins, motion.time, motion.waves - motion.waves[0])
    since = np.searchsorted(np.asarray(begins) + TIME_ROUNDING, window.time, side="left") - 1
    return np.asarray(window.waves - 1.0 - first[np.maximum(since, 0)] >= DROPPED_PERIODS - 1e-9)


class _Window:
    """Moving windows of one commanded period, one for each instant after the first whole period."""

    def __init__(self, motion: Motion) -> None:
        rows = motion.waves - motion.waves[0] >= 1.0
        if not rows.any():
            raise ValueError("tracking: the run is shorter than one commanded period")
        self._all, self.rows = motion.time, rows
        self.time, self.waves = motion.time[rows], motion.waves[rows] - motion.waves[0]
        self.began = np.interp(self.waves - 1.0, motion.waves - motion.waves[0], motion.time)

    def at_begin(self, values: FloatArray) -> FloatArray:
        columns = [np.interp(self.began, self._all, column) for column in np.atleast_2d(values.T)]
        return np.array(columns).T.reshape(-1, *values.shape[1:])

    def mean(self, values: FloatArray) -> FloatArray:
        """Return (V1); the trapezoidal rule gives the integral."""
        steps = np.diff(self._all).reshape(-1, *(1,) * (values.ndim - 1))
        integral = np.cumsum(steps * (values[1:] + values[:-1]) / 2, axis=0)
        total = np.concatenate([np.zeros((1, *values.shape[1:])), integral])
        k = np.clip(np.searchsorted(self._all, self.began, side="right") - 1, 0, len(self._all) - 2)
        share = (self.began - self._all[k]).reshape(-1, *(1,) * (values.ndim - 1))
        part = share * (values[k] + self.at_begin(values)) / 2
        length = (self.time - self.began).reshape(share.shape)
        return np.asarray((total[self.rows] - total[k] - part) / length)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
