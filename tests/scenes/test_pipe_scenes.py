"""The scenes of slopes and pipes do what they say, and what can be wrong with a pipe gets its line."""

import re
from functools import cache

import numpy as np
import pytest
from scene_limits import LIMITS, passes, pipe_of

import worm3d
from scenes.language.errors import SceneError
from scenes.models.loading import load_scene, parse_scene
from scenes.models.worm.build import simulate


@cache
def run_of(scene: str) -> worm3d.Result:
    return simulate(load_scene(scene).settings, lambda done: True)  # type: ignore[arg-type]


def says(scene: str) -> str:
    return load_scene(scene).settings.says


def tail(run: worm3d.Result) -> float:
    """How far along the pipe the tail ends [m]."""
    return float(pipe_of(run).along(run.joints[-1, 0]))


@pytest.mark.parametrize("scene", ["slope_5", "slope_15", "pipe_straight"])
def test_it_crawls_as_far_as_it_says(scene: str) -> None:
    assert f" {run_of(scene).distance:.2f} m in ten seconds" in says(scene)


def test_the_vertical_pipe_is_climbed() -> None:
    run = run_of("pipe_vertical")
    assert f"climbs {run.distance:.2f} m in ten waves" in says("pipe_vertical")
    assert f"{run.distance / 10.0:.3f} body lengths a wave" in says("pipe_vertical")
    assert np.diff(run.com[::300, 2]).min() > 0.06  # in every single wave


def test_the_climbing_worm_sinks_but_little_within_a_wave() -> None:
    """By 6.4 mm in each of the ten, as its rear lets go; it climbs by 131 mm a wave."""
    height = run_of("pipe_vertical").com[:, 2]
    sinks = [(np.maximum.accumulate(wave) - wave).max() for wave in np.split(height[1:], 10)]
    assert f"sinks by {1e3 * max(sinks):.0f} mm" in says("pipe_vertical")
    assert max(sinks) < 9.7e-3


def test_the_bend_is_passed() -> None:
    """Its radius is three times the body's diameter; half a metre behind it the worm is straight again."""
    run = run_of("pipe_bend")
    pipe, worm = pipe_of(run), run.worm
    assert pipe.centreline.curvature.max() == pytest.approx(1.0 / (3.0 * 2.0 * (0.05 + worm.chamber_offset)))
    assert f"goes {run.distance:.2f} m in a minute" in says("pipe_bend")
    assert f"ends {tail(run) - pipe.centreline.ends[1]:.1f} m behind the bend" in says("pipe_bend")
    assert np.rad2deg(run.heading[-1] - run.heading[0]) == pytest.approx(90.0, abs=3.0)


def test_the_narrowing_is_passed() -> None:
    run = run_of("pipe_narrowing")
    pipe = pipe_of(run)
    assert pipe.radius_at(3.0) / pipe.radius_at(0.0) == pytest.approx(0.8)
    assert f"ends {tail(run) - 1.5:.1f} m behind it" in says("pipe_narrowing")


def test_the_tunnel_is_reached() -> None:
    assert f"ends {tail(run_of('slope_into_pipe')):.1f} m inside" in says("slope_into_pipe")


DEPTHS = {
    "pipe_straight": 2e-5,
    "pipe_vertical": 7e-4,
    "pipe_bend": 9e-4,
    "pipe_narrowing": 7e-4,
    "slope_into_pipe": 3e-5,
}
"""Greatest depth of apexes in the wall, twice the measured one; anchors press with up to 22 N [m]."""


@pytest.mark.parametrize("scene", DEPTHS)
def test_the_ledger_closes_and_nothing_goes_through_the_wall(scene: str) -> None:
    run = run_of(scene)
    assert run.status is worm3d.Status.DONE
    assert run.energy.balance_error < 1e-9
    assert run.halved_steps < 0.002 * len(run.newton_iterations)
    assert run.world is not None
    assert run.world.distance(run.points[:, :, :6]).min() > -DEPTHS[scene]


FAILS = {
    "slope_5": 7.0,
    "slope_15": 23.0,
    "pipe_straight": 7.0,
    "pipe_bend": 0.18,
    "pipe_narrowing": 32.0,
    "slope_into_pipe": 16.0,
    "mesh_tunnel": 0.14,
}
"""Values of the first parameter of each scene in the table of limits at which it fails."""


@pytest.mark.parametrize("scene", FAILS)
def test_it_fails_where_the_table_says(scene: str) -> None:
    limit = next(limit for limit in LIMITS if limit.scene == scene)
    assert passes(limit, FAILS[scene] - limit.step)
    assert not passes(limit, FAILS[scene])


@pytest.mark.parametrize(("name", "value"), [("friction", 0.04), ("radius [m], up", 0.1), ("radius [m], down", 0.08)])
def test_the_vertical_climb_fails_where_the_table_says(name: str, value: float) -> None:
    limit = next(limit for limit in LIMITS if limit.scene == "pipe_vertical" and limit.name.startswith(name))
    assert passes(limit, value - limit.step)
    assert not passes(limit, value)


PIPE = 'model = "worm"\n[world]\nkind = "pipe"\n'
MISTAKES = [
    ("radius_m = 0.07", "line 4: world.radius_m: the worm is 0.16 m wide at rest (2 (worm.half_height_m + "),
    ("pieces = [{ bend_deg = 90.0 }]", "line 4: world.pieces: piece 0: must have straight_m, or bend_deg and bend_"),
    ("pieces = [{}]", "line 4: world.pieces: piece 0: must have straight_m, or bend_deg and bend_radius_m"),
    ("radii = [{ at_m = 1.0, radius_m = 0.1 }, { at_m = 0.5, radius_m = 0.2 }]", "line 4: world.radii: got at_m ="),
    ("radii = [{ at_m = 1.0, radius_m = 0.1 }]\nradius_m = 0.2", "line 4: world.radii: got 1 places and world."),
    ("radii = [{ at_m = 1.0, radius_m = 0.07 }]", "line 4: world.radii: the worm is 0.16 m wide at rest"),
    ("points_m = [[0, 0, 0], [1, 0, 0]]\ntilt_deg = 3.0", "line 4: world.points_m: the points say where the pipe goes"),
    ("points_m = [[0, 0, 0], [0, 0, 0]]", "line 2: world: points: two that follow each other coincide"),
    ("points_m = [[0, 0], [0, 0, 0]]", "line 4: world.points_m[0]: got [0, 0]: "),
    ("slope_deg = 3.0", "line 4: world.slope_deg: only for world.kind = 'plane' or 'slope_into_pipe', but"),
    ("mouth_m = 3.0", "line 4: world.mouth_m: only for world.kind = 'slope_into_pipe', but this scene has"),
    ("[start]\nposition_m = [0.0, 0.1]", "line 5: start.position_m: got [0.0, 0.1]: in a pipe it is"),
    ("[start]\nazimuth_deg = 30.0", "line 5: start.azimuth_deg: got 30.0: in a pipe it is 0"),
    ("[gait]\nkind = 'two_anchor'\nanchors = 3", "line 6: gait.anchors: got 3, must leave a segment of the worm's 6"),
    ("[gait]\nanchors = 2", "line 5: gait.anchors: only for gait.kind = 'two_anchor' or 'inchworm', but"),
    ("tilt_deg = 100.0", "line 4: world.tilt_deg: got 100.0: input should be less than or equal to 90"),
    ("pieces = [{ bend_deg = 90.0, bend_radius_m = 0.1 }]", "line 2: world: radius: got 0.12 m in a bend of 0.1 m at"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "line"), MISTAKES)
def test_every_mistake_in_a_pipe_gets_a_line(text: str, line: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_scene(PIPE + text + "\n", "test", [])
    assert str(caught.value).startswith(line)


def test_a_pipe_through_points() -> None:
    points = "[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.8, 0.3, 0.1]]"
    scene = parse_scene(f"{PIPE}points_m = {points}\n[run]\nduration_s = 0.1\n", "test", []).settings
    run = simulate(scene, lambda done: True)  # type: ignore[arg-type]
    assert run.status is worm3d.Status.DONE
    assert np.abs(pipe_of(run).distance(np.array([1.0, 0.0, 0.0])) - 0.12) < 1e-12


def test_a_pipe_that_does_not_lead_into_the_hill() -> None:
    text = 'model = "worm"\n[world]\nkind = "slope_into_pipe"\nslope_deg = 5.0\ntilt_deg = 5.0\n'
    with pytest.raises(SceneError, match=r"line 5: world.tilt_deg: got 5.0: must be below world.slope_deg \(5.0\)"):
        parse_scene(text, "test", [])


@pytest.mark.parametrize("scene", ["pipe_reflex", "pipe_reflex_vertical"])
def test_the_reflex_gains_what_the_scene_says(scene: str) -> None:
    felt = run_of(scene)
    plain = simulate(load_scene(scene, ["reflexes.wall_load=false"]).settings, lambda done: True)  # type: ignore[arg-type]
    lost, lost_plain = (run.energy.friction_loss.sum() / run.distance for run in (felt, plain))
    assert f"{felt.distance:.2f} m in 15 s, {felt.distance / plain.distance - 1.0:.0%}".replace("%", " %") in says(
        scene
    )
    told = re.search(r"loses some (\d+) %", says(scene))
    assert told is not None
    assert 100.0 * (1.0 - lost / lost_plain) == pytest.approx(int(told[1]), abs=3.0)


def test_reflexes_that_are_not_asked_for_and_errors_that_nothing_feels() -> None:
    with pytest.raises(SceneError, match=r"wall_load_rate: there is no such reflex: set reflexes.wall_load = true"):
        load_scene("flat", ["reflexes.wall_load_rate=3"])
    with pytest.raises(SceneError, match=r"neither the gait 'travelling_wave' nor a reflex senses anything"):
        load_scene("flat", ["sensor.contact_load_noise_N=0.1"])
