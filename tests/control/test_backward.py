"""Waves that go backwards: half a turn of the worm about the vertical, in the plant, the filter and the planner."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from control.baselines import PiLineOfSight
from control.estimation.estimate import Estimate
from control.estimation.reduced import STATES, ReducedModel, ReducedState
from control.estimation.wave import InputHistory, MeasuredWave
from control.faults.rules import faults
from control.faults.watch import Watch
from control.gaits.steering import GaitParameters, Schedule, SteeredWave, WaveGenerator
from control.identification.identified import is_reversible, load
from control.planning.feed_forward import FeedForward
from control.planning.mpc import GaitMPC
from control.sensing.sensors import Measurement
from control.supervisor import ARRIVED, BACKWARDS, Supervisor
from control.task import ControlTask
from control.tracking.paths import Circle, Line
from control.tracking.preview import look_ahead, speed_at
from control.tracking.references import Constant, Reference, Steps
from worm3d import Friction, Plane, Worm, simulate

WORM, SCHEDULE = Worm(), Schedule()
ALIKE = Friction(forward=0.1, backward=0.1, lateral=0.1)
AHEAD = GaitParameters(0.3, 0.8, bias=0.02, hinge=0.08)
BACK = replace(AHEAD, amplitude=-0.3)
KNOWN = replace(load(WORM), backward=True)
MODEL = ReducedModel.of(WORM, KNOWN, "both")
BEGIN = ReducedState(0.02, 0.05, 0.1, -0.03, 0.02, slip=0.1, yaw_bias=0.004, drift=0.003, steering=0.2, crab=0.05)
PLACE = (0.0, 0.0)


def turned(state):
    """Return the state of the worm whose tail is called its head."""
    return state._replace(heading=state.heading + np.pi, speed=-state.speed, drift=-state.drift)


def crawled(friction, parameters):
    return simulate(WORM, Plane(), ground=friction, actuation=SteeredWave(parameters, SCHEDULE), duration=3.75)


@pytest.mark.parametrize("direction", ["retrograde", "direct"])
def test_the_wave_is_that_of_the_worm_turned_round(direction):
    schedule, phase = Schedule(direction=direction), np.linspace(0.0, 9.0, 7)
    ahead, back = (schedule.commands_at(phase, np.tile(p.row(), (7, 1)), WORM) for p in (AHEAD, BACK))
    assert_array_equal(back.contraction, ahead.contraction[:, ::-1, ::-1])
    assert_array_equal(back.hinge, -ahead.hinge[:, ::-1])


def test_on_friction_that_is_alike_both_ways_the_plant_does_the_same_backwards():
    ahead, back = crawled(ALIKE, AHEAD), crawled(ALIKE, BACK)
    middle = ahead.com[0, :2]
    assert_allclose(back.com[:, :2] - middle, middle - ahead.com[:, :2], rtol=0.0, atol=1e-11)
    assert_allclose(back.heading, ahead.heading, rtol=0.0, atol=1e-11)
    assert middle[0] - back.com[-1, 0] > 0.07 * WORM.length
    assert ahead.heading[-1] > 0.2


def test_bristles_do_not_let_it_go_backwards():
    straight = GaitParameters(-0.3, 0.8)
    assert crawled(Friction(), straight).com[-1, 0] > crawled(ALIKE, straight).com[-1, 0] + 0.1


def test_which_worms_are_reversible():
    assert is_reversible(WORM, ALIKE)
    assert not is_reversible(WORM, Friction())
    stiff_head = Worm(k_spring=np.linspace(10.0, 15.0, WORM.segments))
    assert not is_reversible(stiff_head, ALIKE)
    assert is_reversible(Worm(k_spring=np.array([15.0, 12.0, 10.0, 10.0, 12.0, 15.0])), ALIKE)
    assert not is_reversible(WORM, replace(ALIKE, lateral=np.linspace(0.1, 0.2, WORM.segments)))


def test_the_generator_goes_over_without_jumps():
    generator, dt = WaveGenerator(SCHEDULE, WORM), 0.002
    plain = [generator.step(dt, AHEAD) for _ in range(3000)]
    over = [generator.step(dt, BACK) for _ in range(6000)]
    jumps = [np.abs(np.diff([getattr(c, name) for c in run], axis=0)).max()
             for name in ("contraction", "hinge") for run in (plain[1500:], [plain[-1], *over])]  # fmt: skip
    assert jumps[1] < 3.0 * jumps[0]
    assert jumps[3] < 3.0 * jumps[2]
    end = SCHEDULE.commands_at(np.array([generator.phase]), generator.parameters.row()[None], WORM)
    assert_array_equal(over[-1].contraction, end.contraction[0])
    assert generator.parameters.amplitude == pytest.approx(-0.3)


def test_a_wave_that_is_called_back_at_once_goes_on():
    generator = WaveGenerator(SCHEDULE, WORM)
    for target in (AHEAD, BACK, AHEAD):
        for _ in range(20):
            generator.step(0.01, target)
    assert 0.1 < generator.parameters.amplitude < 0.3


def test_the_reduced_model_is_that_of_the_worm_turned_round():
    rate = np.array(MODEL.dynamics(list(BEGIN), [-0.25, 0.7, 0.4])).ravel()
    other = np.array(MODEL.dynamics(list(turned(BEGIN)), [0.25, 0.7, 0.4])).ravel()
    signs = ReducedState(*np.ones(STATES))._replace(speed=-1.0, drift=-1.0)
    assert_allclose(rate, np.array(signs) * other, rtol=0.0, atol=1e-15)
    assert rate[3] < 0.0


def test_the_measured_wave_rocks_the_other_way():
    ahead, back = MeasuredWave(6, SCHEDULE), MeasuredWave(6, SCHEDULE)
    for phase in np.linspace(0.0, 12.0, 80):
        commands = SCHEDULE.commands_at(np.array([phase]), np.array([[0.3, 0.8, 0.0, 0.0]]), WORM)
        ahead.take(-commands.contraction[0], phase)
        back.take(-commands.contraction[0, ::-1, ::-1], phase, back=True)
    assert np.linalg.norm(ahead.at(1.0)) > 0.1
    assert_allclose(back.at(1.0), -ahead.at(1.0), rtol=1e-12)


def test_the_history_tells_which_way_the_wave_went():
    history = InputHistory(1.0)
    for t, amplitude in ((0.0, 0.3), (0.1, 0.3), (0.2, -0.3)):
        history.add(t, np.array([amplitude, 0.8, 0.0]), 0.0)
    assert [history.is_back(t) for t in (0.05, 0.1, 0.15, 0.2, 0.3)] == [False, False, True, True, True]


@pytest.mark.parametrize(
    ("path", "other"),
    [
        (Line(PLACE), Line(PLACE, np.pi)),
        (Circle(1.0, PLACE), Circle(1.0, PLACE, np.pi, "right")),
    ],
    ids=["line", "circle"],
)
@pytest.mark.parametrize("make", ["mpc", "line of sight"])
def test_backwards_is_forwards_of_the_worm_turned_round(path, other, make):
    found = []
    for reference, state in (
        (Reference(Constant(-0.05), path=path), BEGIN),
        (Reference(Constant(0.05), path=other), turned(BEGIN)),
    ):
        estimate = Estimate(0.0, state, np.zeros((STATES, STATES)), None)
        if make == "mpc":
            found.append(GaitMPC(WORM, KNOWN, MODEL).plan(0.0, estimate, reference).inputs)
        else:
            controller = PiLineOfSight(ControlTask(WORM, reference, KNOWN, "both"))
            parameters = controller._choose(0.0, estimate).parameters
            found.append(np.array([[parameters.amplitude, parameters.frequency, parameters.steering("both")]]))
    back, ahead = found
    assert back[0, 0] < 0.0 < ahead[0, 0]
    assert np.abs(ahead[:, 2]).max() > 0.05
    assert_allclose(back, ahead * [-1.0, 1.0, 1.0], rtol=0.0, atol=1e-7)


def test_a_plan_goes_over_where_the_reference_does():
    state = ReducedState(0.0, 0.0, 0.0, 0.05, 0.0)
    reference = Reference(Steps(0.05, (2.0,), (-0.05,)), path=Line())
    plan = GaitMPC(WORM, KNOWN, MODEL).plan(0.0, Estimate(0.0, state, np.zeros((STATES, STATES)), None), reference)
    assert plan.status.ok
    assert_array_equal(np.sign(plan.inputs[:, 0]), [1.0] * 4 + [-1.0] * 12)
    sizes = np.abs(plan.inputs[:, 0])
    assert sizes.min() > 0.9 * sizes[-1]  # going over is no change of the amplitude


def test_the_way_ahead_says_which_way():
    steps = Reference(Steps(0.05, (1.0, 2.0, 3.0), (-0.05, 0.0, 0.05)), path=Line())
    ahead = look_ahead(steps, 0.0, 0.5, 8, np.zeros(2), 0.0, None)
    assert_array_equal(ahead.ways, [1, -1, -1, -1, -1, 1, 1, 1])


def test_a_path_that_ends_begins_somewhere():
    reference = Reference(Constant(-0.1), path=Line(length=1.0), ends=True)
    assert_allclose(speed_at(reference, np.zeros(3), np.array([0.0, 0.1, 1.0])), [0.0, -0.04, -0.1])
    forward = Reference(Constant(0.1), path=Line(length=1.0), ends=True)
    assert_allclose(speed_at(forward, np.zeros(3), np.array([0.0, 0.9, 1.0])), [0.1, 0.04, 0.0])


class Known:
    """Estimates of a worm that is at rest at a place."""

    def __init__(self, x):
        self.x = x

    def reset(self):
        pass

    def take(self, t, measurement, parameters, phase):
        pass

    def estimate(self, t):
        return Estimate(t, ReducedState(self.x, 0.0, 0.0, 0.0, 0.0), np.zeros((STATES, STATES)), None)


@pytest.mark.parametrize(
    ("speed", "x", "known", "status"),
    [
        (-0.05, 0.5, KNOWN, None),
        (-0.05, 0.001, KNOWN, ARRIVED),
        (0.05, 0.001, KNOWN, None),
        (0.05, 0.999, KNOWN, ARRIVED),
        (-0.05, 0.999, KNOWN, None),
        (-0.05, 0.5, load(WORM), BACKWARDS),
    ],
)
def test_the_supervisor_goes_back_to_the_begin_of_a_path(speed, x, known, status):
    reference = Reference(Constant(speed), path=Line(length=1.0), ends=True)
    driver = Supervisor(ControlTask(WORM, reference, known, "both"), MODEL, Known(x), GaitMPC(WORM, known, MODEL))
    driver.step(0.0, Measurement(0.0))
    chosen = driver.decisions[-1]
    if status is None:
        assert chosen.source == "mpc"
        assert chosen.parameters.amplitude * speed > 0.0
    else:
        assert (chosen.source, chosen.status) == ("stop", status)


@pytest.mark.parametrize(("x", "rests"), [(0.999, True), (0.5, False)])
def test_a_worm_that_rests_at_its_end_stays_there_though_its_place_is_forgotten(x, rests):
    class Forgetful(Known):
        def estimate(self, t):
            return replace(super().estimate(t), covariance=(0.0 if t < 1.0 else 100.0) * np.eye(STATES))

    reference = Reference(Constant(0.05), path=Line(length=1.0), ends=True)
    task = ControlTask(WORM, reference, KNOWN, "both")
    driver = Supervisor(task, MODEL, Forgetful(x), GaitMPC(WORM, KNOWN, MODEL))
    for t in (0.0, 0.5, 1.0, 1.5):
        driver.step(t, Measurement(t))
    assert [each.status == ARRIVED for each in driver.decisions] == [rests] * 4


def test_the_watch_counts_the_way_backwards():
    able = FeedForward(KNOWN.maps["both"], WORM.length, backward=True)
    watch = Watch(WORM, Reference(Constant(-0.08), path=Line()), able)
    watch._parameters = replace(BACK, amplitude=-0.4)
    wave = watch._wave(0.0, 1.0, None)
    assert (wave.back, wave.least_asked, wave.at_limit) == (True, 0.08, False)
    place = [replace(wave, end=float(k), place=np.array([-0.08 * k, 0.0]), place_time=float(k), place_error=0.0,
                     ahead=0.0, gain=np.ones((6, 2)), gain_error=np.zeros((6, 2)), bend=0.0, numb=False)
             for k in range(5)]  # fmt: skip
    assert list(faults(place)) == []
    wrong = [replace(each, place=-each.place) for each in place]
    assert [fault.kind for fault in faults(wrong)] == ["too slow"]
