"""`worm3d bench control`: scenes with controllers, each with several seeds, by the MPC and by the baselines.

A case is one run. Its figures are kept in a file of its own, with the scene that they are of and a digest of all else
that they depend on (`scenes.bench.basis`), so that a study that was stopped goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from scenes.bench.basis import basis
from scenes.commands.report import timing
from scenes.commands.runner import simulate
from scenes.models.loading import Scene, load_scene
from scenes.records.files import write_bytes
from scenes.records.summary import without_nan

CONTROLLERS = ("mpc", "pi_los", "open_loop")
BLIND = "open_loop"
"""Looks at nothing: noise does not matter to it, and one seed is enough."""

METRICS = (
    *("speed_bias_relative", "speed_error_rms_relative", "speed_bias_settled_relative"),
    *("speed_error_rms_settled_relative", "settling_periods", "heading_error_mean_deg", "heading_error_rms_deg"),
    *("cross_track_rms_bl", "cross_track_max_bl", "mpc_failures"),
)
TIMES = ("control_step_ms_p50", "control_step_ms_p99", "overruns")
"""Wall-clock figures."""

Value = float | None


@dataclass(frozen=True)
class Trial:
    """A scene, with or without changes.

    Attributes
    ----------
    name, scene : str
    overrides : tuple of str
        As after -o.
    """

    name: str
    scene: str
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """What is run.

    Attributes
    ----------
    trials : tuple of Trial
    seeds : int
        0, 1, ...
    controllers : tuple of str
    """

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
class Case:
    """One run."""

    trial: Trial
    controller: str
    seed: int

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.trial.name}-{self.controller}-{self.seed}"

    def load(self) -> Scene:
        """Return its scene."""
        more = (f"controller.kind={self.controller}", f"seed={self.seed}")
        return load_scene(self.trial.scene, (*self.trial.overrides, *more))


@dataclass(frozen=True)
class Found:
    """What a case came to.

    Attributes
    ----------
    trial, controller : str
    seed : int
    status : str
    figures : dict
        `METRICS`, `TIMES` and the period of the control steps; None where one has no value.
    """

    trial: str
    controller: str
    seed: int
    status: str
    figures: dict[str, Value]


SCENES = (
    *("velocity_step", "velocity_sine", "heading_hold", "path_line", "path_circle", "path_s_curve", "path_waypoints"),
    *("velocity_pipe", "path_s_curve_slope", "disturbance_push"),
)
UPHILL = Trial("path_line_uphill", "path_line", ("world.slope_deg=3.0",))
FULL = (*(Trial(name, name) for name in SCENES), UPHILL)
SHORT = ("run.duration_s=12", "run.record_every=2")
QUICK = tuple(Trial(name, name, SHORT) for name in ("path_line", "path_circle"))
"""To try it out: too short to say much."""


@dataclass(frozen=True)
class Study:
    """What all cases came to.

    Attributes
    ----------
    found : tuple of Found
    kept : int
        Cases that were in the folder already.
    outdated : int
        Cases in the folder that were run again: their scene, a program or the identified map has changed since, or
        their file cannot be read.
    """

    found: tuple[Found, ...]
    kept: int
    outdated: int


def study(plan: Plan, folder: Path, watch: Callable[[int], None] = lambda done: None) -> Study:
    """Run all cases that are not in the folder yet; `watch` is called with the number of those that are done.

    Raises
    ------
    SceneError
        A scene is wrong, or the disc refused a file.
    """
    found, kept, outdated = [], 0, 0
    for done, case in enumerate(plan.cases(), start=1):
        scene, there = case.load(), _file(case, folder).exists()
        earlier = _kept(case, scene, folder)
        kept += earlier is not None
        outdated += earlier is None and there
        found.append(earlier or _measured(case, scene, folder))
        watch(done)
    return Study(tuple(found), kept, outdated)


def _measured(case: Case, scene: Scene, folder: Path) -> Found:
    """Run a case and keep what it came to."""
    record = simulate(scene)
    seen: dict[str, Any] = {**record.summary.figures, **timing(record)}
    figures = {name: seen.get(name) for name in (*METRICS, *TIMES)}
    figures["control_period_ms"] = 1e3 * scene.settings.controller.period_s
    found = Found(case.trial.name, case.controller, case.seed, record.status, figures)
    content = without_nan({"scene": scene.to_toml(), "basis": basis(scene), **asdict(found)})
    content["digest"] = _digest(content)
    write_bytes(_file(case, folder), f"{json.dumps(content, indent=1, allow_nan=False)}\n".encode())
    return found


def _kept(case: Case, scene: Scene, folder: Path) -> Found | None:
    """Return what an earlier study found of the very same scene by the very same programs."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        content = json.loads(_file(case, folder).read_text("utf-8"))
        if content.pop("digest") != _digest(content):
            return None
        if content.pop("scene") == scene.to_toml() and content.pop("basis") == basis(scene):
            return Found(**content)
    return None


def _digest(content: dict[str, Any]) -> str:
    """Return by what a damaged file is known."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _file(case: Case, folder: Path) -> Path:
    return folder / "cases" / f"{case.name}.json"


@dataclass(frozen=True)
class Row:
    """The worst over the seeds of one trial and controller.

    Attributes
    ----------
    trial, controller : str
    seeds : int
    failed : int
        Runs that did not come to their end.
    figures : dict
        Of each figure the value of the greatest magnitude; None where a seed has none.
    """

    trial: str
    controller: str
    seeds: int
    failed: int
    figures: dict[str, Value]


def rows(found: Sequence[Found]) -> Iterator[Row]:
    """Yield the worst of each trial and controller, in their order."""
    for trial, controller in dict.fromkeys((each.trial, each.controller) for each in found):
        of = [each for each in found if (each.trial, each.controller) == (trial, controller)]
        worst = {name: _worst([each.figures[name] for each in of]) for name in of[0].figures}
        yield Row(trial, controller, len(of), sum(each.status != "done" for each in of), worst)


def _worst(values: list[Value]) -> Value:
    known = [value for value in values if value is not None]
    return max(known, key=abs) if len(known) == len(values) else None
