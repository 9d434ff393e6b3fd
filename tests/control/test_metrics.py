"""Metrics of tracking on motions of which they are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.tracking.metrics import METRICS, Motion, settling_periods, summary, tracking
from control.tracking.paths import Circle, Line
from control.tracking.references import Constant, Reference, Sine, Steps

TIME = 0.01 * np.arange(3001)
PERIOD = 1.25


def motion(place: np.ndarray, heading: np.ndarray | float = 0.0, period: float = PERIOD) -> Motion:
    return Motion(TIME, place, np.broadcast_to(heading, TIME.shape).astype(float), TIME / period)


def along_x(speed: float, y: float = 0.0, rocking: float = 0.0) -> np.ndarray:
    rock = np.sin(2 * np.pi * TIME / PERIOD)
    return np.column_stack([speed * TIME + rocking * rock, y + rocking * rock])


def figures(made: Motion, reference: Reference, length: float = 1.0) -> dict[str, float | None]:
    return summary(tracking(made, reference), reference, length)[0]


def test_a_steady_worm_is_measured_without_its_rocking() -> None:
    found = figures(motion(along_x(0.082, 0.03, rocking=0.02)), Reference(Constant(0.08), path=Line()), length=2.0)
    assert found["speed_bias_relative"] == pytest.approx(0.025, abs=1e-6)
    assert found["speed_error_rms_relative"] == pytest.approx(0.025, abs=1e-6)
    assert found["cross_track_rms_bl"] == pytest.approx(0.015, abs=1e-6)
    assert found["cross_track_max_bl"] == pytest.approx(0.015, abs=1e-6)
    assert found["settling_periods"] is None


def test_left_is_positive_and_headings_are_taken_within_half_a_turn() -> None:
    reference = Reference(Constant(0.08), path=Line(azimuth=np.pi))
    place = np.column_stack([-0.08 * TIME, np.full_like(TIME, -0.1)])  # to the left of a worm that looks along -x
    tracked = tracking(motion(place, -np.pi + np.deg2rad(2.0)), reference)
    assert_allclose(tracked.cross_track, 0.1, atol=1e-12)
    assert_allclose(np.rad2deg(tracked.heading_error), 2.0, atol=1e-9)
    found = figures(motion(place, -np.pi + np.deg2rad(2.0)), reference)
    assert found["heading_error_mean_deg"] == pytest.approx(2.0)
    assert found["heading_error_rms_deg"] == pytest.approx(2.0)


def test_a_circle_of_another_radius_has_that_offset() -> None:
    reference = Reference(Constant(0.08), path=Circle(1.5))
    turn = 0.08 / 1.5 * TIME
    place = np.column_stack([1.45 * np.sin(turn), 1.5 - 1.45 * np.cos(turn)])
    found = figures(motion(place, turn), reference)
    assert found["cross_track_rms_bl"] == pytest.approx(0.05, abs=1e-9)
    assert found["heading_error_rms_deg"] == pytest.approx(0.0, abs=1e-3)
    chord = np.sinc(0.08 / 1.5 * PERIOD / 2 / np.pi)
    assert found["speed_bias_relative"] == pytest.approx(chord * 1.45 / 1.5 - 1.0, abs=1e-6)


def test_the_head_of_a_straight_worm_on_a_circle_is_outside() -> None:
    radius, length = 0.6, 0.8
    turn = 0.08 / radius * TIME
    com = radius * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
    head = com + length / 2.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    made = Motion(TIME, com, turn, TIME / PERIOD, head)
    found = figures(made, Reference(Constant(0.08), path=Circle(radius)), length)
    outside = (np.hypot(radius, length / 2.0) - radius) / length
    assert found["head_offset_rms_bl"] == pytest.approx(outside, abs=1e-9)
    assert found["head_offset_max_bl"] == pytest.approx(outside, abs=1e-9)
    assert found["cross_track_mean_bl"] == pytest.approx(0.0, abs=1e-9)
    assert figures(motion(com, turn), Reference(Constant(0.08), path=Circle(radius)))["head_offset_rms_bl"] is None


def test_a_worm_joins_its_path_when_it_stays_there() -> None:
    """It comes towards the path by 0.01 m/s from 0.2 m, so that the mean over a period is half a period late."""
    place = np.column_stack([0.08 * TIME, np.maximum(0.2 - 0.01 * TIME, -0.05)])
    reference = Reference(Constant(0.08), path=Line())
    within = 0.02 * 2.0
    found = figures(motion(place), reference, 2.0)
    assert found["joining_periods"] is None  # it goes on to -0.05
    place[:, 1] = np.maximum(place[:, 1], 0.0)
    found = figures(motion(place), reference, 2.0)
    assert found["joining_periods"] == pytest.approx((0.2 - within) / 0.01 / PERIOD + 0.5, abs=0.02)
    assert figures(motion(along_x(0.08)), reference, 2.0)["joining_periods"] == pytest.approx(1.0)
    assert figures(motion(along_x(0.08)), Reference(Constant(0.08)))["joining_periods"] is None


def test_a_worm_that_stops_beside_the_end_of_its_path() -> None:
    """It stops 0.03 m short of the end, 0.04 m to the left: 0.05 m off. What it does there is not held against it."""
    reference = Reference(Constant(0.08), path=Line(length=1.03), ends=True)
    place = np.column_stack([np.minimum(0.08 * TIME, 1.0), np.where(TIME < 12.5, 0.0, 0.04)])
    found = figures(motion(place), reference, 2.0)
    assert found["end_error_bl"] == pytest.approx(0.025)
    assert found["speed_error_rms_relative"] == pytest.approx(0.0, abs=1e-9)
    assert found["cross_track_max_bl"] == pytest.approx(0.0, abs=1e-9)
    made, endless = motion(along_x(0.02)), Reference(Constant(0.08), path=Line())
    far, why = summary(tracking(made, reference), reference, 2.0)
    assert (far["end_error_bl"], why["end_error_bl"]) == (
        None,
        "the worm has not been at the end of its path for 4 s",
    )
    assert summary(tracking(made, endless), endless, 2.0)[1]["end_error_bl"] == "the reference has no end"


def test_the_bias_of_a_speed_of_zero_has_a_value() -> None:
    found = figures(motion(along_x(0.002)), Reference(Constant(0.0), path=Line()))
    assert found["speed_bias_m_s"] == pytest.approx(0.002)
    assert found["speed_bias_relative"] is None


def test_speed_without_a_path_counts_along_the_heading() -> None:
    azimuth = 0.3
    place = np.outer(0.08 * TIME, [np.cos(0.5), np.sin(0.5)])
    found = figures(motion(place, azimuth), Reference(Constant(0.08), heading=Constant(0.25)))
    assert found["speed_bias_relative"] == pytest.approx(np.cos(0.2) - 1.0, abs=1e-9)
    assert found["heading_error_mean_deg"] == pytest.approx(np.rad2deg(0.05))
    assert found["cross_track_rms_bl"] is None


def test_the_first_three_periods_are_left_out() -> None:
    late = 4.0 * PERIOD
    place = np.column_stack([np.where(late > TIME, 0.0, 0.08 * (TIME - late)), np.zeros_like(TIME)])
    tracked = tracking(motion(place), Reference(Constant(0.08), path=Line()))
    assert tracked.time[0] == pytest.approx(PERIOD)
    assert tracked.time[tracked.counted][0] == pytest.approx(4.0 * PERIOD)
    early = np.column_stack([np.where(3.0 * PERIOD > TIME, 0.0, 0.08 * (TIME - 3.0 * PERIOD)), np.zeros_like(TIME)])
    found = figures(motion(early), Reference(Constant(0.08), path=Line()))
    assert found["speed_error_rms_relative"] == pytest.approx(0.0, abs=1e-9)


def test_windows_after_a_step_count_but_not_for_the_settled_figures() -> None:
    """The worm goes on at 0.05 m/s for two periods after a step to 0.08 m/s, and then keeps to that."""
    step, late = 10.005, 10.0 + 2.0 * PERIOD  # between two rows: a window never has a part of it
    place = np.column_stack([np.where(late > TIME, 0.05 * TIME, 0.05 * late + 0.08 * (TIME - late)), 0.0 * TIME])
    reference = Reference(Steps(0.05, (step,), (0.08,)), path=Line())
    tracked, found = tracking(motion(place), reference), figures(motion(place), reference)
    assert found["speed_bias_settled_relative"] == pytest.approx(0.0, abs=1e-9)
    assert found["speed_error_rms_settled_relative"] == pytest.approx(0.0, abs=1e-9)
    lost = -0.03 * (late - step)  # [m], of all windows together
    wanted = 0.01 * tracked.wanted_speed[tracked.counted].sum()
    assert found["speed_bias_relative"] == pytest.approx(lost / wanted, rel=1e-3)
    assert found["speed_error_rms_relative"] > 0.1
    after = (tracked.time > step) & (tracked.time < step + 4.0 * PERIOD)
    np.testing.assert_array_equal(tracked.counted & ~tracked.settled, after)


def test_without_a_step_the_settled_figures_are_the_same() -> None:
    found = figures(motion(along_x(0.082)), Reference(Constant(0.08), path=Line()))
    assert found["speed_bias_settled_relative"] == found["speed_bias_relative"]
    assert found["speed_error_rms_settled_relative"] == found["speed_error_rms_relative"]


def test_steps_that_come_too_fast_leave_no_settled_figures() -> None:
    times = tuple(float(t) for t in range(1, 30, 3))
    reference = Reference(Steps(0.05, times, (0.05, 0.06) * 5), path=Line())
    found, reasons = summary(tracking(motion(along_x(0.05)), reference), reference, 1.0)
    assert found["speed_bias_relative"] is not None
    assert found["speed_bias_settled_relative"] is None
    assert "no window lies beyond the 3 periods after each step" in reasons["speed_bias_settled_relative"]


def test_the_phase_at_the_beginning_does_not_matter() -> None:
    place, reference = along_x(0.082, rocking=0.02), Reference(Steps(0.08, (15.0,), (0.09,)), path=Line())
    made = motion(place)
    later = Motion(made.time, made.com, made.heading, made.waves + 0.75)
    assert tracking(made, reference).counted.sum() == tracking(later, reference).counted.sum()
    assert tracking(made, reference).settled.sum() == tracking(later, reference).settled.sum()


def test_a_reference_that_changes_slowly_is_averaged_like_the_worm() -> None:
    place = np.column_stack([0.06 * TIME - 0.02 * 10 / (2 * np.pi) * (np.cos(2 * np.pi * TIME / 10) - 1), 0 * TIME])
    found = figures(motion(place), Reference(Sine(0.06, 0.02, 10.0)))
    assert found["speed_error_rms_relative"] == pytest.approx(0.0, abs=1e-5)


def test_settling_counts_periods_until_the_last_time_outside() -> None:
    reference = Reference(Steps(0.04, (12.0,), (0.08,)))
    # The speed follows with a time constant of 1 s; averaged over a period it enters the band later.
    speed = np.where(TIME < 12.0, 0.04, 0.08 - 0.04 * np.exp(-(TIME - 12.0)))
    place = np.column_stack([np.concatenate([[0.0], np.cumsum(0.005 * (speed[1:] + speed[:-1]))]), 0 * TIME])
    found, why = settling_periods(tracking(motion(place), reference), reference)
    lag = (np.exp(PERIOD) - 1.0) / PERIOD  # of the mean of an exponential over the window before
    assert found == pytest.approx(np.log(0.04 * lag / 0.008) / PERIOD, abs=0.02)
    assert why == ""
    assert figures(motion(place), reference)["settling_periods"] == found


def test_every_step_counts_until_the_next_one() -> None:
    reference = Reference(Steps(0.04, (10.0, 20.0), (0.08, 0.06)))
    ideal = np.concatenate([[0.0], np.cumsum(0.01 * reference.speed(TIME[1:] - 0.005))])
    found, _ = settling_periods(tracking(motion(np.column_stack([ideal, 0 * TIME])), reference), reference)
    # The mean over the period before is within 10 % of 0.08 when four fifths of the period have the new speed.
    assert found == pytest.approx(0.8, abs=0.02)


def test_a_speed_that_does_not_settle_is_said_to() -> None:
    reference = Reference(Steps(0.04, (12.0,), (0.08,)))
    found, why = settling_periods(tracking(motion(along_x(0.05)), reference), reference)
    assert found is None
    assert why == "the speed has not settled after the step at 12 s"


def test_periods_may_change() -> None:
    waves = np.where(TIME < 15.0, TIME / 2.0, 7.5 + (TIME - 15.0))
    rock = 0.02 * np.sin(2 * np.pi * waves)
    made = Motion(TIME, np.column_stack([0.08 * TIME + rock, rock]), np.zeros_like(TIME), waves)
    tracked = tracking(made, Reference(Constant(0.08), path=Line()))
    steady = (tracked.time < 14.9) | (tracked.time > 17.0)
    assert_allclose(tracked.cross_track[steady], 0.0, atol=1e-5)
    assert_allclose(tracked.speed[steady], 0.08, rtol=1e-3)


def test_short_runs_have_reasons() -> None:
    short = Motion(TIME[:300], along_x(0.08)[:300], np.zeros(300), TIME[:300] / PERIOD)
    found, reasons = summary(tracking(short, Reference(Constant(0.08))), Reference(Constant(0.08)), 1.0)
    assert all(found[name] is None and "3 periods" in reasons[name] for name in METRICS)
    with pytest.raises(ValueError, match="shorter than one commanded period"):
        tracking(Motion(TIME[:50], along_x(0.08)[:50], np.zeros(50), TIME[:50]), Reference(Constant(0.08)))


@pytest.mark.parametrize("lag", [0.5, 3.0])
def test_response_times_of_speeds_and_headings_that_rise(lag: float) -> None:
    """A worm that follows a step by first order: the mean over a period T reaches 90 % at a known time."""
    begin = 10.0
    since = np.maximum(0.0, TIME - begin)
    way = 0.04 * TIME + 0.04 * (since - lag * (1.0 - np.exp(-since / lag)))
    heading = 0.2 + 0.5 * (1.0 - np.exp(-since / lag))
    place = np.column_stack([way, 0.0 * way])
    expected = lag * np.log(lag * np.expm1(PERIOD / lag) / (0.1 * PERIOD))
    straight = figures(motion(place), Reference(Steps(0.04, (begin,), (0.08,)), heading=Constant(0.0)))
    assert straight["speed_response_time_s"] == pytest.approx(expected, abs=1e-3)
    assert straight["heading_response_time_s"] is None
    turning = figures(motion(place, heading), Reference(Constant(0.04), heading=Steps(0.2, (begin,), (0.7,))))
    assert turning["heading_response_time_s"] == pytest.approx(expected, abs=1e-3)
    assert turning["speed_response_time_s"] is None


def test_a_worm_that_does_not_answer_has_no_response_time() -> None:
    made, reference = motion(along_x(0.04)), Reference(Steps(0.04, (10.0, 20.0), (0.08, 0.04)), path=Line())
    found, reasons = summary(tracking(made, reference), reference, 1.0)
    assert found["speed_response_time_s"] is None
    assert "after the step at 10 s it does not keep 90% of its new value" in reasons["speed_response_time_s"]
    assert "no step" in reasons["heading_response_time_s"]
