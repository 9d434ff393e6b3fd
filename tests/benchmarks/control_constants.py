"""The constants of the controller at half and at double: what each of them is worth, as a table.

    python tests/benchmarks/control_constants.py [NAME ...] [--trials 8] [--faults 10] [--duration 25] [--workers 2]

Each constant of the modules of `MODULES` is scaled, alone, in a process of its own. Printed are its value, the errors
of `mpc` on trials of `worm3d bench control` over those with the constant as it is (geometric mean), and how many faults
of `closed_loop.py faults` are named within three waves, and how many are told of that nobody put in. NAME chooses
constants by a part of "module.NAME".
"""

from __future__ import annotations

import argparse
import ast
import importlib
import inspect
import math
import sys
from collections.abc import Iterator, Sequence
from itertools import count, islice
from multiprocessing import get_context
from typing import Any, NamedTuple

import closed_loop
import numpy as np

from scenes.models.control.reference import reference_of
from scenes.models.loading import load_scene
from scenes.running.runner import simulate
from scenes.studies.bench.control_error import error_of
from scenes.studies.bench.control_score import FLOOR
from scenes.studies.bench.control_trials import drawn

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
EXACT = ("SIZE", "ROCKING", "CRAB", "HEADING", "UNKNOWNS", "HARMONICS", "YIELDS", "YAW_BIAS", "ANY_WAY", "SIDE")
"""Names of what is counted or computed, and not chosen."""
SEED, FACTORS = 900, (0.5, 2.0)
LONG = ("heading", "stop_and_go", "speed_steps")
"""Classes of trials with steps that come late: they are too long."""


class Constant(NamedTuple):
    """A constant of a module."""

    module: str
    name: str
    value: Any
    meaning: str


class Task(NamedTuple):
    """A constant, if any, by a factor."""

    module: str
    name: str
    factor: float
    trials: int
    faults: int
    duration: float


class Found(NamedTuple):
    """Errors of the trials, faults that were named in time, and those that nobody put in."""

    errors: tuple[float, ...]
    named: int
    false: int


def constants() -> Iterator[Constant]:
    """Yield the constants of all modules, with the first sentence of what is said of each."""
    for name in MODULES:
        module = importlib.import_module(name)
        body = ast.parse(inspect.getsource(module)).body
        for node, after in zip(body, [*body[1:], None], strict=True):
            if not isinstance(node, ast.Assign):
                continue
            said = after.value.value if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) else ""
            targets = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets
            for target in targets:
                value = getattr(module, target.id, None) if isinstance(target, ast.Name) else None
                if _is_chosen(value) and target.id not in EXACT:  # type: ignore[attr-defined]
                    yield Constant(name, target.id, value, " ".join(str(said).split()).split(". ")[0].rstrip("."))  # type: ignore[attr-defined]


def _is_chosen(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_is_chosen, value.values()))
    if isinstance(value, tuple):
        return bool(value) and all(map(_is_chosen, value))
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value > 0


def scaled(value: Any, factor: float) -> Any:
    """Return a constant by a factor; whole numbers stay whole and above 0."""
    if isinstance(value, dict):
        return {key: scaled(each, factor) for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


def measured(task: Task) -> Found | str:
    """Return what comes of a task; the process is used for nothing else."""
    if task.module:
        known = getattr(sys.modules[task.module], task.name)
        for module in list(sys.modules.values()):
            if (
                getattr(module, "__name__", "").startswith(("control.", "scenes."))
                and vars(module).get(task.name) is known
            ):
                setattr(module, task.name, scaled(known, task.factor))
    try:
        short = (k for k in count() if drawn(SEED, k).kind not in LONG)
        errors = tuple(_error(k, task.duration) for k in islice(short, task.trials))
        told = [_told(SEED + k) for k in range(task.faults)]
    except Exception as error:  # a constant without which nothing goes
        return f"{type(error).__name__}: {error}"[:60]
    return Found(errors, sum(named for named, _ in told), sum(false for _, false in told))


def _error(number: int, duration: float) -> float:
    trial = drawn(SEED, number)
    scene = load_scene(trial.scene, [*trial.overrides[:-3], f"run.duration_s={duration}", *trial.overrides[-2:]])
    settings: Any = scene.settings
    error = error_of(simulate(scene), reference_of(settings), settings.worm.length_m)["error"]
    return 1.0 if error is None else max(error, FLOOR)


def _told(seed: int) -> tuple[int, int]:
    case = closed_loop.faults(seed, np.random.default_rng([33, seed]))
    run = simulate(load_scene(case.scene, [*case.overrides, f"seed={seed}", "controller.map=default"]))
    figures = closed_loop.named(case, None, run)
    others = [row for row in run.summary.faults if row["kind"] != case.kind]
    return sum(int(value) for name, value in figures.items() if name.endswith(" named")), len(others)


def lines(names: Sequence[str], task: Task, workers: int) -> Iterator[str]:
    """Yield the lines of the table."""
    asked = [each for each in constants() if not names or any(name in f"{each.module}.{each.name}" for name in names)]
    tasks = [task] + [task._replace(module=c.module, name=c.name, factor=f) for c in asked for f in FACTORS]
    twice = (f"{what} at {how}" for what in ("errors", "named", "others") for how in ("half", "double"))
    heads = ("constant", "value", *twice, "meaning")
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    with get_context("spawn").Pool(workers, maxtasksperchild=1) as pool:
        found = pool.imap(measured, tasks, chunksize=1)
        usual = next(found)
        if isinstance(usual, str):
            raise SystemExit(usual)
        yield f"| (as they are) | | 1 | 1 | {usual.named} | {usual.named} | {usual.false} | {usual.false} | |"
        for each in asked:
            both = [next(found) for _ in FACTORS]
            ratios = [_ratio(one, usual) for one in both]
            named, false = ([_count(one, name) for one in both] for name in ("named", "false"))
            cells = (f"`{each.module[8:]}.{each.name}`", _short(each.value), *ratios, *named, *false, each.meaning)
            yield f"| {' | '.join(cells)} |"


def _ratio(found: Found | str, usual: Found) -> str:
    if isinstance(found, str):
        return found
    logs = np.log(found.errors) - np.log(usual.errors)
    return f"{math.exp(float(logs.mean())):.2f}"


def _count(found: Found | str, name: str) -> str:
    return "-" if isinstance(found, str) else str(getattr(found, name))


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {each:g}" for key, each in value.items())
    return ", ".join(f"{each:g}" for each in value) if isinstance(value, tuple) else f"{value:g}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--trials", type=int, default=8)
    parser.add_argument("--faults", type=int, default=10)
    parser.add_argument("--duration", type=float, default=25.0)
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    task = Task("", "", 1.0, given.trials, given.faults, given.duration)
    for line in lines(given.names, task, given.workers):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
