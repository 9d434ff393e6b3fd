"""`speed.py`: what the program measures is complete, finite and consistent; no time is asserted."""

from __future__ import annotations

import re
import socket
from pathlib import Path

import calibration
import numpy as np
import pytest
import speed
import speed_measures
import speed_parts
from numpy.testing import assert_allclose
from speed_measures import Speed, StoppedError, crawl, steps_of

from scenes.running.packages import machine
from worm3d import Status

TINY = speed.Plan(segments=(3, 4, 6), shares_of=(4,), duration_s=0.1, repeats=1, batch=2, batch_s=(0.1, 0.2), steps=50)
PARTS = ["kernels", "linear solver", "contact regimes", "start and end of a step", "ledger", "recording"]


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short runs, no fresh processes."""
    monkeypatch.setattr(speed, "measure_start", lambda: (2.0, 0.5, "compiling"))
    monkeypatch.setattr(speed, "measure_memory", lambda steps: 2048)
    monkeypatch.setattr(speed_parts, "ROUNDS", 2)
    monkeypatch.setattr(speed_parts, "LOOP_S", 1e-4)


@pytest.mark.slow
def test_all_is_measured_and_the_page_names_no_place(tiny: None) -> None:
    page = speed.page(TINY)
    assert not re.search(r"\b(nan|inf)\b", page)
    assert re.findall("^## (.*)", page, re.MULTILINE) == [
        *("Time of a step", "What a step is spent on", "2 worms at once", "Start", "Memory")
    ]
    assert all(f"\n| {part} | " in page for part in (*PARTS, "other", "a step", "cold", "warm"))
    assert page.count("N = 3: the default worm would be pressed flat, its chambers are thrice as stiff") == 1
    assert re.search(r"Growth: N\^\S+, least squares in log-log over N = 3, 4, 6\.", page)
    assert "Growth over 50 steps: 2.0 MiB." in page
    assert "The cold start compiles with a message." in page
    assert "distances differ" not in page
    assert machine()["cpu"] in page
    for place in ("/home", str(Path.cwd())):
        assert place not in page
    assert not re.search(rf"\b{re.escape(socket.gethostname())}\b", page)


def test_what_is_not_known_or_not_equal_is_said(tiny: None, monkeypatch: pytest.MonkeyPatch) -> None:
    unequal = speed_measures.Throughput(1, 1.0, 2.0, 1.0, 200.0, 2.0, 1.0, False)
    monkeypatch.setattr(speed, "measure_memory", lambda steps: None)
    monkeypatch.setattr(speed, "measure_throughput", lambda *_: [unequal])
    assert "Growth over 50 steps: not known on this system.\n" in list(speed.memory(TINY))
    assert "1 s, 1 threads: distances differ from single runs.\n" in list(speed.batches(TINY))


def test_figures_of_a_speed_belong_together() -> None:
    found = speed_measures.measure_speed(4, 0.1, 1)
    assert_allclose(found.real_time_factor, 1e6 * speed_measures.DT / found.us_per_step)
    assert found.real_time_factor_of_call < found.real_time_factor
    assert found.newton_iterations >= 1.0
    assert found.distance_error >= 0.0


@pytest.mark.slow
def test_parts_add_up_to_the_step(tiny: None) -> None:
    us = speed_parts.measure_shares(4, 0.1)
    assert list(us) == [*PARTS, "other", "a step"]
    assert_allclose(sum(us.values()), 2.0 * us["a step"])
    assert min(us[part] for part in PARTS) > 0.0


def test_batches_are_measured_on_one_thread_and_on_two() -> None:
    found = speed_measures.measure_throughput(2, 0.1, 1)
    assert [(each.duration_s, each.threads) for each in found] == [(0.1, 1), (0.1, 2)]
    for each in found:
        assert each.equal
        assert_allclose(each.gain, each.single_s / each.batch_s)
    assert found[0].over_one_thread == 1.0


@pytest.mark.parametrize(("sizes", "taken"), [((3, 6, 25, 50, 100), [25, 50, 100]), ((3, 6, 25), [3, 6, 25])])
def test_the_growth_is_fitted_to_long_worms(sizes: tuple[int, ...], taken: list[int]) -> None:
    exponent, of = speed_measures.growth([speed_of(n, 5.0 * n**1.1) for n in sizes])
    assert_allclose(exponent, 1.1)
    assert of == taken


def speed_of(segments: int, us: float) -> Speed:
    return Speed(segments, 1.0, us, 1.1, 1e4 / us, 5e3 / us, 2.0, 4.0, 0, 1e-3)


def test_parts_of_a_step_are_counted_by_what_a_run_did() -> None:
    us = {"whole": 1.0, "exchanged": 10.0, "residual": 100.0, "factorise": 3.0, "solve": 2.0}
    us |= {"ahead": 4.0, "expect": 0.5, "start": 6.0, "end": 7.0, "ledger": 8.0, "record": 9.0}
    parts = speed_parts.parts_of_step(us, 0.5, 2.0, 3.0)
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
    grown = speed_measures.measure_memory(10)
    assert grown is None or grown >= 0


def test_a_fresh_process_is_timed_with_a_cache_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    caches: list[str] = []

    def run(code: str, *_: str, **environment: str) -> tuple[str, str]:
        caches.append(environment["XDG_CACHE_HOME"])
        return f"{speed_measures.time() + 1.0}\n", "compiling\n" if len(caches) == 1 else ""

    monkeypatch.setattr(speed_measures, "_python", run)
    cold, warm, said = speed_measures.measure_start()
    assert (len(caches), len(set(caches))) == (4, 1)
    assert not Path(caches[0]).exists()
    assert min(cold, warm) > 0.9
    assert said == "compiling\n"


def test_a_fresh_process_that_fails_is_a_sentence() -> None:
    with pytest.raises(StoppedError, match=r"^bench: a fresh Python failed: ValueError: no$"):
        speed_measures._python("raise ValueError('no')")


def test_the_calibration_loop_solves_its_system() -> None:
    matrix = 4.0 * np.eye(3) + 0.5
    once = calibration.solve_often(matrix, 1)
    assert_allclose(once, np.linalg.solve(matrix, np.ones(3)))
    assert_allclose(calibration.solve_often(matrix, 2), np.linalg.solve(matrix, 1.0 + once))
