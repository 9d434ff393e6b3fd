"""The measured wave, the body's height and the record of what the worm was told."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.ground import MAX_GROUND_SAMPLES, Ground, GroundTrust, Standing
from control.estimation.wave import InputHistory, MeasuredWave
from control.gaits.steering import GaitParameters, Schedule, WaveGenerator
from worm3d import Worm


def strains(phase: float, amplitude: float, lag: float, schedule: Schedule) -> np.ndarray:
    """Return strains of a sinusoidal wave that lags behind its command."""
    x, sign = (np.arange(6) + 0.5) / 6, 1.0 if schedule.direction == "retrograde" else -1.0
    wave = -0.08 + amplitude * np.cos(2.0 * np.pi * x / schedule.wavelength + sign * (phase - lag))
    return np.column_stack([wave + 0.03, wave - 0.03])  # a bend does not matter


@pytest.mark.parametrize("direction", ["retrograde", "direct"])
def test_a_sinusoidal_wave_is_found_exactly(direction) -> None:
    schedule = Schedule(direction=direction)
    wave = MeasuredWave(6, schedule)
    for phase in np.arange(0.0, 60.0, 0.1):  # the wrong start has decayed to rounding
        wave.take(strains(phase, 0.12, 0.7, schedule), phase)
    assert abs(wave.amplitude) == pytest.approx(0.12, rel=1e-9)
    assert_allclose(np.linalg.norm(wave.at(61.0)), 0.12)
    turned = np.arctan2(*wave.at(61.0)[::-1])
    sign = 1.0 if direction == "retrograde" else -1.0
    assert np.exp(1j * turned) == pytest.approx(np.exp(1j * sign * (61.0 - 0.7)))


def test_a_new_amplitude_shows_within_half_a_wave() -> None:
    schedule = Schedule()
    wave = MeasuredWave(6, schedule)
    for phase in np.arange(0.0, 20.0, 0.05):
        wave.take(strains(phase, 0.1 if phase < 10.0 else 0.2, 0.0, schedule), phase)
        if phase < 10.0 + np.pi:
            late = abs(wave.amplitude)
    assert late == pytest.approx(0.2 - 0.1 * np.exp(-2.0), rel=0.01)


def test_time_without_samples_counts() -> None:
    """What is smoothed away is a matter of the phase passed, not of the number of samples."""
    schedule = Schedule()
    found = []
    for step in (0.02, 0.2):
        wave = MeasuredWave(6, schedule)
        for k in range(round(4.0 / step) + 1):
            wave.take(strains(k * step, 0.1, 0.0, schedule), k * step)
        found.append(wave.amplitude)
    assert found[1] == pytest.approx(found[0], rel=1e-12)


def test_a_uniform_body_stands_as_high_as_its_chambers() -> None:
    worm = Worm(half_height=np.linspace(0.05, 0.05, 6))
    for strain in (-0.3, 0.0, 0.05):
        half_height = np.sqrt(worm.link_length[0] ** 2 - (worm.l0 * (1.0 + strain) / 2.0) ** 2)
        assert Standing(worm).height(np.full((6, 2), strain)) == pytest.approx(half_height, rel=1e-12)


def test_a_body_stands_on_its_thick_segments() -> None:
    strain = np.zeros((6, 2))
    strain[2:4] = -0.35
    thin, thick = (Standing(Worm()).height(np.full((6, 2), each)) for each in (0.0, -0.35))
    assert thick - 0.1 * (thick - thin) < Standing(Worm()).height(strain) < thick


def walked(places: np.ndarray, heights: np.ndarray) -> Ground:
    trust = GroundTrust()
    ground = Ground.unknown(trust)
    for place, height in zip(places, heights, strict=True):
        ground = ground.sampled(place, float(height), trust)
    return ground


def test_the_slope_of_a_plane_is_found_along_the_way_and_across_it_after_a_turn() -> None:
    slope = np.array([0.06, -0.04])
    straight = np.column_stack([np.linspace(0.0, 2.0, 400), np.zeros(400)])
    turned = np.column_stack([np.full(400, 2.0), np.linspace(0.0, 2.0, 400)])
    before = walked(straight, 0.3 + straight @ slope)
    assert before.slope[0] == pytest.approx(0.06, abs=0.002)
    assert before.slope[1] == pytest.approx(0.0, abs=1e-12)
    assert np.sqrt(before.covariance[2, 2]) >= GroundTrust().slope
    both = np.vstack([straight, turned])
    after = walked(both, 0.3 + both @ slope)
    assert after.slope[1] == pytest.approx(-0.04, abs=0.002)
    assert np.sqrt(after.covariance[2, 2]) < 0.5 * GroundTrust().slope


def test_the_slope_is_as_uncertain_as_it_says() -> None:
    """Normalised errors over runs whose slope changes by chance from stride to stride, as the filter assumes."""
    random, trust, errors = np.random.default_rng(4), GroundTrust(), []
    for _ in range(200):
        slope, place, height, ground = trust.slope * random.standard_normal(2), np.zeros(2), 0.5, Ground.unknown(trust)
        for k in range(40):
            towards = np.array([np.cos(0.1 * k), np.sin(0.1 * k)])
            way = 2.0 * trust.stride * towards
            height, place = height + slope @ way, place + way
            slope = slope + trust.change * np.sqrt(2.0 * trust.stride) * random.standard_normal(2)
            standing = height + trust.standing * random.standard_normal()
            for side in (-0.51, 0.51):  # a stride of two samples
                noisy = standing + trust.height * random.standard_normal()
                ground = ground.sampled(place + side * trust.stride * towards, noisy, trust)
        off = ground.slope - slope
        errors.append(off @ np.linalg.solve(ground.covariance[1:, 1:], off))
    assert np.mean(errors) == pytest.approx(2.0, abs=4.0 * 2.0 / np.sqrt(200))


def test_a_worm_at_rest_learns_nothing_of_the_slope() -> None:
    ground = walked(1e-3 * np.random.default_rng(1).standard_normal((1000, 2)), np.full(1000, 0.4))
    assert_allclose(ground.slope, 0.0, atol=0.0)
    assert_allclose(np.diag(ground.covariance)[1:], GroundTrust().slope ** 2)
    assert len(ground.gathered) <= MAX_GROUND_SAMPLES


def test_errors_of_the_place_do_not_point_across_the_way() -> None:
    """Samples 1 mm apart with errors as large: what lies across the way stays unknown, and is not made up."""
    random = np.random.default_rng(2)
    way = np.column_stack([np.linspace(0.0, 2.0, 2000), np.zeros(2000)])
    found = [
        walked(way + 1e-3 * random.standard_normal(way.shape), 5e-3 * random.standard_normal(2000)).slope
        for _ in range(5)
    ]
    assert np.abs(np.array(found)[:, 1]).max() < 0.002


@pytest.mark.parametrize("name", ["height", "standing", "slope", "change"])
def test_bad_trust_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=rf"{name}: got 0\.0.*, must be finite and above 0"):
        GroundTrust(**{name: 0.0})


def test_inputs_hold_up_to_their_instants() -> None:
    driven, one, two = InputHistory(5.0), np.array([0.2, 1.0, 0.0]), np.array([0.3, 1.0, 0.0])
    for k in range(11):
        driven.add(0.1 * k, one if k <= 4 else two, 0.5 * k)
    pieces = list(driven.between(0.13, 0.92))
    assert_allclose([piece[0][1] for piece in pieces], 5.0 / (2.0 * np.pi))
    assert_allclose([piece[1] for piece in pieces], [0.4 - 0.13, 0.92 - 0.4])
    assert driven.phase(0.25) == pytest.approx(1.25)
    assert list(driven.between(0.5, 0.5)) == []
    beyond = list(driven.between(0.9, 1.2))
    assert sum(piece[1] for piece in beyond) == pytest.approx(0.3)


def test_the_wave_in_force_is_the_generators() -> None:
    """Also where it swells from nothing, slows down, and turns round."""
    generator, driven, instants = WaveGenerator(Schedule(), Worm()), InputHistory(9.0), 0.01 * np.arange(601)
    asked = [GaitParameters(0.3, 0.8)] * 200 + [GaitParameters(0.2, 1e-6)] * 200 + [GaitParameters(-0.3, 1.0)] * 200
    driven.add(0.0, asked[0].row()[[0, 1, 3]], 0.0)
    waves = [GaitParameters(0.0, 0.8)]
    for t, target in zip(instants[1:], asked, strict=True):
        generator.step(0.01, target)
        assert generator.parameters is not None
        waves.append(generator.parameters)
        driven.add(t, target.row()[[0, 1, 3]], generator.phase)
    for k in (10, 150, 250, 390):
        ((given, _),) = driven.between(instants[k], instants[k + 1])
        two = np.mean([waves[k].row(), waves[k + 1].row()], axis=0)
        assert_allclose(given[:2], two[:2], rtol=0.02, atol=1e-4)
    ((given, _),) = driven.between(instants[-2], instants[-1])
    assert_allclose(given[:2], [-0.3, 1.0], rtol=0.01)
    assert driven.frequency(5.98) == pytest.approx(1.0, rel=0.01)


def test_what_is_old_is_forgotten() -> None:
    driven = InputHistory(1.0)
    for k in range(1000):
        driven.add(0.01 * k, np.array([0.2, 1.0, 0.0]), 0.05 * k)
    assert driven.phase(9.0) == pytest.approx(45.0)
    assert sum(piece[1] for piece in driven.between(9.2, 9.9)) == pytest.approx(0.7)
    assert len(driven) <= 202
