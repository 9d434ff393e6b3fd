"""Steering of a worm of which one segment is held still."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.controllers import made
from control.estimation.estimator import Estimator
from control.gaits.held import HeldSchedule, HeldSteering, held_schedule, purely_turning
from control.gaits.steering import GaitParameters, Schedule, SteeredWave
from control.identification.identified import Design, Identified, load
from control.loop import WaveController
from control.sensing.sensors import Measurement
from control.task import ControlTask
from control.tracking.paths import Line
from control.tracking.references import Constant, Reference
from scenes.models.control import identify
from worm3d import Friction, Worm

WORM, GROUND = Worm(), Friction()
SUBJECT = identify.Subject(WORM, GROUND, Schedule())
PHASES = np.linspace(0.0, 2.0 * np.pi, 7)
RANDOM = np.random.default_rng(3)
UNEQUAL = tuple(HeldSteering(tuple(map(tuple, RANDOM.uniform(-1.0, 1.0, (2, 5)).tolist())), 0.1) for _ in range(6))


def known() -> Identified:
    found = load(WORM)
    assert found is not None
    return found


def rows(*parameters: float) -> np.ndarray:
    """Return the same parameters at each of the phases."""
    return np.tile(parameters, (len(PHASES), 1))


def test_hinges_follow_their_own_pattern_and_the_segment_rests() -> None:
    usual, held = Schedule(), held_schedule(Schedule(), 2, UNEQUAL)
    given = held.commands_at(PHASES, rows(0.3, 0.8, 0.02, 0.1), WORM)
    ahead = PHASES + 2.0 * np.pi * usual.lead * 0.8
    a, b = np.array(UNEQUAL[2].hinges)
    assert_allclose(given.hinge, 0.1 * (np.outer(np.cos(ahead), a) + np.outer(np.sin(ahead), b)), rtol=0, atol=1e-15)
    others = np.arange(6) != 2
    straight = usual.commands_at(PHASES, rows(0.3, 0.8, 0.0, 0.0), WORM).contraction
    assert_array_equal(given.contraction[:, others], straight[:, others])
    assert_array_equal(given.contraction[:, 2], 0.0)


def test_backwards_it_is_the_worm_turned_round() -> None:
    """(S3): the commands of -A are those of A with the segment of the same place from the other end held."""
    back = held_schedule(Schedule(), 1, UNEQUAL).commands_at(PHASES, rows(-0.3, 0.8, 0.0, 0.1), WORM)
    ahead = held_schedule(Schedule(), 4, UNEQUAL).commands_at(PHASES, rows(0.3, 0.8, 0.0, 0.1), WORM)
    assert_allclose(back.contraction, ahead.contraction[:, ::-1, ::-1], rtol=0, atol=1e-15)
    assert_allclose(back.hinge, -ahead.hinge[:, ::-1], rtol=0, atol=1e-15)


def test_of_a_segment_of_which_nothing_is_known_the_schedule_stays() -> None:
    usual = Schedule()
    assert held_schedule(usual, 0, [None] * 6) is usual


def test_the_pattern_turns_the_most_of_those_that_do_not_move_aside() -> None:
    turn, aside = RANDOM.standard_normal((2, 2, 5))
    pattern = purely_turning(turn, aside)
    assert (pattern * aside).sum() == pytest.approx(0.0, abs=1e-12)
    assert np.hypot(*pattern).max() == pytest.approx(1.0)
    size = np.linalg.norm(pattern)
    for _ in range(100):
        other = RANDOM.standard_normal((2, 5))
        other -= aside * (other * aside).sum() / (aside**2).sum()
        assert (turn * other).sum() / np.linalg.norm(other) <= (turn * pattern).sum() / size + 1e-12
    assert_array_equal(purely_turning(turn, np.zeros((2, 5))), turn / np.hypot(*turn).max())


def test_what_is_shipped_is_what_fresh_runs_find() -> None:
    assert [k for k, each in enumerate(known().held) if each is not None] == [1, 3]
    assert identify.held_steering(SUBJECT, Design(), 0) is None
    shipped, found = known().held[3], identify.held_steering(SUBJECT, Design(), 3)
    assert shipped is not None
    assert found is not None
    assert_allclose(found.hinges, shipped.hinges, rtol=0, atol=1e-6)
    assert found.turn == pytest.approx(shipped.turn, rel=1e-6)


@pytest.mark.parametrize(("hinge", "frequency"), [(0.08, 1.1), (0.08, 0.8), (0.14, 0.8)])
def test_with_hinges_of_its_own_a_worm_turns_as_much_and_moves_aside_less(hinge: float, frequency: float) -> None:
    """Segment 3 of the default worm, in waves other than that with which its hinges were found."""
    usual = Schedule().bend(np.array([[0.0], [np.pi / 2.0]]), 6)
    moved = []
    for hinges in (usual, np.array(known().held[3].hinges)):
        schedule = HeldSchedule(segment=3, hinges=hinges, backward=hinges)
        ways = []
        for side in (1.0, -1.0):
            gait = SteeredWave(GaitParameters(0.3, frequency, hinge=side * hinge), schedule)
            ways.append(identify.steady(WORM, GROUND, gait, 7, 4).motion)
        assert ways[0].turn == pytest.approx(-ways[1].turn, rel=1e-3)
        assert ways[0].drift == pytest.approx(-ways[1].drift, rel=1e-3, abs=1e-6)
        moved.append(ways[0])
    by_whole, by_own = moved
    assert by_whole.drift < -0.08 * by_whole.distance
    assert abs(by_own.drift) < 0.6 * abs(by_whole.drift)
    assert by_own.turn > 0.95 * by_whole.turn > 0.0


def driver(mechanism: str) -> WaveController:
    reference = Reference(Constant(0.08), path=Line())
    return made("pi_los", ControlTask(WORM, reference, known(), mechanism))


def run_until_dead(controller: WaveController, *dead: int) -> None:
    """Run a controller on strains that follow its commands at once but for the left chambers of some segments."""
    strain, t = np.zeros((6, 2)), 0.0
    for t in np.arange(0.0, 4.0, 0.01):
        seen = Measurement(t, strain=(strain, t), com=(np.array([0.08 * t, 0.0, 0.05]), t))
        told = controller.step(t, seen).contraction
        strain = strain + (1.0 - np.exp(-0.01 / 0.1)) * (-0.9 * told - strain)
        strain[list(dead), 0] = 0.0


@pytest.mark.parametrize("mechanism", ["hinge", "both"])
def test_a_controller_steers_so_once_it_holds_a_segment(mechanism: str) -> None:
    controller = driver(mechanism)
    run_until_dead(controller, 3)
    assert list(controller.chambers.held) == [3]
    schedule = controller.generator.schedule
    assert isinstance(schedule, HeldSchedule)
    assert schedule.segment == 3
    assert isinstance(controller.estimator, Estimator)
    assert 0.3 < controller.estimator.estimate(4.0).state.turn_gain < 0.8
    controller.reset()
    assert type(controller.generator.schedule) is Schedule


@pytest.mark.parametrize(("mechanism", "dead"), [("bias", (3,)), ("hinge", (1, 3))])
def test_without_hinges_or_with_two_held_it_steers_as_the_whole_worm(mechanism: str, dead: tuple[int, ...]) -> None:
    controller = driver(mechanism)
    run_until_dead(controller, *dead)
    assert sorted(controller.chambers.held) == sorted(dead)
    assert type(controller.generator.schedule) is Schedule


@pytest.mark.slow
def test_a_dead_chamber_in_the_middle_is_lived_with() -> None:
    """Seed 10: 0.053 body lengths, and winding on and on, with the steering of the whole worm."""
    from scenes.models.loading import load_scene
    from scenes.running.runner import simulate

    faults = ["fault.chamber=true", "fault.chamber_segment=3", "fault.chamber_begin_s=10"]
    run = simulate(load_scene("path_line", [*faults, "seed=10", "run.duration_s=40"]))
    late = np.abs(run["com"][run["time"] > 28.0, 1])
    assert late.max() < 0.015 * worm3d.Worm().length
