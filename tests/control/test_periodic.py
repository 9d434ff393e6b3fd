"""Periodic gaits and splines: their phases and shapes, checked by what must not change them."""

import numpy as np
import pytest
from hypothesis import given, seed
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.interpolate import CubicSpline

from control.gaits import Gait, Inchworm, Periodic, Spline, TravellingWave, TwoAnchor
from worm3d import Plane, Worm, simulate

TIMES = np.linspace(0.0, 7.0, 141)
"""Times [s] at which gaits are compared."""


def drawn(number: int, **others: object) -> Periodic | Spline:
    """Return a random gait with numbers for each side of five segments."""
    rng = np.random.default_rng(number)
    common = {"period": rng.uniform(0.5, 4.0), "waves": rng.uniform(0.0, 3.0), "rectified": bool(rng.integers(2))}
    common |= {"phase": rng.uniform(-1.0, 1.0, (5, 2))} | others
    if rng.integers(2):
        return Spline(values=rng.uniform(-1.0, 1.0, (5, 2, int(rng.integers(3, 9)))), **common)
    duty, sharpness = rng.uniform(0.1, 0.9, (5, 2)), rng.choice([0.0, 1.0, 30.0], (5, 2))
    return Periodic(duty=duty, sharpness=sharpness, weight=rng.uniform(-1.0, 1.0, (5, 2)), **common)


@seed(1)
@given(number=st.integers(0, 10**6), shift=st.floats(-2.0, 2.0))
def test_a_random_gait_repeats_stays_in_range_and_a_phase_is_a_time(number: int, shift: float) -> None:
    gait = drawn(number)
    sampled = gait.activations(TIMES, 5)
    assert sampled.shape == (len(TIMES), 5, 2)
    assert np.abs(sampled).max() <= 1.0
    assert gait.lengthens or sampled.min() >= 0.0
    # Square waves turn within a thousandth of a period, which magnifies rounding.
    assert_allclose(gait.activations(TIMES + 3.0 * gait.period, 5), sampled, atol=1e-9)
    later = drawn(number, phase=np.asarray(gait.phase) + shift).activations(TIMES, 5)
    assert_allclose(later, gait.activations(TIMES + shift * gait.period, 5), atol=1e-9)


@seed(2)
@given(number=st.integers(0, 10**6))
def test_a_direct_wave_is_the_retrograde_one_from_the_other_end(number: int) -> None:
    """The direct wave is the later one, by the phase of the wave between the ends, `waves`."""
    rng = np.random.default_rng(number)
    shape = {"duty": rng.uniform(0.2, 0.8), "sharpness": rng.uniform(0.0, 5.0), "waves": rng.uniform(0.0, 3.0)}
    head = Periodic(period=1.0, **shape)
    tail = Periodic(period=1.0, direction="direct", **shape)
    assert_allclose(tail.activations(TIMES + head.waves, 6), head.activations(TIMES, 6)[:, ::-1], atol=1e-9)


def test_exchanged_sides_exchange_the_commands() -> None:
    gait = drawn(5)
    mirrored = drawn(5, phase=np.asarray(gait.phase)[:, ::-1])
    for name in ("values",) if isinstance(gait, Spline) else ("duty", "sharpness", "weight"):
        object.__setattr__(mirrored, name, np.asarray(getattr(gait, name))[:, ::-1])
    one, other = (each.bind(Worm(segments=5)).commands(TIMES) for each in (gait, mirrored))
    assert_array_equal(one.contraction[..., ::-1], other.contraction)
    assert_allclose(one.hinge, other.hinge, atol=1e-15)


def test_the_default_is_the_papers_wave() -> None:
    for rectified in (True, False):
        wave = TravellingWave(wavelength=0.5, rectified=rectified).activations(TIMES, 6)
        assert_allclose(Periodic(waves=2, rectified=rectified).activations(TIMES, 6), wave, atol=1e-11)


def test_duty_sharpness_and_weight() -> None:
    times = np.linspace(0.0, 1.0, 4001)[:-1]
    for duty in (0.1, 0.5, 0.8):
        wave = Periodic(period=1.0, waves=0, duty=duty, rectified=False).activations(times, 1)[:, 0]
        assert np.mean(wave > 1e-9) == pytest.approx(duty, abs=1e-3)
        assert wave[round(duty / 2 * 4000)] == pytest.approx(1.0)
    square = Periodic(period=1.0, waves=0, sharpness=100.0, rectified=False).activations(times, 1)[:, 0]
    assert np.mean(np.abs(square) > 0.999) > 0.97
    weighed = Periodic(waves=0, weight=[[1.0, -0.5]]).activations(TIMES, 1)
    assert_allclose(weighed[..., 1], -0.5 * weighed[..., 0], atol=1e-15)


@pytest.mark.parametrize("count", [3, 4, 5, 8, 13])
def test_the_spline_is_the_periodic_cubic_one(count: int) -> None:
    values = np.random.default_rng(count).uniform(-0.3, 0.3, count)
    known = CubicSpline(np.arange(count + 1) / count, np.append(values, values[0]), bc_type="periodic")
    gait = Spline(period=1.0, waves=0, values=values, rectified=False)
    assert_allclose(gait.activations(TIMES, 2)[:, 1], known(np.mod(TIMES, 1.0)), atol=1e-14)
    assert_allclose(gait.activations(np.arange(count) / count, 1)[:, 0], values, atol=1e-12)


def test_numbers_for_each_segment() -> None:
    gait = Periodic(phase=[0.0, 0.1, 0.4], waves=0, period=1.0)
    assert gait.activations(TIMES, 3).shape == (len(TIMES), 3)
    assert_allclose(gait.activations(TIMES, 3)[:, 2], gait.activations(TIMES + 0.4, 3)[:, 0], atol=1e-12)
    curves = Spline(values=[[0.0, 1.0, 0.0], [0.0, 0.5, 0.0]], waves=0, period=1.0)
    assert curves.activations(TIMES, 2).shape == (len(TIMES), 2)
    assert curves.activations(np.array([1 / 3]), 2).tolist() == [pytest.approx([1.0, 0.5])]


@pytest.mark.parametrize(
    ("build", "sentence"),
    [
        (
            lambda: Periodic(phase=[0.0, 0.1]).activations(TIMES, 3),
            r"phase: got shape \(2,\), must be a number, or one",
        ),
        (lambda: Periodic(duty=np.full((3, 1, 1), 0.5)), "duty: got .*, a number, or one or a pair of left and right"),
        (lambda: Periodic(weight=2.0), r"weight: got 2.0, must be finite and in \[-1, 1\], a number"),
        (lambda: Spline(values=[0.0, 1.0]), r"values: got shape \(2,\), must be a list of at least 3 numbers"),
        (lambda: Spline(values=0.3), r"values: got shape \(\), must be a list of at least 3 numbers"),
        (lambda: Spline(values=np.zeros((2, 3, 4))), r"values: got .*, a list, or one or a pair of left and right"),
        (lambda: Spline(values=np.zeros((2, 4))).activations(TIMES, 6), "values: got 2 lists, must be one for each of"),
    ],
)
def test_what_does_not_fit_is_refused(build, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        build()


@pytest.mark.parametrize("kind", [TwoAnchor, Inchworm])
def test_anchors_hold_in_turn_and_mirror(kind: type[TwoAnchor]) -> None:
    gait = kind(period=4.0, extension=-0.5)
    times = np.linspace(0.0, 8.0, 801)
    sampled = gait.activations(times, 5)
    assert_allclose(sampled[400:], sampled[:401], atol=1e-12)
    rear, body, front = sampled[:, 0], sampled[:, 2], sampled[:, 4]
    # The body extends only while the rear holds and the front does not, and shortens while it is the other way round.
    moving = np.diff(body)
    assert np.all(rear[:-1][moving < -1e-9] > 1 - 1e-9)
    assert np.all(front[:-1][moving < -1e-9] < -0.49)
    assert np.all(front[:-1][moving > 1e-9] > 1 - 1e-9)
    assert_array_equal(kind(period=4.0, direction="direct").activations(times, 5), sampled[:, ::-1])
    if kind is Inchworm:
        assert_allclose(rear + front, 0.5, atol=1e-12)  # the length is kept while the anchors change over


def way(gait: Gait) -> float:
    """Return the way of the centre of mass in two periods, from the second on [m]."""
    run = simulate(Worm(), Plane(), actuation=gait, duration=3.0 * gait.period)
    return float(run.com[-1, 0] - run.com[round(gait.period / 0.01), 0])


def test_the_inchworm_crawls_towards_its_front() -> None:
    there, back = (way(Inchworm(amplitude=0.3, direction=direction)) for direction in ("retrograde", "direct"))
    assert there > 0.4
    assert there > back
