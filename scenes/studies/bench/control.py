"""The runs of `worm3d bench control`: scenes with controllers, several seeds each, by the MPC and by the baselines.

A case is one run. Its metrics are kept in a file of its own, with the scene that they are of and a digest of all else
that they depend on: the programs, and what the controller knows of the worm. A study that was stopped goes on where it
was.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from control.guest import RAISED
from scenes.models.control.build import maps_of
from scenes.models.control.schema import ControlScene
from scenes.models.loading import Scene, load_scene
from scenes.records.folder import write_bytes
from scenes.records.text import json_bytes
from scenes.running.packages import sources, versions
from scenes.running.runner import simulate
from scenes.running.terminal import timing
from scenes.studies.bench.control_trials import Trial
from worm3d.values.named import is_own

CONTROLLERS = ("mpc", "pi_los", "open_loop")
BLIND = "open_loop"
"""Controller that looks at nothing: noise does not matter to it, and one seed is enough."""

Value = float | None


class Metric(NamedTuple):
    """How a metric is written: title of its column, what it is, unit, format, and factor from a summary's value."""

    column: str
    says: str
    unit: str = ""
    form: str = ".2f"
    scale: float = 1.0

    def number(self, value: Value) -> str:
        """Return a value without its unit."""
        return "-" if value is None else f"{self.scale * value:{self.form}}"

    def text(self, value: Value) -> str:
        """Return a value with its unit."""
        return "-" if value is None else f"{self.number(value)} {self.unit}"


METRICS = {
    "speed_bias_relative": Metric("bias", "bias of the speed", "%", scale=100.0),
    "speed_error_rms_relative": Metric("rms", "rms error of the speed", "%", scale=100.0),
    "speed_bias_settled_relative": Metric("settled bias", "settled bias of the speed", "%", scale=100.0),
    "speed_error_rms_settled_relative": Metric("settled rms", "settled rms error of the speed", "%", scale=100.0),
    "settling_periods": Metric("settling", "periods until a step of the speed has settled to 10 %", "periods"),
    "heading_error_mean_deg": Metric("heading mean", "mean error of the heading", "deg"),
    "heading_error_rms_deg": Metric("heading rms", "rms error of the heading", "deg"),
    "cross_track_rms_bl": Metric("offset rms", "rms offset from the path", "BL", ".4f"),
    "cross_track_max_bl": Metric("offset max", "greatest offset from the path", "BL", ".4f"),
    "cross_track_mean_bl": Metric("steady", "steady offset from the path", "BL", ".4f"),
    "head_offset_rms_bl": Metric("head rms", "rms offset of the head from the path", "BL", ".4f"),
    "head_offset_max_bl": Metric("head max", "greatest offset of the head from the path", "BL", ".4f"),
    "joining_periods": Metric("joining", "periods until it stays within 0.02 BL of the path", "periods"),
    "speed_bias_m_s": Metric("bias mm/s", "bias of the speed", "mm/s", scale=1000.0),
    "mpc_failures": Metric("MPC failures", "failures of the MPC", form=".0f"),
    "control_step_ms_p50": Metric("p50", "median of the control steps", "ms"),
    "control_step_ms_p99": Metric("p99", "99th percentile of the control steps", "ms"),
    "overruns": Metric("overruns", "control steps that took too long", form=".0f"),
}
"""What is kept of each run, by its name in `summary.json`."""
WALL_CLOCK = ("control_step_ms_p50", "control_step_ms_p99", "overruns")
"""Metrics that differ when a run is made again."""
PERIOD = "control_period_ms"
"""Name under which the period of the control steps is kept beside them."""


@dataclass(frozen=True)
class Case:
    """One run."""

    trial: Trial
    controller: str
    seed: int

    def load(self) -> Scene:
        """Return its scene."""
        more = (f"controller.kind={self.controller}", f"seed={self.seed}")
        return load_scene(self.trial.scene, (*self.trial.overrides, *more))

    def file(self, folder: Path) -> Path:
        """Return where its metrics are kept."""
        return folder / "cases" / f"{self.trial.name}-{self.controller.replace(':', '.')}-{self.seed}.json"


@dataclass(frozen=True)
class Plan:
    """What is run: trials, with the seeds 0, 1, ..., by controllers."""

    trials: tuple[Trial, ...]
    seeds: int = 5
    controllers: tuple[str, ...] = CONTROLLERS

    def cases(self) -> list[Case]:
        """Return all cases."""
        return [
            Case(trial, controller, seed)
            for trial in self.trials
            for controller in self.controllers
            for seed in range(1 if controller == BLIND else self.seeds)
        ]


@dataclass(frozen=True)
class Found:
    """What a case came to; `metrics` are `METRICS` and `PERIOD`, None where one has no value."""

    trial: str
    controller: str
    seed: int
    status: str
    metrics: dict[str, Value]


@dataclass(frozen=True)
class Study:
    """What all cases came to."""

    found: tuple[Found, ...]
    kept: int
    """Cases that were in the folder already."""
    outdated: int
    """Cases that were run again: scene, programs or map have changed since, or their file cannot be read."""


def study(plan: Plan, folder: Path, watch: Callable[[int], None] = lambda done: None) -> Study:
    """Run all cases that are not in the folder yet; `watch` is called with the number of those that are done.

    Raises
    ------
    SceneError
        A scene is wrong, or the disc refused a file.
    """
    found, kept, outdated = [], 0, 0
    for done, case in enumerate(plan.cases(), start=1):
        scene, there = case.load(), case.file(folder).exists()
        # What a user's own controller depends on cannot be told: it runs again.
        earlier = None if is_own(case.controller) else _kept(case, scene, folder)
        kept += earlier is not None
        outdated += earlier is None and there
        found.append(earlier or _measured(case, scene, folder))
        watch(done)
    return Study(tuple(found), kept, outdated)


def _measured(case: Case, scene: Scene, folder: Path) -> Found:
    """Run a case and keep what it came to."""
    record = simulate(scene)
    seen: dict[str, Any] = {**record.summary.metrics, **timing(record)}
    metrics = {name: seen.get(name) for name in METRICS}
    metrics[PERIOD] = 1e3 * scene.settings.controller.period_s
    raised = any(fault["kind"] == RAISED for fault in record.summary.faults)
    found = Found(case.trial.name, case.controller, case.seed, RAISED if raised else record.status, metrics)
    content = json.loads(json_bytes({"scene": scene.to_toml(), "basis": basis(scene), **asdict(found)}))
    write_bytes(case.file(folder), json_bytes({**content, "digest": _digest(content)}, indent=1))
    return found


def _kept(case: Case, scene: Scene, folder: Path) -> Found | None:
    """Return what an earlier study found of the very same scene by the very same programs."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        content = json.loads(case.file(folder).read_text("utf-8"))
        if content.pop("digest") != _digest(content):
            return None
        if content.pop("scene") == scene.to_toml() and content.pop("basis") == basis(scene):
            return Found(**content)
    return None


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def basis(scene: Scene) -> str:
    """Return a digest of the versions, of all sources and of the identified maps of a scene with a controller."""
    assert isinstance(scene.settings, ControlScene)
    return _digest({"versions": versions(), "sources": sources(), "maps": maps_of(scene.settings)})


@dataclass(frozen=True)
class Row:
    """The worst over the seeds of one trial and controller; of each metric the value of greatest magnitude."""

    trial: str
    controller: str
    seeds: int
    failed: int
    """Runs that did not come to their end, or in which a controller of a user's own raised an exception."""
    metrics: dict[str, Value]
    """None where a seed has no value."""


def rows(found: Sequence[Found]) -> Iterator[Row]:
    """Yield the worst of each trial and controller, in their order."""
    for trial, controller in dict.fromkeys((each.trial, each.controller) for each in found):
        of = [each for each in found if (each.trial, each.controller) == (trial, controller)]
        worst = {name: _worst([each.metrics[name] for each in of]) for name in of[0].metrics}
        yield Row(trial, controller, len(of), sum(each.status != "done" for each in of), worst)


def _worst(values: list[Value]) -> Value:
    known = [value for value in values if value is not None]
    return max(known, key=abs) if len(known) == len(values) else None
