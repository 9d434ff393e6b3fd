"""Figures of a run with a controller, drawn from its record. The name of each function is the name of the file."""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from control.estimation.reduced import ReducedState
from control.loop import SOURCES
from control.tracking.metrics import SETTLED, Tracking
from control.tracking.references import Reference
from scenes.models.control.record import WAY, path_points, tracked
from scenes.models.control.reference import speed_of
from scenes.models.control.schema import ControlScene
from scenes.models.control.view import reference_seen
from scenes.models.panels import at_least, ends, from_above, stacked
from scenes.models.worm.view import scene_of
from scenes.records.record import Record
from worm3d.values.arrays import FloatArray

BOUND = 2.0
"""Half of the width of the bounds around an estimate [standard deviations]."""

STATE_UNITS = ("m", "m", "deg", "m/s", "deg/s", "1", "deg/s", "m/s", "", "1", "deg")
"""Unit of each entry of the estimated state in the figures."""


def tracking(record: Record) -> tuple[Figure, Axes]:
    """Draw the path of the worm and the desired path from above, and both errors over time.

    The errors are the distance from the desired path and the heading error.
    """
    seen, (figure, (way, aside, turned)) = _tracked(record), stacked(8.0, (2.2, 1, 1), shared=False)
    _from_above(way, record, seen)
    if seen is not None:
        aside.plot(seen.time, 1e3 * seen.cross_track, color="C0")
        turned.plot(seen.time, np.rad2deg(seen.heading_error), color="C0")
    for axes, label, span in ((aside, "left of the path [mm]", 20.0), (turned, "heading error [deg]", 4.0)):
        axes.axhline(0.0, color="0.6", lw=0.8)
        axes.set(ylabel=label, xlim=record["time"][[0, -1]])
        at_least(axes, span)
        if seen is not None:
            _shade(axes, seen)
        _mark_faults(axes, record)
    figure.legend(*way.get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=7)
    turned.set_xlabel("time [s]  (means over a period; grey: not counted)")
    return figure, way


def _from_above(axes: Axes, record: Record, seen: Tracking | None) -> None:
    """Draw the desired path with its bounds, and the motion of the worm.

    The motion is shown by the centre of mass, its mean over a period, the estimated position, and the body at the start
    and at the end.
    """
    reference, com = reference_seen(record, _scene(record)), record["com"][:, :2]
    if reference.path is not None:
        line = path_points(reference.path, com)
        axes.plot(*line.T, color="0.6", lw=3, alpha=0.6, label="path")
        _bounds(axes, reference, line)
    if WAY in record:
        axes.plot(*record[WAY].T, color="C2", lw=1.2, ls="--", label="way around obstacles")
    axes.plot(*com.T, color="C0", lw=0.6, alpha=0.6, label="centre of mass")
    ends(axes, record["joints"])
    if "estimate" in record:
        axes.plot(*record["estimate"][:, :2].T, color="C3", lw=0.9, label="estimate")
    if seen is not None:
        axes.plot(*seen.place.T, color="C0", lw=1.6, label="its mean over a period")
    from_above(axes)
    axes.set_title(f"{record.title}: seen from above")


def _bounds(axes: Axes, reference: Reference, line: FloatArray) -> None:
    """Draw the obstacles and the edges of the corridor around the path; `line` has the points of the path, (P, 2)."""
    for k, obstacle in enumerate(reference.obstacles):
        label = None if k else "obstacle"
        axes.fill(*obstacle.outline().T, color="C1", alpha=0.3, lw=0, label=label)
    if np.isfinite(reference.corridor):
        along = np.gradient(line, axis=0)
        left = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        for side, label in ((1.0, "corridor"), (-1.0, None)):
            axes.plot(*(line + side * reference.corridor * left).T, color="C1", lw=0.8, ls="--", label=label)


def speed_and_heading(record: Record) -> tuple[Figure, Axes]:
    """Draw speed and heading, averaged over a period, with the desired and the estimated values."""
    seen, (figure, (speed, heading)) = _tracked(record), stacked(5.6, (1, 1))
    _speed(speed, record, seen)
    _heading(heading, record, seen)
    speed.set(ylabel="speed [m/s]", title=f"{record.title}: speed and heading", xlim=record["time"][[0, -1]])
    heading.set_ylabel("heading [deg]")
    for axes in (speed, heading):
        if axes.lines:
            axes.legend(fontsize=7)
    return figure, speed


def _speed(axes: Axes, record: Record, seen: Tracking | None) -> None:
    time = record["time"]
    wanted = np.asarray(speed_of(_scene(record).reference)(time), dtype=float)
    axes.fill_between(time, (1 - SETTLED) * wanted, (1 + SETTLED) * wanted, color="0.85", lw=0, label="10 % of it")
    axes.plot(time, wanted, color="0.4", lw=1.2, label="asked for")
    if "estimate" in record:
        state, bound = record["estimate"], BOUND * record["estimate_deviation"]
        kept, k = 1.0 - state[:, _index("slip")], _index("speed")
        _band(axes, record["decision_time"], kept * state[:, k], kept * bound[:, k])
    if seen is not None:
        axes.plot(seen.time, seen.speed, color="C0", label="worm, mean over a period")
        axes.set_ylim(min(0.0, float(seen.speed.min())), 1.35 * max(float(wanted.max()), float(seen.speed.max())))


def _heading(axes: Axes, record: Record, seen: Tracking | None) -> None:
    if "estimate" in record:
        bound = BOUND * record["estimate_deviation"][:, _index("heading")]
        true = np.interp(record["decision_time"], record["time"], record["heading"])
        turn = _same_turn(record["estimate"][:, _index("heading")], true)
        _band(axes, record["decision_time"], np.rad2deg(turn), np.rad2deg(bound))
    if seen is not None:
        axes.plot(seen.time, np.rad2deg(seen.heading), color="C0", label="worm, mean over a period")
        if np.isfinite(seen.wanted_heading).all():
            asked = seen.heading - seen.heading_error
            axes.plot(seen.time, np.rad2deg(asked), color="0.4", lw=1.2, label="asked for")
        axes.set_ylim(*_around(np.rad2deg(seen.heading)))


def commands(record: Record) -> tuple[Figure, Axes]:
    """Draw the commanded parameters of the gait; the colour shows which part of the controller gave the command."""
    figure, rows = stacked(6.4, (2, 2, 2, 1))
    amplitude, frequency, bias, hinge = record["decision_parameters"].T
    steers = ("hinge [deg]", np.rad2deg(hinge)) if np.any(hinge) or not np.any(bias) else ("bias", bias)
    time, source = record["decision_time"], record["decision_source"]
    shown = (("amplitude", amplitude), ("frequency [Hz]", frequency), steers)
    for axes, (label, values) in zip(rows, shown, strict=False):
        axes.step(time, values, where="post", color="0.7", lw=0.8)
        for code in np.unique(source):
            of = source == code
            axes.plot(time[of], values[of], ".", ms=3, color=f"C{code}", label=f"{SOURCES[code]} ({int(of.sum())})")
        axes.set_ylabel(label)
    rows[0].legend(fontsize=7)
    rows[3].step(time, record["decision_iterations"], where="post", color="0.3", lw=0.8)
    rows[3].set(ylabel="iterations", xlim=record["time"][[0, -1]])
    rows[0].set_title(f"{record.title}: commands and whose they are")
    return figure, rows[0]


def estimates(record: Record) -> tuple[Figure, Axes]:
    """Draw the estimates with their bounds, and the normalised innovations.

    For the pose (x, y and heading) the error of the estimate is drawn instead of the estimate.
    """
    figure = Figure(figsize=(11.0, 7.0), layout="constrained", dpi=120)
    grid = figure.subplots(3, 4, sharex=True)
    if "estimate" not in record:
        grid[0, 0].set_title(f"{record.title}: this controller estimates nothing", fontsize=9)
        return figure, grid[0, 0]
    time, state, bound = record["decision_time"], record["estimate"], BOUND * record["estimate_deviation"]
    seen = _tracked(record)
    for k, (axes, name, unit) in enumerate(zip(grid.flat, ReducedState._fields, STATE_UNITS, strict=False)):
        scale = np.rad2deg(1.0) if unit.startswith("deg") else 1.0
        values = state[:, k]
        if k < 3:
            values, name = values - _true(record, seen, time, k, values), f"{name}, error"
        _band(axes, time, scale * values, scale * bound[:, k])
        axes.axhline(0.0, color="0.6", lw=0.8)
        axes.set_ylabel(f"{name.replace('_', ' ')}{unit and f' [{unit}]'}", fontsize=8)
        axes.set_ylim(*_around(scale * values[len(values) // 4 :], float(scale * np.median(bound[:, k]))))
    last: Axes = grid[2, 3]
    last.plot(time, record["estimate_nis"], ".", ms=2, color="C3")
    last.axhline(5.99, color="0.4", lw=0.8)  # quantile of chi squared with two degrees of freedom
    last.set_ylabel("normalised innovation\nsquared; line: 95 %", fontsize=8)
    for axes in grid[-1]:
        axes.set(xlabel="time [s]", xlim=record["time"][[0, -1]])
    for axes in grid.flat:
        axes.grid(alpha=0.3)
    figure.suptitle(f"{record.title}: estimates with bounds of {BOUND:g} standard deviations", fontsize=10)
    return figure, grid[0, 0]


def control_steps(record: Record) -> tuple[Figure, Axes]:
    """Draw the computing time of the control steps in comparison with the control period."""
    figure, (axes,) = stacked(3.4)
    seconds = next((v.values for v in record.timing if v.name == "control_step_s"), np.zeros(0))
    period = _scene(record).controller.period_s
    axes.semilogy(record["decision_time"], np.maximum(1e3 * seconds, 1e-3), ".", ms=4)
    axes.axhline(1e3 * period, color="C3", lw=1.0, label="control period")
    axes.axhline(1e2 * period, color="C3", lw=1.0, ls="--", label="a tenth of it")
    axes.set(ylabel="wall time of a control step [ms]", title=f"{record.title}: control steps")
    axes.legend(fontsize=7)
    return figure, axes


def _scene(record: Record) -> ControlScene:
    scene = scene_of(record)
    assert isinstance(scene, ControlScene)
    return scene


def _tracked(record: Record) -> Tracking | None:
    return tracked(record, reference_seen(record, _scene(record)))


def _index(name: str) -> int:
    return ReducedState._fields.index(name)


def _true(record: Record, seen: Tracking | None, time: FloatArray, k: int, estimated: FloatArray) -> FloatArray:
    """Return entry k of the true pose (x, y or heading) at the given instants, averaged over the surrounding period.

    Values without a known whole period are NaN. A heading is shifted by whole turns to be near `estimated`.
    """
    if seen is None:
        return np.full(len(time), np.nan)
    middle = seen.time - 0.5 * (
        seen.time - np.interp(seen.waves - 1.0, record["waves"] - record["waves"][0], record["time"])
    )
    values = seen.heading if k == _index("heading") else seen.place[:, k]
    at = np.interp(time, middle, values, left=np.nan, right=np.nan)
    return _same_turn(at, estimated) if k == _index("heading") else at


def _same_turn(angle: FloatArray, other: FloatArray) -> FloatArray:
    """Return the angles [rad], shifted by whole turns to be within half a turn of the other angles."""
    moved: FloatArray = angle - 2.0 * np.pi * np.round((angle - other) / (2.0 * np.pi))
    return moved


def _band(axes: Axes, time: FloatArray, values: FloatArray, bound: FloatArray) -> None:
    axes.fill_between(time, values - bound, values + bound, color="C3", alpha=0.2, lw=0)
    axes.plot(time, values, color="C3", lw=0.9, label="estimate")


def _shade(axes: Axes, seen: Tracking) -> None:
    """Mark the times that the metrics leave out."""
    low, high = axes.get_ylim()
    axes.fill_between(seen.time, low, high, where=~seen.counted, color="0.9", lw=0, zorder=0)
    axes.set_ylim(low, high)


def _mark_faults(axes: Axes, record: Record) -> None:
    """Mark the detection times of faults."""
    for when, rows in groupby(record.summary.faults, key=itemgetter("time_s")):
        time, kinds = float(when or 0.0), ", ".join(str(row["kind"]) for row in rows)
        axes.axvline(time, color="C3", lw=0.8, ls=":")
        axes.annotate(
            kinds, (time, 0.97), xycoords=axes.get_xaxis_transform(), rotation=90, va="top", ha="right", size=6
        )


def _around(values: FloatArray, least: float = 1.0) -> tuple[float, float]:
    """Return limits of an axis that show all values, with a margin of at least `least`."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 0.0)
    room = 0.15 * (high - low) + max(least, 1e-6)
    return low - room, high + room
