"""The supervisor and its fallback: what is asked for when plans fail, and what is recorded."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.estimation.estimator import Estimate
from control.estimation.reduced import STATES, ReducedInput, ReducedModel, ReducedState
from control.gaits.steering import GaitParameters
from control.identification.identified import Identified, load
from control.loop import LONGEST_START, MOST_KEPT, NO_DECISION, STILL
from control.planning.feed_forward import FeedForward
from control.planning.gauss_newton import PlanStatus
from control.planning.mpc import GaitMPC, Plan
from control.sensing.sensors import Measurement
from control.supervisor import LATE, STANDS, UNKNOWN, Supervisor
from control.task import ControlTask
from control.tracking.paths import Circle, Line
from control.tracking.preview import turn_rate
from control.tracking.references import Constant, Reference, Steps
from worm3d import Worm

WORM = Worm()
DT = 0.01
NOTHING = Measurement(0.0)
CIRCLE = Reference(Constant(0.08), path=Circle(1.5))
INJECTED = "injected by the test"


def known() -> Identified:
    found = load(WORM)
    assert found is not None
    return found


def model() -> ReducedModel:
    return ReducedModel.of(WORM, known())


class ReducedWorm:
    """An estimator that knows all: it is the worm, and moves as the reduced model does."""

    def __init__(self, variance: float = 0.0, **begin: float) -> None:
        self._step, self._begin, self._variance = model().step(DT), begin, variance
        self.reset()

    def reset(self) -> None:
        self.state = np.array(ReducedState(0.0, 0.0, 0.0, 0.0, 0.0)._replace(**self._begin), dtype=float)
        self.states: list[np.ndarray] = []

    def take(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> None:
        if self.states:
            given = [parameters.amplitude, parameters.frequency, parameters.hinge]
            self.state = np.array(self._step(self.state, given)).ravel()
        self.states.append(self.state)

    def estimate(self, t: float) -> Estimate:
        return Estimate(t, ReducedState(*map(float, self.state)), self._variance * np.eye(STATES), None)


class Unreliable:
    """A planner of which some plans fail."""

    def __init__(self, fails, how: str = "status") -> None:
        self._own, self._fails, self._how = GaitMPC(WORM, known(), model()), fails, how
        self.calls = self.forgotten = 0

    @property
    def feed_forward(self) -> FeedForward:
        return self._own.feed_forward

    def reset(self) -> None:
        self.calls = self.forgotten = 0
        self._own.reset()

    def forget(self) -> None:
        self.forgotten += 1
        self._own.forget()

    def plain(self, t: float, slip: float, reference: Reference) -> ReducedInput:
        return self._own.plain(t, slip, reference)

    def plan(self, t: float, estimate: Estimate, reference: Reference) -> Plan:
        self.calls += 1
        if not self._fails(self.calls):
            return self._own.plan(t, estimate, reference)
        if self._how == "raises":
            raise RuntimeError(INJECTED)
        made = self._own.plan(t, estimate, reference)
        return replace(made, status=PlanStatus.NOT_SOLVED) if self._how == "status" else replace(made, seconds=99.0)


def run(planner, duration: float, reference: Reference = CIRCLE, worm: ReducedWorm | None = None, **more) -> Supervisor:
    """Return the supervisor of a worm that is its reduced model, after a run."""
    supervisor = Supervisor(ControlTask(WORM, reference, known()), model(), worm or ReducedWorm(), planner, **more)
    for k in range(round(duration / DT)):
        supervisor.step(k * DT, NOTHING)
    return supervisor


def sources(supervisor: Supervisor) -> list[str]:
    return [decision.source for decision in supervisor.decisions]


def speed_of(supervisor: Supervisor) -> float:
    """Return the mean speed after two waves [m/s]."""
    worm = supervisor.estimator
    assert isinstance(worm, ReducedWorm)
    return float(np.mean([(1.0 - state[5]) * state[3] for state in worm.states[250:]]))


def test_every_decision_is_written_down() -> None:
    supervisor = run(Unreliable(lambda call: False), 3.0)
    assert sources(supervisor) == ["mpc"] * 15
    assert_allclose([decision.time for decision in supervisor.decisions], np.arange(15) * 0.2)
    for decision in supervisor.decisions:
        assert decision.status in (PlanStatus.OPTIMAL.value, PlanStatus.BETTER.value)
        assert decision.iterations >= 1
        assert np.isfinite(decision.cost)
        assert decision.seconds > 0.0
        assert decision.estimate is not None
        assert decision.estimate.time == decision.time
        assert decision.horizon is not None
        assert_allclose(decision.horizon[0], decision.estimate.position)
    assert supervisor.failures == 0
    assert supervisor.decisions[-1].parameters.hinge > 0.0


@pytest.mark.slow
def test_thirty_percent_of_failures_cost_two_percent_of_the_speed_at_most() -> None:
    whole = speed_of(run(Unreliable(lambda call: False), 20.0))
    chance = np.random.default_rng(8).random(200) < 0.3
    for how in ("status", "raises"):
        supervisor = run(Unreliable(lambda call: bool(chance[call]), how), 20.0)
        assert abs(speed_of(supervisor) / whole - 1.0) < 0.02
        assert supervisor.failures == sources(supervisor).count("shifted plan") > 20


def test_the_fallback_step_by_step() -> None:
    """One plan, then none: it goes on five times, then the plain wave follows for good."""
    supervisor = run(Unreliable(lambda call: call > 1), 4.0)
    assert sources(supervisor) == ["mpc"] + ["shifted plan"] * MOST_KEPT + ["gait"] * (19 - MOST_KEPT)
    first, plain = supervisor.decisions[0], supervisor.decisions[-1]
    assert plain.status == PlanStatus.NOT_SOLVED.value
    found = known().maps["hinge"]
    given = plain.parameters.amplitude, plain.parameters.frequency, plain.parameters.hinge
    assert found.speed(*given) == pytest.approx(0.08, rel=1e-2)
    assert found.turn_rate(*given) == pytest.approx(0.08 / 1.5, rel=1e-2)
    assert first.horizon is not None
    assert plain.horizon is None


def test_a_shifted_plan_is_that_plan_as_it_goes_on() -> None:
    planner = Unreliable(lambda call: call > 1)
    supervisor = run(planner, 1.0)
    expected = GaitMPC(WORM, known(), model()).plan(0.0, ReducedWorm().estimate(0.0), CIRCLE)
    for decision in supervisor.decisions:
        given = decision.parameters
        assert_allclose([given.amplitude, given.frequency, given.hinge], expected.at(decision.time))


def test_from_the_start_without_any_plan_it_crawls_all_the_same() -> None:
    supervisor = run(Unreliable(lambda call: True), 20.0)
    assert set(sources(supervisor)) == {"gait"}
    assert speed_of(supervisor) == pytest.approx(0.08, rel=0.02)
    worm = supervisor.estimator
    assert isinstance(worm, ReducedWorm)
    assert (worm.states[-1][2] - worm.states[500][2]) / 14.99 == pytest.approx(0.08 / 1.5, rel=0.02)


class OddError(Exception):
    """An exception that nobody knows of."""


def none_at_all(plan: Plan) -> object:
    return None


def raising(error: Exception):
    def raises(plan: Plan) -> object:
        raise error

    return raises


SPOILT = {
    "of its own": raising(OddError("what is this")),
    "key": raising(KeyError("x")),
    "index": raising(IndexError()),
    "assertion": raising(AssertionError()),
    "type": raising(TypeError("no")),
    "memory": raising(MemoryError()),
    "stop iteration": raising(StopIteration()),
    "nothing": none_at_all,
    "a text": lambda plan: "a plan",
    "nan": lambda plan: replace(plan, inputs=plan.inputs * np.nan),
    "one nan": lambda plan: replace(plan, inputs=np.where(np.arange(3) == 1, np.nan, plan.inputs)),
    "two columns": lambda plan: replace(plan, inputs=plan.inputs[:, :2]),
    "no step": lambda plan: replace(plan, inputs=plan.inputs[:0]),
    "no array": lambda plan: replace(plan, inputs="inputs"),
    "no parameters": lambda plan: replace(plan, parameters=None),
    "horizon": lambda plan: replace(plan, horizon=np.zeros((2, 2))),
    "nan horizon": lambda plan: replace(plan, horizon=plan.horizon * np.nan),
    "outside": lambda plan: replace(plan, parameters=GaitParameters(0.3, 0.8, hinge=3.0)),
    "far outside": lambda plan: replace(plan, inputs=plan.inputs + 10.0),
    "cost": lambda plan: replace(plan, cost="cheap"),
    "status": lambda plan: replace(plan, status="fine"),
    "step": lambda plan: replace(plan, step=0.0),
}


class Spoilt(Unreliable):
    """A planner of which every other plan is spoilt, and which cannot even forget or say what the plain wave is."""

    def __init__(self, how: str, plain: bool = True) -> None:
        super().__init__(lambda call: False)
        self._spoil, self._plain = SPOILT[how], plain

    def plan(self, t: float, estimate: Estimate, reference: Reference) -> Plan:
        made = super().plan(t, estimate, reference)
        return self._spoil(made) if self.calls % 2 == 0 or not self._plain else made  # type: ignore[return-value]

    def forget(self) -> None:
        raise OddError("forgotten")

    def plain(self, t: float, slip: float, reference: Reference) -> ReducedInput:
        if self._plain:
            return super().plain(t, slip, reference)
        raise OddError("plain")


@pytest.mark.parametrize("how", SPOILT)
def test_whatever_a_planner_does_the_next_best_follows(how: str) -> None:
    supervisor = run(Spoilt(how), 2.0)
    assert sources(supervisor) == ["mpc", "shifted plan"] * 5
    assert supervisor.failures == 5
    reasons = {decision.status for decision in supervisor.decisions if decision.failed}
    assert len(reasons) == 1
    assert reasons.isdisjoint({""})


def test_with_nothing_but_exceptions_parameters_are_kept_and_then_it_rests() -> None:
    supervisor = run(Spoilt("of its own", plain=False), 3.0)
    assert sources(supervisor) == ["gait"] * MOST_KEPT + ["stop"] * (15 - MOST_KEPT)
    assert supervisor.decisions[0].status == "OddError: what is this"


def test_five_failures_in_a_row_clear_the_memory() -> None:
    planner = Unreliable(lambda call: call in (2, 3, 4, 5, 7, 8, 9, 10, 11, 13))
    run(planner, 2.8)
    assert planner.forgotten == 1
    planner = Unreliable(lambda call: call > 1)
    run(planner, 0.2 * (1 + 2 * MOST_KEPT))
    assert planner.forgotten == 2


def test_without_a_finite_reference_parameters_are_kept_and_then_it_rests() -> None:
    def heading(t):
        return np.where(np.asarray(t) < 1.0, 0.0, np.nan)

    def speed(t):
        return np.where(np.asarray(t) < 1.0, 0.08, np.nan)

    supervisor = run(Unreliable(lambda call: False), 5.0, Reference(speed, heading=heading))
    # Of the horizon, some is unknown from the beginning: the plain wave, kept from 1 s on, and rest.
    assert sources(supervisor) == ["gait"] * (5 + MOST_KEPT) + ["stop"] * (20 - MOST_KEPT)
    assert len({d.parameters for d in supervisor.decisions[4 : 5 + MOST_KEPT]}) == 1
    assert supervisor.decisions[4].parameters.amplitude > 0.2
    last = supervisor.decisions[-1]
    assert (last.parameters.amplitude, last.status) == (0.0, NO_DECISION)


def test_a_lost_estimate_leaves_the_plain_wave() -> None:
    supervisor = run(Unreliable(lambda call: False), 1.0, worm=ReducedWorm(x=np.nan, slip=np.nan))
    assert set(sources(supervisor)) == {"gait"}
    assert supervisor.decisions[-1].status == PlanStatus.NOT_FINITE.value
    assert supervisor.decisions[-1].parameters.amplitude > 0.2


@pytest.mark.parametrize("reference", [CIRCLE, Reference(CIRCLE.speed, path=Line()), Reference(CIRCLE.speed)])
def test_it_goes_straight_or_as_the_path_turns_until_the_heading_is_known(reference: Reference) -> None:
    supervisor = run(Unreliable(lambda call: False), 6.0, reference, ReducedWorm(heading=1.0, variance=1.0))
    waiting = [d for d in supervisor.decisions if d.source == "gait"]
    assert {d.status for d in waiting} == {UNKNOWN}
    turn = turn_rate(reference, 0.0, 0.0)
    assert (turn > 0.04) == (reference is CIRCLE)
    expected = GaitMPC(WORM, known(), model()).feed_forward(float(reference.speed(0.0)), turn)
    assert {d.parameters for d in waiting} == {model().parameters(expected)}
    assert waiting[-1].time == pytest.approx(LONGEST_START / 0.8, abs=0.2)
    assert set(sources(supervisor)[len(waiting) :]) == {"mpc"}
    assert supervisor.failures == 0


def test_it_rests_while_no_speed_is_asked_for_and_goes_on_after() -> None:
    reference = Reference(Steps(0.08, (2.0, 4.0), (0.0, 0.08)), path=Line())
    supervisor = run(Unreliable(lambda call: False), 6.0, reference)
    assert sources(supervisor) == ["mpc"] * 10 + ["stop"] * 10 + ["mpc"] * 10
    resting = supervisor.decisions[10:20]
    moving = supervisor.decisions[9].parameters
    still = {(d.parameters.amplitude, d.parameters.frequency, d.parameters.hinge, d.status) for d in resting}
    assert still == {(moving.amplitude, STILL, moving.hinge, STANDS)}
    assert supervisor.failures == 0


def test_late_plans_count_only_where_the_clock_on_the_wall_does() -> None:
    def late(call: int) -> bool:
        return call == 2

    assert sources(run(Unreliable(late, "late"), 0.6)) == ["mpc"] * 3
    strict = run(Unreliable(late, "late"), 0.6, deadline="wall")
    assert strict.decisions[1].status == LATE
    assert strict.decisions[1].source == "shifted plan"


def test_overruns_are_control_periods_that_took_longer_than_they_last() -> None:
    supervisor = run(Unreliable(lambda call: False), 1.0)
    supervisor.decisions = [replace(d, seconds=0.3 * (k % 2)) for k, d in enumerate(supervisor.decisions)]
    assert supervisor.overruns == 2


def test_a_reset_begins_anew() -> None:
    supervisor = run(Unreliable(lambda call: call % 3 == 0), 2.0)
    before = [(d.source, d.parameters) for d in supervisor.decisions]
    supervisor.reset()
    assert not supervisor.decisions
    for k in range(200):
        supervisor.step(k * DT, NOTHING)
    assert [(d.source, d.parameters) for d in supervisor.decisions] == before


def test_commands_are_those_of_the_wave_that_is_asked_for() -> None:
    supervisor = run(Unreliable(lambda call: False), 2.0, Reference(Constant(0.08)))
    assert supervisor.generator.parameters is not None
    asked, given = supervisor.decisions[-1].parameters, supervisor.generator.parameters
    assert_allclose(given.row(), asked.row(), rtol=2e-2)
    command = supervisor.step(2.0, NOTHING)
    assert command.contraction.max() <= asked.amplitude * 1.02
    assert_allclose(command.hinge, 0.0)


def test_there_is_no_such_deadline() -> None:
    with pytest.raises(ValueError, match="deadline: got 'never', must be 'iterations' or 'wall'"):
        run(Unreliable(lambda call: False), 0.0, deadline="never")
