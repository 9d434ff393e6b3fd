"""The constants of the controller at half and at double: what each of them is worth, as a table.

    python tests/benchmarks/control_constants.py [NAME ...] [--trials 4] [--duration 18] [--workers 2]

Without a NAME it prints the page `control/CONSTANTS.md` (`PAGE` says what the cells are), in some two hours of two
cores. NAME chooses constants by a part of "module.NAME". Each is measured in a process of its own, in which its module
is imported with the other value.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import inspect
import math
import sys
from collections.abc import Iterator, Sequence
from itertools import count, islice
from multiprocessing import get_context
from types import ModuleType
from typing import Any, NamedTuple

MODULES = tuple(
    f"control.{name}"
    for name in (
        *("loop", "supervisor", "sensing.gate", "tracking.preview", "tracking.guide", "tracking.search"),
        *("estimation.chamber_gains", "estimation.estimate", "estimation.estimator", "estimation.ground"),
        *("estimation.kalman", "estimation.noise", "estimation.reduced", "estimation.wave"),
        *("planning.mpc", "planning.feed_forward", "planning.gauss_newton", "planning.terms", "planning.suited"),
        *("faults.chambers", "faults.descent", "faults.rules", "faults.sides", "faults.watch"),
    )
)
SEED = 900
LONG = ("heading", "stop_and_go", "speed_steps")
"""Classes of trials with steps that come late: they are too long."""
FIELDS = (300, 301, 303, 305)
"""Seeds of fields of obstacles."""
PAGE = """# Constants of the controller

Chosen numbers in `control` that are no keys of scenes, in units of the worm where possible (body lengths, waves,
standard deviations). Each constant was halved and doubled, alone, and the controller `mpc` with the default map was
compared with the same controller and the usual constant:

* `faults/rules`, `sides`, `watch`: number of named faults, of five faults of different kinds, within three waves, and
  number of other reported faults in these runs and in a clean run;
* `faults/chambers`: number of named dead chambers, of six, number of other reported faults, and mean time until a dead
  chamber is named;
* `tracking/search`, `guide`: ratio of the errors in four fields of obstacles, and least clearance of the body in body
  lengths;
* elsewhere: ratio of the errors (B5) in trials of the benchmark and after a short error of the centre of mass. A few
  trials do not separate 1.03 from 1. A constant with 1.000 on both sides serves cases outside these trials: failing
  sensors, the end of a path, pipes, or a gyroscope.

"-" marks a constant that was not measured. The modules give further reasons for each constant. This page was made by
`python tests/benchmarks/control_constants.py`.

"""
NOTHING = 0.02
"""Error below which errors count as this one [shares of the speed asked for]."""


class Constant(NamedTuple):
    """A constant of a module."""

    module: str
    name: str
    value: Any
    meaning: str


class Task(NamedTuple):
    """A value of a constant, if any, and the measurement."""

    kind: str
    module: str
    name: str
    value: Any
    trials: int
    duration: float


class Found(NamedTuple):
    """Errors of runs, least clearance, faults named and others, and the mean time until one is named [s]."""

    errors: tuple[float, ...]
    clearance: float = math.inf
    named: int = 0
    false: int = 0
    after: float = math.nan


def kind_of(module: str) -> str:
    """Return the measurement that suits the constants of a module."""
    room, name = module.split(".")[1:] if module.count(".") == 2 else ("", "")
    if name in ("search", "guide"):
        return "fields"
    return {"chambers": "chambers", "descent": "nothing"}.get(name, "faults") if room == "faults" else "trials"


def constants() -> Iterator[Constant]:
    """Yield the constants of all modules that are chosen numbers, with the first sentence of what is said of each."""
    for name in MODULES:
        module = importlib.import_module(name)
        body = ast.parse(inspect.getsource(module)).body
        for node, after in zip(body, [*body[1:], None], strict=True):
            said = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
            for target in _names(node):
                if said and _is_chosen(getattr(module, target)):
                    meaning = " ".join(str(said).split()).split(". ")[0].rstrip(".")
                    yield Constant(name, target, getattr(module, target), meaning)


def _names(node: ast.AST) -> list[str]:
    if not isinstance(node, ast.Assign):
        return []
    targets = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets
    return [target.id for target in targets if isinstance(target, ast.Name)]


def _is_chosen(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_is_chosen, value.values()))
    if isinstance(value, tuple):
        return bool(value) and all(map(_is_chosen, value))
    return isinstance(value, (int, float)) and not isinstance(value, bool) and 1e-5 < value < math.inf


def scaled(value: Any, factor: float) -> Any:
    """Return a constant by a factor; whole numbers stay whole and above 0."""
    if isinstance(value, dict):
        return {key: scaled(each, factor) for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


class _WithValue(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports a module with another value of a constant."""

    def __init__(self, task: Task) -> None:
        self.task = task

    def find_spec(self, fullname: str, path: Any, target: ModuleType | None = None) -> Any:
        if fullname != self.task.module:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path)
        assert spec is not None
        assert spec.origin is not None
        return importlib.util.spec_from_file_location(fullname, spec.origin, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        with open(str(module.__file__)) as file:
            tree = ast.parse(file.read())
        at = next(k for k, node in enumerate(tree.body) if self.task.name in _names(node))
        tree.body[at + 1 : at + 1] = ast.parse(f"{self.task.name} = {self.task.value!r}").body
        exec(compile(ast.fix_missing_locations(tree), str(module.__file__), "exec"), module.__dict__)


def measured(task: Task) -> Found | str:
    """Return the measurement of a task, in a process that is used for nothing else."""
    if task.module:
        sys.meta_path.insert(0, _WithValue(task))
    try:
        return MEASURES[task.kind](task)
    except Exception as error:  # a constant without which nothing goes
        return f"{type(error).__name__}: {error}"[:60]


def _trials(task: Task) -> Found:
    from scenes.studies.bench.control_trials import drawn

    short = list(islice((k for k in count() if drawn(SEED, k).kind not in LONG), task.trials))
    return Found(tuple(_error(k, task.duration, jumps=place == task.trials - 1) for place, k in enumerate(short)))


def _error(number: int, duration: float, jumps: bool) -> float:
    import closed_loop
    import numpy as np

    from scenes.models.control.reference import reference_of
    from scenes.models.loading import load_scene
    from scenes.running.runner import simulate
    from scenes.studies.bench.control_error import error_of
    from scenes.studies.bench.control_trials import drawn

    if jumps:
        case = closed_loop.errors(SEED, np.random.default_rng([33, SEED]))
        scene = load_scene(case.scene, [*case.overrides, f"seed={SEED}", "controller.map=default"])
    else:
        trial = drawn(SEED, number)
        scene = load_scene(trial.scene, [*trial.overrides[:-3], f"run.duration_s={duration}", *trial.overrides[-2:]])
    settings: Any = scene.settings
    error = error_of(simulate(scene), reference_of(settings), settings.worm.length_m)["error"]
    return 1.0 if error is None else max(error, NOTHING)


def _fields(task: Task) -> Found:
    import obstacle_fields

    from scenes.studies.bench.control_error import error_of

    errors, least = [], math.inf
    for drawn in map(obstacle_fields.field, FIELDS):
        run = _run(drawn.scene, *drawn.overrides, "run.record_every=1")
        errors.append(error_of(run, drawn.bare, obstacle_fields.LENGTH)["error"] or 1.0)
        least = min(least, float(run.summary["body_clearance_min_bl"]))
    return Found(tuple(errors), clearance=least)


def _faults(task: Task) -> Found:
    import closed_loop
    import numpy as np

    named = false = 0
    for seed in range(SEED, SEED + 6):
        draw = closed_loop.faults if seed < SEED + 5 else closed_loop.clean
        case = draw(seed, np.random.default_rng([33, seed]))
        run = _run(case.scene, *case.overrides, f"seed={seed}", "controller.map=default")
        figures = closed_loop.named(case, None, run)
        named += sum(int(value) for name, value in figures.items() if case.kind and name.endswith(" named"))
        false += sum(row["kind"] != case.kind for row in run.summary.faults)
    return Found((), named=named, false=false)


def _chambers(task: Task) -> Found:
    false, after = 0, list[float]()
    for segment in range(6):
        dead = "fault.chamber=true", f"fault.chamber_segment={segment}", "fault.chamber_begin_s=10"
        run = _run("path_line", *dead, "controller.map=default", "run.duration_s=15")
        named = [row for row in run.summary.faults if row["kind"] == f"chamber {segment} left"]
        told = [row for row in named if float(row["time_s"]) >= 10.0]
        after += [float(row["time_s"]) - 10.0 for row in told[:1]]
        false += len(run.summary.faults) - len(told)
    return Found((), named=len(after), false=false, after=sum(after) / max(len(after), 1))


def _run(scene: str, *overrides: str) -> Any:
    from scenes.models.loading import load_scene
    from scenes.running.runner import simulate

    return simulate(load_scene(scene, [*overrides]))


MEASURES = {
    "fields": _fields,
    "faults": _faults,
    "chambers": _chambers,
    "trials": _trials,
    "nothing": lambda task: Found(()),
}


def lines(names: Sequence[str], task: Task, workers: int) -> Iterator[str]:
    """Yield the lines of the table."""
    asked = [each for each in constants() if not names or any(name in f"{each.module}.{each.name}" for name in names)]
    kinds = list(dict.fromkeys(kind_of(each.module) for each in asked))
    tasks = [task._replace(kind=kind) for kind in kinds]
    for each in asked:
        of = task._replace(kind=kind_of(each.module), module=each.module, name=each.name)
        tasks += [of._replace(value=scaled(each.value, factor)) for factor in (0.5, 2.0)]
    if not names:
        yield PAGE.rstrip() + "\n"
    yield "| constant | value | at half | at double | meaning |"
    yield "|---|---|---|---|---|"
    with get_context("spawn").Pool(workers, maxtasksperchild=1) as pool:
        found = pool.imap(measured, tasks, chunksize=1)
        usual = {kind: next(found) for kind in kinds}
        for kind, one in usual.items():
            if isinstance(one, str):
                raise SystemExit(f"{kind}, with the constants as they are: {one}")
            yield f"| (as they are, {kind}) | | {_cell(kind, one, one)} | | |"
        for each in asked:
            kind = kind_of(each.module)
            cells = [_cell(kind, next(found), usual[kind]) for _ in range(2)]
            yield f"| {' | '.join((f'`{each.module[8:]}.{each.name}`', _short(each.value), *cells, each.meaning))} |"


def _cell(kind: str, found: Found | str, usual: Found | str) -> str:
    if isinstance(found, str) or isinstance(usual, str):
        return str(found)
    if kind == "nothing":
        return "-"
    if kind in ("faults", "chambers"):
        return f"{found.named} named, {found.false} others" + (f", {found.after:.2f} s" if found.after > 0.0 else "")
    ratio = math.exp(sum(math.log(a / b) for a, b in zip(found.errors, usual.errors, strict=True)) / len(found.errors))
    return f"{ratio:.3f}" + (f", {found.clearance:.3f}" if kind == "fields" else "")


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {each:g}" for key, each in value.items())
    return ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--trials", type=int, default=4)
    parser.add_argument("--duration", type=float, default=18.0)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    task = Task("", "", "", None, given.trials, given.duration)
    for line in lines(given.names, task, given.workers):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
