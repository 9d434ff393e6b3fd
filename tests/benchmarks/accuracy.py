"""How far the time step puts a run off, scene by scene, and how honest error estimates are.

    python tests/benchmarks/accuracy.py [--quick] [--out PAGE.md]
    python tests/benchmarks/accuracy.py --random 100 [--seed 6]

Distance, turn and work of each scene are compared with those at a fine time step, also of runs that are asked for an
accuracy. This program wrote the tables of `.docs/evidence/accuracy.md` in some minutes. On rough ground every stone
decides, so that a run says little: there the tables have mean and standard deviation over starts that differ by a
millimetre, as the reference has.

`--random` makes runs, each with a worm, a ground, a gait and an accuracy (0.01 or 0.03) of its own, on the flat, on
slopes or in a bent pipe. The truth is a run that is allowed a 64th of the error in each step. A line for each run has
the error over the estimate for distance, heading and work (more than 2: missed). The last lines have the share of runs
within two estimates, at least 95 % of each, and the median of estimate over error. How errors are estimated was chosen
on the seeds 1 to 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from measuring import options, publish, say
from speed_measures import StoppedError

from scenes.language.errors import SceneError
from scenes.models.loading import load_scene
from scenes.models.worm.build import problem_of
from scenes.records.text import Cells, markdown_table
from scenes.running.packages import machine
from scenes.running.runner import simulate
from scenes.running.terminal import each
from worm3d import Result, Status
from worm3d.running import accuracy as runs
from worm3d.running.problem import Problem
from worm3d.running.run import Run
from worm3d.values.arrays import FloatArray

STEPS = (0.02, 0.01, 0.005, 0.002)
"""Time steps that are judged [s]."""
REFERENCE = 0.0002
"""Time step that they are judged by [s]."""

METRICS = {
    "distance_m": "Distance: reference [m], and differences [%]",
    "heading_change_deg": "Turn: reference, and differences [degrees]",
    "work_contract_J": "Work of contraction: reference [J], and differences [%]",
}

SAYS = (
    "Time steps against one of 0.2 ms, scene by scene; the last column is of `run.accuracy=0.01`, where gaits that "
    "feel decide every 10 ms. Where a cell has two numbers they are mean and standard deviation over 8 starts within "
    "1 mm of the scene's, of both time steps alike: less than two thirds of the second is no difference. Made by "
    "`python tests/benchmarks/accuracy.py`."
)


@dataclass(frozen=True)
class Case:
    """A scene with changes, and whether its ground is rough."""

    scene: str
    changes: tuple[str, ...] = ()
    rough: bool = False


AS_SHIPPED = (
    "circling inchworm larva_network optimised_robust optimised_speed phases pipe_reflex pipe_reflex_vertical shc "
    "sidewinding turn turn_planned"
)
"""Scenes that are judged as they are."""

CASES: Mapping[str, Case] = {
    "flat": Case("flat"),
    "flat, period 0.5 s": Case("flat", ("gait.period_s=0.5",)),
    "flat, little damping": Case("flat", ("worm.kelvin_voigt_time_s=0.005",)),
    "flat, hinges 30 deg": Case("flat", ("gait.hinge_deg=30",)),
    "flat, bias 0.5": Case("flat", ("gait.bias=0.5",)),
    "slope_5": Case("slope_5"),
    "flat, slope 9 deg": Case("flat", ("world.slope_deg=9",)),
    "slope_15": Case("slope_15"),
    "planar_case": Case("planar_case"),
    "pipe_straight": Case("pipe_straight"),
    "pipe_bend": Case("pipe_bend", ("run.duration_s=30",)),
    "pipe_narrowing": Case("pipe_narrowing", ("run.duration_s=30",)),
    "pipe_vertical": Case("pipe_vertical"),
    "slope_into_pipe": Case("slope_into_pipe"),
    "rubble": Case("rubble", rough=True),
    "mesh_tunnel": Case("mesh_tunnel", rough=True),
    **{each: Case(each) for each in AS_SHIPPED.split()},
}
QUICK = {f"{name}, 1 s": Case(name, ("run.duration_s=1",), rough=name == "rubble") for name in ("flat", "rubble")}
"""Cases of `--quick`."""


@dataclass(frozen=True)
class Found:
    """What a case came to: `METRICS` of each start at the fine time step, at each of `STEPS`, and with an accuracy."""

    name: str
    reference: FloatArray
    """Shape (starts, 3)."""
    coarse: FloatArray
    """Shape (columns, starts, 3)."""


def measure(cases: Mapping[str, Case]) -> list[Found]:
    """Run cases, by name.

    Raises
    ------
    StoppedError
        A run did not reach its end.
    """
    return list(each("accuracy", cases, lambda name: _found(name, cases[name]), "scene", quiet=False).values())


def _found(name: str, case: Case) -> Found:
    ways = [_stepped(dt) for dt in (REFERENCE, *STEPS)]
    ways.append((*_stepped(0.01), "run.integrator=bdf2", "run.accuracy=0.01"))
    places = starts(case)
    reference, *coarse = (np.array([_metrics(name, case, (*place, *way)) for place in places]) for way in ways)
    return Found(name, reference, np.array(coarse))


def _stepped(dt: float) -> tuple[str, ...]:
    """Return the changes of a scene by which it has a time step, and rows 20 ms apart."""
    return f"run.dt_s={dt}", f"run.record_every={round(0.02 / dt)}"


def starts(case: Case) -> list[tuple[str, ...]]:
    """Return the changes of a scene by which its runs start at different places: none where the ground is even."""
    if not case.rough:
        return [()]
    x, y = load_scene(case.scene, case.changes).settings.start.position_m
    moved = np.array([x, y]) + np.random.default_rng(7).uniform(-0.001, 0.001, (8, 2))
    return [(f"start.position_m={place}",) for place in moved.tolist()]


def _metrics(name: str, case: Case, changes: tuple[str, ...]) -> list[float]:
    record = simulate(load_scene(case.scene, (*case.changes, *changes)))
    if record.status != "done":
        raise StoppedError(f"bench: {name}, {', '.join(changes)}: {record.sentence}")
    return [np.nan if record.summary[name] is None else float(str(record.summary[name])) for name in METRICS]


def markdown(found: list[Found]) -> str:
    """Return the page."""
    lines = ["# What the time step changes", "", SAYS, ""]
    for title, header, rows in tables(found):
        lines += [f"## {title}", "", *markdown_table(header, rows), ""]
    about = machine()
    return "\n".join([*lines, f"{about['cpu']}, {about['system']}, {about['date']}."]) + "\n"


def tables(found: list[Found]) -> Iterator[tuple[str, Cells, list[Cells]]]:
    """Yield title, header and rows of each table."""
    header = ("scene", *(f"{1e3 * dt:g} ms" for dt in (REFERENCE, *STEPS)), "1 %")
    for metric, title in enumerate(METRICS.values()):
        yield title, header, [_cells(each, metric, relative="[%]" in title) for each in found]


def _cells(found: Found, metric: int, *, relative: bool) -> Cells:
    """Return the reference, and the differences from its mean, perhaps as a percentage."""
    reference = found.reference[:, metric]
    off = found.coarse[:, :, metric] - reference.mean()
    off = 100.0 * off / abs(reference.mean()) if relative else off
    return (found.name, _shown(reference, ".4g" if relative else ".1f"), *(_shown(each, "+.1f") for each in off))


def _shown(values: FloatArray, form: str) -> str:
    """Return a number, mean and standard deviation of several, or a dash for what has no value (a vertical heading)."""
    if np.isnan(values).any():
        return "-"
    mean = f"{values.mean():{form}}"
    mean = mean[1:] if float(mean) == 0.0 and mean[0] in "+-" else mean
    return mean if len(values) == 1 else f"{mean} ± {values.std(ddof=1):.1{form[-1]}}"


def drawn(rng: np.random.Generator) -> Problem:
    """Return a random problem that has a solution by its scene's checks; SceneError if it has none."""
    scene = str(rng.choice(["flat", "flat", "flat", "turn", "slope_15", "pipe_bend"]))
    keys: dict[str, Any] = {"run.duration_s": rng.choice([2, 3]), "run.record_every": 1, "run.dt_s": 0.01}
    keys["gait.amplitude"], keys["gait.period_s"] = rng.uniform(0.12, 0.3), 10 ** rng.uniform(-0.2, 0.5)
    if scene in ("flat", "turn"):
        keys |= {"worm.segments": rng.integers(4, 8), "worm.kelvin_voigt_time_s": 10 ** rng.uniform(-2.3, -1.2)}
        keys |= {f"friction.{way}": 10 ** rng.uniform(-1.5, -0.2) for way in ("forward", "backward", "lateral")}
        keys["friction.static_ratio"] = rng.uniform(1.0, 1.6)
    if scene == "flat":
        keys |= {"gait.wavelength": rng.uniform(0.6, 2.0), "gait.bias": rng.uniform(-0.7, 0.7)}
        keys |= {"gait.hinge_deg": rng.uniform(-40.0, 40.0), "world.slope_deg": rng.uniform(-8.0, 8.0)}
        keys["gait.direction"] = rng.choice(["direct", "retrograde"])
    loaded: Any = load_scene(scene, tuple(f"{key}={value}" for key, value in keys.items())).settings
    return replace(problem_of(loaded), accuracy=float(rng.choice([0.01, 0.03])))


def figures(result: Result) -> FloatArray:
    """Return distance [m], turn [rad] and work [J] of a run that reached its end, shape (3,)."""
    if result.status is not Status.DONE:
        raise StoppedError(result.stop.sentence)
    work = float(result.energy.work_contract.sum())
    return np.array([result.distance, result.heading[-1] - result.heading[0], work])


def judged(of: Problem) -> FloatArray:
    """Return error over estimate of each figure, shape (3,); NaN for the heading of a worm that keeps straight."""
    run = runs.begin(of)()
    found, estimate = figures(run), run.error_estimate
    assert estimate is not None
    truth = figures(Run(of, allowed=estimate.step_error / 64.0).finish())
    errors = np.abs(found - truth) / [estimate.distance, estimate.heading, estimate.work]
    straight = abs(truth[1]) < 1e-10  # but for rounding
    return np.where([False, straight, False], np.nan, errors)


def judge(seed: int, count: int) -> None:
    """Print the errors of random runs over their estimates."""
    names, found = ("distance", "heading", "work"), []
    for case in range(count):
        try:
            found.append(judged(drawn(np.random.default_rng([seed, case]))))
        except (SceneError, ValueError) as error:
            say(f"{case:4d} {type(error).__name__}: {' '.join(str(error).split())[:120]}")
            continue
        say(f"{case:4d} " + "  ".join(f"{name} {ratio:7.3f}" for name, ratio in zip(names, found[-1], strict=True)))
    for name, ratios in zip(names, np.array(found).T, strict=True):
        known = ratios[~np.isnan(ratios)]
        within = f"within two estimates {np.sum(known <= 2.0)} of {len(known)} ({np.mean(known <= 2.0):.1%})"
        say(f"{name:9} {within}, largest {known.max():.2f}, median of estimate over error {np.median(1 / known):.1f}")


def main() -> None:
    """Print what is asked for."""
    given = options(__doc__, quick=False, out=Path("runs", "accuracy.md"), random=0, seed=6)
    if given.random:
        judge(given.seed, given.random)
    else:
        publish(markdown(measure(QUICK if given.quick else CASES)), given.out)


if __name__ == "__main__":
    main()
