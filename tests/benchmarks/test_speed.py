"""`speed.py`: what the program measures is complete, finite and consistent; no time is asserted."""

from __future__ import annotations

import math
import re
import socket
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import calibration
import numpy as np
import pytest
import speed
import speed_measures
import speed_parts
from numpy.testing import assert_allclose
from speed_measures import MemoryGrowth, Speed, Start, StoppedError, Throughput, crawl, steps_of

from scenes.running.packages import machine
from worm3d import Status

TINY = speed.Plan(
    segments=(3, 4, 6),
    shares_of=(4,),
    duration_s=0.1,
    repeats=1,
    batch=2,
    batch_s=(0.1, 0.2),
    steps=50,
)
PARTS = [
    "kernels",
    "linear solver",
    "contact regimes",
    "start and end of a step",
    "ledger",
    "recording",
    "other",
]


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short runs, no fresh processes."""
    monkeypatch.setattr(speed, "measure_start", lambda: Start(6, 2.0, 0.5, False))
    monkeypatch.setattr(speed, "measure_memory", lambda steps: MemoryGrowth(6, steps, 12))
    monkeypatch.setattr(speed_parts, "BEFORE", 0.1)
    monkeypatch.setattr(speed_parts, "ROUNDS", 2)
    monkeypatch.setattr(speed_parts, "LOOP_S", 1e-4)


@pytest.fixture
def measured(tiny: None) -> speed.Study:
    return speed.measure(TINY)


def numbers_in(content: Any) -> Iterator[float]:
    """All numbers, however deep."""
    if isinstance(content, dict | list | tuple):
        for item in content.values() if isinstance(content, dict) else content:
            yield from numbers_in(item)
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield content


def test_all_is_measured_and_the_page_names_no_place(measured: speed.Study) -> None:
    assert all(math.isfinite(number) for number in numbers_in(asdict(measured)))
    _check_speeds(measured)
    _check_shares(measured)
    _check_batch(measured)
    page = speed.markdown(measured, "speed.png")
    assert measured.machine["cpu"] in page
    assert "/home" not in page
    assert str(Path.cwd()) not in page
    assert not re.search(rf"\b{re.escape(socket.gethostname())}\b", page)


def _check_speeds(study: speed.Study) -> None:
    assert [each.segments for each in study.speeds] == [3, 4, 6]
    for each in study.speeds:
        assert_allclose(each.real_time_factor, 1e6 * speed_measures.DT / each.us_per_step)
        assert each.real_time_factor_of_call < each.real_time_factor
        assert each.newton_iterations >= 1.0
        assert each.distance_error >= 0.0
    assert study.growth.segments == (3, 4, 6)


def _check_shares(study: speed.Study) -> None:
    (each,) = study.shares
    assert list(each.us) == list(each.fractions) == PARTS
    assert_allclose(sum(each.us.values()), each.us_per_step)
    assert_allclose(sum(each.fractions.values()), 1.0)
    assert min(each.us[part] for part in PARTS if part != "other") > 0.0


def _check_batch(study: speed.Study) -> None:
    kinds = [(each.duration_s, each.threads) for each in study.batch]
    assert kinds == [(0.1, 1), (0.1, 2), (0.2, 1), (0.2, 2)]
    for each in study.batch:
        assert each.equal
        assert_allclose(each.gain, each.single_s / each.batch_s)
    assert study.batch[0].over_one_thread == 1.0


@pytest.mark.parametrize(("sizes", "taken"), [((3, 6, 25, 50, 100), (25, 50, 100)), ((3, 6, 25), (3, 6, 25))])
def test_the_growth_is_fitted_to_long_worms(sizes: tuple[int, ...], taken: tuple[int, ...]) -> None:
    found = speed_measures.growth([speed_of(n, 5.0 * n**1.1) for n in sizes])
    assert_allclose([found.exponent, found.us_of_one], [1.1, 5.0])
    assert found.segments == taken


def speed_of(segments: int, us: float) -> Speed:
    return Speed(segments, 1.0, us, 1.1, 1e4 / us, 5e3 / us, 2.0, 4.0, 0, 1e-3)


def study() -> speed.Study:
    speeds = tuple(speed_of(n, 5.0 * n) for n in (3, 6))
    share = speed_parts.Shares(6, 10.0, {"kernels": 8.0, "other": 2.0})
    batch = Throughput(2, 6, 1, 1.0, 2.0, 1.0, 200.0, 2.0, 1.0, False)
    start, memory = Start(6, 2.0, 0.5, True), MemoryGrowth(6, 50, None)
    return speed.Study(machine(), TINY, 0.5, speeds, speed_measures.growth(speeds), (share,), (batch,), start, memory)


def test_what_is_not_known_or_not_equal_is_said() -> None:
    report = speed.markdown(study(), "p.png")
    assert "Growth over 50 steps: not known on this system." in report
    assert "1 s, 1 threads: distances differ from single runs." in report
    assert "N = 3: the default worm would be pressed flat by its weight" in report


def test_the_figure_shows_every_worm_and_every_part() -> None:
    times, bars = speed.draw(study()).axes
    assert_allclose(times.lines[1].get_ydata(), [15.0, 30.0])
    assert_allclose([bar.get_height() for bar in bars.patches], [80.0, 20.0])


def test_parts_of_a_step_are_counted_by_what_a_run_did() -> None:
    result = crawl(4, 0.2)
    counts = speed_parts.Counts.of(result)
    assert_allclose(counts.solves, 1.0 + result.breakaways.mean())
    us = {"whole": 1.0, "exchanged": 10.0, "residual": 100.0, "factorise": 3.0, "solve": 2.0}
    us |= {"ahead": 4.0, "expect": 0.5, "start": 6.0, "end": 7.0, "ledger": 8.0, "record": 9.0}
    parts = speed_parts.parts_of_step(us, speed_parts.Counts(1.5, 2.0, 3.0))
    linear = 2.0 * 3.0 + 3.0 * 2.0
    assert_allclose(list(parts.values()), [1.5 + 5.0 + 300.0, linear, 20.0 + 0.5, 13.0, 8.0, 9.0])


def test_a_run_that_stops_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stopped:
        status = Status.FOLDED
        stop = type("Stop", (), {"sentence": "it folded"})

    monkeypatch.setattr("worm3d.simulate", lambda *_, **__: Stopped)
    with pytest.raises(StoppedError, match=r"bench: the worm of 4 segments at dt = 0\.01 s: it folded"):
        crawl(4, 0.1)


def test_steps_fill_the_duration() -> None:
    assert [steps_of(1.0, dt) for dt in (0.1, 0.3, 1.0, 2.0)] == [10, 4, 1, 1]


def test_every_worm_of_the_plans_stands() -> None:
    for segments in (3, 4, 6):
        assert crawl(segments, 0.02).status is Status.DONE
    assert_allclose(np.asarray(speed_measures.standing(6).k_spring), np.asarray(speed_measures.standing(4).k_spring)[0])


def test_a_fresh_process_tells_its_memory() -> None:
    grown = speed_measures.measure_memory(10).grown_kib
    assert grown is None or grown >= 0


def test_a_fresh_process_is_timed_with_a_cache_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    caches: list[str] = []

    def run(code: str, *_: str, **environment: str) -> tuple[str, str]:
        caches.append(environment["XDG_CACHE_HOME"])
        return f"{speed_measures.time() + 1.0}\n", "compiling\n" if len(caches) == 1 else ""

    monkeypatch.setattr(speed_measures, "_python", run)
    start = speed_measures.measure_start(2)
    assert (len(caches), len(set(caches))) == (3, 1)
    assert not Path(caches[0]).exists()
    assert min(start.cold_s, start.warm_s) > 0.9
    assert start.cold_says_so


def test_a_fresh_process_that_fails_is_a_sentence() -> None:
    with pytest.raises(StoppedError, match=r"^bench: a fresh Python failed: ValueError: no$"):
        speed_measures._python("raise ValueError('no')")


def test_the_calibration_loop_solves_its_system() -> None:
    matrix = 4.0 * np.eye(3) + 0.5
    once = calibration.solve_often(matrix, 1)
    assert_allclose(once, np.linalg.solve(matrix, np.ones(3)))
    assert_allclose(calibration.solve_often(matrix, 2), np.linalg.solve(matrix, 1.0 + once))
