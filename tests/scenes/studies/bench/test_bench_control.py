"""`worm3d bench control`: which cases, how they are resumed, and what the report says of them."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import control_page
import pytest

from scenes.language.errors import SceneError
from scenes.language.loader import shipped_scenes
from scenes.models.control import build
from scenes.models.control.model import MODEL
from scenes.models.loading import load_scene
from scenes.running import packages
from scenes.studies.bench import control, control_bars, control_report, control_score, control_trials
from scenes.studies.bench.control import Found, Plan, Row
from scenes.studies.bench.control_trials import FULL, QUICK, SCENES, Trial

STANDS_OR_RAISES = """
import numpy as np
import worm3d
from control.parts import part


@part("controller")
class Still:
    @classmethod
    def of(cls, *given):
        return cls()

    def reset(self):
        pass

    def step(self, t, measurement):
        return worm3d.Command(np.zeros((6, 2)))


@part("controller")
class Raises(Still):
    def step(self, t, measurement):
        raise RuntimeError("valve stuck")
"""
TINY = Plan((Trial("tiny", "path_line", ("run.duration_s=6",)),), seeds=2, controllers=("pi_los", "open_loop"))


def found(trial: str, controller: str, seed: int, **figures: float | None) -> Found:
    metrics = {**dict.fromkeys(control.METRICS), control.PERIOD: 200.0, **figures}
    return Found(trial, controller, seed, "done", metrics)


def test_every_scene_with_a_controller_is_in_it() -> None:
    loaded = {name: load_scene(name) for name in shipped_scenes()}
    shipped = [name for name, scene in loaded.items() if scene.model is MODEL]
    usual = [name for name in shipped if loaded[name].settings.controller.kind in control.CONTROLLERS]
    assert sorted((*(trial.scene for trial in SCENES), *control_trials.UNSCORED)) == sorted(usual)


def test_the_cases_are_all_seeds_but_of_the_blind_controller() -> None:
    cases = Plan(FULL, 5).cases()
    assert len(cases) == len(FULL) * (5 + 5 + 1)
    assert len({case.file(Path()) for case in cases}) == len(cases)
    assert [case.load().settings.seed for case in cases[:5]] == [0, 1, 2, 3, 4]
    assert len(Plan(QUICK, 1).cases()) == 6


def test_a_study_that_was_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs again what is broken, of another scene, or by other programs; the rest it keeps."""
    (tmp_path / "cases").mkdir()
    seen: list[int] = []
    first = control.study(TINY, tmp_path, seen.append)
    assert seen == [1, 2, 3]
    assert (first.kept, first.outdated) == (0, 0)
    assert [each.status for each in first.found] == ["done"] * 3
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
    assert (again.kept, again.outdated) == (1, 2)
    for one, other in zip(first.found, again.found, strict=True):
        same = control.METRICS.keys() - control.WALL_CLOCK
        assert {name: one.metrics[name] for name in same} == {name: other.metrics[name] for name in same}
    case = TINY.cases()[0]
    file = case.file(tmp_path)
    assert control._kept(case, case.load(), tmp_path) is not None
    file.write_text(file.read_text().replace('"seed": 0', '"seed": 4'))
    assert control._kept(case, case.load(), tmp_path) is None, "a digit that flipped is noticed"


def test_what_other_programs_found_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cases").mkdir()
    plan = replace(TINY, controllers=("open_loop",))
    control.study(plan, tmp_path)
    assert (control.study(plan, tmp_path).kept, control.study(plan, tmp_path).outdated) == (1, 0)
    monkeypatch.setattr(control, "versions", lambda: {"numpy": "0.1"})
    assert (control.study(plan, tmp_path).kept, control.study(plan, tmp_path).kept) == (0, 1)


def test_sources_and_the_identified_map_are_what_a_case_depends_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = load_scene("path_line")
    now = control.basis(scene)
    assert control.basis(load_scene("path_line", ["seed=3"])) == now
    with monkeypatch.context() as patch:
        patch.setattr(build, "loaded", lambda settings, wave: None)
        assert control.basis(scene) != now
    (tmp_path / "scenes").mkdir()
    monkeypatch.setattr(packages, "HOME", tmp_path)
    digests = []
    for text in ("x = 1", "x = 2", "x = 1"):
        (tmp_path / "scenes" / "one.py").write_text(text)
        packages.sources.cache_clear()
        digests.append(control.basis(scene))
    packages.sources.cache_clear()
    assert digests[0] == digests[2] != digests[1]


def test_the_worst_seed_counts_by_its_magnitude() -> None:
    values = (0.01, -0.03, 0.02)
    (row,) = control.rows([found("path_line", "mpc", k, speed_bias_relative=v) for k, v in enumerate(values)])
    assert (row.seeds, row.failed, row.metrics["speed_bias_relative"]) == (3, 0, -0.03)
    unknown = [found("a", "mpc", 0, cross_track_rms_bl=0.1), found("a", "mpc", 1)]
    (row,) = control.rows(unknown)
    assert row.metrics["cross_track_rms_bl"] is None


def verdict(rows: list[Row], trial: str, says: str) -> control_bars.Verdict:
    (one,) = [v for v in control_bars.verdicts(rows) if v.bar.trial == trial and says in v.bar.says]
    return one


def test_bars_are_kept_or_not() -> None:
    rows = list(
        control.rows(
            [
                found(
                    "path_line",
                    "mpc",
                    0,
                    cross_track_rms_bl=0.0011,
                    speed_bias_relative=-0.03,
                    control_step_ms_p99=65.0,
                ),
                found("path_line", "pi_los", 0, cross_track_rms_bl=0.0007),
            ]
        )
    )
    assert verdict(rows, "path_line", "rms offset from the path").word == "kept"
    assert verdict(rows, "path_line", "below line-of-sight").word == "NOT KEPT"
    assert verdict(rows, "path_line", "bias of the speed").word == "NOT KEPT"
    assert verdict(rows, "path_line", "control steps").bar.most == pytest.approx(60.0)
    assert verdict(rows, "path_line", "control steps").word == "NOT KEPT"
    assert verdict(rows, "path_circle", "rms offset from the path").word == "not run"


def test_what_never_settles_and_what_does_not_reach_its_end_keeps_no_bar() -> None:
    """Neither counts as "not run"; good figures of a run that stopped early flatter."""
    unsettled = found("velocity_step", "mpc", 0, settling_periods=None)
    stopped = replace(found("path_line", "mpc", 0, cross_track_rms_bl=0.001), status="diverged")
    rows = list(control.rows([unsettled, stopped]))
    assert verdict(rows, "velocity_step", "settled").word == "NOT KEPT"
    assert verdict(rows, "path_line", "rms offset from the path").word == "NOT KEPT"


def test_trials_without_a_bar_say_so_with_their_figures() -> None:
    runs = [found("heading_hold", "mpc", 0, heading_error_rms_deg=2.345, speed_bias_relative=0.01)]
    lines = [" ".join(line.split()) for line in control_report.terminal_lines(list(control.rows(runs)))]
    assert "heading_hold rms error of the heading 2.35 deg - no bar" in lines
    assert "heading_hold bias of the speed 1.00 % - no bar" in lines
    assert not any("heading_hold" in line and "offset" in line for line in lines)


def test_a_score_is_the_geometric_mean_of_the_errors_over_line_of_sights() -> None:
    errors = {"mpc": (0.002, 1.0), "pi_los": (0.004, 8.0), "mine:C": (0.0001, None), "open_loop": (0.4, 80.0)}
    runs = [
        each
        for name, (offset, heading) in errors.items()
        for each in (
            found("path_circle", name, 0, cross_track_rms_bl=offset, control_step_ms_p99=7.0),
            found("heading_hold", name, 0, heading_error_rms_deg=heading),
        )
    ]
    found_scores = control_score.scores(list(control.rows(runs)))
    assert [each.controller for each in found_scores] == ["mpc", "pi_los", "mine:C", "open_loop"]
    best, line_of_sight, own, blind = found_scores
    assert best.score == pytest.approx((0.5 * 0.125) ** 0.5)
    assert line_of_sight.score == pytest.approx(1.0)
    assert own.score == pytest.approx((0.25 * control_score.LOST) ** 0.5), (
        "no less than can be told apart, and one lost"
    )
    assert (own.lost, own.trials, own.errors["heading_error_rms_deg"]) == (1, 2, None)
    assert blind.score == pytest.approx(10.0), "100 times the error is no worse than a lost trial"
    assert next(control_score.cells(list(control.rows(runs)))) == (
        *("mpc", "0.250", "0 of 2", "0.0020", "1.00", "-", "7.00"),
    )
    stopped = [replace(each, status="diverged") if each.controller == "mpc" else each for each in runs]
    assert {each.controller: each.lost for each in control_score.scores(list(control.rows(stopped)))}["mpc"] == 2


def test_a_worm_that_does_not_go_loses_what_is_about_offset_or_heading() -> None:
    """It has next to no offset; to the score of speeds it says itself that it stands."""

    def lost(trial: str, **figures: float | None) -> int:
        metric = control_trials.METRIC[trial]
        runs = [found(trial, "mine:C", 0, **{metric: 0.5, **figures}), found(trial, "pi_los", 0, **{metric: 0.5})]
        return next(each.lost for each in control_score.scores(list(control.rows(runs))) if each.controller == "mine:C")

    assert lost("path_circle", speed_bias_relative=-0.9999, speed_error_rms_relative=0.9999) == 1
    assert lost("path_circle", speed_bias_relative=-0.7, speed_error_rms_relative=0.7) == 1
    assert lost("heading_hold", speed_bias_relative=-0.9999, speed_error_rms_relative=0.9999) == 1
    assert lost("there_and_back", speed_bias_relative=0.0001, speed_error_rms_relative=0.9999) == 1
    assert lost("velocity_step", speed_bias_relative=-0.9999, speed_error_rms_relative=0.9999) == 0
    assert lost("corner", speed_bias_relative=-0.578, speed_error_rms_relative=0.7257) == 0, "as of open_loop"
    assert lost("path_circle", speed_bias_relative=None) == 0


def test_outside_controllers_run_beside_those_that_ship(
    worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They run again each time, since nobody knows what they depend on."""
    (tmp_path / "outside.py").write_text(
        "from control.baselines import OpenLoop\n\n\nclass Mine(OpenLoop):\n    pass\n"
    )
    monkeypatch.chdir(tmp_path)
    tiny = Trial("path_line", "path_line", ("run.duration_s=6",))
    monkeypatch.setattr(control_report, "chosen", lambda names: (tiny,))
    options = (
        "bench",
        "control",
        "--trial",
        "path_line",
        "--seeds",
        "1",
        "--controller",
        "outside:Mine",
        "--out",
        "it",
    )
    for new, kept in ((4, 0), (0, 3)):
        ended = worm3d(*options)
        assert f"Of 4 runs {kept} kept from before" in ended.out, ended.out
        assert f"{new} new" in ended.out
        lines = {line.split()[0]: line.split()[1] for line in ended.out.splitlines() if " of 1 " in line}
        assert set(lines) == {"mpc", "pi_los", "open_loop", "outside:Mine"}
        assert lines["outside:Mine"] == lines["open_loop"]
    assert (tmp_path / "it" / "cases" / "path_line-outside.Mine-0.json").is_file()
    wrong = worm3d("bench", "control", "--controller", "outside:Mien")
    assert (wrong.code, wrong.complaints) == (
        2,
        ["--controller: the module 'outside' has no 'Mien'; did you mean 'Mine'?"],
    )
    assert not (tmp_path / "runs").exists()


def test_outside_controllers_that_stand_or_raise_lose_and_the_mpc_is_held_to_no_bar(
    worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "outside_wrong.py").write_text(STANDS_OR_RAISES)
    monkeypatch.chdir(tmp_path)
    tiny = Trial("path_line", "path_line", ("run.duration_s=6",))
    monkeypatch.setattr(control_report, "chosen", lambda names: (tiny,))
    monkeypatch.setattr(control_report, "CONTROLLERS", ("pi_los",))
    options = ("bench", "control", "--trial", "path_line", "--seeds", "1", "--controller")
    for name, code, seeds in (("Still", 0, "1"), ("Raises", 5, "1 (1 failed)")):
        ended = worm3d(*options, f"outside_wrong:{name}", "--out", name)
        lines = [line.split() for line in ended.out.splitlines() if " of 1 " in line]
        assert [(line[0], line[2]) for line in lines] == [("pi_los", "0"), (f"outside_wrong:{name}", "1")]
        assert lines[1][1] == "10.000"
        assert f"outside_wrong:{name}  {seeds}" in ended.out
        assert "not run" not in ended.out
        assert "held to bars" in ended.out
        assert ended.code == code


def test_the_page_of_rules_is_that_of_the_tables() -> None:
    kept = Path(control.__file__).with_name("CONTROL.md").read_text()
    assert kept == control_page.page(), (
        "write it again: python tests/benchmarks/control_page.py > scenes/studies/bench/CONTROL.md"
    )


def test_trials_are_chosen_by_name() -> None:
    assert [trial.name for trial in control_trials.chosen(["corner", "path_line", "corner"])] == ["corner", "path_line"]
    assert control_trials.chosen([]) == FULL
    with pytest.raises(SceneError, match="did you mean 'corner'"):
        control_trials.chosen(["cornr"])


def test_every_trial_is_a_scene() -> None:
    assert len({trial.name for trial in FULL}) == len(FULL)
    for trial in control_trials.HARD:
        assert load_scene(trial.scene, trial.overrides).model is MODEL


def test_the_report_has_every_row_and_every_run() -> None:
    runs = [
        found("path_line", name, seed, speed_bias_relative=0.0123, speed_bias_settled_relative=0.0456)
        for name in ("mpc", "pi_los")
        for seed in (0, 1)
    ]
    rows = list(control.rows(runs))
    machine = {"cpu": "a processor", "system": "Linux", "date": "today"}
    text = control_report.markdown(rows, machine, "control.png")
    assert "| path_line | mpc | 2 | 1.23 | - | 4.56 |" in text
    assert "![the worst of the seeds](control.png)" in text
    assert "| path_line | bias of the speed | 1.23 % | 2.00 % | kept |" in text
    assert "kept" not in control_report.markdown(rows, machine, "control.png", judged=False).replace("kept to", "")
    table = list(csv.DictReader(control_report.as_csv(runs).decode().splitlines()))
    assert len(table) == 4
    assert float(table[0]["speed_bias_relative"]) == 0.0123
    assert table[0]["settling_periods"] == ""


def test_the_tables_fit_a_terminal_and_have_every_figure() -> None:
    figures = dict.fromkeys(control.METRICS, 123.456)
    runs = [found(trial.name, name, 0, **figures) for trial in FULL for name in control.CONTROLLERS]
    lines = list(control_report.terminal_lines(list(control.rows(runs)), judged=False))
    assert max(map(len, lines)) <= 100
    assert [name for names in control_report.TABLES.values() for name in names] == list(figures)


def test_in_short_each_trial_has_its_own_figure() -> None:
    runs = [
        found("path_line", "mpc", 0, cross_track_rms_bl=0.004, heading_error_rms_deg=1.0),
        found("path_line", "pi_los", 0, cross_track_rms_bl=0.01234),
        found("heading_hold", "mpc", 0, heading_error_rms_deg=2.0, speed_error_rms_relative=0.01),
        found("heading_hold", "open_loop", 0, heading_error_rms_deg=20.0),
        found("velocity_sine", "mpc", 0, speed_error_rms_relative=0.05, cross_track_rms_bl=0.001),
    ]
    text = control_report.markdown(list(control.rows(runs)), {"cpu": "", "system": "", "date": ""}, "control.png")
    assert "| path_line | rms offset from the path | 0.0040 BL | 0.0123 BL | - |" in text
    assert "| heading_hold | rms error of the heading | 2.00 deg | - | 20.00 deg |" in text
    assert "| velocity_sine | rms error of the speed | 5.00 % | - | - |" in text


def test_the_figure_shows_every_controller() -> None:
    runs = [found("path_line", name, 0, speed_error_rms_relative=0.01) for name in control.CONTROLLERS]
    figure = control_report.draw(runs)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(control.CONTROLLERS)


def test_the_figure_shows_zeros_as_zeros_and_nothing_where_there_is_no_value() -> None:
    runs = [
        found("path_line", "mpc", 0, cross_track_rms_bl=0.0),
        found("path_line", "pi_los", 0, cross_track_rms_bl=5e-5),
        found("path_line", "open_loop", 0),
    ]
    axes = control_report.draw(runs).axes[1]
    assert sorted(bar.get_width() for bar in axes.patches) == [0.0, 5e-5]
    assert [line.get_xdata().tolist() for line in axes.lines] == [[0.0], [5e-5]]
    assert axes.get_xlim()[0] == 0.0
    left, zero, small = axes.transData.transform([(axes.get_xlim()[0], 0.0), (0.0, 0.0), (5e-5, 0.0)])[:, 0]
    assert zero == left < small - 1.0  # pixels
    assert not axes.lines[0].get_clip_on()


def test_the_command_line(worm3d, tmp_path: Path) -> None:
    ended = worm3d("bench", "control", "--seeds", "0")
    assert (ended.code, ended.complaints) == (2, ["--seeds: got 0, must be at least 1"])


@pytest.mark.parametrize(("bias", "status", "code"), [(0.01, "done", 0), (0.03, "done", 6), (0.03, "diverged", 5)])
def test_it_ends_with_a_code_after_everything_is_written(
    worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bias: float, status: str, code: int
) -> None:
    run = found("path_line_uphill", "mpc", 0, speed_bias_relative=2.0 * bias, control_step_ms_p99=1.0)
    study = control.Study((replace(run, status=status),), kept=1, outdated=0)
    monkeypatch.setattr(control, "study", lambda *args: study)
    ended = worm3d("bench", "control", "--out", "bench")
    assert ended.code == code
    assert "Of 1 run 1 kept from before, 0 run again (scene, programs or map have changed since), 0 new" in ended.out
    assert {path.name for path in (tmp_path / "bench").iterdir()} == {
        "cases",
        "control.csv",
        "control.md",
        "control.png",
    }
    assert ("NOT KEPT" in ended.out) == (code != 0)
    quick = worm3d("bench", "control", "--out", "bench", "--quick")
    assert quick.code == (code if code == 5 else 0)
    assert "not the complete runs of what ships that are held to bars" in quick.out, (
        "nor are chosen trials, since lately"
    )
    one = worm3d("bench", "control", "--out", "bench", "--trial", "path_line_uphill")
    assert one.code == quick.code, "whoever tries a trial need not keep the bars of the MPC"
    assert "NOT KEPT" not in one.out
