"""One case of a sweep in a worker of any kind: the input is a text, the output is a file."""

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
    """Input of a worker for a case: plain texts."""

    key: str
    """Key of the case (`scenes.sweep.key`)."""
    name: str
    """Name of the scene."""
    packed: bytes
    """The resolved and checked scene as TOML, compressed, since the scenes of many cases would fill the memory."""
    path: str
    """Absolute path of the case's file, `<key>.json`, or `<key>.nc` if the whole record is stored."""
    results: bool = False
    """Whether the file contains the whole record."""
    limit_s: float = CASE_LIMIT
    """Time limit, counted from the first step [s]."""

    @property
    def scene(self) -> str:
        """The resolved and checked scene as TOML."""
        return zlib.decompress(self.packed).decode()


@dataclass(frozen=True)
class Ended:
    """How a case ended, for the driver."""

    key: str
    status: str
    """`done`, `diverged` or `failed`; `interrupted` if the case was stopped and has no file."""
    reason: str = ""
    """Reason why the case is not done."""


def perform(job: Job, stopped: Callable[[], bool] = lambda: False) -> Ended:
    """Run a case and write the file, completely or not at all; a case with a file is not run again.

    Parameters
    ----------
    job : Job
    stopped : callable
        Called now and then while the case runs; if the function returns True, the case ends without a file.

    Raises
    ------
    DiscError
        The file cannot be written.
    MissingPartError
        A package is missing.
    SceneError
        The programs, or the data that the scene refers to, differ from the driver's.
    """
    if (earlier := found(job)) is not None:
        return _ended(earlier)
    data = tomllib.loads(job.scene)
    scene = trusted_scene(data, job.name)
    if key_of(scene) != job.key:
        raise SceneError(
            f"{job.name}: a worker's worm3d, its libraries, or a file or map that the scene needs, is not that of the "
            "driver: install the same versions where both run"
        )
    clock = Clock(job.limit_s)
    try:
        record = simulate(scene, lambda done: clock.looks() and not stopped())
    except (DiscError, MissingPartError):
        raise
    except Exception as error:  # the other cases continue after any error
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
    """Return how a case ended that exceeded the limit: without a file, since the case may be in time elsewhere."""
    return Ended(job.key, FAILED_STATUS, told(job.limit_s))


def found(job: Job) -> CaseResult | None:
    """Return the result of an earlier run of a case; None if the file is missing, damaged or incomplete."""
    whole, short = Path(job.path).with_suffix(".nc"), Path(job.path).with_suffix(".json")
    if (earlier := read(whole)) is not None:
        return earlier
    earlier = read(short)
    return None if earlier is None or (job.results and earlier.status != FAILED_STATUS) else earlier


def _failed(job: Job, scene: Scene, data: Mapping[str, Any], error: Exception) -> Ended:
    """Write the file of a case without a record."""
    kind, words = type(error).__name__, " ".join(str(error).split())
    explained = bool(words) and isinstance(error, ValueError | SceneError)
    sentence = printable(words if explained else f"{kind}: {words}".removesuffix(": "))
    return _ended(refused(job, scene.model.name, scene.settings.seed, data, sentence))


def refused(job: Job, model: str, seed: int, scene: Mapping[str, Any], sentence: str) -> CaseResult:
    """Write the file of a case that failed without a record, and return the result of the case."""
    result = CaseResult(job.key, job.name, model, FAILED_STATUS, sentence, seed, versions=versions(), scene=scene)
    write(result, Path(job.path).with_suffix(".json"))
    return result


def _ended(result: CaseResult) -> Ended:
    return Ended(result.key, result.status, "" if result.status == "done" else result.sentence)
