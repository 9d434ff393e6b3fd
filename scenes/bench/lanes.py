"""Whether a batch could be faster with several worms in the lanes of the processor's vectors.

    python -m scenes.bench.lanes --out DIR

prints a table of measured parts and bounds (`scenes.bench.lane_bound`), and writes it and a figure.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scenes.bench import lane_figure
from scenes.bench.lane_bound import LaneStudy, measure_lanes
from scenes.bench.machine import machine
from scenes.bench.tables import Cells, aligned, markdown_table
from scenes.language.errors import SceneError
from scenes.records import folder as folders
from scenes.records.drawing import save_figure
from scenes.records.files import write_bytes

BAR = 1.5
"""Throughput of a batch over that of single runs that is asked for."""


app = typer.Typer(add_completion=False)


@app.command()
def main(
    out: Annotated[Path, typer.Option(help="Folder for lanes.md and lanes.png.")],
    runs: Annotated[int, typer.Option(help="Worms; a multiple of 8.")] = 64,
    duration: Annotated[float, typer.Option(help="Simulated by each of them [s].")] = 10.0,
    repeats: Annotated[int, typer.Option(help="Of which the fastest counts.")] = 3,
    force: Annotated[bool, typer.Option(help="Write into a folder that has something in it.")] = False,
) -> None:
    """Measure the parts of a batch, and what it could gain with several worms in the lanes of the vectors."""
    try:
        with folders.prepared(out, "bench-lanes", force=force) as folder:
            study = measure_lanes(runs, duration, repeats)
            header, rows = table(study)
            title = f"# Worms in lanes\n\n{sentence(study)}\n\n{machine()['cpu']}, {machine()['date']}\n\n"
            write_bytes(folder / "lanes.md", (title + "\n".join(markdown_table(header, rows)) + "\n").encode())
            save_figure(lane_figure.draw(study, BAR), folder / "lanes.png")
    except SceneError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(error.exit_code) from error
    for line in (*aligned(header, rows), sentence(study)):
        typer.echo(line)


def table(study: LaneStudy) -> tuple[tuple[str, ...], list[Cells]]:
    """Return header and rows: a step as it is, and each bound [µs]."""
    header = ("scheme", "worms", *study.now, "step", "gain of a step", "of the batch")
    rows = [_row("as it is", 1, study.now, 1.0, study.throughput.gain)]
    rows += [_row(each.scheme, each.worms, each.us, each.step_gain, each.batch_gain) for each in study.bounds]
    return header, rows


def _row(scheme: str, worms: int, us: dict[str, float], *gains: float) -> Cells:
    times = (f"{value:.2f}" for value in (*us.values(), sum(us.values())))
    return (scheme, str(worms), *times, *(f"{gain:.2f}" for gain in gains))


def sentence(study: LaneStudy) -> str:
    """Return what the batch does now, what a step may cost, and how many iterations wait."""
    batch, alone, last = study.throughput, study.counts[1], study.counts[max(study.counts)]
    return (
        f"{batch.runs} worms of {batch.duration_s:g} s: batch {batch.batch_s:.2f} s, of which steps "
        f"{study.stepping_s:.2f} s, single runs {batch.single_s:.2f} s. For {BAR:g} times their throughput a step may "
        f"cost {study.allowed(BAR):.2f} of what it does. Alone a worm makes {alone.jacobians:.2f} Jacobians and "
        f"{alone.residuals:.2f} other residuals a step, in lock-step of {max(study.counts)} {last.jacobians:.2f} and "
        f"{last.residuals:.2f}."
    )


if __name__ == "__main__":
    app()
