"""The foot of a hill: in front of a slope and of a steeper face."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control import gaits
from worm3d import Plane, Straight, Worm, slope_into_pipe
from worm3d.worlds import Foot
from worm3d.worlds.kernels import looked_up

FOOT = Foot(slope=0.1, face=1.3, place=0.8, heading=0.4)
POINTS = np.random.default_rng(3).uniform([-0.5, -0.5, -0.4], [1.5, 1.5, 0.6], (400, 3))


def test_the_distance_is_to_the_nearer_plane() -> None:
    """In free space and in the hill it is the distance to the nearest of many points of the surface."""
    slope, face = Plane(0.1, 0.4), Plane(1.3, 0.4)
    nearer = np.minimum(slope.distance(POINTS), face.distance(POINTS - 0.8 * slope.axes[0]))
    found = FOOT.distance(POINTS)
    assert_allclose(found[nearer >= 0.0], nearer[nearer >= 0.0], atol=1e-15)
    behind = found < nearer - 0.02
    free = POINTS[(nearer > 0.05) & (nearer < 0.15)][:5]
    up, across = np.linspace(-3.0, 3.0, 1201)[:, None, None], np.linspace(-2.0, 2.0, 801)[:, None]
    sides = [0.8 * slope.axes[0] + sign * np.abs(up) * side.axes[0] for sign, side in ((-1.0, slope), (1.0, face))]
    surface = np.concatenate([(side + across * slope.axes[1]).reshape(-1, 3) for side in sides])
    solid = np.concatenate([POINTS[(nearer < -0.05) & ~behind][:5], POINTS[behind][:5]])
    for points, sign in ((free, 1.0), (solid, -1.0)):
        nearest = [sign * np.linalg.norm(surface - point, axis=1).min() for point in points]
        assert len(points) >= 5
        assert_allclose(nearest, FOOT.distance(points), atol=2e-4)


def test_the_kernel_has_the_distance_its_gradient_and_hessian() -> None:
    rows, h = looked_up(FOOT.kernel(), POINTS), 1e-6
    assert_allclose(rows[0], FOOT.distance(POINTS), atol=1e-15)
    assert_allclose(rows[1:4].T, FOOT.normal(POINTS, 1.0), atol=1e-7)
    assert_allclose(rows[10], 1.0)
    upper = [(d, e) for d in range(3) for e in range(d, 3)]
    for row, (d, e) in zip(rows[4:10], upper, strict=True):
        ahead, back = (looked_up(FOOT.kernel(), POINTS + sign * h * np.eye(3)[d])[1 + e] for sign in (1.0, -1.0))
        assert_allclose(row, (ahead - back) / (2.0 * h), atol=1e-5)
    curved = np.any(rows[4:10] != 0.0, axis=0)
    assert 20 < np.sum(curved) < 200
    assert np.all(rows[0, curved] < 0.0)


def test_the_normal_turns_from_slope_to_face_in_the_corner() -> None:
    """A point that lies at the same depth behind both is pushed out of both alike."""
    slope, face = (side.axes[2] for side in FOOT.sides)
    shares = np.linspace(0.0, 1.0, 11)[:, None]
    out = (1.0 - shares) * slope + shares * face
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    rows = looked_up(FOOT.kernel(), FOOT.corner - 1e-5 * out)
    assert_allclose(rows[0], -1e-5, rtol=1e-9)
    assert_allclose(rows[1:4].T, out, atol=1e-9)


def test_the_height_is_where_the_distance_is_0() -> None:
    xy = POINTS[:, :2]
    assert_allclose(FOOT.distance(np.column_stack([xy, FOOT.height(xy)])), 0.0, atol=1e-12)


def test_what_is_no_foot_is_told() -> None:
    with pytest.raises(ValueError, match=r"face: got 0\.1 rad, must be more than the slope"):
        Foot(slope=0.1, face=0.1)
    with pytest.raises(ValueError, match=r"tilt: got 1\.4 rad, must be less than the face"):
        slope_into_pipe(0.1, 1.0, [Straight(1.0)], 0.1, tilt=1.4, face=1.3)


@pytest.mark.parametrize(("amplitude", "period"), [(0.15, 1.0), (0.25, 2.0)])
def test_a_worm_gets_out_of_the_corner_at_the_foot(amplitude: float, period: float) -> None:
    """Beside its bottom the pipe is above the slope: chambers' corners wedge between slope and face, and go up it."""
    slope, tilt, face = np.deg2rad([6.0, 5.0, 80.0])
    world = slope_into_pipe(slope, 0.9, [Straight(2.0)], 0.13, tilt=tilt, face=face)
    friction, gait = worm3d.Friction(0.3, 0.8, 0.8), gaits.TravellingWave(period=period, amplitude=amplitude)
    worm = Worm(k_spring=100.0)
    result = worm3d.simulate(worm, world, friction, actuation=gait, duration=5.0, dt=0.005, record_every=10)
    assert result.status.name == "DONE"
    assert result.halved_steps == 0
    assert result.com[-1, 0] - result.com[0, 0] > 0.2


def test_a_worm_that_lies_at_the_foot_stays_there() -> None:
    """Its feet are on the slope only; the pipe's bottom begins a radius before the face."""
    world = slope_into_pipe(0.1, 1.0, [Straight(1.0)], 0.12, tilt=0.05, face=1.3)
    assert world.worlds[0].place == pytest.approx(1.12)
    result = worm3d.simulate(Worm(), world, worm3d.Friction(0.3, 0.8, 0.8), duration=0.3, record_every=10)
    assert result.status.name == "DONE"
    assert np.abs(result.com[-1] - result.com[0]).max() < 1e-3
