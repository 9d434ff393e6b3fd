"""`worm3d study control`: which trials and runs, how they are resumed, and what the report says of them."""

from __future__ import annotations

import csv
import json
import shlex
from collections import Counter
from dataclasses import replace
from pathlib import Path

import control_page
import pytest

from scenes.language.errors import SceneError
from scenes.models.control import build
from scenes.models.control.model import CONTROL_MODEL
from scenes.models.loading import load_scene
from scenes.running import packages
from scenes.running.report import markdown, terminal_lines
from scenes.studies.bench import control, control_error, control_report, control_score, control_trials
from scenes.studies.bench.control import DONE, Case, Found
from scenes.studies.bench.control_report import Options
from scenes.studies.bench.control_trials import CLASSES, Trial, chosen, drawn

TINY = Trial("tiny", "line", "path_line", ("run.duration_s=8",))
TIMES = {"real_time_factor": 4.0, "step_share_p50": 0.1, "step_share_p99": 0.2}


def cases(*controllers: str, trial: Trial = TINY) -> list[Case]:
    return [Case(trial, name) for name in controllers]


def found(trial: str, controller: str, error: float, status: str = DONE) -> Found:
    return Found(trial, trial.partition("-")[0], controller, status, error, {"way": 0.5 * error, **TIMES})


def test_a_trial_follows_from_its_seed_and_number_alone() -> None:
    assert drawn(3, 5) == drawn(3, 5)
    assert len({drawn(seed, 5).overrides for seed in (0, 1, 2, 10**40)}) == 4
    assert len({drawn(0, k).overrides for k in range(60)}) == 60


def test_all_classes_take_turns() -> None:
    assert Counter(drawn(4, k).kind for k in range(24)) == dict.fromkeys(CLASSES, 2)


@pytest.mark.parametrize("number", range(36))
def test_every_trial_is_a_scene_that_all_see_by_the_default_map(number: int) -> None:
    scene = Case(drawn(number % 5, number), "mpc").load()
    assert scene.model is CONTROL_MODEL
    assert scene.settings.controller.map == "default"
    assert scene.settings.run.duration_s == 60.0


def test_worms_grounds_and_sensors_differ() -> None:
    drawn_scenes = [Case(drawn(0, k), "pi_los").load().settings for k in range(24)]
    assert {each.worm.segments for each in drawn_scenes} == {5, 6, 7, 8, 9}
    for seen in (
        [each.fault.unequal for each in drawn_scenes],
        [each.sensor.heading for each in drawn_scenes],
        [each.world.slope_deg > 0.0 for each in drawn_scenes],
    ):
        assert 3 < sum(seen) < 20


def test_trials_are_chosen_by_number_name_or_class() -> None:
    def called(*names: str) -> list[str]:
        return [trial.name for trial in chosen(names, (0,), 30)]

    assert called("line", "3") == ["0-03-waypoints", "0-07-line", "0-19-line"]
    assert called("0-07-line") == ["0-07-line"]
    assert len(called()) == 30
    with pytest.raises(SceneError, match="did you mean 'heading'"):
        called("headin")
    with pytest.raises(SceneError, match="a number from 0 to 29"):
        called("30")


def test_the_runs_are_all_trials_by_all_controllers() -> None:
    asked = Options(seed=2, seeds=2, trials=3, overrides=("run.duration_s=50",))
    runs = asked.cases
    assert len(runs) == len({case.file(Path()) for case in runs}) == 2 * 3 * 3
    assert {case.load().settings.run.duration_s for case in runs} == {50.0}
    assert [case.controller for case in runs[:3]] == ["mpc", "pi_los", "open_loop"]
    quick = Options(quick=True).cases
    assert (len(quick), quick[0].load().settings.run.duration_s) == (6, 12.0)
    assert "seeds 2 to 3, with run.duration_s=50" in asked.says


def test_a_printed_trial_is_a_command_that_runs_it(worm3d) -> None:
    ended = worm3d("bench", "control", "--show", "--trial", "2", "--seed", "7")
    name, command = ended.out.splitlines()
    assert (name, ended.code) == ("# 7-02-stop_and_go", 0)
    program, run, scene, *overrides = shlex.split(command)
    assert (program, run) == ("worm3d", "run")
    assert load_scene(scene, overrides[1::2]).to_toml() == Case(drawn(7, 2), "mpc").load().to_toml()


@pytest.mark.slow
def test_a_study_that_was_stopped_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs again what is broken, of another scene, or by other programs; the rest it keeps."""
    (tmp_path / "cases").mkdir()
    seen: list[int] = []
    plan = [*cases("pi_los", "open_loop"), *cases("open_loop", trial=TINY._replace(name="other"))]
    first = control.study(plan, tmp_path, watch=seen.append)
    assert seen == [1, 2, 3]
    assert (first.kept, first.outdated) == (0, 0)
    assert [each.status for each in first.found] == [DONE] * 3
    (tmp_path / "cases" / "tiny-pi_los.json").write_text("cut sh")
    changed = json.loads((tmp_path / "cases" / "tiny-open_loop.json").read_text())
    changed["scene"] += "# an older one"
    (tmp_path / "cases" / "tiny-open_loop.json").write_text(json.dumps(changed))
    ran: list[str] = []
    real = control.simulate

    def counted(scene):
        ran.append(scene.settings.controller.kind)
        return real(scene)

    monkeypatch.setattr(control, "simulate", counted)
    again = control.study(plan, tmp_path)
    assert ran == ["pi_los", "open_loop"]
    assert (again.kept, again.outdated) == (1, 2)
    for one, other in zip(first.found, again.found, strict=True):
        assert (one.error, one.metrics["offset_bl"]) == (other.error, other.metrics["offset_bl"])
    file = plan[0].file(tmp_path)
    assert control._kept(plan[0], plan[0].load(), tmp_path) is not None
    file.write_text(file.read_text().replace('"kind": "line"', '"kind": "lime"'))
    assert control._kept(plan[0], plan[0].load(), tmp_path) is None, "a letter that flipped is noticed"


@pytest.mark.slow
def test_two_workers_find_what_one_finds(tmp_path: Path) -> None:
    (tmp_path / "cases").mkdir()
    two = control.study(cases("open_loop", "pi_los"), tmp_path, workers=2)
    assert (two.kept, [each.controller for each in two.found]) == (0, ["open_loop", "pi_los"])
    (case,) = cases("open_loop")
    assert control._measured(case, case.load()).error == two.found[0].error


def test_what_other_programs_found_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cases").mkdir()
    control.study(cases("open_loop"), tmp_path)
    assert control.study(cases("open_loop"), tmp_path).kept == 1
    monkeypatch.setattr(control, "versions", lambda: {"numpy": "0.1"})
    assert control.study(cases("open_loop"), tmp_path).kept == 0


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


def test_a_score_is_the_geometric_mean_of_the_errors_over_line_of_sights() -> None:
    errors = {"mpc": (0.05, 0.08), "pi_los": (0.1, 0.8), "mine:C": (0.0001, 1.0), "open_loop": (0.4, 1.0)}
    runs = [found(f"{k}-0", name, e) for name, pair in errors.items() for k, e in enumerate(pair)]
    runs[5] = replace(runs[5], status="diverged")
    best, own, line_of_sight, blind = control_score.scores(runs)
    assert [each.controller for each in (best, own, line_of_sight, blind)] == ["mpc", "mine:C", "pi_los", "open_loop"]
    assert best.score == pytest.approx((0.5 * 0.1) ** 0.5)
    assert line_of_sight.score == pytest.approx(1.0)
    assert own.score == pytest.approx((control_score.FLOOR / 0.1 * 1.0 / 0.8) ** 0.5), "no less than can be told apart"
    assert (own.lost, own.median, own.worst) == (1, pytest.approx(0.50005), 1.0)
    assert blind.score == pytest.approx((4.0 * 1.25) ** 0.5)
    cells = [column.cell(best) for column in control_score.SCORE_COLUMNS.values()]
    assert cells == ["mpc", "0.224", "0.065", "0.080", "0", "4", "10", "20"]
    assert control_score.scores([found("line-0", "mpc", 0.5)])[0].score is None, "line-of-sight was not run"


@pytest.mark.slow
def test_outside_controllers_run_beside_those_that_ship(
    worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They run again each time, since nobody knows what they depend on."""
    (tmp_path / "outside.py").write_text(
        "from control.baselines import OpenLoop\n\n\nclass Mine(OpenLoop):\n    pass\n"
    )
    options = ("bench", "control", "--trial", "line", "--quick", "-o", "run.duration_s=8", "--trials", "8")
    options = (*options, "--controller", "outside:Mine", "--out", "it")
    for new, kept in ((4, 0), (0, 3)):
        ended = worm3d(*options)
        assert f"4 runs: {kept} kept from before" in ended.out, ended.out
        assert f"{new} new" in ended.out
        lines = {line.split()[0]: line.split()[1:5] for line in ended.out.splitlines() if line.count(".") > 2}
        assert {"mpc", "pi_los", "open_loop", "outside:Mine"} <= set(lines)
        assert lines["outside:Mine"] == lines["open_loop"]
    assert (tmp_path / "it" / "cases" / "0-07-line-outside.Mine.json").is_file()
    wrong = worm3d("bench", "control", "--controller", "outside:Mien")
    assert (wrong.code, wrong.complaints) == (
        2,
        ["--controller: the module 'outside' has no 'Mien'; did you mean 'Mine'?"],
    )
    assert not (tmp_path / "runs").exists()


def test_the_page_of_rules_is_that_of_the_tables() -> None:
    kept = control_page.PAGE.read_text()
    assert kept == control_page.page(kept), "write it again: python tests/benchmarks/control_page.py"
    quick = " and ".join(f"a {name}" for name in control_trials.QUICK)
    least, most = control_trials.SPEEDS
    for sentence in (
        f"# {Options().trials} trials of seed 0",
        f"exit code of the command is {control_report.LOST_TRIAL_EXIT_CODE} if a trial was lost",
        f"`--quick` runs {quick}, for {control_trials.SHORT[0].partition('=')[2]} s each",
        f"averaged over windows of {control_error.WINDOW:g} s",
        f"count from {control_error.MIN_RUN_DURATION_S:g} s on",
        f"into the first {control_error.STARTUP_TIME_S:g} s.",
        f"E = max(error, {control_score.FLOOR:g})",
        f"{len(CLASSES)} classes of tasks in turn. Each trial lasts 60 s; the required speeds are {least:g} to "
        f"{most:g} m/s.",
    ):
        assert sentence in kept


RUNS = [
    *(found("line-0", name, error) for name, error in (("mpc", 0.02), ("pi_los", 0.04))),
    *(found("line-1", name, error) for name, error in (("mpc", 0.06), ("pi_los", 0.08))),
    found("pipe-0", "mpc", 1.0, "valve stuck"),
    found("pipe-0", "pi_los", 0.5),
]


def test_the_report_has_every_class_and_every_lost_trial_and_every_run() -> None:
    report = control_report.report(control.Study(tuple(RUNS), kept=0, outdated=0), "Trials of seed 3")
    text = markdown(report.pages["control.md"])
    assert report.exit_code == control_report.LOST_TRIAL_EXIT_CODE
    assert "| line | 2 | 0.040, 0.060 | 0.060, 0.080 |" in text
    assert "* mpc lost pipe-0: valve stuck" in text
    assert "Trials of seed 3." in text
    assert "![errors](control.png)" in text
    table = list(csv.DictReader(control_report.as_csv(RUNS).decode().splitlines()))
    assert len(table) == len(RUNS)
    assert (float(table[0]["error"]), table[0]["way"], table[0]["heading_deg"]) == (0.02, "0.01", "")


def test_the_tables_fit_a_terminal() -> None:
    controllers = (*control.CONTROLLERS, "my_module:Mine")
    runs = [found(f"{kind}-0", name, 0.1234) for kind in CLASSES for name in controllers]
    report = control_report.report(control.Study(tuple(runs), kept=0, outdated=0), "Trials of seed 0")
    assert max(map(len, terminal_lines(report.said, 100))) <= 100


def test_the_figure_shows_every_run() -> None:
    figure = control_report.draw(RUNS)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["mpc", "pi_los"]
    assert [line.get_xdata().tolist() for line in figure.axes[0].lines] == [[0.02, 0.06, 1.0], [0.04, 0.08, 0.5]]


@pytest.mark.parametrize(
    ("option", "complaint"),
    [
        (("--seeds", 0), "--seeds: got 0, must be at least 1"),
        (("--seed", -1), "--seed: got -1, must be at least 0"),
        (("-o", "run.duration_s=7"), "run.duration_s: got 7 s, must be above 7.5 s: errors count only from then on"),
        (("-o", "run.record_every=20"), "run.record_every: got 20, must store a state every 0.1 s or sooner"),
        (
            ("-o", "reference.speed_m_s=0"),
            "reference.speed_m_s: got 0 at all times, must be above 0 at some time: errors are fractions of the "
            "required distance",
        ),
    ],
)
def test_wrong_options(worm3d, option: tuple[str, object], complaint: str) -> None:
    ended = worm3d("bench", "control", "--trials", 1, *option)
    assert (ended.code, ended.complaints) == (2, [complaint])


@pytest.mark.parametrize(("status", "code"), [(DONE, 0), ("diverged", 5)])
def test_it_ends_with_a_code_after_everything_is_written(
    worm3d, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, status: str, code: int
) -> None:
    study = control.Study((found("line-0", "mpc", 0.1, status),), kept=1, outdated=0)
    monkeypatch.setattr(control, "study", lambda *args: study)
    ended = worm3d("bench", "control", "--out", "bench")
    assert ended.code == code
    assert "1 run: 1 kept from before, 0 repeated (their scene, programs or map have changed), 0 new" in ended.out
    assert {path.name for path in (tmp_path / "bench").iterdir()} == {
        "cases",
        "control.csv",
        "control.md",
        "control.png",
    }
