"""The filter: derivatives, its formulas in NumPy, and what it believes of several beliefs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.estimate import Belief, consistency, merged, pruned, weights, wrapped
from control.estimation.kalman import GAINS, IMPOSSIBLE, MAX_REFUSED_SAMPLES, ROCKING, SIZE, Kalman, Uncertainty
from control.estimation.reduced import LONGEST_SUBSTEP, STATES, ReducedModel
from control.identification.identified import load
from worm3d import Worm

WORM = Worm()
TRUST = Uncertainty(crab=0.01)
GIVEN = np.array([0.27, 0.9, 0.05])
SLOPE = np.array([0.04, -0.02])
MEAN = np.array([0.3, -0.2, 0.7, 0.06, 0.1, 0.1, 0.02, 0.005, 0.04, 1.1, 0.06, 0.02, -0.01, 0.005, 0.01])
WAVE = np.array([0.1, -0.07])


def reduced_model() -> ReducedModel:
    found = load(WORM)
    assert found is not None
    return ReducedModel.of(WORM, found)


MODEL = reduced_model()
FILTER = Kalman(MODEL, TRUST)


def spread(seed: int = 0) -> np.ndarray:
    """Return a covariance of states that are uncertain by about a hundredth."""
    root = 0.01 * np.random.default_rng(seed).standard_normal((SIZE, SIZE))
    return root @ root.T + 1e-6 * np.eye(SIZE)


def differences(of, at: np.ndarray, h: float = 1e-6) -> np.ndarray:
    columns = [(of(at + h * side) - of(at - h * side)) / (2.0 * h) for side in np.eye(len(at))]
    return np.array(columns).T


def noise(seconds: float) -> np.ndarray:
    t, ahead = TRUST, np.array([np.cos(MEAN[2]), np.sin(MEAN[2])])
    behind = MODEL.lag * float(MODEL.in_force(MEAN[:STATES], GIVEN)[3])
    heading = t.heading**2 + (t.turning * MEAN[4]) ** 2
    drift = 2.0 * t.drift**2 / t.drift_time
    rates = [t.place**2, t.place**2, heading, t.speed**2, t.turn_rate**2, t.slip**2, t.yaw_bias**2, drift]
    density = np.diag([*rates, 0.0, t.turn_gain**2, t.crab**2, *[t.rocking**2] * 4])
    density[:2, :2] += (t.changing * behind) ** 2 * np.outer(ahead, ahead)
    return density * seconds


def test_the_prediction_is_that_of_the_reduced_model_with_a_drift_that_yields_to_the_slope() -> None:
    after = FILTER.predicted(Belief(MEAN, spread()), GIVEN, SLOPE, 0.05).mean
    expected = np.array(MODEL.advance(MEAN[:STATES], GIVEN, 0.05, MODEL.in_force)).ravel()
    others = np.delete(np.arange(STATES), 7)
    assert_allclose(after[others], expected[others], atol=1e-15)
    left = np.array([-np.sin(0.7), np.cos(0.7)])
    target = -TRUST.slope_yield * 0.06 * (SLOPE @ left)
    assert after[7] == pytest.approx(target + (0.005 - target) * np.exp(-0.05 / TRUST.drift_time))
    assert_allclose(after[ROCKING], MEAN[ROCKING], atol=0.0)


def test_a_worm_heading_across_a_slope_drifts_downhill() -> None:
    """The left is uphill: it drifts to the right."""
    rising_left = np.array([0.0, 0.05])
    mean = np.zeros(SIZE)
    mean[3] = 0.08
    after = FILTER.predicted(Belief(mean, spread()), np.array([0.3, 0.9, 0.0]), rising_left, 3.0).mean
    assert after[7] < -0.01
    assert after[1] < 0.0


def test_the_predicted_covariance_against_central_differences() -> None:
    before = spread(1)
    after = FILTER.predicted(Belief(MEAN, before), GIVEN, SLOPE, 0.05).covariance

    def step(mean: np.ndarray) -> np.ndarray:
        return FILTER.predicted(Belief(mean, before), GIVEN, SLOPE, 0.05).mean

    F = differences(step, MEAN)
    assert_allclose(after, F @ before @ F.T + noise(0.05), atol=1e-12)


def test_what_is_not_known_of_a_wave_is_the_same_in_slow_waves() -> None:
    """A wave at a quarter of the frequency takes four times as long and adds the same variances; of rates, 1/16."""
    sure, frequency = np.zeros((SIZE, SIZE)), TRUST.frequency
    still = np.where(np.arange(SIZE) == 4, 0.0, MEAN)  # no turn, whose noise goes with its rate

    def added(share: float) -> np.ndarray:
        short = 1e-4 / share
        given = np.array([0.27, share * frequency, 0.05])
        return np.diag(FILTER.predicted(Belief(still, sure), given, SLOPE, short).covariance) / 1e-4

    fast, slow, faster = added(1.0), added(0.25), added(1.5)
    alike = [2, 5, 9, 10, *range(STATES, SIZE)]
    assert_allclose(slow[alike], fast[alike], rtol=1e-9)
    assert_allclose(slow[[3, 4, 6]], fast[[3, 4, 6]] / 16.0, rtol=1e-9)
    assert slow[7] == pytest.approx(fast[7] / 4.0)
    assert_allclose(faster[2:] * 1.5, fast[2:], rtol=1e-9)


def in_parts(parts: int) -> Belief:
    belief = Belief(MEAN, spread())
    for _ in range(parts):
        belief = FILTER.predicted(belief, GIVEN, SLOPE, 1.0 / parts)
    return belief


def test_a_long_prediction_is_divided() -> None:
    """Into steps that Runge and Kutta may take."""
    once, parts = in_parts(1), in_parts(int(np.ceil(1.0 / min(MODEL.longest_step, LONGEST_SUBSTEP * MODEL.lag))))
    assert_allclose(once.mean, parts.mean, atol=1e-15)
    assert_allclose(once.covariance, parts.covariance, atol=1e-15)


def test_predictions_converge_with_shorter_steps() -> None:
    """In first order: noise and the way to the drift of the slope are those of the beginning of a step."""
    truth = in_parts(640)
    for name in ("mean", "covariance"):
        errors = [np.abs(getattr(in_parts(parts), name) - getattr(truth, name)).max() for parts in (20, 40)]
        assert 1.8 < errors[0] / errors[1] < 2.3
        assert errors[0] < 1e-4


def expected_com(mean: np.ndarray) -> np.ndarray:
    along, left = mean[ROCKING].reshape(2, 2).T @ WAVE
    c, s = np.cos(mean[2]), np.sin(mean[2])
    return mean[:2] + np.array([c * along - s * left, s * along + c * left])


def textbook(P: np.ndarray, H: np.ndarray, e: np.ndarray, deviation: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return state and covariance after a sample, the latter by another formula than (KF4), and nis."""
    information = np.linalg.inv(P) + H.T @ H / deviation**2
    after = np.linalg.inv(information)
    S = H @ P @ H.T + deviation**2 * np.eye(len(e))
    return MEAN + after @ H.T @ e / deviation**2, after, float(e @ np.linalg.solve(S, e))


def test_a_sample_of_the_centre_of_mass_corrects_as_the_information_filter_does() -> None:
    P, sample = spread(2), expected_com(MEAN) + np.array([0.004, -0.007])
    corrected = FILTER.with_com(Belief(MEAN, P), sample, WAVE, gated=True)
    mean, covariance, nis = textbook(P, differences(expected_com, MEAN), np.array([0.004, -0.007]), TRUST.com)
    assert_allclose(corrected.belief.mean, mean, atol=1e-9)
    assert_allclose(corrected.belief.covariance, covariance, atol=1e-9)
    assert corrected.nis == pytest.approx(nis)


def test_a_heading_corrects_by_the_shorter_way() -> None:
    P = spread(3)
    H = np.eye(SIZE)[2:3]
    for turns in (-1, 0, 3):
        belief, *_ = FILTER.with_heading(Belief(MEAN, P), 0.75 + turns * 2.0 * np.pi)
        mean, covariance, _ = textbook(P, H, np.array([0.05]), TRUST.heading_sample)
        assert_allclose(belief.mean, mean, atol=1e-9)
        assert_allclose(belief.covariance, covariance, atol=1e-9)


def test_likelier_samples_make_likelier_beliefs() -> None:
    """The weights are those of the normal density of the innovation."""
    P = spread(4)
    H = differences(expected_com, MEAN)
    S = H @ P @ H.T + TRUST.com**2 * np.eye(2)
    logs = []
    for off in (np.zeros(2), np.array([0.01, 0.0])):
        corrected = FILTER.with_com(Belief(MEAN, P), expected_com(MEAN) + off, WAVE, gated=False)
        logs.append(corrected.belief.log_weight)
        assert logs[-1] == pytest.approx(-0.5 * off @ np.linalg.solve(S, off) - 0.5 * np.log(np.linalg.det(S)))
    assert logs[0] > logs[1]


def test_a_few_impossible_samples_are_refused_and_many_believed() -> None:
    belief, far = Belief(MEAN, 1e-2 * spread()), expected_com(MEAN) + np.array([0.3, 0.0])
    for count in range(MAX_REFUSED_SAMPLES):
        corrected = FILTER.with_com(belief, far, WAVE, gated=True)
        assert corrected.nis > IMPOSSIBLE
        assert corrected.belief.refused == count + 1
        assert_allclose(corrected.belief.mean, MEAN, atol=0.0)
        belief = corrected.belief
    moved = FILTER.with_com(belief, far, WAVE, gated=True).belief
    assert moved.refused == 0
    assert_allclose(expected_com(moved.mean), far, atol=0.01)
    assert np.sqrt(moved.covariance[2, 2]) > 0.3, "after a push the heading is open again"


def test_one_impossible_sample_between_good_ones_is_forgotten() -> None:
    good, far = expected_com(MEAN), expected_com(MEAN) + np.array([0.3, 0.0])
    once = FILTER.with_com(Belief(MEAN, 1e-2 * spread()), far, WAVE, gated=True).belief
    assert FILTER.with_com(once, good, WAVE, gated=True).belief.refused == 0


def test_the_whole_of_several_beliefs_has_their_moments() -> None:
    random = np.random.default_rng(8)
    beliefs = [Belief(MEAN + 0.1 * random.standard_normal(SIZE), spread(k), np.log(w)) for k, w in enumerate((1, 2, 5))]
    shares = np.array([1, 2, 5]) / 8.0
    assert_allclose(weights(beliefs), shares)
    whole = merged(beliefs)
    means = np.array([belief.mean for belief in beliefs])
    rest = [k for k in range(SIZE) if k != 2]
    assert_allclose(whole.mean[rest], (shares @ means)[rest], atol=1e-14)
    second = sum(w * (b.covariance + np.outer(b.mean, b.mean)) for w, b in zip(shares, beliefs, strict=True))
    assert_allclose(whole.covariance, second - np.outer(shares @ means, shares @ means), atol=1e-4)


def test_headings_are_averaged_on_the_circle() -> None:
    def believed(heading: float, log_weight: float = 0.0) -> Belief:
        mean = MEAN.copy()
        mean[2] = heading
        return Belief(mean, spread(), log_weight)

    across = merged([believed(np.pi - 0.1), believed(-np.pi + 0.1)])
    assert abs(wrapped(across.mean[2:3] - np.pi)[0]) == pytest.approx(0.0, abs=1e-12)
    assert across.covariance[2, 2] == pytest.approx(0.1**2 + spread()[2, 2])
    around = merged([believed(side) for side in (np.arange(12) - 5.5) * np.pi / 6.0])
    assert around.mean[2] == pytest.approx(0.0, abs=1e-12)
    assert np.sqrt(around.covariance[2, 2]) == pytest.approx(np.pi / np.sqrt(3.0), rel=0.01)


def test_hopeless_beliefs_are_given_up_and_equal_ones_put_together() -> None:
    turned = MEAN + np.eye(SIZE)[2]
    left = pruned([Belief(MEAN, spread(), -3.0), Belief(turned, spread(), -4.0), Belief(turned, spread(), -20.0)])
    assert [belief.log_weight for belief in left] == [0.0, -1.0]
    assert len(pruned([Belief(MEAN, spread()), Belief(MEAN + 1e-3, spread())])) == 1


def test_consistency_of_chi_squared_numbers() -> None:
    """The interval holds 19 times out of 20; numbers that are a tenth too large fall out of it."""
    random = np.random.default_rng(11)
    held = [consistency(random.chisquare(2, 1000).tolist()).holds for _ in range(400)]
    assert np.mean(held) == pytest.approx(0.95, abs=4.0 * np.sqrt(0.95 * 0.05 / 400))
    large = consistency((1.1 * random.chisquare(2, 4000)).tolist())
    assert not large.holds
    assert large.mean > large.high > 2.0 > large.low
    with pytest.raises(ValueError, match="got no innovations, must be at least one"):
        consistency([])


@pytest.mark.parametrize(
    ("name", "value", "rule"), [("com", 0.0, "above 0"), ("slip", -1.0, "at least 0"), ("drift_time", 0.0, "above 0")]
)
def test_bad_uncertainties_are_refused(name: str, value: float, rule: str) -> None:
    with pytest.raises(ValueError, match=f"{name}: got {value}.*, must be finite and {rule}"):
        Uncertainty(**{name: value})


def crawled(gated: bool, aside: float) -> Belief:
    """Return the belief after two seconds ahead along x and pushed aside [m/s]."""
    mean = np.zeros(SIZE)
    mean[3], mean[9] = 0.08, 1.0
    belief = Belief(mean, np.diag(np.full(SIZE, 1e-3) ** 2))
    for k in range(1, 41):
        belief = FILTER.predicted(belief, np.array([0.27, 0.9, 0.0]), np.zeros(2), 0.05)
        belief = FILTER.with_com(belief, np.array([belief.mean[0], aside * 0.05 * k]), np.zeros(2), gated).belief
    return belief


def test_a_push_is_taken_for_drift_and_not_for_a_turn() -> None:
    pushed = crawled(True, 0.04)
    assert 0.025 < pushed.mean[7] < 0.045, "the rest is a small turn"
    assert abs(pushed.mean[2]) < 0.1
    assert abs(crawled(False, 0.04).mean[2]) > 2.0 * abs(pushed.mean[2]), "which without a trend it is"
    assert abs(crawled(True, 0.0).mean[7]) < 1e-3


def test_what_rocks_a_slow_worm_is_no_push() -> None:
    """Errors that last as long as half a wave does are taken for a push in quick waves only."""
    aside = np.array([0.0, 0.0085])

    def deviation(frequency: float) -> float:
        belief = Belief(np.where(np.arange(SIZE) == 9, 1.0, 0.0), np.diag(np.full(SIZE, 1e-4) ** 2))
        for _ in range(30):
            belief = FILTER.with_com(belief, aside, np.zeros(2), True, frequency=frequency).belief
        return float(np.sqrt(belief.covariance[7, 7]))

    assert deviation(0.8) > 0.04
    assert deviation(0.1) < 1e-3


def test_a_change_of_speed_makes_the_way_ahead_uncertain() -> None:
    sure, still = np.zeros((SIZE, SIZE)), np.where(np.arange(SIZE) == 9, 1.0, 0.0)
    begun = FILTER.predicted(Belief(still, sure), np.array([0.27, 0.9, 0.0]), np.zeros(2), 0.05).covariance
    resting = FILTER.predicted(Belief(still, sure), np.array([0.27, 0.0, 0.0]), np.zeros(2), 0.05).covariance
    assert begun[0, 0] > 4.0 * begun[1, 1]
    assert resting[0, 0] == pytest.approx(resting[1, 1])


def test_steering_never_turns_a_worm_the_other_way_round() -> None:
    mean = MEAN.copy()
    mean[9] = -2.0
    assert FILTER.with_com(Belief(mean, spread()), mean[:2], WAVE, True).belief.mean[9] == GAINS[0]


def test_samples_that_follow_each_other_closely_make_no_push() -> None:
    aside = np.array([0.0, 0.012])  # an error that lasts a tenth of a second
    often, seldom = (np.full(count, 0.1 / count) for count in (50, 2))
    found = []
    for steps in (often, seldom):
        belief = Belief(MEAN, 1e-9 * spread())
        for since in steps:
            belief = FILTER.with_com(belief, expected_com(MEAN) + aside, WAVE, True, 0.005, since).belief
        found.append(belief.trend[1])
    assert 0.0 < found[0] < 1.3 * found[1]
    assert np.array_equal(FILTER.with_com(Belief(MEAN, spread()), np.array([1e200, 0.0]), WAVE, True).belief.mean, MEAN)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_few_impossible_headings_are_refused_and_many_believed(way: float) -> None:
    """A heading that a filter is so sure of that no sample may be a radian off; it is open again for such samples."""
    belief, far = Belief(MEAN, 1e-2 * spread()), MEAN[2] + way
    for count in range(MAX_REFUSED_SAMPLES):
        belief, refused, jumped = FILTER.with_heading(belief, far, gated=True)
        assert (refused, jumped) == (True, False)
        assert (belief.turned, belief.log_weight) == (count + 1, 0.0)
        assert_allclose(belief.mean, MEAN, atol=0.0)
    likely, *said = FILTER.with_heading(belief, MEAN[2] + 0.01, gated=True)
    assert (likely.turned, said) == (0, [False, False])
    turned, *said = FILTER.with_heading(belief, far, gated=True)
    assert (turned.turned, said) == (0, [False, True])
    assert turned.mean[2] == pytest.approx(far, abs=0.01)
    ungated, *said = FILTER.with_heading(Belief(MEAN, 1e-2 * spread()), far)
    assert said == [False, False]
    assert 0.0 < way * (ungated.mean[2] - MEAN[2]) < 0.5
