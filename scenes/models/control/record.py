"""A run with a controller as variables of a record: decisions, their sources, and estimates of the worm's state."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple

import numpy as np

import worm3d
from control.estimation.reduced import STATES, ReducedState
from control.loop import SOURCES, Decision
from control.tracking.detour import Detour
from control.tracking.metrics import Motion, Tracking, tracking
from control.tracking.paths import Path, SplinePath
from control.tracking.references import Reference
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

SERIES = ("time", "com", "heading", "joints")
OUTWARD = 2, 5
"""Numbers of the two apexes at the widest points of a segment, left and right."""
PATH_VARIABLE = "path"
"""Variable with the points of a user's own path."""
WAY = "way"
"""Variable with the points of the path around obstacles."""
STATE_NAMES = ", ".join(ReducedState._fields)


def variables_of(decisions: Sequence[Decision], waves: FloatArray) -> tuple[Variable, ...]:
    """Return the variables of a record for the decisions of a controller and for the commanded phase.

    `waves` is the phase at the stored instants, shape (T,) [waves].
    """
    texts = sorted({decision.status for decision in decisions})
    meant = "; ".join(f"{code}: {text or 'nothing to solve'}" for code, text in enumerate(texts))
    sources = "; ".join(f"{code}: {source}" for code, source in enumerate(SOURCES))
    each = ("decision",)
    return (
        Variable("waves", ("time",), waves, "1", "commanded phase, in waves"),
        Variable("decision_time", each, [d.time for d in decisions], "s", "from when on a decision is in force"),
        Variable("decision_source", each, [SOURCES.index(d.source) for d in decisions], "1", f"whose: {sources}"),
        Variable("decision_status", each, [texts.index(d.status) for d in decisions], "1", meant or "no decision"),
        Variable("decision_iterations", each, [d.iterations for d in decisions], "1", "iterations of the solver"),
        Variable("decision_cost", each, [d.cost for d in decisions], "1", "cost of the plan; NaN without one"),
        Variable(
            "decision_parameters",
            ("decision", "parameter"),
            np.array([astuple(d.parameters) for d in decisions]).reshape(-1, 4),
            "1",
            "asked for: amplitude, frequency [Hz], bias, hinge [rad]",
        ),
        *_estimates(decisions),
        *_horizon(decisions),
        *_chambers(decisions),
    )


def _estimates(decisions: Sequence[Decision]) -> tuple[Variable, ...]:
    known = [d.estimate for d in decisions if d.estimate is not None]
    if len(known) < len(decisions):
        return ()
    states = np.array([e.state for e in known], dtype=float).reshape(-1, STATES)
    bounds = np.array([e.deviations for e in known]).reshape(-1, STATES)
    nis = [np.nan if e.nis is None else e.nis for e in known]
    dims = ("decision", "state")
    return (
        Variable("estimate", dims, states, "SI", f"estimated {STATE_NAMES}"),
        Variable("estimate_deviation", dims, bounds, "SI", f"standard deviations of {STATE_NAMES}"),
        Variable("estimate_nis", ("decision",), nis, "1", "normalised innovation squared; NaN before the first sample"),
    )


def _horizon(decisions: Sequence[Decision]) -> tuple[Variable, ...]:
    """Return the predicted paths of the decisions as a variable; the row of a decision without prediction is NaN."""
    shape = next((d.horizon.shape for d in decisions if d.horizon is not None), None)
    if shape is None:
        return ()
    unknown = np.full(shape, np.nan)
    ways = [unknown if d.horizon is None or d.horizon.shape != shape else d.horizon for d in decisions]
    meaning = "predicted way of the centre of mass; NaN where nothing was predicted"
    return (Variable("horizon", ("decision", "ahead", "plane"), ways, "m", meaning),)


def _chambers(decisions: Sequence[Decision]) -> Iterator[Variable]:
    """Yield the estimated gains and phases of the chambers, if the controller estimates them."""
    for name, unit, meaning in (
        ("chamber_gain", "1", "gain of the chambers over a healthy worm's, as the controller finds it"),
        ("chamber_phase", "rad", "phase by which chambers are ahead of a healthy worm's, as the controller finds it"),
    ):
        known = [getattr(decision, name) for decision in decisions]
        if known and all(each is not None for each in known):
            yield Variable(name, ("decision", "segment", "chamber"), np.array(known), unit, meaning)


def timing_of(
    decisions: Sequence[Decision], steps: Sequence[float], dt: float, control_period: float
) -> tuple[Variable, ...]:
    """Return the computing time of the decisions, and statistics of the computing time per control period.

    `steps` are the computing times of all steps of the controller [s], and `dt` is the time step of the run. The
    statistics leave out the first control period, which contains the compilation.
    """
    if not steps:
        return ()
    seconds = np.bincount((np.arange(len(steps)) * dt / control_period + 1e-6).astype(int), steps)
    later = 1e3 * (seconds[1:] if len(seconds) > 1 else seconds)
    own = [d.seconds for d in decisions]
    return (
        Variable("control_step_s", ("decision",), own, "s", "wall time of a control step, estimates included"),
        Variable("control_step_ms_p50", (), np.percentile(later, 50.0), "ms", "median of the control steps"),
        Variable("control_step_ms_p99", (), np.percentile(later, 99.0), "ms", "99th percentile of the control steps"),
        Variable("overruns", (), int(np.sum(seconds > control_period)), "1", "control steps longer than their period"),
    )


def path_points(path: Path, com: FloatArray, spacing: float = 0.02) -> FloatArray:
    """Return points of a path for drawing, shape (P, 2) [m].

    If the path is infinite, the points cover the part that the worm passed and some more; `com` are the positions of
    the worm, shape (T, 2) [m].
    """
    ends = [float(path.project(place)) for place in (com[0], com[-1])]
    end = path.length if math.isfinite(path.length) else max(ends) + 1.0
    begin = 0.0 if math.isfinite(path.length) else min(ends) - 0.5
    return path.point(np.linspace(begin, end, max(2, math.ceil((end - begin) / spacing) + 1)))


def way_variables(path: Path | None) -> tuple[Variable, ...]:
    """Return the path around obstacles as a variable; empty if the worm did not follow such a path.

    The path is the last one that the controller computed.
    """
    if not isinstance(path, Detour):
        return ()
    return (Variable(WAY, ("station", "plane"), path.points, "m", "points of the way around the obstacles"),)


def path_variable(path: Path, com: FloatArray) -> Variable:
    """Return a user's own path as points, so that the run can be drawn later without the user's code."""
    return Variable(
        PATH_VARIABLE, ("place", "plane"), path_points(path, com), "m", "points of the path, a module's own"
    )


def stored_path(record: Record) -> Path | None:
    """Return the path through the points in a record, or None if the record has no such points.

    The path is closed if its last point is its first.
    """
    if PATH_VARIABLE not in record:
        return None
    points = record[PATH_VARIABLE]
    closed = len(points) > 3 and bool(np.linalg.norm(points[-1] - points[0]) < 1e-9)
    return SplinePath(points[:-1] if closed else points, closed)


def motion_of(result: worm3d.Result | Record, waves: FloatArray, outline: FloatArray | None = None) -> Motion:
    """Return the motion of the worm for the metrics.

    `waves` is the commanded phase at the instants of the result, shape (T,), and `outline` the result of `outline_of`.
    """
    time, com, heading, joints = (result[n] if isinstance(result, Record) else getattr(result, n) for n in SERIES)
    return Motion(time, com[:, :2], heading, waves, joints[:, -1, :2], outline)


def outline_of(result: worm3d.Result) -> FloatArray:
    """Return the corners of the outline of the body from above, in their order around it, shape (T, 2 N + 4, 2) [m].

    The corners are the outward apexes of both sides, which are the widest points of the segments, and the corners of
    the two end faces. The body is inside this polygon, since links and skin are narrower at the joints.
    """
    half = np.broadcast_to(result.worm.half_height, result.worm.segments)
    ends, across = result.joints[:, [0, -1], :2], result.directors[:, [0, -1], :2] * half[[0, -1], None]
    left, right = (result.apexes[:, :, apex, :2] for apex in OUTWARD)
    (tail_left, head_left), (tail_right, head_right) = (
        np.split(ends + side * across, 2, axis=1) for side in (1.0, -1.0)
    )
    return np.concatenate([tail_left, left, head_left, head_right, right[:, ::-1], tail_right], axis=1)


def tracked(record: Record, reference: Reference) -> Tracking | None:
    """Return how well the worm of a record followed the reference, or None if the run is shorter than a period."""
    waves = record["waves"]
    return tracking(motion_of(record, waves), reference) if waves[-1] - waves[0] >= 1.0 else None
