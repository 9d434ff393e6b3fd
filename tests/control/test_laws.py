"""Laws of crawling for ordinary worms, all segments alike, of which feet lift and loads pass from one to another.

`scenes.studies.validate.closed_forms` has the laws for chains of feet that keep their loads.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import Breathing, Gait, Periodic, TravellingWave
from worm3d import Friction, Plane, Result, Worm, simulate

BELOW = (0, 3)
"""Apexes of a segment that stand on the ground, left and right."""


def coefficients(rng: np.random.Generator) -> tuple[float, float]:
    forward, backward = np.exp(rng.uniform(np.log(0.03), np.log(0.6), 2))
    return float(forward), float(backward)


def crawl(worm: Worm, gait: Gait, forward: float, backward: float, period: float, dt: float) -> Result:
    """Return two periods of a slow, straight crawl; end faces would be further contacts."""
    friction = Friction(forward, backward, max(forward, backward), static_ratio=1.0)
    return simulate(worm, Plane(), friction, gait, duration=2 * period, dt=dt, integrator="implicit_euler")


def body(segments: int, **others: float) -> Worm:
    size = segments / 6
    return Worm(segments=segments, mass=0.1 * size, length=size, end_faces=False, k_spring=1e5, **others)


@pytest.mark.parametrize("seed", range(8))
def test_any_slow_gait_follows_the_velocity_law(seed: int) -> None:
    """V = -(load-weighted quantile at forward/(forward + backward) of the feet's velocities relative to the body).

    Gidoni, Noselli, DeSimone 2014, with the loads of the run. At half the period inertia takes 1 to 3 % of the way.
    """
    rng = np.random.default_rng(seed)
    segments, period, dt = int(rng.integers(3, 12)), 240.0, 0.2
    forward, backward = coefficients(rng)
    gait = Periodic(
        period=period,
        amplitude=rng.uniform(0.1, 0.3),
        waves=rng.uniform(0, 2),
        phase=rng.uniform(-0.2, 0.2, segments),
        duty=rng.uniform(0.3, 0.7, segments),
    )
    run = crawl(body(segments), gait, forward, backward, period, dt)
    steps = round(period / dt)
    moved = np.diff(run.apexes[-1 - steps :, :, BELOW, 0].reshape(steps + 1, -1), axis=0)
    loads = run.normal_load[-steps:, :, BELOW].reshape(steps, -1)
    travel = moved.mean(axis=1)
    relative = moved - travel[:, None]
    order = np.argsort(relative, axis=1)
    share = np.cumsum(np.take_along_axis(loads, order, axis=1), axis=1)
    anchor = (share < forward / (forward + backward) * share[:, -1:]).sum(axis=1)
    anchored = np.take_along_axis(order, anchor[:, None], axis=1)
    law = -np.take_along_axis(relative, anchored, axis=1).sum()
    stroke = np.abs(relative).sum(axis=0).mean()
    assert abs(law) > 0.01 * stroke
    assert_allclose(travel.sum(), law, rtol=0, atol=0.01 * max(abs(law), 0.1 * stroke))


@pytest.mark.parametrize("seed", range(6))
def test_breathing_is_the_ratchet_of_its_feet(seed: int) -> None:
    """d = c L (1 - (2 k + 1)/N), k = floor(N q): the feet, in the middle of segments, span (N - 1)/N of the body.

    q is forward/(forward + backward), and 1 - q in its place where the worm goes backwards.
    """
    rng = np.random.default_rng(seed)
    segments = int(rng.integers(2, 16))
    level = 0.0
    while abs(segments * level - round(segments * level)) < 0.15:
        forward, backward = coefficients(rng)
        level = forward / (forward + backward)
    contraction, period, dt = rng.uniform(0.05, 0.3), 20.0, 0.05
    worm = body(segments, k_torsion=1e4, actuator_lag=0.01)
    run = crawl(worm, Breathing(period=period, amplitude=contraction), forward, backward, period, dt)
    slipping = np.floor(segments * min(level, 1.0 - level))
    way = contraction * worm.length * (1.0 - (2.0 * slipping + 1.0) / segments)
    found = run.com[-1, 0] - run.com[round(period / dt), 0]
    assert_allclose(found, np.copysign(way, backward - forward), rtol=0, atol=4e-4 * contraction * worm.length)


def stride(gait: Gait, friction: Friction | None = None, worm: Worm | None = None) -> float:
    """Return the way in a period on average of the last four of five, in body lengths."""
    body = worm or Worm()
    run = simulate(body, Plane(), friction or Friction(), gait, duration=10.0)
    return float(run.com[-1, 0] - run.com[200, 0]) / 4.0 / body.length


def test_the_map_of_wavelengths_has_a_dip_near_half_a_body() -> None:
    """With 1/3 of a body, neighbours of six segments contract in turn; with twelve segments there is no such dip."""
    known = {0.33: 0.097, 0.5: 0.020, 0.7: 0.063, 1.0: 0.100, 2.0: 0.149, 4.0: 0.163}
    found = {wavelength: stride(TravellingWave(wavelength=wavelength)) for wavelength in known}
    assert_allclose(list(found.values()), list(known.values()), rtol=0, atol=0.002)
    dip = {wavelength: stride(TravellingWave(wavelength=wavelength)) for wavelength in (0.36, 0.4, 0.44, 0.48, 0.56)}
    assert min(dip, key=lambda wavelength: dip[wavelength]) == 0.44
    assert 0.0 < dip[0.44] < 0.015


@pytest.mark.parametrize(("amplitude", "segments", "coefficient"), [(0.2, 6, 0.2), (0.3, 5, 0.1), (0.1, 9, 0.5)])
def test_in_unison_on_equal_friction_nothing_moves(amplitude: float, segments: int, coefficient: float) -> None:
    """The worm is the same from both ends, and so is the ground."""
    gait, friction = Periodic(waves=0, amplitude=amplitude), Friction(coefficient, coefficient, 0.2)
    assert abs(stride(gait, friction, Worm(segments=segments))) < 1e-9
    assert stride(gait, Friction(0.5 * coefficient, coefficient, 0.2), Worm(segments=segments)) > 0.01
