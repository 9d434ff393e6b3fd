"""The chamber model against closed form, its own equations and the plant."""

import casadi as ca
import numpy as np
import pytest

import worm3d
from control.chambers.model import GRAVITY, TILT, ChamberModel, _loads
from control.estimation.reduced import flat_body
from control.gaits.steering import GaitParameters, Schedule, SteeredWave
from worm3d import Friction, Worm

WORM = Worm()
N = WORM.segments
STEP = 0.05


@pytest.fixture(scope="module")
def model():
    return ChamberModel.of(WORM)


def at_rest(worm=WORM):
    state = np.zeros(5 * 2 + worm.segments * 3 - 1 - 2)
    state[6 : 6 + 2 * worm.segments] = worm.l0
    return state


def rolled(model, commands, state=None, dt=STEP):
    states = [at_rest() if state is None else state]
    for command in commands:
        states.append(np.array(model.step(states[-1], command, dt)).ravel())
    return np.array(states)


def wave(parameters, waves, beside=0.0):
    times = STEP * np.arange(round(waves / parameters.frequency / STEP))
    rows = np.tile(parameters.row(), (len(times), 1))
    given = Schedule().commands_at(2.0 * np.pi * parameters.frequency * times, rows, WORM)
    return np.hstack([given.contraction[..., 0], given.contraction[..., 1], given.hinge + beside])


def mirrored(state):
    left, right = state[..., 6 : 6 + N], state[..., 6 + N : 6 + 2 * N]
    rest = state[..., 6 + 2 * N : -2]
    signs = np.array([1.0, -1.0, -1.0])
    tilt = state[..., -2:] * [1.0, -1.0]
    return np.concatenate([state[..., :3] * signs, state[..., 3:6] * signs, right, left, -rest, tilt], axis=-1)


def test_loads_are_in_balance():
    feet, reach = ca.SX.sym("feet", 14, 2), ca.SX.sym("reach", 14)
    loads = ca.Function("loads", [feet, reach], list(_loads(feet, reach, 1.0)))
    lengths, hinge = ca.SX.sym("lengths", N, 2), ca.SX.sym("hinge", N - 1)
    body = flat_body(WORM, lengths, hinge)
    shape = ca.Function("shape", [lengths, hinge], [body.feet, body.reach])
    commands = wave(GaitParameters(0.35, 0.8, 0.0, 0.1), 1.0)
    for command in commands[::3]:
        places, heights = shape(WORM.l0 * (1.0 - command[: 2 * N].reshape(2, N).T), command[2 * N :])
        tilt, shares = (np.array(value).ravel() for value in loads(places, heights))
        assert shares.sum() == pytest.approx(1.0)
        np.testing.assert_allclose(shares @ np.array(places), TILT * tilt, atol=5e-4)  # of a body of 1 m


def test_pushed_along_a_rigid_body_is_stopped_by_friction(model):
    # m v' = -mu m g: after t it is slower by mu g t.
    state, speed = at_rest(), 0.3
    state[3] = speed
    states = rolled(model, np.zeros((8, 3 * N - 1)), state, dt=0.02)
    np.testing.assert_allclose(states[1:, 3], speed - Friction().forward * GRAVITY * 0.02 * np.arange(1, 9), atol=1e-3)
    np.testing.assert_allclose(np.diff(states[:, 0]), 0.02 * states[1:, 3])
    assert np.abs(states[:, [1, 2, 4, 5]]).max() < 1e-12


def test_mirror_images_stay_so_and_place_does_not_matter(model):
    commands = wave(GaitParameters(0.3, 0.8, 0.05, 0.05), 1.0)
    images = np.hstack([commands[:, N : 2 * N], commands[:, :N], -commands[:, 2 * N :]])
    states = rolled(model, commands)
    np.testing.assert_allclose(rolled(model, images), mirrored(states), atol=1e-9)
    elsewhere = at_rest()
    elsewhere[:3] = 2.0, -1.0, 0.7
    moved = rolled(model, commands, elsewhere)
    cos, sin = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(moved[:, :2], [2.0, -1.0] + states[:, :2] @ [[cos, sin], [-sin, cos]], atol=1e-9)
    np.testing.assert_allclose(moved[:, 2], states[:, 2] + 0.7, atol=1e-9)


@pytest.mark.parametrize("amplitude", [0.3, 0.4])
def test_a_wave_goes_nearly_as_far_as_in_the_plant(model, amplitude):
    parameters, waves = GaitParameters(amplitude, 0.8), 4
    states = rolled(model, wave(parameters, waves))
    period = round(1.0 / parameters.frequency / STEP)
    actuation = SteeredWave(parameters, Schedule())
    plant = worm3d.simulate(WORM, worm3d.Plane(), actuation=actuation, duration=waves / 0.8, dt=0.01)
    way = np.interp([plant.time[-1] - 1.25, plant.time[-1]], plant.time, plant.com[:, 0])
    assert states[-1, 0] - states[-1 - period, 0] == pytest.approx(way[1] - way[0], rel=0.12)
    assert np.abs(states[:, [1, 2]]).max() < 1e-9


def test_a_bent_body_turns_along_its_bend(model):
    bent = np.array([0.2, 0.1, 0.0, 0.1, 0.2])
    states = rolled(model, wave(GaitParameters(0.3, 0.8), 4.0, bent))
    assert 0.03 < states[-1, 2] - states[-26, 2] < 0.2
    assert np.abs(states[:, -1]).max() < 0.2  # it does not roll over
