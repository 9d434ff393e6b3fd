"""Obstacles: distances against brute force, the edges and ways that follow of them, in closed loop too."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.tracking.metrics import tracking
from control.tracking.obstacles import OBSTACLES, Disc, Obstacle, Wall
from control.tracking.paths import Circle, Line
from control.tracking.preview import bounds, detour
from control.tracking.references import Constant, Reference
from scenes.language.errors import SceneError
from scenes.language.loader import Scene
from scenes.models.control.record import motion_of
from scenes.models.control.reference import reference_of
from scenes.models.loading import load_scene
from scenes.running.runner import simulate
from worm3d.values.arrays import FloatArray

LINE = Line(length=8.0)


@dataclass(frozen=True)
class Box(Obstacle):
    """A kind of a user's own: a rectangle along the axes with round corners."""

    x: float
    y: float
    half: tuple[float, float]
    radius: float

    @property
    def spine(self) -> FloatArray:
        signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        return np.array([self.x, self.y]) + signs * np.array(self.half)

    def distance(self, x: ca.SX, y: ca.SX) -> ca.SX:
        dx, dy = ca.fabs(x - self.x) - self.half[0], ca.fabs(y - self.y) - self.half[1]
        return ca.hypot(ca.fmax(dx, 0.0), ca.fmax(dy, 0.0)) + ca.fmin(ca.fmax(dx, dy), 0.0) - self.radius


def some(kind: type[Obstacle], seed: int) -> Obstacle:
    """Return an obstacle at random beside the line."""
    rng = np.random.default_rng(seed)
    x, y, radius, length, azimuth = rng.uniform([2.0, -0.4, 0.05, 0.02, -3.0], [4.0, 0.4, 0.4, 2.0, 3.0])
    if kind is Disc:
        return Disc(x, y, radius)
    return Wall(x, y, radius, length, azimuth) if kind is Wall else Box(x, y, (length / 2.0, length / 5.0), radius)


def covered(obstacle: Obstacle) -> FloatArray:
    """Return places (K, 2) that cover the spine of an obstacle, and what lies between, within 4 mm."""
    if isinstance(obstacle, Box):
        shares = np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 501)]), axis=-1).reshape(-1, 2)
        return np.array([obstacle.x, obstacle.y]) + shares * np.array(obstacle.half)
    length, azimuth = (obstacle.length, obstacle.azimuth) if isinstance(obstacle, Wall) else (0.0, 0.0)
    along = np.linspace(-0.5, 0.5, 501)[:, None] * length * np.array([np.cos(azimuth), np.sin(azimuth)])
    return np.array([obstacle.x, obstacle.y]) + along  # type: ignore[attr-defined, no-any-return]


def brute(obstacle: Obstacle, places: FloatArray) -> FloatArray:
    """Return the distances of places (K, 2) that lie outside the spine."""
    return np.linalg.norm(places[:, None] - covered(obstacle), axis=-1).min(axis=1) - obstacle.radius


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", [*OBSTACLES.values(), Box])
def test_the_distance_is_that_of_the_nearest_point(kind: type[Obstacle], seed: int) -> None:
    obstacle = some(kind, seed)
    places = np.random.default_rng(seed).uniform([1.0, -1.5], [5.0, 1.5], (40, 2))
    found, seen = obstacle.distances(places), brute(obstacle, places)
    outside = seen > 0.01 - obstacle.radius
    assert outside.any()
    assert_allclose(found[outside], seen[outside], atol=4e-3 if kind is Box else 1e-4)
    assert (found[~outside] < 0.01 - obstacle.radius).all()
    assert_allclose(obstacle.distances(obstacle.outline()), 0.0, atol=1e-14)
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    distance = obstacle.distance(x, y)
    slope = ca.Function("slope", [x, y], [ca.gradient(distance, ca.vertcat(x, y))])
    step = 1e-6
    for place in places[outside][:5]:
        around = place + step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        east, west, north, south = obstacle.distances(around)
        assert_allclose(slope(*place).full().ravel(), [(east - west) / 2 / step, (north - south) / 2 / step], atol=1e-6)


def test_distances_of_places_in_any_shape() -> None:
    for shape in ((2,), (3, 4, 2), (0, 2)):
        assert Disc(0.0, 0.0, 1.0).distances(np.ones(shape)).shape == shape[:-1]
    assert np.isnan(Wall(0.0, 0.0, 1.0).distances([np.nan, 0.0]))


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("kind", [*OBSTACLES.values(), Box])
def test_ways_stay_outside_and_bounds_touch_the_edge(kind: type[Obstacle], seed: int) -> None:
    obstacle = some(kind, seed)
    reference, s = Reference(Constant(0.08), path=LINE, obstacles=(obstacle,)), np.linspace(0.0, 8.0, 1601)
    (passing,), (left, right), (e, slope) = reference.passings, bounds(reference, s), detour(reference, s, 1.0)
    places = np.column_stack([s, e])
    assert obstacle.distances(places).min() > -1e-12
    assert (e <= left + 1e-9).all()
    assert (-e <= right + 1e-9).all()
    assert_allclose(np.gradient(e, s)[1:-1], slope[1:-1], atol=1e-2)
    outline = obstacle.outline()
    assert passing.on_left == (outline[:, 1].max() < -outline[:, 1].min())
    assert passing.reach == pytest.approx(max(outline[:, 1].max() if passing.on_left else -outline[:, 1].min(), -9.0))
    bound = -right if passing.on_left else left
    beside = np.isfinite(bound)
    assert_allclose(obstacle.distances(np.column_stack([s, bound])[beside]), 0.0, atol=1e-12)
    inside = (s > outline[:, 0].min() + 1e-3) & (s < outline[:, 0].max() - 1e-3)
    assert beside[inside].all()
    assert (reference.trespass(places, e) < 1e-12).all()


def test_on_a_closed_path_every_lap_is_alike() -> None:
    path, wall = Circle(2.0), Wall(0.05, 0.0, 0.15, 0.6, 0.3)  # the path begins beside it
    reference, s = Reference(Constant(0.08), path=path, obstacles=(wall,)), np.linspace(-2.0, 2.0, 401)
    e, _ = detour(reference, s, 1.0)
    left_of = np.column_stack([-np.sin(path.heading(s)), np.cos(path.heading(s))])
    assert wall.distances(path.point(s) + e[:, None] * left_of).min() > -1e-9
    assert_allclose(detour(reference, s + 3.0 * path.length, 1.0)[0], e, atol=1e-12)
    assert_allclose(bounds(reference, s - path.length), bounds(reference, s), atol=1e-7)


@pytest.mark.parametrize("kind", [Wall, Box])
def test_obstacles_that_leave_no_way_between_them_are_passed_on_one_side(kind: type[Obstacle]) -> None:
    """A cross has none, though the ends of its bars are far from each other."""
    bars = Wall(2.0, 0.25, 0.05, 1.0, 0.7), Wall(2.0, -0.2, 0.05, 1.2, -0.7)
    other: Obstacle = Wall(2.4, -0.1, 0.05, 1.0, 1.4) if kind is Wall else Box(2.0, -0.1, (0.3, 0.3), 0.05)
    sides = [each.on_left for each in Reference(Constant(0.1), path=LINE, obstacles=(*bars, other)).passings]
    assert len(set(sides)) == 1
    apart = Reference(Constant(0.1), path=LINE, obstacles=(Wall(2.0, 0.6, 0.05, 1.0), Wall(2.0, -0.6, 0.05, 1.0)))
    assert [each.on_left for each in apart.passings] == [False, True]


def wall_scene(*more: str, **wall: float | str) -> Scene:
    keys = ", ".join(f"{key} = {value!r}" for key, value in wall.items())
    return load_scene("obstacles", (f"reference.obstacles=[{{{keys}}}]".replace("'", '"'), *more))


def test_a_worm_goes_around_a_wall_and_the_clearance_is_that_of_brute_force() -> None:
    shape: dict[str, float | str] = {"radius_m": 0.12, "length_m": 0.4, "azimuth_deg": 20.0}
    scene = wall_scene("run.duration_s=13", kind="wall", x_m=1.2, y_m=0.05, **shape)
    record = simulate(scene)
    wall, reference = Wall(1.2, 0.05, 0.12, 0.4, np.deg2rad(20.0)), reference_of(scene.settings)
    assert reference.obstacles == (wall,)
    seen = tracking(motion_of(record, record["waves"]), reference)
    place, aside = seen.place[seen.counted], seen.cross_track[seen.counted]
    nearest = min(brute(wall, place).min(), (0.3 - np.abs(aside)).min())
    assert record.summary["clearance_min_bl"] == pytest.approx(nearest, abs=1e-4)
    assert record.summary["clearance_min_bl"] > -0.005
    assert record.summary["cross_track_max_bl"] > 0.1, "it left its line"
    assert record.summary["faults"] == []


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            {"x_m": 1.0, "y_m": 0.0, "radius_m": 0.1, "length_m": 2.0},
            r"obstacles\[0\].length_m: only for kind = 'wall'",
        ),
        (
            {"kind": "wall", "x_m": 0.5, "y_m": 0.0, "radius_m": 0.1},
            r"obstacles\[0\]: got one in which the worm begins",
        ),
        ({"kind": "wall", "x_m": 1.5, "y_m": 0.0, "radius_m": -0.1}, "radius_m"),
        ({"kind": "hole", "x_m": 1.5, "y_m": 0.0, "radius_m": 0.1}, "one of 'disc', 'wall', or module:NAME"),
        ({"kind": "wall", "y_m": 0.0, "radius_m": 0.1}, "x_m"),
    ],
)
def test_mistakes_in_scenes(given: dict[str, float | str], sentence: str) -> None:
    with pytest.raises(SceneError, match=sentence):
        wall_scene(**given)


def test_mistakes_in_python() -> None:
    for make, sentence in (
        (lambda: Disc(0.0, 0.0, 0.0), "radius: got 0.0 m, must be"),
        (lambda: Wall(0.0, 0.0, 0.1, length=0.0), "length: got 0.0 m, must be"),
        (lambda: Wall(0.0, np.nan, 0.1), "y: got nan"),
    ):
        with pytest.raises(ValueError, match=sentence):
            make()
