"""Running a sweep in a folder: find the cases without results, run them, and return the results of all cases."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from scenes.language.errors import SceneError
from scenes.language.sweep_section import CASE_LIMIT
from scenes.records.folder import TEMPORARY_PREFIX, is_used, made, remove
from scenes.sweep.case_file import CASES, FAILED_STATUS, NOT_RUN, CaseResult
from scenes.sweep.executors import LOOPBACK, Executor, InProcess, Stopped
from scenes.sweep.job import Ended, Job, found, perform, refused
from scenes.sweep.plan import Case, Plan


@dataclass
class Progress:
    """Progress of a sweep."""

    total: int
    """Number of different cases."""
    kept: int
    """Number of cases whose results were in the folder before."""
    ran: int = 0
    """Number of cases that were run and have ended."""
    failed: int = 0
    """Number of cases that diverged or failed, including cases of earlier runs and impossible cases."""
    refused: int = 0
    """Number of impossible cases, which fail without being run. They are counted neither in `kept` nor in `ran`."""

    @property
    def ended(self) -> int:
        """Number of cases that need not be run any more."""
        return self.kept + self.refused + self.ran


@dataclass
class Sweep:
    """A sweep in a folder."""

    plan: Plan
    folder: Path
    results: bool = False
    """Whether the files of the cases contain whole records."""
    limit_s: float = CASE_LIMIT
    """Time limit of a case, counted from the first step [s]."""
    _lost: dict[str, str] = field(default_factory=dict)
    """Reasons why cases failed in this run, by key."""

    def run(
        self,
        executor: Executor,
        stopped: Stopped = lambda: False,
        watch: Callable[[Progress], None] = lambda progress: None,
        *,
        anew: bool = False,
        retry_failed: bool = False,
    ) -> Progress:
        """Run the cases without results in the folder, and return the final progress.

        Parameters
        ----------
        executor : Executor
        stopped : callable
            Function that is called regularly. When it returns True, no further case is started.
        watch : callable
            Function that is called with the progress, at the beginning and after each case.
        anew : bool
            Whether to run all cases again.
        retry_failed : bool
            Whether to run cases again that diverged or failed.

        Raises
        ------
        SceneError
            If a file cannot be written, or a package is missing in a worker.
        """
        made(self.cases_folder)
        self._remove_parts()
        cases = {case.key: case for case in self.plan.cases}.values()
        impossible = [case for case in cases if case.refused]
        jobs = [self._job(case) for case in cases if not case.refused]
        missing, failed = self._missing(jobs, anew=anew, retry_failed=retry_failed)
        self._refuse(impossible)
        progress = Progress(
            len(cases), len(jobs) - len(missing), failed=failed + len(impossible), refused=len(impossible)
        )
        watch(progress)
        try:
            for ended in executor.run(missing, perform, stopped) if missing else ():
                self._note(ended, progress)
                watch(progress)
        finally:
            self._remove_parts()
        return progress

    def ended(self) -> Iterator[CaseResult]:
        """Yield the result of each case, in the order of the design."""
        for case in self.plan.cases:
            yield found(self._job(case)) or self._without_file(case)

    @cached_property
    def cases_folder(self) -> Path:
        """Folder of the files of the cases."""
        return self.folder.resolve() / CASES

    def _job(self, case: Case) -> Job:
        path = self.cases_folder / f"{case.key}{'.nc' if self.results else '.json'}"
        return Job(case.key, self.plan.base.name, case.packed, str(path), self.results, self.limit_s)

    def _missing(self, jobs: Sequence[Job], *, anew: bool, retry_failed: bool) -> tuple[list[Job], int]:
        """Return the jobs to run, and the number of failed cases among the others.

        Existing files of the jobs to run are removed.
        """
        missing, failed = [], 0
        for job in jobs:
            earlier = found(job)
            if earlier is not None and not anew and (earlier.status == "done" or not retry_failed):
                failed += earlier.status != "done"
                continue
            for suffix in (".json", ".nc"):
                remove(Path(job.path).with_suffix(suffix))
            missing.append(job)
        return missing, failed

    def _refuse(self, cases: Iterable[Case]) -> None:
        """Write the files of impossible cases."""
        for case in cases:
            job = self._job(case)
            if found(job) is None:
                refused(job, self.plan.base.model.name, case.seed, tomllib.loads(job.scene), case.refused)

    def _note(self, ended: Ended, progress: Progress) -> None:
        progress.ran += 1
        if ended.status != "done":
            progress.failed += 1
            self._lost[ended.key] = ended.reason

    def _without_file(self, case: Case) -> CaseResult:
        reason = self._lost.get(case.key)
        status, sentence = (NOT_RUN, "the sweep was stopped earlier") if reason is None else (FAILED_STATUS, reason)
        return CaseResult(case.key, self.plan.base.name, self.plan.base.model.name, status, sentence, case.seed)

    def _remove_parts(self) -> None:
        """Remove the unfinished files that killed workers have left behind."""
        with suppress(OSError):
            for path in self.cases_folder.glob(f"{TEMPORARY_PREFIX}*.part"):
                remove(path)


def require_place(folder: Path, *, force: bool) -> None:
    """Check that a folder can be used for a sweep: it does not exist, is empty, or contains a sweep.

    Raises
    ------
    SceneError
        If the folder contains other files and `force` is false.
    DiscError
        If the folder cannot be read.
    """
    if is_used(folder) and not force and not (folder / CASES).is_dir():
        raise SceneError(
            f"{folder} is not empty, and no folder of a sweep: choose another --out, or write to it with --force"
        )


def chosen(workers: int | None = None, scheduler: str | None = None, bind: str = LOOPBACK) -> Executor:
    """Return the executor for the options of the user. By default, the cases run in this process.

    Parameters
    ----------
    workers : int, optional
        Number of processes to start on this machine with Dask.
    scheduler : str, optional
        Address of a running Dask scheduler, such as tcp://127.0.0.1:8786.
    bind : str
        Network address where the scheduler for `workers` listens. Other machines can reach it, unless it is
        127.0.0.1.

    Raises
    ------
    SceneError
        If both `workers` and `scheduler` are given, or a value is invalid.
    """
    if workers is not None and scheduler is not None:
        raise SceneError(
            "--workers starts processes, --scheduler uses the workers of a running scheduler: give one of the two"
        )
    if workers is None and bind != LOOPBACK:
        raise SceneError("--bind is the address of the scheduler that --workers starts: give --workers too")
    if workers is None and scheduler is None:
        return InProcess()
    from scenes.sweep import cluster  # imports Dask, which takes as much time as a short run

    return cluster.Remote(scheduler) if scheduler is not None else cluster.Local(workers or 0, bind)
