"""A run on a robot as a record: a measurement in the format that `plot`, `compare`, `fit` and the page take."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from control.bridge.board import STATES, Board
from control.bridge.bridge import CHANNELS, Bridge, Ending
from control.bridge.packets import RESTING, Refusal, shape
from control.sensing.sensors import QUANTITIES
from control.tracking.metrics import Motion, measured
from scenes.models.control.model import Phased
from scenes.models.control.record import timing_of, variables_of
from scenes.models.control.reference import reference_of
from scenes.models.loading import Scene
from scenes.models.worlds.build import world_of
from scenes.models.worm.build import worm_of
from scenes.records.measured import MEASURED_MODEL, as_scene
from scenes.records.record import Cell, Metric, Record, Summary, fault_row
from scenes.running.packages import versions
from worm3d.results.files import plain
from worm3d.values.arrays import FloatArray
from worm3d.values.variable import Variable

NAMES = {"strain": "chamber_length", "pressure": "actuator_pressure"}
"""Names of series for the channels whose series in a simulation has another name. A strain becomes a length."""
DIMS = {2: ("segment", "chamber"), 3: ("segment", "axis"), 6: ("segment", "apex")}
MEASURED_FILE, COMMANDS_FILE = "measured.csv", "commands.csv"
FITTED = ("time", "com", "heading", "chamber_length", "actuator_pressure")
"""Series of the file that `worm3d fit --to` takes."""
LOOK = "look at the cable or the radio, and at the load of both computers"
NO_MOTION = "too few samples have come, or the robot has no such sensor"


def record_of(scene: Scene, bridge: Bridge, ending: Ending, driver: Phased | None) -> Record:
    """Return the record of a run on a robot; `driver` is the controller, None for a gait."""
    board, given = bridge.board, scene.settings
    time, series = samples(board)
    worm = worm_of(given)
    if "strain" in series:
        series["strain"] = worm.l0 * (1.0 + series["strain"])
    known = _estimated_heading(time, series, driver)
    told = commanded(board, ending.ticks)
    tick = np.clip((time / bridge.period).astype(int), 0, max(len(told) - 1, 0))
    arrays: list[np.ndarray] = []
    text = json.dumps({"worm": plain(worm, arrays), "world": plain(world_of(given.world), arrays)})
    metrics, reasons = _metrics(scene, time, series, driver)
    decisions = driver.controller.decisions if driver else []
    return Record(
        name=scene.name,
        model=MEASURED_MODEL,
        scene=as_scene({"title": f"{scene.name} on a robot", "scene": scene.to_toml()}),
        status=ending.status,
        sentence=ending.sentence,
        seed=given.seed,
        versions=versions(),
        summary=Summary(
            {
                "status": ending.status,
                "duration_s": ending.ticks * bridge.period,
                **metrics,
                **_link(bridge, ending.ticks),
                "faults": sorted(_faults(bridge, ending.ticks), key=lambda row: float(row["time_s"] or 0.0)),
            },
            {**reasons, **dict.fromkeys(LINK_FIGURES, "no sample has come")},
        ),
        variables=(
            Variable("time", ("time",), time, "s", "time"),
            *(_variable(name, values, known) for name, values in series.items()),
            *_commands("command", told[tick], board.segments),
            *(variables_of(decisions, _waves(driver, time, bridge.period)) if driver else ()),
            Variable("round_trip", ("time",), _per_row(board, "round_trip"), "s", "latest round trip of packets"),
            Variable("tick_time", ("tick",), bridge.period * np.arange(len(told)), "s", "instants of the commands"),
            Variable("tick_lateness", ("tick",), board.sent[: len(told), 0], "s", "by how much a packet left late"),
            Variable("tick_sent", ("tick",), board.sent[: len(told), 1], "1", f"what was sent: {_codes()}"),
            Variable("sent", ("tick", "number"), told, "SI", "contractions [left, right], hinge angles [rad]"),
        ),
        timing=timing_of(decisions, driver.seconds, bridge.period, given.controller.period_s) if driver else (),
        run=text,
        parts=tuple(
            Variable(f"array_{k}", tuple(f"array_{k}_{n}" for n in range(each.ndim)), each, "SI", "of worm or world")
            for k, each in enumerate(arrays)
        ),
    )


def _codes() -> str:
    return "; ".join(f"{code}: {name}" for code, name in enumerate(STATES))


def samples(board: Board) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the instants of the samples, shape (T,) [s], and the channels that have come, each of shape (T, ...).

    A channel is NaN at an instant without a sample of it.
    """
    order = np.argsort(board.head("taken"), kind="stable")
    time, first = np.unique(board.head("taken")[order], return_index=True)
    found = {name: board.values(name)[order] for name in CHANNELS}
    return time, {
        name: np.fmax.reduceat(values, first, axis=0) if len(first) else values
        for name, values in found.items()
        if np.isfinite(values).any()
    }


def _per_row(board: Board, column: str) -> FloatArray:
    """Return a column of the samples at the instants of `samples`."""
    order = np.argsort(board.head("taken"), kind="stable")
    first = np.unique(board.head("taken")[order], return_index=True)[1]
    kept: FloatArray = board.head(column)[order][first]
    return kept


def commanded(board: Board, ticks: int) -> FloatArray:
    """Return the commands that were sent at the ticks, shape (K, 3 N - 1); 0 where the robot was told to rest."""
    state = board.sent[:ticks, 1].astype(int)
    planned = state == STATES.index("planned")
    latest = np.maximum.accumulate(np.where(planned, np.arange(ticks), -1)) if ticks else np.zeros(0, dtype=int)
    moving = (latest >= 0) & (state <= STATES.index("held"))
    sent: FloatArray = np.where(moving[:, None], board.commands[latest], 0.0)
    return sent


def _commands(name: str, rows: FloatArray, segments: int) -> Iterator[Variable]:
    """Yield the contractions and hinge angles of commands, shape (T, 3 N - 1)."""
    chambers = rows[:, : 2 * segments].reshape(-1, *shape("contraction", segments))
    yield Variable(
        name, ("time", "segment", "chamber"), chambers, "1", "contraction asked of each chamber [left, right]"
    )
    yield Variable(
        "hinge", ("time", "inner_joint"), rows[:, 2 * segments :], "rad", "hinge angle asked at joints 1 to N-1"
    )


def _variable(name: str, values: FloatArray, known: str) -> Variable:
    quantity, inner = QUANTITIES[name], values.shape[1:]
    dims = DIMS[inner[-1]] if len(inner) == 2 else ("axis",) if inner else ()
    unit = "m" if name == "strain" else quantity.unit or "1"
    meaning = "length of each chamber [left, right]" if name == "strain" else quantity.meaning
    return Variable(
        NAMES.get(name, name), ("time", *dims), values, unit, f"{meaning}{known if name == 'heading' else ''}"
    )


def _estimated_heading(time: FloatArray, series: dict[str, FloatArray], driver: Phased | None) -> str:
    """Add the controller's estimate of the heading if the robot has no compass; return an addition to its meaning."""
    known = [] if driver is None else [d for d in driver.controller.decisions if d.estimate is not None]
    if "heading" in series or not known:
        return ""
    found = [float(d.estimate.state.heading) for d in known if d.estimate is not None]
    series["heading"] = np.interp(time, [d.time for d in known], np.unwrap(found))
    return ", as the controller estimates it"


def _waves(driver: Phased, time: FloatArray, period: float) -> FloatArray:
    waves = driver.waves or [0.0]
    found: FloatArray = np.interp(time, period * np.arange(len(waves)), waves)
    return found


def _metrics(
    scene: Scene, time: FloatArray, series: dict[str, FloatArray], driver: Phased | None
) -> tuple[dict[str, Metric], dict[str, str]]:
    """Return the way of the robot, and for a controller the metrics of its reference, by the measured place."""
    names = ("distance_m", "mean_speed_m_s")
    place = series.get("com", np.zeros((0, 3)))
    seen = np.flatnonzero(np.isfinite(place).all(axis=1))
    if len(seen) < 2 or "heading" not in series:
        return dict.fromkeys(names), dict.fromkeys(names, NO_MOTION)
    heading = series["heading"]
    azimuth = np.interp(time[seen], time[np.isfinite(heading)], np.unwrap(heading[np.isfinite(heading)]))
    forward = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    com = place[seen][:, :2]
    way = float((com[-1] - com[0]) @ forward[0])
    found: dict[str, Metric] = dict(zip(names, (way, way / float(np.ptp(time[seen]))), strict=True))
    if driver is None:
        return found, {}
    reference, length = reference_of(scene.settings), scene.settings.worm.length_m
    waves = _waves(driver, time[seen], scene.settings.run.dt_s)
    figures, reasons = measured(
        Motion(time[seen], com, azimuth, waves, com + length / 2.0 * forward, None), reference, length
    )
    return {**found, **figures}, reasons


LINK_FIGURES = {
    "deadlines_kept": "share of the ticks whose packet left before the next tick",
    "lateness_ms_p99": "99th percentile of the lateness of packets",
    "commands_held": "ticks that repeated a command or sent REST, since the controller was late",
    "samples": "samples that have come",
    "round_trip_ms_p50": "median of the round trips",
    "round_trip_ms_p99": "99th percentile of the round trips",
    "sessions": "sessions: 1, and one more after each silence of the robot",
    "packets_refused": "packets of the robot that were refused",
}
"""Figures of the link in the summary, with their meanings."""


def _link(bridge: Bridge, ticks: int) -> dict[str, Metric]:
    board = bridge.board
    lateness, state = board.sent[:ticks].T
    trips = board.head("round_trip") if board["seen"] else np.array([np.nan])
    values = (
        float(np.mean((state > 0) & (lateness <= bridge.period))) if ticks else math.nan,
        1e3 * float(np.percentile(lateness, 99.0)) if ticks else math.nan,
        int(np.isin(state, [STATES.index("held"), STATES.index("rest")]).sum()),
        int(board["seen"]),
        *(1e3 * float(np.percentile(trips, each)) for each in (50.0, 99.0)),
        int(board["sessions"]),
        sum(int(board[each.name]) for each in Refusal),
    )
    return dict(zip(LINK_FIGURES, values, strict=True))


def _faults(bridge: Bridge, ticks: int) -> Iterator[dict[str, Cell]]:
    """Yield rows for silences of the robot, rests of its watchdog, and refused packets."""
    board = bridge.board
    arrived = np.concatenate([[0.0], board.head("arrived"), [ticks * bridge.period]])
    for k in np.flatnonzero(np.diff(arrived) > bridge.silence):
        what = f"no sample has come for {arrived[k + 1] - arrived[k]:.2f} s"
        yield fault_row(float(arrived[k]), "silent robot", what, LOOK)
    resting = board.head("flags").astype(int) & RESTING > 0
    told = np.clip((board.head("arrived") / bridge.period).astype(int), 0, max(ticks - 1, 0))
    wanted = board.sent[told, 1] <= STATES.index("held")
    if (rested := np.flatnonzero(resting & wanted & (board.head("arrived") > bridge.silence))).size:
        what = f"the robot rested in {len(rested)} samples, since no command had reached it"
        yield fault_row(float(board.head("arrived")[rested[0]]), "robot at rest", what, LOOK)
    if refused := bridge.refusals():
        yield fault_row(0.0, "refused packets", f"packets of the robot were refused: {refused}", LOOK)


def tables(record: Record) -> dict[str, Record]:
    """Return tables of a run by the name of their file: the measurement for a fit, and the commands for a replay."""
    measurement = [variable for variable in record.variables if variable.name in FITTED]
    estimated = [each for each in measurement if each.long_name.endswith("estimates it")]
    sent, segments = record["sent"], record["command"].shape[1]
    time = Variable("time", ("time",), record["tick_time"], "s", "time")
    commands = next(_commands("contraction", sent, segments))
    return {
        MEASURED_FILE: replace(record, variables=tuple(each for each in measurement if each not in estimated)),
        COMMANDS_FILE: replace(record, variables=(time, commands)),
    }


def lines(record: Record) -> Iterator[str]:
    """Yield lines with the main figures of a run for the terminal."""
    for name in ("distance_m", "cross_track_rms_bl", *LINK_FIGURES):
        if record.summary.metrics.get(name) is not None:
            yield f"{name:22}{record.summary[name]:.6g}"
