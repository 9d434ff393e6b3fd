"""Chambers that do not obey: who is found, who is not, and what becomes of their segment; faults that are put in."""

import numpy as np
import pytest

from control.estimation.chamber_gains import ChamberGains
from control.faults.chambers import Chambers
from control.faults.injected import INJECTED, Faulty, FaultyChamber, FaultyPlanner, FaultySensor, Injected
from control.identification.strain_model import StrainModel
from control.sensing.sensors import Measurement, Sample
from worm3d import Command, Worm

WORM = Worm()
GAIN, LAG = 0.9, 0.1  # of the plain model
DT = 0.01
NO_HINGE = np.zeros(WORM.segments - 1)


def wave(t: float) -> np.ndarray:
    """Return a wave of the commands, left and right alike, shape (N, 2)."""
    x = (np.arange(WORM.segments) + 0.5) / WORM.segments
    return np.tile(0.3 * np.maximum(0.0, np.sin(2.0 * np.pi * (x / 0.7 + 0.8 * t)))[:, None], 2)


def crawled(
    spoil, seconds: float = 4.0, noise: float = 0.01, bend=0.0, gain: float = GAIN, delay: int = 0
) -> tuple[Chambers, list]:
    """Return the chambers of a worm of first-order answers after a while, and the faults that were found.

    `spoil` changes what is told at a time; `bend` is added to the contraction of the left, taken from the right.
    """
    chambers, gains, random = Chambers(WORM), ChamberGains(StrainModel.plain(WORM.segments)), np.random.default_rng(1)
    answer, found, waiting = np.zeros((WORM.segments, 2)), [], []
    for t in np.arange(0.0, seconds, DT):
        seen = answer + np.multiply.outer(np.broadcast_to(bend, WORM.segments), [0.5, -0.5])
        strain = -seen + noise * random.standard_normal(seen.shape)
        waiting.append((t, strain))
        instant, arrived = waiting.pop(0) if len(waiting) > delay else (np.nan, None)
        gains.take(t, 2.0 * np.pi * 0.8 * t, arrived, instant)
        found += chambers.take(t, arrived, gains)
        command = chambers.amended(t, Command(wave(t), NO_HINGE))
        gains.tell(t, command)
        told = command.contraction
        answer += (1.0 - np.exp(-DT / LAG)) * (gain * spoil(t, told.copy()) - answer)
    return chambers, found


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("segment", range(WORM.segments))
@pytest.mark.parametrize(("share", "value"), [(0.0, 0.0), (0.3, 0.0), (0.0, 0.3)])
def test_the_chamber_that_does_not_obey_is_found_within_a_wave_and_its_segment_held_still(segment, side, share, value):
    def spoil(t: float, told: np.ndarray) -> np.ndarray:
        if t >= 1.0:
            told[segment, side] = value + share * told[segment, side]
        return told

    chambers, found = crawled(spoil)
    assert [fault.kind for fault in found] == [f"chamber {segment} {('left', 'right')[side]}"]
    assert 1.0 < found[0].time < 1.0 + 1.25
    later = [chambers.amended(t, Command(wave(t), NO_HINGE)).contraction for t in (5.0, 5.4, 5.8)]
    assert np.ptp([each[segment] for each in later], axis=0).max() == 0.0
    others = np.arange(WORM.segments) != segment
    for t, each in zip((5.0, 5.4, 5.8), later, strict=True):
        np.testing.assert_array_equal(each[others], wave(t)[others])
    answered = (value + share * later[0][segment, side]) * GAIN
    assert later[0][segment, 1 - side] == pytest.approx(answered, abs=0.015)


def test_a_chamber_that_does_not_obey_is_found_by_strains_that_come_late() -> None:
    def spoil(t: float, told: np.ndarray) -> np.ndarray:
        told[2, 1] *= t < 1.0
        return told

    _, found = crawled(spoil, delay=10)
    assert [fault.kind for fault in found] == ["chamber 2 right"]
    assert 1.0 < found[0].time < 1.0 + 1.25 + 0.1


@pytest.mark.parametrize(
    ("bend", "gain", "noise"),
    [
        (0.0, 0.6, 0.01),  # a load that all feel
        (0.0, GAIN, 0.05),
        ([0.02, 0.06, 0.12, 0.12, 0.06, 0.02], GAIN, 0.01),  # a push
        ([0.18, 0.09, 0.05, 0.02, 0.0, 0.0], GAIN, 0.01),
    ],
)
def test_loads_noise_and_pushes_are_no_faults(bend, gain, noise) -> None:
    chambers, found = crawled(lambda t, told: told, noise=noise, bend=bend, gain=gain)
    assert not found
    command = Command(wave(1.0), NO_HINGE)
    assert chambers.amended(9.0, command) is command


def test_unknown_strains_are_passed_over() -> None:
    chambers, gains = Chambers(WORM), ChamberGains(StrainModel.plain(WORM.segments))
    for t in np.arange(0.0, 2.0, DT):
        strain = None if int(t / DT) % 3 else np.full((WORM.segments, 2), np.nan)
        gains.take(t, 2.0 * np.pi * 0.8 * t, strain, t)
        assert not chambers.take(t, strain, gains)
        gains.tell(t, chambers.amended(t, Command(wave(t), NO_HINGE)))
    np.testing.assert_array_equal(gains.gain, 1.0)
    assert np.isfinite(chambers.amended(2.0, Command(wave(2.0), NO_HINGE)).contraction).all()


class Recorder:
    """A controller that writes down what it is told."""

    def reset(self) -> None:
        self.seen: list[Measurement] = []

    def step(self, t: float, measurement: Measurement) -> Command:
        self.seen.append(measurement)
        return Command(wave(t), NO_HINGE)


def measured(t: float) -> Measurement:
    return Measurement(t, com=(np.array([t, 2.0 * t, 0.1]), t), strain=(np.full((WORM.segments, 2), -t), t))


def steps(*faults: Injected) -> tuple[list[Measurement], list[Command]]:
    recorder = Recorder()
    faulty = Faulty(recorder, faults)
    commands = [faulty.step(t, measured(t)) for t in (0.0, 1.0, 2.0, 3.0)]
    return recorder.seen, commands


def test_a_faulty_chamber_holds_or_follows_in_part_while_the_fault_lasts() -> None:
    fault = FaultyChamber(begin=1.0, duration=1.5, segment=2, side="right", contraction=0.1, share=0.5)
    _, commands = steps(fault)
    for t, command in zip((0.0, 1.0, 2.0, 3.0), commands, strict=True):
        expected = wave(t)
        if t in (1.0, 2.0):
            expected[2, 1] = 0.1 + 0.5 * expected[2, 1]
        np.testing.assert_allclose(command.contraction, expected, rtol=0, atol=1e-15)


def test_a_faulty_sensor_is_lost_frozen_or_off() -> None:
    seen, _ = steps(FaultySensor(begin=2.0), FaultySensor(begin=2.0, channel="strain", mode="frozen", segment=1))
    assert [each.com is None for each in seen] == [False, False, True, True]
    assert seen[3].strain[1].tolist() == [-1.0, -1.0]
    assert seen[3].strain[0].tolist() == [-3.0, -3.0]
    assert seen[3].strain_time == 3.0
    seen, _ = steps(FaultySensor(mode="off", error=0.5))
    np.testing.assert_allclose(seen[3].com, [3.5, 6.5, 0.6])


def test_a_faulty_sensor_drifts_in_one_component_or_has_its_sides_swapped() -> None:
    seen, _ = steps(FaultySensor(begin=1.0, mode="drifting", error=0.1, component=1))
    whole, _ = steps()
    off = [spoilt.com - true.com for spoilt, true in zip(seen, whole, strict=True)]
    np.testing.assert_allclose(off, [[0, 0, 0], [0, 0, 0], [0, 0.1, 0], [0, 0.2, 0]], rtol=0, atol=1e-15)
    lost, _ = steps(FaultySensor(component=2))
    assert np.isnan(lost[3].com).tolist() == [False, False, True]
    strain = np.arange(12.0).reshape(6, 2)
    given = Measurement(1.0, strain=Sample(strain, 1.0))
    swapped = FaultySensor(channel="strain", mode="swapped").measured(given, None)
    assert swapped.strain.tolist() == strain[:, ::-1].tolist()
    one = FaultySensor(channel="strain", mode="swapped", segment=2).measured(given, None)
    assert one.strain[2].tolist() == [5.0, 4.0]
    assert one.strain[[0, 1, 3, 4, 5]].tolist() == strain[[0, 1, 3, 4, 5]].tolist()


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (FaultyChamber(segment=6), "segment: got 6, must be below 6"),
        (FaultySensor(channel="com", segment=1), "com is of the whole worm"),
        (FaultySensor(channel="com", mode="swapped"), "mode: got 'swapped', must be another one: com has no sides"),
        (FaultySensor(channel="com", component=3), "component: got 3, must be below 3"),
        (FaultySensor(channel="strain", component=0), "component: got 0, must be left out: strain has the shape"),
    ],
)
def test_faults_that_a_worm_cannot_have(fault: Injected, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        fault.require(WORM)


def test_a_controller_without_planner_has_no_faulty_one() -> None:
    with pytest.raises(ValueError, match="planner: got this fault, but Recorder plans nothing"):
        Faulty(Recorder(), [FaultyPlanner()])


def test_faults_are_found_by_name() -> None:
    assert set(INJECTED) == {"chamber", "unequal", "sensor", "planner"}
