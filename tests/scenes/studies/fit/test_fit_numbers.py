"""Fits without a simulation: noise, intervals, slopes, what data determine, and the search for a minimum."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.fft import dct
from scipy.linalg import toeplitz
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.studies.fit.dips import dips
from scenes.studies.fit.identifiability import VAGUE, determined, vague
from scenes.studies.fit.lack import lack_of, ratio_of
from scenes.studies.fit.noise import Noise, autocorrelation, noise_of, spectra_of
from scenes.studies.fit.slopes import MAX_DERIVATIVE_HALVINGS, Slopes, slopes_at
from scenes.studies.fit.solving import AROUND, FIRST_STEP, STARTS, TINY_STEP, _Problem, solve
from scenes.studies.fit.suspects import suspects_of
from scenes.studies.fit.trials import Data, SpentError
from scenes.studies.fit.uncertainty import MOST_CHANNELS, Uncertainty, uncertainty_of
from scenes.studies.fit.varied import Varied, varied_of

PHI = 0.8
TIME = np.linspace(0.0, 4.0, 160)


def autoregressive(random: np.random.Generator, *shape: int, phi: float = PHI) -> np.ndarray:
    """Return stationary series of variance 1 along the last axis."""
    white = random.standard_normal((*shape[:-1], shape[-1] + 200))
    return np.sqrt(1.0 - phi**2) * lfilter([1.0], [1.0, -phi], white, axis=-1)[..., 200:]


class Analytic:
    """Stands in for trial runs of a scene: a function of the values."""

    def __init__(self, function: Callable, values: np.ndarray, *varied: Varied, most: int = 1000) -> None:
        self.varied, self.most, self.runs, self._function = varied, most, 0, function
        self.data = Data(("y_m",), ("m",), TIME, values)

    def __call__(self, values: np.ndarray) -> np.ndarray | None:
        if self.runs >= self.most:
            raise SpentError
        self.runs += 1
        found = self._function(*values)
        return None if found is None else np.where(np.isfinite(self.data.values), found, np.nan)

    def number(self, key: str) -> None:
        """Return nothing: it has no scene with further keys."""

    def changed(self, values: np.ndarray, override: str) -> None:
        """Return nothing: there are no other laws."""

    def allow(self, more: int) -> None:
        self.most += more


def varied(key: str, start: float, low: float = -np.inf, high: float = np.inf) -> Varied:
    return Varied(key, start, low, high, "m", key)


def test_the_covariance_of_scores_is_that_of_the_autocovariance() -> None:
    """Covariance for two channels with AR(1) noise and correlated innovations, for which (F2)'s matrix G is known."""
    phi, own, length = np.array([0.9, -0.4]), np.array([[1.0, 0.6], [0.6, 2.0]]), 60
    slopes = np.random.default_rng(1).standard_normal((2, length, 3))
    expected = np.zeros((3, 3))
    for c in range(2):
        for d in range(2):  # E e_c(t) e_d(t - k) = s_cd phi_c^k / (1 - phi_c phi_d) for k >= 0
            k = np.arange(length)
            ahead, behind = (own[c, d] * phi[j] ** k / (1.0 - phi[c] * phi[d]) for j in (c, d))
            expected += slopes[c].T @ toeplitz(ahead, behind) @ slopes[d]
    long = np.concatenate([slopes, np.zeros((2, 4000, 3))], axis=1)  # no wrap-around of the memory of the noise
    spectra, size = spectra_of(long)
    np.testing.assert_allclose(Noise(phi[:, None], own).score_covariance(spectra, size), expected, rtol=1e-9, atol=1e-9)


def test_burg_finds_an_autoregressive_model_and_draws_from_it() -> None:
    random = np.random.default_rng(2)
    series = lfilter([1.0], [1.0, -1.2, 0.5], random.standard_normal((1, 20_000)), axis=1)
    found = noise_of(series, 2)
    np.testing.assert_allclose(found.coefficients, [[1.2, -0.5]], atol=0.02)
    np.testing.assert_allclose(found.covariance, [[1.0]], atol=0.03)
    assert noise_of(series).order >= 2
    again = noise_of(found.draw(20_000, random), 2)
    np.testing.assert_allclose(again.coefficients, found.coefficients, atol=0.03)
    np.testing.assert_allclose(autocorrelation(autoregressive(random, 20_000), 3), PHI ** np.arange(4), atol=0.03)
    assert noise_of(np.zeros((1, 50))).order == 0
    assert not autocorrelation(np.ones(20), 3).any()


@pytest.mark.slow
@pytest.mark.parametrize("phi", [0.0, PHI])
def test_intervals_hold_in_95_of_100_linear_fits(phi: float) -> None:
    """With white and autocorrelated noise, in two channels of which one lacks values; widths fit the scatter."""
    random, repeats = np.random.default_rng(3), 100
    slopes = np.stack([np.stack([TIME, np.sin(np.pi * TIME), np.ones_like(TIME)], -1), np.stack([TIME**2] * 3, -1)])
    slopes[1, :, 1:] *= [0.3, 0.0]
    missing = np.zeros((2, len(TIME)), dtype=bool)
    missing[1, 100:] = True
    used = np.where(missing[..., None], 0.0, slopes)
    inverse = np.linalg.inv(np.einsum("ctp,ctq->pq", used, used))
    off, half = [], []
    for _ in range(repeats):
        noise = autoregressive(random, 2, len(TIME), phi=phi)
        off.append(inverse @ np.einsum("ctp,ct->p", used, noise))
        left = np.where(missing, np.nan, noise - slopes @ off[-1])
        half.append(uncertainty_of(left, slopes, np.ones(2), inverse, draws=24).half_width)
    held = (np.abs(off) <= half).sum(axis=0)
    assert np.all((held >= 89) & (held <= 99)), held
    ratio = np.mean(half, axis=0) / 1.96 / np.std(off, axis=0)
    assert np.all((ratio > 0.8) & (ratio < 1.25)), ratio


@pytest.mark.slow
def test_intervals_of_many_channels_hold() -> None:
    """More than are modelled one by one, which two keys move in few patterns; neighbours share part of their noise."""
    random, repeats, many = np.random.default_rng(8), 60, MOST_CHANNELS + 2
    at = np.linspace(0.0, 1.0, many)[:, None]
    slopes = np.stack([np.sin(np.pi * (TIME - at)), (1.0 - at) * TIME], axis=-1)
    inverse = np.linalg.inv(np.einsum("ctp,ctq->pq", slopes, slopes))
    off, half = [], []
    for _ in range(repeats):
        noise = autoregressive(random, many, len(TIME))
        noise[1:] = 0.6 * noise[1:] + 0.8 * noise[:-1]
        off.append(inverse @ np.einsum("ctp,ct->p", slopes, noise))
        half.append(uncertainty_of(noise - slopes @ off[-1], slopes, np.ones(many), inverse, draws=20).half_width)
    held = (np.abs(off) <= half).mean(axis=0)
    assert np.all(held >= 0.85), f"{held}: 0.95 and three and a half standard errors of as many repeats"
    ratio = np.mean(half, axis=0) / 1.96 / np.std(off, axis=0)
    assert np.all((ratio > 0.8) & (ratio < 1.25)), ratio


@pytest.mark.parametrize("length", [51, 160, 600])
@pytest.mark.parametrize("phi", [0.0, PHI])
def test_noise_of_a_right_model_is_no_lack_of_fit(phi: float, length: int) -> None:
    """A right model is said to lack fit in at most 2 % of 500 series and in one of 500 sets of four series."""
    series = autoregressive(np.random.default_rng(10), 500, 4, length, phi=phi)
    assert sum(lack_of(each[:1]).found for each in series) <= 10
    lacks = [lack_of(each) for each in series]
    assert sum(lack.found for lack in lacks) <= 1
    assert 0.5 < np.median([lack.ratio for lack in lacks]) < 3.0


@pytest.mark.parametrize(("phi", "size"), [(0.0, 2.0), (PHI, 5.0)])
@pytest.mark.parametrize("cycles", [0.7, 12.0], ids=["drift", "strides"])
def test_what_goes_with_the_motion_is_a_lack_of_fit(cycles: float, phi: float, size: float) -> None:
    """Under noise of variance 1, in one channel with missing values."""
    random, time = np.random.default_rng(11), np.linspace(0.0, 1.0, 600)
    error = size * np.sin(2.0 * np.pi * cycles * time)
    series = error + autoregressive(random, 100, 600, phi=phi)
    series[:, 100:130] = np.nan
    assert sum(lack_of(each[None]).found for each in series) >= 95


def test_nothing_is_said_of_few_samples_or_no_residuals() -> None:
    assert lack_of(np.full((2, 500), np.nan)).ratio == 0.0
    assert lack_of(np.zeros((2, 500))).ratio == 0.0
    assert not lack_of(np.arange(20.0)[None]).found


def test_what_alternates_is_the_opposite_of_slow_and_what_is_slow_has_no_longer_memory_than_noise() -> None:
    """Neighbours in noise have a correlation of 0 to 0.9; a sine is compared with noise of the longest memory."""
    alternating = (-1.0) ** np.arange(400) + 0.1 * np.random.default_rng(14).standard_normal(400)
    assert ratio_of(alternating[None]) < 0.1
    slow = np.sin(np.linspace(0.0, 2.0 * np.pi, 400))
    steps = np.diff(slow)
    noise = 0.5 * 1.9 * float(steps @ steps) / len(steps) / (1.0 - 0.9**2)
    k = np.arange(400)
    spectrum = (1.0 - 0.9**2) / (1.0 - 1.8 * np.cos(np.pi * k / 400) + 0.9**2)
    power = dct(slow, norm="ortho") ** 2 / (noise * spectrum)
    assert ratio_of(slow[None]) == pytest.approx(power[:6].mean(), rel=1e-6)


def test_white_noise_gives_the_textbook_covariance() -> None:
    random = np.random.default_rng(4)
    slopes = random.standard_normal((1, 4000, 2))
    inverse = np.linalg.inv(slopes[0].T @ slopes[0])
    found = uncertainty_of(0.3 * random.standard_normal((1, 4000)), slopes, np.ones(1), inverse, draws=20)
    np.testing.assert_allclose(found.covariance, 0.09 * inverse, rtol=0.08, atol=2e-7)
    plain = uncertainty_of(0.3 * random.standard_normal((1, 4000)), slopes, np.ones(1), inverse, draws=0)
    half = 1.959964 * np.sqrt(np.diag(plain.covariance))  # of 95 % of normal errors
    np.testing.assert_allclose(plain.half_width, half, rtol=1e-6)


def test_slopes_use_the_side_where_the_run_comes_to_its_end() -> None:
    def function(u: np.ndarray) -> np.ndarray | None:
        return None if u[0] > 1.0 or u[1] > 2.02 else np.array([[3.0 * u[0] + u[1] ** 2]])

    at, steps, wide = np.array([1.0, 2.0]), np.array([0.1, 0.1]), np.full(2, np.inf)
    found = slopes_at(function, at, np.array([[7.0]]), steps, -wide, wide)
    np.testing.assert_allclose(found.values, [[[3.0, 3.9]]])
    np.testing.assert_allclose(found.roughness, 0.0)
    bounded = slopes_at(lambda u: np.array([[u[1] ** 2]]), at, np.array([[4.0]]), steps, -wide, np.array([1.0, 2.0]))
    np.testing.assert_allclose(bounded.values, [[[0.0, 3.9]]])
    both = slopes_at(lambda u: np.array([[u[1] ** 2]]), at, np.array([[4.0]]), steps, -wide, wide)
    np.testing.assert_allclose(both.values, [[[0.0, 4.0]]], atol=1e-12)
    np.testing.assert_allclose(both.roughness, [[[0.0, 0.1]]], atol=1e-12)
    with pytest.raises(SceneError, match="the runs fail to both sides of a key"):
        slopes_at(lambda u: None, at, np.array([[7.0]]), steps, -wide, wide)


def test_keys_that_cancel_each_other_are_named() -> None:
    keys = [varied("a", 2.0), varied("b", 4.0), varied("c", 1.0)]
    slopes = np.column_stack([np.sin(TIME), 2.0 * np.sin(TIME), np.cos(3.0 * TIME)])
    found = determined(keys, slopes, np.zeros_like(slopes), lambda direction: slopes @ direction)
    assert found.known.tolist() == [False, False, True]
    (relation,) = found.relations
    assert relation.keys == ("a", "b")
    np.testing.assert_allclose(relation.changes[0] / relation.changes[1], -1.0)  # a moves 2 u, b 4 u / 2
    assert relation.effect_over_residual_rms < 1e-12
    assert "cannot tell apart a, b: to change a by" in relation.sentence
    without = determined(keys, slopes * [1.0, 0.0, 1.0], np.zeros_like(slopes), lambda direction: 0.0 * TIME)
    assert without.known.tolist() == [True, False, True]
    assert without.relations[0].sentence.startswith("the data say little about b: to change b by")
    rough = 0.05 * np.abs(slopes)
    near = slopes + 0.02 * np.column_stack([TIME, 0.0 * TIME, 0.0 * TIME])
    assert determined(keys, near, rough, lambda direction: near @ direction).known.all()
    assert not determined(keys, near, rough, lambda direction: 0.0 * TIME).known.all()


def test_shifts_of_unknown_sign_are_further_errors() -> None:
    known = Uncertainty(np.diag([4.0, 1.0]), np.array([4.0, 2.0]))
    widened = known.widened(np.array([[0.0, 1.5], [0.0, 0.0]]))
    np.testing.assert_allclose(widened.covariance, [[6.25, 0.0], [0.0, 1.0]])
    np.testing.assert_allclose(widened.half_width, [5.0, 2.0])
    both = known.widened(np.array([[2.0], [-1.0]]))
    np.testing.assert_allclose(both.covariance, [[8.0, -2.0], [-2.0, 2.0]])


def test_what_the_data_determine_has_the_inverse_of_the_normal_equations() -> None:
    slopes = np.random.default_rng(4).standard_normal((50, 3)) * [1.0, 20.0, 0.3]
    found = determined([varied(key, 1.0) for key in "abc"], slopes, np.zeros_like(slopes), lambda direction: direction)
    np.testing.assert_allclose(found.inverse, np.linalg.inv(slopes.T @ slopes), rtol=1e-9)
    assert found.known.all()
    assert found.relations == ()


def test_a_direction_with_a_large_error_is_said_in_units_of_its_keys() -> None:
    """In scales of a (2 m) and b (3 m) the first may rise as the second falls; c is well known."""
    keys = [varied("a", 2.0), varied("b", 3.0), varied("c", 1.0)]
    direction, slopes = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0), np.eye(3)
    covariance = 4.0 * VAGUE**2 * np.outer(direction, direction) + 1e-6 * np.eye(3)
    (found,) = vague(keys, covariance, slopes)
    assert found.keys == ("a", "b")
    np.testing.assert_allclose(found.changes[1] / found.changes[0], -3.0 / 2.0)
    np.testing.assert_allclose(found.effect_over_residual_rms, abs(found.changes[0] / 2.0) * np.sqrt(2.0 / 3.0))
    assert list(vague(keys, covariance / 5.0, slopes)) == []


class OneMore(Analytic):
    """Trials of a function whose last argument is a fixed key of the scene."""

    fixed = 1.0

    def __call__(self, values: np.ndarray) -> np.ndarray:
        found: np.ndarray = self._function(*values, self.fixed)
        return found

    def number(self, key: str) -> float | None:
        return self.fixed if key == "worm.mass_kg" else None

    def changed(self, values: np.ndarray, override: str) -> np.ndarray | None:
        key, _, value = override.partition("=")
        return self._function(*values, float(value)) if key == "worm.mass_kg" else None


@pytest.mark.parametrize("channels", [1, MOST_CHANNELS + 2])
@pytest.mark.parametrize("truth", [1.4, 0.7])
def test_a_suspect_says_which_way_it_is_wrong_and_what_that_did_to_the_varied_key(truth: float, channels: int) -> None:
    """y = a f + c (f + g): a fit of a takes the part of a wrong c along f, and would give it back."""
    at = np.linspace(0.0, 1.0, channels)[:, None]
    f, g = np.sin(np.pi * (TIME - at)), (1.0 + at) * np.cos(np.pi * (TIME - at))
    noise = 1e-3 * np.random.default_rng(5).standard_normal((channels, len(TIME)))

    def y(a: float, c: float) -> np.ndarray:
        return a * f + c * (f + g)

    measured = y(2.0, truth) + noise
    a = float(np.sum(f * (measured - y(0.0, 1.0))) / np.sum(f**2))
    trials = OneMore(y, measured, varied("a", 1.0))
    residuals = measured - trials(np.array([a]))
    found = suspects_of(trials, np.array([a]), residuals, f[..., None], np.ones(channels))
    assert found.found
    suspect = found.named[0]
    assert suspect.what == "worm.mass_kg"
    assert suspect.larger == (truth > 1.0)
    assert suspect.share > 0.99
    np.testing.assert_allclose(a + suspect.shift, 2.0, atol=0.01)


def test_of_several_suspects_the_best_are_named_and_noise_is_what_the_best_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a scene with three wrong keys the one with less than half of the share is not named."""
    effects = {
        key: np.sin(cycles * np.pi * TIME)[None]
        for key, cycles in (("worm.mass_kg", 2.0), ("friction.forward", 3.0), ("friction.backward", 5.0))
    }
    sizes, noise = (1.6, 0.5, 2.0), 0.3 * np.random.default_rng(12).standard_normal((1, len(TIME)))

    class Several(Analytic):
        def number(self, key: str) -> float | None:
            return 1.0 if key in effects else None

        def changed(self, values: np.ndarray, override: str) -> np.ndarray | None:
            key, _, value = override.partition("=")
            return values[0] * TIME[None] + (float(value) - 1.0) * effects[key] if key in effects else None

    modelled: list[np.ndarray] = []
    monkeypatch.setattr(
        "scenes.studies.fit.suspects.noise_of", lambda series: modelled.append(series) or noise_of(series)
    )
    wrong = sum(size * effect for size, effect in zip(sizes, effects.values(), strict=True))
    trials = Several(lambda a: a * TIME[None], TIME[None] + wrong + noise, varied("a", 1.0))
    residuals = wrong + noise
    found = suspects_of(trials, np.ones(1), residuals, TIME[None, :, None], np.ones(1))
    assert [each.what for each in found.named] == ["friction.backward", "worm.mass_kg"]
    assert found.named[0].share > found.named[1].share
    (left,) = modelled
    best = effects["friction.backward"][0]
    assert abs(left[0] @ best) < 0.02 * abs(residuals[0] @ best)
    for key in ("worm.mass_kg", "friction.forward"):
        assert abs(left[0] @ effects[key][0]) > 0.8 * abs(residuals[0] @ effects[key][0])


@pytest.mark.parametrize(
    ("key", "value", "tried"),
    [
        ("worm.mass_kg", 2.0, [3.0, 2.0 / 1.5]),
        ("worm.mass_kg", 0.0, []),
        ("worm.mass_kg", np.inf, []),
        ("worm.drag_N_s_m", 0.0, [0.1]),
        ("worm.drag_N_s_m", 2.0, [3.0, 2.0 / 1.5]),
    ],
)
def test_a_number_is_tried_above_and_below_and_one_that_factors_do_not_change_is_not_run(
    key: str, value: float, tried: list[float]
) -> None:
    """Of the numbers that are 0 only those of `ZEROS`, such as drag, are tried: by a number of their own."""
    runs: list[str] = []

    class OneNumber(Analytic):
        def number(self, name: str) -> float | None:
            return value if name == key else None

        def changed(self, values: np.ndarray, override: str) -> None:
            runs.append(override)

    trials = OneNumber(lambda a: a * TIME[None], TIME[None], varied("a", 1.0))
    suspects_of(trials, np.ones(1), np.zeros((1, len(TIME))), TIME[None, :, None], np.ones(1))
    numbers = [float(run.removeprefix(f"{key}=")) for run in runs if run.startswith(f"{key}=")]
    np.testing.assert_allclose(numbers, tried)


def test_channels_of_one_unit_are_weighed_by_the_one_that_moves_most() -> None:
    x = np.array([1.0, -1.0, 1.0, -1.0])
    still = np.array([0.5, 0.5, np.nan, 0.5])
    data = Data(("x_m", "y_m", "z_rad"), ("m", "m", "rad"), np.arange(4.0), np.stack([0.1 * x, 3.0 * x, still]))
    np.testing.assert_allclose(data.spread, [3.0, 3.0, 1.0])


def test_a_dip_behind_a_crest_is_found() -> None:
    def squares(u: np.ndarray) -> float:
        return float(u[0] ** 2 + u[1] ** 2 - 2.0 * np.exp(-(((u[0] - 0.1) / 0.03) ** 2)))

    found = dips(squares, np.zeros(2), np.eye(2))
    assert len(found) == 1
    np.testing.assert_allclose(found[0], [0.1, 0.0])


def test_a_fit_takes_a_run_that_fails_for_a_step_that_was_too_long() -> None:
    """The first step from 0.2 would go far beyond 2, where runs fail."""

    def function(a: float, b: float) -> np.ndarray | None:
        return None if a > 2.0 or a <= 0.0 else np.array([b * np.log(a) * TIME + b])

    trials = Analytic(function, function(1.9, 0.7), varied("a", 0.2, 0.0, 50.0), varied("b", 1.0))
    found = solve(trials)
    np.testing.assert_allclose(found.values, [1.9, 0.7], rtol=1e-5)
    assert found.finished
    assert found.known.all()
    assert np.all(found.uncertainty.standard_error < 1e-4)


def test_a_value_at_its_bound_has_no_interval() -> None:
    noise = 0.01 * np.random.default_rng(5).standard_normal(len(TIME))
    model = lambda a, b: np.array([a * TIME + b * TIME**2])  # noqa: E731
    found = solve(Analytic(model, model(2.0, 0.5) + noise, varied("a", 1.0, 0.0, 1.5), varied("b", 1.0)))
    assert found.at_bound == ("highest", "")
    assert found.known.tolist() == [False, True]
    assert found.values[0] == pytest.approx(1.5, abs=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_fit_ends_at_the_bottom_of_its_valley_however_wide_the_interval_is(seed: int) -> None:
    """From 1 on a contact slides in addition: chords across that, as wide as the interval, lead past the bottom."""
    model = lambda a: np.array([a * TIME + 3.0 * max(a - 1.0, 0.0) * np.sin(5.0 * TIME)])  # noqa: E731
    measured = model(1.0) + 0.3 * np.random.default_rng(seed).standard_normal(len(TIME))
    found = solve(Analytic(model, measured, varied("a", 1.02)))
    (a,), (error,) = found.values, found.uncertainty.standard_error
    bounds = a - 0.5 * error, a + 0.5 * error
    bottom = minimize_scalar(lambda a: np.sum((model(a) - measured) ** 2), bounds=bounds, options={"xatol": 1e-8}).x
    assert abs(a - bottom) < 0.05 * error


def test_a_fit_without_runs_left_ends_with_the_best_values() -> None:
    model = lambda a, b: np.array([np.exp(-a * TIME) * np.cos(b * TIME)])  # noqa: E731
    found = solve(Analytic(model, model(0.5, 4.0), varied("a", 1.0), varied("b", 3.5), most=12))
    assert not found.finished
    assert np.all(np.isfinite(found.values))
    assert np.abs(found.simulated - model(*found.values)).max() < 1e-12


def test_a_product_of_keys_is_one_key() -> None:
    noise = 0.01 * np.random.default_rng(6).standard_normal(len(TIME))
    model = lambda a, b, c: np.array([a * b * TIME + c])  # noqa: E731
    keys = (varied("a", 1.0), varied("b", 3.0), varied("c", 1.0))
    found = solve(Analytic(model, model(2.0, 2.0, 1.0) + noise, *keys))
    assert found.known.tolist() == [False, False, True]
    assert found.relations[0].keys == ("a", "b")
    assert found.values[0] * found.values[1] == pytest.approx(4.0, rel=0.01)


def test_a_valley_close_by_is_found_across_a_crest() -> None:
    """A step of the model at a = 1.006, hidden by the slopes of two keys that nearly cancel each other."""
    model = lambda a, b: np.array([a * TIME + b * np.sin(TIME) + 0.05 * (a > 1.006) * np.sin(9.0 * TIME)])  # noqa: E731
    noise = 0.01 * np.random.default_rng(9).standard_normal(len(TIME))
    trials = Analytic(model, model(1.0, 1.0) + noise, varied("a", 1.012), varied("b", 0.95))
    found = solve(trials)
    np.testing.assert_allclose(found.values, 1.0, atol=0.02)
    assert np.std(found.simulated - trials.data.values) < 0.0102


def test_a_valley_beside_the_right_one_is_left() -> None:
    """A step of the model, as of a contact that sticks later, makes a minimum of its own at 0.9."""
    model = lambda a: np.array([a * TIME + 0.12 * np.tanh((a - 0.94) / 0.004) * TIME])  # noqa: E731
    noise = 0.01 * np.random.default_rng(7).standard_normal(len(TIME))
    found = solve(Analytic(model, model(1.0) + noise, varied("a", 0.8)))
    assert found.values[0] == pytest.approx(1.0, abs=0.01)


def test_a_valley_whose_residuals_are_no_noise_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """All values but those near 1 look best at 0.9915; 1 lies between the distances that `dips` looks at."""

    def model(a: float) -> np.ndarray:
        if abs(a - 1.0) < 0.002:
            return np.array([a * TIME])
        return np.array([(a + 0.0085) * TIME + 0.03 * np.sin(9.0 * TIME)])

    tried: list[float] = []

    def noted(a: float) -> np.ndarray:
        tried.append(a)
        return model(a)

    noise = 0.01 * np.random.default_rng(9).standard_normal(len(TIME))
    key = varied("a", 0.95)
    trials = Analytic(noted, model(1.0) + noise, key)
    assert solve(trials).values[0] == pytest.approx(1.0, abs=0.001)
    monkeypatch.setattr("scenes.studies.fit.solving.SUSPECT", np.inf)
    assert solve(trials).values[0] == pytest.approx(0.9915, abs=0.001)
    assert key.low <= min(tried)
    assert max(tried) <= key.high


def test_a_key_without_bounds_may_take_any_value() -> None:
    (key,) = varied_of(load_scene("flat", ["start.azimuth_deg=3"]), ["start.azimuth_deg"])
    assert (key.start, key.low, key.high) == (3.0, -np.inf, np.inf)


@pytest.mark.parametrize("search", ["lowest", "beside"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_of_two_valleys_beside_a_minimum_the_lower_one_is_taken(search: str, side: float) -> None:
    """A tenth to one side nothing is left; half as far to the other hardly less than at 1; both lie behind a crest."""

    def model(a: float) -> np.ndarray:
        off = side * (a - 1.0)
        bottom, left = (-0.1, 0.0) if off < -0.03 else (0.0, 0.05) if off < 0.02 else (off, 0.07)
        bottom, left = (0.05, 0.0499) if off > 0.04 else (bottom, left)
        return np.array([(off - bottom + 1.0) * TIME + left * np.sin(9.0 * TIME)])

    noise = 1e-3 * np.random.default_rng(3).standard_normal(len(TIME))
    problem = _Problem(Analytic(model, model(1.0 - 0.1 * side) + noise, varied("a", 1.0)))
    found = getattr(problem, search)(np.ones(1), np.ones(1), np.full(1, 1e-3))
    assert found == pytest.approx(1.0 - 0.1 * side, abs=1e-3)


def test_the_floor_of_a_valley_is_the_sum_of_squares_without_a_space() -> None:
    """Residuals are (a - 1) t and 0.3 sin 9 t: without t only the part of the sine that is no multiple of t is left."""
    sine, line = 0.3 * np.sin(9.0 * TIME), TIME / np.linalg.norm(TIME)
    problem = _Problem(Analytic(lambda a: np.array([a * TIME + sine]), TIME[None], varied("a", 1.0)))
    left = float(sine @ sine - (line @ sine) ** 2)
    for a in (0.8, 1.0, 1.3):
        floor = problem._floor(np.array([a]), np.ones(len(TIME)), line[:, None])
        assert floor == pytest.approx(left, rel=1e-10)


def test_searches_from_further_places_begin_within_the_bounds_and_none_is_left_out() -> None:
    """At a minimum in a corner half of the places of each key lie out of bounds: they are moved to the bound."""
    model = lambda a, b: np.array([a * TIME + b * TIME**2 + np.sin(9.0 * TIME)])  # noqa: E731
    keys = varied("a", 1.0, 0.5, 1.0), varied("b", 2.0, 2.0, 3.0)
    problem = _Problem(Analytic(model, 4.0 * TIME[None], *keys))
    starts: list[np.ndarray] = []
    problem.minimum = lambda start, *rest: starts.append(start) or start
    problem.elsewhere(np.ones(2), np.ones(1), np.full(2, 1e-3))
    begun = np.array(starts[:STARTS])
    assert begun.shape == (STARTS, 2)
    assert np.all((problem.low <= begun) & (begun <= problem.high))
    assert np.all((begun == 1.0).any(axis=0)), "on its bound"
    assert np.all((begun != 1.0).any(axis=0))
    assert np.abs(begun - 1.0).max() < 5.0 * AROUND


@pytest.mark.parametrize("apart", [0.0, 0.01])
def test_keys_whose_rough_slopes_may_cancel_are_told_apart_by_a_tiny_step(apart: float) -> None:
    """The slopes differ by less than their roughness: the step alone tells whether the keys cancel, however sure it is.

    A contact changes where b has gone twice as far as the step may lead. The third key is at its bound, with no part.
    """
    other = np.sin(9.0 * TIME)

    def model(c: float, a: float, b: float) -> np.ndarray:
        event = abs(b - 1.0) > 2.0 * TINY_STEP
        return np.array([c * TIME**2 + a**3 * b * TIME + (apart * (b - 1.0) * np.linalg.norm(TIME) + event) * other])

    keys = varied("c", 1.0, 1.0), varied("a", 1.0), varied("b", 1.0)
    problem = _Problem(Analytic(model, model(1.0, 1.0, 1.0), *keys))
    values = np.column_stack([TIME**2, 3.0 * TIME, TIME + 0.1 * other])[None]
    slopes = Slopes(values, 0.5 * np.abs(values))
    for weight in (1.0, 1e3):
        found = problem._determined(np.ones(3), np.array([weight]), slopes)
        assert found.known.tolist() == [False, apart > 0.0, apart > 0.0]
        assert [each.keys for each in found.relations] == ([] if apart else [("a", "b")])


def test_weights_that_no_longer_change_end_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run may take minutes: that more passes are allowed costs a linear fit of white noise none."""
    noise = 0.01 * np.random.default_rng(6).standard_normal(len(TIME))
    runs = []
    for passes in (4, 40):
        monkeypatch.setattr("scenes.studies.fit.solving.PASSES", passes)
        trials = Analytic(lambda a: a * TIME[None], TIME[None] + noise, varied("a", 1.3))
        assert solve(trials).values[0] == pytest.approx(1.0, abs=0.01)
        runs.append(trials.runs)
    assert runs[0] == runs[1]


def test_slopes_at_the_minimum_are_those_of_a_chord_as_wide_as_the_interval() -> None:
    """Two standard errors to each side: a valley is steeper at its bottom than where a value is nearly as likely."""
    noise, tried = 0.05 * np.random.default_rng(6).standard_normal(len(TIME)), []

    def model(a: float) -> np.ndarray:
        tried.append(a)
        return a * TIME[None]

    found = solve(Analytic(model, TIME[None] + noise, varied("a", 1.3)))
    (a,), (error,) = found.values, found.uncertainty.standard_error
    white = 0.05 / np.linalg.norm(TIME)
    assert error == pytest.approx(white, rel=0.3)
    for side in (2.0, -2.0):
        assert np.isclose(tried, a + side * error, rtol=0.0, atol=0.2 * error).any()
    assert not np.isclose(np.abs(np.array(tried) - a), error, rtol=0.0, atol=0.2 * error).any()


def test_where_no_runs_are_left_the_slopes_at_the_best_values_are_found_however_many_runs_fail() -> None:
    """Around the best values all runs fail but those of the last halving of a step, which the reserve allows for."""

    class Fragile(Analytic):
        centre: np.ndarray | None = None
        ended = False

        def allow(self, more: int) -> None:
            super().allow(more)
            self.ended = True

        def __call__(self, values: np.ndarray) -> np.ndarray | None:
            if not self.ended:
                return super().__call__(values)
            if self.centre is None:
                self.centre = values.copy()
            if np.array_equal(values, self.centre):  # that run is kept
                return self._function(*values)
            found = super().__call__(values)
            return (
                found if np.abs(values - self.centre).max() < 1.01 * FIRST_STEP * 0.5**MAX_DERIVATIVE_HALVINGS else None
            )

    noise = 0.01 * np.random.default_rng(6).standard_normal(len(TIME))
    model = lambda a, b: np.array([a * TIME + b * np.sin(3.0 * TIME)])  # noqa: E731
    found = solve(Fragile(model, model(1.0, 1.2) + noise, varied("a", 1.0), varied("b", 1.0), most=4))
    assert not found.finished
    assert found.known.all()


def test_a_scale_is_the_start_or_else_the_range() -> None:
    cases = [(2.0, -1.0, 3.0), (-2.0, -3.0, 3.0), (0.0, -1.0, 3.0), (0.0, -1.0, np.inf), (0.0, -np.inf, np.inf)]
    assert [varied("a", *each).scale for each in cases] == [2.0, 2.0, 4.0, 1.0, 1.0]


def test_errors_that_are_larger_by_a_factor_are_so_in_both_measures() -> None:
    scaled = Uncertainty(np.array([[4.0, 1.0], [1.0, 9.0]]), np.array([4.0, 7.0])).scaled(3.0)
    np.testing.assert_allclose(scaled.covariance, [[36.0, 9.0], [9.0, 81.0]])
    np.testing.assert_allclose(scaled.half_width, [12.0, 21.0])
    np.testing.assert_allclose(scaled.standard_error, [6.0, 9.0])


def test_the_end_of_a_drawn_series_knows_nothing_of_its_begin() -> None:
    """The slowest memory of all channels counts: series are drawn round a circle on which all is forgotten."""
    coefficients = np.array([[0.95, -0.045], [0.1, 0.0]])  # roots 0.9 and 0.05
    noise, random = Noise(coefficients, np.eye(2)), np.random.default_rng(13)
    drawn = np.array([noise.draw(60, random) for _ in range(600)])
    for channel in (0, 1):
        assert abs(np.corrcoef(drawn[:, channel, 0], drawn[:, channel, -1])[0, 1]) < 0.15
    assert drawn.shape == (600, 2, 60)
    assert np.corrcoef(drawn[:, 0, 0], drawn[:, 0, 1])[0, 1] > 0.8
