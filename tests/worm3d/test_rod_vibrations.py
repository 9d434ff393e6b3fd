"""First natural frequencies of the worm as a rod, with all mass on the joints, and of torsion; BDF2, no damping.

The rod's constants and where its clamp is: see test_rod_statics. The frequency is that at which the motion, projected
on the mode of the continuous rod, crosses zero; BDF2 runs slow by (omega dt)^2/3, here 1.3e-5 of it.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.testing import assert_allclose

from worm3d import Held, Result, State, Status, Worm, simulate

MASS = 0.1
"""Per length [kg/m]."""
STEPS_PER_PERIOD = 1000
PLANES = {"pitch": 2, "yaw": 1}
JOINTS, CHAMBERS = 0.4, 0.6
"""Shares of the compliance in yaw."""
EI = {"pitch": 0.5, "yaw": 0.8}


def rod(segments: int, l0: float) -> Worm:
    """Return a rod with the stiffnesses EI and EA = 400 N."""
    return Worm(
        segments=segments,
        length=segments * l0,
        mass=MASS * segments * l0,
        joint_mass_fraction=1.0,
        chamber_offset=np.sqrt(EI["yaw"] / CHAMBERS / 400.0),
        half_height=0.4,
        k_spring=400.0,
        k_torsion=EI["pitch"] / l0,
        k_yaw=EI["yaw"] / JOINTS / l0,
        k_twist=1.0 / l0,
        kelvin_voigt_time=0.0,
    )


def vibrate(worm: Worm, omega: float, velocity: np.ndarray, held: Held) -> Result:
    """Return a bit more than two periods of a straight worm that starts with a velocity of its joints."""
    period = 2 * np.pi / omega
    state = State.straight(worm, position=(0.0, 0.0, 5.0)).with_changes(joint_velocity=velocity)
    result = simulate(
        worm,
        None,
        duration=2.2 * period,
        dt=period / STEPS_PER_PERIOD,
        gravity=(0.0, 0.0, 0.0),
        state=state,
        held=held,
    )
    assert result.status is Status.DONE
    return result


def frequency(time: np.ndarray, motion: np.ndarray) -> float:
    """Return pi over the mean time between zeros, each by the cubic through four samples [rad/s]."""
    zeros = []
    for i in np.flatnonzero(motion[1:-2] * motion[2:-1] < 0.0) + 1:
        near = slice(i - 1, i + 3)
        t = np.polynomial.Polynomial.fit(motion[near], time[near], 3)(0.0)
        zeros.append(t)
    assert len(zeros) >= 4
    return float(np.pi * (len(zeros) - 1) / (zeros[-1] - zeros[0]))


def orders(errors: Sequence[float]) -> np.ndarray:
    return np.log2(np.abs(np.array(errors[:-1]) / errors[1:]))


def mode(beta: float, clamped: bool) -> Callable[[np.ndarray], np.ndarray]:
    """Return a mode of a beam of length 1 with a free head, its tail clamped or free (Rayleigh, Theory of Sound, 8)."""
    if clamped:
        ratio = (np.sinh(beta) - np.sin(beta)) / (np.cosh(beta) + np.cos(beta))
        return lambda s: np.cosh(beta * s) - np.cos(beta * s) - ratio * (np.sinh(beta * s) - np.sin(beta * s))
    ratio = (np.cosh(beta) - np.cos(beta)) / (np.sinh(beta) - np.sin(beta))
    return lambda s: np.cosh(beta * s) + np.cos(beta * s) - ratio * (np.sinh(beta * s) + np.sin(beta * s))


@pytest.mark.parametrize("plane", PLANES)
def test_first_frequency_of_a_cantilever(plane: str) -> None:
    """omega = beta^2 sqrt(EI/(m L^4)), cos(beta) cosh(beta) = -1: beta = 1.87510407."""
    beta, errors, axis = 1.87510407, [], PLANES[plane]
    omega, shape = beta**2 * np.sqrt(EI[plane] / MASS), mode(beta, clamped=True)
    offset = 0.5 if plane == "pitch" else 0.5 * JOINTS + 0.25 * CHAMBERS
    for n in (6, 12, 24):
        worm = rod(n, 1.0 / (n - 1 + offset))
        along = (np.arange(n + 1) - 1 + offset) * worm.l0
        moving = np.where(np.arange(n + 1) > 1, shape(along), 0.0)
        velocity = np.zeros((n + 1, 3))
        velocity[:, axis] = 1e-3 * moving
        result = vibrate(worm, omega, velocity, Held(np.arange(n + 1)[:, None] < 2, roll=True))
        motion = (result.joints[:, :, axis] - result.joints[0, :, axis]) @ (worm.joint_mass * moving)
        errors.append(frequency(result.time, motion) / omega - 1)
    assert_allclose(orders(errors), 2.0, atol=0.25)
    assert abs(errors[-1]) < 5e-4


@pytest.mark.parametrize("plane", PLANES)
def test_first_frequency_of_a_free_beam(plane: str) -> None:
    """omega = beta^2 sqrt(EI/(m L^4)), cos(beta) cosh(beta) = 1: beta = 4.73004074; there is no clamp to correct."""
    beta, errors, axis = 4.73004074, [], PLANES[plane]
    omega = beta**2 * np.sqrt(EI[plane] / MASS)
    for n in (10, 20, 40):
        worm, along = rod(n, 1.0 / n), np.arange(n + 1) / n - 0.5
        shape, mass = mode(beta, clamped=False)(along + 0.5), worm.joint_mass
        shape -= mass @ shape / mass.sum() + along * (mass * along @ shape) / (mass @ along**2)
        velocity = np.zeros((n + 1, 3))
        velocity[:, axis] = 1e-3 * shape
        result = vibrate(worm, omega, velocity, Held(roll=True))
        motion = (result.joints[:, :, axis] - result.joints[0, :, axis]) @ (mass * shape)
        errors.append(frequency(result.time, motion) / omega - 1)
    assert_allclose(orders(errors), 2.0, atol=0.15)
    assert abs(errors[-1]) < 3e-3


def test_first_frequency_of_axial_motion() -> None:
    """A free bar: omega = pi sqrt(EA/(m L^2)); the chain's own: 2 sqrt(EA/(m l0^2)) sin(pi/(2 N))."""
    errors = []
    for n in (5, 10, 20):
        worm = rod(n, 1.0 / n)
        omega, own = (sine * np.sqrt(400.0 / MASS) for sine in (np.pi, 2 * n * np.sin(np.pi / (2 * n))))
        shape = np.cos(np.pi * np.arange(n + 1) / n)
        velocity = np.zeros((n + 1, 3))
        velocity[:, 0] = 1e-3 * shape
        result = vibrate(worm, omega, velocity, Held(roll=True))
        found = frequency(result.time, (result.joints[:, :, 0] - result.joints[0, :, 0]) @ (worm.joint_mass * shape))
        assert_allclose(found, own * (1 - (2 * np.pi / STEPS_PER_PERIOD) ** 2 / 3), rtol=1e-6)
        errors.append(found / omega - 1)
    assert_allclose(orders(errors), 2.0, atol=0.15)


def test_first_frequency_of_torsion() -> None:
    """A free bar with the polar inertia J' per length of its apexes: omega = pi sqrt(GJ/(J' L^2)).

    J' L = sum of m r^2 of all apexes, r^2 = b^2 + h^2 or (b + h)^2. The chain of N segments has the mode
    cos(pi (i + 1/2)/N) and the frequency 2 sqrt(GJ/(J' l0^2)) sin(pi/(2 N)).
    """
    GJ, b, h, errors = 0.3, 0.04, 0.05, []
    for n in (5, 10, 20):
        worm = Worm(
            segments=n, chamber_offset=b, half_height=h, k_spring=1e4, k_twist=GJ * n, kelvin_voigt_time=0.0, mass=0.1
        )
        inertia = n * worm.apex_mass[0] @ np.array([b**2 + h**2, b**2 + h**2, (b + h) ** 2] * 2)
        omega, own = (sine * np.sqrt(GJ / inertia) for sine in (np.pi, 2 * n * np.sin(np.pi / (2 * n))))
        shape, period = np.cos(np.pi * (np.arange(n) + 0.5) / n), 2 * np.pi / omega
        state = State.straight(worm, position=(0.0, 0.0, 5.0)).with_changes(roll_rate=1e-3 * shape)
        result = simulate(
            worm, None, duration=2.2 * period, dt=period / STEPS_PER_PERIOD, gravity=(0.0, 0.0, 0.0), state=state
        )
        turned = np.arctan2(result.directors[:, :, 2], result.directors[:, :, 1])
        assert turned[1, 0] > 0.0, "a positive roll lifts the left side"
        found = frequency(result.time, turned @ shape)
        assert_allclose(found, own * (1 - (2 * np.pi / STEPS_PER_PERIOD) ** 2 / 3), rtol=2e-6)
        errors.append(found / omega - 1)
    assert_allclose(orders(errors), 2.0, atol=0.15)
    assert abs(errors[-1]) < 2e-3
