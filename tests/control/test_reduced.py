"""The reduced model: its derivatives, limits and symmetry, and how well it foretells the plant."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.reduced import INPUTS, STATES, ReducedInput, ReducedModel, ReducedState
from control.gaits.steering import GaitParameters, PlannedWave, Schedule, WaveGenerator
from control.identification.identified import Identified, load
from worm3d import Plane, Worm, simulate
from worm3d.values.period_means import averaged

WORM = Worm()
REST = np.array(ReducedState(0.0, 0.0, 0.0, 0.0, 0.0))
STATE = ReducedState(
    0.3, -0.2, 0.7, 0.06, 0.1, slip=0.1, yaw_bias=0.02, drift=0.005, steering=0.05, turn_gain=1.1, crab=0.04
)
INPUT = ReducedInput(0.27, 0.9, 0.05)


def known() -> Identified:
    found = load(WORM)
    assert found is not None
    return found


def model(mechanism="hinge") -> ReducedModel:
    return ReducedModel.of(WORM, known(), mechanism)


def values(function: ca.Function, *given) -> np.ndarray:
    return np.array(function(*given)).ravel()


def test_the_dynamics_are_their_formula() -> None:
    found, rate = known().maps["hinge"], values(model().dynamics, STATE, INPUT)
    lags, f = known().lags["hinge"], INPUT.frequency
    v = 0.9 * 0.06
    u = found.drift_speed(*INPUT) + 0.04 * v + 0.005
    c, s = np.cos(0.7), np.sin(0.7)
    assert_allclose(rate[:3], [v * c - u * s, v * s + u * c, 0.12], atol=1e-15)
    assert rate[3] == pytest.approx((found.speed(*INPUT) - 0.06) * f / lags.amplitude)
    assert rate[4] == pytest.approx((1.1 * found.turn_rate(*INPUT) - 0.1) / lags.steering)
    assert_allclose(rate[5:], 0.0, atol=0.0)
    assert_allclose(values(model().output, STATE, INPUT), rate[:3])


def test_a_worm_that_comes_to_turn_swings_aside() -> None:
    """Its centre of mass goes aside by D = 0.3 - 0.25 f times the turn acceleration, by less in very slow waves."""
    lags = replace(known().lags["hinge"], swing=0.3, swing_rise=-0.25)
    swinging = ReducedModel.of(WORM, replace(known(), lags={"hinge": lags}), "hinge")
    for frequency, swing in ((0.9, 0.3 - 0.25 * 0.9), (0.1, (0.3 - 0.25 * 0.5) * 0.1 / 0.5), (0.0, 0.0)):
        given = INPUT._replace(frequency=frequency)
        plain, rate = (values(each.dynamics, STATE, given) for each in (model(), swinging))
        aside = swing * rate[4] * np.array([-np.sin(0.7), np.cos(0.7)])
        assert_allclose(rate[:2] - plain[:2], aside, atol=1e-15)
        assert_allclose(rate[2:], plain[2:], atol=0.0)


def test_jacobians_against_central_differences() -> None:
    step = model().step(0.3)
    symbols = [ca.SX.sym("x", STATES), ca.SX.sym("u", INPUTS)]
    jacobian = ca.Function("J", symbols, [ca.jacobian(step(*symbols), ca.vertcat(*symbols))])
    at, h = np.array([*STATE, *INPUT]), 1e-6
    for column, exact in enumerate(np.array(jacobian(STATE, INPUT)).T):
        ends = [at + side * h * np.eye(len(at))[column] for side in (1.0, -1.0)]
        ahead, behind = (values(step, end[:STATES], end[STATES:]) for end in ends)
        assert_allclose(exact, (ahead - behind) / (2.0 * h), atol=1e-8)


def test_the_step_is_of_fourth_order() -> None:
    """Steps so short that none is divided."""
    truth = steps(model(), 0.6, 128)
    errors = [np.abs(steps(model(), 0.6, parts) - truth).max() for parts in (8, 16)]
    assert 12.0 < errors[0] / errors[1] < 20.0
    assert errors[0] < 1e-5


def test_a_long_step_is_divided() -> None:
    assert_allclose(steps(model(), 2.0, 1), steps(model(), 2.0, 400), atol=1e-5)


def steps(reduced: ReducedModel, duration: float, parts: int) -> np.ndarray:
    state = np.array(STATE)
    for _ in range(parts):
        state = values(reduced.step(duration / parts), state, INPUT)
    return state


def test_motion_fades_with_an_amplitude_below_those_identified() -> None:
    least = known().maps["hinge"].ranges.amplitude[0]
    at = [values(model().dynamics, STATE, (share * least, 0.9, 0.05)) for share in (0.0, 0.5, 1.0)]
    assert_allclose(at[1], (at[0] + at[2]) / 2.0, atol=1e-15)
    resting = ReducedState(*values(model().step(60.0), REST, (0.0, 0.9, 0.05)))
    assert_allclose(resting._replace(steering=0.0), REST, atol=0.0)
    assert resting.steering == pytest.approx(0.05), "the steering in force moves nothing"


def test_it_settles_on_the_map() -> None:
    reduced, found, state = model(), known().maps["hinge"], REST
    for _ in range(200):
        state = values(reduced.step(0.1), state, INPUT)
    assert_allclose(state[3:5], [found.speed(*INPUT), found.turn_rate(*INPUT)], rtol=1e-9)


def test_the_steering_in_force_is_the_generators() -> None:
    generator, target, state = WaveGenerator(Schedule(), WORM), GaitParameters(0.3, 0.8, 0.0, 0.06), REST
    generator.step(0.0, GaitParameters(0.3, 0.8))
    for _ in range(20):
        generator.step(0.05, target)
        state = values(model().step(0.05), state, [0.3, 0.8, 0.06])
    assert generator.parameters is not None
    assert state[ReducedState._fields.index("steering")] == pytest.approx(generator.parameters.hinge, rel=1e-3)
    assert 0.05 < generator.parameters.hinge < 0.059


def test_mirrored_input_gives_the_mirrored_path() -> None:
    step = model("bias").step(0.2)
    sides = np.array([1, -1, -1, 1, -1, 1, -1, -1, -1, 1, -1.0])
    left, right = np.array(STATE), sides * STATE
    for _ in range(50):
        left, right = values(step, left, [0.3, 0.8, 0.03]), values(step, right, [0.3, 0.8, -0.03])
    assert_allclose(right, sides * left, atol=1e-13)


def test_it_foretells_half_a_minute_of_the_plant() -> None:
    """Steps of amplitude, frequency and steering, open loop: 1.3 m of way to 0.03 m, and each step to 4 degrees."""
    steered = ((8.0, GaitParameters(0.3, 0.8)), (20.0, GaitParameters(0.25, 0.9, 0.0, 0.06)))

    def plan(t: float) -> GaitParameters:
        return next((given for end, given in steered if t < end), GaitParameters(0.35, 0.7, 0.0, -0.08))

    run = simulate(
        WORM, Plane(), actuation=PlannedWave(plan, WaveGenerator(Schedule(), WORM)), duration=32.0, record_every=5
    )
    rows, dt = 25, 0.05
    com, h = averaged(run.com, rows), np.convolve(run.heading, np.full(rows, 1.0 / rows), "valid")
    state, step = np.array([*run.com[0, :2], *REST[2:]]), model().step(dt)
    states = [state]
    for k in range(640):
        given = plan(k * dt)
        states.append(values(step, states[-1], [given.amplitude, given.frequency, given.hinge]))
    off = np.array([states[k + rows // 2] for k in range(len(h))])[:, :3] - np.column_stack([com[:, :2], h])
    assert np.abs(off[100:380, :2]).max() < 0.03
    assert np.rad2deg(np.abs(off[100:380, 2]).max()) < 4.0
    assert np.rad2deg(np.abs(off[380:600, 2] - off[380, 2]).max()) < 4.0
    assert np.rad2deg(h.max()) > 70.0


def test_a_worm_stops_and_starts_with_its_wave() -> None:
    """In the mean over phases its way is foretold to 4 mm by the wave in force, and not by that asked for."""
    steady, still, dt, reduced = GaitParameters(0.3, 0.8), GaitParameters(0.3, 1e-6), 0.05, model()
    state, given = ca.SX.sym("state", STATES), ca.SX.sym("input", INPUTS)
    follow = ca.Function("follow", [state, given], [reduced.advance(state, given, dt, reduced.in_force)])
    ways, after = [], dt * np.arange(-25, 76)
    for stop in 6.25 + 0.3125 * np.arange(4):

        def plan(t: float, stop: float = stop) -> GaitParameters:
            return still if stop <= t < stop + 2.5 else steady

        wave = PlannedWave(plan, WaveGenerator(Schedule(), WORM))
        run = simulate(WORM, Plane(), actuation=wave, duration=11.0)
        ways.append(np.interp(stop + after, run.time, run.com[:, 0]))
    way = np.mean(ways, axis=0)
    way, speed = way[25:] - way[25], (way[25] - way[0]) / 1.25
    generator, ask = WaveGenerator(Schedule(), WORM), reduced.step(dt)
    generator.parameters = steady
    one = other = np.where(np.arange(STATES) == 3, speed, REST)
    found = [(0.0, 0.0)]
    for k in range(75):
        target, phase = still if k < 50 else steady, generator.phase
        generator.step(dt, target)
        force = [generator.parameters.amplitude, (generator.phase - phase) / (2.0 * np.pi * dt), 0.0]
        one, other = values(follow, one, force), values(ask, other, [target.amplitude, target.frequency, 0.0])
        found.append((one[0], other[0]))
    off = np.abs(np.array(found).T - way).max(axis=1)
    assert off[0] < 0.004 < 0.01 < off[1]


def test_parameters_and_refusals() -> None:
    assert model("bias").parameters(ReducedInput(0.3, 0.8, 0.04)) == GaitParameters(0.3, 0.8, bias=0.04)
    only = Identified(Schedule(), {"hinge": known().maps["hinge"]}, known().lags)
    with pytest.raises(ValueError, match="mechanism: got 'bias', must be one of the identified mechanisms: 'hinge'"):
        ReducedModel.of(WORM, only, "bias")
    with pytest.raises(ValueError, match=r"dt: got 0\.0 s, must be above 0"):
        model().step(0.0)
    with pytest.raises(ValueError, match="chamber_offset: got 0, must be above 0"):
        ReducedModel.of(Worm.planar(), known())
