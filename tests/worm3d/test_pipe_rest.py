"""Worms at rest in pipes: they stick inside the cone of friction, and their loads balance weight and wedging."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import TravellingWave
from worm3d import (
    Bend,
    Centreline,
    Command,
    Friction,
    Pipe,
    Plane,
    Profile,
    Result,
    State,
    StateError,
    Status,
    Straight,
    Worm,
)
from worm3d.values.arrays import FloatArray
from worm3d.worlds.kernels import looked_up as rows

STIFF = Worm(k_spring=100.0)
WEIGHT = 0.1 * 9.81


def tilted(tilt: float, radius: float = 0.12) -> Pipe:
    return Pipe(Centreline.of([Straight(3.0)], tilt=tilt), radius)


def resting(pipe: Pipe, mu: float, state: State | None = None, worm: Worm | None = None) -> Result:
    """65 s of a worm that is left alone, or kept contracted."""
    worm = worm or Worm()
    start = State.straight(worm, pipe) if state is None else state
    kept = Command(start.contraction)
    return worm3d.simulate(
        worm, pipe, Friction(mu, mu, mu), actuation=lambda t: kept, duration=65.0, state=start, record_every=100
    )


def assert_rests(run: Result) -> None:
    """No creep in the last 60 s, and the forces of the wall carry the weight to 1e-8 of the loads (or of 1 N).

    Of wedged loads, 150 N in all, for one: 2e-16 m, the rounding of a position, times the stiffness of an anchor under
    12 N, N mu^2/rho_b = 2e7 N/m, is 4e-9 N already.
    """
    assert run.status is Status.DONE
    after = run.time >= 5.0
    assert np.abs(run.joints[after] - run.joints[-1]).max() < 1e-12
    loads = run.normal_load[-1].sum()
    balance = run.contact_force[-1].sum(axis=(0, 1)) - [0.0, 0.0, WEIGHT]
    assert_allclose(balance, 0.0, rtol=0, atol=1e-8 * max(1.0, loads))


def normal_forces(run: Result) -> FloatArray:
    """Normal forces on the apexes in the last row, shape (N, 6, 3) [N]."""
    assert isinstance(run.world, Pipe)
    normals = rows(run.world.kernel(), run.points[-1, :, :6])[1:4]
    return run.normal_load[-1, :, :, None] * np.moveaxis(normals, 0, -1)


@pytest.mark.parametrize(("degrees", "mu"), [(0, 0.5), (20, 0.5), (45, 1.2), (60, 2.0), (70, 6.0)])
def test_a_worm_in_a_tilted_pipe_sticks_inside_the_cone(degrees: float, mu: float) -> None:
    assert_rests(resting(tilted(np.deg2rad(degrees)), mu))


@pytest.mark.parametrize("degrees", [20, 45])
def test_a_worm_beyond_the_cone_slides(degrees: float) -> None:
    """The wall is a wedge: it multiplies the loads, and friction with them, by 1/sqrt(1 - (b/R)^2) = 1.03."""
    mu = 0.9 * np.tan(np.deg2rad(degrees)) / 1.2
    pipe = tilted(np.deg2rad(degrees))
    run = worm3d.simulate(Worm(), pipe, Friction(mu, mu, mu), duration=2.0)
    assert run.distance < -0.1
    assert run.com_velocity[-1] @ pipe.centreline.tangent[0] < -0.1


@pytest.mark.parametrize("degrees", [0, 30])
@pytest.mark.parametrize("radius", [0.1, 0.12, 0.3])
def test_the_wall_wedges_the_worm(radius: float, degrees: float) -> None:
    """Apexes at the lateral offsets +-b touch where the normal is inclined by asin(b/R), end faces at the bottom:

    sqrt(1 - (b/R)^2) times the loads of apexes, and those of faces, add up to the weight across the pipe.
    """
    run = worm3d.simulate(Worm(), tilted(np.deg2rad(degrees), radius), Friction(0.0, 0.0, 0.0, 1.0), duration=0.01)
    apexes, faces = run.normal_load[0].sum(), run.joint_load[0].sum()
    pressing = WEIGHT * np.cos(np.deg2rad(degrees))
    assert_allclose(np.sqrt(1.0 - (0.03 / radius) ** 2) * apexes + faces, pressing, rtol=1e-5)
    across = normal_forces(run).sum(axis=(0, 1)) @ [-np.sin(np.deg2rad(degrees)), 0.0, np.cos(np.deg2rad(degrees))]
    assert_allclose(across + run.joint_load[-1].sum(), pressing, rtol=0, atol=1e-8)


def test_a_contracted_worm_is_wedged_in_a_vertical_pipe() -> None:
    """Opposite walls press it with equal forces; friction carries all of the weight."""
    pipe = tilted(np.pi / 2, 0.092)
    run = resting(pipe, 0.8, State.straight(STIFF, pipe, contraction=0.2), STIFF)
    assert_rests(run)
    force = normal_forces(run)
    assert np.abs(force[:, 2, 1]).min() > 5.0  # each outward apex presses
    assert_allclose(force.sum(axis=(0, 1)), 0.0, rtol=0, atol=1e-8)
    assert_allclose(force[:, 2], -force[:, 5], rtol=0, atol=1e-8)


def test_the_contraction_at_the_start_is_that_of_the_actuators() -> None:
    """They give it from the first instant, without a lag, and the state at the end tells what they give then."""
    pipe = tilted(np.pi / 2, 0.092)
    state = State.straight(STIFF, pipe, contraction=0.2)
    assert state.contraction.shape == (6, 2)
    run = worm3d.simulate(STIFF, pipe, Friction(0.8, 0.8, 0.8), duration=0.3, state=state)  # asked to let go
    assert_allclose(run.contraction[0], 0.2, rtol=0, atol=1e-15)
    assert_allclose(run.contraction[-1], 0.2 * np.exp(-0.3 / STIFF.actuator_lag), rtol=1e-9)
    assert_allclose(run.state.contraction, run.contraction[-1], rtol=0, atol=0)


def test_a_worm_that_is_not_wedged_falls() -> None:
    run = worm3d.simulate(STIFF, tilted(np.pi / 2, 0.092), Friction(0.8, 0.8, 0.8), duration=0.2)
    assert_allclose(run.com_velocity[-1], [0.0, 0.0, -9.81 * 0.2], rtol=0, atol=1e-9)


UPHILL = Centreline.of([Straight(1.2), Bend(np.pi / 3, 0.48, "up"), Straight(1.2)])
ASIDE = Centreline.of([Straight(1.2), Bend(np.pi / 2, 0.48), Straight(1.2)])


@pytest.mark.parametrize(
    ("pipe", "at"),
    [
        (Pipe(ASIDE, 0.12), 0.0),
        (Pipe(ASIDE, 0.12), 0.9),
        (Pipe(UPHILL, 0.12), 0.9),
        (Pipe(Centreline.of([Straight(3.0)]), Profile([0.3, 0.6], [0.12, 0.1])), 0.0),
    ],
)
def test_a_worm_rests_in_bends_and_narrowings(pipe: Pipe, at: float) -> None:
    assert_rests(resting(pipe, 2.0, State.straight(Worm(), pipe, position=(at, 0.0))))


def test_a_worm_put_into_a_bend_follows_it() -> None:
    pipe = Pipe(ASIDE, 0.12)
    state = State.straight(Worm(), pipe, position=(0.9, 0.0))
    assert_allclose(np.linalg.norm(np.diff(state.joints, axis=0), axis=1), Worm().l0, rtol=0, atol=1e-13)
    assert_allclose(state.joints[:, 2], state.joints[0, 2], rtol=0, atol=1e-14)
    places, _ = ASIDE.at(pipe.along(state.joints))
    assert_allclose((state.joints - places)[:, :2], 0.0, rtol=0, atol=1e-12)
    back = State.straight(Worm(), pipe, position=(1.9, 0.0), azimuth=np.pi)
    assert np.all(np.diff(pipe.along(back.joints)) < 0.0)


def test_in_a_wide_pipe_it_lies_as_on_a_plane() -> None:
    """As R grows, the loads become those of the plane; apexes lie b^2/2R higher than end faces."""
    flat = worm3d.simulate(Worm(), Plane(), duration=0.01).normal_load[0]
    off = [
        np.abs(worm3d.simulate(Worm(), tilted(0.0, radius), duration=0.01).normal_load[0] - flat).max()
        for radius in (30.0, 300.0)
    ]
    assert off[1] < 1e-4
    assert_allclose(off[0] / off[1], 10.0, rtol=0.01)


def test_a_pipe_narrower_than_the_worm() -> None:
    for tilt in (0.0, np.pi / 2):
        with pytest.raises(StateError, match=r"narrower than the worm: a radius of 0.07 m leaves no room for it; make"):
            State.straight(Worm(), tilted(tilt, 0.07))
    State.straight(Worm(), tilted(0.0, 0.0801))


def test_a_start_inside_the_wall_or_across_the_pipe() -> None:
    pipe = tilted(0.0)
    lifted = State.straight(Worm(), position=(0.0, 0.0, 0.1))
    with pytest.raises(StateError, match=r"segment \d lies 0.03\d+ m inside the world; lift or move the worm"):
        worm3d.simulate(Worm(), pipe, state=lifted)
    with pytest.raises(StateError, match=r"position: got \[0.0, 0.1\] m, must be \(how far along the pipe"):
        State.straight(Worm(), pipe, position=(0.0, 0.1))
    with pytest.raises(StateError, match=r"azimuth: got 1.0 rad, must be 0 \(along the pipe\) or pi"):
        State.straight(Worm(), pipe, azimuth=1.0)
    with pytest.raises(ValueError, match=r"contraction: got 1.5, must be below 1"):
        State.straight(Worm(), pipe, contraction=1.5)


def test_distance_counts_along_the_pipe() -> None:
    """Backwards through a bend: from its own tail's point of view a worm falls back down a steep pipe."""
    pipe = tilted(np.pi / 2, 0.092)
    run = worm3d.simulate(STIFF, pipe, duration=0.2)
    assert_allclose(run.distance, run.com[-1, 2] - run.com[0, 2], rtol=1e-12)
    down = State.straight(STIFF, pipe, position=(2.0, 0.0), azimuth=np.pi)
    run = worm3d.simulate(STIFF, pipe, duration=0.2, state=down)
    assert_allclose(run.distance, run.com[0, 2] - run.com[-1, 2], rtol=1e-12)
    assert run.distance > 0.1


def test_the_energy_ledger_closes_in_a_bend() -> None:
    pipe = Pipe(ASIDE, 0.1)
    run = worm3d.simulate(
        Worm(),
        pipe,
        actuation=TravellingWave(amplitude=0.3),
        duration=3.0,
        state=State.straight(Worm(), pipe, position=(0.8, 0.0)),
    )
    assert run.status is Status.DONE
    assert run.energy.balance_error < 1e-9
