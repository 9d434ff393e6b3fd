"""What a step costs in a world over what it costs on a plane.

    python tests/benchmarks/worlds.py [--quick] [--out PAGE.md]

On a plane the default worm is exactly symmetric: its left and right contacts change together. In a crooked pipe they
change one by one, and so they do where the worm turns on the plane, which is measured beside.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from measuring import options, publish
from speed_measures import StoppedError, us_per_step

import worm3d
from control.gaits import TravellingWave
from scenes.records.text import Column, markdown_table, table
from scenes.running.packages import machine
from scenes.running.terminal import each
from worm3d import Bend, Centreline, Heightfield, Mesh, Pipe, Plane, Profile, Result, Status, Straight, Worm
from worm3d.worlds import World

BARS: Mapping[str, float] = {"pipe": 1.5, "mesh": 2.0}
"""Greatest time of a step over the plane's that is asked for, by the first word of a world's name."""
COLUMNS = {
    "world": Column("name"),
    "us/step": Column("us_per_step", ".1f"),
    "over the plane": Column("over_plane", ".2f"),
    "bar": Column("bar", "g"),
    "Jacobians": Column("jacobians", ".2f"),
    "other residuals": Column("residuals", ".2f"),
    "us an iteration": Column("us_per_iteration", ".2f"),
}


@dataclass(frozen=True)
class Visit:
    """Cost of a step in a world, in the fastest run."""

    name: str
    us_per_step: float
    over_plane: float
    jacobians: float
    """Evaluations with a new Jacobian, a step."""
    residuals: float
    """Evaluations without one, a step."""

    @property
    def us_per_iteration(self) -> float:
        """Time of a step over its evaluations [µs]."""
        return self.us_per_step / (self.jacobians + self.residuals)

    @property
    def bar(self) -> float | None:
        """Greatest time over the plane's that is asked for."""
        return BARS.get(self.name.split()[0])


def worlds(folder: Path) -> dict[str, World]:
    """Return what is visited, by name; the mesh is written into a folder."""
    box = trimesh.creation.box((3.0, 1.5, 0.2))
    box.apply_translation((1.0, 0.0, -0.1))
    (folder / "box.stl").write_bytes(box.export(file_type="stl"))
    radius, along = 0.12, np.linspace(0.0, 1.0, 7)
    snake = np.column_stack([4.0 * along, 0.5 * np.sin(4.0 * along), 0.3 * along])
    narrowing = Profile([0.0, 0.8, 1.0, 3.0], [radius, radius, 0.8 * radius, 0.8 * radius])
    return {
        "plane": Plane(),
        "plane, turning": Plane(),
        "pipe straight": Pipe(Centreline.of([Straight(3.0)]), radius),
        "pipe narrowing": Pipe(Centreline.of([Straight(3.0)]), narrowing),
        "pipe bend 0.48 m": Pipe(Centreline.of([Straight(0.3), Bend(np.pi / 2, 0.48), Straight(3.0)]), radius),
        "pipe bend 2 m": Pipe(Centreline.of([Straight(0.3), Bend(np.pi / 2, 2.0), Straight(3.0)]), radius),
        "pipe spline": Pipe(Centreline.through(snake), radius),
        "heightfield level": Heightfield(np.zeros((120, 60)), 0.05, origin=(-1.5, -1.5)),
        "mesh box": Mesh(folder / "box.stl", units="m"),
    }


def measure_worlds(duration: float, repeats: int) -> list[Visit]:
    """Measure all in turns, after a run of each that warms up; the plane comes first.

    Parameters
    ----------
    duration : float
        Simulated time in each world [s].
    repeats : int
        Number of runs there, of which the fastest counts.

    Raises
    ------
    StoppedError
        A run did not reach its end.
    """
    best: dict[str, Result] = {}
    with tempfile.TemporaryDirectory() as folder:
        go = partial(_visit_all, worlds(Path(folder)), duration, best)
        each("worlds", range(repeats + 1), go, "round", quiet=False)
    plane = us_per_step(best["plane"])
    return [_visit(name, result, plane) for name, result in best.items()]


def _visit_all(places: Mapping[str, World], duration: float, best: dict[str, Result], number: int) -> None:
    """Run in each world once, and keep the runs that are the fastest so far."""
    for name, world in places.items():
        result = _crawled(name, world, duration)
        best[name] = min(best.get(name, result), result, key=us_per_step)


def _crawled(name: str, world: World, duration: float) -> Result:
    gait = TravellingWave(bias=0.05 if name.endswith("turning") else 0.0)
    result = worm3d.simulate(Worm(), world, actuation=gait, duration=duration)
    if result.status is not Status.DONE:
        raise StoppedError(f"bench: {name}: {result.stop.sentence}")
    return result


def _visit(name: str, result: Result, plane: float) -> Visit:
    jacobians, residuals = (float(x.mean()) for x in (result.newton_iterations, result.gradient_evaluations))
    return Visit(name, us_per_step(result), us_per_step(result) / plane, jacobians, residuals)


def markdown(visits: list[Visit]) -> str:
    """Return the page."""
    about = machine()
    lines = ["# A step in worlds", "", f"{about['cpu']}, {about['date']}", ""]
    return "\n".join([*lines, *markdown_table(*table(COLUMNS, visits))]) + "\n"


if __name__ == "__main__":
    given = options(__doc__, quick=False, out=Path("runs", "worlds.md"))
    publish(markdown(measure_worlds(0.5, 2) if given.quick else measure_worlds(8.0, 20)), given.out)
