"""Tuned constants at half and at double: what each of them is worth, as a table.

    python tests/benchmarks/constants.py [control] [solver] [--only NAME] [--workers 2]

Measured are the constants that have a row in a table of `control/CONSTANTS.md`, which says what the cells are, or of
`worm3d/solver/CONSTANTS.md`; all take hours. `--only` chooses constants by a part of "module.NAME". For the solver a
cell has the evaluations of the residual per step (mean of four scenes, the first 6 s of each), the fallbacks in all of
them, and of each Newton's iterations with a new Jacobian, and the distance; "!" marks a run that did not reach its end.

Each value is measured in a process of its own, which imports a copy of the package with that value. The solver is then
compiled anew, which takes half a minute.
"""

from __future__ import annotations

import ast
import importlib
import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from itertools import count, islice
from pathlib import Path
from typing import Any, NamedTuple

from measuring import mapped, options, say

ROOT = Path(__file__).parents[2]
PAGES = {"control": "control/CONSTANTS.md", "solver": "worm3d/solver/CONSTANTS.md"}
KINDS = {
    "worm3d.": "solver",
    "control.faults.chambers": "chambers",
    "control.faults.descent": "nothing",
    "control.faults": "faults",
    "control.tracking.guide": "fields",
    "control.tracking.search": "fields",
    "control.": "trials",
}
"""Measurement that suits the constants of modules, by the beginning of their names; the first that fits counts."""
SEED = 900
"""Seed of trials and faults."""


class Constant(NamedTuple):
    """A constant of a module; without a name: all constants as they are."""

    module: str
    name: str = ""
    value: Any = None
    meaning: str = ""

    @property
    def kind(self) -> str:
        """Measurement that suits it."""
        return next(kind for beginning, kind in KINDS.items() if self.module.startswith(beginning))


class Found(NamedTuple):
    """Errors of runs, and other results in words."""

    errors: tuple[float, ...]
    words: str = ""


def constants(subject: str) -> Iterator[Constant]:
    """Yield the constants of a page, whose rows have names such as `loop.NAME`, or files as titles before them."""
    page = ROOT / PAGES[subject]
    module = ""
    for line in page.read_text(encoding="utf-8").splitlines():
        title = re.match(r"\| \*\*`(.*)\.py`\*\*", line)
        row = re.match(r"\| `([a-z_.]*?)\.?([A-Z_]+)` \|", line)
        if title:
            path = os.path.normpath(page.parent / title[1])
            module = os.path.relpath(path, ROOT).replace("/", ".")
        if row:
            home = f"control.{row[1]}" if row[1] else module
            cells = line.strip("| ").split(" | ")
            value = getattr(importlib.import_module(home), row[2])
            yield Constant(home, row[2], value, cells[2] if module else cells[-1])


def scaled(value: Any, factor: float) -> Any:
    """Return a constant by a factor; whole numbers stay whole and above 0."""
    if isinstance(value, dict):
        return {key: scaled(each, factor) for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


def measured(constant: Constant) -> Found:
    """Return what the suitable measurement finds with a value of a constant, in a process for nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        if constant.name:
            _change(constant, Path(folder))
        try:
            return MEASURES[constant.kind]()
        except Exception as error:  # a constant without which nothing goes
            return Found((), f"{type(error).__name__}: {error}"[:60])


def _change(constant: Constant, folder: Path) -> None:
    """Let this process import the package from a copy in which the constant has the value."""
    package, *rest = constant.module.split(".")
    shutil.copytree(ROOT / package, folder / package)
    path = folder.joinpath(package, *rest).with_suffix(".py")
    lines = path.read_text(encoding="utf-8").splitlines()
    assigned = (node for node in ast.parse("\n".join(lines)).body if isinstance(node, ast.Assign))
    end = next(
        node.end_lineno for node in assigned if constant.name in ast.unparse(node.targets[0]).strip("()").split(", ")
    )
    lines.insert(end or 0, f"{constant.name} = {constant.value!r}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    sys.path.insert(0, str(folder))
    if package == "worm3d":  # none of what is compiled here is of use elsewhere
        os.environ["XDG_CACHE_HOME"] = str(folder)


def _trials() -> Found:
    """Return errors in short trials of the benchmark, and after a short error of the centre of mass."""
    import closed_loop

    from scenes.studies.bench.control_trials import drawn

    late = ("heading", "stop_and_go", "speed_steps")
    trials = (drawn(SEED, k) for k in count())
    short = islice((trial for trial in trials if trial.kind not in late), 3)
    cases = [(each.scene, [*each.overrides[:-3], "run.duration_s=18", *each.overrides[-2:]]) for each in short]
    jump = closed_loop.drawn("errors", SEED)
    cases.append((jump.scene, [*jump.overrides, f"seed={SEED}", "controller.map=default"]))
    return Found(tuple(_run(*case)[1] for case in cases))


def _fields() -> Found:
    """Return errors in four fields of obstacles, and the least clearance of the body."""
    import obstacle_fields

    drawn = [obstacle_fields.field(seed) for seed in (300, 301, 303, 305)]
    runs = [_run(each.scene, [*each.overrides, "run.record_every=1"], each.bare) for each in drawn]
    least = min(float(run.summary["body_clearance_min_bl"]) for run, _ in runs)
    return Found(tuple(error for _, error in runs), f"{least:.3f}")


def _run(name: str, overrides: list[str], reference: Any = None) -> tuple[Any, float]:
    """Return a run and its error; errors below 2 % of the speed asked for count as 2 %."""
    from scenes.models.control.reference import reference_of
    from scenes.models.loading import load_scene
    from scenes.running.runner import simulate
    from scenes.studies.bench.control_error import error_of

    scene = load_scene(name, overrides)
    run, settings = simulate(scene), scene.settings
    error = error_of(run, reference or reference_of(settings), settings.worm.length_m)["error"]
    return run, 1.0 if error is None else max(error, 0.02)


def _faults() -> Found:
    """Return how many of five faults are named, and what else is told of them and of a run without."""
    return _told([("faults", seed, "mpc") for seed in range(SEED, SEED + 5)] + [("clean", SEED + 5, "mpc")])


def _chambers() -> Found:
    """Return how many of six dead chambers are named and after what time, and what else is told."""
    return _told([("chambers", segment, "mpc") for segment in range(6)])


def _told(tasks: list[tuple[str, int, str]]) -> Found:
    import closed_loop

    found = [closed_loop.measured(task) for task in tasks]
    named = sum(value for each in found for name, value in each.items() if name.endswith(" named"))
    others = sum(each.get("#others", 0.0) + each.get("#faults", 0.0) for each in found)
    after = [each["after s"] for each in found if "after s" in each]
    return Found((), f"{named:.0f} named, {others:.0f} others, {sum(after) / max(len(after), 1):.2f} s")


def _solver() -> Found:
    """Return evaluations and fallbacks of four scenes, and Newton's iterations and the distance of each."""
    import worm3d
    from scenes.models.loading import load_scene
    from scenes.models.worm.build import simulate

    iterations, distances, evaluations, fallbacks = [], [], list[float](), 0
    for name in ("flat", "pipe_bend", "slope_15", "rubble"):
        settings: Any = load_scene(name, ["run.duration_s=6"]).settings
        run = simulate(settings, lambda done: True)
        done = run.status is worm3d.Status.DONE
        iterations.append(f"{run.newton_iterations.mean():.2f}" if done else "!")
        evaluations += [float((run.newton_iterations + run.gradient_evaluations).mean())] if done else []
        fallbacks += int(run.fallbacks.sum())
        distances.append(f"{run.distance:.5f}")
    mean = sum(evaluations) / max(len(evaluations), 1)
    return Found((), f"{mean:.2f}, {fallbacks} ({', '.join(iterations)}; {', '.join(distances)} m)")


def _nothing() -> Found:
    return Found((), "-")


MEASURES = {
    "trials": _trials,
    "fields": _fields,
    "faults": _faults,
    "chambers": _chambers,
    "solver": _solver,
    "nothing": _nothing,
}


def rows(subjects: list[str], only: str, workers: int) -> Iterator[str]:
    """Yield the lines of the table."""
    every = (each for subject in subjects for each in constants(subject))
    asked = [each for each in every if only in f"{each.module}.{each.name}"]
    usual = {each.kind: Constant(each.module) for each in asked}
    tasks = [*usual.values()]
    for each in asked:
        tasks += [each._replace(value=scaled(each.value, factor)) for factor in (0.5, 2.0)]
    yield "| constant | value | at half | at double | meaning |"
    yield "|---|---|---|---|---|"
    results = mapped(measured, tasks, workers, fresh=True)
    as_they_are = {kind: next(results) for kind in usual}
    for kind, found in as_they_are.items():
        yield f"| (as they are, {kind}) | | {_cell(found, found)} | | |"
    for each in asked:
        half, double = (_cell(next(results), as_they_are[each.kind]) for _ in range(2))
        name = f"{each.module.removeprefix('control.')}.{each.name}"
        yield f"| `{name}` | {_short(each.value)} | {half} | {double} | {each.meaning} |"


def _cell(found: Found, usual: Found) -> str:
    if not found.errors:
        return found.words
    ratio = math.exp(sum(math.log(a / b) for a, b in zip(found.errors, usual.errors, strict=True)) / len(found.errors))
    return f"{ratio:.3f}" + (f", {found.words}" if found.words else "")


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {each:g}" for key, each in value.items())
    return ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"


if __name__ == "__main__":
    given = options(__doc__, PAGES, only="", workers=2)
    for row in rows(given.names, given.only, given.workers):
        say(row)
