"""Runs on a robot: the simulated robot, the record of a run, its tables, pictures and page, and the commands."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.bridge.board import Board
from control.bridge.bridge import Bridge, Ending
from control.bridge.packets import RESTING, Kind, Packet
from control.sensing.sensors import Measurement
from scenes.bridge import drive, record
from scenes.bridge.simulated import LAG, SimulatedRobot
from scenes.models.loading import load_scene
from scenes.models.worm.build import problem_of
from scenes.records import measured
from scenes.records.store import load
from scenes.running import robot_page
from scenes.running.runner import simulate
from worm3d import Command
from worm3d.running.run import Run

PERIOD = 0.01


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A clock that the test turns."""
    found = SimpleNamespace(now=100.0)
    monkeypatch.setattr("scenes.bridge.simulated.time.monotonic", lambda: found.now)
    return found


class TestSimulatedRobot:
    def test_it_is_the_worm_of_the_scene_in_real_time(self, clock: SimpleNamespace) -> None:
        """With the commands of the gait at each step, it runs as the simulation of a worm that begins at rest does."""
        scene = load_scene("flat", ["run.duration_s=0.5"])
        robot, (step, _) = SimulatedRobot(scene), drive.step_of(scene)
        for k in range(51):
            robot.apply(step(k * PERIOD, Measurement(k * PERIOD)))
            clock.now += PERIOD
        problem = problem_of(scene.settings)
        bound = problem.actuation.bind(problem.worm)
        from_rest = lambda t: bound(t) if t > 0.0 else Command(np.zeros((6, 2)))  # noqa: E731
        result = Run(replace(problem, actuation=from_rest)).finish()
        samples = robot.sample()
        assert samples["strain"].time == pytest.approx(100.5)
        assert_allclose(samples["strain"].value, result.chamber_strain[-1], atol=1e-12)
        assert_allclose(robot.result().com, result.com, atol=1e-12)
        assert not robot.over

    def test_a_pause_of_its_process_is_made_up_and_a_slow_machine_loses_time(self, clock: SimpleNamespace) -> None:
        robot = SimulatedRobot(load_scene("flat", ["run.duration_s=0.1"]))
        for moment in (0.0, 0.013, 0.4, 0.4, 0.4, 0.4):
            clock.now = 100.0 + moment
            robot.rest()
        assert robot.result().time[-1] == pytest.approx(0.4)
        assert robot.lost == 0.0
        for moment in range(1, 1001):  # half as fast as real time
            clock.now = 100.4 + 0.2 * moment
            robot.rest()
            if robot.over:
                break
        assert robot.result().time[-1] == pytest.approx(60.2)
        assert robot.lost == pytest.approx(59.8 - LAG, abs=0.2)
        assert robot.sample()["com"].time == pytest.approx(clock.now - LAG, abs=0.2)

    def test_it_has_the_sensors_and_parameters_of_its_scene(self, clock: SimpleNamespace) -> None:
        robot = SimulatedRobot(load_scene("path_line", ["worm.mass_kg=0.2", "sensor.heading=true"]))
        robot.rest()
        assert robot.result().worm.mass == 0.2
        assert {*robot.sample()} == {"strain", "com", "heading"}


def board_of(bridge: Any, scene: Any) -> None:
    """Fill the board of a bridge as a run of a scene does, from its simulation; the robot rested for a moment."""
    found, board = simulate(scene), bridge.board
    board["began"], board["offset"], board["sessions"] = 50.0, 7.0, 1
    l0 = 1.0 / 6.0
    for k in range(board.ticks):
        board.commands[k] = np.concatenate([found["command"][k].ravel(), found["hinge"][k]])
        board.sent[k] = 0.001, 1 if k % 10 else 2, k if k % 10 else max(k - 1, 0)
        values = {"strain": found["chamber_length"][k] / l0 - 1.0}
        if k % 5 == 0:
            values |= {"com": found["com"][k], "heading": np.array(found["heading"][k])}
        taken = 57.0 + 0.002 + k * PERIOD
        flags = RESTING if 30 <= k < 33 else 0
        if not 60 <= k < 80:
            packet = Packet(Kind.SAMPLE, 1, k, 0.0, values, flags, taken=taken)
            board.store(packet, 50.0 + 0.005 + k * PERIOD, 0.004)
    board["OLD"] = 3


@pytest.fixture(scope="module")
def scene() -> Any:
    return load_scene("turn", ["run.duration_s=2"])


@pytest.fixture(scope="module")
def kept(scene: Any) -> Any:
    bridge = Bridge("udp://127.0.0.1:7", 6, 200)
    board_of(bridge, scene)
    return record.record_of(scene, bridge, Ending("done", "the robot has run to the end", 200), None)


class TestRecord:
    def test_series_have_the_names_and_values_of_a_simulation(self, kept: Any, scene: Any) -> None:
        found = simulate(scene)
        assert_allclose(kept["time"], 0.002 + PERIOD * np.array([*range(60), *range(80, 200)]), atol=1e-6)
        assert_allclose(kept["chamber_length"][:60], found["chamber_length"][:60], rtol=1e-12)
        assert_array_equal(np.isfinite(kept["com"][:60, 0]), np.arange(60) % 5 == 0)
        assert_allclose(kept["com"][::5][:12], found["com"][:60:5])
        for name in ("chamber_length", "com", "heading", "command", "hinge"):
            assert kept.variable(name).units == found.variable(name).units
            assert kept.variable(name).dims == found.variable(name).dims

    def test_a_held_tick_has_the_command_before_it(self, kept: Any) -> None:
        assert_array_equal(kept["sent"][50], kept["sent"][49])
        assert np.any(kept["sent"][51] != kept["sent"][50])

    def test_commands_are_recorded_as_they_were_sent(self) -> None:
        """A controller that is late by less than a tick plans each command just after its tick, so all are held."""
        board = Board(2, 6)
        board.commands[:] = np.arange(1.0, 7.0)[:, None]
        board.sent[:, 1] = [3, 2, 2, 3, 0, 1]  # rest, held, held, rest, not sent, planned
        board.sent[:, 2] = [0, 0, 1, 0, 0, 5]
        assert_array_equal(record.commanded(board, 6)[:, 0], [0.0, 1.0, 2.0, 0.0, 0.0, 6.0])

    def test_the_summary_says_how_the_link_was(self, kept: Any) -> None:
        summary = kept.summary
        assert summary["deadlines_kept"] == 1.0
        assert summary["commands_held"] == 20
        assert summary["samples"] == 180
        assert summary["round_trip_ms_p50"] == pytest.approx(4.0)
        assert summary["lateness_ms_p99"] == pytest.approx(1.0)
        assert summary["packets_refused"] == 3
        told = {row["kind"]: row for row in summary.faults}
        assert told["silent robot"]["what"] == "no sample has come for 0.21 s"
        assert told["silent robot"]["time_s"] == pytest.approx(0.595)
        assert told["robot at rest"]["what"].startswith("the robot rested in 3 samples")
        assert summary["duration_s"] == pytest.approx(2.0)
        assert told["refused packets"]["what"].endswith("3 not newer than the packet before")

    def test_nothing_has_come(self, scene: Any) -> None:
        bridge = Bridge("udp://127.0.0.1:7", 6, 10)
        found = record.record_of(scene, bridge, Ending("diverged", "silent", 0), None)
        assert found.summary["distance_m"] is None
        assert found.summary["deadlines_kept"] is None
        assert len(found["time"]) == 0

    def test_the_body_is_reconstructed(self, kept: Any, scene: Any) -> None:
        """From exact lengths, place and heading, within two hundredths of the body length; the worm turns."""
        found = simulate(scene)
        rows = [50, 120, 175]
        seen = robot_page.body(kept, SimulatedRobot(scene).result().worm, rows)
        at = np.array([50, 140, 195])
        assert_allclose(seen["joints"][..., :2], found["joints"][at][..., :2], atol=0.02)
        assert_allclose(seen["points"][:, :, :6], found["points"][at][:, :, :6], atol=0.03)
        heading = np.arctan2(*(seen["joints"][:, -1] - seen["joints"][:, 0])[:, 1::-1].T)
        assert_allclose(heading, found["heading"][at], atol=0.02)


def test_what_a_run_writes_is_taken_by_the_other_commands(kept: Any, worm3d: Any, tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    folder.mkdir()
    drive._write(kept, folder)
    assert {
        "result.nc",
        "summary.json",
        "measured.csv",
        "commands.csv",
        "viewer.html",
        "measured_path.png",
        "measured_chambers.png",
    } <= {each.name for each in folder.iterdir()}
    for arguments in (("plot", folder), ("view", folder, "--no-open"), ("export", folder, "--csv", "all.csv")):
        assert worm3d(*arguments).code == 0
    assert worm3d("run", "turn", "-o", "run.duration_s=2", "--out", "simulated", "--quiet").code == 0
    ended = worm3d("compare", "simulated", folder, "--out", "compared")
    assert ended.code == 0
    assert "chamber_length" in ended.out
    csv = measured.load(folder / "measured.csv")
    assert_allclose(csv["chamber_length"], kept["chamber_length"])
    assert {v.name for v in csv.variables} == {"time", "com", "heading", "chamber_length"}
    replay = worm3d(
        "run", "flat", "-o", f"gait.file={folder / 'commands.csv'}", "-o", "run.duration_s=1", "--quiet", "--out", "r"
    )
    assert replay.code == 0
    assert_allclose(load(Path("r"))["command"][1:100], kept["sent"][1:100, :12].reshape(-1, 6, 2), atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (("bridge", "flat", "--to", "nowhere"), 2, "--to: address: got 'nowhere', must be udp://HOST:PORT"),
        (("bridge", "planar_case", "--to", "udp://127.0.0.1:9"), 2, "bridge: got a scene of the model 'worm_planar'"),
        (("robot", "load_frame", "--listen", "udp://127.0.0.1:9"), 2, "robot: got a scene of the model 'load_frame'"),
        (("robot", "flat", "--listen", "serial:/no/device"), 1, "--listen: cannot open serial:/no/device"),
        (("bridge", "flat", "--to", "serial:/no/device"), 1, "--to: cannot open serial:/no/device"),
    ],
)
def test_mistakes_are_told(worm3d: Any, arguments: tuple[str, ...], code: int, says: str) -> None:
    ended = worm3d(*arguments)
    assert ended.code == code
    assert ended.complaints[-1].startswith(says)


def test_no_robot_is_told(worm3d: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive, "Bridge", lambda *given, **named: Bridge(*given, **named, connecting=0.5))
    ended = worm3d("bridge", "flat", "--to", "udp://127.0.0.1:9", "--out", "x")
    assert ended.code == 2
    assert "no robot has answered within 0.5 s" in ended.err


def program(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "scenes.commands.cli", *arguments]


@pytest.mark.slow
def test_a_controller_keeps_a_simulated_robot_on_its_path(tmp_path: Path) -> None:
    """Two processes, loss and jitter, and another mass than the controller believes."""
    port = 20_000 + os.getpid() % 20_000
    line = ["--delay", "0.001", "--jitter", "0.005", "--loss", "0.01"]
    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root)}
    given = ["-o", "worm.mass_kg=0.12", "--listen", f"udp://127.0.0.1:{port}", *line, "--out", "true"]
    log = {"cwd": tmp_path, "env": environment, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(program("robot", "path_line", *given), **log) as robot:  # type: ignore[call-overload]
        try:
            assert robot.stderr.readline().startswith("path_line: the robot listens at")
            to = ["--to", f"udp://127.0.0.1:{port}", "-o", "run.duration_s=10", "--out", "driven", "--quiet"]
            subprocess.run(program("bridge", "path_line", *to), cwd=tmp_path, env=environment, check=True, timeout=120)
            robot.send_signal(signal.SIGINT)
            assert robot.wait(60) == 0
        finally:
            robot.kill()
    summary = json.loads((tmp_path / "driven" / "summary.json").read_text())
    assert summary["cross_track_rms_bl"] < 0.02
    assert summary["distance_m"] > 0.5
    true, seen = load(tmp_path / "true"), load(tmp_path / "driven")
    known = np.isfinite(seen["com"][:, 0])
    assert_allclose(np.ptp(true["com"][:, 0]), np.ptp(seen["com"][known, 0]), atol=0.05)


def test_a_gait_with_senses_takes_measurements() -> None:
    step, _ = drive.step_of(load_scene("pipe_reflex", []))
    bridge = Bridge("udp://127.0.0.1:7", 6, 10)
    bridge.begin()
    felt = bridge.measurement(0)
    assert isinstance(step(0.01, felt), Command)
