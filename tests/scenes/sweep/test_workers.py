"""Cases of a sweep on workers: real processes of Dask on the loopback, which are killed."""

from __future__ import annotations

import gc
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
import sweep_jobs
from sweep_jobs import jobs, perform

from scenes.language.errors import DiscError, SceneError
from scenes.records.folder import TEMPORARY_PREFIX
from scenes.sweep import cluster, flight
from scenes.sweep.engine import chosen
from scenes.sweep.executors import InProcess
from scenes.sweep.flight import DEATH, Flight, SchedulerError
from scenes.sweep.job import Ended, Job

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)  # Dask leaves sockets to the garbage collector
WORKERS = {**os.environ, "PYTHONPATH": str(Path(sweep_jobs.__file__).parent)}


@pytest.fixture(autouse=True)
def _collected() -> Iterator[None]:
    yield
    gc.collect()


def never() -> bool:
    return False


def runs_of(job: Job) -> list[str]:
    """Return the processes that finished a job."""
    return (Path(job.path).parent / f"begun-{job.key}").read_text().split()


def require_complete(wanted: list[Job]) -> None:
    """Check that each job was finished once, and that nothing else is in the folder that a sweep does not remove."""
    folder = Path(wanted[0].path).parent
    assert [len(runs_of(job)) for job in wanted] == [1] * len(wanted)
    assert {path.name for path in folder.iterdir() if not path.match(f"{TEMPORARY_PREFIX}*.part")} == {
        name for job in wanted for name in (Path(job.path).name, f"begun-{job.key}")
    }


def listening() -> set[str]:
    """Return the addresses on which this process and those that it has started listen."""
    me = psutil.Process()
    found = []
    for each in (me, *me.children(recursive=True)):
        with suppress(psutil.NoSuchProcess):  # a worker that was killed meanwhile
            found += each.net_connections("inet")
    return {link.laddr.ip for link in found if link.status == psutil.CONN_LISTEN}


class Scheduler:
    """Stands in for a client of Dask: notes tasks, none of which ends."""

    status = "running"

    def __init__(self, workers: int = 0) -> None:
        self.workers = workers
        self.keys: list[object] = []
        self.batches: list[tuple[Job, ...]] = []

    def subscribe_topic(self, topic: str, handler: object) -> None:
        """Nothing is ever told."""

    def submit(self, task: object, perform: object, batch: tuple[Job, ...], topic: str, *, key: object) -> Scheduler:
        self.keys.append(key)
        self.batches.append(batch)
        return self

    def add_done_callback(self, callback: object) -> None:
        """It is never done."""

    def cancel(self, futures: list[Scheduler]) -> None:
        assert len(futures) == len(self.batches)

    def nthreads(self) -> dict[str, int]:
        return {f"worker {k}": 1 for k in range(self.workers)}


class Failed:
    """Stands in for a task of Dask that ended with an exception."""

    status = "error"

    def exception(self) -> Exception:
        return ZeroDivisionError("nothing to divide by")


def flight_of(scheduler: Scheduler, hint: str = "") -> Flight:
    """Return a flight that stops after it has sent tasks once."""
    return Flight(scheduler, perform, iter([False, True]).__next__, hint)  # type: ignore[arg-type]


def test_two_tasks_are_the_same_to_the_scheduler_where_all_of_their_cases_are(tmp_path: Path) -> None:
    """A driver that comes after one that was killed would be told the cases of the other's task, and not its own."""
    scheduler, (a, b, c) = Scheduler(), jobs(tmp_path, "spin", 3)
    driver = flight_of(scheduler)
    for batch in ((a, b), (a, c), (b, c), (a, b, c), (a,)):
        driver._send(batch, 0)
        driver._send(batch, 1)
        assert len(set(scheduler.keys)) == len(scheduler.keys)
    flight_of(scheduler)._send((a, b), 0)
    assert scheduler.keys[-1] == scheduler.keys[0]


@pytest.mark.parametrize(("company", "tasks"), [(2, 6), (1, 3), (0, 1)])
def test_there_are_as_many_tasks_as_workers_have_places_and_half_of_the_cases_wait(
    tmp_path: Path, company: int, tasks: int
) -> None:
    """Short cases go together, as many as a task has time for; a case that may have killed a worker goes alone."""
    wanted = jobs(tmp_path, "spin", 120)
    for size, number, sizes in ((4, 0, {4}), (1000, 0, None), (4, 1, {1})):
        scheduler = Scheduler(3)
        driver = flight_of(scheduler)
        driver._size = size
        assert list(driver._try(number, wanted, company)) == []
        found = [len(batch) for batch in scheduler.batches]
        assert len(found) == tasks
        assert [job for batch in scheduler.batches for job in batch] == wanted[: sum(found)]
        if sizes is None:
            assert 120 * (1.0 - np.exp(-0.5)) - tasks < sum(found) <= 60, (
                "each task takes a half of its share of the rest"
            )
        else:
            assert set(found) == sizes


@pytest.mark.parametrize(
    ("number", "seconds", "size"),
    [(1, 0.001, 2), (1, 0.0, 2), (4, 0.5, 4), (4, 1.0, 2), (8, 0.4, 10), (8, 0.1, 16), (8, 100.0, 1)],
)
def test_as_many_cases_go_together_as_take_half_a_second_and_at_most_twice_as_many_as_before(
    number: int, seconds: float, size: int
) -> None:
    driver, ended = flight_of(Scheduler()), [(f"key{k}", "done", "") for k in range(number)]
    driver._under_way["key0"] = Scheduler()  # type: ignore[assignment]
    for _ in range(2):  # a worker's event, and what the scheduler says of the same task
        driver._news.put(flight._Report("key0", seconds, ended))
    assert list(driver._arrived()) == [Ended(*each) for each in ended]
    assert driver._size == size
    assert not driver._under_way


def test_a_user_who_has_to_start_workers_is_told_once_and_nobody_waits_for_ever(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flight, "LOOK", 0.0)
    monkeypatch.setattr(flight, "NOTICE", 0.02)
    told = {}
    for hint in ("", "run 'dask worker'"):
        scheduler = Scheduler()
        waiting = flight_of(scheduler, hint)
        waiting._look()
        assert capsys.readouterr().err == ""
        time.sleep(0.03)
        waiting._look()
        waiting._look()
        told[hint] = capsys.readouterr().err
    assert told == {"": "", "run 'dask worker'": "waiting for a worker: run 'dask worker'\n"}
    monkeypatch.setattr(flight, "WORKER_TIMEOUT_S", 0.02)
    with pytest.raises(SchedulerError, match="no worker for 0 minutes"):
        waiting._look()
    scheduler.workers = 1
    waiting._look()
    scheduler.status = "closed"
    with pytest.raises(SchedulerError, match="the scheduler has ended"):
        waiting._look()


@pytest.mark.parametrize("together", [1, 2])
def test_cases_of_a_task_that_fails_are_tried_again_unless_there_is_one(tmp_path: Path, together: int) -> None:
    batch = tuple(jobs(tmp_path, "spin", together))
    driver, task = flight_of(Scheduler()), Failed()
    driver._under_way[batch[0].key] = task  # type: ignore[assignment]
    report = driver._verdict(batch, task)  # type: ignore[arg-type]
    assert (report is None) == (together == 2)
    assert driver._lost == (list(batch) if together == 2 else [])


@pytest.mark.slow
def test_a_killed_worker_costs_no_case_and_a_killing_case_is_told(tmp_path: Path) -> None:
    innocent = jobs(tmp_path, "spin 0.3", 8)
    guilty, wrong = jobs(tmp_path, "kill", 1)[0], jobs(tmp_path, "raise", 1)[0]
    ended: dict[str, Ended] = {}
    for each in cluster.Local(2).run([innocent[0], guilty, wrong, *innocent[1:]], perform, never):
        assert each.key not in ended
        ended[each.key] = each
        if len(ended) == 2:
            assert listening() == {"127.0.0.1"}
        done = [job for job in innocent if job.key in ended]
        if len(done) == 3:
            os.kill(int(runs_of(done[-1])[0]), signal.SIGKILL)  # of a worker that has its next case by now
    assert ended.pop(guilty.key) == Ended(guilty.key, "failed", DEATH)
    assert ended.pop(wrong.key) == Ended(wrong.key, "failed", "ZeroDivisionError: nothing to divide by")
    assert {each.status for each in ended.values()} == {"done"}
    assert ended.keys() == {job.key for job in innocent}
    require_complete(innocent)


@pytest.mark.slow
def test_short_cases_that_share_a_task_with_a_killing_one_are_run_once(tmp_path: Path) -> None:
    innocent = jobs(tmp_path, "spin 0.01", 60)
    guilty, wrong = jobs(tmp_path, "kill", 1)[0], jobs(tmp_path, "raise", 1)[0]
    ended = list(cluster.Local(2).run([*innocent[:40], guilty, wrong, *innocent[40:]], perform, never))
    told = {each.key: each for each in ended}
    assert len(told) == len(ended) == 62
    assert told.pop(guilty.key) == Ended(guilty.key, "failed", DEATH)
    assert told.pop(wrong.key) == Ended(wrong.key, "failed", "ZeroDivisionError: nothing to divide by")
    assert {each.status for each in told.values()} == {"done"}
    require_complete(innocent)


@pytest.mark.slow
def test_the_worker_of_a_case_that_never_ends_is_replaced(tmp_path: Path) -> None:
    innocent = jobs(tmp_path, "spin 0.2", 6)
    stuck = replace(jobs(tmp_path, "hang", 1)[0], limit_s=0.5)
    begun = time.monotonic()
    ended = list(cluster.Local(2).run([innocent[0], stuck, *innocent[1:]], perform, never))
    assert time.monotonic() < begun + 60.0
    told = {each.key: each for each in ended}
    why = "took longer than 0.5 s, the time limit of a case: give cases more time by --case-limit-s"
    assert told.pop(stuck.key) == Ended(stuck.key, "failed", why)
    assert {each.status for each in told.values()} == {"done"}
    assert len(told) == len(innocent)
    assert [path.name for path in tmp_path.glob(f"{TEMPORARY_PREFIX}*")] == [
        f"{TEMPORARY_PREFIX}{stuck.key}.late.part"
    ], "a sweep removes it"
    assert all(len(runs_of(job)) == 1 for job in innocent)


@contextmanager
def started(*command: str) -> Iterator[tuple[subprocess.Popen[str], Iterator[str]]]:
    """Run one of Dask's own commands and give what it says."""
    program = Path(sys.executable).with_name("dask")
    process = subprocess.Popen(
        [program, *command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=WORKERS
    )
    assert process.stderr is not None
    try:
        yield process, iter(process.stderr)
    finally:
        process.terminate()
        process.communicate(timeout=20)


@contextmanager
def scheduler() -> Iterator[tuple[subprocess.Popen[str], str]]:
    options = ("--host", "127.0.0.1", "--port", "0", "--dashboard-address", "127.0.0.1:0")
    with started("scheduler", *options) as (process, lines):
        yield process, next(found[0] for line in lines if (found := re.search(r"tcp://127\.0\.0\.1:\d+", line)))


@pytest.mark.slow
def test_a_running_scheduler_is_used_and_its_end_is_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    wanted, full = jobs(tmp_path, "spin 0.2", 30), jobs(tmp_path, "full", 1)
    with scheduler() as (process, address):
        executor = chosen(scheduler=address)
        options = ("--host", "127.0.0.1", "--no-dashboard", "--no-nanny", "--nthreads", "1")
        with started("worker", address, *options):
            with pytest.raises(DiscError, match=r"cannot write .*: no space left on device"):
                list(executor.run(full, perform, never))
            stopped = time.monotonic() + 3.0
            some = list(executor.run(wanted, perform, lambda: time.monotonic() > stopped))
            assert 0 < len(some) < 20, "it stops where it is told to"
            lost = executor.run(wanted, perform, never)
            before = [next(lost) for _ in range(len(some) + 3)]
            process.kill()
            killed = time.monotonic()
            with pytest.raises(SchedulerError, match=r"the scheduler has ended: finished cases are kept, the same"):
                before += list(lost)
            assert time.monotonic() < killed + 10.0
    assert "Traceback" not in capfd.readouterr().err
    assert len(before) < len(wanted)
    ended = list(InProcess().run(wanted, perform, never))
    assert [each.key for each in ended] == [job.key for job in wanted]
    assert {each.key for each in ended if each.reason == "found"} >= {each.key for each in before}
    require_complete(wanted)


def test_where_nobody_answers_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense://", "127.0.0.1:x"):
        with pytest.raises(SceneError, match=rf"no scheduler answers at '{address}'; 'dask scheduler --host 127"):
            list(chosen(scheduler=address).run(jobs(tmp_path, "spin", 1), perform, never))


def test_workers_of_several_threads_are_refused() -> None:
    cluster.require_single({"tcp://127.0.0.1:1": 1})
    with pytest.raises(
        SceneError, match=r"at tcp://127\.0\.0\.1:2 has 4 threads, must have 1: .* --nthreads 1 --nworkers 4"
    ):
        cluster.require_single({"tcp://127.0.0.1:1": 1, "tcp://127.0.0.1:2": 4})


def test_a_folder_is_seen_where_a_file_of_the_driver_is(tmp_path: Path) -> None:
    probe = tmp_path / "probe"
    assert not cluster._sees(str(probe))
    probe.write_text("probe")
    assert cluster._sees(str(probe))
    probe.write_text("another one")
    assert not cluster._sees(str(probe))


def test_what_cannot_be_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert isinstance(chosen(), InProcess)
    with pytest.raises(SceneError, match="--workers: got 0, must be 1 or more"):
        chosen(workers=0)
    with pytest.raises(SceneError, match="give one of the two"):
        chosen(workers=2, scheduler="tcp://127.0.0.1:8786")
    with pytest.raises(SceneError, match="--bind is the address"):
        chosen(bind="0.0.0.0")
    with pytest.raises(SceneError, match=r"the workers cannot be started on 192\.0\.2\.1"):
        list(chosen(workers=1, bind="192.0.2.1").run([Job("a", "a", b"", "a")], perform, never))
    assert "warning: the scheduler listens on 192.0.2.1: anyone who can connect" in capsys.readouterr().err


def test_dask_is_imported_on_demand() -> None:
    program = "import sys; from scenes.sweep.engine import chosen; chosen(); print('distributed' in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout == "False\n"
