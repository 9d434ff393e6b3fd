"""Before a run the worm is brought to rest on its world: equilibrium, from wherever it starts."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from worm3d import (
    Bend,
    Centreline,
    Command,
    Friction,
    Heightfield,
    Mesh,
    Pipe,
    Plane,
    Profile,
    State,
    Status,
    Straight,
    Worm,
)
from worm3d.worlds import World

SHIPPED = Path(__file__).parents[2] / "scenes"

SLOPES = [
    (0.46877909731787637, np.deg2rad(37.0)),
    (0.41062599484256557, 0.569977470649413),
    (0.4772234046998184, -0.36994747963287544),
    (0.5724016246883944, -1.8330345396862178),
    (0.43398925616669354, 2.9936044925337804),
]
"""On which the default worm was not settled: `_search` in solver/descent.py went up where the slope fell again."""


@pytest.mark.parametrize(("slope", "heading"), SLOPES)
def test_the_default_worm_settles_on_any_slope(slope: float, heading: float) -> None:
    run = worm3d.simulate(Worm(), Plane(slope, heading), Friction(1.0, 1.0, 1.0), duration=0.01)
    assert run.status is Status.DONE


@pytest.mark.parametrize("mass", [0.2, 0.3, 0.35, 0.5])
def test_a_heavy_worm_settles_below_its_limit_point(mass: float) -> None:
    run = worm3d.simulate(Worm(mass=mass), Plane(), duration=0.05)
    assert run.status is Status.DONE


@pytest.mark.parametrize("heading", [0.0, 0.7])
@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_a_settled_worm_is_in_equilibrium_under_the_pressing_weight(slope: float, heading: float) -> None:
    """On the level it stays where it was put at rest; loads carry the weight from the first instant."""
    worm = Worm()
    run = worm3d.simulate(worm, Plane(slope, heading), Friction(2.0, 2.0, 2.0), duration=0.01, dt=0.01)
    total = run.normal_load.sum(axis=(1, 2)) + run.joint_load.sum(axis=1)
    assert_allclose(total[0], worm.mass * 9.81 * np.cos(slope), rtol=1e-8)
    assert np.abs(run.joint_velocity[0]).max() == 0.0
    if slope == 0.0:
        assert np.abs(run.joints[1] - run.joints[0]).max() < 1e-11


@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_the_forces_of_the_world_are_there_from_the_first_instant(slope: float) -> None:
    """Normal loads of 0.981 N cos(slope) against the plane, no friction yet; 5 s later all of the weight."""
    worm, plane = Worm(), Plane(slope, 0.7)
    run = worm3d.simulate(worm, plane, Friction(2.0, 2.0, 2.0), duration=5.0, record_every=500)
    weight = np.array([0.0, 0.0, worm.mass * 9.81])
    force = run.contact_force.sum(axis=(1, 2))
    assert_allclose(force[0], weight @ plane.axes[2] * plane.axes[2], rtol=0, atol=1e-8)
    assert_allclose(force[1], weight, rtol=0, atol=1e-8)
    assert_allclose(run.contact_force[0, :, :6] @ plane.axes[2], run.normal_load[0], rtol=0, atol=1e-15)


RUBBLE = Heightfield.rubble(4.0, 2.0, 0.02, height=0.03, size=0.15)
BEND = Pipe(Centreline.of([Straight(1.2), Bend(np.pi / 2, 0.48), Straight(1.2)]), 0.12)
NARROWING = Pipe(Centreline.of([Straight(3.0)]), Profile([0.3, 0.6], [0.12, 0.1]))


@pytest.mark.parametrize(
    ("world", "at"), [(RUBBLE, 0.4), (RUBBLE, 1.7), (BEND, 0.9), (NARROWING, 0.0)], ids=["one", "two", "bend", "narrow"]
)
def test_the_runs_own_friction_holds_it_from_the_first_instant(world: World, at: float) -> None:
    """The default worm with the default friction: without that it slides by 6, 12, 16 and 8 mm after the start."""
    run = worm3d.simulate(Worm(), world, duration=60.0, state=State.straight(Worm(), world, position=(at, 0.0)))
    assert run.status is Status.DONE
    assert np.abs(run.joints - run.joints[0]).max() < 1e-11
    assert np.abs(run.joint_velocity[0]).max() == 0.0
    for row in (0, -1):
        force = run.contact_force[row].sum(axis=(0, 1))
        assert_allclose(force, [0.0, 0.0, 0.981], rtol=0, atol=1e-8)
    assert run.energy.residual[0] == run.energy.friction_loss[0] == 0.0


def test_so_it_does_in_a_tunnel_from_a_mesh() -> None:
    tunnel = Mesh(SHIPPED / "mesh_tunnel.stl", units="m", solid="outside", cell=0.015)
    run = worm3d.simulate(Worm(), tunnel, duration=60.0, state=State.straight(Worm(), tunnel, position=(0.1, 0.0)))
    assert run.status is Status.DONE
    assert np.abs(run.joints - run.joints[0]).max() < 1e-11


@pytest.mark.parametrize("friction", [Friction(), Friction(0.3, 0.8, 0.8)])
def test_so_it_does_wedged_in_a_vertical_pipe(friction: Friction) -> None:
    worm, pipe = Worm(k_spring=100.0), Pipe(Centreline.of([Straight(3.0)], tilt=np.pi / 2), 0.092)
    state = State.straight(worm, pipe, contraction=0.2)
    kept = Command(state.contraction)
    run = worm3d.simulate(worm, pipe, friction, actuation=lambda t: kept, duration=60.0, state=state, record_every=10)
    assert run.status is Status.DONE
    assert np.abs(run.joints - run.joints[0]).max() < 3e-8


def test_where_friction_does_not_hold_it_it_starts_where_it_was_put_and_slides() -> None:
    """0.3 rad up, friction of 0.2 and 0.05: both start in the same place."""
    x, y = np.arange(0.0, 4.01, 0.05), np.arange(-1.0, 1.01, 0.05)
    hill = Heightfield(0.3 * x[:, None] + 0.01 * np.sin(6.0 * x)[:, None] * np.cos(6.0 * y), 0.05)
    state = State.straight(Worm(), hill, position=(1.5, 0.0))
    runs = [worm3d.simulate(Worm(), hill, Friction(mu, mu, mu), duration=0.5, state=state) for mu in (0.05, 0.2)]
    assert_array_equal(runs[0].joints[0], runs[1].joints[0])
    assert runs[0].distance < -0.2
    assert runs[1].distance < -0.05


def test_settled_loads_and_pose_do_not_depend_on_how_high_it_starts() -> None:
    """It is let down, not dropped."""
    lifts = (0.0, 0.01, 0.3)
    states = [State.straight(Worm(), Plane(), position=(0.0, 0.0, lift)) for lift in lifts]
    runs = [worm3d.simulate(Worm(), Plane(), duration=0.01, state=each, settle_first=True) for each in states]
    assert_allclose([run.settling for run in runs], lifts, rtol=0, atol=5e-3)  # it sags by 2 mm
    for run in runs[1:]:
        assert run.status is Status.DONE
        assert_allclose(run.joints[0], runs[0].joints[0], rtol=0, atol=1e-9)


def test_without_settling_it_starts_where_the_state_says() -> None:
    start = State.straight(Worm(), Plane(), position=(0.3, -0.2, 0.05), azimuth=0.5)
    run = worm3d.simulate(Worm(), Plane(), duration=0.5, state=start, settle_first=False)
    assert_allclose(run.joints[0], start.joints, rtol=0, atol=0)
    assert run.normal_load[0].sum() == 0.0
    assert run.normal_load[-1].sum() > 0.5  # it has fallen
    moving = start.with_changes(joint_velocity=np.tile([0.1, 0.0, 0.0], (7, 1)))
    run = worm3d.simulate(Worm(), Plane(), duration=0.05, state=moving)
    assert_allclose(run.joints[0], start.joints, rtol=0, atol=0)
    assert_allclose(run.com_velocity[0], [0.1, 0.0, 0.0], rtol=0, atol=1e-14)
    # In the air for sqrt(2 * 0.05/g) = 0.1 s: BDF2 falls like a stone.
    assert_allclose(run.com_velocity[-1], [0.1, 0.0, -9.81 * 0.05], rtol=0, atol=1e-9)


def test_what_touches_nothing_falls_and_the_result_says_so() -> None:
    start = State.straight(Worm(), Plane(0.2, 0.4), position=(0.0, 0.0, 0.05))
    run = worm3d.simulate(Worm(), Plane(0.2, 0.4), duration=0.5, state=start)
    assert_array_equal(run.joints[0], start.joints)
    assert_allclose(run.com_velocity[8], [0.0, 0.0, -9.81 * 0.08], rtol=0, atol=1e-9)
    assert (run.settled, run.settling, run.summary()["settling_m"]) == (False, None, None)
    assert "was not brought to rest before the run" in run.reasons()["settling_m"]


TUNNEL = Pipe(Centreline.of([Straight(3.0)], tilt=np.pi / 2), 0.092)


@pytest.mark.parametrize(
    ("world", "at"),
    [
        (Plane(), (0.0, 0.0)),
        (Plane(0.4, 0.9), (-3.0, 2.0)),
        (RUBBLE, (0.4, 0.0)),
        (RUBBLE, (1.7, 0.1)),
        (BEND, (0.9, 0.0)),
        (NARROWING, (0.0, 0.0)),
    ],
    ids=["level", "slope", "one", "two", "bend", "narrow"],
)
def test_a_straight_worm_laid_on_its_world_is_settled(world: World, at: tuple[float, float]) -> None:
    start = State.straight(Worm(), world, position=at)
    run = worm3d.simulate(Worm(), world, Friction(0.6, 0.6, 0.6), duration=0.01, state=start)
    assert run.settled
    assert run.settling == run.summary()["settling_m"]
    assert start.laid
    assert_allclose(run.settling, np.linalg.norm(run.joints[0] - start.joints, axis=1).max(), rtol=1e-12)


@pytest.mark.parametrize(("gap", "settled"), [(-1e-9, True), (0.0, True), (1e-9, True), (1e-5, False), (1e-3, False)])
def test_a_gap_of_rounding_is_none(gap: float, settled: bool) -> None:
    joints = np.column_stack([np.linspace(0.0, 1.0, 7), np.zeros(7), np.full(7, 0.05 + gap)])
    run = worm3d.simulate(Worm(), Plane(), duration=0.01, state=State(joints=joints))
    assert run.settled is settled


@pytest.mark.parametrize(("lift", "settled"), [(0.0, True), (0.01, True), (0.3, False)])
def test_a_start_that_is_contracted_touches_where_its_chambers_come_to_the_world(lift: float, settled: bool) -> None:
    start = State.straight(Worm(), Plane(), position=(0.0, 0.0, lift), contraction=0.2)
    assert worm3d.simulate(Worm(), Plane(), duration=0.01, state=start).settled is settled


def test_in_a_steep_pipe_a_worm_falls_unless_it_is_contracted() -> None:
    """There it starts on the centre line, 0.012 m from the wall."""
    loose, wedged = (State.straight(Worm(k_spring=100.0), TUNNEL, contraction=c) for c in (0.0, 0.2))
    runs = [worm3d.simulate(Worm(k_spring=100.0), TUNNEL, duration=0.1, state=each) for each in (loose, wedged)]
    assert [run.settled for run in runs] == [False, True]
    assert_allclose(runs[0].com_velocity[-1], [0.0, 0.0, -0.981], rtol=0, atol=1e-9)


def test_worms_of_a_batch_start_as_they_do_alone() -> None:
    states = [None, *(State.straight(Worm(), Plane(), position=(0.0, 0.0, lift)) for lift in (0.0, 0.05))]
    runs = worm3d.simulate_batch(Worm(), Plane(), duration=0.02, state=states)
    assert [run.settled for run in runs] == [True, True, False]
    alone = [worm3d.simulate(Worm(), Plane(), duration=0.02, state=state) for state in states]
    assert [run.settling for run in runs] == [run.settling for run in alone]


def test_a_state_with_memory_and_one_that_moves_are_not_settled() -> None:
    first = worm3d.simulate(Worm(), Plane(), duration=0.02)
    on = worm3d.simulate(Worm(), Plane(), duration=0.02, state=first.state)
    moving = first.state.with_changes(joint_velocity=0.01)
    assert (first.settled, on.settled) == (True, False)
    assert not worm3d.simulate(Worm(), Plane(), duration=0.02, state=moving).settled
    still = first.state.with_changes(joint_velocity=0.0, roll_rate=0.0, bend_rate=0.0)
    assert worm3d.simulate(Worm(), Plane(), duration=0.02, state=still).settled


@pytest.mark.parametrize("stiffness", [2e4, 300.0, np.linspace(200.0, 900.0, 6)])
def test_a_soft_skin_yields_by_the_load_over_its_stiffness(stiffness: float | np.ndarray) -> None:
    friction = Friction(contact_stiffness=stiffness)
    result = worm3d.simulate(
        Worm(), Plane(), friction, actuation=lambda t: worm3d.Command(np.zeros((6, 2))), duration=0.1
    )
    depth = np.maximum(0.0, -result.apexes[-1, ..., 2])
    k = np.broadcast_to(stiffness, 6)[:, None]
    assert_allclose(k * depth, result.normal_load[-1], atol=1e-8)
    assert_allclose(result.normal_load[-1].sum() + result.joint_load[-1].sum(), 0.1 * 9.81, rtol=1e-9)
    assert np.abs(result.joint_velocity).max() < 1e-12
