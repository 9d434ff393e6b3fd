"""Accuracy on request: order with steps of any length, the limit, rows between steps, resume, estimates, errors."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.gaits import TravellingWave
from tests.worm3d.test_free_flight import fly, tumbling, uneven_worm, writhing
from worm3d import Command, Plane, Result, Spread, State, Status, Worm, load, scattered, simulate, simulate_batch
from worm3d.physics.kernels.inertia import weights
from worm3d.running import accuracy as runs
from worm3d.running.problem import Problem
from worm3d.running.run import Run
from worm3d.solver.advance import LAST, NEXT, advance


def test_weights_differentiate_every_parabola() -> None:
    """On 1, t and t^2 the backward difference is exact, whatever the ratio of the steps; equal steps give 4/3, -1/3."""
    dt = 0.3
    for ratio in (0.2, 1.0, 1.9):
        w0, w1 = weights(ratio)
        span = dt * (1.0 + ratio) / (1.0 + 2.0 * ratio)
        t = np.array([1.0, 1.0 - dt, 1.0 - dt - dt / ratio])
        for power, rate in ((0, 0.0), (1, 1.0), (2, 2.0)):
            values = t**power
            assert (values[0] - w0 * values[1] - w1 * values[2]) / span == pytest.approx(rate, abs=1e-12)
    assert weights(1.0) == (4.0 / 3.0, -1.0 / 3.0)
    assert weights(0.0) == (1.0, 0.0)
    symbol = ca.SX.sym("w")
    assert_allclose(list(map(float, ca.Function("w", [symbol], list(weights(symbol)))(0.7))), weights(0.7), rtol=1e-15)


def flown(steps: np.ndarray) -> np.ndarray:
    """Return the joints of a worm that tumbled and writhed for the sum of these steps."""
    worm = uneven_worm()
    problem = Problem(worm=worm, world=None, actuation=writhing, state=tumbling(worm), duration=0.4, settle_first=False)
    run = Run(problem, allowed=np.inf)
    counters, force, ends = np.zeros((1, 4), dtype=np.int64), np.zeros((0, 3, run.n + 1)), np.cumsum(steps)
    for t, h in zip(ends, steps, strict=True):
        run.pace[NEXT] = h
        command = run.driver.at(t)[None]
        given = run.core, run.records.block, counters, command, force, 0, 10**9, h, True, run.pace, (1, 1, 0)
        assert advance(*given) == (1, 0)
        assert run.pace[LAST] == h
    return run.plant.arrays["joints"][:3, : run.n + 1].copy()


def test_order_is_two_with_steps_of_random_ratios() -> None:
    rng, reference = np.random.default_rng(3), fly("bdf2", 1e-4).joints[-1].T
    pattern = np.exp(np.clip(np.cumsum(rng.uniform(-0.65, 0.65, 80)), -0.9, 0.9))
    errors = []
    for repeats in (1, 2, 4):
        # The same changes of length over the same time, each step cut into as many of random lengths.
        parts = rng.dirichlet(np.full(repeats, 20.0), len(pattern)).ravel() if repeats > 1 else np.ones(len(pattern))
        steps = np.repeat(pattern, repeats) * parts
        steps *= 0.4 / steps.sum()
        begin = steps[:1] * 2.0 ** -np.arange(12.0, 0.0, -1.0)  # implicit Euler's first step must not count
        steps = np.concatenate([begin, steps[:1] - begin.sum(), steps[1:]])
        errors.append(np.abs(flown(steps) - reference).max())
    orders = [np.log2(coarse / fine) for coarse, fine in pairwise(errors)]
    assert np.mean(orders) >= 1.9, (errors, orders)


ASKED = 0.02
GAIT = TravellingWave(period=1.0, bias=0.3)


def crawl(**changes: Any) -> Result:
    given: dict[str, Any] = {"actuation": GAIT, "duration": 1.0, "accuracy": ASKED, **changes}
    return simulate(Worm(), Plane(), **given)


@pytest.fixture(scope="module")
def whole() -> Result:
    return crawl()


def test_the_limit_is_that_of_fine_steps_and_the_estimate_covers_the_error(whole: Result) -> None:
    fine = crawl(accuracy=None, dt=1e-4, record_every=100)
    estimate = whole.error_estimate
    assert estimate is not None
    assert estimate.met
    assert abs(whole.distance - fine.distance) <= 2.0 * estimate.distance <= ASKED * 0.1
    turned = [run.heading[-1] - run.heading[0] for run in (whole, fine)]
    assert abs(turned[0] - turned[1]) <= 2.0 * estimate.heading
    assert whole.energy.balance_error < 1e-10
    assert 100 < estimate.steps < 1500
    assert estimate.runs == 3
    assert "estimated errors: distance" in estimate.sentence
    assert estimate.sentence in repr(whole)
    assert whole.summary()["distance_error_m"] == estimate.distance
    assert fine.summary()["distance_error_m"] is None


def test_runs_that_agree_at_their_end_by_chance_are_off_as_on_their_way() -> None:
    """Errors that swing count by their size before the end; none is below a share of what is asked."""
    problem = Problem(worm=Worm(), world=Plane(), accuracy=ASKED)
    t = np.linspace(0.0, 1.0, 101)
    swing = np.sin(2.0 * np.pi * t) * np.array([[1e-3], [2e-3], [3e-4]])
    last = t * np.array([[1.0], [0.5], [0.2]])
    found = [last + 4.0 * swing, last + swing, last]
    assert_allclose(found[1][:, -1], last[:, -1], rtol=1e-9)
    rms = np.array([1e-3, 2e-3, 3e-4]) / np.sqrt(2.0)
    factors = runs.EARLIER * 4.0 * np.array([1.0, runs.TURN_AND_WORK, runs.TURN_AND_WORK])
    assert_allclose(runs._errors_on_the_way(found, 0.02, problem), factors * rms, rtol=0.02)
    least = runs.LEAST_SHARE * 0.02 * np.array([1.0, 1.0 / problem.worm.length, 0.2])
    assert_allclose(runs._errors_on_the_way([last, last, last], 0.02, problem), least, rtol=1e-12)


def test_rows_stand_at_the_times_asked_for(whole: Result) -> None:
    """Rows lie between the ends of steps: the interpolated places agree with those of a run whose steps end there."""
    rare = crawl(dt=0.02)
    assert_allclose(whole.time, 0.01 * np.arange(101), rtol=0, atol=1e-15)
    assert_allclose(rare.time, 0.02 * np.arange(51), rtol=0, atol=1e-15)
    assert_array_equal(rare.joints, whole.joints[::2])
    assert_allclose(rare.slip[1:], whole.slip[1:].reshape(50, 2, 6, 6).sum(axis=1), rtol=0, atol=1e-15)
    assert_allclose(np.cumsum(rare.energy.elastic), np.cumsum(whole.energy.elastic)[::2], rtol=0, atol=1e-15)
    exact, fine = crawl(accuracy=0.005), crawl(accuracy=None, dt=1e-4, record_every=100)
    for name, error in {"joints": 3e-4, "points": 3e-4, "chamber_length": 3e-4, "command": 2e-3, "com": 1e-4}.items():
        assert np.abs(getattr(exact, name) - getattr(fine, name)).max() < error, name
    assert_allclose(np.linalg.norm(whole.directors, axis=-1), 1.0, rtol=0, atol=1e-4)
    assert np.abs(np.cumsum(whole.slip, axis=0) - np.cumsum(fine.slip, axis=0)).max() < 2e-3
    work = [np.cumsum(each.energy.work_contract) for each in (whole, fine)]
    assert_allclose(work[0], work[1], rtol=0, atol=0.02 * np.abs(work[1]).max())


def test_a_run_goes_on_bit_for_bit(whole: Result) -> None:
    half = crawl(duration=0.5)
    rest = crawl(duration=0.5, state=half.state)
    assert rest.time[0] == half.time[-1] == 0.5
    for name in ("joints", "normal_load", "anchors", "contact_force"):
        assert_array_equal(np.concatenate([getattr(half, name), getattr(rest, name)[1:]]), getattr(whole, name))
    for name, array in whole.state.memory.items():
        assert_array_equal(rest.state.memory[name], array, err_msg=name)


def test_an_observer_changes_nothing(whole: Result) -> None:
    seen = []
    watched = crawl(observer=lambda t, view: seen.append((t, view.com)) is None, every=30)
    assert_array_equal(watched.joints, whole.joints)
    assert [t for t, _ in seen] == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])
    for t, com in seen:
        assert_array_equal(com, whole.com[round(100 * t)])


def test_a_run_that_fails_says_when() -> None:
    def jerked(t: float) -> Command:
        return Command(np.full((6, 2), 0.1), hinge=np.full(5, 0.4 if t < 0.15 else 1.7))

    failed = crawl(actuation=jerked)
    assert failed.status is Status.FOLDED
    assert failed.error_estimate is None
    assert 0.15 < failed.stop.time < 0.6
    assert np.isfinite(failed.joints).all()
    assert len(failed.time) == len(failed.newton_iterations) + 1


def test_an_actuation_that_fails_between_two_ticks_keeps_the_whole_ones() -> None:
    def failing(t: float) -> Command:
        if t > 0.1234:
            raise RuntimeError("broken")
        return Command(np.full((6, 2), 0.1 * t))

    failed = crawl(actuation=failing)
    assert failed.status is Status.BAD_COMMAND
    assert failed.stop.reason == "RuntimeError: broken"
    assert_allclose(failed.time[-1], 0.12)


def test_a_file_keeps_the_estimate(whole: Result, tmp_path: Path) -> None:
    whole.save(tmp_path / "run.nc")
    kept = load(tmp_path / "run.nc")
    assert kept.error_estimate == whole.error_estimate
    assert whole.error_estimate is not None
    assert (whole.error_estimate + whole.error_estimate).steps == 2 * whole.error_estimate.steps
    assert_array_equal(crawl(duration=0.1, state=kept.state).joints, crawl(duration=0.1, state=whole.state).joints)


def test_controllers_decide_at_every_tick() -> None:
    class Held:
        def __init__(self) -> None:
            self.times: list[float] = []

        def reset(self) -> None:
            self.times = []

        def step(self, t: float, measurement: Any) -> Command:
            self.times.append(t)
            assert measurement.time == t
            return Command(np.full((6, 2), 0.1 * np.sin(5.0 * t) ** 2))

    controller = Held()
    run = crawl(actuation=controller, duration=0.3, dt=0.02)
    assert run.status is Status.DONE
    assert_allclose(controller.times, 0.02 * np.arange(15), rtol=0, atol=1e-15)
    assert_allclose(run.command[1:, 0, 0], 0.1 * np.sin(5.0 * run.time[:-1]) ** 2, rtol=0, atol=1e-15)


def test_a_batch_gives_what_single_runs_give(whole: Result) -> None:
    batch = simulate_batch(
        Worm(), Plane(), actuation=[GAIT, TravellingWave(period=0.7)], duration=1.0, accuracy=ASKED, threads=2
    )
    assert_array_equal(batch[0].joints, whole.joints)
    assert batch[1].error_estimate is not None


def test_what_cannot_be_met_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "MAX_REFINEMENTS", 0)
    monkeypatch.setattr(runs, "STEP_ERROR", 1e-2)
    missed = crawl(accuracy=1e-3, duration=0.5)
    assert missed.error_estimate is not None
    assert not missed.error_estimate.met
    assert "NOT as accurate as requested" in missed.error_estimate.sentence


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"accuracy": 0.0}, "accuracy: got 0.0"),
        ({"accuracy": 0.5}, "accuracy: got 0.5"),
        ({"accuracy": "fine"}, "accuracy: got 'fine'"),
        ({"integrator": "implicit_euler"}, "accuracy: got one for 'implicit_euler'"),
    ],
)
def test_wrong_accuracies(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        crawl(**wrong)


def test_a_mean_has_a_standard_error(whole: Result) -> None:
    start = State.straight(Worm(), Plane())
    states = scattered(start, 24, seed=2)
    moved = np.array([state.joints[0] - start.joints[0] for state in states])
    assert np.abs(moved).max() <= 1e-3
    assert np.ptp(moved[:, :2], axis=0).min() > 1e-3
    assert not moved[:, 2].any()
    spread = Spread.of([whole] * 24)
    assert (spread.mean, spread.standard_error, spread.count) == (pytest.approx(whole.distance), 0.0, 24)
    with pytest.raises(ValueError, match="results: got 3, must be"):
        Spread.of([whole] * 3)


def test_every_figure_has_an_error_that_holds() -> None:
    """Each figure of a crawl lies within two estimates of a run that is ten times as accurate; the clock has none."""
    crawl = TravellingWave(period=1.0, amplitude=0.25)
    asked, exact = (simulate(Worm(), Plane(), actuation=crawl, duration=4.0, accuracy=a) for a in (0.01, 0.001))
    assert asked.error_estimate is not None
    errors, found, reference = dict(asked.error_estimate.figures), asked.summary(), exact.summary()
    names = ("distance_m", "mean_speed_m_s", "speed_bl_s", "cost_of_transport", "slip_per_metre", "work_contract_J")
    for name in (*names, "roll_margin_deg", "effort"):
        assert abs(float(found[name]) - float(reference[name])) <= 2.0 * errors[name], name
    assert all(0.0 < errors[name] < 0.03 * abs(float(found[name])) for name in names)
    assert errors["duration_s"] == 0.0
    assert errors.keys().isdisjoint(runs.OF_THE_COMPUTATION | {"status", "distance_error_m"})
    assert (asked.error_estimate + asked.error_estimate).figures == ()
