"""`worm3d law`: fit a segment law to a table of states or to a measurement, and write its file and a figure."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import typer

from scenes.language.errors import SceneError
from scenes.records.folder import made, require_free, write_bytes
from scenes.records.text import Column, json_bytes
from scenes.running.report import Block, Items, Table, terminal_lines
from scenes.running.terminal import counted, progress
from scenes.studies.law import table as tables
from scenes.studies.law.bench import Cycle, Way
from scenes.studies.law.law import BAND, FITS, Law, content, domain, errors, make
from scenes.studies.law.prepared import prepared
from worm3d.values.arrays import FloatArray

FORCE_BAR, BAND_BAR, RADIUS_BAR_M, VOLUME_BAR = 0.01, 0.03, 3e-4, 0.01
"""Errors on held-out states above which a warning is printed: relative errors of all forces and of the forces in the
working band, the error of the radius [m], and the relative error of the volume."""


def run(
    path: Path,
    out: Path,
    renamed: Sequence[str],
    given: Sequence[str],
    *,
    seed: int,
    force: bool,
    quiet: bool,
) -> int:
    """Fit a law to the table `path`, write the file `out` and a figure, print the report, and return the exit code.

    Raises
    ------
    SceneError
        As in `table.load`, `prepared` and `make`, or a file exists.
    DiscError
        A file cannot be read or written.
    """
    if out.suffix != ".json":
        raise SceneError(f"--out: got '{out}', must be a file ending in .json")
    picture = out.with_suffix(".png")
    require_free([out, picture], path, force=force)
    try:
        with progress(f"law of {path.name}", FITS, quiet=quiet, what="fit") as show:
            law = make(prepared(tables.load(path, renamed, given)), seed, show)
    except SceneError as error:
        raise type(error)(*(line if str(path) in line else f"{path}: {line}" for line in error.lines)) from None
    made(out.parent)
    write_bytes(out, json_bytes(content(law)))
    _draw(law, path, picture)
    for warning in warnings(law):
        typer.echo(f"warning: {warning}", err=True)
    if not quiet:
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
        for line in terminal_lines(said(law, path), width):
            typer.echo(line)
        typer.echo(f"Written: {out}, {picture}")
    return 0


def _draw(law: Law, path: Path, picture: Path) -> None:
    from scenes.running.drawing import save_figure
    from scenes.studies.law import figure  # imports matplotlib

    cycle = law.prepared.cycle
    model = None if cycle is None else cycle.predicted(_elastic(law, cycle))
    save_figure(figure.draw(law, f"Segment law of {path.name}", model), picture)


ERROR_COLUMNS = {
    "states": Column("states"),
    "force rms [N]": Column("force_rms_N", ".3g"),
    "over rms force [%]": Column("force_rms_relative", ".2f", 100.0),
    "peak [N]": Column("force_peak_N", ".3g"),
    "in the band [N]": Column("force_band_rms_N", ".3g"),
    "over rms in the band [%]": Column("force_band_rms_relative", ".2f", 100.0),
    "radius rms [mm]": Column("radius_rms_m", ".3g", 1e3),
    "volume rms [%]": Column("volume_rms_relative", ".2f", 100.0, none="-"),
}
WAY_COLUMNS = {
    "way": Column("number"),
    "rows": Column("use"),
    "count": Column("rows"),
    "rms over peak [%]": Column("error", ".2f", 100.0),
}
"""Columns of the tables that are printed."""


def said(law: Law, path: Path) -> list[Block]:
    """Return the report."""
    table, states = law.prepared.table, law.states
    left = "".join(f", {counted(count, 'row')} left out for {reason}" for reason, count in table.left_out.items())
    found = {"held out": law.errors(), "fitted": errors(law.fit, states, states)}
    rows = [SimpleNamespace(states=name, **each) for name, each in found.items()]
    blocks: list[Block] = [
        f"{path}: {counted(len(states), 'state')}{left}",
        Table.of(ERROR_COLUMNS, rows),
        Items([*_sentences(law), *law.prepared.notes]),
    ]
    if (cycle := law.prepared.cycle) is not None:
        blocks += [*_friction(law, cycle)]
    return blocks


def _sentences(law: Law) -> Iterable[str]:
    """Yield what a reader of the report needs to know about the law."""
    band = BAND * float(np.abs(law.states.force).max())
    (low, high), most = domain(law.fit, law.states)
    spread, free = law.spread(), law.fit.free
    yield f"The working band has forces below {band:.3g} N, {BAND:.0%} of the greatest force."
    yield (
        f"Domain: lengths from {1e3 * low:.4g} to {1e3 * high:.4g} mm, contractions from 0 to {most:.3f}, where the "
        f"standard deviation of the {len(law.members) + 1} laws is at most {spread['force_N']:.2g} N, or "
        f"{spread['force_share']:.0%} of a large force, and {1e3 * spread['radius_m']:.2g} mm."
    )
    yield (
        "The law is fitted to all states. The errors at held-out states are those of a law that is fitted in the same "
        "way to the other states."
    )
    if free.lengthens:
        yield (
            "The input lengthens the segment. The contraction is counted from the free length at the greatest input, "
            f"{1e3 * free.rest_length:.4g} mm."
        )
    if law.moment_error is None:
        yield "The table has no bent states. The bending stiffness follows from the two chambers only."
    else:
        count = counted(len(law.prepared.bent), "bent state")
        yield f"The moments of {count} have an rms error of {law.moment_error:.1%} of their rms."
    yield f"The chambers are {1e3 * law.chamber_offset:.3g} mm from the axis."
    if stiffness := law.prepared.table.facts.get("contact_stiffness_N_m"):
        yield f"The wall yields to the ground. As a key of a scene: friction.contact_stiffness_N_m = {stiffness:.3g}"


def _elastic(law: Law, cycle: Cycle) -> FloatArray:
    """Return the elastic force of the law as coefficients of the record's spline, shape (L, coefficients) [N]."""
    length = np.linspace(cycle.spline.low, cycle.spline.high, 200)
    basis = cycle.spline.matrix(length)
    forces = [law.fit.force(length, np.full(len(length), level)) for level in cycle.record.inputs]
    return np.array([np.linalg.lstsq(basis, force / cycle.record.lever(length), rcond=None)[0] for force in forces])


def _friction(law: Law, cycle: Cycle) -> Iterable[Block]:
    ways: list[Way] = cycle.errors(_elastic(law, cycle))
    yield "The law and the friction of the joints, against the measured force:"
    yield Table.of(WAY_COLUMNS, ways)
    if len(cycle.record.cycles) == 1:
        yield "The record has one cycle. Every fifth row was held out, no other cycle can be compared."
    yield f"The friction is at most {cycle.half_width:.3g} N along the segment. As keys of a scene:"
    yield from cycle.scene_keys()


def warnings(law: Law) -> Iterable[str]:
    """Yield the errors on held-out states that are above the bars."""
    found = law.errors()
    bars = {
        "force_rms_relative": ("all forces", FORCE_BAR, 100.0, "%"),
        "force_band_rms_relative": ("forces in the working band", BAND_BAR, 100.0, "%"),
        "radius_rms_m": ("radii", RADIUS_BAR_M, 1e3, "mm"),
        "volume_rms_relative": ("volumes", VOLUME_BAR, 100.0, "%"),
    }
    for name, (what, bar, scale, unit) in bars.items():
        value = found[name]
        if value is not None and value > bar:
            yield (
                f"the rms error of {what} is {scale * value:.2g} {unit} on held-out states, should be at most "
                f"{scale * bar:.2g} {unit}; add states, or measure with less noise"
            )
