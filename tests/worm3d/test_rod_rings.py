"""Rods bent into rings: by an end moment, by hinges, by rest angles. Statics as in test_rod_statics, EI = L = 1."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d import Command, Held, Result, State, Status, Worm, simulate

STEP = 100.0
"""Pseudo time step of statics [s]."""


def couple(worm: Worm, ramp: int) -> Callable[[float], np.ndarray]:
    """Return the end moment 2 pi EI/L, rising over some steps, as a pair of forces across the last segment.

    Their direction goes with the angle (N - 1) phi that the moment gives this segment (see below).
    """
    n = worm.segments

    def force(t: float) -> np.ndarray:
        part = min(1.0, t / (STEP * ramp))
        angle = (n - 1) * 0.5 * np.arcsin(min(1.0, 4 * np.pi * part / n))
        forces = np.zeros((n + 1, 3))
        forces[-1] = 2 * np.pi * part / (worm.length * worm.l0) * np.array([-np.sin(angle), 0.0, np.cos(angle)])
        forces[-2] = -forces[-1]
        return forces

    return force


def polygon(worm: Worm, turn: float) -> State:
    """Return a worm along x at its tail that turns upwards by the same angle at every joint."""
    angles = turn * np.arange(worm.segments)
    edges = worm.l0 * np.column_stack([np.cos(angles), np.zeros(worm.segments), np.sin(angles)])
    joints = np.vstack([[[0.0, 0.0, 5.0]], np.cumsum(edges, axis=0) + 5.0 * np.eye(3)[2]])
    return State(joints=joints, directors=np.tile([0.0, 1.0, 0.0], (worm.segments, 1)))


def bent_to_a_ring(n: int, ramp: int, start: float = 0.0) -> Result:
    """Bend a clamped rod (in pitch, in its plane) by the end moment that closes a ring."""
    worm = Worm(segments=n, joint_mass_fraction=1.0, half_height=0.4, k_spring=1e4, k_torsion=n, kelvin_voigt_time=0.0)
    held = np.arange(n + 1)[:, None] < 2
    return simulate(
        worm,
        None,
        duration=(ramp + 4) * STEP,
        dt=STEP,
        integrator="implicit_euler",
        gravity=(0.0, 0.0, 0.0),
        state=polygon(worm, start),
        external_force=couple(worm, ramp),
        held=Held(held | [False, True, False], roll=True),
    )


def joint_turns(joints: np.ndarray) -> np.ndarray:
    """Return the angles between successive segments in the (x, z) plane."""
    edges = np.diff(joints, axis=0)
    return np.diff(np.unwrap(np.arctan2(edges[:, 2], edges[:, 0])))


def apothem(n: int) -> float:
    """Return the distance of the sides from the middle of a regular polygon with n sides and the circumference 1."""
    return 1.0 / (2 * n * np.tan(np.pi / n))


def test_end_moment_closes_a_ring() -> None:
    """M = 2 pi EI/L bends a rod into a ring; a joint resists with k sin(phi) cos(phi), so that sin(2 phi) = 4 pi/N."""
    gaps, counts = [], (13, 26, 52, 104)
    for n in counts:
        turn = 0.5 * np.arcsin(4 * np.pi / n)
        result = bent_to_a_ring(n, ramp=1, start=0.999 * turn)
        assert result.status is Status.DONE, result.stop.sentence
        assert_allclose(joint_turns(result.joints[-1]), turn, rtol=1e-9)
        gaps.append(np.linalg.norm(result.joints[-1, -1] - result.joints[-1, 0]))
    assert_allclose(np.log2(np.array(gaps[1:-1]) / gaps[2:]), 2.0, atol=0.3)
    assert gaps[-1] < 3e-3


def test_end_moment_curls_a_straight_rod_upwards() -> None:
    result = bent_to_a_ring(52, ramp=40)
    assert_allclose(joint_turns(result.joints[-1]), 0.5 * np.arcsin(4 * np.pi / 52), rtol=1e-8)
    assert_allclose(result.joints[-1, :, 2].mean(), 5.0 + 1 / (2 * np.pi), rtol=2e-3)


def test_twelve_segments_cannot_carry_the_moment_of_a_ring() -> None:
    """k/2 < 2 pi k/12: at 0.955 of it the sine law passes its maximum, at a joint angle of 45 degrees."""
    result = bent_to_a_ring(12, ramp=40)
    assert_allclose(joint_turns(result.joints[30]), 0.5 * np.arcsin(0.75 * 4 * np.pi / 12), rtol=1e-6)
    assert result.status.diverged or joint_turns(result.joints[-1]).max() > np.pi / 4


@pytest.mark.parametrize("n", [6, 20])
def test_hinges_bend_a_free_worm_into_a_ring_to_the_left(n: int) -> None:
    """N - 1 hinges of 2 pi/N close a regular polygon without any strain, with its middle to the left of the worm."""
    worm = Worm(segments=n, actuator_lag=0.0)

    def curl(t: float) -> Command:
        return Command(np.zeros((n, 2)), hinge=2 * np.pi / n * min(1.0, t / (10 * STEP)))

    state = State.straight(worm, position=(0.0, 0.0, 5.0))
    result = simulate(
        worm,
        None,
        actuation=curl,
        duration=15 * STEP,
        dt=STEP,
        integrator="implicit_euler",
        gravity=(0, 0, 0),
        state=state,
    )
    assert result.status is Status.DONE
    joints = result.joints[-1]
    assert_allclose(joints[-1], joints[0], rtol=0, atol=1e-9)
    assert_allclose(np.linalg.norm(np.diff(joints, axis=0), axis=1), worm.l0, rtol=1e-10)
    assert_allclose(joints[:, 2], 5.0, rtol=0, atol=1e-6)  # nothing holds the free worm's attitude
    edge, middle = joints[n // 2 + 1] - joints[n // 2], joints[:-1].mean(axis=0)
    inward = middle - (joints[n // 2 + 1] + joints[n // 2]) / 2
    assert_allclose(np.cross(edge, inward)[2], worm.l0 * apothem(n), rtol=1e-9)


def test_rest_angles_bend_a_free_worm_into_a_ring_upwards() -> None:
    """cross0 = sin(2 pi/N) at N - 1 joints: the same ring in the vertical plane, the head up."""
    n = 12
    worm = Worm(segments=n, cross0=np.sin(2 * np.pi / n), kelvin_voigt_time=1.0)
    state = State.straight(worm, position=(0.0, 0.0, 5.0))
    result = simulate(
        worm, None, duration=200.0, dt=0.5, integrator="implicit_euler", gravity=(0.0, 0.0, 0.0), state=state
    )
    joints = result.joints[-1]
    assert result.status is Status.DONE
    assert_allclose(joints[-1], joints[0], rtol=0, atol=1e-9)
    edge, middle = joints[n // 2] - joints[n // 2 - 1], joints[:-1].mean(axis=0)
    inward = middle - (joints[n // 2] + joints[n // 2 - 1]) / 2
    assert_allclose(np.cross(edge, inward)[1], -worm.l0 * apothem(n), rtol=1e-9)
    assert_allclose(joints[:, 1], 0.0, atol=1e-6)
