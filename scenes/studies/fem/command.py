"""`worm3d fem`: compute the equilibria of a soft segment by finite elements, and write table and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from time import perf_counter

import numpy as np
import typer

from scenes.language.errors import MissingPartError, SceneError
from scenes.records.folder import disc_errors, made, written_whole
from scenes.running.drawing import save_figure
from scenes.running.terminal import counted, progress
from worm3d.fem.description import Segment, parse
from worm3d.values.arrays import FloatArray

try:
    from worm3d.fem import pictures, table
    from worm3d.fem.axisymmetric import Wall
    from worm3d.fem.bending import BentState, QuarterModel, bent_states, pressed_states, spread, with_bends
    from worm3d.fem.sweep import CHECKED_STATES, FREE_STATES, Progress, mesh_error, sweep
except ImportError as error:
    raise MissingPartError(str(error)) from error

DATA = Path(__file__).parents[2] / "data"
"""Folder of the descriptions that ship with the program."""
QUICK_STATES, QUICK_MESH = 25, (10, 1)
"""States and elements of --quick, for a first look. The force of the shipped barrel has an error of about 0.2 %."""

BENT_FORCES = -0.03, 0.08
"""Range of the force of the straight states that are bent, as shares of the greatest force: states in which a segment
works. States that are compressed more crumple when they bend, and their continuation takes ten times as long."""

PRESSED_MESH = 8, 6
"""Elements along half of the segment and around half of the circumference for pressed states. The compliance of the
shipped barrel differs by at most 3 % from the result of 18 x 12 elements, which takes ten times as long."""

MOST_ALONG, MOST_ACROSS = 80, 4
"""Largest mesh. The mesh error takes four times as many elements, and the test of stability the cube of the time."""


@dataclass(frozen=True)
class Options:
    """Options of the command."""

    states: int
    """Number of stable states."""
    mesh: tuple[int, int]
    """Elements along half of the segment and through the wall."""
    bending: int
    """Number of states with bent plates."""
    patch: int
    """Number of straight states that flat ground presses."""
    quick: bool
    force: bool
    quiet: bool


def run(segment: str, out: Path, options: Options) -> int:
    """Compute the table of a segment, write it and its pictures, and return the exit code.

    Raises
    ------
    SceneError
        The description is wrong, the file exists, or too few states are stable.
    """
    if options.quick:
        options = replace(options, states=min(options.states, QUICK_STATES), mesh=QUICK_MESH)
    if out.exists() and not options.force:
        raise SceneError(f"{out} exists: choose another name, or replace it with --force")
    made(out.parent)
    described, began = load(segment), perf_counter()
    try:
        result = _swept(described, options)
    except ValueError as wrong:
        raise SceneError(f"{segment}: {wrong}") from wrong
    found_error = _checked(described, result, options)
    straight = _working(result)
    bent = _bent(described, straight, options)
    free = [(state.length, state.input) for state in result.states[1:FREE_STATES] if state.stable]
    model, pressed = _pressed(described, free, options)
    rows = {
        name: np.append(column, [row[name] for row in bent]) for name, column in table.columns(result.states).items()
    }
    rows |= table.pressed(pressed)
    written = {"shapes": pictures.shapes(result.states), "states": pictures.states(result.states)}
    if model is not None and pressed:
        written["patch"] = pictures.patch(model, *pressed[-1])
    _write(out, described, result, rows, len(bent), options, found_error)
    for name, figure in written.items():
        save_figure(figure, picture_path(out, name))
    if not options.quiet:
        _report(out, result, found_error, perf_counter() - began, list(written))
        if options.bending:
            typer.echo(f"{len(bent)} of {counted(options.bending, 'bent state')} found")
        for sentence in _compliance(rows):
            typer.echo(sentence)
    return 0


def mesh_of(text: str) -> tuple[int, int]:
    """Return the numbers of elements of a text such as `20x2`.

    Raises
    ------
    SceneError
        The text is not of this form, or a number is too small or too large.
    """
    along, cross, across = text.partition("x")
    numbers = [int(part) if part.isdecimal() and len(part) < 4 else 0 for part in (along, across)]
    if not (cross and 4 <= numbers[0] <= MOST_ALONG and 1 <= numbers[1] <= MOST_ACROSS):
        raise SceneError(
            f"--mesh: got '{text}', must be two numbers such as 20x2: 4 to {MOST_ALONG} elements along half of the "
            f"segment, and 1 to {MOST_ACROSS} through the wall"
        )
    return numbers[0], numbers[1]


def load(segment: str) -> Segment:
    """Return a segment from a TOML file, or from the name of a shipped description.

    Raises
    ------
    SceneError
        There is no such description, or the description is wrong.
    """
    shipped = {path.stem: path for path in sorted(DATA.glob("*.toml"))}
    path = shipped.get(segment, Path(segment))
    if not path.is_file():
        raise SceneError(f"there is no segment '{segment}': must be a TOML file, or one of {', '.join(shipped)}")
    try:
        return parse(path.read_text(encoding="utf-8"))
    except ValueError as wrong:
        raise SceneError(f"{path.name}: {wrong}") from wrong


def _swept(segment: Segment, options: Options) -> Progress:
    with progress("finite elements", options.states, quiet=options.quiet, what="state") as show:
        for result in sweep(Wall(segment, *options.mesh), options.states):
            show(result.stable)
    return result


def _checked(segment: Segment, result: Progress, options: Options) -> float:
    along, across = options.mesh
    with progress("mesh error", CHECKED_STATES, quiet=options.quiet, what="state") as show:
        return mesh_error(result.states, Wall(segment, 2 * along, 2 * across), show)


def _working(result: Progress) -> list[tuple[float, float]]:
    """Return length and input of the straight states in which a segment works."""
    stable = [state for state in result.states if state.stable]
    peak = max(abs(state.force) for state in stable)
    low, high = (share * peak for share in BENT_FORCES)
    return [(state.length, state.input) for state in stable if low <= state.force <= high and state.input > 0.0]


def _bent(segment: Segment, straight: list[tuple[float, float]], options: Options) -> list[dict[str, float]]:
    """Return the rows of states with bent plates; states without an equilibrium are left out."""
    if not (options.bending and straight):
        return []
    with progress("bent states", options.bending, quiet=options.quiet, what="state") as show:
        done = count(1)
        return bent_states(segment, with_bends(straight, options.bending), report=lambda _: show(next(done)))


def _pressed(
    segment: Segment, straight: list[tuple[float, float]], options: Options
) -> tuple[QuarterModel | None, list[tuple[float, BentState]]]:
    """Return the model and the states of `pressed_states`; None and no state where nothing is pressed."""
    if not (options.patch and straight):
        return None, []
    gas = segment.load.input == "pressure_Pa"
    chosen = [(length, value * gas) for length, value in spread(straight, options.patch)]
    with progress("pressed states", options.patch, quiet=options.quiet, what="state") as show:
        done, model = count(1), QuarterModel(segment, *PRESSED_MESH, pressed=True)
        return model, pressed_states(model, chosen, lambda _: show(next(done)))


def _compliance(rows: Mapping[str, FloatArray]) -> Iterable[str]:
    """Yield sentences about the compliance under flat ground."""
    if (point := table.contact_stiffness(rows)) is None:
        return
    length, pressure, way, load = (rows[name] for name in rows if name.startswith(table.PRESSED))
    for state in sorted(set(zip(pressure, length, strict=True))):
        own = (pressure == state[0]) & (length == state[1])
        ends = [f"{1e3 * w / f:.3g} mm/N at {f:.3g} N" for w, f in zip(way[own], load[own], strict=True)]
        yield f"compliance at {state[0] / 1e3:.2f} kPa, {1e3 * state[1]:.1f} mm: {ends[0]}, {ends[-1]}"
    yield (
        f"median stiffness of a segment on flat ground: {table.POINTS_OF_A_SEGMENT * point:.3g} N/m, on "
        f"{table.POINTS_OF_A_SEGMENT} contact points: friction.contact_stiffness_N_m = {point:.3g}"
    )


def _write(
    out: Path,
    segment: Segment,
    result: Progress,
    rows: Mapping[str, FloatArray],
    bent: int,
    options: Options,
    error: float,
) -> None:
    along, across = options.mesh
    source = (
        f"worm3d fem: axisymmetric finite elements (Q2/Q1), {along} x {across} elements of half of the segment, "
        f"farthest-point states; {counted(len(result.stopped), 'state')} not reached; "
        f"{counted(bent, 'bent state')} of a quarter model"
    )
    with written_whole(out) as part, disc_errors(out):
        table.write(part, segment, rows, source, error)


def picture_path(out: Path, name: str) -> Path:
    """Return the path of a picture beside a table."""
    return out.with_name(f"{out.stem}_{name}.png")


def _report(out: Path, result: Progress, error: float, seconds: float, names: list[str]) -> None:
    crumpled = len(result.states) - result.stable
    typer.echo(f"{counted(result.stable, 'stable state')}, {crumpled} crumpled, in {seconds:.0f} s")
    typer.echo(f"mesh error of the force: {100.0 * error:.2g} % (rms, from a mesh of half the size)")
    for sentence in result.stopped:
        typer.echo(f"not reached: {sentence}")
    for path in (out, *(picture_path(out, name) for name in names)):
        typer.echo(str(path))
