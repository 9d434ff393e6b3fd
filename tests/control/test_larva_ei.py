"""The larva's network on its own mechanics, against its published figures, and on the worm."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import worm3d
from control.gaits import LarvaEI
from control.gaits.larva_ei.kernel import Parameters
from control.gaits.larva_ei.network import Crawling, crawling


@cache
def larva(duration: float = 200.0, dt: float = 1e-3) -> Crawling:
    return crawling(duration, dt=dt)


def test_published_figures() -> None:
    found = larva()
    assert_allclose(1.0 / found.period, 0.0378, rtol=0.02)
    assert_allclose(found.speed, 0.0368, rtol=0.02)
    assert_allclose(found.peak_contraction, 0.298, rtol=0.02)
    assert found.lifted == 3.0


def test_time_step_is_short_enough() -> None:
    coarse, fine = larva(150.0), larva(150.0, 0.25e-3)
    for figure in ("period", "speed", "peak_contraction"):
        assert_allclose(getattr(coarse, figure), getattr(fine, figure), rtol=2e-3)


def test_the_mechanics_balance_forces() -> None:
    # Velocities from one row to the next, where nothing switches between: nodes move only where friction is overcome.
    found, p = larva(), Parameters()
    step = found.time[1] - found.time[0]
    u, f = found.nodes[-2], found.force[-2]
    v = (found.nodes[-1] - u) / step
    rates = -np.diff(v)
    resisted = (1.0 - found.contraction[-2]) + p.c * rates + f  # of each segment; interior nodes see the difference
    pull = resisted[:-1] - resisted[1:]
    friction = np.where(f[:-1] > p.f_half, 0.0, p.F_max)
    assert (np.abs(pull) <= friction + 0.01).all()
    assert (np.abs(v[1:-1][friction > 0.0]) < 1e-9).all()
    assert np.abs(v).max() > 0.05


def test_the_body_keeps_its_length_and_moves_to_the_head() -> None:
    nodes = larva().nodes
    assert_allclose(nodes[:, 0] - nodes[:, -1], 10.0, rtol=1e-12)
    ways = np.diff(nodes, axis=0)
    assert (np.maximum(-ways, 0.0).sum(axis=0) < 1e-3 * ways.sum(axis=0)).all()  # as friction lets go or takes hold


def test_waves_run_from_tail_to_head() -> None:
    found = larva()
    first = [found.time[(found.excitation[:, i] > 0.4).argmax()] for i in range(10)]
    assert (np.diff(first) < 0.0).all()


def test_without_feeling_there_are_no_waves() -> None:
    with pytest.raises(ValueError, match="the larva carries no waves"):
        _ = crawling(100.0, parameters=Parameters(w_Ep=0.0)).period


def crawl(lag: float = 0.05, segments: int = 6, **given: Any) -> tuple[worm3d.Result, list[int]]:
    """Let a worm crawl for twelve seconds; return the run and the segments in the order of their contractions."""
    worm = worm3d.Worm(segments=segments, actuator_lag=lag)
    result = worm3d.simulate(worm, worm3d.Plane(), actuation=LarvaEI(amplitude=0.3, **given), duration=12.0, dt=0.01)
    command = result.contraction.mean(axis=2)
    rows, columns = np.nonzero((command[1:] > 0.15) & (command[:-1] <= 0.15))
    return result, [int(each) for each in columns[np.argsort(rows, kind="stable")]]


@pytest.mark.parametrize(("lag", "period", "segments"), [(0.02, 2.0, 6), (0.2, 2.0, 6), (0.05, 4.0, 8)])
def test_it_carries_waves_and_crawls(lag: float, period: float, segments: int) -> None:
    result, order = crawl(lag, segments, period=period)
    assert len(order) > 1.5 * segments
    assert set(np.diff(order) % segments) == {segments - 1}  # from head to tail, and from the tail to the head again
    assert result.distance > 0.1 * 12.0 / period * float(result.worm.length) / 3.0


def test_the_other_way() -> None:
    result, order = crawl(direction="direct")
    assert set(np.diff(order) % 6) == {1}
    back, _ = crawl()
    assert back.distance > 2.0 * abs(result.distance)


def test_slower_actuators_make_slower_waves() -> None:
    counts = [len(crawl(lag)[1]) for lag in (0.02, 0.1, 0.3)]
    assert counts[0] > counts[1] > counts[2] > 6


def test_bad_gaits() -> None:
    with pytest.raises(ValueError, match="needs 3 segments or more for a wave; the worm has 2"):
        LarvaEI().require_body(2)
    with pytest.raises(ValueError, match=r"feeling_threshold: got 1.5, must be finite and in \(0, 1\)"):
        LarvaEI(feeling_threshold=1.5)
    with pytest.raises(ValueError, match="senses strain"):
        LarvaEI().activations(np.zeros(1), 6)
