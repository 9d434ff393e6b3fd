"""The runs of `worm3d study control`: each trial of the family with the MPC, the baselines and other controllers.

A case is one run. A file for each case holds the result, the scene, and a digest of the programs and of the maps that
the controller may know. A study that was stopped continues with the missing cases.
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
"""Status of a run that is not lost."""
TOO_SLOW = "its median control step takes longer than the control period"
"""Status of a run that other load on the machine may have slowed down; such a case runs again."""

Value = float | None


@dataclass(frozen=True)
class Case:
    """One run."""

    trial: Trial
    controller: str

    def load(self) -> Scene:
        """Return the scene of the case; SceneError if the error of the case cannot be measured."""
        scene = load_scene(self.trial.scene, (*self.trial.overrides, f"controller.kind={self.controller}"))
        run = scene.settings.run
        if run.duration_s <= MIN_RUN_DURATION_S:
            raise SceneError(
                f"run.duration_s: got {run.duration_s:g} s, must be above {MIN_RUN_DURATION_S:g} s, when errors count"
            )
        if run.record_every * run.dt_s > COARSEST:
            raise SceneError(
                f"run.record_every: got {run.record_every}, must store a state every {COARSEST:g} s or sooner"
            )
        if not speeds_of(scene.settings).any():
            raise SceneError(
                "reference.speed_m_s: got 0 at all times, must be a way to go: errors are shares of that way"
            )
        return scene

    def file(self, folder: Path) -> Path:
        """Return the file of the result."""
        return folder / "cases" / f"{self.trial.name}-{self.controller.replace(':', '.')}.json"


@dataclass(frozen=True)
class Found:
    """Result of a case."""

    trial: str
    kind: str
    """Class of the trial."""
    controller: str
    status: str
    """`DONE`, or the reason why the trial is lost."""
    error: float
    """(B5); 1 if the trial is lost."""
    metrics: dict[str, Value]
    """Parts of the error as in `error_of`; `real_time_factor`; `step_share_p50` and `_p99` of the control period."""


@dataclass(frozen=True)
class Study:
    """Results of all cases."""

    found: tuple[Found, ...]
    kept: int
    """Number of cases that were in the folder already."""
    outdated: int
    """Number of cases that ran again, because scene, programs or map have changed, or because a file is unreadable."""


def study(
    cases: Sequence[Case], folder: Path, workers: int = 1, watch: Callable[[int], None] = lambda done: None
) -> Study:
    """Run all cases that are not in the folder yet; `watch` is called with the number of finished cases.

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
        raise SceneError("a worker process died; started again on the same --out, the rest is run") from error
    finally:
        if pool:
            pool.shutdown(cancel_futures=True)
    kept = sum(was_kept for _, was_kept in ended)
    return Study(tuple(found for found, _ in ended), kept, sum(there) - kept)


def _found(case: Case, folder: Path) -> tuple[Found, bool]:
    """Return the result of a case, and whether it was in the folder."""
    scene = case.load()
    # A user's own controller may depend on anything, so its cases run again.
    earlier = None if is_own(case.controller) else _kept(case, scene, folder)
    if earlier is not None:
        return earlier, True
    found = _measured(case, scene)
    content = json.loads(json_bytes({"scene": scene.to_toml(), "basis": basis(scene), **asdict(found)}))
    write_bytes(case.file(folder), json_bytes({**content, "digest": _digest(content)}, indent=1))
    return found, False


def _measured(case: Case, scene: Scene) -> Found:
    """Run a case."""
    settings, metrics = scene.settings, dict[str, Value]()
    assert isinstance(settings, ControlScene)
    try:
        record = simulate(scene)
        status = _lost(record, settings)
    except (DiscError, MissingPartError):
        raise
    except SceneError as error:  # of a part of the user's own: the others go on
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
        return f"it senses {', '.join(further)}, of which robots of the trials have no sensor"
    if record["force"].any():
        return "it commands forces of the chambers, which the worms of the trials do not have"
    return TOO_SLOW if timing(record)["control_step_ms_p50"] > 1e3 * settings.controller.period_s else DONE


def _kept(case: Case, scene: Scene, folder: Path) -> Found | None:
    """Return the result of an earlier study for the same scene and the same programs, None if there is none."""
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
    """Return a digest of the versions, of all sources and of the identified maps of a scene with a controller."""
    assert isinstance(scene.settings, ControlScene)
    return _digest({"versions": versions(), "sources": sources(), "maps": maps_of(scene.settings)})
