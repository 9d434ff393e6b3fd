from __future__ import annotations

import csv
import errno
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

import worm3d as package
from scenes.language.errors import SceneError
from scenes.records import folder
from scenes.sweep import engine
from scenes.sweep.engine import Progress
from scenes.sweep.progress import summed_up

SHORT = ("planar_published", "-o", "run.duration_s=0.05")
NOT_DRAWN = ("--vary", "run.dt_s=0.01", "--vary", "friction.forward=0.03")
"""Further keys: sweeps of more than two keys have no figures, which take longer than these runs."""


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_sweep_writes_a_table_a_data_set_and_a_summary(worm3d, tmp_path: Path) -> None:
    command = ("sweep", *SHORT, "--vary", "gait.period_s=1,2", "--vary", "worm.segments=3,4", *NOT_DRAWN, "--out", "x")
    ended = worm3d(*command)
    assert ended.code == 0
    assert ended.complaints == ["planar_published: 0 of 4 cases"]
    table = rows(tmp_path / "x" / "sweep.csv")
    assert [(row["gait.period_s"], row["worm.segments"]) for row in table] == [
        ("1", "3"), ("1", "4"), ("2", "3"), ("2", "4")
    ]  # fmt: skip
    assert {row["status"] for row in table} == {"done"}
    for row in table:
        case = json.loads((tmp_path / "x" / "cases" / f"{row['case']}.json").read_text())
        assert float(row["distance_m"]) == case["summary"]["distance_m"]
        assert int(row["seed"]) == case["seed"]
    assert json.loads((tmp_path / "x" / "summary.json").read_text())["status"] == "done"
    before = {path.name: path.read_bytes() for path in (tmp_path / "x").glob("sweep.*")}
    again = worm3d(*command, "--quiet")
    assert (again.code, again.out, again.err) == (0, "", "")
    assert {path.name: path.read_bytes() for path in (tmp_path / "x").glob("sweep.*")} == before


def test_failed_cases_are_told_and_the_others_finish(worm3d, tmp_path: Path) -> None:
    ended = worm3d("sweep", *SHORT, "--vary", "gait.force_N=1,1e100,2", *NOT_DRAWN, "--out", "x")
    assert ended.code == 5
    assert ended.complaints[-1].startswith(
        "with gait.force_N = 1e+100, run.dt_s = 0.01, friction.forward = 0.03: diverged: the state became infinite"
    )
    assert [row["status"] for row in rows(tmp_path / "x" / "sweep.csv")] == ["done", "diverged", "done"]
    assert "3 of 3 cases, 1 failed" in ended.out


def test_cases_that_cannot_be_are_failed_without_being_run(worm3d, tmp_path: Path) -> None:
    command = ("sweep", *SHORT, "--vary", "gait.period_s=0.001,2", *NOT_DRAWN, "--out", "x")
    ended = worm3d(*command)
    assert ended.code == 5
    assert ended.complaints[0] == "planar_published: 1 of 2 cases, 1 failed (1 refused, not run)"
    refused, done = rows(tmp_path / "x" / "sweep.csv")
    assert (refused["status"], done["status"]) == ("failed", "done")
    assert "at most a 10th of the gait's period, 0.001 s" in refused["reason"]
    case = json.loads((tmp_path / "x" / "cases" / f"{refused['case']}.json").read_text())
    assert (case["status"], case["scene"]["gait"]["period_s"]) == ("failed", 0.001)
    again = worm3d(*command, "--retry-failed")
    assert again.code == 5
    assert again.complaints[0] == "planar_published: 2 of 2 cases, 1 kept from before, 1 failed (1 refused, not run)"


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--vary", "gait.perod_s=1,2"), "gait.perod_s: unknown key; did you mean 'period_s'?"),
        (
            ("--vary", "gait.period_s=1:2:1000", "--vary", "gait.force_N=1:2:1000"),
            "1000000 cases (1000 x 1000): at most",
        ),
        (("--vary", "gait.period_s="), "must be key=values"),
        ((), "planar_published: nothing to vary"),
        (("--list", "nowhere.csv"), "cannot read nowhere.csv: no such file or directory"),
        (("--vary", "gait.period_s=1,2", "--workers", "2", "--scheduler", "tcp://x"), "give one of the two"),
    ],
)
def test_mistakes_are_one_sentence_and_nothing_is_written(worm3d, tmp_path: Path, options, complaint: str) -> None:
    ended = worm3d("sweep", *SHORT, *options, "--out", "x")
    assert ended.code in (1, 2)
    assert len(ended.complaints) == 1
    assert complaint in ended.err
    assert not (tmp_path / "x").exists()


def test_a_full_disc_is_one_sentence_and_keeps_finished_cases(worm3d, tmp_path: Path, monkeypatch) -> None:
    real, written = os.replace, []

    def full(source: Path, target: Path) -> None:
        written.append(target)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(folder.os, "replace", full)
        ended = worm3d("sweep", *SHORT, "--vary", "gait.period_s=1,2,3,4", *NOT_DRAWN, "--out", "x")
    assert ended.code == 1
    assert ended.complaints[-1].endswith(".json: no space left on device")
    assert len(list((tmp_path / "x" / "cases").iterdir())) == 2
    assert worm3d("sweep", *SHORT, "--vary", "gait.period_s=1,2,3,4", *NOT_DRAWN, "--out", "x").code == 0


def test_folders_that_cannot_be_used(worm3d, tmp_path: Path) -> None:
    vary = ("--vary", "gait.period_s=1,2")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").touch()
    ended = worm3d("sweep", *SHORT, *vary, "--out", "other")
    assert (ended.code, ended.err) == (
        2,
        "other is not empty, and no folder of a sweep: choose another --out, or write to it with --force\n",
    )
    ended = worm3d("sweep", *SHORT, *vary, "--out", "/proc/x")
    assert (ended.code, ended.err) == (1, "cannot write /proc/x: no such file or directory\n")
    with folder.locked(folder.made(tmp_path / "locked")):
        ended = worm3d("sweep", *SHORT, *vary, "--out", "locked")
    assert ended.code == 2
    assert "is writing to it: wait until it ends" in ended.err


SWEPT = """
model = "planar_published"
[run]
duration_s = 0.05
[sweep]
vary = { "gait.period_s" = [1, 2, 3], "run.dt_s" = 0.01, "friction.forward" = 0.03 }
"""


def test_a_scene_with_a_sweep_is_run_checked_and_studied_as_one(worm3d, tmp_path: Path) -> None:
    (tmp_path / "swept.toml").write_text(SWEPT)
    assert worm3d("check", "swept.toml").out == (
        "swept: the scene is right (model planar_published, 3 cases of 5 steps)\n"
    )
    for command, out in (("run", "a"), ("sweep", "b"), ("study", "c")):
        assert worm3d(command, "swept.toml", "--out", out).code == 0
    tables = [(tmp_path / out / "sweep.csv").read_text() for out in "abc"]
    assert tables[0] == tables[1] == tables[2]
    ended = worm3d("check", "swept.toml", "-o", "run.dt_s=0.5")
    assert ended.code == 2
    assert worm3d("study", *SHORT).code == 2


def test_ctrl_c_keeps_finished_cases(script: str, tmp_path: Path) -> None:
    command = [
        script,
        "sweep",
        "planar_published",
        "-o",
        "run.duration_s=20",
        "--vary",
        "gait.period_s=1:2:400",
        *NOT_DRAWN,
    ]
    with subprocess.Popen([*command, "--out", "x"], cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        limit = time.monotonic() + 60
        while not list(tmp_path.glob("x/cases/*.json")) and time.monotonic() < limit:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        try:
            _, err = process.communicate(timeout=30)
        finally:
            process.kill()
    assert process.returncode == 130
    assert "planar_published: stopped by Ctrl-C; finished cases are safe" in err
    files = list((tmp_path / "x" / "cases").iterdir())
    assert 0 < len(files) < 400
    assert {path.suffix for path in files} == {".json"}
    assert json.loads((tmp_path / "x" / "summary.json").read_text())["status"] == "interrupted"


def test_a_second_ctrl_c_ends_at_once(worm3d, monkeypatch) -> None:
    def impatient(*_: object, **__: object) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(engine, "perform", impatient)
    ended = worm3d("sweep", *SHORT, "--vary", "gait.period_s=1,2", "--out", "x")
    assert (ended.code, ended.out) == (130, "")
    assert ended.complaints[-1].startswith("planar_published: stopped by Ctrl-C")


def test_progress_tells_rate_time_left_and_failures() -> None:
    assert summed_up(Progress(1, 0), 0.0) == "0 of 1 case"
    assert (
        summed_up(Progress(200, 40, 60, 3), 30.0)
        == "100 of 200 cases, 40 kept from before, 3 failed, 2 cases/s, 50 s left"
    )
    assert summed_up(Progress(10_000, 0, 100), 1000.0) == "100 of 10000 cases, 0.1 cases/s, 27.5 h left"
    assert summed_up(Progress(2, 0, 2), 0.1) == "2 of 2 cases, 20 cases/s"
    assert summed_up(Progress(3, 2), 0.0, workers=4) == "2 of 3 cases, 2 kept from before, 1 worker starting"
    assert summed_up(Progress(3, 3), 0.0, workers=4) == "3 of 3 cases, 3 kept from before"
    assert summed_up(Progress(3, 0, 1), 1.0, workers=4) == "1 of 3 cases, 1 cases/s, 2 s left"


def test_from_python_wrong_types_are_refused_with_advice() -> None:
    with pytest.raises(SceneError, match=r"^vary: got \['gait.period_s=1'\], must be a mapping from keys to values"):
        package.sweep("planar_published", ["gait.period_s=1"])  # type: ignore[arg-type]
    for wrong in ("run.duration_s=1", {"run.duration_s": 1}, [["run.duration_s=1"]]):
        with pytest.raises(SceneError, match="must be a list of texts"):
            package.sweep("planar_published", {"gait.period_s": [1]}, overrides=wrong)  # type: ignore[arg-type]


def test_from_python_it_is_a_data_set(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    options = {"overrides": ["run.duration_s=0.05"], "out": tmp_path / "x"}
    vary = {"gait.period_s": [1.0, 2.0], "worm.segments": "3:5:3", "run.dt_s": 0.01}
    found = package.sweep("planar_published", vary, **options)
    assert dict(found.sizes) == {"gait.period_s": 2, "worm.segments": 3, "run.dt_s": 1}
    assert set(found["status"].values.ravel()) == {"done"}
    assert found["distance_m"].attrs["units"] == "m"
    one = float(found["distance_m"].sel({"gait.period_s": 2.0, "worm.segments": 4}).item())
    keys = [
        {"gait.period_s": 2.0, "worm.segments": 4, "run.dt_s": 0.01},
        {"gait.period_s": 1.0, "worm.segments": 3, "run.dt_s": 0.01},
    ]
    listed = package.sweep("planar_published", cases=keys, overrides=["run.duration_s=0.05"])
    assert dict(listed.sizes) == {"case": 2}
    assert float(listed["distance_m"][0]) == one
    assert len(list((tmp_path / "x" / "cases").iterdir())) == 6
