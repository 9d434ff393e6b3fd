"""Metrics of how well a run followed its reference. The definitions are those in worm3d/NOTATION.md.

Since a wave rocks the body, all quantities are averaged over a moving window of one commanded period. Let w(t) be the
commanded phase in waves. The window that ends at t begins at the time b with w(b) = w(t) - 1, and

    mean y (t) = 1/(t - b) int_b^t y,    velocity V = (x(t) - x(b))/(t - b)                                    (V1)

for the centre of mass x, the heading h and the offset e from the path. The speed is the component of V along the path's
tangent at the mean position, or without a path along the mean heading. The reference speed and the reference heading
are averaged over the same window.

Bias, rms and greatest values ignore windows that overlap the first three periods of the run. If the worm has to stop at
the end of the path, they also ignore windows from three periods before the end on. The metrics `..._settled_relative`
are a second bias and rms of the speed, which also ignore windows that overlap the three periods after a step of the
reference speed. The step itself is measured by the number of periods until the speed stays within 10 %.

The head is the foremost point of the worm. Its offset is defined by (L2), like the offset of the centre of mass, but
with its own projection. If a straight body of length L touches a circle of radius R tangentially, its head is
sqrt(R^2 + L^2/4) - R outside the circle.

The clearance of the body is the smallest distance between the outline, seen from above, and any obstacle, at any
instant of the run and without averaging. A negative clearance is the depth of the outline inside an obstacle.
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
"""Number of periods that are ignored at the beginning, and for `SETTLED_METRICS` also after a step."""
TIME_ROUNDING = 1e-6
"""Greatest difference between two times that count as equal [s]."""
SETTLED = 0.10
"""Relative error of the speed below which the speed has settled."""
SPEED_METRICS = ("speed_bias_relative", "speed_error_rms_relative")
SETTLED_METRICS = ("speed_bias_settled_relative", "speed_error_rms_settled_relative")
HEADING_METRICS = ("heading_error_mean_deg", "heading_error_rms_deg")
PATH_METRICS = ("cross_track_rms_bl", "cross_track_max_bl", "cross_track_mean_bl")
HEAD_METRICS = ("head_offset_rms_bl", "head_offset_max_bl")
WITHIN = 0.02
"""Greatest offset of a worm that counts as on the path [body lengths]."""
BODY_CLEARANCE = "body_clearance_min_bl"
RESPONSE_METRICS = ("speed_response_time_s", "heading_response_time_s")
METRICS = {
    "speed_bias_relative": "mean speed error, divided by the mean reference speed",
    "speed_error_rms_relative": "rms speed error, divided by the mean reference speed",
    "speed_bias_m_s": "mean speed error",
    "speed_bias_settled_relative": "speed_bias_relative without the three periods after each step of the reference",
    "speed_error_rms_settled_relative": "speed_error_rms_relative without the same periods",
    "heading_error_mean_deg": "mean heading error, positive to the left",
    "heading_error_rms_deg": "rms heading error",
    "cross_track_rms_bl": "rms distance of the centre of mass from the path",
    "cross_track_max_bl": "greatest distance of the centre of mass from the path",
    "cross_track_mean_bl": "mean distance of the centre of mass to the left of the path",
    "head_offset_rms_bl": "rms distance of the head from the path",
    "head_offset_max_bl": "greatest distance of the head from the path",
    "joining_periods": f"commanded periods until the worm stays within {WITHIN:g} body lengths of the path",
    "clearance_min_bl": "smallest distance of the averaged centre of mass from an obstacle or the edge of the corridor",
    BODY_CLEARANCE: "smallest distance of the outline of the body from an obstacle, negative inside",
    "end_error_bl": "greatest distance from the end of the path in the last seconds",
    "settling_periods": f"commanded periods until the speed stays within {SETTLED:.0%} after a step of the reference",
    "speed_response_time_s": "time from a step of the reference speed to 90 % of the step, longest of all steps",
    "heading_response_time_s": "time from a step of the reference heading to 90 % of the step, longest of all steps",
}
"""Meaning of each metric that `summary` returns, by name."""
STAYED = 4.0
"""Time at the end of the run during which the worm must be at the end of its path [s]. It is about three periods at 0.8
Hz."""
TOO_SHORT = f"the run is shorter than the {DROPPED_PERIODS:g} periods that are left out and one more"
UNSETTLED = f"no window lies beyond the {DROPPED_PERIODS:g} periods after each step of the reference speed"
REASONS = {
    **dict.fromkeys((*SPEED_METRICS, *SETTLED_METRICS), "the reference speed is 0"),
    **dict.fromkeys(HEADING_METRICS, "there is no heading and no path to keep to"),
    **dict.fromkeys((*PATH_METRICS, *HEAD_METRICS, "joining_periods"), "there is no path to follow"),
    "clearance_min_bl": "there is neither a corridor nor an obstacle",
    BODY_CLEARANCE: "there is no obstacle",
}
"""Reason for the missing value of a metric in a run that is long enough."""


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
    """Commanded phase, which does not decrease [waves], shape (T,)."""
    head: FloatArray | None = None
    """True position of the head [m], shape (T, 2). If it is None, the metrics of the head's offset are missing."""
    outline: FloatArray | None = None
    """Corners of the true outline of the body, in order [m], shape (T, C, 2). If it is None, the clearance is
    missing."""


@dataclass(frozen=True, eq=False)
class Tracking:
    """Motion of a worm compared with its reference, for K windows of one period, (V1)."""

    time: FloatArray
    """Ends of the windows [s], shape (K,)."""
    waves: FloatArray
    """Commanded phase at the ends of the windows [waves], shape (K,)."""
    place: FloatArray
    """Mean centre of mass [m], shape (K, 2)."""
    speed: FloatArray
    """Forward speed, in a rising pipe along its centre line [m/s], shape (K,)."""
    wanted_speed: FloatArray
    """Mean reference speed [m/s], shape (K,)."""
    heading: FloatArray
    """Mean heading [rad], shape (K,)."""
    wanted_heading: FloatArray
    """Heading of the path or the requested heading [rad], shape (K,). NaN without either."""
    cross_track: FloatArray
    """Mean offset to the left of the path [m], shape (K,). NaN without a path."""
    head_offset: FloatArray
    """Mean offset of the head to the left of the path [m], shape (K,). NaN if there is no path or the head is
    unknown."""
    arriving: Bools
    """Whether the worm is stopping at the end of its path in this window, shape (K,)."""
    counted: Bools
    """Whether the window enters the metrics, shape (K,)."""
    settled: Bools
    """Whether the window counts and lies outside the periods after steps of the reference speed, shape (K,)."""

    @property
    def heading_error(self) -> FloatArray:
        """Heading minus requested heading, within half a turn, shape (K,) [rad]."""
        return np.mod(self.heading - self.wanted_heading + np.pi, 2.0 * np.pi) - np.pi


def tracking(motion: Motion, reference: Reference) -> Tracking:
    """Compare the motion of a worm with a reference. ValueError if the run is shorter than one commanded period."""
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
    """Return the requested heading, the direction of the counted speed, and a factor of the speed, each of shape (K,).

    The requested heading is NaN without a path or heading. The factor is the length of a rising pipe divided by its
    length seen from above.
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
    """Return the mean offsets of places from the path, shape (K,). They are NaN without a path or places.

    `places` has the shape (T, 2).
    """
    if places is None or reference.path is None:
        return np.full(len(window.time), np.nan)
    return window.mean(offset(reference.path, places, track(reference.path, places)))


def measured(motion: Motion, reference: Reference, length: float) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return the metrics of a run of any length, and the reasons for missing values. See `summary`."""
    if motion.waves[-1] - motion.waves[0] < 1.0:
        found, reasons = dict[str, float | None].fromkeys(METRICS), dict.fromkeys(METRICS, TOO_SHORT)
    else:
        found, reasons = summary(tracking(motion, reference), reference, length)
    if reference.obstacles and motion.outline is not None:
        found[BODY_CLEARANCE] = float(clearances(motion.outline, reference).min()) / length
    return found, {**reasons, BODY_CLEARANCE: REASONS[BODY_CLEARANCE]}


def clearances(outline: FloatArray, reference: Reference) -> FloatArray:
    """Return the distances of outlines from the nearest obstacle, shape (T,) [m]. They are negative inside.

    `outline` has the shape (T, C, 2). The distances are evaluated at the corners and at seven points between two
    corners, which are 0.02 body lengths apart. The true distance from an obstacle of radius 0.05 body lengths is
    smaller by at most 0.001.
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
    """Store the response times (V2) in `metrics`, and return the reasons for missing values."""
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
    """Return bias and rms error of the speed over some windows.

    They are relative to the mean reference speed in the windows, and None if it is 0.
    """
    size = float(np.abs(tracked.wanted_speed[taken]).mean()) if taken.any() else 0.0
    if size == 0.0:
        return None, None
    miss = (tracked.speed - tracked.wanted_speed)[taken]
    return float(miss.mean()) / size, _rms(miss) / size


def settling_periods(tracked: Tracking, reference: Reference) -> tuple[float | None, str]:
    """Return the number of commanded periods until the speed stays within 10 %, for the slowest step.

    The second result is the reason if the number is None. Only the class `control.tracking.references.Steps` has steps.
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
    """Return the number of commanded periods until the offset stays within `WITHIN`. None if it never does.

    The periods are counted from the start of the run to the end of the first window after which no window exceeds
    `WITHIN`. The result is 1 for a worm that begins on its path, since the first window ends after one period.
    """
    off = np.flatnonzero(~(np.abs(tracked.cross_track) <= WITHIN * length))
    if len(off) == 0:
        return float(tracked.waves[0])
    return None if off[-1] == len(tracked.waves) - 1 else float(tracked.waves[off[-1] + 1])


def end_error(tracked: Tracking, reference: Reference, length: float) -> tuple[float | None, str]:
    """Return the greatest distance from the end of the path in the last seconds [body lengths].

    It is None, with a reason as the second result, if the worm does not have to stop at the end, or if it has not been
    at the end for long enough.
    """
    if not reference.ends or reference.path is None:
        return None, "the reference has no end"
    last = tracked.time >= tracked.time[-1] - STAYED  # in seconds: a wave that stands still has no period
    if not (tracked.arriving & last)[last].all():
        return None, f"the worm has not been at the end of its path for {STAYED:g} s"
    off = np.linalg.norm(tracked.place[last] - reference.path.point(reference.path.length), axis=1)
    return float(off.max()) / length, ""


def _arriving(reference: Reference, window: _Window, place: FloatArray, wanted: FloatArray) -> Bools:
    """Return a mask of the windows where the worm is stopping at the end of the path.

    It starts three periods before the end.
    """
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
    """Moving windows of one commanded period. There is one for each instant after the first whole period."""

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
        """Return (V1). The integral is computed by the trapezoidal rule."""
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
