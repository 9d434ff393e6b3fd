"""Compare worm3d with other simulators, each at the step where its own distance error is 1 %.

    python tests/benchmarks/plant.py [--out DIR] [--segments 6 --segments 100] [--rival mujoco] [--ground isotropic]

on bristles, and on the isotropic ground that every simulator can express (`rivals.GROUNDS`): there their distances
can be compared, too. It prints a table and writes it as `rivals.md`, and everything as `rivals.json`. The rivals come
with the extra `bench`: one that is named and not installed ends the program with exit code 4, and so does having none
of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer
from calibration import calibrate
from rivals import DURATION, GROUNDS, REPEATS, RIVALS, TOLERANCE, WARM_UP, Measured, Rival, Task, load, measure
from speed_measures import TOLERANCE as NEWTON
from speed_measures import crawl, relative_error, steps_of
from step_search import NotConvergedError

from scenes.language.errors import MissingPartError, SceneError
from scenes.records import folder as folders
from scenes.records.folder import write_bytes
from scenes.records.text import Column, aligned, json_bytes, markdown_table, table
from scenes.running.packages import machine
from worm3d import Friction

OURS = "worm3d"
STEPS = (0.005, 0.010, 0.015, 0.020, 0.025, 0.030, 0.035, 0.040)
"""Time steps with which worm3d is tried [s]."""
REFERENCE = 0.0005
"""Time step of worm3d's reference [s]."""
LONG_WORM = 50
"""Number of segments from which on MuJoCo is also measured with the worm as a single tree."""
ONE_TREE_S = 0.5
"""Simulated time of MuJoCo's single tree where the search for its step takes too long [s]."""

COLUMNS = {
    "ground": Column("ground"),
    "N": Column("segments"),
    "simulator": Column("title"),
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
    + "; ".join(f"{name} {', '.join(f'{value:g}' for value in each.values())}" for name, each in GROUNDS.items())
    + "."
)


@dataclass(frozen=True)
class Contender:
    """A simulator on the worm of N segments on one of `rivals.GROUNDS`.

    Attributes
    ----------
    name, settings : str
        With version; the configuration in words.
    segments : int
    ground : str
    dt_s : float
        Largest step with an error of at most 1 % [s].
    error : float or None
        Relative error of the distance after 10 s by its own reference; None: unknown.
    distance : float
        Way of the centre of mass along x in 10 s [m].
    us_per_step : float
        [µs].
    real_time_factor : float
        Simulated over computing time, of the steps alone.
    real_time_factor_of_call : float or None
        Of the whole call, for worm3d.
    ratio, ratio_of_call : float or None
        Of worm3d's real-time factor to this one, of the steps alone and of the whole call.
    remark : str
    """

    name: str
    settings: str
    segments: int
    ground: str
    dt_s: float
    error: float | None
    distance: float
    us_per_step: float
    real_time_factor: float
    real_time_factor_of_call: float | None = None
    ratio: float | None = None
    ratio_of_call: float | None = None
    remark: str = ""

    @property
    def title(self) -> str:
        """Name with the remark."""
        return f"{self.name} ({self.remark})" if self.remark else self.name


def main(
    out: Annotated[Path | None, typer.Option(help="Folder to write to.")] = None,
    segments: Annotated[list[int] | None, typer.Option(help="Segments of the worm; repeatable.")] = None,
    rival: Annotated[list[str] | None, typer.Option(help="Rival to measure; repeatable.")] = None,
    ground: Annotated[list[str] | None, typer.Option(help="One of bristles, isotropic; repeatable.")] = None,
    search_s: Annotated[float, typer.Option(help="Wall-clock limit of a search for a step [s].")] = 60.0,
    force: Annotated[bool, typer.Option("--force", help="Replace what is there.")] = False,
) -> None:
    """Compare worm3d with other simulators at the same error of the distance."""
    try:
        grounds = known_grounds(ground)
        there, missing = present(rival, search_s)
        with folders.prepared(out, "bench-rivals", force=force) as folder:
            entries: list[Contender | str] = []
            for name in grounds:
                rivals = {each: load(each, search_s, name) for each in there}
                for n in segments or (6, 100):
                    entries += beside(n, name, rivals, search_s)
            contenders = [entry for entry in entries if isinstance(entry, Contender)]
            remarks = [*missing, *(entry for entry in entries if isinstance(entry, str))]
            remarks += [f"{c.name}, {c.ground}, N = {c.segments}: {c.settings}." for c in contenders]
            remarks.append(f"Calibration loop: {calibrate():.2f} us.")
            remarks += [f"{each.name} cannot express: {'; '.join(each.cannot)}." for each in there.values()]
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


def known_grounds(wanted: Sequence[str] | None) -> Sequence[str]:
    """Return the grounds to compare on, all if none is named.

    Raises
    ------
    SceneError
        One is named that nobody knows.
    """
    for name in wanted or ():
        if name not in GROUNDS:
            raise SceneError(f"--ground: got '{name}', must be one of {', '.join(GROUNDS)}")
    return wanted or tuple(GROUNDS)


def present(wanted: Sequence[str] | None, seconds: float) -> tuple[dict[str, Rival], list[str]]:
    """Return the rivals that are installed, and a sentence for each that is not.

    Raises
    ------
    SceneError
        One is named that nobody knows.
    MissingPartError
        One that is named, or everyone, is missing.
    """
    there, missing = {}, []
    for name in wanted or RIVALS:
        if name not in RIVALS:
            raise SceneError(f"--rival: got '{name}', must be one of {', '.join(RIVALS)}")
        try:
            there[name] = load(name, seconds)
        except MissingPartError as error:
            missing.append(str(error))
    if missing and (wanted or not there):
        raise MissingPartError(*missing)
    return there, missing


def beside(segments: int, ground: str, there: Mapping[str, Rival], seconds: float) -> list[Contender | str]:
    """Measure worm3d and every rival with N segments; a sentence for each that finds no step."""
    try:
        own = ours(segments, ground)
    except NotConvergedError as error:
        return [str(error)]
    found: list[Contender | str] = [own]
    for name, rival in there.items():
        entry = theirs(rival, own)
        found.append(entry)
        if name == "mujoco" and segments >= LONG_WORM and isinstance(entry, Contender):
            found.extend(one_tree(own, entry, seconds / 2.0))
    return found


def ours(segments: int, ground: str) -> Contender:
    """Measure worm3d at the largest of `STEPS` up to which all hold the tolerance.

    Raises
    ------
    NotConvergedError
        Not even the smallest does.
    """
    friction = Task.of(segments, ground).friction
    dt, error = largest_that_holds(distance_errors(segments, friction))
    remark = "larger steps not tried" if dt == max(STEPS) else ""
    crawl(segments, WARM_UP, dt, ground=friction)
    calls, walls, distances = zip(*(_timed(segments, dt, friction) for _ in range(REPEATS)), strict=True)
    dt = DURATION / steps_of(DURATION, dt)
    return Contender(
        name=f"{OURS} {metadata.version(OURS)}",
        settings=f"BDF2, every step recorded, ledger on, Newton to {NEWTON:g}",
        segments=segments,
        ground=ground,
        dt_s=dt,
        error=error,
        distance=distances[0],
        us_per_step=1e6 * min(walls) * dt / DURATION,
        real_time_factor=DURATION / min(walls),
        real_time_factor_of_call=DURATION / min(calls),
        remark=remark,
    )


def distance_errors(segments: int, ground: Friction) -> dict[float, float]:
    """Return worm3d's error of the distance after 10 s, by time step."""

    def distance(dt: float) -> float:
        return crawl(segments, DURATION, dt, recorded=False, ground=ground).distance

    reference = distance(REFERENCE)
    return {dt: relative_error(distance(dt), reference) for dt in STEPS}


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


def theirs(rival: Rival, own: Contender, remark: str = "") -> Contender | str:
    """Measure a rival against worm3d; a sentence where no step holds the tolerance in the time for the search."""
    try:
        return against(rival, own, measure(rival, own.segments), remark)
    except NotConvergedError as error:
        return f"{rival.name} ({rival.settings(own.segments)}), {own.segments} segments: {error}"


def against(rival: Rival, own: Contender, measured: Measured, remark: str = "") -> Contender:
    """Return a measured rival with worm3d's ratios to it."""
    of_call, factor = own.real_time_factor_of_call, measured.real_time_factor
    return Contender(
        name=rival.name,
        settings=rival.settings(own.segments),
        segments=own.segments,
        ground=own.ground,
        dt_s=measured.dt,
        error=measured.error,
        distance=measured.distance,
        us_per_step=measured.us_per_step,
        real_time_factor=factor,
        ratio=own.real_time_factor / factor,
        ratio_of_call=of_call / factor if of_call is not None else None,
        remark=remark,
    )


def one_tree(own: Contender, best: Contender, seconds: float) -> Iterator[Contender | str]:
    """Measure MuJoCo with the worm as a single kinematic tree, or at the step of its best configuration."""
    from mujoco_model import Settings
    from mujoco_worm import MuJoCoWorm

    rival = MuJoCoWorm(Settings(per_tree=own.segments), seconds, own.ground)
    found = theirs(rival, own, "one tree")
    if isinstance(found, Contender):
        yield found
        return
    factor = rival.real_time_factor(own.segments, best.dt_s, ONE_TREE_S)
    measured = Measured(best.dt_s, float("nan"), 1e6 * best.dt_s / factor, factor, float("nan"))
    yield against(rival, own, measured, "one tree, at the step of the line above")
    yield found


if __name__ == "__main__":
    typer.run(main)
