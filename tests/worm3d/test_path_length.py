"""The way of the centre of mass: nothing of it is lost at the ends, and no wave lengthens it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.gaits import TravellingWave
from worm3d import Plane, State, Worm, simulate
from worm3d.values.period_means import path_length

DT = 0.01


def rocked(period: float, phase: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places on a line of 0.1 m/s that a wave rocks back and forth, faster than that, and their times."""
    time = np.arange(0.0, duration + DT / 2.0, DT)
    size = 0.01 * period
    x = 0.1 * time + size * np.sin(2.0 * np.pi * time / period + phase)
    y = size * np.cos(4.0 * np.pi * time / period)
    return np.column_stack([x, y, np.full_like(time, 0.05)]), time


@pytest.mark.parametrize("period", [0.5, 0.777, 2.0, np.pi])
@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5, 4.0])
def test_no_wave_lengthens_the_way(period: float, phase: float) -> None:
    for periods in (1.0, 1.5, 7.3):
        com, time = rocked(period, phase, periods * period)
        chord = float(np.linalg.norm(com[-1] - com[0]))
        assert chord * (1.0 - 1e-12) <= path_length(com, time, period) <= chord + 0.04 * period * 0.1 + 0.02 * chord


@pytest.mark.parametrize("period", [2.0, 1.997, 0.5])
def test_a_planar_way_is_whole_without_the_rocking(period: float) -> None:
    """A line of 0.3 m/s, rocked with the period, of a whole number of time steps or not."""
    time = np.linspace(0.0, 10.0, 1001)
    x = 0.3 * time + 0.05 * np.sin(2.0 * np.pi * time / period)
    com = np.column_stack([x, np.zeros_like(time)])
    assert_allclose(path_length(com, time, period), np.ptp(x[[0, -1]]), rtol=1e-4)
    assert_allclose(path_length(com[:, ::-1], time, period), np.ptp(x[[0, -1]]), rtol=1e-4)
    assert_allclose(path_length(com[:100], time[:100], 4.0 * period), np.ptp(x[[0, 99]]), rtol=1e-10)


def test_a_bend_has_the_length_of_its_arc() -> None:
    angle = np.linspace(0.0, np.pi, 2001)
    arc = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    assert_allclose(path_length(arc, np.linspace(0.0, 20.0, 2001), 0.5), np.pi, rtol=1e-3)


def test_uneven_times_and_no_time() -> None:
    time = np.array([0.0, 0.3, 0.4, 1.1, 1.2, 2.0])
    com = np.outer(time, [0.3, 0.4, 0.0])
    assert_allclose(path_length(com, time, 0.7), 1.0, rtol=1e-12)
    assert_allclose(path_length(com, time, 5.0), 1.0, rtol=1e-12)
    assert path_length(com[:1], time[:1], 0.7) == 0.0


@pytest.mark.parametrize(
    ("gait", "slope", "duration"),
    [
        (TravellingWave(), 0.0, 10.0),
        (TravellingWave(), 0.1, 10.0),
        (TravellingWave(period=0.5), 0.0, 4.0),
        (TravellingWave(period=0.777, amplitude=0.3), 0.0, 3.0),
        (TravellingWave(), 0.0, 3.0),
        (TravellingWave(), 0.0, 1.3),
    ],
    ids=["default", "slope", "fast", "odd period", "a period and a half", "less than a period"],
)
def test_a_straight_run_has_the_length_of_its_distance(gait, slope: float, duration: float) -> None:
    result = simulate(Worm(), Plane(slope=slope), actuation=gait, duration=duration)
    figures = result.summary()
    assert figures["distance_m"] > 0.01
    assert_allclose(figures["path_length_m"], figures["distance_m"], rtol=0.02)


def test_the_heading_of_the_start_and_a_turn_do_not_matter() -> None:
    gait = TravellingWave(hinge=0.4)
    lengths = []
    for azimuth in (0.0, 2.0):
        start = State.straight(Worm(), Plane(), azimuth=azimuth)
        figures = simulate(Worm(), Plane(), actuation=gait, duration=8.0, state=start).summary()
        assert figures["path_length_m"] > 1.02 * figures["distance_m"]
        lengths.append(figures["path_length_m"])
    assert_allclose(*lengths, rtol=1e-3)
