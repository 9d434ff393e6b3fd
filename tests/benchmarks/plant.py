"""Compare worm3d with other simulators, each at the step where its own distance error is 1 %.

    python tests/benchmarks/plant.py [--out DIR] [--segments 6 --segments 100] [--rival mujoco] [--ground isotropic]

on bristles, and on the isotropic ground that every simulator can express (`rivals.GROUNDS`): there their distances
can be compared, too. It prints a table and writes it as `rivals.md`, and everything as `rivals.json`. The rivals come
with the extra `bench`: one that is named and not installed ends the program with exit code 4, and so does having none
of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, replace
from importlib import metadata
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer
from calibration import calibrate
from rivals import DURATION, GROUNDS, REPEATS, RIVALS, TOLERANCE, WARM_UP, Contender, NotConvergedError, Rival, load
from speed_measures import TOLERANCE as NEWTON
from speed_measures import crawl, relative_error, steps_of

from scenes.language.errors import MissingPartError, SceneError
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import Column, aligned, json_bytes, markdown_table, table
from scenes.running.packages import machine
from worm3d import Friction

STEPS = (0.005, 0.010, 0.015, 0.020, 0.025, 0.030, 0.035, 0.040)
"""Time steps with which worm3d is tried [s]; they are judged by one of 0.5 ms."""

COLUMNS = {
    "ground": Column("ground"),
    "N": Column("segments"),
    "simulator": Column("name"),
    "dt [ms]": Column("dt_s", ".3g", 1e3),
    "error [%]": Column("error", ".2f", 100.0),
    "distance [m]": Column("distance", ".3f"),
    "us/step": Column("us_per_step", ".1f"),
    "real time": Column("real_time_factor", ".1f"),
    "worm3d over it": Column("ratio", ".1f"),
    "with the whole call": Column("ratio_of_call", ".1f"),
}
SAYS = (
    "Each at the largest step at which its own distance after 10 s is within 1 % of its own converged one, in the "
    "same run on the same machine; real-time factors of the steps alone, and worm3d's of the whole call too. "
    "Distances: of the centre of mass in 10 s. Friction forward, backward and sideways, and static over kinetic: "
    "bristles 0.03, 0.2, 0.2, 1.2; isotropic 0.2, 0.2, 0.2, 1."
)


def main(
    out: Annotated[Path | None, typer.Option(help="Folder to write to.")] = None,
    segments: Annotated[list[int] | None, typer.Option(help="Segments of the worm; repeatable.")] = None,
    rival: Annotated[list[str] | None, typer.Option(help="Rival to measure; repeatable.")] = None,
    ground: Annotated[list[str] | None, typer.Option(help="One of bristles, isotropic; repeatable.")] = None,
    search_s: Annotated[float, typer.Option(help="Wall-clock limit of a search for a step [s].")] = 60.0,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Compare worm3d with other simulators at the same error of the distance."""
    try:
        require_known("--ground", ground, GROUNDS)
        there, missing = present(rival)
        with folders.prepared(out, "bench-rivals", force=force) as folder:
            entries: list[Contender | str] = []
            for name in ground or GROUNDS:
                for n in segments or (6, 100):
                    entries += beside(n, name, there, search_s)
            contenders = [entry for entry in entries if isinstance(entry, Contender)]
            remarks = [*missing, *(entry for entry in entries if isinstance(entry, str))]
            remarks += [f"{c.name}, {c.ground}, N = {c.segments}: {c.settings}." for c in contenders]
            remarks.append(f"Calibration loop: {calibrate():.2f} us.")
            remarks += [f"{each.name} cannot express: {'; '.join(each.cannot)}." for each in there]
            _write(folder, contenders, remarks)
    except SceneError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(error.exit_code) from error
    for line in (*aligned(*table(COLUMNS, contenders)), *remarks, f"Written to {folder}: rivals.md, rivals.json"):
        typer.echo(line)


def _write(folder: Path, contenders: Sequence[Contender], remarks: Sequence[str]) -> None:
    about: dict[str, Any] = machine()
    for name in RIVALS:
        with suppress(metadata.PackageNotFoundError):
            about["versions"][name] = metadata.version(name)
    content = {"machine": about, "rivals": [asdict(each) for each in contenders], "remarks": remarks}
    write_bytes(folder / "rivals.json", json_bytes(content))
    lines = ["# worm3d beside other simulators", "", f"{about['cpu']}, {about['system']}, {about['date']}.", "", SAYS]
    lines += ["", *markdown_table(*table(COLUMNS, contenders)), *(line for each in remarks for line in ("", each))]
    write_bytes(folder / "rivals.md", ("\n".join(lines) + "\n").encode())


def require_known(option: str, wanted: Sequence[str] | None, known: Mapping[str, object]) -> None:
    """Raise SceneError if one is named that nobody knows."""
    for name in wanted or ():
        if name not in known:
            raise SceneError(f"{option}: got '{name}', must be one of {', '.join(known)}")


def present(wanted: Sequence[str] | None) -> tuple[list[Rival], list[str]]:
    """Return the rivals that are installed, and a sentence for each that is not.

    Raises
    ------
    SceneError
        One is named that nobody knows.
    MissingPartError
        One that is named, or everyone, is missing.
    """
    require_known("--rival", wanted, RIVALS)
    there, missing = [], []
    for name in wanted or RIVALS:
        try:
            there.append(load(name))
        except MissingPartError as error:
            missing.append(str(error))
    if missing and (wanted or not there):
        raise MissingPartError(*missing)
    return there, missing


def beside(segments: int, ground: str, there: Sequence[Rival], seconds: float) -> list[Contender | str]:
    """Measure worm3d and every rival with N segments; a sentence for each that finds no step."""
    try:
        own = ours(segments, ground)
    except NotConvergedError as error:
        return [str(error)]
    found: list[Contender | str] = [own]
    for rival in there:
        try:
            found.append(against(own, rival.measured(segments, ground, seconds)))
        except NotConvergedError as error:
            found.append(f"{rival.name} ({rival.settings(segments)}), {segments} segments: {error}")
    return found


def against(own: Contender, rival: Contender) -> Contender:
    """Return a rival with worm3d's ratios to it."""
    of_call, factor = own.real_time_factor_of_call, rival.real_time_factor
    of_call = of_call / factor if of_call is not None else None
    return replace(rival, ratio=own.real_time_factor / factor, ratio_of_call=of_call)


def ours(segments: int, ground: str) -> Contender:
    """Measure worm3d at the largest of `STEPS` up to which all hold the tolerance.

    Raises
    ------
    NotConvergedError
        Not even the smallest does.
    """
    friction = GROUNDS[ground]
    reference = _distance(segments, 0.0005, friction)
    errors = {dt: relative_error(_distance(segments, dt, friction), reference) for dt in STEPS}
    dt, error = largest_that_holds(errors)
    larger = ", larger steps not tried" if dt == max(STEPS) else ""
    crawl(segments, WARM_UP, dt, ground=friction)
    calls, walls, distances = zip(*(_timed(segments, dt, friction) for _ in range(REPEATS)), strict=True)
    dt = DURATION / steps_of(DURATION, dt)
    return Contender(
        name=f"worm3d {metadata.version('worm3d')}",
        settings=f"BDF2, every step recorded, ledger on, Newton to {NEWTON:g}{larger}",
        segments=segments,
        ground=ground,
        dt_s=dt,
        error=error,
        distance=distances[0],
        us_per_step=1e6 * min(walls) * dt / DURATION,
        real_time_factor=DURATION / min(walls),
        real_time_factor_of_call=DURATION / min(calls),
    )


def _distance(segments: int, dt: float, ground: Friction) -> float:
    return crawl(segments, DURATION, dt, recorded=False, ground=ground).distance


def largest_that_holds(errors: Mapping[float, float], tolerance: float = TOLERANCE) -> tuple[float, float]:
    """Return the largest step, and its error, up to which all hold the tolerance."""
    found: tuple[float, float] | None = None
    for dt in sorted(errors):
        if not errors[dt] <= tolerance:
            break
        found = dt, errors[dt]
    if found is None:
        dt = min(errors)
        raise NotConvergedError(f"worm3d: an error of {errors[dt]:.2g} at dt = {dt:g} s, must be {tolerance:g} or less")
    return found


def _timed(segments: int, dt: float, ground: Friction) -> tuple[float, float, float]:
    """Return the wall time of a call of `simulate`, and of its steps [s], and the distance [m]."""
    began = perf_counter()
    result = crawl(segments, DURATION, dt, ground=ground)
    return perf_counter() - began, result.wall_s, result.distance


if __name__ == "__main__":
    typer.run(main)
