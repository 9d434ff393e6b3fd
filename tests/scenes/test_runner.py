"""Runs that go wrong or are stopped: what was computed is kept, the exit code says what happened."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import time
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from scenes import kinds
from scenes.interrupt import Interruption
from scenes.report import ending
from scenes.store import load

SHORT = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2")
# The only segment pushes with an absurd force from t = T/2 on.
EXPLODES = (
    *("-o", "worm.segments=1", "-o", "gait.direction=retrograde", "-o", "gait.force_N=1e100"),
    *("-o", "run.duration_s=1", "-o", "gait.period_s=0.4"),
)
FIGURES = {"activation.png", "centre_of_mass.png", "cumulative_cost_of_transport.png"}


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_run_writes_everything_and_ends_with_what_matters(worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x")
    assert ended.code == 0
    assert names(tmp_path / "x") == {"result.nc", "summary.json", "animation.gif", *FIGURES}
    assert ended.err == "planar_published: 20 steps\n"
    first, *rows = ended.out.splitlines()
    assert first.startswith("planar_published: the run reached its end (0.2 s simulated, ")
    labels = [row[2:24].strip() for row in rows]
    assert labels[:3] == ["distance", "mean speed", "work of contraction"]
    assert rows[-1].split() == ["files", "x"]


def test_the_summary_on_disc(worm3d, tmp_path: Path) -> None:
    worm3d("run", "planar_published", *SHORT, "--out", "x", "--quiet")
    summary = json.loads((tmp_path / "x" / "summary.json").read_text())
    assert summary["status"] == "done"
    assert_allclose(summary["duration_s"], 0.2)
    assert summary["real_time_factor"] > 1
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
    assert names(tmp_path / "x") == {"result.nc", "summary.json", "animation.gif", *FIGURES}
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
    command = [script, "run", "planar_published", "-o", "run.duration_s=100000", "--out", "x"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "planar_published: 10000000 steps\n"
        time.sleep(0.5)
        process.send_signal(number)
        try:
            out, err = process.communicate(timeout=30)
        finally:
            process.kill()  # a run that does not listen must not go on for ever
    assert process.returncode == 130
    assert err == ""
    assert out.startswith("planar_published: the run was interrupted; the steps computed so far are kept (")
    assert names(tmp_path / "x") == {"result.nc", "summary.json", *FIGURES}
    record = load(tmp_path / "x")
    assert record.status == "interrupted"
    assert 10 < record.sizes["step"] < 100_000


def test_the_second_ctrl_c_has_its_old_power() -> None:
    with Interruption() as interruption:
        os.kill(os.getpid(), signal.SIGINT)
        assert interruption.requested
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_afterwards_ctrl_c_is_as_before() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with Interruption():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_a_figure_without_a_value_ends_with_its_reason(record) -> None:
    reason = record.summary.reasons["cost_of_transport"]
    lines = ending(record, kinds.get("planar_published"), Path("x")).splitlines()
    assert f"  cost of transport     none: {reason}" in lines
