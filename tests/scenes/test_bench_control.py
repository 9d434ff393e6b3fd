"""`worm3d bench control`: which cases, how they are resumed, and what the report says of them."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from scenes.bench import control, control_bars, control_figure, control_report
from scenes.bench.control import FULL, QUICK, SCENES, Found, Plan, Row, Trial
from scenes.kinds.worm_control import KIND
from scenes.loader import load_scene, shipped_scenes

TINY = Plan((Trial("tiny", "path_line", ("run.duration_s=6",)),), seeds=2, controllers=("pi_los", "open_loop"))


def found(trial: str, controller: str, seed: int, **figures: float | None) -> Found:
    names = (*control.METRICS, *control.TIMES, "control_period_ms")
    return Found(trial, controller, seed, "done", {**dict.fromkeys(names), "control_period_ms": 200.0, **figures})


def test_every_scene_with_a_controller_is_in_it() -> None:
    shipped = [name for name in shipped_scenes() if load_scene(name).kind is KIND]
    assert sorted(SCENES) == sorted(shipped)


def test_the_cases_are_all_seeds_but_of_the_blind_controller() -> None:
    cases = Plan(FULL, 5).cases()
    assert len(cases) == len(FULL) * (5 + 5 + 1)
    assert len({case.name for case in cases}) == len(cases)
    assert [case.load().settings.seed for case in cases[:5]] == [0, 1, 2, 3, 4]
    assert len(Plan(QUICK, 1).cases()) == 6


def test_a_study_that_was_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cases").mkdir()
    seen: list[int] = []
    first = control.study(TINY, tmp_path, seen.append)
    assert seen == [1, 2, 3]
    assert [each.status for each in first] == ["done"] * 3
    (tmp_path / "cases" / "tiny-pi_los-1.json").write_text("cut sh")
    changed = json.loads((tmp_path / "cases" / "tiny-open_loop-0.json").read_text())
    changed["scene"] += "# an older one"
    (tmp_path / "cases" / "tiny-open_loop-0.json").write_text(json.dumps(changed))
    ran: list[str] = []
    real = control.simulate

    def counted(scene):
        ran.append(scene.settings.controller.kind)
        return real(scene)

    monkeypatch.setattr(control, "simulate", counted)
    again = control.study(TINY, tmp_path)
    assert ran == ["pi_los", "open_loop"]
    for one, other in zip(first, again, strict=True):
        assert {name: one.figures[name] for name in control.METRICS} == {
            name: other.figures[name] for name in control.METRICS
        }


def test_the_worst_seed_counts_by_its_magnitude() -> None:
    values = (0.01, -0.03, 0.02)
    (row,) = control.rows([found("path_line", "mpc", k, speed_bias_relative=v) for k, v in enumerate(values)])
    assert (row.seeds, row.failed, row.figures["speed_bias_relative"]) == (3, 0, -0.03)
    unknown = [found("a", "mpc", 0, cross_track_rms_bl=0.1), found("a", "mpc", 1)]
    (row,) = control.rows(unknown)
    assert row.figures["cross_track_rms_bl"] is None


def verdict(rows: list[Row], trial: str, says: str) -> control_bars.Verdict:
    (one,) = [v for v in control_bars.verdicts(rows) if v.trial == trial and says in v.says]
    return one


def test_bars_are_kept_or_not() -> None:
    rows = list(
        control.rows(
            [
                found(
                    "path_line", "mpc", 0, cross_track_rms_bl=0.004, speed_bias_relative=-0.03, control_step_ms_p99=25.0
                ),
                found("path_line", "pi_los", 0, cross_track_rms_bl=0.003),
            ]
        )
    )
    assert verdict(rows, "path_line", "rms offset from the line").kept is True
    assert verdict(rows, "path_line", "below that of line-of-sight").kept is False
    assert verdict(rows, "path_line", "bias of the speed").kept is False
    assert verdict(rows, "path_line", "control steps").most == pytest.approx(20.0)
    assert verdict(rows, "path_line", "control steps").kept is False
    assert verdict(rows, "path_circle", "rms offset from the circle").kept is None


def test_what_never_settles_and_what_does_not_reach_its_end_keeps_no_bar() -> None:
    """Neither counts as "not run"; good figures of a run that stopped early flatter."""
    unsettled = found("velocity_step", "mpc", 0, settling_periods=None)
    stopped = replace(found("path_line", "mpc", 0, cross_track_rms_bl=0.001), status="diverged")
    rows = list(control.rows([unsettled, stopped]))
    assert verdict(rows, "velocity_step", "settled").kept is False
    assert verdict(rows, "path_line", "rms offset from the line").kept is False


def test_the_report_has_every_row_and_every_run() -> None:
    runs = [found("path_line", name, seed, speed_bias_relative=0.0123) for name in ("mpc", "pi_los") for seed in (0, 1)]
    rows = list(control.rows(runs))
    text = control_report.markdown(rows, {"cpu": "a processor", "system": "Linux", "date": "today"}, "control.png")
    assert "| path_line | mpc | 2 | 1.23 |" in text
    assert "![the worst of the seeds](control.png)" in text
    table = list(csv.DictReader(control_report.as_csv(runs).splitlines()))
    assert len(table) == 4
    assert float(table[0]["speed_bias_relative"]) == 0.0123
    assert table[0]["settling_periods"] == ""
    assert any("NOT KEPT" in line or "kept" in line for line in control_report.terminal_lines(rows))


def test_the_figure_shows_every_controller() -> None:
    runs = [found("path_line", name, 0, speed_error_rms_relative=0.01) for name in control.CONTROLLERS]
    figure = control_figure.draw(runs)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(control.CONTROLLERS)


def test_the_command_line(worm3d, tmp_path: Path) -> None:
    ended = worm3d("bench", "control", "--seeds", "0")
    assert (ended.code, ended.complaints) == (2, ["--seeds: got 0, must be at least 1"])
