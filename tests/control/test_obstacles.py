"""Obstacles: distances against brute force, in closed loop too."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.tracking.metrics import tracking
from control.tracking.obstacles import OBSTACLES, Disc, Obstacle, Wall
from scenes.language.errors import SceneError
from scenes.models.control.record import motion_of
from scenes.models.control.reference import reference_of
from scenes.models.loading import Scene, load_scene
from scenes.running.runner import simulate
from worm3d.values.arrays import FloatArray


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


def wall_scene(*more: str, **wall: float | str) -> Scene:
    keys = ", ".join(f"{key} = {value!r}" for key, value in wall.items())
    return load_scene("obstacles", (f"reference.obstacles=[{{{keys}}}]".replace("'", '"'), *more))


@pytest.mark.slow
def test_a_worm_goes_around_a_wall_and_the_clearances_are_those_of_brute_force() -> None:
    shape: dict[str, float | str] = {"radius_m": 0.05, "length_m": 0.3, "azimuth_deg": 20.0}
    scene = wall_scene("run.duration_s=16", kind="wall", x_m=1.5, y_m=0.03, **shape)
    record = simulate(scene)
    wall, reference = Wall(1.5, 0.03, 0.05, 0.3, np.deg2rad(20.0)), reference_of(scene.settings)
    assert reference.obstacles == (wall,)
    seen = tracking(motion_of(record, record["waves"]), reference)
    place, aside = seen.place[seen.counted], seen.cross_track[seen.counted]
    nearest = min(brute(wall, place).min(), (0.3 - np.abs(aside)).min())
    assert record.summary["clearance_min_bl"] == pytest.approx(nearest, abs=1e-4)
    body = min(brute(wall, record["points"][:, k, :6, :2].reshape(-1, 2)).min() for k in range(6))
    assert record.summary["body_clearance_min_bl"] == pytest.approx(body, abs=5e-3)
    assert record.summary["body_clearance_min_bl"] > 0.02
    assert record.summary["cross_track_max_bl"] > 0.1, "it left its line"
    assert record.summary["faults"] == []
    assert np.abs(record["way"][:, 1]).max() == pytest.approx(np.abs(aside).max(), abs=0.02)


def test_a_body_that_enters_an_obstacle_shows_in_the_summary_and_is_a_fault() -> None:
    """Open loop looks at nothing, and so comes to know of nothing."""
    hidden = wall_scene("controller.kind=open_loop", "run.duration_s=5", x_m=1.3, y_m=0.0, radius_m=0.1, sight_m=0.5)
    record = simulate(hidden)
    assert record.summary["body_clearance_min_bl"] < -0.05
    (fault,) = (row for row in record.summary.faults if row["kind"] == "inside an obstacle")
    tip = record["joints"][record["time"] < fault["time_s"] + 1e-9, -1, 0].max()
    assert tip == pytest.approx(1.2, abs=0.01), "as the head comes to its edge"


@pytest.mark.parametrize("controller", ["mpc", pytest.param("pi_los", marks=pytest.mark.slow)])
def test_a_way_is_found_anew_where_an_obstacle_comes_into_sight_or_the_worm_stops_before_it(controller: str) -> None:
    seen = wall_scene(
        f"controller.kind={controller}", "run.duration_s=14", x_m=1.9, y_m=0.02, radius_m=0.1, sight_m=0.7
    )
    record = simulate(seen)
    assert record.summary["body_clearance_min_bl"] > 0.0
    assert record.summary["faults"] == []
    across: dict[str, float | str] = {"kind": "wall", "radius_m": 0.05, "length_m": 3.0, "azimuth_deg": 90.0}
    blocked = simulate(
        wall_scene(f"controller.kind={controller}", "run.duration_s=9", x_m=1.5, y_m=0.0, sight_m=0.3, **across)
    )
    assert [row["kind"] for row in blocked.summary.faults] == ["blocked"]
    assert 0.1 < blocked.summary["body_clearance_min_bl"] < 0.3
    last = blocked["time"] > 6.0
    assert np.ptp(blocked["com"][last, 0]) < 1e-3


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
        ({"x_m": 2.0, "y_m": 0.0, "radius_m": 0.2}, r"obstacles\[0\]: got one past which no way leads, .* \(0.3 m\)"),
        ({"x_m": 4.5, "y_m": 0.1, "radius_m": 0.1}, r"obstacles\[0\]: got one past which no way leads, .* ends"),
        ({"x_m": 2.0, "y_m": 0.0, "radius_m": 0.1, "sight_m": 0.0}, "sight_m: got 0.0"),
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
