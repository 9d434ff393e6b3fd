"""The estimator on runs of the plant: errors, bounds, late and lost samples, moved worms, mirror images."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from time import process_time
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.estimate import consistency
from control.estimation.estimator import Estimate, Estimator, _Sample
from control.estimation.reduced import ReducedModel, ReducedState
from control.gaits.steering import GaitParameters, Schedule, WaveGenerator
from control.identification.identified import load
from control.sensing.sensors import COM, HEADING_SENSOR, STRAIN, Channel, Measurement, Sensors
from worm3d import Command, Friction, Observation, Plane, Worm, simulate

WORM = Worm()
BEGUN = 5.0
"""Time after which errors count [s]."""


@cache
def model() -> ReducedModel:
    found = load(WORM)
    assert found is not None
    return ReducedModel.of(WORM, found)


def straight(t: float) -> GaitParameters:
    return GaitParameters(0.28, 0.9)


def winding(t: float) -> GaitParameters:
    """As a controller winds along a path: speed and turn change slowly."""
    return GaitParameters(0.28 + 0.03 * np.sin(0.5 * t), 0.9 + 0.1 * np.sin(0.3 * t), hinge=0.05 * np.sin(0.4 * t))


PLANS: dict[str, Callable[[float], GaitParameters]] = {"straight": straight, "winding": winding}


@dataclass(frozen=True, eq=False)
class Recorded:
    """A run of the plant: what was asked for, phases and observations."""

    plan: Callable[[float], GaitParameters]
    phases: list[float]
    seen: list[Observation]

    @property
    def time(self) -> np.ndarray:
        return np.array([each.time for each in self.seen])

    def averaged(self, values: np.ndarray) -> np.ndarray:
        """Return the means over a wave around each instant; NaN at the ends."""
        t, phase = self.time, np.array(self.phases)
        summed = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))])
        begin = np.interp(phase - np.pi, phase, t, left=np.nan)
        end = np.interp(phase + np.pi, phase, t, right=np.nan)
        mean: np.ndarray = (np.interp(end, t, summed) - np.interp(begin, t, summed)) / (end - begin)
        return mean

    def truth(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return position (T, 2), heading and speed along it, averaged over a wave."""
        com = np.array([each.com[:2] for each in self.seen])
        place = np.column_stack([self.averaged(com[:, 0]), self.averaged(com[:, 1])])
        heading = self.averaged(np.unwrap([each.heading for each in self.seen]))
        velocity = np.gradient(place, self.time, axis=0)
        return place, heading, velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading)


class Recorder:
    """A controller that follows a plan and writes down what it sees."""

    def __init__(self, plan: Callable[[float], GaitParameters]) -> None:
        self.plan, self.generator = plan, WaveGenerator(Schedule(), WORM)
        self.reset()

    def reset(self) -> None:
        self.generator.reset()
        self.phases: list[float] = []
        self.seen: list[Observation] = []

    def step(self, t: float, seen: Observation) -> Command:
        dt = t - self.seen[-1].time if self.seen else 0.0
        self.phases.append(self.generator.phase)
        self.seen.append(seen)
        return self.generator.step(dt, self.plan(t))


@cache
def recorded(name: str, slope_deg: float = 0.0) -> Recorded:
    recorder = Recorder(PLANS[name])
    simulate(WORM, Plane(slope=np.deg2rad(slope_deg)), actuation=recorder, duration=30.0)
    return Recorded(recorder.plan, recorder.phases, recorder.seen)


def updated(estimator: Estimator, t: float, *given: Any) -> Estimate:
    """Return the estimate of an instant after the measurement of this instant."""
    estimator.take(t, *given)
    return estimator.estimate(t)


def estimated(run: Recorded, sensors: Sensors, estimator: Estimator, steps: int | None = None) -> list[Estimate]:
    """Return the estimates of a run that is seen again through sensors."""
    estimator.reset()
    sensors.reset()
    estimates, asked = [], GaitParameters(0.0, 0.9)
    for seen, phase in zip(run.seen[:steps], run.phases[:steps], strict=True):
        estimates.append(updated(estimator, seen.time, sensors(seen), asked, phase))
        asked = run.plan(seen.time)
    return estimates


@dataclass(frozen=True)
class Errors:
    """Errors of a run after its beginning: place [m], heading [rad] and speed [m/s]; each over its deviation too."""

    place: np.ndarray
    heading: np.ndarray
    speed: np.ndarray
    place_share: np.ndarray
    heading_share: np.ndarray


def errors(run: Recorded, estimates: list[Estimate]) -> Errors:
    place, heading, speed = run.truth()
    states, deviations = np.array([each.state for each in estimates]), np.array([e.deviations for e in estimates])
    counted = (run.time > BEGUN) & np.isfinite(speed)
    averaged = [run.averaged(column) for column in (states[:, 0], states[:, 1], np.unwrap(states[:, 2]))]
    off = np.column_stack(averaged[:2]) - place
    turned = (averaged[2] - heading + np.pi) % (2.0 * np.pi) - np.pi
    missed = run.averaged(np.array([each.speed for each in estimates])) - speed
    return Errors(
        off[counted],
        turned[counted],
        missed[counted],
        (off / deviations[:, :2])[counted],
        (turned / deviations[:, 2])[counted],
    )


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def nis_of(estimator: Estimator) -> list[float]:
    return [nis for t, nis in estimator.innovations if t > BEGUN]


@pytest.mark.slow
def test_nominal_runs_straight_ahead_are_known_within_their_bounds() -> None:
    """The worst of five seeds is within the bounds; the heading at the start is not told."""
    run, estimator, nis, shares = recorded("straight"), Estimator(WORM, model()), [], []
    for seed in range(5):
        off = errors(run, estimated(run, Sensors(seed=seed), estimator))
        assert rms(off.place) < 0.0015
        assert rms(off.heading) < np.deg2rad(1.0)
        assert abs(off.heading.mean()) < np.deg2rad(0.6)
        assert abs(off.speed.mean()) < 0.005 * 0.08
        assert rms(off.speed) < 0.02 * 0.08
        assert rms(off.place_share) < 1.0
        assert np.abs(off.heading_share).max() < 3.0
        shares.append(off.heading_share)
        nis.append(nis_of(estimator))
    assert rms(np.array(shares)) < 1.0
    assert sum(consistency(each).holds for each in nis) >= 4
    assert consistency([each for run_nis in nis for each in run_nis]).holds


@pytest.mark.slow
def test_nominal_runs_that_wind_are_known_within_their_bounds() -> None:
    run, estimator, nis, shares = recorded("winding"), Estimator(WORM, model(), heading=0.0), [], []
    for seed in range(5):
        off = errors(run, estimated(run, Sensors(seed=seed), estimator))
        assert rms(off.place) < 0.002
        assert rms(off.heading) < np.deg2rad(2.5)
        assert abs(off.speed.mean()) < 0.005 * 0.08
        assert rms(off.place_share) < 1.0
        shares.append(off.heading_share)
        nis.append(nis_of(estimator))
    assert rms(np.array(shares)) < 1.0
    assert sum(consistency(each).holds for each in nis) >= 4


@pytest.mark.slow
def test_without_noise_and_with_samples_at_every_step_little_is_left() -> None:
    """What the model misses: the harmonics of the rocking, and the lag."""
    exact = Sensors(Channel(noise=0.0), Channel(noise=0.0))
    off = errors(recorded("straight"), estimated(recorded("straight"), exact, Estimator(WORM, model())))
    assert rms(off.place) < 5e-4
    assert rms(off.heading) < 1e-9
    assert rms(off.speed) < 0.02 * 0.08


def turned(seen: Observation, angle: float) -> Observation:
    c, s = np.cos(angle), np.sin(angle)
    com = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ seen.com
    return replace(seen, com=com, heading=float(np.angle(np.exp(1j * (seen.heading + angle)))))


@pytest.mark.parametrize("angle", [0.3, 1.7, 3.1, -2.0])
def test_an_unknown_heading_is_found_within_two_seconds(angle: float) -> None:
    run = recorded("straight")
    away = Recorded(run.plan, run.phases, [turned(each, angle) for each in run.seen])
    estimates = estimated(away, Sensors(seed=6), Estimator(WORM, model()), 201)
    off = (estimates[-1].heading - angle + np.pi) % (2.0 * np.pi) - np.pi
    assert estimates[0].deviations[2] > 1.5, "from all sides"
    assert estimates[-1].deviations[2] < np.deg2rad(4.0)
    assert abs(off) < np.deg2rad(10.0)


def test_the_first_stroke_is_taken_neither_for_speed_nor_for_a_push() -> None:
    """A worm that begins to crawl draws itself together, which takes it 2 cm ahead at once."""
    run, exact = recorded("straight"), Sensors(Channel(noise=0.0), Channel(noise=0.0))
    _, _, speed = run.truth()
    estimates = estimated(run, exact, Estimator(WORM, model()), 200)
    assert estimates[100].speed == pytest.approx(speed[100], abs=0.015)
    assert estimates[150].speed == pytest.approx(speed[150], abs=0.008)
    for seed in range(20, 26):
        begun = estimated(run, Sensors(seed=seed), Estimator(WORM, model()), 400)
        assert max(each.deviations[ReducedState._fields.index("drift")] for each in begun) < 0.005, seed


@pytest.mark.slow
def test_a_first_stroke_back_is_not_taken_for_the_way_ahead() -> None:
    """Uphill on ground that holds feet no better one way than the other, it takes the worm back."""
    recorder, slope = Recorder(straight), Plane(slope=np.deg2rad(3.0))
    simulate(WORM, slope, ground=Friction(forward=0.1, backward=0.1, lateral=0.1), actuation=recorder, duration=1.8)
    run = Recorded(recorder.plan, recorder.phases, recorder.seen)
    assert min(each.com[0] for each in run.seen) < run.seen[0].com[0] - 0.01
    for seed in range(10):
        estimates = estimated(run, Sensors(seed=seed), Estimator(WORM, model()))
        assert abs(estimates[-1].heading) < 0.5, seed


def resting(steps: int, heading: float | None) -> list[Estimate]:
    run = recorded("straight")
    first = run.seen[0]
    estimator, sensors = Estimator(WORM, model(), heading=heading), Sensors(seed=7)
    asked = GaitParameters(0.0, 0.9)
    return [updated(estimator, 0.01 * k, sensors(replace(first, time=0.01 * k)), asked, 0.0) for k in range(steps)]


def test_at_rest_the_heading_stays_unknown() -> None:
    """Told or not, it grows no more certain."""
    unknown, told = resting(1000, None), resting(1000, 0.2)
    assert unknown[-1].deviations[2] > 1.0
    assert told[-1].heading == pytest.approx(0.2, abs=0.05)
    assert told[0].deviations[2] == pytest.approx(0.05)
    assert np.diff([each.deviations[2] for each in told[::20]]).min() > 0.0
    assert told[-1].speed == pytest.approx(0.0, abs=0.002)
    assert rms(np.array([each.position for each in told[300:]]) - recorded("straight").seen[0].com[:2]) < 0.002


@pytest.mark.slow
def test_a_late_sample_counts_at_its_instant() -> None:
    """With all samples late by as much, the estimate is the one that was, told on to now: no lag but of the model."""
    run = recorded("winding")
    prompt, late = Estimator(WORM, model(), heading=0.0), Estimator(WORM, model(), heading=0.0)
    delayed = Sensors(replace(STRAIN, delay=0.1), replace(COM, delay=0.1), seed=1)
    off = errors(run, estimated(run, Sensors(seed=1), prompt))
    off_late = errors(run, estimated(run, delayed, late))
    assert rms(off_late.place) < 1.3 * rms(off.place)
    assert rms(off_late.heading) < 1.1 * rms(off.heading)
    assert_allclose([t for t, _ in late.innovations], [t for t, _ in prompt.innovations][: len(late.innovations)])
    assert consistency(nis_of(late)).holds


@pytest.mark.slow
def test_samples_out_of_order_count_as_if_in_order() -> None:
    run = recorded("winding")
    quick = Sensors(Channel(noise=0.01), COM, replace(HEADING_SENSOR, rate=10.0), seed=2)
    slow = Sensors(Channel(noise=0.01), replace(COM, delay=0.13), replace(HEADING_SENSOR, rate=10.0), seed=2)
    for steps in (1009, 1500):
        in_order = estimated(run, quick, Estimator(WORM, model(), heading=0.0), steps)
        estimator = Estimator(WORM, model(), heading=0.0)
        out_of_order = estimated(run, slow, estimator, steps + 13)
        before, after = in_order[-1], out_of_order[-1]
        # The same samples, except for headings of the last moments; told on by a model that is quite sure of that.
        assert_allclose(
            after.position,
            before.position + 0.13 * before.speed * np.array([np.cos(before.heading), np.sin(before.heading)]),
            atol=0.002,
        )
        assert after.heading == pytest.approx(before.heading + 0.13 * before.turn_rate, abs=0.02)


@pytest.mark.parametrize("arrival", [(4, 3, 2, 1, 0), (2, 4, 0, 3, 1)])
def test_the_order_of_arrival_of_headings_makes_no_difference(arrival: tuple[int, ...]) -> None:
    """Samples of five instants, all of which arrive at later ones: the estimate is that of samples in order."""
    instants = 0.02 * (1.0 + np.arange(5))
    headings = np.array([0.05, -0.04, 0.1, -0.08, 0.02])

    def fed(order: tuple[int, ...]) -> Estimate:
        estimator, asked = Estimator(WORM, model(), heading=0.0), GaitParameters(0.28, 0.9, hinge=0.3)
        for k in range(11):
            known = {"heading": (np.array(headings[order[k - 6]]), instants[order[k - 6]])} if k > 5 else {}
            last = updated(estimator, 0.02 * k, Measurement(0.02 * k, **known), asked, 0.02 * k * 1.8 * np.pi)
        return last

    in_order, out_of_order = fed(tuple(range(5))), fed(arrival)
    assert_allclose(out_of_order.state, in_order.state, rtol=1e-9, atol=1e-12)
    assert_allclose(out_of_order.covariance, in_order.covariance, rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_lost_samples_are_bridged() -> None:
    run = recorded("winding")
    lossy = Sensors(replace(STRAIN, dropout=0.3), replace(COM, dropout=0.3), seed=3)
    estimator = Estimator(WORM, model(), heading=0.0)
    off = errors(run, estimated(run, lossy, estimator))
    assert rms(off.place) < 0.002
    assert rms(off.place_share) < 1.2
    assert consistency(nis_of(estimator)).holds


def test_without_any_sample_it_grows_uncertain() -> None:
    """From 10 s on nothing arrives: the bounds still hold the truth."""
    run, sensors = recorded("straight"), Sensors(seed=4)
    estimator, asked, estimates = Estimator(WORM, model(), heading=0.0), GaitParameters(0.0, 0.9), []
    for seen, phase in zip(run.seen, run.phases, strict=True):
        measured = sensors(seen)
        if seen.time > 10.0:
            measured = Measurement(measured.time)
        estimates.append(updated(estimator, seen.time, measured, asked, phase))
        asked = run.plan(seen.time)
    place, _, _ = run.truth()
    last = 2900
    off = np.abs(estimates[last].position - place[last])
    assert (off < 3.0 * estimates[last].deviations[:2]).all()
    assert estimates[last].deviations[0] > 5.0 * estimates[1000].deviations[0]
    assert off.max() < 0.15, "the model alone, over 1.4 m"


def test_the_slope_and_what_it_costs_are_found() -> None:
    """Uphill 3 degrees: the slope from the height, the slip from the way."""
    run = recorded("straight", 3.0)
    last = estimated(run, Sensors(seed=1), Estimator(WORM, model(), heading=0.0))[-1]
    _, _, speed = run.truth()
    assert last.slope[0] == pytest.approx(np.tan(np.deg2rad(3.0)), abs=0.02)
    assert abs(last.slope[0] - np.tan(np.deg2rad(3.0))) < 3.0 * np.sqrt(last.slope_covariance[0, 0])
    assert last.speed == pytest.approx(float(np.nanmean(speed[1000:])), rel=0.04)
    assert last.state.slip == pytest.approx(0.2, abs=0.05)


def test_a_single_wrong_sample_is_refused() -> None:
    run = recorded("straight")
    seen = [replace(each, com=each.com + 0.4) if k == 1500 else each for k, each in enumerate(run.seen)]
    estimator = Estimator(WORM, model(), heading=0.0)
    spoilt = estimated(Recorded(run.plan, run.phases, seen), Sensors(seed=2), estimator)
    fine = estimated(run, Sensors(seed=2), Estimator(WORM, model(), heading=0.0))
    assert max(nis for _, nis in estimator.innovations) > 1000.0
    assert_allclose(spoilt[-1].position, fine[-1].position, atol=1e-3)
    assert_allclose(spoilt[1501].position, fine[1501].position, atol=3e-3)


def test_a_worm_that_is_moved_is_found_again() -> None:
    """By 11 cm and 25 degrees at 15 s: known again a second later, heading included."""
    run, angle = recorded("straight"), np.deg2rad(25.0)
    pivot = run.seen[1500].com
    shift = np.array([0.05, 0.1, 0.0])
    seen = run.seen[:1500] + [
        replace(moved, com=moved.com + pivot + shift)
        for each in run.seen[1500:]
        for moved in [turned(replace(each, com=each.com - pivot), angle)]
    ]
    after = estimated(Recorded(run.plan, run.phases, seen), Sensors(seed=2), Estimator(WORM, model(), heading=0.0))
    assert np.linalg.norm(after[1600].position - seen[1600].com[:2]) < 0.012  # rocking included
    assert after[1800].heading == pytest.approx(angle, abs=0.1)
    assert after[1800].deviations[2] < 0.1
    assert after[1525].deviations[2] > 0.2, "it knows that it does not know"


def mirrored(seen: Observation) -> Observation:
    return replace(seen, chamber_strain=seen.chamber_strain[:, ::-1], com=seen.com * [1, -1, 1], heading=-seen.heading)


def opposite(plan: Callable[[float], GaitParameters]) -> Callable[[float], GaitParameters]:
    return lambda t: replace(plan(t), hinge=-plan(t).hinge, bias=-plan(t).bias)


@pytest.mark.parametrize("heading", [None, 0.1])
def test_the_mirrored_worm_has_the_mirrored_estimate(heading: float | None) -> None:
    run = recorded("winding")
    image = Recorded(opposite(run.plan), run.phases, [mirrored(each) for each in run.seen])
    here = Estimator(WORM, model(), heading=heading)
    there = Estimator(WORM, model(), heading=None if heading is None else -heading)
    one = estimated(run, Sensors(seed=9), here, 1000)
    two = estimated(image, Sensors(seed=9, mirrored=True), there, 1000)
    signs = ReducedState(1, -1, -1, 1, -1, 1, -1, -1, -1)
    for k in (0, 1, 5, 20, 60, 100, 300, 999):
        assert_allclose(two[k].state, np.array(signs) * one[k].state, atol=1e-9)
        assert_allclose(two[k].deviations, one[k].deviations, rtol=1e-6, atol=1e-15)
        assert_allclose(two[k].slope, one[k].slope * [1, -1], atol=1e-9)


@pytest.mark.parametrize("length", [0.1, 4.0])
def test_a_worm_of_another_length_has_the_estimate_in_proportion(length: float) -> None:
    """Samples of a worm that goes, is moved, and climbs, as they are and for a worm of another length."""
    run, found = recorded("winding", 5.0), load(WORM)
    assert found is not None
    seen, asked = Sensors(seed=6), []
    for each, phase in zip(run.seen[:1000], run.phases, strict=False):
        sample = seen(each)
        if sample.com is not None and each.time > 6.0:
            sample = sample.changed(com=(sample.com + np.array([0.0, 0.2, 0.0]), sample.com_time))
        asked.append((each.time, sample, run.plan(each.time), phase))
    states = []
    for factor in (1.0, length):
        worm = Worm(length=factor * WORM.length, half_height=factor * WORM.half_height[0])
        noise = {"com": replace(COM, noise=factor * COM.noise)}
        estimator = Estimator.for_sensors(worm, ReducedModel.of(worm, found), Schedule(), noise)
        for t, sample, parameters, phase in asked:
            com = None if sample.com is None else factor * sample.com
            estimator.take(t, sample.changed(com=(com, sample.com_time)), parameters, phase)
        states.append(estimator.estimate(asked[-1][0]))
    one, other = states
    sizes = np.array([length if name in ("x", "y", "speed", "drift") else 1.0 for name in ReducedState._fields])
    assert_allclose(np.array(other.state) / sizes, np.array(one.state), rtol=1e-3, atol=1e-5)
    assert_allclose(other.deviations / sizes, one.deviations, rtol=1e-3, atol=1e-12)
    assert_allclose(other.slope, one.slope, rtol=1e-3)
    assert one.slope[0] == pytest.approx(np.tan(np.deg2rad(5.0)), abs=0.02)


def test_strains_that_are_late_say_nothing_of_the_ground_rather_than_what_was() -> None:
    run, slopes = recorded("straight"), []
    for delay in (0.0, 0.5):
        found = estimated(run, Sensors(strain=replace(STRAIN, delay=delay), seed=2), Estimator(WORM, model()))
        slopes.append(max(float(np.abs(each.slope).max() / np.sqrt(each.slope_covariance[0, 0])) for each in found))
    assert max(slopes) < 2.5


def test_a_reset_estimator_says_the_same_again() -> None:
    run, estimator = recorded("winding"), Estimator(WORM, model())
    one, two = (estimated(run, Sensors(seed=1), estimator, 300) for _ in range(2))
    assert all(np.array_equal(a.state, b.state) for a, b in zip(one, two, strict=True))


def test_a_heading_sensor_is_used() -> None:
    run = recorded("winding")
    with_it = Sensors(heading=HEADING_SENSOR, seed=1)
    off = errors(run, estimated(run, with_it, Estimator(WORM, model())))
    assert rms(off.heading) < np.deg2rad(0.6)
    assert rms(off.heading_share) < 1.5


def test_an_update_filters_a_few_samples_once_more_and_never_all(record_property) -> None:
    run, sensors = recorded("winding"), Sensors(Channel(noise=0.01), Channel(noise=0.005), seed=1)
    estimator, kept, began = Estimator(WORM, model(), heading=0.0), [], process_time()
    for seen, phase in zip(run.seen[:1000], run.phases[:1000], strict=True):
        updated(estimator, seen.time, sensors(seen), run.plan(seen.time), phase)
        kept.append(len(estimator._past))
    record_property("cpu_ms_an_update", process_time() - began)
    assert max(kept) == max(kept[:300]), kept


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        ({"heading": float("nan")}, "heading: got nan rad, must be finite, or None where it is not known"),
        ({"heading": 0.0, "heading_deviation": 0.0}, r"heading_deviation: got 0\.0 rad, must be finite and above 0"),
    ],
)
def test_bad_starts_are_refused(more, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Estimator(WORM, model(), **more)


def test_an_instant_that_is_put_into_a_pause_of_samples_lies_in_it() -> None:
    """Such an instant bounds the steps of the filter; after the pause no sample may come before one in the future."""
    estimator, asked = Estimator(WORM, model(), heading=0.0), GaitParameters(0.28, 0.9)
    for k in range(60):
        known = {"heading": (np.array(0.05), 0.0)} if k == 0 else {}
        updated(estimator, 0.02 * k, Measurement(0.02 * k, **known), asked, 0.02 * k * 1.8 * np.pi)
        times = [each.sample.time for each in estimator._past]
        assert times == sorted(times)
        assert times[-1] <= 0.02 * k
    assert len(times) > 2, "some were put in"


@pytest.mark.parametrize("likelier", [0, 1])
def test_of_several_beliefs_the_likeliest_says_how_well_a_sample_fits(likelier: int) -> None:
    """Its innovation is that of the estimator, and what the noise is learnt from; the other belief is 2 cm off."""
    estimator, place = Estimator(WORM, model(), heading=0.0), np.array([0.4, 0.1, 0.03])
    estimator.estimate(0.0)
    (start,) = estimator._past
    sure = replace(start.beliefs[0], covariance=1e-8 * start.beliefs[0].covariance)
    near, far = (replace(sure, mean=sure.mean + np.eye(len(sure.mean))[1] * 0.02 * k) for k in (0, 1))
    for belief in (near, far):
        belief.mean[:2] += place[:2]
    learnt: list[np.ndarray] = []
    estimator.noise.learn = lambda innovation, spread: learnt.append(innovation)
    beliefs = [near, far] if likelier == 0 else [far, near]
    sample = _Sample(0.0, place, np.zeros(2), 0.005, np.nan, 0.8)
    found = estimator._fused(replace(start, beliefs=beliefs, placed=-0.05), sample, new=True)
    assert found.nis == pytest.approx(0.0, abs=1e-9)
    assert_allclose(learnt, [[0.0, 0.0]], atol=1e-9)
    alone = estimator._fused(replace(start, beliefs=[far], placed=-0.05), sample, new=True)
    assert alone.nis is not None
    assert alone.nis > 10.0


def test_as_long_as_samples_come_no_instant_is_put_between_them() -> None:
    """Each would cost a prediction of every belief at every step."""
    estimator, asked = Estimator(WORM, model(), heading=0.0), GaitParameters(0.28, 0.9)
    for k in range(40):
        t = 0.05 * k
        estimator.take(t, Measurement(t, heading=(np.array(0.0), t)), asked, t * 1.8 * np.pi)
    times = [each.sample.time for each in estimator._past]
    assert len(times) > 4
    assert_allclose(np.diff(times[1:]), 0.05)  # the first one is the start
