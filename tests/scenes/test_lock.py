"""Two runs never write to one folder at a time, and a killed one leaves nothing that stops the next."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from scenes.language.errors import SceneError
from scenes.records import folder

HOLDS = """
import sys, time
from pathlib import Path
from scenes.records import folder
with folder.locked(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""
SHORT = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2", "--quiet")


@pytest.fixture
def holder(tmp_path: Path):
    """Another process that holds the lock of the folder `x`, until its standard input ends."""
    (tmp_path / "x").mkdir()
    command = [sys.executable, "-c", HOLDS, str(tmp_path / "x")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


@pytest.mark.parametrize("force", [(), ("--force",)])
def test_a_second_run_into_a_folder_is_refused(holder, force, worm3d, tmp_path: Path) -> None:
    ended = worm3d("run", "planar_published", *SHORT, "--out", "x", *force)
    assert (ended.code, ended.complaints) == (
        2,
        [f"x: process {holder.pid} is writing to it: wait until it ends, or choose another --out"],
    )
    holder.communicate("")
    assert list((tmp_path / "x").iterdir()) == []
    assert worm3d("run", "planar_published", *SHORT, "--out", "x").code == 0
    assert not list((tmp_path / "x").glob(f"{folder.TEMPORARY_PREFIX}*"))


def test_the_lock_of_a_killed_process_locks_nothing(holder, worm3d, tmp_path: Path) -> None:
    (tmp_path / "x" / f"{folder.TEMPORARY_PREFIX}1-a.part").write_text("half a file")
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    assert (tmp_path / "x" / folder.LOCK).exists()
    assert worm3d("run", "planar_published", *SHORT, "--out", "x").code == 0, "nor is the folder full by what it left"
    assert not list((tmp_path / "x").glob(f"{folder.TEMPORARY_PREFIX}*"))


def test_one_of_many_gets_it_each_time(tmp_path: Path) -> None:
    inside, most, refused = [0], [0], [0]

    def work() -> None:
        for _ in range(200):
            try:
                with folder.locked(tmp_path):
                    inside[0] += 1
                    most[0] = max(most[0], inside[0])
                    time.sleep(0.0)
                    inside[0] -= 1
            except SceneError:
                refused[0] += 1

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1]
    assert not list(tmp_path.iterdir())


def test_a_folder_that_another_run_has_filled_meanwhile_is_refused(tmp_path: Path, monkeypatch) -> None:
    locked = folder.locked

    def late(place: Path):
        (place / "result.nc").write_text("of the other one")
        return locked(place)

    monkeypatch.setattr(folder, "locked", late)
    with (
        pytest.raises(SceneError, match="exists and is not empty"),
        folder.prepared(tmp_path / "x", "flat", force=False),
    ):
        pass
    assert [path.name for path in (tmp_path / "x").iterdir()] == ["result.nc"]


def test_where_there_are_no_locks_things_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: int) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(folder, "_lock", refuse)
    with folder.locked(tmp_path), folder.locked(tmp_path):
        pass
    with folder.locked(tmp_path / "not" / "there"):
        pass


def test_two_writers_of_one_file_do_not_share_an_unfinished_one(tmp_path: Path) -> None:
    with folder.written_whole(tmp_path / "a") as first, folder.written_whole(tmp_path / "a") as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert (tmp_path / "a").read_text() == "first", "whole; the one that ended last"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o666 & ~_umask()


def test_runs_without_out_have_a_folder_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = [folder._fresh("flat") for _ in range(5)]
    assert len(set(names)) == 5
    assert all(name.is_dir() for name in names)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
