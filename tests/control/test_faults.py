"""Faults that show in measurements: chambers, speeds, tipping; on the plant, and none where nothing is wrong."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from control.estimation.estimate import Estimate
from control.estimation.kalman import Uncertainty
from control.estimation.reduced import STATES, ReducedState
from control.faults.injected import Faulty, FaultySensor
from control.faults.rules import Fault, Wave, faults
from control.faults.watch import _crab, _descent
from control.identification.identified import load
from control.sensing.sensors import COM, HEADING_SENSOR, Channel, Measurement, Sensors
from control.supervisor import BACKWARDS, Supervisor
from control.task import ControlTask
from control.tracking.obstacles import Disc
from control.tracking.paths import Circle, Line
from control.tracking.references import Constant, Reference, Steps
from worm3d import Command, Plane, Result, Worm, simulate
from worm3d.measures.posture import on_its_side, roll

WORM = Worm()
FOUND = load(WORM)
LINE, CIRCLE = Line(start=(0.5, 0.0)), Circle(1.5, start=(0.5, 0.0))
Spoil = Callable[[float, np.ndarray], np.ndarray]


class Broken:
    """A supervisor of which the commands do not all arrive."""

    def __init__(self, supervisor: Supervisor, spoil: Spoil) -> None:
        self.supervisor, self._spoil = supervisor, spoil
        self.reset()

    def reset(self) -> None:
        self.supervisor.reset()
        self.times: list[float] = []
        self.waves: list[float] = []

    def step(self, t: float, measurement: Measurement) -> Command:
        command = self.supervisor.step(t, measurement)
        self.times.append(t)
        self.waves.append(self.supervisor.generator.waves)
        return Command(self._spoil(t, command.contraction.copy()), command.hinge)

    def waves_from(self, begin: float, end: float) -> float:
        return float(np.diff(np.interp([begin, end], self.times, self.waves))[0])


def run(
    reference: Reference,
    duration: float,
    spoil: Spoil = lambda t, contraction: contraction,
    world: Plane | None = None,
    push: Callable[[float], np.ndarray] | None = None,
    sensors: Sensors | None = None,
    worm: Worm = WORM,
) -> tuple[Result, Broken, dict[str, Fault]]:
    assert FOUND is not None
    broken = Broken(Supervisor.of(ControlTask(worm, reference, FOUND)), spoil)
    result = simulate(
        worm,
        world or Plane(),
        actuation=broken,
        sensor=sensors or Sensors(seed=3),
        duration=duration,
        external_force=push,
    )
    return result, broken, {fault.kind: fault for fault in broken.supervisor.faults}


def stuck(segment: int, side: int, begin: float, value: float | None, share: float = 0.0) -> Spoil:
    """Return what keeps a chamber at a contraction, or at a share of what it is told."""

    def spoil(t: float, contraction: np.ndarray) -> np.ndarray:
        if t >= begin:
            contraction[segment, side] = share * contraction[segment, side] if value is None else value
        return contraction

    return spoil


@pytest.mark.parametrize(
    ("segment", "side", "begin", "value", "share"),
    [(0, 0, 4.1, 0.0, 0.0), (3, 1, 5.6, 0.35, 0.0), (5, 0, 4.7, 0.2, 0.0), (1, 1, 6.0, None, 0.3)],
)
def test_a_chamber_that_does_not_obey_is_named_within_three_waves(segment, side, begin, value, share) -> None:
    spoil = stuck(segment, side, begin, value, share)
    _, broken, found = run(Reference(Constant(0.08), path=LINE), begin + 4.5, spoil)
    fault = found[f"chamber {segment} {('left', 'right')[side]}"]
    assert 0.0 < broken.waves_from(begin, fault.time) < 3.0
    assert f"{('left', 'right')[side]} chamber of segment {segment}" in fault.what
    assert {kind.partition(" ")[0] for kind in found} <= {"chamber", "too"}, "it may be too slow by then"
    assert len([kind for kind in found if kind.startswith("chamber")]) == 1


def test_a_chamber_that_does_not_obey_is_not_taken_for_a_worm_that_tips() -> None:
    """Its gain alone once made left and right differ by more than the limit."""
    result, _, found = run(Reference(Constant(0.11), path=LINE), 11.4, stuck(4, 0, 5.4097, 0.1))
    assert on_its_side(result) is None
    assert set(found) == {"chamber 4 left"}


def test_all_chambers_without_pressure() -> None:
    _, broken, found = run(Reference(Constant(0.08), path=LINE), 10.0, lambda t, c: c if t < 5.0 else 0.2 * c)
    assert broken.waves_from(5.0, found["chambers"].time) < 3.0
    assert "too slow" in found


def test_chambers_that_do_not_move_at_all_are_one_fault() -> None:
    zero = np.zeros((6, 2))
    wave = Wave(1.0, zero, zero, 0.0, None, np.nan, np.nan, False, 0.1, 0.05, 0.05, 0.1)
    assert [fault.kind for fault in faults([wave, wave])] == ["chambers"]


def test_loads_on_single_chambers_count_the_more_the_smaller_the_wave() -> None:
    gain = np.full((6, 2), 0.5)
    gain[2, 1] = 0.22
    wave = Wave(1.0, gain, 0.0 * gain, 0.0, None, np.nan, np.nan, False, 0.1, 0.0, 0.05, 0.1)
    assert [fault.kind for fault in faults([wave, wave])] == ["chamber 2 right"]
    small = replace(wave, expected=0.6)
    assert list(faults([small, small])) == []
    gain[2, 1] = 0.1
    assert [fault.kind for fault in faults([small, small])] == ["chamber 2 right"]


def test_a_worm_leans_where_its_gains_differ_from_the_usual_ones_and_not_where_chambers_are_weak() -> None:
    usual = np.tile([[0.7, 1.0]], (6, 1))
    weak = Wave(1.0, 0.85 * usual, 0.0 * usual, 0.0, None, np.nan, np.nan, False, 0.1, 0.0, 0.05, 0.1)
    weak = replace(weak, place=np.zeros(2), place_time=1.0)
    known = replace(weak, usual_gain=usual)
    assert [fault.kind for fault in faults([weak] * 3)] == ["tipped"]
    assert list(faults([known] * 3)) == []
    for side, name in enumerate(("left", "right")):
        carries = known.gain.copy()
        carries[:, side] *= 1.2
        (told,) = faults([known, *[replace(known, gain=carries)] * 2])
        assert told.kind == "tipped"
        assert f"on its {name} side" in told.what
    assert list(faults([known, replace(known, gain=carries)])) == []  # the first wave tells no lean
    dead, gain = np.ones((6, 2)), np.full((6, 2), 0.85)
    gain[2], dead[2] = 0.2, (0.05, 0.1)  # neither chamber does anything, and which one less is chance
    assert "tipped" not in {fault.kind for fault in faults([replace(known, gain=gain, usual_gain=dead)] * 3)}


@pytest.mark.slow
def test_small_waves_under_load_are_no_fault_of_the_chambers() -> None:
    heavy, slow = replace(WORM, mass=0.4), Reference(Constant(0.02), path=LINE)
    _, _, found = run(slow, 6.0, worm=heavy)
    assert "chambers" not in found
    _, _, found = run(slow, 6.0, lambda t, c: 0.2 * c, worm=heavy)
    assert "chambers" in found


@pytest.mark.parametrize("share", [1.3, 2.5])
def test_a_speed_beyond_the_map_is_reported_within_three_waves(share: float) -> None:
    assert FOUND is not None
    reach = Supervisor.of(ControlTask(WORM, Reference(Constant(0.08), path=LINE), FOUND)).feed_forward.fastest
    reference = Reference(Steps(0.06, (5.0,), (share * reach,)), path=LINE)
    _, broken, found = run(reference, 11.0)
    assert 0.0 < broken.waves_from(5.0, found["unreachable speed"].time) < 3.0


def test_a_way_backwards_is_reported_and_the_worm_rests() -> None:
    result, broken, found = run(Reference(Constant(-0.05), path=Circle(1.5, start=(0.5, 0.0))), 3.0)
    assert "goes backwards" in found["unreachable speed"].what
    assert list(found) == ["unreachable speed"]
    assert {decision.status for decision in broken.supervisor.decisions} == {BACKWARDS}
    assert np.abs(result.com[-1] - result.com[20]).max() < 1e-3


def test_a_speed_that_a_slope_does_not_allow() -> None:
    result, _, found = run(Reference(Constant(0.12), path=LINE), 8.0, world=Plane(slope=np.deg2rad(6.0)))
    assert "too slow" in found
    assert "unreachable speed" not in found
    assert on_its_side(result) is None


def test_a_worm_that_goes_the_wrong_way_along_its_path_is_too_slow() -> None:
    """What it believes of its heading does not count where there is a path: the belief may be what is wrong."""
    nothing = np.full((6, 2), np.nan)
    still = Wave(0.0, nothing, nothing, 0.0, None, np.nan, 0.001, False, 0.08, 0.08, 0.08, 0.14, 0.0, aside=0.0)
    for way, kinds in ((0.08, []), (-0.08, ["too slow"]), (0.2, ["too fast"])):
        waves = [replace(still, end=k, place=np.array([way * k, 0.0]), place_time=k) for k in np.arange(5.0)]
        assert [fault.kind for fault in faults(waves)] == kinds
        quick = [replace(wave, made=0.2) for wave in waves]
        assert [fault.kind for fault in faults(quick)] == [kind for kind in kinds if kind != "too fast"]


@pytest.mark.slow
def test_a_worm_that_faces_away_says_so_and_not_that_it_is_slow() -> None:
    _, _, found = run(Reference(Constant(0.08), path=Line(start=(0.5, 0.0), azimuth=np.pi)), 14.0)
    assert set(found) == {"facing away"}
    assert "faces 1" in found["facing away"].what


def test_a_worm_that_is_told_to_stand_misses_no_heading() -> None:
    assert run(Reference(Constant(0.0), path=LINE), 8.0)[2] == {}


def test_an_obstacle_that_leaves_no_way_to_turn_in_is_refused() -> None:
    with pytest.raises(ValueError, match=r"obstacles\[0\]: got one past which no way leads"):
        run(Reference(Constant(0.08), path=LINE, obstacles=(Disc(0.7, 0.05, 0.15),)), 8.0)


@pytest.mark.slow
def test_an_obstacle_with_room_before_it_is_no_fault() -> None:
    blocked = (Disc(1.5, 0.1, 0.15), Disc(1.5, -0.12, 0.15))
    assert run(Reference(Constant(0.08), path=LINE, corridor=1.0, obstacles=blocked), 20.0)[2] == {}


def test_a_turn_beyond_the_map_is_what_is_said_of_a_worm_that_slows_down_for_it() -> None:
    _, _, found = run(Reference(Constant(0.08), path=Circle(0.2, start=(0.5, 0.0))), 10.0)
    assert set(found) == {"unreachable turn"}


def sideways(force: float, joint: int, begin: float, end: float) -> Callable[[float], np.ndarray]:
    def push(t: float) -> np.ndarray:
        forces = np.zeros((WORM.segments + 1, 3))
        forces[joint, 1] = force if begin < t <= end else 0.0
        return forces

    return push


@pytest.mark.parametrize(
    ("world", "push"),
    [
        (Plane(), sideways(0.4, 6, 5.0, 7.0)),
        pytest.param(Plane(), sideways(-0.5, 1, 5.0, 5.8), marks=pytest.mark.slow),
        pytest.param(Plane(slope=np.deg2rad(12.0), heading=np.deg2rad(70.0)), None, marks=pytest.mark.slow),
    ],
)
def test_a_worm_that_tips_is_reported_within_three_waves(world: Plane, push) -> None:
    result, broken, found = run(Reference(Constant(0.08), path=LINE), 18.0, world=world, push=push)
    since = on_its_side(result)
    assert since is not None
    assert np.abs(np.rad2deg(roll(result)[-1])) == pytest.approx(45.0, abs=3.0)
    assert found, "something is reported"
    assert broken.waves_from(since, found["tipped"].time) < 3.0 + 1.0  # from upright to lying takes most of a wave
    assert ("left" in found["tipped"].what) == (roll(result)[-1] > 0.0)


def test_the_roll_is_that_of_the_segments_against_the_ground() -> None:
    slope = np.deg2rad(12.0)
    for world in (Plane(), Plane(slope=slope, heading=0.5)):
        result = simulate(WORM, world, duration=0.05)
        assert np.abs(roll(result)).max() < 1e-3
        assert on_its_side(result) is None
    falling = simulate(WORM, None, duration=0.05)
    assert np.isnan(roll(falling)).all()


NOMINAL = [
    (Reference(Constant(0.08), path=CIRCLE), Plane(), Sensors(seed=11)),
    (Reference(Constant(0.08), path=LINE), Plane(slope=float(np.deg2rad(3.0))), Sensors(seed=12)),
    (Reference(Steps(0.05, (6.0, 12.0), (0.1, 0.0)), path=LINE), Plane(), Sensors(seed=13)),
    (Reference(Constant(0.04)), Plane(), Sensors(com=Channel(noise=0.02, rate=5.0, dropout=0.2), seed=14)),
    (Reference(Constant(0.08), path=CIRCLE), Plane(), Sensors(Channel(noise=0.05, rate=30.0), COM, seed=15)),
]


@pytest.mark.parametrize(("reference", "world", "sensors"), NOMINAL)
def test_no_false_alarms(reference: Reference, world: Plane, sensors: Sensors) -> None:
    result, _, found = run(reference, 18.0, world=world, sensors=sensors)
    assert found == {}
    assert on_its_side(result) is None


def test_without_samples_of_the_place_it_says_so() -> None:
    _, _, found = run(Reference(Constant(0.08), path=LINE), 6.0, sensors=Sensors(com=Channel(noise=0.005, dropout=1.0)))
    assert set(found) == {"no place", "lost heading"}
    assert "known to 10" in found["lost heading"].what, "it may look anywhere: 180 / sqrt(3) degrees"


@pytest.mark.slow
def test_strains_that_are_lost_are_told_within_three_waves_and_a_worm_without_such_sensors_misses_nothing() -> None:
    class Deaf(Broken):
        def step(self, t: float, measurement: Measurement) -> Command:
            lost = measurement.changed(strain=(None, float("nan"))) if t > 4.0 else measurement
            return super().step(t, lost)

    assert FOUND is not None
    for sensors, told in ((Sensors(seed=3), True), (Sensors(strain=None, seed=3), False)):
        deaf = Deaf(Supervisor.of(ControlTask(WORM, Reference(Constant(0.08), path=LINE), FOUND)), lambda t, told: told)
        if sensors.channels.get("strain") is None:
            deaf.step = lambda t, measurement, deaf=deaf: Broken.step(deaf, t, measurement)
        simulate(WORM, Plane(), actuation=deaf, sensor=sensors, duration=10.0)
        found = {fault.kind: fault for fault in deaf.supervisor.faults}
        assert set(found) == ({"no strains"} if told else set())
        if told:
            assert deaf.waves_from(4.0, found["no strains"].time) < 3.0 + 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "fault"),
    [
        ("push or drift", FaultySensor(begin=9.3, mode="drifting", error=0.02, component=0)),
        ("push or drift", FaultySensor(begin=11.7, mode="drifting", error=-0.02, component=1)),
        ("heading off", FaultySensor(begin=9.9, channel="heading", mode="off", error=-0.35)),
        ("swapped sides", FaultySensor(begin=10.4, channel="strain", mode="swapped")),
    ],
)
def test_a_sensor_that_misleads_is_named_within_three_waves(kind: str, fault: FaultySensor) -> None:
    assert FOUND is not None
    heading = HEADING_SENSOR if fault.channel == "heading" else None
    supervisor = Supervisor.of(ControlTask(WORM, Reference(Constant(0.08), path=CIRCLE), FOUND))
    sensors = Sensors(heading=heading, seed=5)
    simulate(WORM, Plane(), actuation=Faulty(supervisor, [fault]), sensor=sensors, duration=15.0)
    (found,) = [each for each in supervisor.faults if each.kind == kind]
    assert 0.0 < found.time - fault.begin < 3.0 * 1.3
    assert supervisor.faults[0] is found
    assert supervisor.sides.swapped == (kind == "swapped sides") == (supervisor.generator.correction is None)


@pytest.mark.slow
def test_a_heading_that_was_off_from_the_first_is_told_by_the_way() -> None:
    assert FOUND is not None
    supervisor = Supervisor.of(
        ControlTask(WORM, Reference(Constant(0.08), path=LINE), FOUND, sensors={"heading": HEADING_SENSOR})
    )
    off = FaultySensor(channel="heading", mode="off", error=0.35)
    simulate(
        WORM,
        Plane(),
        actuation=Faulty(supervisor, [off]),
        sensor=Sensors(heading=HEADING_SENSOR, seed=5),
        duration=20.0,
    )
    assert [each.kind for each in supervisor.faults] == ["heading off"]


def test_a_push_is_named_within_three_waves_and_what_the_wave_makes_is_none() -> None:
    _, broken, found = run(Reference(Constant(0.08), path=LINE), 14.0, push=sideways(0.07, 3, 8.0, 12.0))
    assert broken.waves_from(8.0, found["push or drift"].time) < 3.0
    ones, zero = np.ones((6, 2)), np.zeros((6, 2))
    steady = Wave(0.0, ones, zero, 0.0, zero[0], 0.0, 0.0, False, 0.08, 0.08, 0.08, 0.1)

    def waves(*ways: tuple[float, float], **last: object) -> list[Wave]:
        places = np.cumsum([(0.0, 0.0), *ways], axis=0)
        seen = [replace(steady, end=k + 0.5, place=place, place_time=float(k)) for k, place in enumerate(places)]
        return [replace(steady, end=-1.0), *seen[:-1], replace(seen[-1], **last)]

    def kinds(seen: list[Wave]) -> list[str]:
        return [each.kind for each in faults(seen)]

    assert kinds(waves((0.08, 0.0), (0.08, 0.02), pushed=True)) == ["push or drift"]
    assert kinds(waves((0.08, 0.0), (0.06, 0.0), pushed=True)) == ["push or drift"]
    assert kinds(waves((0.08, 0.0), (0.08, 0.02))) == kinds(waves((0.08, 0.0), (0.08, 0.01), pushed=True)) == []
    assert kinds(waves((0.08, 0.0), (0.06, 0.0), pushed=True, made=0.04)) == []
    assert kinds(waves((0.08, 0.0), (0.08, 0.02), pushed=True, length=2.0)) == []
    assert kinds(waves((0.08, 0.0), (0.08, 0.02), pushed=True, place_error=0.01)) == []
    # Gravity may add 0.1 * 9.81 * 0.01 m/s in this wave of one second.
    assert kinds(waves((0.08, 0.0), (0.1, 0.0), pushed=True, descent=0.01)) == []
    assert kinds(waves((0.08, 0.0), (0.11, 0.0), pushed=True, descent=0.01)) == ["push or drift"]
    turning = [replace(each, turning=0.25) for each in waves((0.08, 0.0), (0.08, 0.02), pushed=True)]
    assert kinds(turning) == []
    assert "heading off" in kinds(waves((0.08, 0.0), (0.08, 0.02), pushed=True, jumped=True))
    assert "push or drift" not in kinds(waves((0.08, 0.0), (0.08, 0.02), pushed=True, jumped=True))
    assert kinds([replace(steady, crab=0.25)] * 2) == ["heading off"]
    assert kinds([steady, replace(steady, crab=0.25)]) == []


@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_ground_that_falls_in_the_direction_of_motion_descends(heading: float) -> None:
    ahead = np.array([np.cos(heading), np.sin(heading)])
    state = ReducedState(0.0, 0.0, heading, 0.08, 0.0)
    down = Estimate(0.0, state, np.zeros((STATES, STATES)), None, slope=-0.05 * ahead)
    up = replace(down, slope=0.05 * ahead)
    across = replace(down, slope=0.05 * np.array([-ahead[1], ahead[0]]))
    assert [_descent(each, back=False) for each in (down, up, across)] == pytest.approx([0.05, 0.0, 0.0], abs=1e-12)
    assert [_descent(each, back=True) for each in (down, up, across)] == pytest.approx([0.0, 0.05, 0.0], abs=1e-12)
    unsure = replace(down, slope_covariance=0.02**2 * np.eye(2))
    assert _descent(unsure, back=False) == pytest.approx(0.03)


@pytest.mark.parametrize("heading", [0.0, 2.0])
@pytest.mark.parametrize("left", [0.06, -0.06])
def test_a_worm_crabs_downhill_and_no_more_than_that_is_put_down_to_the_slope(heading: float, left: float) -> None:
    """Where the ground rises to the left by `left` the worm crabs to the right, (KF2)."""
    state = ReducedState(0.0, 0.0, heading, 0.08, 0.0, crab=-Uncertainty().slope_yield * left)
    slope = left * np.array([-np.sin(heading), np.cos(heading)])
    known = Estimate(0.0, state, np.zeros((STATES, STATES)), None, slope=slope)
    assert _crab(known) == pytest.approx(0.0, abs=1e-12)
    assert _crab(replace(known, slope=-slope)) == pytest.approx(2.0 * 3.6 * 0.06)
    assert _crab(replace(known, slope=np.zeros(2))) == pytest.approx(3.6 * 0.06)
    unsure = replace(known, slope=-slope, slope_covariance=0.02**2 * np.eye(2))
    assert _crab(unsure) == pytest.approx(3.6 * (0.12 - 0.02))
