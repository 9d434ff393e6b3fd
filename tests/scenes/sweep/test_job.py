from __future__ import annotations

import json
import zlib
from dataclasses import replace
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

from scenes.language.errors import DiscError, SceneError
from scenes.models.loading import load_scene
from scenes.records.store import load
from scenes.running.runner import simulate
from scenes.sweep import case_file, job
from scenes.sweep.job import Ended, Job, found, perform
from scenes.sweep.key import key_of

SCENE = load_scene("planar_wave", ["run.duration_s=2.5"])
KEY = key_of(SCENE)


def job_in(folder: Path, *, results: bool = False) -> Job:
    packed = zlib.compress(SCENE.to_toml().encode())
    return Job(KEY, SCENE.name, packed, str(folder / f"{KEY}{'.nc' if results else '.json'}"), results)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the files of a case, short and whole."""
    folder = tmp_path_factory.mktemp("cases")
    for results in (False, True):
        assert perform(job_in(folder, results=results)) == Ended(KEY, "done")
    return folder


def test_a_case_is_one_file_and_says_what_a_run_says(done: Path) -> None:
    assert {path.name for path in done.iterdir()} == {f"{KEY}.json", f"{KEY}.nc"}
    run, record = simulate(SCENE), load(done / f"{KEY}.nc")
    short, whole = (case_file.read(done / f"{KEY}{suffix}") for suffix in (".json", ".nc"))
    assert short is not None
    assert whole is not None
    for result in (short, whole):
        assert dict(result.summary) == dict(run.summary.metrics)
        assert (result.key, result.seed, result.status) == (KEY, 0, "done")
        assert result.scene["gait"]["period_s"] == 2.0
        assert set(result.timing) == {"wall_s", "real_time_factor"}
    assert replace(short, timing={}) == replace(whole, timing={})
    assert_array_equal(record["com"], run["com"])


@pytest.mark.parametrize("results", [False, True])
def test_a_finished_case_never_runs_twice(done: Path, monkeypatch: pytest.MonkeyPatch, results: bool) -> None:
    monkeypatch.setattr(job, "simulate", lambda *_: pytest.fail("ran"))
    assert perform(job_in(done, results=results)) == Ended(KEY, "done")


def test_figures_are_not_enough_where_the_whole_record_is_wanted(done: Path, tmp_path: Path) -> None:
    (tmp_path / f"{KEY}.json").write_bytes((done / f"{KEY}.json").read_bytes())
    assert found(job_in(tmp_path)) is not None
    assert found(job_in(tmp_path, results=True)) is None


@pytest.mark.parametrize("suffix", [".json", ".nc"])
def test_a_damaged_file_is_no_file(done: Path, tmp_path: Path, suffix: str) -> None:
    content = (done / f"{KEY}{suffix}").read_bytes()
    path = tmp_path / f"{KEY}{suffix}"
    middle = content.index(b"0.5") if suffix == ".json" else len(content) // 2
    for damaged in (content[:-200], content[:10], b"", content[:middle] + b"7" + content[middle + 1 :], b"[1]", b"1"):
        path.write_bytes(damaged)
        assert case_file.read(path) is None
    path.write_bytes(content)
    assert case_file.read(path) is not None
    other = path.rename(tmp_path / f"other{suffix}")
    assert (case_file.read(other) is None) == (suffix == ".json"), "the key inside tells"


def test_what_the_plant_refuses_is_a_case_that_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for error, reason in (
        (ValueError("worm: too heavy"), "worm: too heavy"),
        (SceneError("one", "two"), "one two"),
        (ZeroDivisionError("division by zero"), "ZeroDivisionError: division by zero"),
        (MemoryError(), "MemoryError"),
    ):
        (tmp_path / f"{KEY}.json").unlink(missing_ok=True)

        def refuse(*_: object, error: Exception = error) -> None:
            raise error

        with monkeypatch.context() as patch:
            patch.setattr(job, "simulate", refuse)
            assert perform(job_in(tmp_path, results=True)) == Ended(KEY, "failed", reason)
        content = json.loads((tmp_path / f"{KEY}.json").read_text())
        assert (content["status"], content["sentence"], content["summary"]) == ("failed", reason, {})
        assert perform(job_in(tmp_path)) == Ended(KEY, "failed", reason), "it is not tried again"


def test_a_case_that_is_stopped_has_no_file(tmp_path: Path) -> None:
    assert perform(job_in(tmp_path), lambda: True).status == "interrupted"
    assert list(tmp_path.iterdir()) == []


def test_other_programs_are_told(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="install the same versions on all machines"):
        perform(replace(job_in(tmp_path), key="0" * 20))


def test_a_disc_that_refuses_ends_the_sweep(tmp_path: Path) -> None:
    with pytest.raises(DiscError, match="cannot write"):
        perform(job_in(tmp_path / "nowhere"))
