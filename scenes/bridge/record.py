"""A run on a robot as a record: a measurement in the format that `plot`, `compare`, `fit` and the page take."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from control.bridge.board import STATES, Board
from control.bridge.bridge import SILENCE, Bridge, Ending
from control.bridge.packets import CHANNELS, RESTING, Refusal, shape
from control.estimation.estimate import HEADING
from control.loop import MAX_HEADING_DEVIATION
from control.sensing.sensors import QUANTITIES
from control.tracking.metrics import Motion, measured
from scenes.models.control.play import Phased
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
"""Names of the series of a simulation for the channels that have other names. A strain becomes a length."""
DIMS = {2: ("segment", "chamber"), 3: ("segment", "axis"), 6: ("segment", "apex")}
MEASURED_FILE, COMMANDS_FILE = "measured.csv", "commands.csv"
FITTED = ("time", "com", "heading", "chamber_length", "actuator_pressure")
"""Series of the file that `worm3d fit --to` takes."""
ESTIMATED = "heading, as the controller estimates it"
LOOK = "look at the cable or the radio, and at the load of both computers"
NO_MOTION = "too few samples have come, or the robot has no such sensor"
MANY_REFUSED = 0.01
"""Share of refused packets above which a run warns. Jitter alone overtakes a few packets, which are then too old."""
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


def record_of(scene: Scene, bridge: Bridge, ending: Ending, driver: Phased | None) -> Record:
    """Return the record of a run on a robot; `driver` is the controller, None for a gait."""
    board, given = bridge.board, scene.settings
    ticks = 1 + int(np.flatnonzero(board.sent[: ending.ticks, 1]).max(initial=-1))  # later ones were only planned
    time, series = samples(board)
    worm, decisions = worm_of(given), driver.controller.decisions if driver else []
    meanings = {name: QUANTITIES[name].meaning for name in series}
    if "strain" in series:
        series["strain"] = worm.l0 * (1.0 + series["strain"])
        meanings["strain"] = "length of each chamber [left, right]"
    if driver and "heading" not in series and (known := _estimated(driver)):
        series["heading"], meanings["heading"] = np.interp(time, *known), ESTIMATED
    told = commanded(board, ticks)
    tick = np.clip((time / bridge.period).astype(int), 0, max(ticks - 1, 0))
    waves = np.interp(time, bridge.period * np.arange(len(driver.waves)), driver.waves) if driver else np.zeros(0)
    metrics, reasons = _metrics(scene, time, series, waves if driver else None)
    arrays: list[NDArray[np.float64]] = []
    text = json.dumps({"worm": plain(worm, arrays), "world": plain(world_of(given.world), arrays)})
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
                "duration_s": ticks * bridge.period,
                **metrics,
                **_link(bridge, ticks),
                "faults": list(_faults(bridge, ticks)),
            },
            {**reasons, **dict.fromkeys(LINK_FIGURES, "no packet has been sent or received")},
        ),
        variables=(
            Variable("time", ("time",), time, "s", "time"),
            *(_variable(name, values, meanings[name]) for name, values in series.items()),
            *_commands("command", told[tick], board.segments),
            *(variables_of(decisions, waves) if driver else ()),
            Variable("sent_time", ("sent",), bridge.period * np.arange(ticks), "s", "instants of the commands"),
            Variable("sent_late", ("sent",), board.sent[:ticks, 0], "s", "lateness of their packets"),
            Variable("sent", ("sent", "number"), told, "SI", "contractions [left, right], hinge angles [rad]"),
        ),
        timing=timing_of(decisions, driver.seconds, bridge.period, given.controller.period_s) if driver else (),
        run=text,
        parts=tuple(
            Variable(f"array_{k}", tuple(f"array_{k}_{n}" for n in range(each.ndim)), each, "SI", "of worm or world")
            for k, each in enumerate(arrays)
        ),
    )


def samples(board: Board) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the instants of the samples, shape (T,) [s], and the channels that have come, each of shape (T, ...).

    A channel is NaN at an instant without a sample of it.
    """
    taken = board.head("taken")
    order = np.argsort(taken, kind="stable")
    order = order[taken[order] >= 0.0]  # the first samples may be from before the run
    time, first = np.unique(taken[order], return_index=True)
    found = {name: board.values(name)[order] for name in CHANNELS}
    come = {name: values for name, values in found.items() if np.isfinite(values).any()}
    return time, {name: np.fmax.reduceat(values, first, axis=0) for name, values in come.items()}


def commanded(board: Board, ticks: int) -> FloatArray:
    """Return the commands in force at the ticks, shape (K, 3 N - 1); 0 where the robot was told to rest.

    At a tick without a packet, the packet before it is in force.
    """
    state, row = board.sent[:ticks, 1:].astype(int).T
    latest = np.maximum.accumulate(np.where(state > 0, np.arange(ticks), 0))
    moving = np.isin(state[latest], (STATES.index("planned"), STATES.index("held")))
    sent: FloatArray = np.where(moving[:, None], board.commands[row[latest]], 0.0)
    return sent


def _commands(name: str, rows: FloatArray, segments: int) -> Iterator[Variable]:
    """Yield the contractions and hinge angles of commands, shape (T, 3 N - 1)."""
    chambers = rows[:, : 2 * segments].reshape(-1, *shape("contraction", segments))
    meaning = "contraction asked of each chamber [left, right]"
    yield Variable(name, ("time", "segment", "chamber"), chambers, "1", meaning)
    yield Variable("hinge", ("time", "inner_joint"), rows[:, 2 * segments :], "rad", "hinge angle asked at joints")


def _variable(name: str, values: FloatArray, meaning: str) -> Variable:
    inner = values.shape[1:]
    dims = DIMS[inner[-1]] if len(inner) == 2 else ("axis",) if inner else ()
    unit = "m" if name == "strain" else QUANTITIES[name].unit or "1"
    return Variable(NAMES.get(name, name), ("time", *dims), values, unit, meaning)


def _estimated(driver: Phased) -> tuple[FloatArray, FloatArray] | None:
    """Return the instants [s] and headings [rad] of the controller's estimates from when on the heading is known."""
    given = [(d.time, d.estimate) for d in driver.controller.decisions if d.estimate is not None]
    known = [(t, each.state.heading) for t, each in given if each.deviations[HEADING] < MAX_HEADING_DEVIATION]
    found = np.array(known, dtype=float).reshape(-1, 2)
    return (found[:, 0], np.unwrap(found[:, 1])) if known else None


def _metrics(
    scene: Scene, time: FloatArray, series: dict[str, FloatArray], waves: FloatArray | None
) -> tuple[dict[str, Metric], dict[str, str]]:
    """Return the way of the robot, and for a controller the metrics of its reference, by the measured place."""
    place, heading = series.get("com", np.zeros((0, 3)))[:, :2], series.get("heading", np.zeros(0))
    seen, known = np.flatnonzero(np.isfinite(place).all(axis=1)), np.isfinite(heading)
    if len(seen) < 2 or not known.any():
        return {"distance_m": None}, {"distance_m": NO_MOTION}
    azimuth = np.interp(time[seen], time[known], np.unwrap(heading[known]))
    forward, com = np.column_stack([np.cos(azimuth), np.sin(azimuth)]), place[seen]
    found: dict[str, Metric] = {"distance_m": float((com[-1] - com[0]) @ forward[0])}
    if waves is None:
        return found, {}
    length = scene.settings.worm.length_m
    motion = Motion(time[seen], com, azimuth, waves[seen], com + length / 2.0 * forward, None)
    figures, reasons = measured(motion, reference_of(scene.settings), length)
    return {**found, **figures}, reasons


def _link(bridge: Bridge, ticks: int) -> dict[str, Metric]:
    board = bridge.board
    lateness, state, _ = board.sent[:ticks].T
    late = STATES.index("held"), STATES.index("rest")
    values = (
        float(np.mean((state > 0) & (lateness <= bridge.period))) if ticks else math.nan,
        _percentile(lateness[state > 0], 99.0),
        int(np.isin(state, late).sum()),
        int(board["seen"]),
        *(_percentile(board.head("round_trip"), each) for each in (50.0, 99.0)),
        int(board["sessions"]),
        sum(int(board[each.name]) for each in Refusal),
    )
    return dict(zip(LINK_FIGURES, values, strict=True))


def _percentile(seconds: FloatArray, share: float) -> float:
    return 1e3 * float(np.percentile(seconds, share)) if len(seconds) else math.nan


def _faults(bridge: Bridge, ticks: int) -> Iterator[dict[str, Cell]]:
    """Yield rows for silences of the robot, rests of its watchdog, and refused packets."""
    board = bridge.board
    arrived = np.array([0.0, *board.head("arrived"), ticks * bridge.period])
    for k in np.flatnonzero(np.diff(arrived) > SILENCE):
        what = f"no sample has come for {arrived[k + 1] - arrived[k]:.2f} s"
        yield fault_row(float(arrived[k]), "silent robot", what, LOOK)
    arrived = arrived[1:-1]
    tick = np.clip((arrived / bridge.period).astype(int), 0, max(ticks - 1, 0))
    moving = board.sent[tick, 1] <= STATES.index("held")
    rested = (board.head("flags").astype(int) & RESTING > 0) & moving & (arrived > SILENCE)
    if rested.any():
        what = f"the robot rested in {rested.sum()} samples, since no command had reached it"
        yield fault_row(float(arrived[np.argmax(rested)]), "robot at rest", what, LOOK)
    refused = bridge.refusals()
    if sum(int(board[each.name]) for each in Refusal) > MANY_REFUSED * board["seen"]:
        yield fault_row(0.0, "refused packets", f"packets of the robot were refused: {refused}", LOOK)


def tables(record: Record) -> dict[str, Record]:
    """Return tables of a run by the name of their file: the measurement for a fit, and the commands for a replay."""
    series = [each for each in record.variables if each.name in FITTED and each.long_name != ESTIMATED]
    time = Variable("time", ("time",), record["sent_time"], "s", "time")
    commands = next(_commands("contraction", record["sent"], record["command"].shape[1]))
    return {
        MEASURED_FILE: replace(record, variables=tuple(series)),
        COMMANDS_FILE: replace(record, variables=(time, commands)),
    }


def lines(record: Record) -> Iterator[str]:
    """Yield lines with the main figures of a run for the terminal."""
    for name in ("distance_m", "cross_track_rms_bl", *LINK_FIGURES):
        if record.summary.metrics.get(name) is not None:
            yield f"{name:22}{record.summary[name]:.6g}"
