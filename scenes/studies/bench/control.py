"""The runs of `worm3d study control`: each controller (the MPC, the baselines and others) runs each trial.

A case is one run: one trial with one controller. Each case has a file with the result, the scene, and a digest. The
digest identifies the source code, the versions of the libraries, and the maps that the controller may read. If a study
was stopped, the next call runs only the missing cases.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from control.guest import RAISED
from scenes.language.errors import DiscError, MissingPartError, SceneError
from scenes.language.schema import keys_in
from scenes.models.control.build import maps_of, sensors_of
from scenes.models.control.reference import reference_of, speeds_of
from scenes.models.control.schema import ControlScene, Sensor
from scenes.models.loading import Scene, load_scene
from scenes.records.folder import write_bytes
from scenes.records.record import Record
from scenes.records.text import json_bytes
from scenes.running.packages import sources, versions
from scenes.running.runner import simulate
from scenes.running.terminal import timing
from scenes.studies.bench.control_error import COARSEST, MIN_RUN_DURATION_S, error_of
from scenes.studies.bench.control_trials import Trial
from worm3d.values.named import is_own

CONTROLLERS = ("mpc", "pi_los", "open_loop")
DONE = "done"
"""Status of a run that has come to its end, so that its error counts."""
TOO_SLOW = "its median control step takes longer than the control period"
"""Status of a run that other programs on the machine may have slowed down. Such a case runs again."""

Value = float | None


@dataclass(frozen=True)
class Case:
    """One run."""

    trial: Trial
    controller: str

    def load(self) -> Scene:
        """Return the scene of the case.

        Raises
        ------
        SceneError
            The error cannot be measured: the run is too short, its rows are too far apart, or the speed is always 0.
        """
        scene = load_scene(self.trial.scene, (*self.trial.overrides, f"controller.kind={self.controller}"))
        run = scene.settings.run
        if run.duration_s <= MIN_RUN_DURATION_S:
            raise SceneError(
                f"run.duration_s: got {run.duration_s:g} s, must be above {MIN_RUN_DURATION_S:g} s: errors count "
                "only from then on"
            )
        if run.record_every * run.dt_s > COARSEST:
            raise SceneError(
                f"run.record_every: got {run.record_every}, must store a state every {COARSEST:g} s or sooner"
            )
        if not speeds_of(scene.settings).any():
            raise SceneError(
                "reference.speed_m_s: got 0 at all times, must be above 0 at some time: errors are fractions of the "
                "required distance"
            )
        return scene

    def file(self, folder: Path) -> Path:
        """Return the file of the result."""
        return folder / "cases" / f"{self.trial.name}-{self.controller.replace(':', '.')}.json"


@dataclass(frozen=True)
class Found:
    """Result of a case. A trial is lost if its run does not count, for a reason that `status` gives."""

    trial: str
    kind: str
    """Class of the trial."""
    controller: str
    status: str
    """`DONE`, or the reason why the trial is lost."""
    error: float
    """Error (B5) of `scenes.studies.bench.control_error`, without unit; 1 if the trial is lost."""
    metrics: dict[str, Value]
    """Parts of the error as in `error_of`, `real_time_factor`, and `step_share_p50` and `step_share_p99`: the median
    and the 99th percentile of the time of a control step, as fractions of the control period."""


@dataclass(frozen=True)
class Study:
    """Results of all cases."""

    found: tuple[Found, ...]
    kept: int
    """Number of cases that were in the folder already."""
    outdated: int
    """Number of cases that ran again although they have a file, because the scene, the source code or a map has
    changed, or because the file is unreadable."""


def study(
    cases: Sequence[Case], folder: Path, workers: int = 1, watch: Callable[[int], None] = lambda done: None
) -> Study:
    """Run all cases that are not in the folder yet, and return the results of all cases.

    Parameters
    ----------
    cases : sequence of Case
    folder : Path
        Folder of the study; its subfolder `cases` holds the files.
    workers : int
        Number of processes.
    watch : callable
        Called with the number of finished cases after each case.

    Raises
    ------
    SceneError
        A scene is wrong, the disc refused a file, or a worker died.
    """
    go, there = partial(_found, folder=folder), [case.file(folder).exists() for case in cases]
    pool, ended = ProcessPoolExecutor(workers, get_context("spawn")) if workers > 1 else None, []
    try:
        for each in pool.map(go, cases) if pool else map(go, cases):
            ended.append(each)
            watch(len(ended))
    except BrokenProcessPool as error:
        raise SceneError("a worker process died; with the same --out, the next call runs the missing cases") from error
    finally:
        if pool:
            pool.shutdown(cancel_futures=True)
    kept = sum(was_kept for _, was_kept in ended)
    return Study(tuple(found for found, _ in ended), kept, sum(there) - kept)


def _found(case: Case, folder: Path) -> tuple[Found, bool]:
    """Return the result of a case, and whether the result was already in the folder."""
    scene = case.load()
    # A user's own controller may depend on any file, so that an earlier result may be outdated.
    earlier = None if is_own(case.controller) else _kept(case, scene, folder)
    if earlier is not None:
        return earlier, True
    found = _measured(case, scene)
    content = json.loads(json_bytes({"scene": scene.to_toml(), "basis": basis(scene), **asdict(found)}))
    write_bytes(case.file(folder), json_bytes({**content, "digest": _digest(content)}, indent=1))
    return found, False


def _measured(case: Case, scene: Scene) -> Found:
    """Run a case and return its result."""
    settings, metrics = scene.settings, dict[str, Value]()
    assert isinstance(settings, ControlScene)
    try:
        record = simulate(scene)
        status = _lost(record, settings)
    except (DiscError, MissingPartError):
        raise
    except SceneError as error:  # an error in a user's own controller must not stop the other cases
        if not is_own(case.controller):
            raise
        record, status = None, " ".join(error.lines)
    if record is not None:
        times, period = timing(record), 1e3 * settings.controller.period_s
        steps = {f"step_share_{p}": times.get(f"control_step_ms_{p}", 0.0) / period for p in ("p50", "p99")}
        metrics = {"real_time_factor": times["real_time_factor"], **steps}
        if status == DONE:
            metrics |= error_of(record, reference_of(settings), settings.worm.length_m)
    missed = metrics.pop("error", None)
    return Found(case.trial.name, case.trial.kind, case.controller, status, 1.0 if missed is None else missed, metrics)


def _lost(record: Record, settings: ControlScene) -> str:
    """Return the reason why a trial is lost, or `DONE`."""
    keys = tuple(keys_in(Sensor))
    further = [name for name in sensors_of(settings).channels if not any(key.startswith(f"{name}_") for key in keys)]
    faults = [str(fault["what"]) for fault in record.summary.faults if fault["kind"] == RAISED]
    if record.status != DONE:
        return record.sentence
    if faults:
        return faults[0]
    if further:
        return f"it senses {', '.join(further)}, for which the worms of the trials have no sensor"
    if record["force"].any():
        return "it commands forces of the chambers, which the worms of the trials do not have"
    return TOO_SLOW if timing(record)["control_step_ms_p50"] > 1e3 * settings.controller.period_s else DONE


def _kept(case: Case, scene: Scene, folder: Path) -> Found | None:
    """Return the result in the file of the case, or None if the case has to run.

    A case has to run if its file is missing or damaged, if the file is for another scene or other source code, or if
    the controller was too slow in the earlier run.
    """
    with suppress(OSError, ValueError, TypeError, KeyError):
        content = json.loads(case.file(folder).read_text("utf-8"))
        if content.pop("digest") != _digest(content):
            return None
        same = content.pop("scene") == scene.to_toml() and content.pop("basis") == basis(scene)
        return Found(**content) if same and content["status"] != TOO_SLOW else None
    return None


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def basis(scene: Scene) -> str:
    """Return a digest of the library versions, of all source files, and of the identified maps of the scene."""
    assert isinstance(scene.settings, ControlScene)
    return _digest({"versions": versions(), "sources": sources(), "maps": maps_of(scene.settings)})
