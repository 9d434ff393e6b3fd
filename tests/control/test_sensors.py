"""Sensors: noise, bias, delay, dropout and rate of each channel, and mirror images."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import TravellingWave
from control.sensing.gate import Gate, Refusal
from control.sensing.sensors import QUANTITIES, Channel, Measurement, Quantity, Sensors
from worm3d import Command, Observation, Plane, Pneumatic, State, Worm, simulate

EXACT = Channel(noise=0.0)
N = 6
APEXES = np.array([[0, 1, -1], [0, 1, 1], [0, 2, 0], [0, -1, -1], [0, -1, 1], [0, -2, 0]])
"""Directions from the middle of a segment to its apexes."""


def seen(t: float) -> Observation:
    """Return what a worm looks like that changes all the time."""
    strain = 0.1 * np.sin(t + np.arange(2.0 * N)).reshape(N, 2)
    com = np.array([0.1 * t, np.sin(t), 0.07])
    random = np.random.default_rng(round(1e3 * t))
    return Observation(
        time=t,
        chamber_strain=strain,
        com=com,
        com_velocity=np.zeros(3),
        heading=np.sin(t),
        joints=np.zeros((N + 1, 3)) + 0.1 * np.arange(N + 1)[:, None] * [1, 0, 0],
        joint_velocity=random.uniform(-0.1, 0.1, (N + 1, 3)),
        apexes=random.uniform(-0.01, 0.01, (N, 6, 3)) + 0.05 * APEXES,
        apex_velocity=random.uniform(-0.1, 0.1, (N, 6, 3)),
        contraction=np.zeros((N, 2)),
        normal_load=random.uniform(0.0, 0.2, (N, 6)),
        actuator_states={"pressure": random.uniform(0.0, 5e4, (N, 2))},
    )


def run(sensors: Sensors, steps: int, dt: float = 0.01) -> list[Measurement]:
    sensors.reset()
    return [sensors(seen(k * dt)) for k in range(steps)]


def test_without_errors_a_measurement_is_the_truth() -> None:
    measured = Sensors(EXACT, EXACT, EXACT)(seen(0.3))
    assert_array_equal(measured.strain, seen(0.3).chamber_strain)
    assert_array_equal(measured.com, seen(0.3).com)
    assert measured.heading == pytest.approx(seen(0.3).heading, abs=1e-15)
    assert (measured.time, measured.strain_time, measured.com_time, measured.heading_time) == (0.3, 0.3, 0.3, 0.3)


def test_there_is_no_heading_without_its_sensor() -> None:
    measured = Sensors()(seen(0.0))
    assert measured.heading is None
    assert np.isnan(measured.heading_time)


def test_noise_is_white_and_as_large_as_said() -> None:
    measured = run(Sensors(Channel(noise=0.02), Channel(noise=0.005), Channel(noise=0.1), seed=1), 4000)
    truth = [seen(each.time) for each in measured]
    strain = np.array([each.strain - true.chamber_strain for each, true in zip(measured, truth, strict=True)])
    com = np.array([each.com - true.com for each, true in zip(measured, truth, strict=True)])
    heading = np.array([each.heading - true.heading for each, true in zip(measured, truth, strict=True)])
    for error, deviation in ((strain, 0.02), (com, 0.005), (heading, 0.1)):
        rows = error.reshape(len(error), -1)
        count = len(rows)
        # Four standard errors of a deviation, a mean and a correlation.
        assert_allclose(rows.std(axis=0), deviation, rtol=4.0 / np.sqrt(2.0 * count))
        assert_allclose(rows.mean(axis=0), 0.0, atol=4.0 * deviation / np.sqrt(count))
        assert_allclose((rows[1:] * rows[:-1]).mean(axis=0), 0.0, atol=4.0 * deviation**2 / np.sqrt(count))
    assert abs(np.corrcoef(com.T)[0, 1]) < 4.0 / np.sqrt(len(com))


def test_bias_is_constant_in_a_run_and_differs_by_channel_and_seed() -> None:
    biased = Channel(noise=0.0, bias=0.01)
    off = {}
    for seed in (1, 2):
        measured = run(Sensors(biased, biased, seed=seed), 20)
        errors = np.array([each.com - seen(each.time).com for each in measured])
        assert_allclose(errors, errors[:1].repeat(20, axis=0), atol=1e-15)
        off[seed] = errors[0]
        assert_allclose(measured[3].strain - seen(0.03).chamber_strain, measured[0].strain - seen(0.0).chamber_strain)
        assert len(np.unique(measured[0].strain - seen(0.0).chamber_strain)) == 2 * N
    assert np.abs(off[1] - off[2]).min() > 1e-4
    drawn = [run(Sensors(EXACT, biased, seed=seed), 1)[0].com - seen(0.0).com for seed in range(300)]
    assert_allclose(np.std(drawn, axis=0), 0.01, rtol=0.17)


def test_a_late_sample_is_of_its_instant() -> None:
    measured = run(Sensors(EXACT, Channel(noise=0.0, delay=0.035)), 50)
    assert [each.com is None for each in measured[:5]] == [True] * 4 + [False]
    assert np.isnan(measured[3].com_time)
    for each in measured[4:]:
        assert each.com_time == pytest.approx(each.time - 0.04)  # the first call after the delay
        assert_array_equal(each.com, seen(each.com_time).com)
        assert each.strain_time == each.time


def test_samples_come_at_their_rate() -> None:
    measured = run(Sensors(Channel(noise=0.0, rate=50.0), Channel(noise=0.0, rate=30.0)), 301)
    strains = [each.time for each in measured if each.strain is not None]
    coms = [each.time for each in measured if each.com is not None]
    assert_allclose(strains, np.arange(0.0, 3.0 + 1e-9, 0.02))
    # Each at the first call after it is due: 30 a second in the mean, at multiples of 10 ms.
    assert len(coms) == 91
    assert_allclose(coms, np.ceil(np.arange(91) / 30.0 * 100.0 - 1e-6) / 100.0)
    held = [each.com_time for each in measured]
    assert_allclose(held, np.maximum.accumulate([each.time if each.com is not None else 0.0 for each in measured]))


def test_dropout_loses_its_share_of_the_samples() -> None:
    measured = run(Sensors(EXACT, Channel(noise=0.0, dropout=0.3)), 4000)
    lost = np.mean([each.com is None for each in measured])
    assert lost == pytest.approx(0.3, abs=4.0 * np.sqrt(0.3 * 0.7 / 4000))
    assert all(each.com is None for each in run(Sensors(EXACT, Channel(noise=0.0, dropout=1.0)), 50))


def test_equal_seeds_meet_equal_errors() -> None:
    first, again, other = (run(Sensors(seed=seed), 30) for seed in (5, 5, 6))
    for one, two, three in zip(first, again, other, strict=True):
        assert_array_equal(one.strain, two.strain)
        assert np.abs(one.strain - three.strain).max() > 1e-3


def mirrored(observation: Observation) -> Observation:
    return replace(
        observation,
        chamber_strain=observation.chamber_strain[:, ::-1],
        com=observation.com * [1, -1, 1],
        heading=-observation.heading,
        joint_velocity=observation.joint_velocity * [1, -1, 1],
        apexes=observation.apexes[:, [3, 4, 5, 0, 1, 2]] * [1, -1, 1],
        apex_velocity=observation.apex_velocity[:, [3, 4, 5, 0, 1, 2]] * [1, -1, 1],
        normal_load=observation.normal_load[:, [3, 4, 5, 0, 1, 2]],
        actuator_states={"pressure": observation.actuator_states["pressure"][:, ::-1]},
    )


def test_mirrored_sensors_make_the_mirrored_measurement_of_the_mirrored_worm() -> None:
    rough = Channel(noise=0.1, bias=0.2, dropout=0.2, delay=0.02, rate=60.0)
    here, there = (Sensors(seed=3, mirrored=m, **dict.fromkeys(QUANTITIES, rough)) for m in (False, True))
    arrived = turned = loaded = pressed = 0
    for k in range(100):
        one, two = here(seen(0.01 * k)), there(mirrored(seen(0.01 * k)))
        assert (one.com is None, one.strain is None) == (two.com is None, two.strain is None)
        if one.com is not None:
            assert_allclose(two.com, one.com * [1, -1, 1], atol=1e-15)
            arrived += 1
        if one.strain is not None:
            assert_allclose(two.strain, one.strain[:, ::-1], atol=1e-15)
        if one.heading is not None:
            assert two.heading == pytest.approx(-one.heading, abs=1e-14)
        if one.angular_rate is not None:
            assert_allclose(two.angular_rate, one.angular_rate * [-1, 1, -1], atol=1e-13)
            turned += 1
        if one.contact_load is not None:
            assert_allclose(two.contact_load, one.contact_load[:, [3, 4, 5, 0, 1, 2]], atol=1e-14)
            loaded += 1
        if one.pressure is not None:
            assert_allclose(two.pressure, one.pressure[:, ::-1], atol=1e-9)
            pressed += 1
    assert min(arrived, turned, loaded, pressed) > 30


def test_measured_headings_stay_within_a_turn() -> None:
    sensors = Sensors(EXACT, EXACT, Channel(noise=0.5), seed=2)
    headings = np.array([sensors(replace(seen(0.01 * k), heading=np.pi)).heading for k in range(200)])
    assert (headings > -np.pi).all()
    assert (headings <= np.pi).all()
    assert (headings < -2.0).any()
    assert (headings > 2.0).any()


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        ({"noise": -1.0}, r"noise: got -1\.0, must be finite and at least 0"),
        ({"noise": 0.0, "delay": float("nan")}, "delay: got nan s, must be finite and at least 0"),
        ({"noise": 0.0, "dropout": 1.5}, r"dropout: got 1\.5, must be a probability, in \[0, 1\]"),
        ({"noise": 0.0, "rate": 0.0}, r"rate: got 0\.0 Hz, must be above 0; infinite for a sample at every call"),
    ],
)
def test_bad_channels_are_refused(bad, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Channel(**bad)


def test_a_bad_seed_is_refused() -> None:
    with pytest.raises(ValueError, match="seed: got -1, must be a whole number of at least 0"):
        Sensors(seed=-1)


def test_a_measurement_is_a_mapping_of_channels() -> None:
    measured = Sensors(EXACT, None, heading=Channel(noise=0.0, rate=1.0))(seen(0.3))
    assert list(measured) == ["strain", "heading"]
    assert measured["strain"].time == 0.3
    assert_array_equal(measured["strain"].value, seen(0.3).chamber_strain)
    assert measured.com is None, "there is no such sensor"
    assert np.isnan(measured.com_time)
    changed = measured.changed(com=(np.ones(3), 0.2))
    assert (changed.com_time, changed.strain_time, "com" in measured) == (0.2, 0.3, False)
    with pytest.raises(AttributeError, match="measurement: has no 'colour'; its channels are strain, com, heading"):
        measured.colour  # noqa: B018
    for wrong in (Measurement, Sensors):
        with pytest.raises(ValueError, match="colour: got a channel of this name, must be one of strain, com, heading"):
            wrong(0.0, colour=EXACT) if wrong is Measurement else wrong(colour=EXACT)


def test_a_quantity_that_is_declared_is_a_channel(monkeypatch: pytest.MonkeyPatch) -> None:
    tail = Quantity(
        "height of the tail",
        "m",
        Channel(noise=0.001),
        true_value=lambda seen: seen.joints[0, 2:],
        shape=lambda worm: (1,),
        limits=lambda worm: (-1.0, 1.0),
        mirrored=lambda value: value,
    )
    monkeypatch.setitem(QUANTITIES, "tail", tail)
    measured = Sensors(tail=EXACT)(seen(0.3))
    assert_array_equal(measured.tail, [0.0])
    assert_array_equal(Measurement.exact(seen(0.3), QUANTITIES).tail, [0.0])
    gate = Gate(Worm())
    assert gate(0.3, measured) is measured
    assert gate(0.4, measured.changed(tail=(np.array([2.0]), 0.4))).tail is None
    assert gate.refused["tail", Refusal.OUT_OF_RANGE] == 1


class Listening:
    """A gait as a controller that keeps its measurements."""

    def __init__(self, gait: Callable[[float], Command]) -> None:
        self._gait = gait

    def reset(self) -> None:
        self.heard: list[Any] = []

    def step(self, t: float, measurement: Any) -> Command:
        self.heard.append(measurement)
        return self._gait(t)


def test_pressures_are_measured_where_actuators_have_them() -> None:
    truth = seen(0.3)
    assert_array_equal(Sensors(pressure=EXACT)(truth).pressure, truth.actuator_states["pressure"])
    dry = replace(truth, actuator_states={})
    with pytest.raises(ValueError, match="pressure: got a sensor of it, but this worm has no pressure of the chambers"):
        Sensors(pressure=EXACT)(dry)
    assert "pressure" not in Gate(Worm())(0.3, dry), "an exact measurement has what there is"


def test_the_pressures_of_pneumatic_chambers_are_measured() -> None:
    worm = Worm(actuator=Pneumatic())
    listening = Listening(TravellingWave().bind(worm))
    run = simulate(worm, Plane(), actuation=listening, sensor=Sensors(pressure=EXACT), duration=0.5)
    measured = np.array([each.pressure for each in listening.heard])
    assert_array_equal(measured, run.actuator_states["pressure"][:-1])
    assert np.ptp(measured) > 100.0
    assert QUANTITIES["pressure"].exists(worm)


@pytest.mark.parametrize("roll", [0.0, 0.1])
def test_contact_loads_bear_the_weight_and_the_lower_side_more_of_it(roll: float) -> None:
    worm = Worm(end_faces=False)
    listening = Listening(lambda t: Command(np.zeros((N, 2))))
    world = Plane(slope=roll, heading=np.pi / 2.0)  # its left side is the upper one
    simulate(worm, world, actuation=listening, duration=0.5, sensor=Sensors(contact_load=EXACT))
    load = listening.heard[-1].contact_load
    assert load.sum() == pytest.approx(worm.mass * 9.81 * np.cos(roll), rel=1e-3)
    assert_allclose(load[:, [1, 2, 4, 5]], 0.0, atol=1e-12)
    assert (load[:, 3].sum() > 1.1 * load[:, 0].sum()) == (roll > 0.0)


@pytest.mark.parametrize("dt", [0.01, 0.005])
def test_the_angular_rate_is_that_of_the_segments_axes(dt: float) -> None:
    worm = Worm()
    listening = Listening(TravellingWave(bias=0.5, hinge=0.1).bind(worm))
    sensors = Sensors(angular_rate=EXACT)
    slope = Plane(slope=0.1, heading=0.7)
    run = simulate(worm, slope, actuation=listening, sensor=sensors, duration=4.0, dt=dt)
    tangents = np.diff(run.joints, axis=1)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    axes = np.stack([tangents, run.directors, np.cross(tangents, run.directors)], axis=-1)
    # R^T R' is the cross product with the rate; central differences of the stored axes give R'.
    spin = np.einsum("tnji,tnjk->tnik", axes[1:-1], (axes[2:] - axes[:-2]) / (2.0 * dt))
    expected = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    measured = np.array([each.angular_rate for each in listening.heard[1:]])
    off = np.abs(measured - expected)
    # Of second order, a quarter at half the step: 3.2e-3, 0.9e-3 and 3.1e-3 rad/s at 10 ms. Impacts are jumps.
    assert np.median(off, axis=(0, 1)).max() < 5e-3 * (dt / 0.01) ** 2
    for axis in range(3):
        assert np.corrcoef(measured[..., axis].ravel(), expected[..., axis].ravel())[0, 1] > 0.98
    assert np.sqrt((expected**2).mean(axis=(0, 1))).min() > 0.2, "it turns about every axis"


@pytest.mark.parametrize("turned", [0.0, 2.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rolling_to_the_right_pitching_down_and_yawing_to_the_left_are_positive(axis: int, turned: float) -> None:
    worm, rate = Worm(), np.zeros(3)
    rate[axis] = 0.5
    start = State.straight(worm, None, (0.0, 0.0, 1.0), turned)
    forward = np.array([np.cos(turned), np.sin(turned), 0.0])
    axes = np.array([forward, np.cross([0.0, 0.0, 1.0], forward), [0.0, 0.0, 1.0]])
    velocity = np.cross(rate @ axes, start.joints - start.joints.mean(axis=0))
    start = start.with_changes(joint_velocity=velocity, roll_rate=np.full(N, rate[0]))
    listening = Listening(lambda t: Command(np.zeros((N, 2))))
    simulate(
        worm,
        None,
        actuation=listening,
        state=start,
        duration=0.2,
        gravity=(0, 0, 0),
        sensor=Sensors(angular_rate=EXACT),
    )
    for each in listening.heard:
        assert_allclose(each.angular_rate, np.tile(rate, (N, 1)), atol=3e-4)
    nose_down = simulate(worm, None, state=start, duration=0.2, gravity=(0, 0, 0)).joints[-1]
    if axis == 1:
        assert nose_down[-1, 2] < nose_down[0, 2] - 0.05
