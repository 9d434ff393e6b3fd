"""What is free in any of several worlds is free."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import TravellingWave
from worm3d import (
    Bend,
    Centreline,
    ClampedGround,
    Friction,
    Heightfield,
    Patch,
    Pipe,
    Plane,
    State,
    Status,
    Straight,
    Union,
    Worm,
    slope_into_pipe,
)
from worm3d.worlds.kernels import looked_up as rows

SLOPE = np.deg2rad(10.0)
TUNNEL = slope_into_pipe(SLOPE, 1.2, [Straight(0.5), Bend(1.0, 0.5), Straight(1.0)], 0.12)


def test_the_distance_is_the_greatest_and_the_rows_are_those_of_its_world() -> None:
    parts = (Plane(0.1, patches=(Patch(0.5),)), Pipe(Centreline.of([Straight(1.0)], start=(0.0, 0.0, -0.2)), 0.15))
    points = np.random.default_rng(2).uniform([-0.5, -0.3, -0.5], [1.5, 0.3, 0.3], (500, 3))
    each = np.array([rows(part.kernel(), points) for part in parts])
    first = each[0, 0] >= each[1, 0]
    assert 100 < first.sum() < 400
    assert_array_equal(rows(Union(parts).kernel(), points), np.where(first, each[0], each[1]))


def test_worlds_of_tables_and_of_formulas_join() -> None:
    """Rubble with a shaft in it, and a union within a union; more points than are handed over at once."""
    rubble = Heightfield.rubble(2.0, 1.0, 0.02, height=0.03, size=0.1)
    shaft = Pipe(Centreline.of([Straight(1.0)], start=(1.0, 0.0, 0.2), tilt=-np.pi / 2), 0.3)
    points = np.random.default_rng(4).uniform([-0.8, -0.4, -0.2], [1.8, 0.4, 0.08], (1333, 3))
    each = np.array([rows(part.kernel(), points) for part in (rubble, shaft, Plane(0.1))])
    expected = each[each[:, 0].argmax(axis=0), :, np.arange(len(points))].T
    assert all((expected[0] == part[0]).sum() > 20 for part in each)
    for union in (Union([rubble, shaft, Plane(0.1)]), Union([Union([rubble, shaft]), Plane(0.1)])):
        assert_array_equal(rows(union.kernel(), points), expected)


def test_a_worm_falls_through_a_hole_in_the_ground() -> None:
    """Onto the pipe's end wall, 0.4 m down; on the ground alone it stays."""
    ground = Heightfield(np.zeros((40, 40)), 0.1, (-2.0, -2.0))
    hole = Pipe(Centreline.of([Straight(2.0)], start=(0.5, 0.0, -0.4), tilt=np.pi / 2), 0.8, start_wall=True)
    start = State.straight(Worm(), ground)
    ends = [
        worm3d.simulate(Worm(), world, duration=1.0, state=start, settle_first=False, record_every=10).com[-1, 2]
        for world in (ground, Union([ground, hole]))
    ]
    assert_allclose(ends[1] - ends[0], -0.4, rtol=0, atol=1e-3)


def test_inside_the_solid_the_distance_is_exact() -> None:
    """Two half-spaces that meet in a ridge: the solid is the wedge below both, the way out of it the shorter one."""
    wedge = Union([Plane(0.4), Plane(-0.4)])
    points = np.random.default_rng(3).uniform([-1.0, -1.0, -1.0], [1.0, 1.0, 0.0], (200, 3))
    left, right = (points @ Plane(slope).axes[2] for slope in (0.4, -0.4))
    inside = np.maximum(left, right) < 0.0
    assert inside.sum() > 50
    found = wedge.distance(points)
    assert_allclose(found[inside], -np.minimum(-left, -right)[inside], rtol=0, atol=1e-14)
    assert_array_equal(found > 0.0, (left > 0.0) | (right > 0.0))


def test_the_mouth_of_the_tunnel_lies_on_the_slope() -> None:
    plane, pipe = TUNNEL.worlds
    lip = 1.2 * np.array([np.cos(SLOPE), 0.0, np.sin(SLOPE)])
    assert isinstance(pipe, Pipe)
    assert_allclose([plane.distance(lip), pipe.distance(lip)], 0.0, rtol=0, atol=1e-14)
    ahead = np.array([1.0, 0.0, 0.0])
    assert_allclose(TUNNEL.distance(lip - 0.1 * ahead), 0.1 * np.sin(SLOPE), rtol=0, atol=1e-14)
    assert_allclose(TUNNEL.distance(lip + 0.4 * ahead), 0.0, rtol=0, atol=1e-14)  # its bottom
    assert TUNNEL.distance(lip + 0.4 * ahead + [0.0, 0.3, 0.0]) < -0.05  # beside it, the hill


def test_a_worm_climbs_the_slope_and_goes_into_the_tunnel() -> None:
    world = slope_into_pipe(SLOPE, 1.1, [Straight(3.0)], 0.12)
    gait = TravellingWave(period=2.0, amplitude=0.3)
    run = worm3d.simulate(Worm(), world, Friction(0.1, 0.6, 0.6), actuation=gait, duration=30.0, record_every=10)
    assert run.status is Status.DONE
    pipe = world.worlds[1]
    assert isinstance(pipe, Pipe)
    tail, head = pipe.along(run.joints[-1, [0, -1]])
    assert 0.5 < tail < head
    assert run.energy.balance_error < 1e-9
    assert np.ptp(run.joints[-1, :, 2]) < 0.06  # level again; the wave lifts segments a little
    deepest = world.distance(run.points[:, :, :6]).min()
    assert deepest > -1e-4


def test_a_worm_at_rest_across_the_edge_sticks() -> None:
    """Half on the slope, half in the tunnel."""
    world = slope_into_pipe(SLOPE, 0.5, [Straight(2.0)], 0.12)
    run = worm3d.simulate(Worm(), world, Friction(1.0, 1.0, 1.0), duration=65.0, record_every=100)
    assert run.status is Status.DONE
    after = run.time >= 5.0
    assert np.abs(run.joints[after] - run.joints[-1]).max() < 1e-12
    assert_allclose(run.contact_force[-1].sum(axis=(0, 1)), [0.0, 0.0, 0.1 * 9.81], rtol=0, atol=1e-8)


def test_a_union_of_one_is_that_one() -> None:
    for world in (Plane(0.2), Pipe(Centreline.of([Straight(2.0)]), 0.12)):
        gait = TravellingWave(amplitude=0.2)
        runs = [worm3d.simulate(Worm(), each, actuation=gait, duration=1.0) for each in (world, Union([world]))]
        assert_array_equal(runs[0].joints, runs[1].joints)


def test_a_worm_is_placed_on_the_first_world() -> None:
    on = State.straight(Worm(), TUNNEL, position=(0.1, 0.05), azimuth=0.3)
    assert_allclose(on.joints, State.straight(Worm(), Plane(SLOPE), (0.1, 0.05), 0.3).joints, rtol=0, atol=1e-15)


def test_bumps_of_any_of_its_worlds_are_seen() -> None:
    fine = Heightfield.rubble(3.0, 1.5, 0.01, height=0.08, size=0.05)
    world = Union([Plane(), fine])
    assert world.bumps(0.1) == fine.bumps(0.1) > 0.05
    assert Union([Plane()]).bumps(0.1) == 0.0
    with pytest.raises(ValueError, match="state: the terrain is finer than the worm's contact points"):
        worm3d.simulate(Worm(), world, duration=0.1)


def test_what_is_no_union_is_refused() -> None:
    with pytest.raises(ValueError, match="worlds: got none, must be at least one"):
        Union([])
    with pytest.raises(ValueError, match="worlds: got ClampedGround, must be worlds with a distance: Plane, Pipe"):
        Union([ClampedGround()])
    with pytest.raises(ValueError, match=r"tilt: got 0.3 rad, must be less than the slope \(0.2 rad\)"):
        slope_into_pipe(0.2, 1.0, [Straight(1.0)], 0.1, tilt=0.3)
