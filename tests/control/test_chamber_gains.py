"""Gains and phases of chambers from strains, the model of a healthy worm, and the law that corrects the commands."""

import numpy as np
import pytest

from control.estimation.chamber_gains import ChamberGains, GainTrust
from control.gaits.steering import Correction, GaitParameters, Schedule, WaveGenerator
from control.identification.identified import load
from control.identification.strain_model import StrainModel, inputs, lagged
from control.inner_loop import InnerLoop
from control.supervisor import Supervisor
from control.task import ControlTask
from control.tracking.references import Constant, Reference
from scenes.models.control.identify import Subject, strain_model
from worm3d import Command, Friction, Worm

DT = 0.01
WAVE = GaitParameters(0.3, 0.8, hinge=0.05)
FOUND = load(Worm())
assert FOUND is not None
assert FOUND.strain is not None
MODEL = FOUND.strain


class Plant:
    """A worm that is (SM1) itself, of which each chamber does a share of its command, later by a phase."""

    def __init__(self, model: StrainModel, gain: np.ndarray, late: np.ndarray) -> None:
        self.model, self.share, self.late = model, gain, late
        count = model.segments
        self.before = np.zeros((count, 2)), np.zeros(count - 1)
        self.lags = np.zeros((count, 2, 3)), np.zeros((count - 1, 3))

    def strain(self, command: Command, late: np.ndarray) -> np.ndarray:
        """Return the strains a step later; `late` is what the chambers would be told, were they not late."""
        now = self.share * late, command.hinge
        parts = zip(self.lags, self.before, now, strict=True)
        self.lags = tuple(lagged(x, u[..., None], v[..., None], self.model.time_constants, DT) for x, u, v in parts)
        self.before = now
        each = inputs(self.lags[0].transpose(2, 0, 1), self.lags[1].T)
        return (self.model.weights.transpose(2, 0, 1)[:, :, None] * each).sum(axis=(0, -1)) + self.model.mean[:, None]


def crawled(gain, late=0.0, seconds=12.0, noise=0.01, loop=None, delay=0.0, seed=1):
    """Return gains, plant strains, and a healthy worm's strains, of a worm that crawls for a while."""
    worm, random = Worm(), np.random.default_rng(seed)
    gain, late = (np.broadcast_to(each, (6, 2)).astype(float) for each in (gain, late))
    plant, healthy = Plant(MODEL, gain, late), Plant(MODEL, np.ones((6, 2)), np.zeros((6, 2)))
    gains, generator, told, seen = (
        ChamberGains(MODEL),
        WaveGenerator(Schedule(), worm),
        WaveGenerator(Schedule(), worm),
        [],
    )
    strain, waiting = None, []
    for k in range(round(seconds / DT)):
        t = k * DT
        if strain is not None:
            waiting.append((t, strain + noise * random.standard_normal((6, 2))))
        sample = waiting.pop(0) if waiting and waiting[0][0] <= t - delay + 1e-9 else (np.nan, None)
        gains.take(t, generator.phase, sample[1], sample[0])
        correction = Correction(np.ones((6, 2)), np.zeros((6, 2))) if loop is None else loop.correction(gains)
        generator.correction = correction
        told.correction = Correction(correction.gain, correction.ahead - late)
        command = generator.step(DT, WAVE)
        strain = plant.strain(command, told.step(DT, WAVE).contraction)
        gains.tell(t, command)
        wanted = Schedule().commands_at(np.array([generator.phase]), generator.parameters.row()[None], worm)
        seen.append((strain, healthy.strain(command, wanted.contraction[0])))
    return gains, *np.array(seen).transpose(1, 0, 2, 3)


def test_a_healthy_worm_has_gains_of_one_and_its_commands_are_left_alone() -> None:
    gains, *_ = crawled(1.0)
    np.testing.assert_allclose(gains.gain, 1.0, atol=0.03)
    np.testing.assert_allclose(gains.phase, 0.0, atol=0.03)
    given = InnerLoop().correction(gains)
    np.testing.assert_allclose(given.gain, 1.0, atol=0.01)
    np.testing.assert_allclose(given.ahead, 0.0, atol=0.01)


@pytest.mark.parametrize("delay", [0.0, 0.3, 1.2])
def test_weak_and_late_chambers_are_found_one_by_one_however_late_strains_come(delay) -> None:
    random = np.random.default_rng(5)
    gain, late = random.uniform(0.5, 1.2, (6, 2)), random.uniform(0.0, 0.5, (6, 2))
    gains, *_ = crawled(gain, late, delay=delay)
    np.testing.assert_allclose(gains.gain, gain, atol=0.06)
    np.testing.assert_allclose(gains.phase, -late, atol=0.1)
    assert (gains.doubt < 0.05).all()


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_with_the_loop_closed_weak_and_late_chambers_do_what_healthy_ones_do(noise) -> None:
    random = np.random.default_rng(6)
    gain, late = random.uniform(0.65, 1.1, (6, 2)), random.uniform(0.0, 0.4, (6, 2))
    _, seen, healthy = crawled(gain, late, noise=noise, loop=InnerLoop(), seconds=10.0)
    _, without, _ = crawled(gain, late, noise=noise, seconds=10.0)
    miss, before = (np.sqrt(((each - healthy)[-250:] ** 2).mean()) for each in (seen, without))
    assert miss < 0.2 * before


def test_a_deviation_that_all_chambers_share_is_left_to_the_planner() -> None:
    gains, *_ = crawled(0.7, -0.35)
    np.testing.assert_allclose(gains.gain, 0.7, atol=0.03)
    np.testing.assert_allclose(gains.phase, 0.35, atol=0.05)
    given = InnerLoop().correction(gains)
    np.testing.assert_allclose(given.gain, 1.0, atol=0.02)
    np.testing.assert_allclose(given.ahead, 0.0, atol=0.02)


@pytest.mark.parametrize(("least", "early"), [(0.5, -0.5), (1.1, 0.1)])
def test_unequal_chambers_are_made_like_the_one_that_is_nearest_to_a_healthy_one(least, early) -> None:
    random = np.random.default_rng(7)
    gain, late = random.uniform(least, least + 0.3, (6, 2)), random.uniform(-early - 0.3, -early, (6, 2))
    shared = min((gain.min(), gain.max()), key=lambda g: abs(g - 1.0))
    nearest = min((late.min(), late.max()), key=abs)
    _, seen, _ = crawled(gain, late, loop=InnerLoop(), seconds=10.0)
    _, without, _ = crawled(gain, late, seconds=10.0)
    _, alike, _ = crawled(shared, nearest, seconds=10.0)
    miss, before = (np.sqrt(((each - alike)[-250:] ** 2).mean()) for each in (seen, without))
    assert miss < 0.2 * before


def test_two_chambers_of_a_segment_are_told_apart_though_each_moves_the_other() -> None:
    gain = np.ones((6, 2))
    gain[2] = 0.6, 1.0
    gains, *_ = crawled(gain)
    np.testing.assert_allclose(gains.gain, gain, atol=0.04)


def test_a_chamber_of_unknown_strain_keeps_its_gain_and_the_others_are_found() -> None:
    gains = ChamberGains(MODEL)
    generator = WaveGenerator(Schedule(), Worm())
    for k in range(500):
        strain = np.full((6, 2), -0.05)
        strain[3, 1] = np.nan
        gains.take(k * DT, generator.phase, strain, k * DT)
        gains.tell(k * DT, generator.step(DT, WAVE))
    assert gains.gain[3, 1] == 1.0
    assert np.isnan(gains.miss[3, 1])
    assert gains.gain[3, 0] < 0.7  # strains that stay are those of a chamber that does nothing
    gains.reset()
    np.testing.assert_array_equal(gains.gain, 1.0)


def test_a_worm_whose_wave_stands_still_teaches_nothing_of_its_gains() -> None:
    gains = ChamberGains(MODEL)
    for k in range(300):
        gains.take(k * DT, 1e-8 * k, np.full((6, 2), 0.02), k * DT)
        gains.tell(k * DT, Command(np.full((6, 2), 0.2)))
    np.testing.assert_array_equal(gains.gain, 1.0)
    np.testing.assert_allclose(gains.doubt, GainTrust().begin)
    assert np.isfinite(gains.miss).all()


@pytest.mark.parametrize("every", [5, 10])
def test_samples_that_are_rare_tell_gains_as_soon_as_frequent_ones(every: int) -> None:
    def found(rarely: int) -> np.ndarray:
        plant, gains = Plant(MODEL, np.full((6, 2), 0.7), np.zeros((6, 2))), ChamberGains(MODEL)
        generator, strain = WaveGenerator(Schedule(), Worm()), None
        for k in range(500):
            sample = strain if k % rarely == 0 else None
            gains.take(k * DT, generator.phase, sample, k * DT)
            command = generator.step(DT, WAVE)
            strain = plant.strain(command, command.contraction)
            gains.tell(k * DT, command)
        np.testing.assert_allclose(gains.gain, 0.7, atol=0.03)
        return gains.doubt

    np.testing.assert_allclose(found(every), found(1), rtol=0.25)


@pytest.mark.parametrize("segments", [1, 2, 9])
def test_worms_of_other_numbers_of_segments_have_gains_by_the_plain_model_and_no_inner_loop(segments: int) -> None:
    assert FOUND is not None
    worm = Worm(segments=segments, length=segments / 6.0)
    driver = Supervisor.of(ControlTask(worm, Reference(Constant(0.05)), FOUND))
    assert driver.inner_loop is None
    gains, generator = ChamberGains(StrainModel.plain(segments)), WaveGenerator(Schedule(), worm)
    lag = np.zeros((segments, 2))
    before = lag
    for k in range(600):
        gains.take(k * DT, generator.phase, -0.9 * 0.6 * lag, k * DT)
        command = generator.step(DT, GaitParameters(0.3, 0.8))
        lag, before = lagged(lag, before, command.contraction, 0.1, DT), command.contraction
        gains.tell(k * DT, command)
    np.testing.assert_allclose(gains.gain, 0.6, atol=0.03)


def test_the_shipped_model_is_that_of_the_default_worm_and_is_made_again() -> None:
    assert FOUND is not None
    again = strain_model(Subject(Worm(), Friction(), FOUND.schedule), FOUND.maps["both"])
    np.testing.assert_allclose(again.weights, MODEL.weights, atol=2e-5)
    assert StrainModel.from_dict(MODEL.as_dict()) == MODEL
    assert StrainModel.plain(6) != MODEL


def test_a_filter_of_one_lag_is_found_exactly() -> None:
    random, count = np.random.default_rng(2), 3
    time, told = DT * np.arange(3000), np.repeat(random.uniform(0.0, 0.3, (60, count, 2)), 50, axis=0)
    hinge, model = np.repeat(random.uniform(-0.1, 0.1, (60, count - 1)), 50, axis=0), StrainModel.plain(count)
    lag, seen = np.zeros((count, 2)), []
    for k in range(len(time)):
        lag = lagged(lag, told[max(k - 1, 0)], told[k], 0.1, DT) if k else told[0]
        seen.append(-0.9 * lag + 0.01)
    found = StrainModel.fit(time, told, hinge, np.array(seen))
    weights = np.zeros_like(found.weights)
    weights[:, 0, 1] = -0.9
    np.testing.assert_allclose(found.weights, weights, atol=1e-6)
    np.testing.assert_allclose(found.mean, 0.01, atol=1e-8)
    few = StrainModel.fit(time[:220], told[:220], hinge[:220], np.array(seen)[:220])
    assert few == model


def test_a_correction_of_a_wave_that_goes_backwards_is_that_of_the_same_chambers() -> None:
    random, worm = np.random.default_rng(3), Worm()
    gain, ahead = random.uniform(0.8, 1.2, (6, 2)), random.uniform(-0.3, 0.3, (6, 2))
    phase, rows = np.array([1.0, 2.0]), np.array([[0.2, 0.8, 0.3, 0.05], [-0.2, 0.8, 0.3, 0.05]])
    forward = Schedule().commands_at(phase, rows * [1.0, 1.0, 1.0, 1.0], worm, Correction(gain, ahead)).contraction
    for k in range(2):
        for segment in range(6):
            for side in range(2):
                alone = Schedule().commands_at(phase[k : k + 1] + ahead[segment, side], rows[k : k + 1], worm)
                wanted = gain[segment, side] * alone.contraction[0, segment, side]
                assert forward[k, segment, side] == pytest.approx(wanted, abs=1e-15)
    none = Correction(np.ones((6, 2)), np.zeros((6, 2)))
    plain = Schedule().commands_at(phase, rows, worm)
    np.testing.assert_array_equal(Schedule().commands_at(phase, rows, worm, none).contraction, plain.contraction)
