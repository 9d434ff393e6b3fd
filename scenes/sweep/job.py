"""Running a case of a sweep in any process. The input is a `Job`, and the output a file."""

from __future__ import annotations

import tomllib
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes.language.errors import DiscError, MissingPartError, SceneError, printable
from scenes.language.sweep_section import CASE_LIMIT
from scenes.models.loading import Scene, trusted_scene
from scenes.records.store import save
from scenes.running.packages import versions
from scenes.running.runner import simulate
from scenes.sweep.case_file import FAILED_STATUS, CaseResult, read, result_of, write
from scenes.sweep.key import key_of
from scenes.sweep.limit import Clock, told

INTERRUPTED_STATUS = "interrupted"


@dataclass(frozen=True)
class Job:
    """The data that a worker needs to run a case."""

    key: str
    """Key of the case (`scenes.sweep.key`)."""
    name: str
    """Name of the scene."""
    packed: bytes
    """The checked scene with all defaults as TOML. It is compressed, since many scenes would need much memory."""
    path: str
    """Absolute path of the file of the case, `<key>.json`, or `<key>.nc` if the whole record is stored."""
    results: bool = False
    """Whether the file contains the whole record."""
    limit_s: float = CASE_LIMIT
    """Time limit, counted from the first step [s]."""

    @property
    def scene(self) -> str:
        """The checked scene with all defaults as TOML."""
        return zlib.decompress(self.packed).decode()


@dataclass(frozen=True)
class Ended:
    """How a case ended, as a worker reports it to the driver."""

    key: str
    status: str
    """`done`, `diverged` or `failed`, or `interrupted` if the case was stopped and has no file."""
    reason: str = ""
    """Reason if the status is not `done`."""


def perform(job: Job, stopped: Callable[[], bool] = lambda: False) -> Ended:
    """Run a case and write its file, completely or not at all. A case that has a file already is not run again.

    Parameters
    ----------
    job : Job
    stopped : callable
        Function that is called regularly while the case runs. If it returns True, the case ends without a file.

    Raises
    ------
    DiscError
        If the file cannot be written.
    MissingPartError
        If a package is missing.
    SceneError
        If the versions of the programs, or data that the scene needs, are not the same as for the driver.
    """
    if (earlier := found(job)) is not None:
        return _ended(earlier)
    data = tomllib.loads(job.scene)
    scene = trusted_scene(data, job.name)
    if key_of(scene) != job.key:
        raise SceneError(
            f"{job.name}: a worker's worm3d, its libraries, or a file or map that the scene needs, differs from the "
            "driver's: install the same versions on all machines"
        )
    clock = Clock(job.limit_s)
    try:
        record = simulate(scene, lambda done: clock.looks() and not stopped())
    except (DiscError, MissingPartError):
        raise
    except Exception as error:  # any error of a case must not stop the other cases
        return _failed(job, scene, data, error)
    if record.status == INTERRUPTED_STATUS:
        return too_late(job) if clock.is_over else Ended(job.key, INTERRUPTED_STATUS)
    result = result_of(job.key, record, data)
    if job.results:
        save(record, Path(job.path))
    else:
        write(result, Path(job.path))
    return _ended(result)


def too_late(job: Job) -> Ended:
    """Return the report about a case that exceeded its time limit.

    The case gets no file. The next sweep therefore runs the case again, since it may be fast enough on another machine.
    """
    return Ended(job.key, FAILED_STATUS, told(job.limit_s))


def found(job: Job) -> CaseResult | None:
    """Return the result of an earlier run of a case, or None if the case has to be run.

    A case has to be run if its file is missing or damaged, or has no whole record although the job needs one.
    """
    whole, short = Path(job.path).with_suffix(".nc"), Path(job.path).with_suffix(".json")
    if (earlier := read(whole)) is not None:
        return earlier
    earlier = read(short)
    return None if earlier is None or (job.results and earlier.status != FAILED_STATUS) else earlier


def _failed(job: Job, scene: Scene, data: Mapping[str, Any], error: Exception) -> Ended:
    """Write the file of a case that raised an error, and return how the case ended."""
    kind, words = type(error).__name__, " ".join(str(error).split())
    explained = bool(words) and isinstance(error, ValueError | SceneError)
    sentence = printable(words if explained else f"{kind}: {words}".removesuffix(": "))
    return _ended(refused(job, scene.model.name, scene.settings.seed, data, sentence))


def refused(job: Job, model: str, seed: int, scene: Mapping[str, Any], sentence: str) -> CaseResult:
    """Write the file of a case that failed without a record, and return its result."""
    result = CaseResult(job.key, job.name, model, FAILED_STATUS, sentence, seed, versions=versions(), scene=scene)
    write(result, Path(job.path).with_suffix(".json"))
    return result


def _ended(result: CaseResult) -> Ended:
    return Ended(result.key, result.status, "" if result.status == "done" else result.sentence)
