"""The baselines: their laws against numbers, mirror images, and what they do where feedback must not."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.baselines import Gains, OpenLoop, PiLineOfSight
from control.estimation.estimator import Estimate
from control.estimation.reduced import STATES, ReducedState
from control.gaits.steering import GaitParameters
from control.identification import identified as kept
from control.loop import MOST_KEPT
from control.sensing.sensors import Measurement
from control.task import ControlTask
from control.tracking.paths import Circle, Line, SCurve
from control.tracking.references import Constant, Reference, Sine, Steps
from worm3d import Worm

WORM = Worm()
KNOWN_WORM = kept.load(WORM)
assert KNOWN_WORM is not None
MAP = KNOWN_WORM.maps["hinge"]
NOTHING = Measurement(0.0)


class Told:
    """An estimator that is told the state."""

    def __init__(self, state: ReducedState, deviation: float = 0.01) -> None:
        self.state, self.covariance = state, deviation**2 * np.eye(STATES)

    def reset(self) -> None:
        """Nothing to forget."""

    def take(self, t: float, measurement: Measurement, parameters: GaitParameters, phase: float) -> None:
        """Nothing to learn."""

    def estimate(self, t: float) -> Estimate:
        return Estimate(t, self.state, self.covariance, None)


def at(x: float = 0.0, y: float = 0.0, heading: float = 0.0, speed: float = 0.08, slip: float = 0.0) -> ReducedState:
    return ReducedState(x, y, heading, speed, 0.0, slip)


def pi_los(reference: Reference, state: ReducedState, deviation: float = 0.01, **gains: float) -> PiLineOfSight:
    told = Told(state, deviation)
    return PiLineOfSight(ControlTask(WORM, reference, KNOWN_WORM), told, replace(Gains(), **gains))


def open_loop(reference: Reference, **asked: Any) -> OpenLoop:
    return OpenLoop(ControlTask(WORM, reference, KNOWN_WORM, **asked))


def first(controller: OpenLoop | PiLineOfSight) -> GaitParameters:
    controller.step(0.0, NOTHING)
    return controller.decisions[0].parameters


def made(parameters: GaitParameters) -> tuple[float, float]:
    """Return the speed and turn rate of a wave by the map."""
    wave = (parameters.amplitude, parameters.frequency, parameters.hinge)
    return float(MAP.speed(*wave)), float(MAP.turn_rate(*wave))


def test_open_loop_is_the_wave_of_the_map() -> None:
    controller = open_loop(Reference(Constant(0.08), path=Circle(1.5)))
    assert_allclose(made(first(controller)), (0.08, 0.08 / 1.5), rtol=5e-3)
    assert controller.decisions[0].estimate is None


def test_open_loop_goes_along_the_path_at_the_speed_asked_for() -> None:
    path = SCurve()
    controller = open_loop(Reference(Constant(0.08), path=path), period=0.1)
    for k in range(2001):
        controller.step(0.01 * k, NOTHING)
    assert len(controller.decisions) == 201
    last = controller.decisions[-1]
    assert last.time == pytest.approx(20.0)
    assert made(last.parameters)[1] == pytest.approx(0.08 * float(path.curvature(0.08 * 20.0)), rel=5e-3)


def test_without_a_miss_feedback_adds_nothing() -> None:
    reference = Reference(Constant(0.08), path=Line())
    assert first(pi_los(reference, at())).row() == pytest.approx(first(open_loop(reference)).row())


def test_the_speed_law_is_proportional_and_integral() -> None:
    reference = Reference(Constant(0.08), path=Line())
    controller = pi_los(reference, at(speed=0.08, slip=0.1), speed=0.5, speed_integral=0.25)
    for k in range(11):
        controller.step(0.2 * k, NOTHING)
    miss = 0.008
    speeds = [made(decision.parameters)[0] for decision in controller.decisions]
    assert_allclose(speeds, [0.08 + 0.5 * miss + 0.25 * miss * 0.2 * k for k in range(11)], rtol=2e-3)


def test_the_integral_stands_still_where_the_worm_cannot_go_faster() -> None:
    reference = Reference(Steps(0.5, (10.0,), (0.08,)), path=Line())
    controller = pi_los(reference, at(speed=0.12))
    for k in range(60):
        controller.step(0.2 * k, NOTHING)
    fastest = max(float(MAP.speed(a, f, 0.0)) for a in (0.35, 0.4) for f in (1.1, 1.25))
    assert made(controller.decisions[40].parameters)[0] == pytest.approx(fastest, rel=0.05)
    after = 0.08 + Gains().speed * (0.08 - 0.12)  # and no more: nothing was summed up
    assert made(controller.decisions[50].parameters)[0] == pytest.approx(after, rel=5e-3)


@pytest.mark.parametrize(("y", "heading"), [(0.1, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.1, -0.1)])
def test_line_of_sight_is_its_law(y: float, heading: float) -> None:
    controller = pi_los(Reference(Constant(0.08), path=Line()), at(y=y, heading=heading), heading=0.3, reach=0.5)
    assert made(first(controller))[1] == pytest.approx(0.3 * (-math.atan(y / 0.5) - heading), rel=5e-3, abs=1e-4)


def test_a_heading_is_approached_the_short_way_round() -> None:
    reference = Reference(Constant(0.08), heading=Constant(math.pi - 0.1))
    controller = pi_los(reference, at(heading=-math.pi + 0.1), heading=0.3)
    assert made(first(controller))[1] == pytest.approx(-0.3 * 0.2, rel=5e-3)


def test_a_turning_heading_is_fed_forward() -> None:
    reference = Reference(Constant(0.08), heading=Sine(0.0, 0.5, 40.0))
    rate = 0.5 * 2 * math.pi / 40.0
    assert made(first(pi_los(reference, at())))[1] == pytest.approx(rate, rel=1e-2)


def test_it_turns_as_the_path_does_until_the_heading_is_known() -> None:
    unknown = pi_los(Reference(Constant(0.08), path=Circle(1.5)), at(y=0.3, heading=0.5), deviation=1.0)
    assert made(first(unknown)) == pytest.approx((0.08, 0.08 / 1.5), rel=1e-2)


def test_it_goes_straight_until_the_heading_is_known() -> None:
    controller = pi_los(Reference(Constant(0.08), path=Line()), at(y=0.3), deviation=1.0)
    for k in range(2 * 125 * 2):
        controller.step(0.01 * k, NOTHING)
    steered = [decision.parameters.hinge != 0.0 for decision in controller.decisions]
    begun = controller.decisions[steered.index(True)].time
    assert 3.0 / 0.8 < begun < 3.0 / 0.8 + 0.5, "after three waves whatever is known is used"
    assert all(steered[steered.index(True) :])


def test_it_stands_where_hardly_any_speed_is_asked_for() -> None:
    for make in (lambda r: open_loop(r), lambda r: pi_los(r, at(speed=0.0))):
        parameters = first(make(Reference(Constant(0.0), path=Circle(1.5))))
        assert (parameters.amplitude, parameters.hinge) == (0.0, 0.0)


def test_mirrored_worms_are_steered_in_mirror_images() -> None:
    left = pi_los(Reference(Constant(0.08), path=Circle(1.5)), at(0.2, 0.1, 0.3))
    right = pi_los(Reference(Constant(0.08), path=Circle(1.5, towards="right")), at(0.2, -0.1, -0.3))
    for k in range(300):
        one, other = (controller.step(0.01 * k, NOTHING) for controller in (left, right))
        assert_allclose(other.contraction, one.contraction[:, ::-1], atol=1e-12)
        assert_allclose(other.hinge, -one.hinge, atol=1e-12)
    assert abs(left.decisions[-1].parameters.hinge) > 0.01


def test_reset_begins_anew() -> None:
    controller = pi_los(Reference(Constant(0.08), path=Line()), at(y=0.1, slip=0.1))
    runs = []
    for _ in range(2):
        controller.reset()
        commands = [controller.step(0.01 * k, NOTHING) for k in range(150)]
        runs.append((np.array([c.contraction for c in commands]), [d.parameters for d in controller.decisions]))
    assert np.array_equal(runs[0][0], runs[1][0])
    assert runs[0][1] == runs[1][1]
    assert len(runs[0][1]) == 8


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: open_loop(Reference(Constant(0.1)), period=0.0), "period: got 0.0 s"),
        (lambda: open_loop(Reference(Constant(0.1)), mechanism="tail"), "mechanism: got 'tail', must be one of"),
        (lambda: Gains(reach=0.0), "reach: got 0.0 body lengths, must be finite and above 0"),
        (lambda: Gains(speed=-1.0), "speed: got -1.0"),
    ],
)
def test_mistakes_are_told(make: Callable[[], object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        make()


@pytest.mark.parametrize("kind", [OpenLoop, PiLineOfSight])
def test_a_reference_that_raises_leaves_the_parameters_in_force_and_then_rest(kind) -> None:
    """The watch for faults, which looks at the reference too, goes on."""

    class LostError(Exception):
        pass

    def speed(t):
        if np.max(t) > 1.0:
            raise LostError("no speed")
        return 0.08 + 0.0 * np.asarray(t)

    controller = kind(ControlTask(WORM, Reference(speed), KNOWN_WORM))
    for k in range(400):
        t = 0.01 * k
        command = controller.step(t, Measurement(t))
        assert np.isfinite(command.contraction).all()
    decisions = controller.decisions
    assert [decision.source for decision in decisions] == (
        [controller.source] * 6 + ["gait"] * MOST_KEPT + ["stop"] * (14 - MOST_KEPT)
    )
    assert decisions[6].parameters == decisions[5].parameters
    assert decisions[6].status == "LostError: no speed"
    assert controller.failures == 14


def test_failures_in_a_row_are_counted_from_the_last_choice_on() -> None:
    """A reference that is lost for four decisions, known for one, and lost for four again: never a reason to rest."""

    def speed(t):
        if round(float(np.max(t)) / 0.2) % 5:
            raise ValueError("no speed")
        return 0.08 + 0.0 * np.asarray(t)

    assert MOST_KEPT == 5
    controller = open_loop(Reference(speed))
    for k in range(15):
        controller.step(0.2 * k, Measurement(0.2 * k))
    assert [decision.source for decision in controller.decisions] == ["open_loop", *["gait"] * 4] * 3
