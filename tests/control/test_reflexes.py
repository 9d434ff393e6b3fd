"""Reflexes: their laws on loads that are given, and what they do for a worm in a pipe."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import REFLEXES, Gait, Reach, Reflex, Reflexive, TravellingWave, TwoAnchor, Wait, WallLoad
from control.gaits.reflexes import ReflexMemory
from control.sensing import Channel, Sensors

WORM = worm3d.Worm()
STIFF = worm3d.Worm(k_spring=100.0)
ROUGH = worm3d.Friction(forward=0.3, backward=0.8, lateral=0.8)
N = WORM.segments
UP = math.pi / 2.0


def loaded(load: float) -> dict[str, np.ndarray]:
    """Every segment bears so much, shared by two apexes."""
    return {"contact_load": np.tile([load / 2.0, 0.0, 0.0, load / 2.0, 0.0, 0.0], (N, 1))}


def chambers(contraction: float) -> np.ndarray:
    return np.full((N, 2), contraction)


def given_at(memory: ReflexMemory, times: np.ndarray, wanted: float, load: float) -> list[float]:
    return [float(memory.step(t, chambers(wanted), loaded(load))[2, 0]) for t in times]


def test_a_segment_gives_way_at_the_rate_of_the_law_and_lets_go_when_the_wave_turns() -> None:
    memory, times = WallLoad(load=4.0, rate=2.0, recovery=1.0).start(WORM), np.linspace(0.0, 0.05, 6)
    assert given_at(memory, times, 0.3, 3.9) == [0.3] * 6, "below the threshold nothing happens"
    assert_allclose(given_at(memory, times + 0.06, 0.3, 6.0), 0.3 - 2.0 * 0.5 * (times + 0.01), atol=1e-14)
    assert_allclose(given_at(memory, times + 0.12, 0.3, 4.0), 0.24, atol=1e-14)
    assert_allclose(given_at(memory, times + 0.18, 0.2, 4.0), 0.14, atol=1e-14, err_msg="it lets go with the wave")
    assert_allclose(given_at(memory, times + 0.24, 0.2, 2.0), 0.14 + 0.5 * (times + 0.01), atol=1e-14)
    assert_allclose(given_at(memory, np.array([2.0, 2.01]), 0.3, 2.0), 0.3, atol=1e-14)
    given_at(memory, np.array([2.02]), 0.3, 8.0)
    least = WORM.stroke[0]
    assert given_at(memory, np.array([2.03, 2.04]), least, 4.0) == [least] * 2
    assert given_at(memory, np.array([2.05]), 0.3, 4.0) == [0.3], "at its longest it has forgotten what it held"
    assert_allclose(given_at(memory, np.array([2.06]), 0.3, 80.0), 0.28, atol=1e-14, err_msg="not faster than its rate")
    assert_allclose(given_at(memory, np.array([9.0]), 0.3, 40.0), least, atol=1e-15)


def test_thresholds_follow_from_the_weight() -> None:
    heavy = replace(WORM, mass=3.0 * WORM.mass)
    for worm in (WORM, heavy):
        threshold = 12.0 * worm.mass * 9.81
        for share, stopped in ((0.99, False), (1.01, True)):
            memory = WallLoad().start(worm)
            given_at(memory, np.array([0.0]), 0.2, share * threshold)
            assert (given_at(memory, np.array([0.01]), 0.3, share * threshold)[0] < 0.3) == stopped


@given(st.lists(st.tuples(st.floats(-0.1, 0.4), st.floats(0.0, 60.0)), min_size=1, max_size=30))
def test_it_never_contracts_more_than_is_wanted(history: list[tuple[float, float]]) -> None:
    memory = WallLoad(load=5.0).start(WORM)
    for k, (wanted, load) in enumerate(history):
        found = memory.step(0.01 * k, chambers(wanted), loaded(load))
        assert found.max() <= wanted + 1e-15
        assert found.min() >= min(wanted, WORM.stroke[0]) - 1e-15


@pytest.mark.parametrize("part", REFLEXES.values())
def test_reflexes_neither_steer_nor_take_away_what_steers(part: type[Reflex]) -> None:
    memory, mirrored, rng = part().start(WORM), part().start(WORM), np.random.default_rng(0)
    for k in range(40):
        wanted = rng.uniform(-0.1, 0.4, (N, 2))
        felt = {"contact_load": rng.uniform(0.0, 5.0, (N, 6)), "strain": rng.uniform(-0.3, 0.1, (N, 2))}
        other = {"contact_load": felt["contact_load"][:, [3, 4, 5, 0, 1, 2]], "strain": felt["strain"][:, ::-1]}
        found = memory.step(0.01 * k, wanted, felt)
        assert_allclose(found[:, 0] - found[:, 1], wanted[:, 0] - wanted[:, 1], atol=1e-14)
        assert_allclose(mirrored.step(0.01 * k, wanted[:, ::-1], other), found[:, ::-1], atol=1e-12)


def test_a_segment_without_contact_contracts_further() -> None:
    memory, times = Reach(most=0.5, time=0.2).start(WORM), np.linspace(0.0, 0.05, 6)
    assert_allclose(given_at(memory, times, 0.2, 0.0), 0.2 * (1.0 + times / 0.2), atol=1e-14)
    assert_allclose(given_at(memory, times + 0.06, 0.2, 1.0), 0.25, atol=1e-14)
    assert_allclose(given_at(memory, np.array([0.5]), 0.2, 0.0), 0.3, atol=1e-14)
    assert given_at(memory, np.array([0.51, 0.71]), -0.1, 0.0) == [-0.1, -0.1]
    assert_allclose(given_at(memory, np.array([0.72]), 0.2, 1.0), 0.2, atol=1e-14)


def test_a_segment_waits_for_the_next_one_but_not_for_ever() -> None:
    memory = Wait(share=0.5, patience=0.1).start(WORM)
    wave, later = np.zeros((N, 2)), np.zeros((N, 2))
    wave[3], later[2] = 0.2, 0.2
    strain = np.zeros((N, 2))
    memory.step(0.0, wave, {"strain": strain})
    assert memory.step(0.01, later, {"strain": strain})[3, 0] == pytest.approx(0.2), "2 has not contracted yet"
    slow = [memory.step(0.02 + 0.01 * k, later, {"strain": strain})[3, 0] for k in range(40)]
    assert slow[5] == pytest.approx(0.2)
    assert slow[-1] == pytest.approx(0.0, abs=1e-5)
    assert np.abs(np.diff(slow)).max() < 0.08, "it does not jump"
    memory = Wait(share=0.5, patience=0.1).start(WORM)
    memory.step(0.0, wave, {"strain": strain})
    strain[2] = -0.11
    assert_array_equal(memory.step(0.01, later, {"strain": strain}), later)


def crawled(gait: object, duration: float = 1.0, **others: object) -> worm3d.Result:
    return worm3d.simulate(WORM, worm3d.Plane(), actuation=gait, duration=duration, **others)  # type: ignore[arg-type]


@pytest.mark.parametrize("wave", [TravellingWave(bias=0.2, hinge=0.1, force=0.2), TwoAnchor(period=2.0)])
def test_a_reflex_that_nothing_triggers_changes_no_bit(wave: Gait) -> None:
    plain, reflexed = crawled(wave), crawled(Reflexive(wave, (WallLoad(load=1e3),)))
    assert_array_equal(reflexed.joints, plain.joints)
    assert_array_equal(reflexed.contraction, plain.contraction)
    assert reflexed.period == plain.period
    noisy = crawled(Reflexive(wave, (WallLoad(load=1e3),)), sensor=Sensors(contact_load=Channel(noise=0.01)))
    assert_array_equal(noisy.joints, plain.joints)


def pipe(tilt: float, wide: float, narrow: float) -> worm3d.Pipe:
    line = worm3d.Centreline.of([worm3d.Straight(1.0)], tilt=tilt)
    return worm3d.Pipe(line, worm3d.Profile([0.9, 1.2], [wide, narrow]))


def sent(gait: object, world: worm3d.Pipe, duration: float, tilt: float, **others: object) -> tuple[float, float]:
    """Return the way along a pipe [m], and the energy lost to slip per metre [J/m]."""
    start = worm3d.State.straight(STIFF, world, contraction=gait.bind(STIFF)(0.0).contraction)  # type: ignore[attr-defined]
    run = worm3d.simulate(STIFF, world, ROUGH, gait, duration, state=start, record_every=2, **others)  # type: ignore[arg-type]
    way = float((run.com[-1] - run.com[0]) @ [math.cos(tilt), 0.0, math.sin(tilt)])
    return way, float(run.energy.friction_loss.sum()) / way


@pytest.mark.parametrize(
    ("tilt", "radii", "wave", "sine", "less"),
    [
        (0.0, (0.105, 0.087), (0.7, 2.5, 0.25), (0.8, 2.5, 0.4), 0.6),
        (UP, (0.095, 0.088), (0.45, 1.05, 0.3), (0.38, 1.28, 0.3), 0.4),
    ],
)
def test_a_worm_that_feels_the_wall_goes_faster_and_loses_less_to_slip(
    tilt: float, radii: tuple[float, float], wave: tuple[float, ...], sine: tuple[float, ...], less: float
) -> None:
    """Beside the fastest sine wave that was found in such pipes, and beside its own wave without the reflex."""
    world = pipe(tilt, *radii)
    own, fast = (
        TravellingWave(period=period, wavelength=length, amplitude=most, rectified=False)
        for period, length, most in (wave, sine)
    )
    felt, plain, fastest = (sent(gait, world, 14.0, tilt) for gait in (Reflexive(own, (WallLoad(),)), own, fast))
    assert felt[0] > max(plain[0], fastest[0])
    assert felt[1] < (1.0 - less) * fastest[1]


def test_a_worm_that_reaches_out_climbs_where_its_gait_alone_falls() -> None:
    world, gait = pipe(UP, 0.1, 0.1), TwoAnchor(period=3.0, amplitude=0.2)
    start = worm3d.State.straight(STIFF, world, contraction=gait.bind(STIFF)(0.0).contraction)
    ways = []
    for each in (gait, Reflexive(gait, (Reach(),))):
        run = worm3d.simulate(STIFF, world, ROUGH, each, 6.0, state=start, record_every=10)
        ways.append(run.com[-1, 2] - run.com[0, 2])
    assert ways[0] < -0.1
    assert ways[1] > 0.25


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda: WallLoad(load=-1.0), "load: got -1.0"),
        (lambda: Wait(share=2.0), "share: got 2.0"),
        (lambda: Reflexive(WallLoad(), ()), "gait: got WallLoad"),  # type: ignore[arg-type]
        (lambda: Reflexive(TravellingWave(), (TravellingWave(),)), "reflexes: got TravellingWave"),  # type: ignore[arg-type]
        (lambda: type("Again", (WallLoad,), {}, name="reach"), "name: got 'reach', must be another"),
    ],
)
def test_refusals(wrong: object, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        wrong()  # type: ignore[operator]
