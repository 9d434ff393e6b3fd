"""How far the time step puts a run off, scene by scene.

    python tests/benchmarks/accuracy.py [--quick] [--out tests/benchmarks/accuracy.md]

Distance, turn and work of each scene are compared with those at a fine time step, also of runs that are asked for an
accuracy; `accuracy.md` beside this file is a page that this program wrote in some minutes. On rough ground every stone
decides, so that a run says little: there the tables have mean and standard deviation over starts that differ by a
millimetre, as the reference has.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pages
from speed_measures import StoppedError

from scenes.models.loading import load_scene
from scenes.records.text import Cells, markdown_table
from scenes.running.packages import machine
from scenes.running.runner import simulate
from scenes.running.terminal import each
from worm3d.values.arrays import FloatArray

STEPS = (0.02, 0.01, 0.005, 0.002)
"""Time steps that are judged [s]."""
REFERENCE = 0.0002
"""Time step that they are judged by [s]."""
ASKED, DECIDES = 0.01, 0.01
"""Accuracy that is asked for in the last column, and the time between decisions of gaits that feel there [s]."""
ROW = 0.02
"""Time between two rows of a record [s], a multiple of every time step."""
STARTS, SHIFT, SEED = 8, 0.001, 7
"""Number of starts on rough ground, their largest distance from the scene's along each axis [m], and the seed."""

METRICS = ("distance_m", "heading_change_deg", "work_contract_J")

SAYS = (
    f"Time steps against one of {1e3 * REFERENCE:g} ms, scene by scene; the last column is of `run.accuracy={ASKED}`, "
    f"where gaits that feel decide every {1e3 * DECIDES:g} ms. Where a cell has two numbers they are mean and standard "
    f"deviation over {STARTS} starts within {1e3 * SHIFT:g} mm of the scene's, of both time steps alike: less than two "
    "thirds of the second is no difference. Made by `python tests/benchmarks/accuracy.py`."
)

SPREADS = {".4g": ".1g", ".1f": ".1f", "+.1f": ".1f"}
"""How a standard deviation is written, by how the mean is."""


@dataclass(frozen=True)
class Case:
    """A scene with changes, and whether its ground is rough."""

    scene: str
    changes: tuple[str, ...] = ()
    rough: bool = False


AS_SHIPPED = (
    *("circling", "inchworm", "larva_network", "phases", "pipe_reflex", "pipe_reflex_vertical", "shc", "sidewinding"),
    *("turn", "turn_planned"),
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
    **{each: Case(each) for each in AS_SHIPPED},
}
QUICK = {f"{name}, 1 s": Case(name, ("run.duration_s=1",), rough=name == "rubble") for name in ("flat", "rubble")}
"""Cases of `--quick`."""


@dataclass(frozen=True)
class Found:
    """What a case came to: `METRICS` of each start at the fine time step, at each of `STEPS`, and with `ASKED`."""

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
    of, places = partial(_metrics, name, case), starts(case)
    ways = [*map(_stepped, (REFERENCE, *STEPS)), (*_stepped(DECIDES), "run.integrator=bdf2", f"run.accuracy={ASKED}")]
    reference, *coarse = (np.array([of((*place, *way)) for place in places]) for way in ways)
    return Found(name, reference, np.array(coarse))


def _stepped(dt: float) -> tuple[str, ...]:
    """Return the changes of a scene by which it has a time step."""
    return f"run.dt_s={dt}", f"run.record_every={round(ROW / dt)}"


def starts(case: Case) -> list[tuple[str, ...]]:
    """Return the changes of a scene by which its runs start at different places: none where the ground is even."""
    if not case.rough:
        return [()]
    x, y = load_scene(case.scene, case.changes).settings.start.position_m
    moved = np.array([x, y]) + np.random.default_rng(SEED).uniform(-SHIFT, SHIFT, (STARTS, 2))
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
    header = ("scene", f"{1e3 * REFERENCE:g} ms", *(f"{1e3 * dt:g} ms" for dt in STEPS), f"{100 * ASKED:g} %")
    titles = ("Distance: reference [m], and differences [%]", "Turn: reference, and differences [degrees]")
    for metric, title in enumerate((*titles, "Work of contraction: reference [J], and differences [%]")):
        yield title, header, [_cells(each, metric, relative=metric != 1) for each in found]


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
    return mean if len(values) == 1 else f"{mean} ± {values.std(ddof=1):{SPREADS[form]}}"


if __name__ == "__main__":
    given = pages.options(__doc__, "accuracy.md")
    pages.publish(markdown(measure(QUICK if given.quick else CASES)), given.out)
