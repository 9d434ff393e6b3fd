"""Runs that go wrong or are stopped: what was computed is kept, the exit code says what happened."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from scenes import models
from scenes.language.errors import DiscError
from scenes.records.record import Summary
from scenes.records.store import load
from scenes.running import runner, terminal
from scenes.running.terminal import Interruption, ending
from worm3d.values.metrics import written

SHORT = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2")
# The only segment pushes with an absurd force from t = T/2 on.
EXPLODES = (
    *("-o", "worm.segments=1", "-o", "gait.direction=retrograde", "-o", "gait.force_N=1e100"),
    *("-o", "run.duration_s=1", "-o", "gait.period_s=0.4"),
)


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_run_writes_everything_and_ends_with_what_matters(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x")
    assert ended.code == 0
    assert names(tmp_path / "x") == {"result.nc", "summary.json", "animation.gif", "overview.png"}
    assert ended.err == "planar_published: 20 steps\n"
    first, *rows = ended.out.splitlines()
    assert first.startswith("planar_published: the run reached its end (0.2 s simulated, ")
    labels = [row[2:24].strip() for row in rows]
    assert labels[:3] == ["distance", "mean speed", "net work"]
    assert rows[-1].split() == ["files", "x"]


def test_the_summary_on_disc(worm3d, tmp_path: Path) -> None:
    worm3d("run", "planar_published", *SHORT, "--out", "x", "--quiet")
    summary = json.loads((tmp_path / "x" / "summary.json").read_text())
    assert summary["status"] == "done"
    assert_allclose(summary["duration_s"], 0.2)
    assert_allclose(summary["real_time_factor"], summary["duration_s"] / summary["wall_s"])
    assert {name for name, figure in summary.items() if figure is None} == set(summary["reasons"])


def test_quiet_prints_nothing(worm3d) -> None:
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x", "--quiet")
    assert (ended.out, ended.err) == ("", "")


def test_the_default_folder_is_named_after_scene_and_time(worm3d, tmp_path: Path) -> None:
    for _ in range(2):  # within one second: the second finds another name
        assert worm3d("run", "planar_published", *SHORT, "--quiet").code == 0
    folders = sorted((tmp_path / "runs").glob("planar_published-????????-??????*"))
    assert len(folders) == 2


def test_an_existing_folder_needs_force(worm3d, tmp_path: Path) -> None:
    (tmp_path / "x").mkdir()
    (tmp_path / "x" / "notes.txt").write_text("mine")
    (tmp_path / "x" / "animation.gif").write_text("old")
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x")
    assert ended.code == 2
    assert ended.complaints == ["x exists and is not empty: choose another --out, or replace its results with --force"]
    assert worm3d("run", "planar_published", *SHORT, "--out", "x", "--force").code == 0
    assert (tmp_path / "x" / "notes.txt").read_text() == "mine"
    assert (tmp_path / "x" / "animation.gif").read_bytes().startswith(b"GIF8")


def test_out_is_a_file(worm3d, tmp_path: Path) -> None:
    (tmp_path / "x").write_text("")
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x")
    assert (ended.code, ended.complaints) == (2, ["x is a file: choose a folder for --out"])


def test_out_cannot_be_made(worm3d) -> None:
    ended = worm3d("run", "planar_published", *SHORT, "--out", "/proc/x")
    assert (ended.code, ended.complaints) == (1, ["cannot write /proc/x: no such file or directory"])


def test_a_disc_that_fills_up_is_one_sentence(script: str, tmp_path: Path) -> None:
    def small_files_only() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    command = [script, "run", "planar_published", *SHORT, "--out", "x", "--quiet"]
    done = subprocess.run(command, cwd=tmp_path, preexec_fn=small_files_only, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr == "cannot write x/result.nc: file too large\n"
    assert names(tmp_path / "x") == set()


def test_a_run_that_diverges_says_where_and_keeps_what_it_has(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_published", *EXPLODES, "--out", "x")
    assert ended.code == 3
    _, line = ended.complaints
    assert line.startswith("diverged: the state became infinite or not a number; the steps before are kept (step 21,")
    assert line.endswith("worst in segment 0); try a smaller run.dt_s, a smaller gait.force_N or a larger worm.mass_kg")
    assert names(tmp_path / "x") == {"result.nc", "summary.json", "animation.gif", "overview.png"}
    record = load(tmp_path / "x")
    assert (record.status, record.sizes["step"], record.sizes["time"]) == ("diverged", 20, 21)
    assert json.loads((tmp_path / "x" / "summary.json").read_text())["status"] == "diverged"


def test_a_run_that_diverges_at_once_has_nothing_to_draw(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_published", "-o", "gait.force_N=1e100", "--out", "x", "--quiet")
    assert ended.code == 3
    assert len(ended.complaints) == 1
    assert names(tmp_path / "x") == {"result.nc", "summary.json"}
    reasons = json.loads((tmp_path / "x" / "summary.json").read_text())["reasons"]
    assert reasons["newton_iterations_mean"] == "no step was finished"
    assert worm3d("plot", "x").complaints == ["planar_published: no step was finished, there is nothing to draw"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_what_it_has(script: str, tmp_path: Path, number: signal.Signals) -> None:
    command = [script, "run", "planar_published", "-o", "run.duration_s=8000", "--out", "x"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "planar_published: 800000 steps\n"
        time.sleep(0.5)
        process.send_signal(number)
        try:
            out, err = process.communicate(timeout=30)
        finally:
            process.kill()  # a run that does not listen must not go on for ever
    assert process.returncode == 130
    assert err == ""
    assert out.startswith("planar_published: the run was interrupted; the steps computed so far are kept (")
    assert names(tmp_path / "x") == {"result.nc", "summary.json", "overview.png"}
    record = load(tmp_path / "x")
    assert record.status == "interrupted"
    assert 10 < record.sizes["step"] < 100_000


def test_the_second_ctrl_c_has_its_old_power() -> None:
    with Interruption() as interruption:
        os.kill(os.getpid(), signal.SIGINT)
        assert interruption.requested
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize(("number", "cause"), [(signal.SIGINT, "Ctrl-C"), (signal.SIGTERM, "the signal SIGTERM")])
def test_the_cause_of_an_interruption_is_named(number: signal.Signals, cause: str) -> None:
    with Interruption() as interruption:
        os.kill(os.getpid(), number)
    assert interruption.cause == cause


def test_afterwards_ctrl_c_is_as_before() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with Interruption():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_a_figure_without_a_value_ends_with_its_reason(record) -> None:
    reason = record.summary.reasons["cost_of_transport"]
    lines = ending(record, models.get("planar_published"), Path("x")).splitlines()
    assert f"  cost of transport     none: {reason}" in lines


def test_a_full_disc_leaves_the_old_results_as_they_were(worm3d, tmp_path: Path, monkeypatch) -> None:
    assert worm3d("run", "planar_published", *SHORT, "--out", "x", "--quiet").code == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "x").iterdir()}

    def full(*_: object) -> None:
        raise DiscError("cannot write x/result.nc: no space left on device")

    monkeypatch.setattr(runner, "save", full)
    assert worm3d("run", "planar_published", *SHORT, "--out", "x", "--force", "--quiet").code == 1
    assert {path.name: path.read_bytes() for path in (tmp_path / "x").iterdir()} == before


def test_pictures_of_an_earlier_run_of_any_model_go_and_files_of_others_stay(worm3d, tmp_path: Path) -> None:
    folder = tmp_path / "x"
    folder.mkdir()
    for name in ("overview.png", "energy_ledger.png", "loads_and_slip.png", "animation.gif", "photo.png"):
        (folder / name).write_text("old")
    stops = ("-o", "gait.force_N=1e100")  # diverges at once: draws nothing
    assert worm3d("run", "planar_published", *stops, "--out", "x", "--force", "--quiet").code == 3
    assert names(folder) == {"result.nc", "summary.json", "photo.png"}


@pytest.mark.parametrize("stage", ["draw_overview", "animate", "write_bytes"])
def test_ctrl_c_after_the_simulation_says_where_the_result_is(worm3d, tmp_path: Path, monkeypatch, stage: str) -> None:
    real = getattr(runner, stage)

    def impatient(*arguments: object) -> object:
        os.kill(os.getpid(), signal.SIGINT)
        return real(*arguments)

    monkeypatch.setattr(runner, stage, impatient)
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x")
    assert ended.code == 130
    assert ended.complaints[-1] == (
        "planar_published: stopped by Ctrl-C; x/result.nc is safe, 'worm3d plot x' draws it"
    )
    assert load(tmp_path / "x").status == "done"
    assert (tmp_path / "x" / "summary.json").is_file()


def test_a_second_ctrl_c_while_simulating_says_that_nothing_was_kept(worm3d, tmp_path: Path, monkeypatch) -> None:
    def impatient(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(runner, "simulate", impatient)
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x")
    assert ended.code == 130
    assert ended.complaints[-1] == "planar_published: stopped by Ctrl-C; nothing of this run was kept"
    assert names(tmp_path / "x") == set()


def test_ctrl_c_is_heard_even_where_it_was_ignored_at_the_start() -> None:
    """A background job starts with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interruption() as interruption:
            os.kill(os.getpid(), signal.SIGINT)
            assert interruption.requested
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_steps_that_newton_gave_up_on_are_told(worm3d, tmp_path: Path) -> None:
    hasty = ("-o", "solver.max_iterations=1", "-o", "solver.tolerance_N=1e-12")
    ended = worm3d("run", "planar_published", *SHORT, *hasty, "--out", "x", "--quiet")
    assert "warning: Newton's iteration left 20 steps above its tolerance: try a smaller run.dt_s" in ended.complaints
    assert json.loads((tmp_path / "x" / "summary.json").read_text())["unconverged_steps"] == 20


def test_segments_that_are_inside_out_are_told(record) -> None:
    summary = Summary({**record.summary.metrics, "inverted_steps": 1}, record.summary.reasons)
    assert terminal.warnings(record) == []
    assert terminal.warnings(replace(record, summary=summary)) == [
        "a segment is inside out after 1 step: these are shapes that no worm has"
    ]


def test_rounding_is_not_told_as_a_number(record) -> None:
    summary = Summary({**record.summary.metrics, "distance_m": -2.6e-13}, record.summary.reasons)
    told = ending(replace(record, summary=summary), models.get(record.model), Path("x")).splitlines()
    assert "  distance              0 m" in told
    assert written(-2.6e-13, "deg") == "0"
    assert written(-2.6e-13, "") == "-2.6e-13"


def test_an_animation_that_stops_early_says_so(worm3d, monkeypatch) -> None:
    for module in ("scenes.running.drawing", "scenes.models.planar.merit"):
        monkeypatch.setattr(f"{module}.MOVIE_S", 0.1)
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x")
    assert ended.out.splitlines()[-1] == "  the animation shows the first 0.1 s of 0.2 s"
    ended = worm3d("animate", "x", "--force")
    assert ended.out.splitlines()[-1] == "the animation shows the first 0.1 s of 0.2 s"
    assert "30 s" in worm3d("animate", "--help").out


def test_one_step_is_not_one_steps(worm3d) -> None:
    one = ("-o", "run.duration_s=0.01")
    assert worm3d("run", "planar_published", *one, "--out", "x").err.splitlines()[0] == "planar_published: 1 step"
    assert worm3d("check", "planar_published", *one).out.endswith(", 1 step)\n")


def test_the_title_and_the_seed_of_the_scene_are_kept(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_published", *SHORT, "-o", "seed=17", "--out", "x")
    assert "  title                 The paper's worm" in ended.out.splitlines()
    record = load(tmp_path / "x")
    assert (record.seed, record.title) == (17, "The paper's worm")
    assert replace(record, scene="").title == "planar_published"
