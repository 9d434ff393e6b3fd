"""Crawling where there is room, climbing where walls close round the worm."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.climbing.climb import CLIMB, WEDGING, Climb, enclosed
from control.climbing.climber import Climber
from control.climbing.way import PACES, STUCK, Way
from control.identification.identified import load
from control.sensing.sensors import QUANTITIES, Channel, Measurement, Sensors
from control.task import ControlTask
from control.tracking.paths import Line, PlanView
from control.tracking.references import Constant, Reference
from worm3d import Centreline, Friction, Pipe, Straight, Worm

WORM = Worm(k_spring=100.0)
WEIGHT = 0.1 * 9.81
NOTHING = np.zeros((6, 6))
TILT = np.deg2rad(25.0)
STEP = 0.02


def pressed(*segments: int, sides: tuple[int, ...] = (2, 5), load: float = 1.0) -> np.ndarray:
    loads = NOTHING.copy()
    loads[np.ix_(segments, sides)] = load
    return loads


def test_a_segment_is_enclosed_if_both_outward_apexes_bear_a_load() -> None:
    assert enclosed(WORM, NOTHING) == 0
    assert enclosed(WORM, pressed(0, 4)) == 2
    assert enclosed(WORM, pressed(0, 1, 2, sides=(2,))) == 0
    assert enclosed(WORM, pressed(0, 1, sides=(0, 1, 3, 4))) == 0
    quarter = 0.25 * WEIGHT / 6.0
    assert [enclosed(WORM, pressed(3, load=share * quarter)) for share in (0.99, 1.01)] == [0, 1]


def test_all_segments_contract_before_the_gait_begins_and_pace_is_its_speed() -> None:
    climb, felt = Climb(WORM, reflexes=()), {"contact_load": NOTHING}
    assert_allclose(climb.step(0.0, 0.0, 2.0, felt).contraction, CLIMB.amplitude)
    climb.step(WEDGING, WEDGING, 2.0, felt)
    assert climb.phase == 0.0
    given = climb.step(WEDGING + 0.3, 0.3, 2.0, felt)
    assert climb.phase == pytest.approx(0.6 / CLIMB.period)
    assert_allclose(given.contraction, CLIMB.bind(WORM)(0.6).contraction)


def test_at_pace_0_the_command_stays_but_for_segments_that_give_way() -> None:
    climb, felt = Climb(WORM), {"contact_load": pressed(0, load=0.01)}
    for k in range(60):
        last = climb.step(k * STEP, STEP, 1.0, felt)
    held = [climb.step((60 + k) * STEP, STEP, 0.0, felt).contraction for k in range(50)]
    assert_allclose(held, np.broadcast_to(last.contraction, (50, 6, 2)))
    hard = {"contact_load": pressed(0, load=6.2 * WEIGHT)}
    given_way = [climb.step((110 + k) * STEP, STEP, 0.0, hard).contraction[0, 0] for k in range(5)]
    assert (np.diff(given_way) < 0.0).all()
    after = climb.step(115 * STEP, STEP, 0.0, felt).contraction
    assert after[0, 0] == given_way[-1]
    assert_allclose(after[1:], last.contraction[1:])


def test_the_pace_keeps_a_worm_to_the_speed_asked_for() -> None:
    """With strides of 0.1 m a period of 2 s."""
    way = Way(Line(), 1.0, 2.0)
    assert way.pace(0.05) == 1.0
    for k in range(400):
        way.take(k / 100.0, np.array([0.1 * k / 100.0, 0.0, 0.02]))
    assert way.stride == pytest.approx(0.1)
    assert way.pace(0.03) == pytest.approx(0.6)
    assert (way.pace(1.0), way.pace(1e-4), way.pace(0.0)) == (PACES[1], PACES[0], 0.0)
    assert way.idle == 0


@pytest.mark.parametrize("path", [None, Line()])
def test_a_worm_that_makes_no_way_is_stuck(path: Line | None) -> None:
    way = Way(path, 1.0, 2.0)
    for k in range(100 * (STUCK + 2)):
        way.take(k / 100.0, np.array([0.002 * np.sin(k), 0.0, 0.0]))
    assert way.idle >= STUCK
    assert way.pace(0.05) == PACES[1]


def test_a_worm_that_slides_back_makes_no_way() -> None:
    way = Way(Line(), 1.0, 2.0)
    for k in range(400):
        way.take(k / 100.0, np.array([-0.1 * k / 100.0, 0.0, 0.0]))
    assert way.stride == pytest.approx(-0.1)
    assert way.idle == 2


def test_the_fastest_climb_is_told_by_the_longest_of_the_last_strides() -> None:
    way = Way(Line(), 1.0, 2.0)
    assert way.fastest == np.inf
    for k in range(500):
        way.take(k / 100.0, np.array([0.1 * k / 100.0, 0.0, 0.0]))
    assert way.fastest == pytest.approx(PACES[1] * 0.1 / 2.0)


def climber(reference: Reference | None = None) -> Climber:
    found = load(Worm())
    assert found is not None
    channels = {"strain": Channel(noise=0.01), "com": Channel(noise=0.005), "contact_load": Channel(noise=0.005)}
    return Climber.of(ControlTask(WORM, reference or Reference(Constant(0.05), path=Line()), found, sensors=channels))


def test_it_changes_its_gait_where_walls_close_and_open_without_a_jump() -> None:
    """Walls from 1 to 2 s: it climbs until they have been open for two periods, and all that it told is kept."""
    made, climbs, commands = climber(), [], [np.zeros((6, 2))]
    for k in range(450):
        t = k * STEP
        load = pressed(4, 5) if 1.0 <= t < 2.0 else NOTHING
        seen = Measurement(
            t, strain=(-0.8 * commands[-1], t), com=(np.array([0.05 * t, 0.0, 0.05]), t), contact_load=(load, t)
        )
        commands.append(made.step(t, seen).contraction)
        climbs.append(made.climbs)
    began, ended = (STEP * k for k in np.flatnonzero(np.diff(climbs)) + 1)
    assert began == pytest.approx(1.0)
    assert ended > 2.0 + 2.0 * CLIMB.period * 0.6
    assert np.abs(np.diff(commands, axis=0)).max() < 0.06
    sources = [each.source for each in made.decisions]
    assert sources[0] != "climb"
    assert sources[10] == "climb"
    assert sources[-1] != "climb"
    assert not made.failures
    assert np.diff([each.time for each in made.decisions]).max() < 0.2 + 1e-6


@pytest.mark.parametrize(("speed", "told"), [(0.02, ["too slow"]), (0.048, [])])
def test_a_climb_that_cannot_be_as_fast_as_asked_is_reported_once(speed: float, told: list[str]) -> None:
    made, contraction = climber(), np.zeros((6, 2))
    for k in range(1500):
        t = k * STEP
        place = np.array([speed * t, 0.0, 0.05]), t
        seen = Measurement(t, strain=(-0.8 * contraction, t), com=place, contact_load=(pressed(4, 5), t))
        contraction = made.step(t, seen).contraction
    assert [fault.kind for fault in made.faults] == told


def test_without_walls_it_is_the_supervisor_bit_for_bit() -> None:
    class Other(Climber):
        def _change(self, t: float, closed: bool) -> None:
            raise AssertionError("asked though nothing touches it") if closed else None

    seen = [
        Measurement(
            t, strain=(np.full((6, 2), 0.01), t), com=(np.array([0.05 * t, 0.0, 0.0]), t), contact_load=(NOTHING, t)
        )
        for t in STEP * np.arange(60)
    ]
    mine, found = climber(), load(Worm())
    assert found is not None
    supervisor = Climber.__mro__[1].of(ControlTask(WORM, mine.reference, found))
    supervisor.reset()
    for each in seen:
        np.testing.assert_array_equal(
            mine.step(each.time, each).contraction, supervisor.step(each.time, each).contraction
        )


@cache
def climbed() -> tuple[worm3d.Result, Climber]:
    line = Centreline.of([Straight(2.0)], tilt=TILT)
    made = climber(Reference(Constant(0.04), path=PlanView(line)))
    sensor = Sensors(seed=5, contact_load=QUANTITIES["contact_load"].default)
    ground = Friction(forward=0.3, backward=0.8, lateral=0.8)
    run = worm3d.simulate(
        WORM, Pipe(line, 0.092), ground, actuation=made, duration=6.0, dt=0.01, record_every=5, sensor=sensor
    )
    return run, made


def test_it_climbs_a_pipe_in_which_the_crawling_wave_gets_stuck() -> None:
    run, made = climbed()
    assert run.status.name == "DONE"
    assert made.climbs
    way = run.world.along(run.com)
    assert way[-1] - way[np.searchsorted(run.time, 2.0)] > 0.03 * 4.0
    assert not made.faults
    assert run.normal_load.sum(axis=2).max() < 30.0


def test_speed_and_estimate_are_those_of_the_climb() -> None:
    run, made = climbed()
    last = made.decisions[-1].estimate
    assert last is not None
    assert_allclose(last.position, run.com[-1, :2], atol=0.05)
    assert abs(last.speed - 0.04) < 0.02
