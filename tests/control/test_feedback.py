"""Gaits with memory: as functions of time, and under what they sense."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import Body, Feedback, FeedbackGait, Felt, TravellingWave
from control.sensing import Channel, Measurement, Sensors

WORM = worm3d.Worm()


class Turning:
    """Wave whose phase is its memory, turned by Euler's method; where it feels strain, by its mean as well."""

    def __init__(self, segments: int) -> None:
        self.x, self.phase, self.time = 2.0 * np.pi * (np.arange(segments) + 0.5) / segments, 0.0, np.nan
        self.calls: list[float] = []

    def step(self, t: float, felt: Felt) -> np.ndarray:
        rate = 2.0 * np.pi / 2.0 + (10.0 * felt["strain"].mean() if "strain" in felt else 0.0)
        self.phase += 0.0 if np.isnan(self.time) else rate * (t - self.time)
        self.time = t
        return np.maximum(0.0, np.sin(self.x + self.phase))


@dataclass(frozen=True, kw_only=True)
class Remembering(FeedbackGait):
    channels: tuple[str, ...] = ()
    period: float = 2.0
    lengthens = False

    @property
    def senses(self) -> tuple[str, ...]:
        return self.channels

    def start(self, body: Body) -> Turning:
        return Turning(body.segments)


SENSING = Remembering(channels=("strain",))


def run(actuation: object, duration: float = 0.6, **others: object) -> worm3d.Result:
    return worm3d.simulate(WORM, worm3d.Plane(), actuation=actuation, duration=duration, **others)  # type: ignore[arg-type]


def test_a_gait_that_senses_nothing_is_a_function_of_time() -> None:
    gait, times = Remembering(bias=0.3, hinge=0.1), np.array([0.0, 0.3, 0.31, 1.7])
    wave = TravellingWave(bias=0.3, hinge=0.1)
    assert_allclose(gait.activations(times, 6), wave.activations(times, 6), atol=1e-14)
    for back in (0.2, -1.0, 1.9):  # before the last one asked for, too
        assert_allclose(gait.activation(back, 6), wave.activation(max(back, 0.0), 6), atol=1e-14)
    for found, expected in zip(gait.bind(WORM).commands(times), wave.bind(WORM).commands(times), strict=True):
        assert_allclose(found, expected, atol=1e-14)
    assert pickle.loads(pickle.dumps(SENSING)) == SENSING
    assert gait == Remembering(bias=0.3, hinge=0.1), "what was played is no part of it"


def test_its_run_goes_on_from_a_state() -> None:
    whole, first = run(Remembering(), 0.6), run(Remembering(), 0.4)
    rest = run(Remembering(), 0.2, state=first.state)
    assert_allclose(rest.joints[-1], whole.joints[-1], atol=1e-12)
    assert whole.period == 2.0


def test_a_gait_that_senses_commands_the_end_of_each_step_from_what_was_felt_at_its_beginning() -> None:
    result = run(SENSING)
    phase, t = 0.0, result.time
    strain = result.chamber_length / WORM.l0 - 1.0
    given = [0.0]
    for k in range(1, len(t)):
        phase += (np.pi + 10.0 * strain[k - 1].mean()) * (t[k] - t[k - 1])
        given.append(0.2 * max(0.0, np.sin(np.pi / 6 + phase)))
    actuators = worm3d.simulate(WORM, worm3d.Plane(), actuation=_Replayed(SENSING, result), duration=0.6)
    assert_array_equal(actuators.joints, result.joints)
    replayed = [_Replayed(SENSING, result)(float(each)).contraction[0, 0] for each in t[1:]]
    assert_allclose(replayed, given[1:], atol=1e-9)
    assert_array_equal(run(SENSING).joints, result.joints)


class _Replayed:
    """Commands of a gait that feels the strains of a finished run, as a function of time."""

    def __init__(self, gait: Remembering, result: worm3d.Result) -> None:
        feedback, self.table = gait.bind(WORM), {}
        strain = result.chamber_length / WORM.l0 - 1.0
        self.table[0.0] = feedback.step(0.0, None)
        for before, end in enumerate(result.time[1:]):
            felt = Measurement(result.time[before], strain=(strain[before], result.time[before]))
            self.table[float(end)] = feedback.step(float(end), felt)

    def __call__(self, t: float) -> worm3d.Command:
        return self.table[t]


def test_samples_are_held_and_bad_ones_passed_over() -> None:
    feedback = SENSING.bind(WORM)
    feedback.step(0.0, None)
    assert_array_equal(feedback.felt["strain"], np.zeros((6, 2)))
    sample = np.full((6, 2), 0.1)
    sample[2, 1] = np.nan
    feedback.step(0.1, Measurement(0.1, strain=(sample, 0.1)))
    assert feedback.felt["strain"][2].tolist() == [0.1, 0.0]
    feedback.step(0.2, Measurement(0.2, strain=(None, 0.1)))
    assert feedback.felt["strain"][0].tolist() == [0.1, 0.1]
    feedback.reset()
    assert_array_equal(feedback.felt["strain"], np.zeros((6, 2)))


def test_sensors_make_what_it_feels() -> None:
    exact = run(SENSING)
    noisy = [run(SENSING, sensor=Sensors(strain=Channel(noise=0.01), seed=seed)) for seed in (1, 1, 2)]
    assert_array_equal(noisy[0].joints, noisy[1].joints)
    assert 1e-6 < np.abs(noisy[0].joints - exact.joints).max() < 1e-2
    assert np.abs(noisy[0].joints - noisy[2].joints).max() > 1e-6
    assert_array_equal(run(SENSING, sensor=Sensors(strain=Channel(noise=0.0))).joints, exact.joints)


@pytest.mark.parametrize(
    ("refused", "sentence"),
    [
        (lambda: Remembering(channels=("colour",)).bind(WORM), "colour: got a channel of this name, must be one of"),
        (
            lambda: Remembering(channels=("pressure",)).bind(WORM),
            "gait: it senses pressure, so it must be bound to a worm3d.Worm",
        ),
        (lambda: SENSING.activations(np.zeros(1), 6), "gait: '' senses strain, so it is not a function of time"),
        (lambda: run(Remembering(), sensor=Sensors()), "sensor: got an actuation that does not use measurements"),
    ],
)
def test_refusals(refused: object, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        refused()  # type: ignore[operator]


def test_a_sensor_without_the_channel_ends_the_run_with_a_sentence() -> None:
    result = run(SENSING, sensor=Sensors(strain=None))
    assert not result.status.value.startswith("done")
    assert "must have it because the gait senses it" in result.stop.sentence


def test_feedback_is_a_controller_that_gives_the_command_of_a_start() -> None:
    bound = SENSING.bind(WORM)
    assert isinstance(bound, Feedback)
    assert isinstance(bound, worm3d.Controller)
    assert_allclose(bound(0.0).contraction, TravellingWave().bind(WORM)(0.0).contraction, atol=1e-14)
