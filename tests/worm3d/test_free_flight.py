"""Free flight: momentum, the integrators' parabolas and rotors, their orders."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d import Command, Friction, Held, Result, State, Status, Worm, simulate
from worm3d.physics.kernels import segment
from worm3d.running.plant import Plant

N = 4
PLACES = (np.arange(N) + 0.5) / N
OMEGA, SPEED = np.array([2.0, -1.0, 1.5]), np.array([0.3, 0.2, 1.0])
INTEGRATORS = ("implicit_euler", "bdf2")


def uneven_worm() -> Worm:
    """Return a worm in which every parameter counts and differs along the body."""
    rng = np.random.default_rng(5)
    return Worm(
        segments=N,
        length=0.8,
        joint_mass_fraction=0.4,
        chamber_offset=0.04,
        half_height=rng.uniform(0.05, 0.08, N),
        k_spring=rng.uniform(5.0, 20.0, N),
        k_torsion=rng.uniform(0.2, 0.6, N - 1),
        k_yaw=rng.uniform(0.2, 0.6, N - 1),
        k_twist=rng.uniform(0.2, 0.6, N - 1),
        cross0=rng.uniform(-0.15, 0.15, N - 1),
        k_apex=rng.uniform(0.01, 0.05, N),
        kelvin_voigt_time=0.03,
        actuator_lag=0.05,
    )


def tumbling(worm: Worm, height: float = 5.0) -> State:
    """Return a worm bent in all directions that moves like a rigid body, with OMEGA about the origin and SPEED.

    A director turns with the body: relative to parallel transport, which has no spin about the tangent, it rolls with
    omega.t.
    """
    yaw, pitch = np.array([0.0, 0.3, 0.1, -0.3]), np.array([0.1, -0.2, 0.15, 0.0])
    t = np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    lengths = worm.l0 * np.array([1.02, 0.97, 1.0, 0.95])
    start = np.array([[0.0, 0.0, height]])
    joints = np.vstack([start, start + np.cumsum(lengths[:, None] * t, axis=0)])
    return State(
        joints=joints, bend=[0.1, -0.2, 0.1, 0.2], joint_velocity=np.cross(OMEGA, joints) + SPEED, roll_rate=t @ OMEGA
    )


def writhing(t: float) -> Command:
    """Return smooth commands of every kind: unequal chambers, hinges and forces, at rest at 0 and 0.4 s."""
    swell = np.sin(np.pi * t / 0.4) ** 2
    wave = 0.15 * swell * np.sin(2 * np.pi * (PLACES - t / 0.4))
    hinge = 0.5 * swell * np.sin(2 * np.pi * (np.arange(N - 1) / N + t / 0.4))
    force = 0.2 * swell * np.column_stack([np.cos(5 * PLACES), np.sin(3 * PLACES)])
    return Command(np.column_stack([1.3 * wave, 0.7 * wave]), hinge=hinge, force=force)


def fly(integrator: str, dt: float = 0.01, **changes: Any) -> Result:
    worm = uneven_worm()
    arguments = {"actuation": writhing, "duration": 0.4, "state": tumbling(worm), "settle_first": False} | changes
    result = simulate(worm, None, dt=dt, integrator=integrator, **arguments)
    assert result.status is Status.DONE
    assert result.halved_steps == 0
    return result


def mass_points(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Return mass [kg] and places (T, M, 3) [m] of joints and apexes."""
    worm, count = result.worm, len(result.time)
    mass = np.concatenate([worm.joint_mass, worm.apex_mass.ravel()])
    return mass, np.concatenate([result.joints, result.apexes.reshape(count, -1, 3)], axis=1)


def spin(result: Result) -> np.ndarray:
    """Return the angular momentum about the centre of mass, shape (T, 3) [kg m^2/s]."""
    return result.angular_momentum - np.cross(result.com, result.momentum)


def test_a_state_that_moves_like_a_rigid_body_has_its_momenta() -> None:
    """P = m (v + omega x X_com), L = sum m X x (omega x X + v), in the first row, apexes and rolls included."""
    result = fly("bdf2", duration=0.01)
    mass, places = mass_points(result)
    velocity = np.cross(OMEGA, places[0]) + SPEED
    assert_allclose(result.momentum[0], mass @ velocity, rtol=1e-13)
    assert_allclose(result.angular_momentum[0], mass @ np.cross(places[0], velocity), rtol=1e-12)
    com = np.einsum("m,tmk->tk", mass, places) / mass.sum()
    assert_allclose(result.com, com, rtol=0, atol=1e-14)
    assert_allclose(mass.sum(), 0.1, rtol=1e-14)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_centre_of_mass_follows_the_integrators_own_parabola(integrator: str) -> None:
    """Internal forces cancel: com and momentum obey the integrator's recursion under g alone, whatever the worm does.

    Implicit Euler: V_k = V_0 + k dt g and X_{k+1} = X_k + dt V_{k+1} give X_k = X_0 + k dt V_0 + k (k+1)/2 dt^2 g.
    BDF2 differentiates a parabola exactly; its first step is implicit Euler's, which ends dt^2 g/2 too far. An error
    e_k of X obeys e_{k+1} = (4 e_k - e_{k-1})/3, whose increments shrink by three: e_k = 3/4 (1 - 3^-k) dt^2 g. The
    velocities are exact.
    """
    g, dt = np.array([1.0, -2.0, -9.81]), 0.01
    result = fly(integrator, dt, gravity=g)
    k = np.arange(len(result.time))[:, None]
    start = result.momentum[0] / result.worm.mass
    own = k * (k + 1) / 2 if integrator == "implicit_euler" else k**2 / 2 + 0.75 * (1.0 - 3.0**-k)
    assert_allclose(result.com_velocity, start + k * dt * g, rtol=0, atol=1e-11)
    assert_allclose(result.com, result.com[0] + k * dt * start + own * dt**2 * g, rtol=0, atol=1e-12)
    assert np.abs(result.joints[-1] - result.joints[0] - (result.com[-1] - result.com[0])).max() > 0.05, "it writhes"


@pytest.mark.parametrize(("integrator", "order"), [("implicit_euler", 1.0), ("bdf2", 2.0)])
def test_centre_of_mass_tends_to_the_true_parabola(integrator: str, order: float) -> None:
    g, errors = np.array([0.0, 0.0, -9.81]), []
    for dt in (0.02, 0.01, 0.005):
        result = fly(integrator, dt)
        true = result.com[0] + 0.4 * result.momentum[0] / result.worm.mass + 0.4**2 / 2 * g
        errors.append(np.abs(result.com[-1] - true).max())
    assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), order, atol=0.01)
    assert errors[-1] < {1.0: 0.01, 2.0: 2e-4}[order]


def test_a_worm_may_fall_below_the_height_zero() -> None:
    """Without a world there is nothing to sink into: a fall from height 0 is that from 5 m."""
    high, low = fly("bdf2"), simulate(uneven_worm(), None, state=tumbling(uneven_worm(), 0.0), duration=0.4)
    assert low.status is Status.DONE, low.stop.sentence
    assert high.com[-1, 2] < 5.0


@pytest.mark.parametrize(("integrator", "order", "cap"), [("implicit_euler", 1.0, 1e-2), ("bdf2", 2.0, 1e-4)])
def test_angular_momentum_converges(integrator: str, order: float, cap: float) -> None:
    """About the centre of mass it is constant; what the integrator loses in 0.4 s, of what there is, at its order."""
    losses = []
    for dt in (5e-4, 2.5e-4, 1.25e-4):
        angular = spin(fly(integrator, dt))
        losses.append(np.linalg.norm(angular[-1] - angular[0]) / np.linalg.norm(angular[0]))
    assert_allclose(np.log2(np.array(losses[:-1]) / losses[1:]), order, atol=0.15)
    assert losses[-1] < cap


def rotor(bdf2: bool, omega: float, dt: float, steps: int) -> np.ndarray:
    """Return the azimuth of a rigid rotor after each step."""
    z, v = [1.0 + 0.0j], [1j * omega]
    for k in range(steps):
        second = bdf2 and k > 0
        hat = (4 * z[-1] - z[-2]) / 3 + dt * (8 * v[-1] - 2 * v[-2]) / 9 if second else z[-1] + dt * v[-1]
        new = hat / abs(hat)
        v.append((3 * new - 4 * z[-1] + z[-2]) / (2 * dt) if second else (new - z[-1]) / dt)
        z.append(new)
    return np.unwrap(np.angle(z))


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0)], ids=["yaw", "pitch"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_a_rigid_rotor_turns_as_the_integrator_lets_it(integrator: str, axis: tuple[float, ...]) -> None:
    """The step minimises sum m |X(phi) - Xhat|^2; for a rigid body in its plane X is along Xhat, as a complex number
    z' = zhat/|zhat|. For implicit Euler tan(phi') = sin(phi)/(2 - cos(phi)) from step to step, phi' = phi - phi^3: in a
    second at 5 rad/s it loses a fifth of its speed, BDF2 1 %. A stiff worm tends to this as 1/stiffness.
    """
    dt, omega, errors = 0.01, 5.0, []
    expected = rotor(integrator == "bdf2", omega, dt, 100)
    for stiffness in (1e5, 1e6):
        worm = Worm(segments=2, k_spring=stiffness, k_torsion=stiffness, k_yaw=stiffness, k_twist=stiffness)
        state = State.straight(worm, position=(0.0, 0.0, 2.0))
        velocity = np.cross(omega * np.array(axis), state.joints - state.joints.mean(axis=0))
        result = simulate(
            worm,
            None,
            duration=1.0,
            dt=dt,
            integrator=integrator,
            gravity=(0.0, 0.0, 0.0),
            state=state.with_changes(joint_velocity=velocity),
        )
        chord = result.joints[:, -1] - result.joints[:, 0]
        angle = np.unwrap(np.arctan2(chord[:, 1] + chord[:, 2], chord[:, 0]))
        errors.append(np.abs(angle - expected).max())
    assert errors[1] < 2e-6
    assert_allclose(errors[0] / errors[1], 10.0, rtol=0.01)
    speed = (expected[-1] - expected[-2]) / (omega * dt)
    assert 0.79 < speed < 0.83 if integrator == "implicit_euler" else 0.98 < speed < 0.999


def end(result: Result) -> np.ndarray:
    """Return the configuration at the end, directors and bends in metres of arc."""
    worm = result.worm
    parts = (result.joints[-1], worm.l0 * result.directors[-1], worm.chamber_offset * result.bend[-1])
    return np.concatenate([part.ravel() for part in parts])


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_order_of_the_integrator(integrator: str) -> None:
    """Without contact, between self-similar steps; a tumbling, writhing, damped worm with lag, hinges and forces.

    The difference between halved steps is of the same order as the error; Newton's is 1e-12 m. The cap is on that of
    the last pair, a hundredth and a millionth of the motion.
    """
    order, cap = {"implicit_euler": (1.0, 5e-4), "bdf2": (2.0, 2e-6)}[integrator]
    ends = [end(fly(integrator, dt)) for dt in (1e-3, 5e-4, 2.5e-4, 1.25e-4)]
    steps = np.array([np.abs(a - b).max() for a, b in pairwise(ends)])
    assert_allclose(np.log2(steps[:-1] / steps[1:]), order, atol=0.15)
    assert steps[-1] < cap


def test_both_integrators_tend_to_the_same_motion() -> None:
    """Implicit Euler, extrapolated from two steps to dt = 0 (error of order 2), against BDF2."""
    coarse, fine = (end(fly("implicit_euler", dt)) for dt in (5e-4, 2.5e-4))
    true = end(fly("bdf2", 2.5e-4))
    assert np.abs(fine - true).max() > 1e-4
    assert_allclose(2.0 * fine - coarse, true, rtol=0, atol=2e-5)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize(
    "way", [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)], ids=["hangs", "stands", "juts out"]
)
@pytest.mark.parametrize("segments", [2, 3, 6, 20])
def test_a_chain_without_inertia_in_roll_moves_on(segments: int, way: tuple[float, ...], integrator: Any) -> None:
    """All mass on the axis, held by its tail, straight but for rounding; only damping resists the roll of it all."""
    rng = np.random.default_rng(0)
    for k_twist, off in ((0.5, 0.0), (0.5, 1e-9), (1e-3, 1e-9), (0.5, 1e-4)):
        worm = Worm(segments=segments, joint_mass_fraction=1.0, k_spring=200.0, k_twist=k_twist)
        joints = worm.l0 * np.arange(segments + 1)[:, None] * np.array(way)
        state = State(joints=joints + off * rng.standard_normal(joints.shape))
        tail = Held(np.arange(segments + 1)[:, None] == 0)
        run = simulate(worm, None, state=state, held=tail, duration=0.5, integrator=integrator)
        assert run.status is Status.DONE
        assert run.energy.balance_error < 1e-12


def test_damping_of_roll_leaves_worms_with_mass_off_the_axis_alone() -> None:
    """It fades with the first thousandth of the mass that lies on apexes."""
    dampings = []
    for fraction in (1.0, 0.9995, 0.999, 0.5):
        plant = Plant(Worm(joint_mass_fraction=fraction), None, Friction(), np.zeros(3), np.zeros(35, dtype=bool))
        dampings.append(float(plant.arrays["segment_in"][segment.SEGMENT_LAYOUT.first("roll_damping"), 0]))
    assert dampings[0] > 0.0
    assert_allclose(dampings, [dampings[0], 0.5 * dampings[0], 0.0, 0.0], rtol=1e-9, atol=1e-15)
