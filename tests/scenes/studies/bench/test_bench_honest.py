"""What does not pay in `worm3d study control`: to rest, to be slow, to look at nothing, or to go by its rules."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from control.sensing.sensors import QUANTITIES
from control.tracking.paths import Circle, Line
from control.tracking.references import Constant, Reference, Steps
from scenes.models.loading import load_scene
from scenes.running.runner import simulate
from scenes.running.terminal import timing
from scenes.studies.bench import control
from scenes.studies.bench.control import Case
from scenes.studies.bench.control_error import MIN_RUN_DURATION_S, STARTUP_TIME_S, WINDOW, error_of
from scenes.studies.bench.control_score import RIVAL, scores
from scenes.studies.bench.control_trials import drawn

DULL, SHARP, LOSE = ("Rests", "Constant"), ("Slow", "Lies", "Stops", "Weaves"), ("RaisesLate", "Nothing", "Forces")
LINE_TRIAL, CURVE = (
    each._replace(overrides=(*each.overrides, "run.duration_s=11")) for each in (drawn(7, 7), drawn(7, 11))
)
"""A line and an S-curve, with grounds and sensors as they come. Seed 7 is the first from 2 on with six segments in
both: the strains of other worms would take seconds to find."""
CLEAR = 1.4
"""Score that rest, slowness, a constant wave and lies exceed; the others of the list only have to exceed 1."""


@pytest.mark.slow
def test_nothing_but_the_task_pays(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """One test, since all compare with the same runs."""
    monkeypatch.chdir(Path(__file__).parent)
    (tmp_path / "cases").mkdir()
    cases = [Case(trial, name) for trial in (LINE_TRIAL, CURVE) for name in (RIVAL, *map("cheats:{}".format, DULL))]
    cases += [Case(CURVE, f"cheats:{name}") for name in (*SHARP, *LOSE)]
    found = control.study(cases, tmp_path).found
    score = {each.controller.removeprefix("cheats:"): each for each in scores(found)}
    run = {each.controller.removeprefix("cheats:"): each for each in found if each.trial == CURVE.name}
    assert (score[RIVAL].score, score[RIVAL].worst < 0.5) == (1.0, True)
    assert [name for name in (*DULL, *SHARP, *LOSE) if score[name].score <= 1.0] == []
    assert [name for name in ("Rests", "Slow", "Constant", "Lies") if score[name].score <= CLEAR] == []
    assert {name: score[name].lost for name in (*DULL, *SHARP)} == dict.fromkeys((*DULL, *SHARP), 0)
    assert run["Rests"].error > 0.99, "nothing is worse"
    assert_allclose(run["Slow"].error, 0.6, atol=0.1, err_msg="60 % of the way are missing")
    assert run["Lies"].error == run["Slow"].error, "what it says of its waves changes nothing"
    for name, why in zip(LOSE, ("SystemExit", "contraction", "forces of the chambers"), strict=True):
        assert run[name].error == 1.0
        assert why in run[name].status


def test_a_sensor_of_its_own_loses_the_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parent)
    monkeypatch.setitem(QUANTITIES, "truth", replace(QUANTITIES["com"], standard=False))
    case = Case(LINE_TRIAL._replace(overrides=(*LINE_TRIAL.overrides, "run.duration_s=8")), "cheats:Sees")
    lost = control._measured(case, case.load())
    assert (lost.error, lost.status) == (1.0, "it senses truth, for which the worms of the trials have no sensor")


def test_the_time_of_a_controller_is_measured_from_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(__file__).parent)
    scene = load_scene("path_line", ["controller.kind=cheats:Late", "run.duration_s=1"])
    record = simulate(scene)
    (own,) = [each.values for each in record.timing if each.name == "control_step_s"]
    assert max(own[1:]) < 0.2 < 1e-3 * timing(record)["control_step_ms_p50"]
    assert timing(record)["real_time_factor"] < 1.0
    assert control._lost(record, scene.settings) == control.TOO_SLOW


TIME = np.arange(0.0, 40.0, 0.02)


def record_of(x: np.ndarray, y: np.ndarray | float = 0.0, heading: np.ndarray | float = 0.0) -> dict[str, np.ndarray]:
    com = np.column_stack([x, np.broadcast_to(y, x.shape), np.zeros_like(x)])
    return {"time": TIME[: len(x)], "com": com, "heading": np.broadcast_to(heading, x.shape)}


LINE = Reference(Constant(0.08), path=Line())
"""A line along x."""


@pytest.mark.parametrize(
    ("share", "y", "error"),
    [
        (1.0, 0.0, 0.0),
        (0.0, 0.0, 1.0),
        (0.5, 0.0, 0.5),
        (1.0, 0.1, 0.5),
        (1.6, 0.0, 0.6),
        (-1.0, 0.0, 1.0),
        (1.0, 9.0, 1.0),
    ],
)
def test_the_error_of_a_line(share: float, y: float, error: float) -> None:
    assert_allclose(error_of(record_of(share * 0.08 * TIME, y), LINE, 1.0)["error"], error, atol=1e-9)


def test_the_parts_of_the_error_have_units() -> None:
    parts = error_of(record_of(0.06 * TIME, 0.1), LINE, 2.0)
    assert_allclose([parts["way"], parts["offset_bl"], parts["error"]], [0.25, 0.05, np.hypot(0.25, 0.5)])
    assert parts["heading_deg"] is None


def test_rocking_by_waves_that_fill_the_window_costs_nothing_and_weaving_does() -> None:
    rocking = 0.08 * TIME + 0.01 * np.sin(2.0 * np.pi * 0.8 * TIME)
    assert error_of(record_of(rocking), LINE, 1.0)["error"] < 1e-9
    weaving = 0.1 * np.sin(2.0 * np.pi / WINDOW * TIME)
    assert_allclose(error_of(record_of(0.08 * TIME, weaving), LINE, 1.0)["error"], np.sqrt(0.5) * 0.5, rtol=0.01)


def test_of_going_in_circles_beside_the_path_nothing_is_gained() -> None:
    a = 0.4 * TIME
    assert error_of(record_of(0.2 * np.sin(a), 0.2 * np.cos(a)), LINE, 1.0)["error"] == 1.0
    circle = Reference(Constant(0.08), path=Circle(1.0, (0.0, 0.0)))
    a = 0.08 * TIME
    assert_allclose(error_of(record_of(np.sin(a), 1.0 - np.cos(a)), circle, 1.0)["error"], 0.0, atol=1e-9)
    assert_allclose(error_of(record_of(np.sin(a / 2), 1.0 - np.cos(a / 2)), circle, 1.0)["error"], 0.5, atol=1e-9)


def test_the_error_of_a_heading_is_that_of_the_way() -> None:
    asked = Reference(Constant(0.08), heading=Constant(0.3))
    way = 0.08 * TIME

    def error(heading: float, share: float = 1.0) -> float:
        run = record_of(share * way * np.cos(heading), share * way * np.sin(heading), heading)
        return error_of(run, asked, 1.0)["error"]

    assert_allclose(error(0.3), 0.0, atol=1e-9)
    assert_allclose(error(0.5), 2.0 * np.sin(0.1))
    assert_allclose(error(0.3, share=0.4), 0.6)
    assert_allclose([error(0.3, share=0.0), error(2.0, share=0.0), error(0.3 + np.pi)], 1.0)
    assert_allclose(error_of(record_of(way, 0.0, 0.2), asked, 1.0)["heading_deg"], np.rad2deg(0.1))


def test_who_stands_where_all_are_to_stop_and_go_has_the_greatest_error() -> None:
    asked = Reference(Steps(0.08, (15.0, 25.0), (0.0, 0.04)), path=Line())
    assert_allclose(error_of(record_of(0.0 * TIME), asked, 1.0)["error"], 1.0)
    way = np.cumsum(asked.speed(TIME)) * 0.02
    assert error_of(record_of(way), asked, 1.0)["error"] < 0.01


def test_the_start_does_not_count() -> None:
    late = 0.08 * np.maximum(TIME - STARTUP_TIME_S, 0.0)
    assert error_of(record_of(late), LINE, 1.0)["error"] < 1e-9
    assert error_of(record_of(0.08 * np.maximum(TIME - STARTUP_TIME_S - 0.5, 0.0)), LINE, 1.0)["error"] > 1e-4
    assert MIN_RUN_DURATION_S == STARTUP_TIME_S + 2.0 * WINDOW
