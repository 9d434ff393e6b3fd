from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from scenes.language.errors import SceneError
from scenes.records.folder import TEMPORARY_PREFIX
from scenes.sweep.engine import Progress, Sweep, require_place
from scenes.sweep.executors import InProcess, Perform, Stopped
from scenes.sweep.job import Ended, Job
from scenes.sweep.plan import Plan, Source, planned

PLAN = planned(Source.of("planar_published", ("run.duration_s=0.05",)), {"gait.period_s": [1, 2, 3, 4]})
ONE_FAILS = planned(Source.of("planar_published", ("run.duration_s=0.05",)), {"gait.force_N": [1.0, 1e100, 2.0]})


class Counting:
    """Runs jobs in this process, in some order, and counts them."""

    def __init__(self, backwards: bool = False, most: int = 100) -> None:
        self.ran: list[str] = []
        self.backwards, self.most = backwards, most

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        for job in list(jobs)[:: -1 if self.backwards else 1][: self.most]:
            self.ran.append(job.key)
            yield perform(job, stopped)


def contents(folder: Path) -> dict[str, object]:
    """Return what the files of the cases say, but for the clock."""
    found = {path.name: json.loads(path.read_text()) for path in (folder / "cases").iterdir()}
    return {name: {**content, "timing": None, "digest": None} for name, content in found.items()}


def test_a_second_start_runs_only_what_is_missing(tmp_path: Path) -> None:
    keys = [case.key for case in PLAN.cases]
    first, second, third = Counting(most=2), Counting(), Counting()
    far = Sweep(PLAN, tmp_path).run(first)
    assert (far.total, far.kept, far.ran, far.failed) == (4, 0, 2, 0)
    assert [result.status for result in Sweep(PLAN, tmp_path).ended()] == ["done", "done", "not run", "not run"]
    far = Sweep(PLAN, tmp_path).run(second)
    assert (far.kept, far.ran) == (2, 2)
    assert first.ran + second.ran == keys
    Sweep(PLAN, tmp_path).run(third)
    assert third.ran == []
    assert {path.stem for path in (tmp_path / "cases").iterdir()} == set(keys)
    (tmp_path / "cases" / f"{keys[1]}.json").write_text("{")
    Sweep(PLAN, tmp_path).run(third)
    assert third.ran == [keys[1]], "a damaged file is no file"
    Sweep(PLAN, tmp_path).run(third, anew=True)
    assert third.ran[1:] == keys


def test_results_do_not_depend_on_order_nor_on_other_cases(tmp_path: Path) -> None:
    Sweep(PLAN, tmp_path / "a").run(InProcess())
    Sweep(PLAN, tmp_path / "b").run(Counting(backwards=True))
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    wider = planned(Source.of("planar_published", ("run.duration_s=0.05",)), {"gait.period_s": "5,3,1"})
    counting = Counting()
    Sweep(wider, tmp_path / "b").run(counting)
    assert counting.ran == [wider.cases[0].key], "cases that another sweep has run are kept"


def test_whole_records_are_kept_where_they_are_wanted(tmp_path: Path) -> None:
    Sweep(PLAN, tmp_path).run(InProcess())
    counting = Counting()
    Sweep(PLAN, tmp_path, results=True).run(counting)
    assert len(counting.ran) == 4, "figures alone are not enough"
    assert {path.suffix for path in (tmp_path / "cases").iterdir()} == {".nc"}
    Sweep(PLAN, tmp_path).run(counting)
    assert len(counting.ran) == 4, "a record has the figures too"
    assert [result.summary["duration_s"] for result in Sweep(PLAN, tmp_path).ended()] == [0.05] * 4


def test_failed_cases_are_kept_and_run_again_only_if_asked(tmp_path: Path) -> None:
    seen: list[Progress] = []
    far = Sweep(ONE_FAILS, tmp_path).run(InProcess(), watch=lambda progress: seen.append(replace(progress)))
    assert (far.ran, far.failed) == (3, 1)
    assert [progress.ran for progress in seen] == [0, 1, 2, 3]
    assert [progress.failed for progress in seen] == [0, 0, 1, 1]
    results = list(Sweep(ONE_FAILS, tmp_path).ended())
    assert [result.status for result in results] == ["done", "diverged", "done"]
    assert results[1].sentence.startswith("the state became infinite or not a number")
    counting = Counting()
    far = Sweep(ONE_FAILS, tmp_path).run(counting)
    assert (counting.ran, far.kept, far.failed) == ([], 3, 1)
    far = Sweep(ONE_FAILS, tmp_path).run(counting, retry_failed=True)
    assert counting.ran == [ONE_FAILS.cases[1].key]
    assert (far.kept, far.ran, far.failed) == (2, 1, 1)


class Deadly:
    """Loses the worker of each case."""

    def run(self, jobs: Sequence[Job], perform: Perform, stopped: Stopped) -> Iterator[Ended]:
        for job in jobs:
            (Path(job.path).parent / f"{TEMPORARY_PREFIX}1-a.part").write_text("half")
            yield Ended(job.key, "failed", "its worker died")


def test_a_case_whose_worker_died_has_no_file_and_runs_again(tmp_path: Path) -> None:
    sweep = Sweep(PLAN, tmp_path)
    assert sweep.run(Deadly()).failed == 4
    assert {(result.status, result.sentence) for result in sweep.ended()} == {("failed", "its worker died")}
    assert list((tmp_path / "cases").iterdir()) == [], "parts of files are removed"
    counting = Counting()
    Sweep(PLAN, tmp_path).run(counting)
    assert len(counting.ran) == 4


def test_cases_of_the_same_scene_run_once(tmp_path: Path) -> None:
    rows = [{"gait.period_s": 2.0}, {"gait.period_s": 1.0}, {"gait.period_s": 2.0}]
    plan = planned(Source.of("planar_published", ("run.duration_s=0.05",)), listed=rows)
    counting = Counting()
    Sweep(plan, tmp_path).run(counting)
    assert len(counting.ran) == 2
    first, _, last = Sweep(plan, tmp_path).ended()
    assert first == last


@pytest.mark.parametrize("calls", [1, 30])
def test_a_stop_ends_it_between_cases_or_within_one(tmp_path: Path, calls: int) -> None:
    asked = iter(range(1000))
    far = Sweep(long_plan(), tmp_path).run(InProcess(), stopped=lambda: next(asked) >= calls)
    assert far.ran == 0
    assert list((tmp_path / "cases").iterdir()) == []


def long_plan() -> Plan:
    return planned(Source.of("planar_published"), {"gait.period_s": [1, 2]})


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    require_place(tmp_path / "new", force=False)
    (tmp_path / f"{TEMPORARY_PREFIX}lock").touch()
    require_place(tmp_path, force=False)
    (tmp_path / "result.nc").touch()
    with pytest.raises(SceneError, match="is not empty, and no folder of a sweep: choose another --out"):
        require_place(tmp_path, force=False)
    require_place(tmp_path, force=True)
    (tmp_path / "cases").mkdir()
    require_place(tmp_path, force=False)
