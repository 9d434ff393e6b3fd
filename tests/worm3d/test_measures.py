"""Measures against closed forms: on made-up motions of a run's worm, and on runs of which the answer is known."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import worm3d
from control.gaits import GAITS, TravellingWave
from worm3d import Friction, Plane, Problem, Result, State, Worm, simulate
from worm3d.measures import MEASURES, general, measure
from worm3d.measures.posture import ON_ITS_SIDE
from worm3d.running.recovery import recovery
from worm3d.values.metrics import METRIC_UNITS, named

PERIOD, DT = 0.5, 0.01


@pytest.fixture(scope="module")
def still() -> Result:
    """A worm that lies still on level ground for six periods."""
    result = simulate(Worm(), Plane(), duration=6 * PERIOD, dt=DT)
    return replace(result, period=PERIOD)


def moved(still: Result, place: np.ndarray, azimuth: np.ndarray, **changes) -> Result:
    """Return the worm carried along as it is: its places (T, 2) [m], and azimuths (T,) [rad]."""
    cos, sin, zero = np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)
    turn = np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, zero + 1.0]]).transpose(2, 0, 1)
    offset = np.column_stack([place, zero]) - still.com[0] * [1.0, 1.0, 0.0]

    def carried(points: np.ndarray) -> np.ndarray:
        flat = points.reshape(len(points), -1, 3) - still.com[0]
        return (flat @ turn.transpose(0, 2, 1) + still.com[0] + offset[:, None]).reshape(points.shape)

    same = {"joints": carried(still.joints), "points": carried(still.points), "com": carried(still.com[:, None])[:, 0]}
    return replace(still, **{**same, **changes})


def straight_on(still: Result, speed: float, **changes) -> Result:
    place = np.column_stack([speed * still.time, np.zeros_like(still.time)])
    return moved(still, place, np.zeros_like(still.time), **changes)


@pytest.mark.parametrize("way_round", [1.0, -1.0])
@pytest.mark.parametrize("crab", [0.0, 0.3, -1.2])
def test_on_a_circle(still: Result, way_round: float, crab: float) -> None:
    """The radius is that of the circle, whatever the angle between heading and way, whose sine is the drift."""
    radius, turn = 0.37, np.deg2rad(31.0)
    azimuth = 0.4 + way_round * turn / PERIOD * still.time
    place = radius * way_round * np.column_stack([np.sin(azimuth), -np.cos(azimuth)])
    run = moved(still, place, azimuth - crab).summary()
    chord = 2.0 * radius * np.sin(turn / 2.0)
    assert_allclose(run["turning_radius_bl"], radius, rtol=1e-9)
    assert_allclose(run["degrees_per_wave_deg"], way_round * 31.0, rtol=1e-9)
    assert_allclose(run["drift_per_metre"], np.sin(crab), rtol=1e-9, atol=1e-9)
    assert_allclose(run["stride_bl"], chord * np.cos(crab), rtol=1e-9)
    assert_allclose(run["speed_bl_s"], chord * np.cos(crab) / PERIOD, rtol=1e-9)


def test_a_straight_way_has_no_radius(still: Result) -> None:
    run = straight_on(still, 0.1)
    assert run.summary()["turning_radius_bl"] is None
    assert "straight" in run.reasons()["turning_radius_bl"]
    assert_allclose(run.summary()["stride_bl"], 0.1 * PERIOD, rtol=1e-12)


@pytest.mark.parametrize("speed", [0.2, -0.2])
def test_a_dragged_worm_slides_a_metre_a_metre(still: Result, speed: float) -> None:
    slid = np.where(still.normal_load > 0.0, abs(speed) * DT, 0.0)
    joint_slid = np.where(still.joint_load > 0.0, abs(speed) * DT, 0.0)
    run = straight_on(still, speed, slip=slid, joint_slip=joint_slid).summary()
    assert_allclose(run["slip_per_metre"], 1.0, rtol=1e-9)
    assert_allclose(run["backslide_per_metre"], 0.0 if speed > 0.0 else 1.0, rtol=1e-4, atol=1e-9)
    assert run["anchoring_duty"] == 0.0


def test_a_force_drags_a_worm_over_the_ground() -> None:
    force = np.zeros((7, 3))
    force[:, 0] = 0.2
    run = simulate(Worm(), Plane(), Friction(0.1, 0.4, 0.4), external_force=lambda _: force, duration=2.0, dt=DT)
    run = replace(run, period=PERIOD)
    assert_allclose(run.summary()["slip_per_metre"], 1.0, rtol=1e-3)
    assert run.summary()["backslide_per_metre"] == 0.0


def test_a_worm_at_rest_is_anchored_and_has_no_slip(still: Result) -> None:
    assert still.summary()["anchoring_duty"] == 1.0
    for name in ("slip_per_metre", "backslide_per_metre", "drift_per_metre", "response_time_s"):
        assert still.summary()[name] is None
        assert "did not move" in still.reasons()[name]


@pytest.mark.parametrize("anchored", [1, 2, 5])
@pytest.mark.parametrize("others_slide", [False, True])
def test_anchoring_duty_of_a_wave(still: Result, anchored: int, others_slide: bool) -> None:
    """So many of six segments stand, each in turn; the others are in the air or slide."""
    count = len(still.time)
    begin = np.arange(count) // 5 % 6
    stands = (np.arange(6) - begin[:, None]) % 6 < anchored
    load = np.where(stands, 1.0, 1.0 if others_slide else 0.0)[:, :, None] * np.ones(6)
    slid = np.zeros_like(load)
    before = np.concatenate([stands[:1], stands[:-1]])
    if others_slide:
        slid[~(stands | before)] = 0.001
    run = straight_on(still, 0.1, normal_load=load, joint_load=0.0 * still.joint_load, slip=slid)
    handed_over = (stands | before)[1:].mean()  # in the interval between rows both bear load
    assert_allclose(run.summary()["anchoring_duty"], handed_over, rtol=0.05)
    assert abs(handed_over - anchored / 6) < 0.04


def test_peak_load_and_roll(still: Result) -> None:
    load = still.normal_load.copy()
    load[17, 3] = [1.0, 2.0, 0.0, 3.0, 0.5, 0.0]
    roll = np.deg2rad(np.where(np.arange(len(still.time)) == 23, -10.0, 4.0))
    left = np.stack([0.0 * roll, np.cos(roll), np.sin(roll)], axis=1)
    run = replace(still, normal_load=load, directors=np.repeat(left[:, None], 6, axis=1)).summary()
    assert run["peak_wall_load_N"] == 6.5
    assert_allclose(run["roll_max_deg"], 10.0, rtol=1e-6)
    assert_allclose(run["roll_margin_deg"], np.rad2deg(ON_ITS_SIDE) - 10.0, rtol=1e-6)


def test_largest_penetration_is_the_load_over_the_stiffness(still: Result) -> None:
    """At rest, where no damper acts: the largest load over the stiffness, by which the mean load sinks in by 1e-5."""
    mean = still.worm.mass * 9.81 / (2.0 * still.worm.segments)
    load = max(still.normal_load[-1].max(), still.joint_load[-1].max())
    assert_allclose(still.summary()["largest_penetration"], 1e-5 * load / mean, rtol=1e-3)


def test_what_no_load_is_on_does_not_sink(still: Result) -> None:
    """A point in the solid that bears no load is none of a contact's; without a world there is none."""
    free = replace(still, normal_load=0.0 * still.normal_load, joint_load=0.0 * still.joint_load)
    assert free.summary()["largest_penetration"] == 0.0
    assert "no world" in replace(still, world=None).reasons()["largest_penetration"]


@pytest.mark.parametrize("radius", [0.1, 0.5, 0.9, 1.3])
def test_return_map_of_a_shape_that_decays(still: Result, radius: float) -> None:
    """Changes of shape shrink by this factor a period; place and heading, which go on, take no part."""
    mode = 1e-3 * np.random.default_rng(3).standard_normal((7, 3))
    mode -= mode.mean(axis=0)
    mode[[0, -1]] = 0.0  # the heading is that of the chord
    wave = np.sin(2.0 * np.pi * still.time / PERIOD)[:, None, None] * mode[::-1] * [1.0, 1.0, 0.0]
    shape = radius ** (still.time / PERIOD)[:, None, None] * mode
    bent = replace(still, joints=still.joints + shape + wave)
    place = np.column_stack([0.1 * still.time, 0.03 * still.time])
    run = moved(bent, place, 0.7 * still.time)
    assert_allclose(run.summary()["return_map_radius"], radius, rtol=1e-6)


def test_return_map_of_actuators_that_lag() -> None:
    """What a lag tau leaves of the start shrinks by exp(-T/tau) a period; the body's own modes are faster."""
    lag = 1.0
    gait = TravellingWave(period=PERIOD, amplitude=0.01)
    worm = Worm(actuator_lag=lag, kelvin_voigt_time=0.01)
    run = simulate(worm, None, actuation=gait, gravity=(0.0, 0.0, 0.0), duration=12 * PERIOD, dt=DT)
    assert_allclose(run.summary()["return_map_radius"], np.exp(-PERIOD / lag), rtol=5e-3)


@pytest.mark.parametrize("slow", [0.3, 1.0])
def test_a_damped_body_recovers_from_pushes_at_the_rate_of_its_damping(slow: float) -> None:
    """All springs have the damping K tau: without inertia what a push leaves shrinks by exp(-T/tau) a period."""
    worm = Worm(kelvin_voigt_time=slow, mass=1e-5)
    still = TravellingWave(period=PERIOD, amplitude=0.0)
    held = np.tile([False, True, True], (7, 1))  # or a push makes it spin, for good
    still_there = {"gravity": (0.0, 0.0, 0.0), "held": held, "duration": PERIOD, "dt": DT}
    problem = Problem(worm=worm, world=None, actuation=still, **still_there)
    assert_allclose(recovery(problem, pushes=2, periods=4, size=1e-4), np.exp(-PERIOD / slow), rtol=0.01)


def test_a_crawling_worm_recovers_from_pushes() -> None:
    gait = TravellingWave(period=PERIOD, amplitude=0.2)
    problem = Problem(worm=Worm(), world=Plane(), actuation=gait, duration=2.0, dt=DT)
    factors = recovery(problem, pushes=2, periods=3)
    assert_array_equal(factors, recovery(problem, pushes=2, periods=3))
    assert (factors < 0.5).all()


def test_small_pushes_agree_and_a_large_one_leaves_the_worm_on_its_side() -> None:
    gait = GAITS["steered"](amplitude=0.3, period=1.25)
    problem = Problem(worm=Worm(), world=Plane(), actuation=gait, duration=6.25, dt=DT)
    small = recovery(problem, pushes=2)
    assert_allclose(small, small[0], rtol=0.01)
    assert small[0] < 0.5
    assert_allclose(recovery(problem, pushes=2, size=0.1).max(), 1.0, rtol=1e-3)


def test_recovery_refuses_what_has_no_period() -> None:
    plain = Problem(worm=Worm(), world=Plane(), duration=1.0)
    with pytest.raises(ValueError, match="actuation: has no `period`"):
        recovery(plain)
    with pytest.raises(ValueError, match="whole number"):
        recovery(replace(plain, actuation=TravellingWave(period=0.505)))
    with pytest.raises(ValueError, match="periods: got 1, must be at least 2"):
        recovery(replace(plain, actuation=TravellingWave()), periods=1)


def test_return_map_of_a_motion_that_repeats_itself(still: Result) -> None:
    assert straight_on(still, 0.1).summary()["return_map_radius"] == 0.0


@pytest.mark.parametrize("lag", [0.2, 0.7])
def test_response_time_of_a_speed_that_rises(still: Result, lag: float) -> None:
    time = 4.0 * still.time  # 24 periods
    way = 0.1 * (time - lag * (1.0 - np.exp(-time / lag)))
    run = moved(replace(still, time=time), np.column_stack([way, 0.0 * way]), 0.0 * time)
    final = 1.0 - np.exp(-0.75 * time[-1] / lag)
    expected = lag * np.log(lag * np.expm1(PERIOD / lag) / (PERIOD * 0.1 * final))
    assert_allclose(run.summary()["response_time_s"], expected, rtol=2e-3)


def test_response_time_of_full_speed_at_once(still: Result) -> None:
    assert_allclose(straight_on(still, 0.1).summary()["response_time_s"], 0.9 * PERIOD, rtol=1e-9)


def test_effort(still: Result) -> None:
    wave = 0.2 * np.sin(2.0 * np.pi * still.time / PERIOD)[:, None, None] * np.ones((6, 2))
    run = replace(still, contraction=wave)
    assert_allclose(run.summary()["effort"], 0.2 / np.sqrt(2.0) / run.worm.stroke[1], rtol=1e-9)
    force = 0.1 * np.asarray(still.worm.k_spring)[:, None] / 2.0 * np.ones((len(still.time), 6, 2))
    run = replace(still, contraction=0.0 * wave, force=force)
    assert_allclose(run.summary()["effort"], 0.1 / run.worm.stroke[1], rtol=1e-9)


def test_energy_drawn_from_a_source() -> None:
    """What pneumatic chambers draw went into the worm, or is kept or lost in them; plain ones have no source."""
    gait = TravellingWave(period=PERIOD, amplitude=0.3)
    run = simulate(Worm(actuator=worm3d.Pneumatic()), Plane(), Friction(0.1, 0.6, 0.6), gait, duration=3.0, dt=DT)
    summary, weight = run.summary(), run.worm.mass * 9.81
    assert_allclose(summary["work_input_J"], sum(run.energy.uses.values()), rtol=1e-9)
    assert_allclose(summary["cost_of_transport_input"] * weight * summary["distance_m"], summary["work_input_J"])
    plain = simulate(Worm(), Plane(), actuation=gait, duration=1.0, dt=DT)
    assert plain.summary()["work_input_J"] is None
    assert "no source of energy" in plain.reasons()["cost_of_transport_input"]


def test_left_and_right_are_mirror_images() -> None:
    left, right = (
        simulate(Worm(), Plane(), actuation=TravellingWave(period=PERIOD, hinge=hinge), duration=2.0, dt=DT).summary()
        for hinge in (0.1, -0.1)
    )
    odd = {"degrees_per_wave_deg", "drift_per_metre", "heading_change_deg"}
    assert abs(float(left["degrees_per_wave_deg"])) > 0.1  # type: ignore[arg-type]
    for name in MEASURES.keys() - {"status", "real_time_factor", "return_map_radius"}:
        if isinstance(left[name], float):
            sign = -1.0 if name in odd else 1.0
            assert_allclose(right[name], sign * left[name], rtol=1e-5, atol=1e-8, err_msg=name)


def test_without_a_period_or_rows_there_is_a_reason(still: Result) -> None:
    names = ("stride_bl", "slip_per_metre", "effort", "return_map_radius")
    for run, why in (
        (replace(still, period=None), "no `period`"),
        (replace(still, period=99.0), "shorter than one period"),
        (replace(still, period=0.05), "fewer than 8 rows"),
    ):
        assert_array_equal([run.summary()[name] for name in names], None)
        assert all(why in run.reasons()[name] for name in names)
    uneven = replace(still, period=0.205)
    assert "whole number" in uneven.reasons()["return_map_radius"]


def test_a_vertical_worm_has_no_heading(still: Result) -> None:
    run = replace(still, joints=still.joints[..., [2, 1, 0]], com=still.com[:, [2, 1, 0]])
    assert "vertical" in run.reasons()["stride_bl"]
    assert "vertical" in run.reasons()["degrees_per_wave_deg"]


def test_on_the_clamped_ground() -> None:
    """The paper's worm slides with its joints; those that bear no load swing forward."""
    worm = Worm.planar(segments=4)
    run = simulate(worm, worm3d.ClampedGround(), actuation=TravellingWave(period=PERIOD), duration=2.0, dt=DT)
    summary = run.summary()
    assert float(summary["slip_per_metre"]) > 0.0  # type: ignore[arg-type]
    assert 0.0 <= float(summary["anchoring_duty"]) <= 1.0  # type: ignore[arg-type]
    assert float(summary["peak_wall_load_N"]) > 0.0  # type: ignore[arg-type]


def test_a_measure_of_ones_own(still: Result) -> None:
    @measure("head_height_m", "height of the head at the end")
    def head_height(result: Result) -> float:
        return float(result.joints[-1, -1, 2])

    try:
        own = replace(still).summary()
        assert own["head_height_m"] == still.joints[-1, -1, 2]
        with pytest.raises(ValueError, match="'head_height_m', which is taken"):
            measure("head_height_m", "again")(head_height)
    finally:
        del MEASURES["head_height_m"]


def test_what_is_no_number_has_no_value(still: Result) -> None:
    overflowing = replace(still, normal_load=np.full_like(still.normal_load, np.inf))
    with np.errstate(invalid="ignore"):
        assert overflowing.summary()["peak_wall_load_N"] is None
        assert "too large" in overflowing.reasons()["peak_wall_load_N"]


def test_the_table_is_documented() -> None:
    """Names end in their units, and NOTATION.md has the formula of each measure of a gait."""
    notation = (Path(worm3d.__file__).parent / "NOTATION.md").read_text()
    listed = re.findall(r"^\| `(\w+)` \|", notation, re.MULTILINE)
    for name, each in MEASURES.items():
        assert each.meaning, name
        assert named(name)[1] or not any(name.endswith(ending) for ending in METRIC_UNITS)
        assert name in listed or each.function.__module__ in (general.__name__, "functools"), name


def test_the_start_may_face_anywhere() -> None:
    runs = [
        simulate(
            Worm(),
            Plane(),
            actuation=TravellingWave(period=PERIOD, bias=0.2),
            duration=2.0,
            dt=DT,
            state=State.straight(Worm(), Plane(), (0.3, -0.1), azimuth),
        ).summary()
        for azimuth in (0.0, 2.6)
    ]
    for name in ("stride_bl", "degrees_per_wave_deg", "turning_radius_bl", "drift_per_metre", "slip_per_metre"):
        assert_allclose(runs[1][name], runs[0][name], rtol=1e-6, atol=1e-8, err_msg=name)
