"""Worlds of a Python function: distances and crawls are those of the built-in worlds, and bad functions are refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import TravellingWave
from worm3d import Centreline, Pipe, Plane, State, Status, Straight, World, Worm
from worm3d.worlds.kernels import looked_up
from worm3d.worlds.scenery import Window, scenery

BOX = ((-0.5, -0.8, -0.3), (2.0, 0.8, 0.5))
SLOPE = Plane(slope=0.1, heading=0.3)
PIPE = Pipe(Centreline.of([Straight(1.0)]), 0.12)
PIPE_BOX = ((-0.3, -0.2, -0.2), (1.8, 0.2, 0.2))
RADIUS, MIDDLE = 1.5, np.array([0.0, 0.0, 1.5])
BOWL_BOX = ((-0.9, -0.9, -0.1), (0.9, 0.9, 0.7))


def tilted(points: np.ndarray) -> np.ndarray:
    return points @ SLOPE.axes[2]


def tube(points: np.ndarray) -> np.ndarray:
    return 0.12 - np.hypot(points[:, 1], points[:, 2])


def bowl(points: np.ndarray) -> np.ndarray:
    return RADIUS - np.linalg.norm(points - MIDDLE, axis=1)


def groove(points: np.ndarray) -> np.ndarray:
    """A V along x, of 45 degrees on both sides: its bottom is a sharp edge, and so is what is equally far from both."""
    return (points[:, 2] - np.abs(points[:, 1])) / np.sqrt(2.0)


@pytest.fixture(scope="module")
def sampled_slope() -> World:
    return World.from_distance(tilted, BOX)


@pytest.fixture(scope="module")
def sampled_pipe() -> World:
    return World.from_distance(tube, PIPE_BOX)


def points_in(box: object, seed: int, count: int = 20_000) -> np.ndarray:
    low, high = np.array(box)
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def test_a_plane_is_that_plane_everywhere_and_beyond_its_bounds(sampled_slope: World) -> None:
    around = ((-9.0, -9.0, -9.0), (9.0, 9.0, 9.0))
    for points, error in ((points_in(BOX, 1), 1e-6), (points_in(around, 2), 1e-4)):
        rows = looked_up(sampled_slope.kernel(), points)
        assert_allclose(rows[0], SLOPE.distance(points), rtol=0, atol=error)
        assert_allclose(rows[1:4].T, np.broadcast_to(SLOPE.axes[2], points.shape), rtol=0, atol=1e-5)
        assert_allclose(rows[4:10], 0.0, atol=1e-3)
        assert_allclose(rows[10], 1.0)


def test_a_pipe_is_that_pipe_where_the_worm_touches_it(sampled_pipe: World) -> None:
    points = points_in(PIPE_BOX, 3)
    points = points[np.abs(tube(points)) < sampled_pipe.grid.cell]
    rows, exact = looked_up(sampled_pipe.kernel(), points), looked_up(PIPE.kernel(), points)
    assert_allclose(rows[0], exact[0], rtol=0, atol=1e-7)
    assert_allclose(rows[1:4], exact[1:4], rtol=0, atol=2e-4)
    assert_allclose(rows[4:10], exact[4:10], rtol=0, atol=0.03 / 0.12)
    longer = points + np.array([5.0, 0.0, 0.0])
    assert_allclose(sampled_pipe.distance(longer), exact[0], rtol=0, atol=1e-7, err_msg="it goes on straight")


def test_a_bowl_is_a_sphere_with_the_normals_of_its_distance() -> None:
    world, points = World.from_distance(bowl, BOWL_BOX), points_in(BOWL_BOX, 4)
    points = points[np.abs(bowl(points)) < world.grid.cell]
    assert_allclose(world.distance(points), bowl(points), rtol=0, atol=1e-5, err_msg="up to the bounds")
    points = points[np.abs(points[:, :2]).max(axis=1) < 0.8]
    away = MIDDLE - points
    rows = looked_up(world.kernel(), points)
    assert_allclose(rows[0], bowl(points), rtol=0, atol=1e-8)
    assert_allclose(rows[1:4].T, away / np.linalg.norm(away, axis=1)[:, None], rtol=0, atol=1e-5)
    h = 1e-6
    for k, axis in enumerate(np.eye(3)):
        ends = [looked_up(world.kernel(np.inf), points + side * h * axis)[0] for side in (1.0, -1.0)]
        assert_allclose((ends[0] - ends[1]) / (2.0 * h), rows[1 + k], rtol=0, atol=1e-5)


def test_an_edge_is_rounded_by_less_than_a_fifth_of_a_spacing() -> None:
    box = ((-0.2, -0.2, -0.1), (0.2, 0.2, 0.2))
    world, points = World.from_distance(groove, box, 0.01), points_in(((-0.15, -0.02, -0.02), (0.15, 0.02, 0.02)), 5)
    assert_allclose(world.distance(points), groove(points), rtol=0, atol=0.2 * 0.01)


@pytest.mark.parametrize(
    ("exact", "name", "options"),
    [(SLOPE, "sampled_slope", {}), (PIPE, "sampled_pipe", {}), (PIPE, "sampled_pipe", {"settle_first": False})],
)
def test_a_worm_crawls_as_far_as_on_the_built_in_world(
    exact: World, name: str, options: dict[str, object], request: pytest.FixtureRequest
) -> None:
    """Measured 0.16 % less on the slope, 0.05 % less in the pipe: it comes to rest with contacts that stick."""
    world, gait = request.getfixturevalue(name), TravellingWave()
    for seed in range(2):
        x, y = np.random.default_rng(seed).uniform((0.0, -0.2), (0.2, 0.2))
        place = (x, y if exact is SLOPE else 0.0)
        azimuth = 0.4 * seed if exact is SLOPE else 0.0
        state = State.straight(Worm(), exact, place, azimuth)
        runs = [
            worm3d.simulate(Worm(), each, actuation=gait, duration=6.0, state=state, **options)
            for each in (exact, world)
        ]
        assert {run.status for run in runs} == {Status.DONE}
        assert runs[0].distance > 0.1
        assert_allclose(runs[1].distance, runs[0].distance, rtol=5e-3)


def test_a_worm_is_laid_on_it_and_what_has_no_ground_is_said(sampled_slope: World, sampled_pipe: World) -> None:
    for world, exact in ((sampled_slope, SLOPE), (sampled_pipe, PIPE)):
        joints = State.straight(Worm(), world, (0.1, 0.0)).joints
        assert (exact.distance(joints) > 0.5 * np.max(Worm().half_height)).all()
    with pytest.raises(ValueError, match="the world has no ground under the worm"):
        State.straight(Worm(), sampled_pipe, (0.0, 0.19))


def test_its_friction_and_its_picture(sampled_pipe: World) -> None:
    rough = World.from_distance(tilted, BOX, 0.05, grip=2.5)
    assert_allclose(looked_up(rough.kernel(), np.zeros((3, 3)))[10], 2.5)
    worm = State.straight(Worm(), PIPE).joints
    (wall,) = scenery(sampled_pipe, Window(worm, 1.0)).meshes
    assert wall.opacity < 0.5, "one sees the worm inside"
    assert len(wall.faces) > 1000
    assert_allclose(tube(wall.vertices), 0.0, atol=2e-3)


BAD = {
    "a number a point": (lambda p: p[:, 2:], BOX, None, r"f: returned shape \(\d+, 1\) for points of shape \(\d+, 3\)"),
    "one number": (lambda p: 1.0, BOX, None, r"f: returned shape \(\)"),
    "no numbers": (lambda p: ["a"] * len(p), BOX, None, "f: got .*must be numbers"),
    "not finite": (
        lambda p: np.where(p[:, 0] > 1.9, np.nan, p[:, 2]),
        BOX,
        None,
        r"values that are not finite, as nan",
    ),
    "all free": (lambda p: p[:, 2] + 9.0, BOX, None, r"f: is positive everywhere .*\(at best 8.\d* m\): no surface"),
    "all solid": (lambda p: p[:, 2] - 9.0, BOX, None, "f: is negative everywhere"),
    "twice the distance": (lambda p: 2.0 * p[:, 2], BOX, None, "f: is no distance: .* changes by 2 to 2 m per metre"),
    "a tenth of it": (lambda p: 0.1 * p[:, 2], BOX, None, "divide it by the length of its gradient"),
    "a height over a steep hill": (lambda p: p[:, 2] - 2.0 * np.sin(p[:, 0]), BOX, None, "f: is no distance"),
    "a step": (lambda p: np.where(p[:, 0] > 0.5, p[:, 2], p[:, 2] - 0.2), BOX, None, "f: is no distance"),
    "no function": (7.0, BOX, None, "f: got float, must be a function of points"),
    "bounds the wrong way": (tilted, BOX[::-1], None, "bounds: got .*lowest and the highest corner"),
    "bounds of a square": (tilted, ((0.0, 0.0), (1.0, 1.0)), None, "bounds: got shape"),
    "too coarse": (tilted, BOX, 0.5, "spacing: got 0.5 m, must be at most 0.2 m"),
    "too fine": (
        tilted,
        BOX,
        1e-3,
        r"spacing: got 0.001 m, which makes 3\.2\d*e\+09 nodes, .* take 0.007\d* m or more",
    ),
    "no spacing": (tilted, BOX, 0.0, "spacing: got 0.0 m, must be finite and above 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_function_is_told_what_is_wrong(name: str) -> None:
    f, bounds, spacing, words = BAD[name]
    with pytest.raises(ValueError, match=words):
        World.from_distance(f, bounds, spacing)


def test_the_function_is_asked_within_the_bounds_alone() -> None:
    asked: list[np.ndarray] = []

    def seen(points: np.ndarray) -> np.ndarray:
        asked.append(points)
        return tilted(points)

    spacing = 0.07
    kept: Callable[[np.ndarray], np.ndarray] = World.from_distance(seen, BOX, spacing).distance
    count, places = len(asked), np.concatenate(asked)
    assert (places >= np.array(BOX[0])).all()
    assert (places <= np.array(BOX[1]) + spacing).all()
    kept(places)
    assert len(asked) == count, "afterwards it is not called any more"
