"""The planner of chambers and hinges: derivatives by finite differences, bounds, and never worse than the posture."""

import numpy as np
import pytest

from control.chambers.model import ChamberModel
from control.chambers.mpc import BodyMPC, BodyTolerances, wanted_of
from control.gaits.steering import GaitParameters, Schedule
from control.tracking.paths import Circle, Line
from worm3d import Worm

WORM = Worm(segments=4)
STEPS, BLOCKS = 4, 2
LOOSE = BodyTolerances(hinge=0.3, chamber=0.05, head=0.03)


@pytest.fixture(scope="module")
def model():
    return ChamberModel.of(WORM)


@pytest.fixture
def mpc(made):
    made.forget()
    return made


@pytest.fixture(scope="module")
def made(model):
    return BodyMPC(WORM, model, LOOSE, steps=STEPS, blocks=BLOCKS)


def situation(model, path, amplitude=0.3):
    state = np.zeros(model.size)
    state[6:14] = WORM.l0
    times = 0.1 * (np.arange(STEPS) + 0.5)
    rows = np.tile(GaitParameters(amplitude, 0.8).row(), (STEPS, 1))
    given = Schedule().commands_at(2.0 * np.pi * 0.8 * times, rows, WORM)
    wave = np.hstack([given.contraction[..., 0], given.contraction[..., 1], given.hinge])
    return state, wave, wanted_of(path, 0.01 * np.arange(1.0, STEPS + 1.0), 0.43), np.zeros((BLOCKS, 3))


def test_jacobian_is_that_of_the_rollout(mpc, model):
    state, wave, wanted, _ = situation(model, Circle(0.6))
    z = 0.02 * np.sin(np.arange(BLOCKS * 11.0))

    def misses(z):
        return (mpc._rollout(state, mpc._commands(z, wave).T, wanted.T)[1].T * mpc._weights).ravel()

    analytic = mpc._jacobian(z, state, wave, wanted)
    numeric = np.column_stack([(misses(z + 1e-6 * e) - misses(z - 1e-6 * e)) / 2e-6 for e in np.eye(z.size)])
    np.testing.assert_allclose(analytic, numeric, atol=1e-4 * np.abs(numeric).max())


def test_plans_bend_the_worm_into_its_path_and_are_better_than_the_posture(mpc, model):
    for t in (0.0, 0.2):
        plan = mpc.plan(t, *situation(model, Circle(0.6)))
        assert plan.ok
        assert plan.cost < plan.plain_cost
    assert plan.beside[:, 8:].sum() > 0.1
    right = situation(model, Circle(0.6, towards="right"))
    mpc.forget()
    left = mpc.plan(0.0, *situation(model, Circle(0.6)))
    mpc.forget()
    mirrored = mpc.plan(0.0, *right)
    np.testing.assert_allclose(mirrored.beside[:, 8:], -left.beside[:, 8:], atol=1e-6)


def test_straight_on_nothing_is_done_beside_the_wave(mpc, model):
    assert np.abs(mpc.plan(0.0, *situation(model, Line())).beside).max() < 1e-6


def test_chambers_stay_within_their_stroke(mpc, model):
    state, wave, wanted, postures = situation(model, Circle(0.3), amplitude=0.45)
    plan = mpc.plan(0.0, state, wave, wanted, postures)
    total = wave[:, :8] + np.repeat(plan.beside[:, :8], STEPS // BLOCKS, axis=0)
    assert total.max() <= WORM.stroke[1] + 1e-9
    assert total.min() >= WORM.stroke[0] - 1e-9


def test_estimates_that_are_not_finite_give_no_plan(mpc, model):
    state, *rest = situation(model, Circle(0.6))
    state[0] = np.nan
    assert not mpc.plan(0.0, state, *rest).ok
    assert mpc.plan(0.2, *situation(model, Circle(0.6))).ok  # and do no lasting harm


def test_plans_go_on_block_by_block(mpc, model):
    plan = mpc.plan(1.0, *situation(model, Circle(0.6)))
    for t, k in ((1.0, 0), (1.19, 0), (1.2, 1), (9.0, 1)):
        assert np.array_equal(plan.at(t), plan.beside[k])


def test_blocks_divide_the_steps(model):
    with pytest.raises(ValueError, match=r"blocks: got 3, must be a whole share of the steps \(4\)"):
        BodyMPC(WORM, model, steps=4, blocks=3)
