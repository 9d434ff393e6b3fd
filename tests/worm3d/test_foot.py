"""The foot of a hill: in front of a slope and of a steeper face."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from worm3d import Plane, Straight, Worm, slope_into_pipe
from worm3d.worlds import Foot
from worm3d.worlds.kernels import looked_up

FOOT = Foot(slope=0.1, face=1.3, place=0.8, heading=0.4)
POINTS = np.random.default_rng(3).uniform([-0.5, -0.5, -0.4], [1.5, 1.5, 0.6], (400, 3))


def test_the_distance_is_to_the_nearer_plane() -> None:
    """In free space it is the distance to the nearest of many points of the surface."""
    slope, face = Plane(0.1, 0.4), Plane(1.3, 0.4)
    expected = np.minimum(slope.distance(POINTS), face.distance(POINTS - 0.8 * slope.axes[0]))
    assert_allclose(FOOT.distance(POINTS), expected, atol=1e-15)
    free = POINTS[(expected > 0.05) & (expected < 0.15)][:20]
    up, across = np.linspace(-3.0, 3.0, 1201)[:, None, None], np.linspace(-2.0, 2.0, 801)[:, None]
    sides = [0.8 * slope.axes[0] + sign * np.abs(up) * side.axes[0] for sign, side in ((-1.0, slope), (1.0, face))]
    surface = np.concatenate([(side + across * slope.axes[1]).reshape(-1, 3) for side in sides])
    nearest = [np.linalg.norm(surface - point, axis=1).min() for point in free]
    assert len(free) > 5
    assert_allclose(nearest, FOOT.distance(free), atol=2e-4)


def test_the_kernel_has_the_distance_its_gradient_and_no_curvature() -> None:
    rows = looked_up(FOOT.kernel(), POINTS)
    assert_allclose(rows[0], FOOT.distance(POINTS), atol=1e-15)
    assert_allclose(rows[1:4].T, FOOT.normal(POINTS, 1.0), atol=1e-7)
    assert_allclose(rows[4:10], 0.0)
    assert_allclose(rows[10], 1.0)


def test_the_height_is_where_the_distance_is_0() -> None:
    xy = POINTS[:, :2]
    assert_allclose(FOOT.distance(np.column_stack([xy, FOOT.height(xy)])), 0.0, atol=1e-12)


def test_what_is_no_foot_is_told() -> None:
    with pytest.raises(ValueError, match=r"face: got 0\.1 rad, must be more than the slope"):
        Foot(slope=0.1, face=0.1)
    with pytest.raises(ValueError, match=r"tilt: got 1\.4 rad, must be less than the face"):
        slope_into_pipe(0.1, 1.0, [Straight(1.0)], 0.1, tilt=1.4, face=1.3)


def test_a_worm_that_lies_at_the_foot_stays_there() -> None:
    """Its feet are on the slope only; the pipe's bottom begins a radius before the face."""
    world = slope_into_pipe(0.1, 1.0, [Straight(1.0)], 0.12, tilt=0.05, face=1.3)
    assert world.worlds[0].place == pytest.approx(1.12)
    result = worm3d.simulate(Worm(), world, worm3d.Friction(0.3, 0.8, 0.8), duration=0.3, record_every=10)
    assert result.status.name == "DONE"
    assert np.abs(result.com[-1] - result.com[0]).max() < 1e-3
