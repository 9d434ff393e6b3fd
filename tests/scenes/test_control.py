"""Scenes with a controller: what they build, what a run leaves behind, and what is wrong with others."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

import worm3d as plant
from control.baselines import OpenLoop, PiLineOfSight
from control.estimation.estimator import Estimator
from control.estimation.reduced import STATES
from control.identification import identified as kept
from control.loop import SOURCES
from control.sensing.sensors import Measurement, Sensors
from control.supervisor import Supervisor
from control.tracking.obstacles import Disc
from control.tracking.paths import Circle, Line, PlanView, SCurve, SplinePath, WayPoints
from control.tracking.references import Constant, Sine, Steps
from scenes.language.errors import SceneError
from scenes.models.base import Watch
from scenes.models.control.build import controller_of, sensors_of, wave_of
from scenes.models.control.faults import in_turn, of_controller, refused
from scenes.models.control.model import CONTROL_MODEL
from scenes.models.control.record import tracked
from scenes.models.control.reference import path_of, reference_of
from scenes.models.control.schema import ControlScene
from scenes.models.loading import load_scene
from scenes.models.worm import view as worm_view
from scenes.records.record import Record
from scenes.records.store import load, save
from scenes.running import terminal
from scenes.running.runner import simulate
from worm3d.viewer import Frames
from worm3d.viewer.live import LiveView

TIMED = ("control_step_ms_p50", "control_step_ms_p99", "overruns")
REQUIRED = (
    *("speed_bias_relative", "speed_error_rms_relative", "heading_error_rms_deg", "cross_track_rms_bl"),
    *("cross_track_max_bl", "settling_periods", "mpc_failures"),
)
SCENES = (
    *("velocity_step", "velocity_sine", "velocity_pipe", "stop_and_go", "heading_hold", "path_line", "path_circle"),
    *("path_s_curve", "path_s_curve_slope", "path_waypoints", "there_and_back", "disturbance_push", "obstacles"),
)
BRIEF = ("run.duration_s=8", "run.record_every=2")


def scene(name: str, *overrides: str) -> ControlScene:
    settings = load_scene(name, overrides).settings
    assert isinstance(settings, ControlScene)
    return settings


def complaints(name: str, *overrides: str) -> tuple[str, ...]:
    with pytest.raises(SceneError) as refused:
        load_scene(name, overrides)
    return tuple(refused.value.lines)


@pytest.fixture(scope="module")
def circle() -> Record:
    """The first eight seconds round the circle by the MPC."""
    return simulate(load_scene("path_circle", BRIEF))


@pytest.mark.parametrize("name", SCENES)
def test_every_shipped_scene_has_a_controller_and_says_what_to_see(name: str) -> None:
    loaded = load_scene(name)
    assert loaded.model is CONTROL_MODEL
    assert len(loaded.settings.says) > 20
    assert scene(name).controller.kind == "mpc"
    assert isinstance(controller_of(scene(name)), Supervisor)


def test_references_are_those_of_the_scenes() -> None:
    kinds = {"path_line": Line, "path_circle": Circle, "path_s_curve": SCurve, "path_waypoints": WayPoints}
    for name, kind in kinds.items():
        assert isinstance(path_of(scene(name)), kind)
    assert isinstance(path_of(scene("velocity_pipe")), PlanView)
    assert isinstance(path_of(scene("path_waypoints", "reference.kind=spline", "reference.radius_m=1.5")), SplinePath)
    assert reference_of(scene("path_line")).speed == Constant(0.08)
    assert reference_of(scene("velocity_step")).speed == Steps(0.05, (20.0, 40.0), (0.08, 0.06))
    assert reference_of(scene("velocity_sine")).speed == Sine(0.07, 0.02, 20.0)
    turned = reference_of(scene("heading_hold"))
    assert turned.path is None
    assert turned.heading == Steps(0.0, (10.0,), (math.radians(30.0),))


def test_paths_begin_in_the_middle_of_the_worm_and_along_it() -> None:
    path = path_of(scene("path_circle", "start.azimuth_deg=90", "start.position_m=[1.0, 2.0]"))
    assert isinstance(path, Circle)
    assert_allclose((*path.start, path.azimuth), (1.0, 2.5, math.pi / 2), atol=1e-9)
    said = path_of(scene("path_circle", "reference.start_m=[3.0, 4.0]", "reference.azimuth_deg=180"))
    assert isinstance(said, Circle)
    assert (said.start, said.azimuth) == ((3.0, 4.0), math.pi)


def test_the_s_curve_is_as_long_as_the_worm_may_go() -> None:
    path = path_of(scene("path_s_curve"))
    assert isinstance(path, SCurve)
    assert path.length > 60 * 0.08 + 1.0


def test_controllers_and_sensors_are_those_asked_for() -> None:
    assert isinstance(controller_of(scene("path_line", "controller.kind=pi_los")), PiLineOfSight)
    other = controller_of(scene("path_line", "controller.kind=open_loop", "controller.period_s=0.4"))
    assert isinstance(other, OpenLoop)
    assert other.control_period == 0.4
    noisy = scene("path_line", "sensor.com_noise_m=0.02", "sensor.heading=true", "sensor.strain_rate_Hz=50", "seed=7")
    sensors = sensors_of(noisy)
    assert sensors.seed == 7
    assert sensors.channels["com"].noise == 0.02
    assert sensors.channels["strain"].rate == 50.0
    assert sensors.channels["heading"].noise == pytest.approx(math.radians(1.1))
    assert "heading" not in sensors_of(scene("path_line")).channels
    with pytest.raises(SceneError, match=r"sensor\.pressure: got true: this worm has no pressure of the chambers"):
        scene("path_line", "sensor.pressure=true")
    with pytest.raises(SceneError, match=r"no such sensor: set sensor\.angular_rate = true, or leave it out"):
        scene("path_line", "sensor.angular_rate_bias_deg_s=2")
    gyroscopes = ("sensor.angular_rate=true", "sensor.angular_rate_bias_deg_s=2", "sensor.angular_rate_rate_Hz=200")
    found = sensors_of(scene("path_line", *gyroscopes)).channels["angular_rate"]
    assert (found.noise, found.bias) == pytest.approx((math.radians(0.1), math.radians(2.0)))
    assert found.rate == 200.0
    assert math.isinf(sensors_of(scene("path_line")).channels["strain"].rate)


def test_the_mpc_chooses_the_wave_by_the_greatest_speed_of_a_run() -> None:
    for asked in ("speed_m_s=0.14", "speed_steps=[{at_s=20, speed_m_s=0.14}]", "speed_sine_m_s=0.06"):
        assert wave_of(scene("path_line", f"reference.{asked}")) == "steep", asked
        assert wave_of(scene("path_line", f"reference.{asked}", "controller.wave=sine")) == "sine"
    for asked in ("speed_m_s=0.13", "speed_sine_m_s=0.05"):
        assert wave_of(scene("path_line", f"reference.{asked}")) == "sine", asked
    assert wave_of(scene("path_line", "controller.wave=steep")) == "steep"


def test_all_but_the_mpc_go_by_the_sine_unless_told() -> None:
    fast = "reference.speed_m_s=0.2"
    for kind in ("pi_los", "open_loop", "bending", "control.baselines:PiLineOfSight"):
        assert wave_of(scene("path_line", fast, f"controller.kind={kind}")) == "sine"
        assert wave_of(scene("path_line", fast, f"controller.kind={kind}", "controller.wave=auto")) == "steep"


def test_a_speed_beyond_the_sine_is_reached() -> None:
    figures = simulate(load_scene("path_line", ("reference.speed_m_s=0.2", "run.duration_s=12"))).summary.metrics
    assert figures["wave"] == "steep"
    assert abs(figures["speed_bias_relative"]) <= 0.02, "the sine is 28 % too slow"
    assert figures["cross_track_rms_bl"] <= 0.006
    assert not any("unreachable" in fault["kind"] for fault in figures["faults"])


def test_a_run_has_the_figures_that_are_promised(circle: Record) -> None:
    figures = circle.summary.metrics
    assert circle.status == "done"
    assert all(name in figures for name in REQUIRED)
    assert {v.name for v in circle.timing} >= set(TIMED)
    assert figures["mpc_failures"] == 0
    assert figures["measurements_refused"] == 0
    assert figures["faults"] == []
    assert abs(figures["speed_bias_relative"]) < 0.03
    assert figures["cross_track_rms_bl"] < 0.02
    assert figures["settling_periods"] is None
    assert circle.summary.reasons["settling_periods"] == "the reference speed has no step"


def test_a_run_holds_what_was_decided_and_believed(circle: Record) -> None:
    decisions = circle.sizes["decision"]
    assert decisions == 40
    assert_allclose(np.diff(circle["decision_time"]), 0.2, atol=1e-9)
    assert set(circle["decision_source"]) <= {SOURCES.index("mpc"), SOURCES.index("gait")}
    assert "0: mpc; 1: shifted plan" in circle.variable("decision_source").long_name
    assert circle["decision_parameters"].shape == (decisions, 4)
    assert circle["estimate"].shape == circle["estimate_deviation"].shape == (decisions, STATES)
    assert circle["horizon"].shape[0] == decisions
    assert circle["waves"].shape == circle["time"].shape
    frequency = circle["decision_parameters"][:, 1]
    assert circle["waves"][-1] == pytest.approx(0.2 * frequency.sum(), rel=0.02)
    later, rocked = 0.2 * 0.08, 0.015  # the last decision is 0.2 s old, and a wave rocks the centre of mass
    assert_allclose(circle["estimate"][-1, :2], circle["com"][-1, :2], atol=later + rocked)


def test_a_run_repeats_bit_for_bit_and_another_seed_does_not(circle: Record) -> None:
    again, other = (simulate(load_scene("path_circle", (*BRIEF, *more))) for more in ((), ("seed=1",)))
    for variable in circle.variables:
        assert_array_equal(again[variable.name], variable.values)
    assert not np.array_equal(other["com"], circle["com"])


def test_a_record_survives_the_disc_and_is_drawn(circle: Record, tmp_path: Path) -> None:
    save(circle, tmp_path / "result.nc")
    read = load(tmp_path)
    for stem, draw in CONTROL_MODEL.figures.items():
        figure, _ = draw(read)
        figure.savefig(tmp_path / f"{stem}.png")
        with Image.open(tmp_path / f"{stem}.png") as picture:
            assert np.ptp(np.asarray(picture.convert("L"))) > 100
    assert {path.stem for path in tmp_path.glob("*.png")} == set(CONTROL_MODEL.figures)


@pytest.mark.slow
def test_a_run_that_is_watched_shows_the_horizon_as_its_page_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each picture has the way that the latest decision before it predicted, and none before there is one."""
    seen: list[np.ndarray | None] = []
    places: list[np.ndarray] = []
    show = LiveView.show

    def look(view: LiveView, frames: Frames, values: Mapping[str, Any]) -> None:
        seen.append(None if frames.horizon is None else frames.horizon[0])
        places.append(frames.joints[0])
        show(view, frames, values)

    monkeypatch.setattr(LiveView, "show", look)
    watched = load_scene("path_circle", ["run.duration_s=5"])
    record = simulate(watched, how=Watch(1e9, lambda address: None))
    page = worm_view.frames_of(record)
    assert page.horizon is not None
    assert seen[0] is None
    known = [way is not None for way in seen]
    assert known == sorted(known)
    assert sum(known) > 10
    for joints, way in zip(places, seen, strict=True):
        if way is not None:
            row = int(np.argmin(np.abs(record["joints"] - joints).max(axis=(1, 2))))
            k = int(np.searchsorted(record["decision_time"], record["time"][row] - 1e-9)) - 1
            assert_allclose(way[:, :2], record["horizon"][k], rtol=0, atol=0)
            assert_allclose(way[:, 2], page.horizon[-1, 0, 2], rtol=0, atol=0)


def test_pictures_show_the_path_and_the_horizon(circle: Record) -> None:
    frames = worm_view.frames_of(circle)
    assert frames.path is not None
    assert frames.horizon is not None
    path = path_of(scene("path_circle"))
    assert path is not None
    assert_allclose(np.linalg.norm(frames.path[:, :2] - [0.5, 1.5], axis=1), 1.5, atol=1e-9)
    assert_allclose(frames.path[:, 2], 0.004)
    assert frames.horizon.shape[0] == len(frames)
    assert_allclose(frames.horizon[-1, 0, :2], circle["com"][-1, :2], atol=0.05)
    assert frames.period == pytest.approx(1.25, rel=0.1)


def test_lines_lie_on_the_slope() -> None:
    record = simulate(load_scene("path_s_curve_slope", ("run.duration_s=1", "run.record_every=2")))
    frames = worm_view.frames_of(record)
    assert frames.path is not None
    assert_allclose(frames.path[:, 2], 0.004 + math.tan(math.radians(3.0)) * frames.path[:, 0], atol=1e-6)


def test_the_metrics_are_those_of_the_record(circle: Record) -> None:
    seen = tracked(circle, reference_of(scene("path_circle", *BRIEF)))
    assert seen is not None
    aside = seen.cross_track[seen.counted]
    assert circle.summary["cross_track_rms_bl"] == pytest.approx(np.sqrt(np.mean(aside**2)), rel=1e-3)


@pytest.fixture(scope="module")
def tipped() -> Record:
    """Across a slope on which the worm rolls over within two waves, and slides away."""
    return simulate(load_scene("path_line", (*BRIEF, "world.slope_deg=12", "world.heading_deg=90")))


def test_a_worm_that_lies_on_its_side_is_no_ordinary_end(tipped: Record, tmp_path: Path) -> None:
    rows = tipped.summary.faults
    assert tipped.status == "done"
    assert [set(row) for row in rows] == [{"time_s", "kind", "what", "advice"}] * len(rows)
    assert {"on its side", "tipped"} <= {row["kind"] for row in rows}
    times = [row["time_s"] for row in rows]
    assert times == sorted(times)
    assert 0.5 < times[0] < 3.0
    ending = terminal.ending(tipped, CONTROL_MODEL, tmp_path)
    assert f"path_line: the run reached its end, with {len(rows)} faults" in ending
    assert any("the worm lies on its side (from 1." in line for line in terminal.warnings(tipped))
    save(tipped, tmp_path / "result.nc")
    assert load(tmp_path).summary.faults == rows
    CONTROL_MODEL.figures["tracking"](tipped)[0].savefig(tmp_path / "tracking.png")


def test_noise_and_delays_of_a_scene_are_those_of_its_estimator() -> None:
    for kind in ("mpc", "pi_los"):
        asked = (f"controller.kind={kind}", "sensor.com_noise_m=0.02", "sensor.strain_delay_s=4")
        controller = controller_of(scene("path_line", *asked))
        assert isinstance(controller.estimator, Estimator)
        assert controller.estimator.noise.told == 0.02
        assert controller.estimator.span > 4.0


def test_refused_measurements_and_failed_plans_are_rows_of_the_summary() -> None:
    controller = controller_of(scene("path_line"))
    nan = float("nan")
    for k in range(40):
        wrong = np.array([nan, 0.0, 0.07]) if k % 10 == 0 else None
        controller.step(0.01 * k, Measurement(0.01 * k, com=(wrong, 0.01 * k)))
    decided = controller.decisions[-1]
    controller.decisions += [replace(decided, status="KeyError: 'x'", failed=True, time=0.5 + k) for k in range(3)]
    rows = in_turn(of_controller(controller))
    assert [row["kind"] for row in rows] == ["refused com", "no plan"]
    assert rows[0]["what"] == "4 times the centre of mass came not finite"
    assert rows[1]["what"] == "3 times no plan could be used: KeyError: 'x'"
    assert refused(controller) == 4


@pytest.mark.slow
def test_baselines_run_too() -> None:
    blind = simulate(load_scene("path_circle", (*BRIEF, "controller.kind=open_loop")))
    assert blind.summary["mpc_failures"] is None
    assert "horizon" not in {v.name for v in blind.variables}
    sighted = simulate(load_scene("path_circle", (*BRIEF, "controller.kind=pi_los")))
    assert sighted["estimate"].shape == (40, STATES)
    for draw in CONTROL_MODEL.figures.values():
        draw(blind)


def test_a_run_shorter_than_a_period_says_so() -> None:
    record = simulate(load_scene("path_line", ("run.duration_s=0.5", "run.record_every=2")))
    assert record.summary["speed_bias_relative"] is None
    assert "3 periods" in record.summary.reasons["speed_bias_relative"]
    for draw in CONTROL_MODEL.figures.values():
        draw(record)


def test_the_command_line_runs_and_refuses_to_resume(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "path_line", "-o", "run.duration_s=2", "--out", "here", "--quiet")
    assert ended.code == 0, ended.err
    summary = json.loads((tmp_path / "here" / "summary.json").read_text())
    assert all(name in summary for name in (*REQUIRED, *TIMED))
    assert (tmp_path / "here" / "viewer.html").is_file()
    assert {path.name for path in (tmp_path / "here").glob("*.png")} == {"overview.png"}
    ended = worm3d("resume", "here", "--duration", "1")
    assert (ended.code, ended.complaints) == (
        2,
        ["path_line: has no checkpoint to go on from (model 'worm_control')"],
    )


@pytest.mark.parametrize("kind", ["mpc", pytest.param("pi_los", marks=pytest.mark.slow)])
def test_mirrored_path_and_noise_give_mirrored_commands(kind: str) -> None:
    def commands(towards: str, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:
        settings = scene("path_circle", f"controller.kind={kind}", f"reference.towards={towards}")
        run = plant.simulate(
            plant.Worm(),
            plant.Plane(),
            actuation=controller_of(settings),
            sensor=Sensors(seed=5, mirrored=mirrored),
            duration=8.0,
        )
        return run.command, run.hinge

    (left, bent), (right, other) = commands("left", False), commands("right", True)
    assert_allclose(right, left[..., ::-1], atol=1e-6)
    assert_allclose(other, -bent, atol=1e-6)
    assert np.abs(bent).max() > 0.01


SHORTER = (
    "override run.duration_s: got 6 s: must be more than 40 s, when the last of reference.speed_steps comes; let the "
    "run last longer, or leave out steps (reference.speed_steps = [] leaves out all)"
)
TOO_LATE = "override reference.speed_steps: got a step at 70 s: must be before the end of the run (run.duration_s = "


@pytest.mark.parametrize(
    ("name", "overrides", "sentence"),
    [
        ("path_line", ("reference.radius_m=2.0",), "only for reference.kind = 'circle' or 'way_points'"),
        ("path_line", ("reference.kind=pipe",), "must be in one with a pipe"),
        ("pipe_climb_controlled", ("sensor.contact_load=false",), "the controller 'climber' needs it"),
        ("path_waypoints", ("reference.radius_m=4.0",), "too large for the stretch"),
        (
            "path_line",
            ("fault.chamber=true", "fault.chamber_begin_s=60"),
            "got a beginning at 60 s: must be before the end of the run",
        ),
        ("path_line", ("reference.kind=spline",), "points: got shape (0, 2)"),
        ("path_line", ("controller.period_s=0.001",), "must be at least run.dt_s"),
        ("velocity_step", ("reference.speed_sine_m_s=0.01",), "not both: leave one out"),
        ("velocity_step", ("run.duration_s=6",), SHORTER),
        ("velocity_step", ("reference.speed_steps=[{at_s = 70.0, speed_m_s = 0.1}]",), TOO_LATE),
        ("velocity_sine", ("reference.speed_sine_m_s=0.1",), "a speed of less than 0 cannot be asked for"),
        ("path_line", ("gait.amplitude=0.3",), "gait"),
    ],
)
def test_mistakes_are_told(name: str, overrides: tuple[str, ...], sentence: str) -> None:
    (line,) = complaints(name, *overrides)
    assert sentence in line


def test_a_shorter_run_without_its_steps() -> None:
    assert scene("velocity_step", "run.duration_s=6", "reference.speed_steps=[]").reference.speed_steps == ()


def test_another_worm_may_be_driven_by_the_default_worms_map() -> None:
    settings = scene("path_line", "worm.mass_kg=0.11", "controller.map=default")
    assert controller_of(settings).period == controller_of(scene("path_line")).period


def test_the_default_worm_is_identified() -> None:
    assert kept.load(plant.Worm()) is not None
    assert kept.load(replace(plant.Worm(), mass=0.11)) is None


@pytest.mark.parametrize("slope", [0.0, 2.0])
def test_obstacles_are_drawn_where_they_stand_on_the_ground_and_as_high_as_the_worm(slope: float) -> None:
    record = simulate(load_scene("obstacles", ["run.duration_s=0.1", f"world.slope_deg={slope}"]))
    drawn = [mesh for mesh in worm_view.frames_of(record).world if mesh.name.startswith("obstacle")]
    for mesh, (x, y) in zip(drawn, [(1.7, 0.03), (3.1, -0.05)], strict=True):
        off = np.linalg.norm(mesh.vertices[:, :2] - [x, y], axis=1)
        assert_allclose(off[off > 0.01], 0.1)  # the others are the middles of both ends
        above = mesh.vertices[:, 2] - math.tan(math.radians(slope)) * mesh.vertices[:, 0]
        assert_allclose(np.ptp(above), 2.0 * plant.Worm().half_height.max())
        assert 0.0 < above.min() < 0.01


def test_obstacles_stand_on_rough_ground_and_not_at_the_height_of_the_worm() -> None:
    record = simulate(load_scene("obstacles", ["run.duration_s=0.1", "world.kind=heightfield"]))
    drawn = [mesh for mesh in worm_view.frames_of(record).world if mesh.name.startswith("obstacle")]
    feet = [mesh.vertices[:, 2].min() for mesh in drawn]
    assert len(feet) == 2
    assert 0.0 < min(feet) <= max(feet) < 0.02 < 0.5 * record["com"][:, 2].mean()


def test_references_have_ends_corridors_obstacles_and_go_backwards() -> None:
    asked = ("length_m=2.0", "ends=true", "corridor_m=0.1", "obstacles=[{x_m=1.5, y_m=0.3, radius_m=0.1}]")
    found = reference_of(scene("path_line", *(f"reference.{each}" for each in asked), "reference.speed_m_s=-0.02"))
    assert (found.ends, found.corridor, found.obstacles) == (True, 0.1, (Disc(1.5, 0.3, 0.1),))
    assert (found.path.length, float(found.speed(0.0))) == (2.0, -0.02)
    usual = reference_of(scene("path_line"))
    assert (usual.ends, usual.corridor, usual.obstacles) == (False, math.inf, ())
    for wrong, said in (("path_line", "a path without end"), ("path_circle", "only for reference.kind = 'line'")):
        with pytest.raises(SceneError, match=said):
            scene(wrong, "reference.ends=true")
    with pytest.raises(SceneError, match=r"obstacles\[0\]: got one in which the worm begins"):
        scene("path_line", "reference.obstacles=[{x_m=0.5, y_m=0.1, radius_m=0.2}]")
