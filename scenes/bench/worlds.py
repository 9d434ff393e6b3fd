"""What a step costs in a world, over what it costs on a plane.

    python -m scenes.bench.worlds --out DIR

prints a table of times and of Newton's iterations, and writes it and a figure. On a plane the default worm is exactly
symmetric: its left and right contacts change together. In a crooked pipe they change one by one, and so they do where
the worm turns on the plane, which is measured beside.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import trimesh
import typer
from matplotlib.figure import Figure

import worm3d
from control.gaits import TravellingWave
from scenes.bench.crawl import StoppedError, us_per_step
from scenes.bench.machine import machine
from scenes.bench.tables import Cells, aligned, markdown_table
from scenes.language.errors import SceneError
from scenes.records import folder as folders
from scenes.records.drawing import save_figure
from scenes.records.files import write_bytes
from worm3d import Bend, Centreline, Heightfield, Mesh, Pipe, Plane, Profile, Result, Status, Straight, Worm
from worm3d.worlds import World

RADIUS = 0.12
"""Of the pipes [m]."""
BIAS = 0.05
"""Of the gait of the worm that turns on the plane."""
BARS: Mapping[str, float] = {"pipe": 1.5, "mesh": 2.0}
"""Greatest time of a step over the plane's that is asked for, by the first word of a world's name."""
HEADER = ("world", "us/step", "over the plane", "bar", "Jacobians", "other residuals", "us an iteration")

app = typer.Typer(add_completion=False)


@dataclass(frozen=True)
class Visit:
    """What a step cost in a world.

    Attributes
    ----------
    name : str
    us_per_step : float
        Of the fastest run [µs].
    jacobians, residuals : float
        Evaluations with and without a new Jacobian, a step.
    """

    name: str
    us_per_step: float
    jacobians: float
    residuals: float

    @property
    def us_per_iteration(self) -> float:
        """Time of a step over its evaluations [µs]."""
        return self.us_per_step / (self.jacobians + self.residuals)

    @property
    def bar(self) -> float | None:
        """What is asked for, or None."""
        return BARS.get(self.name.split()[0])


@app.command()
def main(
    out: Annotated[Path, typer.Option(help="Folder for worlds.md and worlds.png.")],
    duration: Annotated[float, typer.Option(help="Simulated in each world [s].")] = 8.0,
    repeats: Annotated[int, typer.Option(help="Of which the fastest counts.")] = 20,
    force: Annotated[bool, typer.Option(help="Write into a folder that has something in it.")] = False,
) -> None:
    """Measure the default worm's step in worlds of all kinds."""
    try:
        with folders.prepared(out, "bench-worlds", force=force) as folder:
            visits = measure_worlds(duration, repeats)
            rows = [_cells(visit, visits[0]) for visit in visits]
            title = f"# A step in worlds\n\n{machine()['cpu']}, {machine()['date']}\n\n"
            write_bytes(folder / "worlds.md", (title + "\n".join(markdown_table(HEADER, rows)) + "\n").encode())
            save_figure(draw(visits), folder / "worlds.png")
    except SceneError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(error.exit_code) from error
    for line in aligned(HEADER, rows):
        typer.echo(line)


def worlds(folder: Path) -> dict[str, World]:
    """Return what is visited, by name; the mesh is written into a folder."""
    box = trimesh.creation.box((3.0, 1.5, 0.2))
    box.apply_translation((1.0, 0.0, -0.1))
    (folder / "box.stl").write_bytes(box.export(file_type="stl"))
    along = np.linspace(0.0, 1.0, 7)
    snake = np.column_stack([4.0 * along, 0.5 * np.sin(4.0 * along), 0.3 * along])
    narrowing = Profile([0.0, 0.8, 1.0, 3.0], [RADIUS, RADIUS, 0.8 * RADIUS, 0.8 * RADIUS])
    level = np.zeros((120, 60))
    return {
        "plane": Plane(),
        "plane, turning": Plane(),
        "pipe straight": Pipe(Centreline.of([Straight(3.0)]), RADIUS),
        "pipe narrowing": Pipe(Centreline.of([Straight(3.0)]), narrowing),
        "pipe bend 0.48 m": Pipe(Centreline.of([Straight(0.3), Bend(np.pi / 2, 0.48), Straight(3.0)]), RADIUS),
        "pipe bend 2 m": Pipe(Centreline.of([Straight(0.3), Bend(np.pi / 2, 2.0), Straight(3.0)]), RADIUS),
        "pipe spline": Pipe(Centreline.through(snake), RADIUS),
        "heightfield level": Heightfield(level, 0.05, origin=(-1.5, -1.5)),
        "mesh box": Mesh(folder / "box.stl", units="m"),
    }


def measure_worlds(duration: float, repeats: int) -> list[Visit]:
    """Measure all in turns, after a run of each that warms up; the plane comes first.

    Raises
    ------
    StoppedError
        A run did not reach its end.
    """
    best: dict[str, Result] = {}
    with tempfile.TemporaryDirectory() as folder:
        places = worlds(Path(folder))
        for _ in range(repeats + 1):
            for name, world in places.items():
                result = _crawled(name, world, duration)
                if name not in best or us_per_step(result) < us_per_step(best[name]):
                    best[name] = result
    return [_visit(name, result) for name, result in best.items()]


def _crawled(name: str, world: World, duration: float) -> Result:
    gait = TravellingWave(bias=BIAS if name.endswith("turning") else 0.0)
    result = worm3d.simulate(Worm(), world, actuation=gait, duration=duration)
    if result.status is not Status.DONE:
        raise StoppedError(f"bench: {name}: {result.stop.sentence}")
    return result


def _visit(name: str, result: Result) -> Visit:
    jacobians, residuals = (float(x.mean()) for x in (result.newton_iterations, result.gradient_evaluations))
    return Visit(name, us_per_step(result), jacobians, residuals)


def _cells(visit: Visit, plane: Visit) -> Cells:
    ratio = f"{visit.us_per_step / plane.us_per_step:.2f}"
    bar = "" if visit.bar is None else f"{visit.bar:g}"
    counts = (f"{visit.jacobians:.2f}", f"{visit.residuals:.2f}", f"{visit.us_per_iteration:.2f}")
    return (visit.name, f"{visit.us_per_step:.1f}", ratio, bar, *counts)


def draw(visits: list[Visit]) -> Figure:
    """Return the figure: times over the plane's, the bars, and iterations over the plane's."""
    plane, places = visits[0], np.arange(len(visits))
    figure = Figure(figsize=(9.0, 4.5), layout="constrained", dpi=120)
    axes = figure.subplots()
    times = axes.bar(places, [each.us_per_step / plane.us_per_step for each in visits], 0.6, label="time of a step")
    axes.bar_label(times, fmt="%.2f", label_type="center", color="white", fontsize=9)
    counts = [(each.jacobians + each.residuals) / (plane.jacobians + plane.residuals) for each in visits]
    axes.plot(places, counts, "kD", ms=5, label="iterations of Newton")
    asked = [(place, each.bar) for place, each in zip(places, visits, strict=True) if each.bar is not None]
    axes.hlines([bar for _, bar in asked], [k - 0.4 for k, _ in asked], [k + 0.4 for k, _ in asked], "C3", label="bar")
    axes.set_xticks(places, [each.name.replace(" ", "\n", 1) for each in visits], fontsize=8)
    axes.set_ylabel("over those on the plane")
    axes.set_title("A step of the default worm in worlds")
    axes.set_ylim(0.0, 1.15 * max(2.0, *axes.get_ylim()))
    axes.legend(loc="upper left", fontsize=8, ncols=3)
    return figure


if __name__ == "__main__":
    app()
