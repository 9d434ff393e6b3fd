"""The noise of samples as innovations show it, and what controllers make of sensors that are noisier than told."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.estimator import SPAN, TOO_SURE, Estimator
from control.estimation.noise import NOISE_LATEST, NOISE_LEAST, NOISE_WINDOW, Noise
from control.estimation.reduced import ReducedModel
from control.gaits.steering import GaitParameters
from control.identification.identified import load
from control.sensing.sensors import COM, HEADING_SENSOR, STRAIN, Channel, Measurement, Sensors
from control.supervisor import Supervisor
from control.task import ControlTask
from control.tracking.metrics import Motion, summary, tracking
from control.tracking.paths import Circle
from control.tracking.references import Constant, Reference
from worm3d import Plane, Worm, simulate

WORM = Worm()
FOUND = load(WORM)
TOLD = 0.005
REFERENCE = Reference(Constant(0.08), path=Circle(1.5, start=(0.5, 0.0)))


def learned(
    noise: Noise, deviation: float, samples: int, seed: int = 0, wrong: float = 0.0, spread: float = 0.0
) -> float:
    random = np.random.default_rng(seed)
    for _ in range(samples):
        innovation = np.hypot(deviation, np.sqrt(spread)) * random.standard_normal(2)
        if random.random() < wrong:
            innovation += random.uniform(-3.0, 3.0, 2)
        noise.learn(innovation, spread)
    return noise.deviation


@pytest.mark.parametrize("true", [0.01, 0.02, 0.04])
def test_noise_that_nobody_told_is_found_in_the_mean_of_many_runs(true: float) -> None:
    found = [learned(Noise(TOLD, 0.2), true, 2 * NOISE_WINDOW, seed) for seed in range(24)]
    assert np.mean(found) == pytest.approx(true, rel=0.05)
    assert np.std(found) < 0.15 * true


@pytest.mark.slow
def test_what_was_told_is_believed_as_long_as_it_may_be_right() -> None:
    changes = 0
    for seed in range(40):
        noise = Noise(TOLD, 0.2)
        changes += any(learned(noise, TOLD, 1, 1000 * seed + k) > TOLD for k in range(3 * NOISE_WINDOW))
    assert changes <= 2


def test_noise_that_is_less_than_told_is_found_down_to_what_the_wave_leaves() -> None:
    assert learned(Noise(0.04, 0.2, 0.002), 0.01, 3 * NOISE_WINDOW) == pytest.approx(0.01, rel=0.15)
    assert learned(Noise(0.04, 0.2, 0.002), 0.0001, 3 * NOISE_WINDOW) == 0.002


@pytest.mark.parametrize(("before", "after"), [(0.005, 0.02), (0.02, 0.005)])
def test_it_follows_a_change_of_the_noise(before: float, after: float) -> None:
    noise = Noise(before, 0.2)
    learned(noise, before, NOISE_WINDOW)
    assert learned(noise, after, 2 * NOISE_LATEST, seed=1) == pytest.approx(after, rel=0.35)


def test_wrong_samples_uncertain_predictions_and_steady_errors_are_no_noise() -> None:
    assert learned(Noise(TOLD, 0.2), TOLD, 300, wrong=0.05) == TOLD
    assert learned(Noise(TOLD, 0.2), TOLD, 300, spread=0.02**2) == TOLD
    assert learned(Noise(TOLD, 0.2), 0.02, 500, spread=0.01**2) == pytest.approx(0.02, rel=0.35)
    unsure = [learned(Noise(TOLD, 0.2), 0.02, 2 * NOISE_WINDOW, seed, spread=0.02**2) for seed in range(6)]
    assert np.mean(unsure) == pytest.approx(0.02, rel=0.15), "what is uncertain is no change of the noise"
    noise = Noise(TOLD, 0.2)
    random = np.random.default_rng(3)
    for k in range(300):
        noise.learn(np.array([0.05, -0.02]) * np.sin(0.02 * k) + TOLD * random.standard_normal(2), 0.0)
    assert noise.deviation == TOLD


def test_the_estimate_is_bounded_and_waits_for_some_samples() -> None:
    assert learned(Noise(TOLD, 0.2), 5.0, 300) == 0.2
    assert learned(Noise(TOLD, 0.2), 1.0, NOISE_LEAST) == TOLD


def test_the_estimator_is_told_how_good_its_sensors_are() -> None:
    assert FOUND is not None
    model = ReducedModel.of(WORM, FOUND)

    def told(**sensors: Channel) -> Estimator:
        return Estimator.for_sensors(WORM, model, FOUND.schedule, {"strain": STRAIN, "com": COM} | sensors)

    assert told().noise.told == COM.noise
    assert told(com=Channel(noise=0.03)).noise.told == 0.03
    assert told(com=Channel(noise=0.0)).noise.told > 0.0, "the wave is not known to the micrometre"
    assert told(com=Channel(noise=0.005, delay=3.0)).span > 3.0
    assert told(heading=HEADING_SENSOR).span == told().span


def test_samples_that_came_before_the_noise_was_found_count_as_if_it_had_been_told() -> None:
    """Those that are kept are all, in less than the span; after noise of 0.03 m that nobody told."""
    assert FOUND is not None
    model, random = ReducedModel.of(WORM, FOUND), np.random.default_rng(2)
    estimator = Estimator(WORM, model, heading=0.0)
    places = [np.array([0.004 * k, 0.0, 0.0]) + 0.03 * random.standard_normal(3) for k in range(20)]

    def taken(estimator: Estimator, until: Callable[[int], bool]) -> int:
        for k, place in enumerate(places):
            seen = Measurement(0.05 * k, com=(place, 0.05 * k))
            estimator.take(0.05 * k, seen, GaitParameters(0.28, 0.9), 0.09 * np.pi * k)
            if until(k):
                return k
        raise AssertionError("it is never so")

    last = taken(estimator, lambda k: estimator.noise.deviation > TOO_SURE * estimator.noise.told)
    assert NOISE_LEAST <= last < SPAN / 0.05
    told = Estimator(WORM, model, heading=0.0)
    told.noise = Noise(estimator.noise.deviation, 0.2)
    taken(told, lambda k: k == last)
    assert told.noise.deviation == estimator.noise.deviation
    found, expected = (each.estimate(0.05 * last) for each in (estimator, told))
    assert_allclose(found.state, expected.state, rtol=1e-12)
    assert_allclose(found.covariance, expected.covariance, rtol=1e-12, atol=1e-18)
    assert found.slope_covariance == pytest.approx(expected.slope_covariance)


@pytest.mark.parametrize(
    ("com_m", "strain", "told", "bar"),
    [
        pytest.param(0.020, 0.01, True, 0.020, marks=pytest.mark.slow),
        (0.020, 0.01, False, 0.024),
        pytest.param(0.040, 0.01, False, 0.045, marks=pytest.mark.slow),
        pytest.param(0.005, 0.05, False, 0.010, marks=pytest.mark.slow),
    ],
)
def test_with_noisy_sensors_told_or_not_it_keeps_to_the_path(
    com_m: float, strain: float, told: bool, bar: float
) -> None:
    """With 20 mm it went 0.18 body lengths beside it, with a bias of 21 %, when nothing was told of sensors."""
    assert FOUND is not None
    sensors = Sensors(Channel(noise=strain), Channel(noise=com_m, rate=20.0), seed=21)
    supervisor = Supervisor.of(ControlTask(WORM, REFERENCE, FOUND, sensors=sensors.channels if told else {}))
    waves = []

    class Watched:
        reset = supervisor.reset

        def step(self, t, measurement):
            command = supervisor.step(t, measurement)
            waves.append(supervisor.generator.waves)
            return command

    result = simulate(WORM, Plane(), actuation=Watched(), sensor=sensors, duration=25.0)
    motion = Motion(result.time, result.com[:, :2], result.heading, np.array([0.0, *waves]))
    found, _ = summary(tracking(motion, REFERENCE), REFERENCE, WORM.length)
    assert found["cross_track_rms_bl"] < bar
    assert abs(found["speed_bias_relative"]) < 0.02
    assert supervisor.estimator.noise.deviation == pytest.approx(com_m, rel=0.4)
    assert not supervisor.faults
