"""Stable heteroclinic cycles against their closed forms, and the gait that they make."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import SHC
from control.gaits.shc.cycle import Cycle, Walk, sojourns
from worm3d.values.arrays import FloatArray

CYCLES = [
    {"alpha": 2.0, "nu": 1.5, "noise": 1e-8, "nodes": 3},
    {"alpha": 2.0, "nu": 1.5, "noise": 1e-8, "nodes": 6},
    {"alpha": 0.5, "nu": 3.0, "noise": 1e-12, "nodes": 5},
    {"alpha": 1.0, "nu": 6.0, "noise": 1e-14, "nodes": 4},
]


def sampled(cycle: Cycle, count: int = 2000, seed: int = 1) -> tuple[float, float, float]:
    """Return the mean of some sojourns, its standard error, and their standard deviation [s]."""
    times = sojourns(Walk(cycle, seed, dt=0.2 / float(cycle.alpha.max())), count)
    return float(times.mean()), float(times.std() / np.sqrt(count)), float(times.std())


def test_saddles_have_the_eigenvalues_of_the_design() -> None:
    cycle = Cycle(5, alpha=[2.0, 1.0, 3.0, 1.5, 2.0], beta=[1.0, 0.5, 2.0, 1.0, 1.5], nu=[1.5, 2.0, 3.0, 2.0, 4.0])
    rates = cycle.alpha[:, None] - cycle.rho * cycle.beta  # of state j at node i, in column i
    node = np.arange(5)
    assert_allclose(rates[node, node], 0.0, atol=1e-14)  # beta is a fixed point
    assert_allclose(rates[(node + 1) % 5, node], cycle.leaving)
    assert_allclose(cycle.leaving, [1.0, 0.5, 1.0, 0.75, 0.5])  # alpha/nu, of node 0 at most the next alpha
    for others in (2, 3, 4):
        assert_allclose(rates[(node + others) % 5, node], -cycle.alpha)


@pytest.mark.parametrize("given", CYCLES)
def test_times_between_saddles(given: Mapping[str, Any]) -> None:
    cycle = Cycle(**given)
    mean, error, deviation = sampled(cycle)
    assert_allclose(cycle.formula_period / cycle.nodes, mean, rtol=0.03)
    assert_allclose(cycle.mean_period / cycle.nodes, mean, rtol=0.002, atol=3.0 * error)
    assert_allclose(deviation, np.pi / (2.0 * np.sqrt(2.0) * cycle.leaving[0]), rtol=0.07)


def test_period_grows_with_the_logarithm_of_the_noise() -> None:
    noise = np.geomspace(1e-8, 1e-4, 5)
    means, errors, _ = np.transpose([sampled(Cycle(3, noise=each), 3000, seed) for seed, each in enumerate(noise)])
    (slope, _), covariance = np.polyfit(-np.log(noise), means, 1, w=1.0 / errors, cov="unscaled")
    assert np.sqrt(covariance[0, 0]) < 0.005 * slope
    assert_allclose(slope, 1.5 / 2.0, rtol=0.02)  # nu/alpha


def test_nodes_may_differ() -> None:
    cycle = Cycle(4, alpha=[2.0, 1.0, 3.0, 1.5], beta=[1.0, 0.5, 2.0, 1.0], nu=[1.5, 2.0, 3.0, 2.0], noise=1e-10)
    times = sojourns(Walk(cycle), 2000).reshape(-1, 4)  # the first that is counted is that of node 1
    assert_allclose(times.mean(axis=0), np.roll(cycle.mean_times, -1), rtol=0.015)


def test_noise_far_below_the_rounding_of_the_largest_state_counts() -> None:
    cycle = Cycle(3, alpha=1.0, nu=6.0, noise=1e-36)
    mean, error, _ = sampled(cycle, 100)
    assert_allclose(mean, cycle.mean_period / 3, atol=4.0 * error)
    assert mean > 470.0


def test_time_step_is_short_enough() -> None:
    # Driven from node to node, without chance: the larger the step the further off, but in second order.
    ends = []
    for parts in (1, 2, 8):
        walk = Walk(Cycle(3, noise=1e-30), dt=0.1 / 2.0 / parts)
        walk.states[:], walk.push[:] = (1.0, 1e-3, 1e-9), (0.0, 1e-3, 1e-3)
        ends.append(walk.advance(round(8.0 / walk.dt))[-1])
    coarse, fine = (np.abs(end - ends[-1]).max() for end in ends[:2])
    assert coarse < 2e-3
    assert_allclose(coarse / fine, 4.2, rtol=0.2)


def test_the_walk_is_the_same_however_it_is_cut() -> None:
    whole, parts = Walk(Cycle(4), seed=3), Walk(Cycle(4), seed=3)
    cut = np.vstack([parts.advance(steps) for steps in (1, 0, 700, 5299)])
    assert np.array_equal(whole.advance(6000), cut)
    assert not np.array_equal(Walk(Cycle(4), seed=4).advance(6000), cut)


def test_another_unit_of_time() -> None:
    cycle = Cycle(4, alpha=[2.0, 1.0, 3.0, 1.5])
    quick = cycle.lasting(2.0)
    assert_allclose(quick.mean_period, 2.0)
    assert_allclose(quick.mean_times / 2.0, cycle.mean_times / cycle.mean_period)
    ratio = quick.mean_period / cycle.mean_period
    assert_allclose(Walk(quick).advance(3000), Walk(cycle, dt=Walk(quick).dt / ratio).advance(3000), atol=1e-7)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"nodes": 2}, "nodes: got 2, must be a whole number of at least 3"),
        ({"nodes": 3, "nu": 1.0}, "nu: got 1.0, every value must be finite and above 1"),
        ({"nodes": 3, "alpha": [1.0, 2.0]}, r"alpha: got 2 values, must be a number or 3 of them"),
        ({"nodes": 3, "noise": 0.0}, "noise: got 0.0, must be above 0 and at most 0.0487"),
        ({"nodes": 3, "noise": 0.1}, "noise: got 0.1, must be above 0 and at most 0.0487"),
        ({"nodes": 3, "noise": float("nan")}, "noise: got nan"),
    ],
)
def test_bad_cycles(given: Mapping[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Cycle(**given)


def order_of(activations: FloatArray) -> list[int]:
    """Return which segment is the most active one, in turn, without the one at the start."""
    active = activations.argmax(axis=1)
    return [int(each) for each in active[1:][np.diff(active) != 0]]


@pytest.mark.parametrize(("direction", "order"), [("direct", [1, 2, 3, 4, 5, 0]), ("retrograde", [4, 3, 2, 1, 0, 5])])
def test_segments_take_turns(direction: Any, order: list[int]) -> None:
    times = np.arange(0.0, 20.0, 0.02)
    activations = SHC(direction=direction, period=2.0).activations(times, 6)
    assert activations.min() >= 0.0
    assert activations.max() == 1.0
    turns = order_of(activations)
    assert turns[:12] == [*order, *order]
    assert_allclose(20.0 / (len(turns) / 6), 2.0, rtol=0.05)


def test_waves_and_breadth() -> None:
    times = np.arange(0.0, 6.0, 0.02)
    twice = SHC(nodes=3).activations(times, 6)
    assert np.array_equal(twice[:, :3], twice[:, 3:])
    broad = SHC(breadth=3).activations(times, 6)
    narrow = SHC().activations(times, 6)
    assert_allclose(broad[:, 2], np.minimum(1.0, narrow[:, 2] + narrow[:, 1] + narrow[:, 0]), atol=1e-12)


def test_saddle_values_belong_to_segments() -> None:
    slow = np.array([1.5, 1.5, 6.0, 1.5, 1.5, 1.5])
    for direction in ("direct", "retrograde"):
        active = SHC(nu=slow, direction=direction).activations(np.arange(0.0, 20.0, 0.01), 6).argmax(axis=1)
        assert np.bincount(active).argmax() == 2


def test_times_may_be_asked_in_any_order() -> None:
    gait, times = SHC(), np.arange(0.0, 3.0, 0.013)
    assert_allclose(gait.activations(times[::-1], 6)[::-1], gait.activations(times, 6), atol=1e-12)
    assert_allclose(gait.activations(times[100:101], 6), gait.activations(times, 6)[100:101], atol=1e-12)


def test_it_senses_what_has_a_gain() -> None:
    assert SHC().senses == ()
    assert SHC(strain_gain=0.1, load_gain=0.1).senses == ("strain", "contact_load")
    with pytest.raises(ValueError, match="senses strain, so it is not a function of time"):
        SHC(strain_gain=0.1).activations(np.zeros(1), 6)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"nodes": 7}, "nodes: got 7, must be at least 3 and at most the worm's 6 segments"),
        ({"nodes": 2}, "nodes: got 2, must be at least 3"),
        ({"breadth": 6}, "breadth: got 6, must be below the 6 nodes of the cycle"),
        ({"saddle_noise": 1.0}, "saddle_noise: got 1.0, must be above 0 and at most"),
    ],
)
def test_bad_gaits(given: Mapping[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        SHC(**given).activations(np.zeros(1), 6)


def waves(lag: float, duration: float = 8.0, **given: Any) -> tuple[worm3d.Result, float]:
    """Let the default worm crawl with actuators of some lag [s]; return the run and the mean period [s]."""
    worm, gait = worm3d.Worm(actuator_lag=lag), SHC(amplitude=0.3, **given)
    result = worm3d.simulate(worm, worm3d.Plane(), actuation=gait, duration=duration, dt=0.01)
    return result, 6.0 * duration / len(order_of(result.contraction.mean(axis=2)))


def test_feedback_by_strain_waits_for_slow_actuators() -> None:
    given = {"saddle_noise": 1e-20, "nu": 3.0, "period": 12.0, "strain_gain": 0.05}
    (quick, short), (_, long) = waves(0.05, **given), waves(0.2, **given)
    assert short < long < 4.0  # the pace is that of the body, and not the mean of 12 s without feedback
    assert quick.distance > 0.2
    assert waves(0.05, 12.0, **{**given, "strain_gain": 0.0})[1] > 8.0


def test_feedback_by_load_goes_on_where_a_segment_bears_the_worm() -> None:
    given = {"saddle_noise": 1e-20, "nu": 3.0, "period": 12.0, "load_gain": 0.05}
    assert waves(0.05, load_threshold=0.4, **given)[1] < 4.0
    assert waves(0.05, 12.0, load_threshold=100.0, **given)[1] > 8.0
