"""Laws of crawling: the quantile law with the true loads, which way a wave drives, and turning."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import TravellingWave
from worm3d import Friction, Plane, State, Status, Worm


def quantile(values: np.ndarray, weights: np.ndarray, level: float) -> float:
    """Return the weighted quantile of values."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, level * total[-1])])


PERIOD, STEPS = 30.0, 800
SLOW = Worm(segments=7, k_spring=1e4, k_torsion=10.0, k_yaw=10.0, k_twist=10.0, end_faces=False, actuator_lag=0.0)
"""Stiff actuation, feet only: seven places of contact."""


def slow_crawl(ground: Friction, direction: str, heading: float = 0.0) -> worm3d.Result:
    """Crawl two slow cycles, with an amplitude that grows over the first quarter of one."""
    gait = TravellingWave(period=PERIOD, amplitude=0.1, direction=direction, rectified=False)

    def ramped(t: float) -> worm3d.Command:
        wave = gait.amplitude * gait.activation(t, 7) * min(1.0, 4 * t / PERIOD)
        return worm3d.Command(np.column_stack([wave, wave]))

    start = State.straight(SLOW, Plane(), azimuth=heading)
    return worm3d.simulate(SLOW, Plane(), ground, actuation=ramped, duration=2 * PERIOD, dt=PERIOD / STEPS, state=start)


@pytest.mark.parametrize("direction", ["retrograde", "direct"])
@pytest.mark.parametrize(("mu_forward", "mu_backward"), [(0.03, 0.20), (0.10, 0.20), (0.20, 0.20), (0.20, 0.05)])
def test_quasi_static_crawling_follows_the_quantile_law(mu_forward: float, mu_backward: float, direction: str) -> None:
    """V = -(load-weighted quantile of the relative velocities at mu_f/(mu_f + mu_b)), over the second cycle, 0.5 %.

    Gidoni, Noselli, DeSimone 2014, with the true, changing loads. With isotropic friction (anchoring by load alone)
    direct and retrograde waves drive opposite ways.
    """
    run = slow_crawl(Friction(mu_forward, mu_backward, 0.2, static_ratio=1.0), direction)
    assert run.status is Status.DONE
    feet, loads = run.apexes[:, :, 0, 0], run.normal_load[1:, :, 0] + run.normal_load[1:, :, 3]
    relative = np.diff(feet - feet[:, :1], axis=0) / run.dt
    level = mu_forward / (mu_forward + mu_backward)
    law = np.array([-quantile(w, p, level) for w, p in zip(relative, loads, strict=True)])
    predicted, distance = law[STEPS:].sum() * run.dt, feet[-1, 0] - feet[STEPS, 0]
    assert_allclose(distance, predicted, rtol=5e-3)
    if mu_forward == mu_backward:
        assert distance * (1.0 if direction == "retrograde" else -1.0) > 0.05


def test_a_worm_facing_elsewhere_makes_the_turned_path() -> None:
    """Directions are those of the body, not of the world."""
    ground = Friction(0.03, 0.20, 0.1)
    gait = TravellingWave(amplitude=0.3, bias=0.3, hinge=0.3)
    angle = np.deg2rad(143.0)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    runs = [
        worm3d.simulate(
            Worm(),
            Plane(),
            ground,
            actuation=gait,
            duration=4.0,
            state=State.straight(Worm(), Plane(), azimuth=azimuth),
        )
        for azimuth in (0.0, angle)
    ]
    assert_allclose(runs[1].joints, runs[0].joints @ turn.T, rtol=0, atol=1e-9)
    assert_allclose(runs[1].distance, runs[0].distance, rtol=1e-9)
    assert runs[0].distance > 0.03


@pytest.mark.parametrize("friction", [Friction(0.2, 0.2, 0.2), Friction(0.2, 0.2, 0.2, static_ratio=1.0)])
def test_with_isotropic_friction_direct_and_retrograde_waves_drive_opposite_ways(friction: Friction) -> None:
    distance = {
        direction: worm3d.simulate(
            Worm(), Plane(), friction, actuation=TravellingWave(direction=direction), duration=10.0
        ).distance
        for direction in ("retrograde", "direct")
    }
    assert distance["retrograde"] > 0.05
    assert distance["direct"] < -0.05
    # A direct wave is a retrograde one seen from the other end.
    assert_allclose(distance["direct"], -distance["retrograde"], rtol=0.35)


def test_anisotropic_friction_alone_drives_it_forward_whichever_way_the_wave_runs() -> None:
    for direction in ("retrograde", "direct", "standing"):
        gait = TravellingWave(direction=direction, rectified=direction != "standing", amplitude=0.1)
        result = worm3d.simulate(Worm(), Plane(), Friction(0.01, 1.0, 1.0), actuation=gait, duration=6.0)
        assert result.distance > 0.02, direction


@pytest.mark.parametrize(
    ("how", "least", "most"), [({"bias": 0.3}, 10, 200), ({"bias": 0.5}, 50, 500), ({"hinge": 0.5}, 10, 300)]
)
def test_a_biased_worm_turns_by_tens_of_degrees(how: dict[str, float], least: float, most: float) -> None:
    """Amplitude 0.3, 10 s: the prototype turned by 5 x 8 degrees at bias 0.3 and 5 x 44 at 0.5, all to the left."""
    result = worm3d.simulate(Worm(), Plane(), actuation=TravellingWave(amplitude=0.3, **how), duration=10.0)
    assert result.status is Status.DONE
    assert least < np.rad2deg(result.heading[-1] - result.heading[0]) < most


@pytest.mark.parametrize("how", [{"bias": 0.3}, {"bias": 0.6, "hinge": 0.4}, {"hinge": 0.8}], ids=str)
def test_mirrored_commands_make_the_mirrored_path(how: dict[str, float]) -> None:
    runs = [
        worm3d.simulate(
            Worm(),
            Plane(),
            actuation=TravellingWave(amplitude=0.3, **{name: sign * value for name, value in how.items()}),
            duration=6.0,
        )
        for sign in (1.0, -1.0)
    ]
    assert_allclose(runs[1].joints * [1.0, -1.0, 1.0], runs[0].joints, rtol=0, atol=1e-10)
    assert_allclose(runs[1].heading, -runs[0].heading, rtol=0, atol=1e-9)
    assert np.abs(runs[0].heading).max() > 0.01
    swapped = runs[1].normal_load[:, :, [3, 4, 5, 0, 1, 2]]
    assert_allclose(swapped, runs[0].normal_load, rtol=0, atol=1e-4 * 0.981)


def test_unbiased_it_goes_straight() -> None:
    result = worm3d.simulate(Worm(), Plane(), actuation=TravellingWave(amplitude=0.3), duration=10.0)
    assert np.abs(result.heading).max() < 1e-9
    assert np.abs(result.joints[..., 1]).max() < 1e-9
    assert 0.1 < result.distance < 2.0


def test_it_climbs_a_gentle_slope_and_slides_down_a_steep_one() -> None:
    gait = TravellingWave(amplitude=0.2)
    assert worm3d.simulate(Worm(), Plane(slope=0.1), actuation=gait, duration=10.0).distance > 0.05
    assert worm3d.simulate(Worm(), Plane(slope=0.3), actuation=gait, duration=2.0).distance < -0.5
